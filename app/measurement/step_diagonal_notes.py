"""What a person must know of a sequential step diagonal beside its numbers, in sentences.

Among it the reading that contradicts the others, named with its diagonal and step. A wrong
reading is in two single steps, the one before it and the one behind it, and with opposite
signs in two closures; a jump that stays, such as lost counts, is in one. From the closures
alone a reading of one diagonal cannot be told from one of another that moved the same two
axes: the true one leaves the smoother errors when it is put right.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Final, NamedTuple

import numpy as np
from scipy.special import gdtrc

from app.arrays import FloatArray
from app.errors import list_names
from app.geometry.chain import Chain
from app.geometry.components import LINEAR_LETTERS, ROTATION_LETTERS
from app.geometry.measuring_line import MeasuringLines
from app.measurement.outliers import far_closures
from app.measurement.step_diagonal_input import StepWalk
from app.measurement.step_diagonal_uncertainty import (
    ROUNDING_UM,
    StepNoise,
    closure_um,
    neighbours_correlation,
    solution_of,
)

UNLIKELY: Final = 0.01
"""Closures so much larger than a stated repeatability come by chance so seldom."""


SMOOTHER: Final = 4.0
"""So many times the squares of the smoothest errors are still as smooth."""
WORSE: Final = 16.0
"""So many closures' variances may an explanation leave more than the best."""


def translations_of(walk: StepWalk, lines: MeasuringLines, line: str) -> str:
    """Say where the translations were measured and from what they count."""
    x, y, z = walk.centre_mm
    tool = ", ".join(f"{t:g}" for t in lines["x"].tool_offset_mm)
    return (
        f"Translations belong to the lines through the volume's centre ({x:g}, {y:g}, {z:g}) mm "
        f"with tool offset ({tool}) mm; EXX, EYY, EZZ are 0 at their lowest positions by "
        "definition (readings count from each diagonal's start), and straightness counts from the "
        f"{line} line, whose slopes make the squareness."
    )


def notes_of_rotations(chain: Chain, rotations: Iterable[str]) -> list[str]:
    """Say what the rotations that nobody stated do to the translations of this chain.

    Returns
    -------
    list of str
        One sentence, or none where no such rotation has a lever arm.

    Notes
    -----
    Let the rotation ω(v) act on the coordinate u ≠ v. While v moves, its arm u − u_c has
    both signs on the diagonals and cancels but for ∫ (v − v_c) dω in the straightness of v
    towards u. While u moves, ω(v) displaces along ω × u: the part of ω that is even about
    the centre is as a turn of axis u, the odd part lengthens or shortens u. The ends of the
    diagonals are where ω has its end values: their mean counts as squareness.
    """
    declared = set(rotations)
    neglected = []
    for v in chain.axes:
        for u in sorted(chain.acts_on(v) - {v}):
            (w,) = set(LINEAR_LETTERS) - {u, v}
            turn, roll = (
                f"E{ROTATION_LETTERS[LINEAR_LETTERS.index(about)]}{v}".upper() for about in (w, v)
            )
            along, across, even, rolled = (
                f"E{a}{b}".upper() for a, b in ((u, u), (u, v), (v, u), (w, u))
            )
            if turn not in declared:
                neglected.append(
                    f"{turn} (its even part about the centre in {even}, its odd part in {along}, "
                    f"its change times {v} from the centre in {across})"
                )
            if roll not in declared:
                neglected.append(f"{roll} (its even part in {rolled})")
    if not neglected:
        return []
    return [
        f"Rotations that were not stated remain in the translations of the chain {chain.text}, "
        f"their mean at both ends of the axis as end-point squareness: {list_names(neglected)}."
    ]


def notes_of_uncertainty(
    walk: StepWalk,
    closure: FloatArray | None,
    noise: StepNoise,
    repeatability_um: float | None,
    mirror_angle_urad: float | None,
) -> list[str]:
    """Say where the uncertainty comes from and what it leaves out.

    Parameters
    ----------
    closure : ndarray, shape (3, n), optional [µm]
        Closures of four diagonals.
    """
    notes = []
    if closure is None:
        notes.append(
            f"Three diagonals ({list_names(walk.diagonals)}) leave no closure: noise and a tilted "
            "mirror do not show, variances are twice those of four, and squareness is not free of "
            "the mirror's tilt."
        )
    if closure is not None and walk.steps > 1 and not 0 < noise.degrees_of_freedom < math.inf:
        notes.append(
            "The closures do not vary: readings of a coarse scale, or simulated ones, do not show "
            "their noise."
            + ("" if noise.reading_um is None else " The stated repeatability counts.")
        )
    if noise.reading_um is None:
        notes.append(
            "No uncertainty: nothing in this measurement shows its noise, and no repeatability_um "
            "was stated."
        )
    if closure is not None and noise.reading_um is not None:
        notes += _judged_noise(closure, noise, repeatability_um)
    return notes + _judged_mirror(noise, mirror_angle_urad, closure is not None)


def _judged_noise(
    closure: FloatArray, noise: StepNoise, repeatability_um: float | None
) -> list[str]:
    notes = []
    neighbours = neighbours_correlation(closure)
    if neighbours is not None and neighbours < -2.0 / closure.size**0.5:
        notes.append(
            f"Neighbouring closures correlate by {neighbours:.2f}: the noise is rather that of the "
            "axes' positions than of the readings, and errors far from the start are better known "
            "than their standard errors say."
        )
    freedom = noise.degrees_of_freedom
    if repeatability_um is None or noise.reading_um is None or not 0 < freedom < float("inf"):
        return notes
    chi2 = freedom * (noise.reading_um / repeatability_um) ** 2
    if gdtrc(0.5, freedom / 2, chi2) < UNLIKELY:
        notes.append(
            f"The closures' noise of {noise.reading_um:.3g} µm exceeds the stated "
            f"{repeatability_um:g} µm: angular errors, drift or reversal are in the readings."
        )
    return notes


def _judged_mirror(noise: StepNoise, mirror_angle_urad: float | None, closed: bool) -> list[str]:
    if mirror_angle_urad == 0.0:
        return []
    hidden = "A tilted flat mirror looks like differences between the scales of EXX, EYY, EZZ" + (
        "" if closed else " and like squareness"
    )
    if mirror_angle_urad is not None:
        notes = [f"{hidden}: {mirror_angle_urad:g} µrad are counted as stated."]
        if noise.seen_tilt_urad is not None and noise.seen_tilt_urad > 2 * mirror_angle_urad:
            notes.append(
                f"The closures' means show {noise.seen_tilt_urad:.3g} µrad, more than was stated."
            )
        return notes
    if noise.seen_tilt_urad is not None:
        return [
            f"{hidden}: the {noise.seen_tilt_urad:.3g} µrad that the closures' means show are "
            "counted."
        ]
    limit = (
        ""
        if noise.hidden_tilt_urad is None
        else f", though less than {noise.hidden_tilt_urad:.3g} µrad would not show"
    )
    return [f"{hidden}: none is counted{limit}; state mirror_angle_urad."]


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
    increments_um : ndarray, shape (4, 3, n) [µm]
        As `StepWalk.by_interval` gives them.
    closure : ndarray, shape (3, n) [µm]

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
    blunders = [
        blunder
        for candidate in _readings_at(walk, axis, interval)
        if (blunder := _judged(walk, increments_um, closure, candidate)) is not None
    ]
    likely = _likely(blunders, closure.size)
    if likely:
        descriptions = ", or ".join(_described(walk, suspect) for suspect in likely)
        return [f"Suspicious, far from what the other diagonals say, and kept: {descriptions}."]
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
    # Each axis' middle is the mirror's share, which is no wrong reading; the size is the least
    # squares' one.
    middle = np.median(closure, axis=1, keepdims=True)
    size = float(((closure - middle) * in_closures).sum() / (in_closures**2).sum())
    residuals = closure - size * in_closures
    if far_closures(residuals):
        return None
    # Several readings can explain the same closures. The right one, put right, leaves errors that
    # change from interval to interval as they do elsewhere; a wrong one leaves a jump.
    moved = np.einsum("vd,dui->uvi", solution_of(walk), increments_um - size * seen)
    rough = moved - np.median(moved, axis=2, keepdims=True)
    touched = in_closures != 0
    misfit = float(((residuals - np.median(residuals, axis=1, keepdims=True)) ** 2).sum())
    roughness = float((rough.transpose(0, 2, 1)[touched] ** 2).sum())
    return Blunder(diagonal, reading, jumps, size, misfit, roughness)


def _likely(blunders: list[Blunder], closures: int) -> list[Blunder]:
    """Keep those that explain the closures best, and of them the smoothest."""
    least = min((blunder.misfit for blunder in blunders), default=0.0)
    most = least * (1 + WORSE / closures) + closures * ROUNDING_UM**2
    fitting = [blunder for blunder in blunders if blunder.misfit <= most]
    smoothest = min((blunder.roughness for blunder in fitting), default=0.0)
    return [blunder for blunder in fitting if blunder.roughness <= SMOOTHER * smoothest]


def _described(walk: StepWalk, blunder: Blunder) -> str:
    step, axis = divmod(blunder.reading, 3)
    where = f"{walk.diagonals[blunder.diagonal]}, step {step + 1}, after {LINEAR_LETTERS[axis]}"
    lasting = " and from there on" if blunder.jumps and blunder.reading < 3 * walk.steps - 1 else ""
    return f"{where}{lasting} (by about {blunder.size_um:.2g} µm)"
