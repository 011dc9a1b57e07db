"""What an analysis says of the sensors that components follow, in sentences."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from app.identification.analysis.analysis import TriedAssignment
from app.pages.report_parts.words import figure_text

DECIMALS: Final = 1


def proposal_words(one: TriedAssignment) -> str:
    """Say what a proposal leaves of set-ups that were held out."""
    before, after = (figure_text(size, DECIMALS) for size in (one.before_rms, one.after_rms))
    return (
        f"{one.component} with {one.other_sensor} instead of {one.present_sensor}: {before} → "
        f"{after} {one.unit} on held-out set-ups, and none of them gets markedly worse."
    )


def staying_words(tried: Sequence[TriedAssignment]) -> list[str]:
    """Say which components stay on their sensors though another one was found, and why."""
    return [one.sentence for one in tried if one.why_not]
