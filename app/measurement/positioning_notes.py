"""What a person must know of a positioning test beside its figures, in sentences."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

import numpy as np

from app.arrays import FloatArray
from app.measurement.positioning_figures import drift_of
from app.measurement.run_scatter import varies
from app.measurement.stated_numbers import suspiciously_small
from app.units import MM_PER_M

RUNS_OF_THE_STANDARD: Final = 5
TARGETS_OF_THE_STANDARD: Final = 5
"""In each direction; targets per metre, and at least so many."""

SIGNIFICANT: Final = 0.01
"""Probability by chance below which runs are said to drift."""


def notes_on(targets_mm: FloatArray, runs: Mapping[str, FloatArray]) -> tuple[str, ...]:
    """Say what departs from the standard, what cannot be seen and what looks wrong.

    Parameters
    ----------
    targets_mm : ndarray, shape (m,) [mm]
        Target positions.
    runs
        Direction to readings, one row for each run [µm].

    Returns
    -------
    tuple of str
    """
    notes = _notes_on_the_standard(targets_mm, runs)
    drift = drift_of(runs)
    if drift is not None and drift[1] < SIGNIFICANT:
        notes.append(
            f"The runs drift by {drift[0]:.2f} µm from the first to the last: the axis warms up "
            "or cools down. The means belong to the mean thermal state of the runs, and s, R "
            "and A contain the drift."
        )
    for way, readings in runs.items():
        if len(readings) > 1 and not varies(readings):
            notes.append(
                f"The runs of {way}_um do not differ: they do not show their noise, and standard "
                "errors are those of repeatability_um, or unknown."
            )
        notes += suspiciously_small(f"{way}_um", readings)
    return tuple(notes)


def _notes_on_the_standard(targets_mm: FloatArray, runs: Mapping[str, FloatArray]) -> list[str]:
    notes = []
    fewest = min(len(readings) for readings in runs.values())
    if fewest < RUNS_OF_THE_STANDARD:
        less = "there is no repeatability and no accuracy" if fewest < 2 else "s is less certain"
        notes.append(
            f"ISO 230-2 asks for {RUNS_OF_THE_STANDARD} runs in each direction, came {fewest}: "
            f"{less}."
        )
    asked = max(1.0, float(np.ptp(targets_mm)) / MM_PER_M) * TARGETS_OF_THE_STANDARD
    if targets_mm.size < asked:
        notes.append(
            f"ISO 230-2 asks for at least {math.ceil(asked)} targets here, came {targets_mm.size}."
        )
    if "backward" not in runs:
        notes.append("Approached in one direction only: there is no reversal error.")
    steps = np.diff(targets_mm)
    if steps.size > 1 and np.ptp(steps) <= 1e-9 * float(np.abs(targets_mm).max()):
        notes.append(
            f"The targets are evenly spaced: an error whose period divides {steps[0]:g} mm "
            "cannot be seen."
        )
    return notes
