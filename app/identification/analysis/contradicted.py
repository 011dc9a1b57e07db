"""What is said of a stated repeatability that nearly all lengths contradict."""

from __future__ import annotations

from typing import Final

import numpy as np

from app.arrays import rms
from app.identification.analysis.finished_search import FinishedSearch
from app.search.noise import COMMON
from app.units import Unit

UM: Final = Unit.UM.symbol


def contradicted(found: FinishedSearch) -> tuple[str, str] | None:
    """Say by how much a stated repeatability is contradicted, and what to state.

    Returns
    -------
    tuple of str, or None
        A sentence for the summary and one for what to do next; None where nothing is contradicted.
    """
    noise = {c: one for c, one in found.findings.noise.items() if one.origin == COMMON}
    if not noise:
        return None
    shown = rms(np.array([one.repeatability for one in noise.values()]))
    before = rms(np.array([found.rows.noise[c].repeatability or np.nan for c in noise]))
    rows = found.residuals.rows
    which = np.unique(rows.verification[np.isin(rows.channel, list(noise))]).tolist()
    values = [rows.verifications[i].repeatability_um for i in which]
    stated = sorted({f"{value:.2g}" for value in values if value is not None}, key=float)
    number = " to ".join(dict.fromkeys([stated[0], stated[-1]]))
    return (
        f" The stated repeatability of {number} {UM} is contradicted: nearly all lengths scatter "
        f"by {shown:.2g} {UM} within their set-ups, {shown / before:.2g} times as much, and the "
        "answer rests on that.",
        f"State {shown:.2g} instead of {number} {UM} as repeatability_um, or measure some places "
        "twice within two minutes, which shows how well lengths repeat.",
    )
