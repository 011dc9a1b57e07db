"""The report of an analysis: one page that needs nothing else."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from app.identification.analysis import Analysis
from app.pages.analysis_report.component_table import component_section
from app.pages.analysis_report.detectable import detectable_section
from app.pages.analysis_report.effect_section import effect_section
from app.pages.analysis_report.overview import header, next_steps, tiles
from app.pages.analysis_report.remains import (
    excluded_section,
    not_testable_section,
    unexplained_section,
)
from app.pages.analysis_report.visit_plots import visit_drawings
from app.pages.report_parts.drawing import Drawing, figures_script
from app.pages.report_parts.style import SCRIPT, STYLE
from app.pages.report_parts.words import escaped
from app.pictures.page import INLINE, html_head
from app.services.report_head import ReportHead

WORDS: Final = """<footer class="quiet"><p>A residual is what an instrument measured minus what
the model predicted. RMS is the root mean square. A visit is what was measured with one set-up.
Held-out visits took no part in finding an effect or in estimating it. Evidence is twice the
logarithm of a Bayes factor, the prior spread evenly inside each kind of effect.</p></footer>"""


def analysis_report(head: ReportHead, result: Analysis, *, plotly_js: str = INLINE) -> str:
    """Write the page of an analysis.

    Parameters
    ----------
    head
        Which analysis.
    result
        Its answer as it is stored, JSON's own types.
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
    effects, drawings = effect_section(result)
    visits = visit_drawings(result)
    # Where nothing was found, what would have been found is the answer.
    smallest = detectable_section(result)
    title = escaped(f"{head.machine_name}: analysis of residuals")
    return f"""{html_head(title, STYLE, plotly_js)}
<body>
{header(head, result)}
<main>
{tiles(result)}
{next_steps(result)}
{component_section(result)}
{effects or smallest}
{_over_time(visits, bool(effects))}
{unexplained_section(result)}
{excluded_section(result)}
{not_testable_section(result)}
{smallest if effects else ""}
</main>
{WORDS}
{figures_script([*drawings, *visits])}
<script>{SCRIPT}</script>
</body>
</html>
"""


def _over_time(visits: Sequence[Drawing], is_changed: bool) -> str:
    """Write the section of the visits' means."""
    if not visits:
        return ""
    marks = "Rings: before; filled: after." if is_changed else "Rings: each visit's mean residual."
    places = "".join(d.place() for d in visits)
    if any(isinstance(t.get("marker", {}).get("symbol"), list) for d in visits for t in d.data):
        marks += " Triangles point the way of approach, where an error reverses with it."
    return f"""<section><h2>Over time, visit by visit</h2>
<p class="quiet">{marks} Grey: where 95 % of the visits' means should lie if repeatability and
set-up scatter were all. Components of effects first, then those that stand out most; times are
UTC.</p>
<div class="plots three">{places}</div></section>"""
