"""A figure on its way out: as a page for people, as JSON for programs."""

from __future__ import annotations

import html
import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final

from app.errors import InvalidContent

if TYPE_CHECKING:
    from plotly.graph_objects import Figure  # type: ignore[import-untyped]

INLINE: Final = "inline"

FIGURE_ID: Final = "work-volume"

CONFIG: Final = {
    "displaylogo": False,
    "responsive": True,
    "toImageButtonOptions": {"format": "png", "scale": 2, "filename": FIGURE_ID},
}

FIT: Final = """
  document.getElementById("not-drawn").remove();
  const picture = document.getElementById("{plot_id}");
  const shape = picture.clientWidth / picture.clientHeight / 1.6;
  if (shape < 1) {
    const {x, y, z} = picture.layout.scene.aspectratio;
    const scale = {x: x * shape, y: y * shape, z: z * shape};
    Plotly.relayout(picture, {"scene.aspectratio": scale});
  }
"""
"""Once all is drawn: the words that stand in for it go, and it is fitted into the window.

Without perspective plotly cuts off what is wider than a narrow window.
"""

STYLE: Final = """
  :root { color-scheme: light; }
  html, body { height: 100%; margin: 0; }
  body { display: flex; flex-direction: column; background: #fff; color: #1f2933;
         font: 15px/1.45 Inter, "Helvetica Neue", Helvetica, Arial, sans-serif; }
  header, footer { padding: 0.9rem 1.5rem; overflow-wrap: anywhere; }
  h1 { margin: 0; font-size: 1.35rem; font-weight: 600; line-height: 1.25; }
  header p { margin: 0.25rem 0 0; color: #52606d; }
  header .warnings { margin: 0.6rem 0 0; padding: 0.4rem 0.8rem 0.4rem 2rem;
                     background: #fff8e1; border-left: 4px solid #b7791f; color: #5f370e; }
  #not-drawn { margin: 0; padding: 1rem 1.5rem; }
  main { flex: 1 1 auto; min-height: 22rem; position: relative; }
  main > div { position: absolute; inset: 0; }
  footer { border-top: 1px solid #e4e7eb; color: #323f4b; font-size: 0.9rem; }
  @page { size: landscape; margin: 12mm; }
  @media print {
    html, body { height: auto; }
    header, footer { padding-left: 0; padding-right: 0; }
    main { min-height: 135mm; }
    .modebar { display: none; }
  }
"""

_ADDRESS: Final = re.compile(r"https?://[^/\s]\S*|(\.{0,2}/(?!/)|[\w-])[^\s:]*", re.ASCII)
"""Of a file over HTTP, or beside the page; no other scheme, and no other host by `//`."""


def page(figure: Figure, *, plotly_js: str) -> str:
    """Write a complete page around a picture of the work volume.

    Parameters
    ----------
    figure
        What `work_volume_picture` drew.
    plotly_js
        `inline`: plotly's JavaScript, some 5 MB, becomes part of the page, which then
        needs nothing else; or the address from which the page is to load it.

    Returns
    -------
    str
        HTML. The same figure gives the same page.

    Raises
    ------
    InvalidContent
        If the address is none of a file over HTTP.

    Notes
    -----
    Title, subtitle, warnings and what is drawn stand outside the figure, where they wrap. They
    are shown letter by letter: no markup in them has an effect. Where plotly does not run, a
    sentence stands in the figure's place.
    """
    meta = figure.layout.meta or {}
    texts = {name: html.escape(str(text)) for name, text in meta.items()}
    title, subtitle = texts.get("title", ""), texts.get("subtitle", "")
    return f"""{html_head(title, STYLE, plotly_js)}
<body>
<header>
<h1>{title}</h1>
{f"<p>{subtitle}</p>" if subtitle else ""}
{_warnings(meta)}
</header>
<main>
<p id="not-drawn">{_not_drawn(plotly_js)}</p>
{_drawing(figure)}
</main>
<footer>{texts.get("drawn", "")}</footer>
</body>
</html>
"""


def html_head(title: str, style: str, plotly_js: str) -> str:
    """Write the beginning of a page, up to its body.

    Parameters
    ----------
    title
        HTML, with what users wrote escaped.
    style
        CSS.
    plotly_js
        As for `page`.

    Returns
    -------
    str
        HTML.

    Raises
    ------
    InvalidContent
        If the address is none of a file over HTTP.
    """
    return f"""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<style>{style}</style>
{_plotly_script(plotly_js)}
</head>"""


def figure_json(figure: Figure) -> str:
    """Write a picture as plotly's JSON.

    Parameters
    ----------
    figure
        What `work_volume_picture` drew.

    Returns
    -------
    str
        Strict JSON with `data` and `layout`, which every plotly library reads.
    """
    written: str = figure.to_json()
    return written


def _plotly_script(plotly_js: str) -> str:
    """Bring plotly's JavaScript into a page."""
    if plotly_js == INLINE:
        from plotly.offline import get_plotlyjs  # type: ignore[import-untyped]

        return f"<script>{get_plotlyjs()}</script>"
    if not _ADDRESS.fullmatch(plotly_js):
        raise InvalidContent.of_field(
            "plotly_js", f"expected `{INLINE}` or the address of plotly.min.js, came {plotly_js!r}"
        )
    return f'<script src="{html.escape(plotly_js)}" charset="utf-8"></script>'


def _warnings(meta: Mapping[str, Any]) -> str:
    """List what is to be said against the errors that are drawn, if anything is."""
    said = [] if meta.get("complete", True) else ["not complete"]
    said += meta.get("warnings", ())
    if not said:
        return ""
    items = "\n".join(f"<li>{html.escape(str(text))}</li>" for text in said)
    return f'<ul class="warnings" aria-label="warnings">\n{items}\n</ul>'


def _not_drawn(plotly_js: str) -> str:
    """Say why there is no drawing, for whoever sees none."""
    if plotly_js == INLINE:
        return "The picture is not drawn yet: the browser has to run this page's JavaScript."
    return (
        "The picture is not drawn yet: the browser has to run JavaScript, and loads "
        f"{html.escape(plotly_js)} from the service that wrote this page. Kept as a file, the "
        "page cannot draw; <code>thermap picture</code> writes one that needs no other file."
    )


def _drawing(figure: Figure) -> str:
    """The figure without the texts that the page has around it."""
    from plotly.io import to_html  # type: ignore[import-untyped]

    drawn: dict[str, Any] = figure.to_dict()
    margin = {**drawn["layout"].get("margin", {}), "t": 30, "b": 40}
    layout = {**drawn["layout"], "title": {}, "annotations": [], "margin": margin}
    written: str = to_html(
        {**drawn, "layout": layout},
        config=CONFIG,
        include_plotlyjs=False,
        full_html=False,
        div_id=FIGURE_ID,
        post_script=FIT,
    )
    return written
