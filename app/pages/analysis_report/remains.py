"""What remains: structure without a name, observations left out, and what could not be tested."""

from __future__ import annotations

from app.errors import counted
from app.identification.analysis import Analysis, UnexplainedPart
from app.pages.analysis_report.names import TESTS, untested_together
from app.pages.report_parts.component_names import component_name
from app.pages.report_parts.tables import NUMBER, Column, body, reasons_table, row, table
from app.pages.report_parts.words import decimals_for, escaped, figure_text, sentence


def unexplained_section(result: Analysis) -> str:
    """Write what no effect of the library explains, with leads.

    Parameters
    ----------
    result
        The analysis' answer.

    Returns
    -------
    str
        HTML; says so where nothing is left.
    """
    parts = result.unexplained
    if not parts:
        told = "<p>Nothing that stands out of the noise is left without an explanation.</p>"
        return f"<section><h2>What remains unexplained</h2>{told}</section>"
    columns = (
        Column("component"),
        Column("RMS left", NUMBER),
        Column("scatter of one observation", NUMBER),
        Column("moves with"),
        Column("how it shows"),
    )
    rows = body(row(columns, _part(part)) for part in parts)
    return f"""<section><h2>What remains unexplained</h2>
<p>Structure is left that no effect of the library fits. The leads are smooth curves without a
physical meaning: they say where to look, and nothing of them can be adopted.</p>
{table(columns, rows)}</section>"""


def excluded_section(result: Analysis) -> str:
    """Write which observations took no part, and why.

    Parameters
    ----------
    result
        The analysis' answer.

    Returns
    -------
    str
        HTML.
    """
    took_part = f"{counted(result.values, 'value')} of {counted(result.visits, 'visit')}"
    told = f"{took_part} took part."
    if not result.excluded:
        return f"<section><h2>Left out</h2><p>{told} None was left out.</p></section>"
    return f"""<section><h2>Left out</h2><p>{told} The others did not, and why:</p>
{reasons_table(result.excluded)}</section>"""


def not_testable_section(result: Analysis) -> str:
    """Write what these observations cannot show, and why; one reason for many kinds once.

    Parameters
    ----------
    result
        The analysis' answer.

    Returns
    -------
    str
        HTML, empty where everything could be tested.
    """
    if not result.not_testable:
        return ""
    columns = (Column("effect"), Column("on"), Column("because"))
    rows = body(
        row(columns, [escaped(kinds), escaped(on or "–"), sentence(reason)])
        for kinds, on, reason in untested_together(result.not_testable)
    )
    return f"<section><h2>What could not be tested</h2>{table(columns, rows)}</section>"


def _part(part: UnexplainedPart) -> list[str]:
    decimals, unit = decimals_for(part.noise_um), escaped(part.unit)
    return [
        escaped(component_name(part.component)),
        f"{figure_text(part.rms_um, decimals)} {unit}",
        f"{figure_text(part.noise_um, decimals)} {unit}",
        "; ".join(map(sentence, part.leads)) or "nothing that was recorded",
        "; ".join(escaped(TESTS.get(test, test)) for test in part.tests),
    ]
