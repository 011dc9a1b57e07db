"""How a report looks, on a screen, on a phone and on A4; and what its figures do."""

from __future__ import annotations

from typing import Final

from app.pictures.colours import FAINT, FONT, INK, QUIET

BEFORE: Final = "#b45309"
"""Residuals without the effects: rings."""

AFTER: Final = "#0f766e"
"""Residuals with the effects: filled."""

SOFT: Final = "#f5f7fa"

PRINTED_WIDTH_PX: Final = 680
"""Of A4 between its margins, at 96 px to the inch."""

GAP_PX: Final = 12

STYLE: Final = f"""
  :root {{ color-scheme: light; }}
  html {{ scrollbar-gutter: stable; }}
  * {{ box-sizing: border-box; }}
  body {{ margin: 0 auto; padding: 2rem 1.5rem 3rem; max-width: 66rem; background: #fff;
         color: {INK}; font: 15px/1.5 {FONT}; overflow-wrap: break-word; }}
  h1 {{ margin: 0.1rem 0 0.6rem; font-size: 1.6rem; line-height: 1.2; font-weight: 650; }}
  h2 {{ margin: 2.4rem 0 0.5rem; padding-top: 0.8rem; border-top: 1px solid {FAINT};
        font-size: 1.2rem; font-weight: 650; }}
  h3 {{ margin: 0 0 0.3rem; font-size: 1.05rem; font-weight: 650; }}
  h4 {{ margin: 1.1rem 0 0.3rem; font-size: 0.95rem; font-weight: 650; }}
  p {{ margin: 0.3rem 0 0.6rem; max-width: 48rem; }}
  .quiet, figcaption, .facts {{ color: #52606d; font-size: 0.9rem; }}
  .summary {{ font-size: 1.15rem; line-height: 1.45; margin: 0.6rem 0; }}
  .badge {{ display: inline-block; padding: 0.1rem 0.6rem; border: 1.5px solid; border-radius: 1rem;
           font-size: 0.9rem; font-weight: 600; white-space: normal; }}
  .effects-found, .confirmed {{ color: #0b5f58; background: #ecfdf8; }}
  .nothing-found {{ color: #334e68; background: {SOFT}; }}
  .unexplained, .suspected, .not-confirmable, .proxy {{ color: #8a3b04; background: #fff7ed; }}
  .facts {{ display: grid; grid-template-columns: max-content 1fr; gap: 0.1rem 0.9rem;
           margin: 0.8rem 0; }}
  .facts dt {{ color: {QUIET}; }}
  .facts dd {{ margin: 0; }}
  .tiles {{ display: grid; grid-template-columns: repeat(auto-fit, minmax(11rem, 1fr)); gap: 12px;
           margin: 1.2rem 0; }}
  .tile {{ border: 1px solid {FAINT}; border-radius: 6px; padding: 0.6rem 0.8rem; }}
  .tile b {{ display: block; font-size: 1.35rem; font-weight: 650; line-height: 1.3; }}
  .tile span {{ display: block; font-size: 0.85rem; color: #52606d; line-height: 1.35; }}
  .next {{ background: {SOFT}; border-left: 4px solid {INK}; padding: 0.7rem 1rem;
          margin: 1.2rem 0; }}
  .next h2 {{ border: 0; margin: 0; padding: 0; font-size: 1.05rem; }}
  ol, ul {{ margin: 0.3rem 0 0.6rem; padding-left: 1.4rem; }}
  li {{ margin: 0.2rem 0; max-width: 46rem; }}
  .warning {{ border-left: 4px solid {BEFORE}; background: #fff7ed; padding: 0.4rem 0.8rem;
             margin: 0.6rem 0; max-width: 48rem; }}
  .wide {{ overflow-x: auto;
          background: linear-gradient(to right, #fff 30%, transparent) left / 2.5rem 100%,
                      linear-gradient(to left, #fff 30%, transparent) right / 2.5rem 100%,
                      linear-gradient(to right, {FAINT}, transparent) left / 0.9rem 100%,
                      linear-gradient(to left, {FAINT}, transparent) right / 0.9rem 100%;
          background-repeat: no-repeat; background-attachment: local, local, scroll, scroll; }}
  table {{ border-collapse: collapse; font-variant-numeric: tabular-nums; }}
  .wide > table {{ width: 100%; }}
  caption {{ text-align: left; color: #52606d; font-size: 0.9rem; padding-bottom: 0.3rem; }}
  th, td {{ padding: 0.25rem 0.9rem 0.25rem 0; text-align: left; vertical-align: baseline;
           border-bottom: 1px solid {FAINT}; }}
  thead th {{ font-weight: 600; font-size: 0.85rem; vertical-align: bottom; color: #323f4b; }}
  tbody th {{ font-weight: 500; }}
  .figures table {{ table-layout: fixed; }}
  .narrow .wide > table {{ width: auto; }}
  tr.unit th {{ padding-top: 0.7rem; font-weight: 600; color: #323f4b; }}
  .number {{ text-align: right; white-space: nowrap; }}
  thead .number {{ white-space: normal; overflow-wrap: normal; }}
  .strong td, .strong th {{ font-weight: 650; }}
  .picture {{ padding: 0 0 0 0.6rem; }}
  svg {{ display: block; width: 100%; height: 20px; overflow: visible; }}
  .bar {{ display: block; height: 0.8rem; min-width: 1px; background: #9fb3c8; }}
  .own .bar {{ background: {AFTER}; }}
  .tied .bar {{ background: repeating-linear-gradient(45deg, {BEFORE} 0 4px, #fff 4px 7px); }}
  td.bars {{ width: 36%; min-width: 5rem; vertical-align: middle; }}
  .effect {{ border: 1px solid {FAINT}; border-radius: 6px; padding: 0.9rem 1.1rem;
            margin: 0.9rem 0; }}
  .effect .badge {{ margin: 0.1rem 0.4rem 0.2rem 0; }}
  .plots {{ display: grid; gap: {GAP_PX}px; margin: 0.6rem 0; }}
  .plots.two {{ grid-template-columns: repeat(2, minmax(0, 1fr)); }}
  .plots.three {{ grid-template-columns: repeat(3, minmax(0, 1fr)); }}
  figure {{ margin: 0; min-width: 0; }}
  figure h4 {{ margin: 0.2rem 0 0; }}
  .plot {{ height: 250px; }}
  .three .plot {{ height: 190px; }}
  details summary {{ cursor: pointer; margin: 0.6rem 0; font-weight: 600; }}
  footer {{ margin-top: 2.5rem; padding-top: 0.8rem; border-top: 1px solid {FAINT}; }}
  @media screen and (max-width: 44rem) {{
    body {{ padding: 1rem 0.8rem 2rem; }}
    h1 {{ font-size: 1.35rem; }}
    .facts {{ grid-template-columns: 1fr; }}
    .facts dd {{ margin-bottom: 0.35rem; }}
    .plots.two, .plots.three {{ grid-template-columns: minmax(0, 1fr); }}
    .tiles {{ grid-template-columns: repeat(2, 1fr); }}
    .wide > table:has(.picture) {{ min-width: 50rem; }}
    td.text {{ min-width: 8rem; }}
    .effect {{ padding: 0.7rem 0.7rem; }}
  }}
  @page {{ size: A4 portrait; margin: 15mm; }}
  @media print {{
    * {{ print-color-adjust: exact; -webkit-print-color-adjust: exact; }}
    body {{ max-width: none; padding: 0; font-size: 10.5pt; }}
    h2, h3, h4, .plots h4 {{ break-after: avoid; }}
    h2 {{ margin-top: 1.4rem; }}
    h2 + p {{ break-after: avoid; }}
    figure, .plots.two, tr, .tile {{ break-inside: avoid; }}
    .plots.two {{ grid-template-columns: repeat(2, minmax(0, 1fr)); }}
    .plots.three {{ grid-template-columns: repeat(3, minmax(0, 1fr)); }}
    .tiles {{ grid-template-columns: repeat(4, 1fr); }}
    .tile b {{ font-size: 1.15rem; }}
    .wide {{ overflow: visible; background: none; }}
    .figures {{ font-size: 9pt; }}
    .modebar {{ display: none; }}
    details:not([open]) {{ display: none; }}
  }}
"""

# plotly writes its figures as wide as the window is; paper has another width, and what is
# hidden has none.
SCRIPT: Final = f"""
  const figures = JSON.parse(document.getElementById("figures").textContent);
  const config = {{displayModeBar: false, responsive: true, displaylogo: false}};
  const UNSEEN = "details:not([open]), [hidden]";
  const drawn = new Set();
  function draw() {{
    for (const [id, figure] of Object.entries(figures)) {{
      const place = document.getElementById(id);
      if (drawn.has(id) || place.closest(UNSEEN)) continue;
      drawn.add(id);
      Plotly.newPlot(place, figure.data, figure.layout, config);
    }}
  }}
  draw();
  addEventListener("toggle", draw, true);
  function fit(printing) {{
    for (const id of drawn) {{
      const plot = document.getElementById(id);
      if (plot.closest(UNSEEN)) continue;
      const grid = plot.closest(".plots").classList;
      const columns = grid.contains("three") ? 3 : grid.contains("two") ? 2 : 1;
      const width = Math.floor(({PRINTED_WIDTH_PX} - {GAP_PX} * (columns - 1)) / columns);
      Plotly.relayout(plot, printing ? {{autosize: false, width}} : {{autosize: true}});
    }}
  }}
  addEventListener("beforeprint", () => fit(true));
  addEventListener("afterprint", () => fit(false));
"""
