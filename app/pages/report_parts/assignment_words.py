"""What an analysis says of the sensors that components follow, in sentences."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from typing import Final

from app.errors import list_names
from app.identification.analysis.analysis import TriedAssignment
from app.pages.report_parts.words import figure_text

DECIMALS: Final = 1


def proposal_words(one: TriedAssignment) -> str:
    """Say what a proposal leaves, in all set-ups and in the one that fares worst with it."""
    sizes = (one.before_rms, one.after_rms, one.worst_before_rms, one.worst_after_rms)
    before, after, worst_before, worst_after = (figure_text(size, DECIMALS) for size in sizes)
    return (
        f"{one.component} with {one.other_sensor} instead of {one.present_sensor}: {before} → "
        f"{after} {one.unit} over {one.setups} set-ups, each held out in turn; the one that fares "
        f"worst, {one.worst_setup}, goes {worst_before} → {worst_after} {one.unit}."
    )


def staying_words(tried: Sequence[TriedAssignment]) -> list[str]:
    """Say which components stay on their sensors, and which could not be judged and why."""
    stay = [one.component for one in tried if one.why_not and one.other_sensor]
    found = []
    if stay:
        found.append(
            f"{list_names(stay, 8)}: no other sensor would leave markedly less on held-out set-ups."
        )
    reasons: dict[str, list[str]] = defaultdict(list)
    for one in tried:
        if one.why_not and one.other_sensor is None:
            reasons[one.why_not].append(one.component)
    found += [f"{list_names(codes, 8)}: not judged: {why}." for why, codes in reasons.items()]
    return found
