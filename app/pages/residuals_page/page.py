"""Residuals as one page that needs nothing else."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from app.errors import counted
from app.identification.residual_curves import ComponentCurves
from app.identification.residual_report import ResidualFigures
from app.pages.report_parts.drawing import figures_script
from app.pages.report_parts.style import SCRIPT, STYLE
from app.pages.report_parts.tables import reasons_table
from app.pages.report_parts.words import escaped
from app.pages.residuals_page.component_blocks import component_blocks, plots_section
from app.pages.residuals_page.head import ResidualsHead, header
from app.pages.residuals_page.size_table import size_section
from app.pictures.page import INLINE, html_head

WORDS: Final = """<footer class="quiet"><p>A residual is what an instrument measured minus what
the model predicted, without the unknown zero of a datum that is not absolute. RMS is the root mean
square; repeatability the standard deviation of one observation.</p></footer>"""

OWN_STYLE: Final = """
  .figures td a, .figures th a { color: inherit; text-underline-offset: 0.15em; }
  .component { margin: 1.4rem 0 2rem; scroll-margin-top: 1rem; }
  .component h3 + p { margin-bottom: 0; }
  .component .plot { height: 170px; }
  .component h4 { font-size: 0.85rem; white-space: nowrap; overflow: hidden;
                  text-overflow: ellipsis; }
  .choice select { font: inherit; max-width: 100%; padding: 0.2rem 0.4rem; }
  @media screen and (max-width: 44rem) {
    .component .plot { height: 220px; }
  }
  @media print {
    .component { margin: 0.8rem 0 1rem; }
    .component h4 { font-size: 8pt; }
    .choice, details { display: none; }
    h3 + p { break-after: avoid; }
    .component { break-inside: avoid; }
  }
"""

CHOICE: Final = """
  const choice = document.getElementById("choice");
  const blocks = [...document.querySelectorAll(".component")];
  function show() {
    for (const block of blocks) {
      block.hidden = choice.value ? block.id !== choice.value : !block.classList.contains("open");
    }
    draw();
    for (const id of drawn) {
      const place = document.getElementById(id);
      if (!place.closest(UNSEEN)) Plotly.Plots.resize(place);
    }
  }
  function follow() {
    const block = document.getElementById(location.hash.slice(1));
    if (!blocks.includes(block)) return;
    if (block.hidden) {
      choice.value = block.id;
      show();
    }
    block.scrollIntoView();
  }
  if (choice) {
    choice.addEventListener("change", () => {
      history.replaceState(null, "", location.pathname + location.search);
      show();
    });
    addEventListener("hashchange", follow);
    show();
    follow();
  }
"""


def residuals_page(
    head: ResidualsHead,
    figures: ResidualFigures,
    curves: Sequence[ComponentCurves],
    *,
    plotly_js: str = INLINE,
) -> str:
    """Write the page of residuals.

    Parameters
    ----------
    head
        Whose residuals.
    figures
        The residuals.
    curves
        Of each component, and of all lengths.
    plotly_js
        As for a picture: `inline`, or the address from which plotly is to be loaded.

    Returns
    -------
    str
        HTML. The same answer gives the same page. What users wrote is shown letter by letter.

    Raises
    ------
    InvalidContent
        If the address is none of a file over HTTP.
    """
    blocks = component_blocks(figures, curves)
    places = {block.size.component: block.place for block in blocks}
    drawings = [drawing for block in blocks for drawing in block.drawings]
    title = escaped(f"{head.machine_name}: residuals")
    return f"""{html_head(title, STYLE + OWN_STYLE, plotly_js)}
<body>
{header(head, figures)}
<main>
{size_section(figures, places)}
{plots_section(blocks, figures)}
{_left_out(figures)}
</main>
{WORDS}
{figures_script(drawings)}
<script>{SCRIPT}{CHOICE}</script>
</body>
</html>
"""


def _left_out(figures: ResidualFigures) -> str:
    """Write what could not be held against the model, and why."""
    values = counted(figures.count, "value")
    told = f"{values} could be held against the model"
    if not figures.excluded:
        return f"<section><h2>Left out</h2><p>{told}; none was left out.</p></section>"
    others = counted(sum(one.count for one in figures.excluded), "value")
    return f"""<section><h2>Left out</h2><p>{told}; {others} could not, and why:</p>
{reasons_table(figures.excluded)}</section>"""
