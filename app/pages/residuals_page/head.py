"""What stands at the top: whose residuals, how large they are in one sentence, what was used."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from app.errors import counted, list_names
from app.identification.analysis.residual_report import ResidualFigures
from app.pages.report_parts.certificate import machine_facts, measured_facts, written_by
from app.pages.report_parts.words import decimals_for, figure_text, percent_text
from app.units import utc_time

MOST_LABELS: Final = 12

BY_NOISE: Final = 0.32
"""Share of normal noise beyond one standard deviation."""

DATUMS: Final = {
    "absolute": "absolute (the instrument's zero is the model's zero)",
    "first": "first (zeroed at the first observation: the residual there is taken off)",
    "free": "free (the zero is not known: the mean of each component is taken off)",
}


@dataclass(frozen=True, slots=True)
class ResidualsHead:
    """Of which machine, and of which measurements.

    Parameters
    ----------
    chain
        Order of its axes, such as `XYFZ`.
    first_s, last_s
        When the first and the last value were measured [s since 1970-01-01 UTC].
    """

    machine_id: str
    machine_name: str
    chain: str
    model_version: int
    verifications: Sequence[tuple[str, str]]
    first_s: float
    last_s: float
    serial_number: str | None = None
    instruments: Sequence[str | None] = ()
    operators: Sequence[str | None] = ()
    temperatures_c: Mapping[str, tuple[float, float]] = field(default_factory=dict)


def size_sentence(figures: ResidualFigures) -> str:
    """Say how large the residuals are, and beside what, as plain text."""
    denied = f" {figures.contradiction}" if figures.contradiction else ""
    return _size_sentence(figures) + denied


def _size_sentence(figures: ResidualFigures) -> str:
    size = figures.overall
    if size is None:
        measured = counted(figures.count, "value")
        return f"{measured}, none of them a length: each component is shown in its own unit below."
    decimals, unit = decimals_for(size.repeatability), size.unit
    rms, p95 = (figure_text(one, decimals) for one in (size.rms, size.p95))
    if size.count == 1:
        return f"The one residual that is a length is {figure_text(size.mean, decimals)} {unit}."
    most = f"{percent_text(0.95)} of them within ±{p95} {unit}"
    text = f"The residuals are {rms} {unit} (root mean square), {most}"
    if size.share_above_repeatability is None:
        return f"{text}."
    noise = figure_text(size.repeatability, decimals)
    share = percent_text(size.share_above_repeatability)
    from_first = ", √2 of it from a first observation" if size.zero == "first" else ""
    return (
        f"{text}; {share} exceed the repeatability of {noise} {unit}{from_first}, as "
        f"{percent_text(BY_NOISE)} would if there were nothing else."
    )


def head_facts(head: ResidualsHead, figures: ResidualFigures) -> list[tuple[str, str]]:
    """Say what was held against what."""
    values = figures.count
    labels = [label for label, _ in head.verifications]
    datums = Counter(datum for _, datum in head.verifications)
    text = [
        DATUMS.get(datum, datum) + (f" in {count}" if len(datums) > 1 else "")
        for datum, count in datums.items()
    ]
    measured = utc_time(head.first_s), utc_time(head.last_s)
    return [
        *machine_facts(head.machine_id, head.chain, head.serial_number).items(),
        *measured_facts(head.instruments, head.operators, measured, head.temperatures_c).items(),
        ("model", f"version {head.model_version}, its adopted effects included; {written_by()}"),
        ("verifications", list_names(labels, MOST_LABELS)),
        ("datum", "; ".join(text)),
        ("values", f"{values} of {counted(len(figures.components), 'component')}"),
    ]
