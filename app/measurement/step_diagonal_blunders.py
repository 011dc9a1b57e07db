"""A reading of a step diagonal that contradicts the others: named with its diagonal and step.

A wrong reading is in two single steps, the one before it and the one behind it, and with
opposite signs in two closures; a jump that stays, such as lost counts, is in one. From the
closures alone a reading of one diagonal cannot be told from one of another that moved the
same two axes: the true one leaves the smoother errors when it is put right.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np

from app.arrays import FloatArray
from app.geometry.components import LINEAR_LETTERS
from app.measurement.outliers import far_closures
from app.measurement.step_diagonal_uncertainty import ROUNDING_UM, closure_um, solution_of
from app.measurement.step_diagonal_walk import StepWalk

SMOOTHER: Final = 4.0
"""So many times the squares of the smoothest errors are still as smooth."""

WORSE: Final = 16.0
"""So many closures' variances may an explanation leave more than the best."""


class Blunder(NamedTuple):
    """One reading, or one that begins a jump, by how much it is wrong, and what that leaves.

    `misfit` is the sum of squares of the closures that are left, `roughness` that of the
    errors' steps beside those of the other intervals [µm²].
    """

    diagonal: int
    reading: int
    jumps: bool
    size_um: float
    misfit: float
    roughness: float


def blunders_in(walk: StepWalk, increments_um: FloatArray, closure: FloatArray) -> list[str]:
    """Name the reading that makes closures lie far from the rest.

    Parameters
    ----------
    walk
        The steps of four diagonals.
    increments_um : ndarray, shape (4, 3, n) [µm]
        As `StepWalk.by_interval` gives them.
    closure : ndarray, shape (3, n) [µm]
        Their closures.

    Returns
    -------
    list of str
        One sentence, or none; it names two readings where both explain the closures as
        well, and the steps where no single reading does.
    """
    far = far_closures(closure)
    if not far:
        return []
    axis, interval = divmod(far[0], walk.steps)
    found = [
        blunder
        for candidate in _readings_at(walk, axis, interval)
        if (blunder := _judged(walk, increments_um, closure, candidate)) is not None
    ]
    likely = _likely(found, closure.size)
    if likely:
        said = ", or ".join(_said(walk, one) for one in likely)
        return [f"Suspicious, far from what the other diagonals say, and kept: {said}."]
    places = sorted({f"{LINEAR_LETTERS[i // walk.steps]}{i % walk.steps + 1}" for i in far})
    return [
        "Suspicious: the diagonals contradict each other far more than elsewhere where "
        f"{', '.join(places)} (axis and its step counted from below) were crossed, and no single "
        "reading explains it."
    ]


def _readings_at(walk: StepWalk, axis: int, interval: int) -> Iterator[tuple[int, int, bool]]:
    """Give readings whose error enters an interval: diagonal, which, whether it stays."""
    for diagonal, ways in enumerate(walk.ways):
        step = interval if ways[axis] > 0 else walk.steps - 1 - interval
        after = 3 * step + axis
        yield diagonal, after, True
        # A wrong last reading is as a jump at the end.
        if after < 3 * walk.steps - 1:
            yield diagonal, after, False
        if after > 0:
            yield diagonal, after - 1, False


def _judged(
    walk: StepWalk, increments_um: FloatArray, closure: FloatArray, candidate: tuple[int, int, bool]
) -> Blunder | None:
    """Put one reading right; None where closures still lie far from the rest."""
    diagonal, reading, jumps = candidate
    wrong = np.zeros((len(walk.diagonals), 3 * walk.steps))
    wrong[diagonal, reading : None if jumps else reading + 1] = 1.0
    seen = walk.by_interval(wrong.reshape(len(walk.diagonals), walk.steps, 3))
    in_closures = closure_um(walk, seen)
    middle = np.median(closure, axis=1, keepdims=True)
    size = float(((closure - middle) * in_closures).sum() / (in_closures**2).sum())
    left = closure - size * in_closures
    if far_closures(left):
        return None
    moved = np.einsum("vd,dui->uvi", solution_of(walk), increments_um - size * seen)
    rough = moved - np.median(moved, axis=2, keepdims=True)
    touched = in_closures != 0
    misfit = float(((left - np.median(left, axis=1, keepdims=True)) ** 2).sum())
    roughness = float((rough.transpose(0, 2, 1)[touched] ** 2).sum())
    return Blunder(diagonal, reading, jumps, size, misfit, roughness)


def _likely(found: list[Blunder], closures: int) -> list[Blunder]:
    """Keep those that explain the closures best, and of them the smoothest."""
    least = min((one.misfit for one in found), default=0.0)
    most = least * (1 + WORSE / closures) + closures * ROUNDING_UM**2
    fitting = [one for one in found if one.misfit <= most]
    smoothest = min((one.roughness for one in fitting), default=0.0)
    return [one for one in fitting if one.roughness <= SMOOTHER * smoothest]


def _said(walk: StepWalk, blunder: Blunder) -> str:
    step, axis = divmod(blunder.reading, 3)
    where = f"{walk.diagonals[blunder.diagonal]}, step {step + 1}, after {LINEAR_LETTERS[axis]}"
    lasting = " and from there on" if blunder.jumps and blunder.reading < 3 * walk.steps - 1 else ""
    return f"{where}{lasting} (by about {blunder.size_um:.2g} µm)"
