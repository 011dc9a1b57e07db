"""What a person must know of a sequential step diagonal beside its numbers, in sentences."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Final

from scipy.special import gdtrc

from app.arrays import FloatArray
from app.errors import list_names
from app.geometry.chain import Chain
from app.geometry.components import LINEAR_LETTERS, ROTATION_LETTERS
from app.geometry.measuring_line import MeasuringLines
from app.measurement.step_diagonal_uncertainty import StepNoise, neighbours_correlation
from app.measurement.step_diagonal_walk import StepWalk

UNLIKELY: Final = 0.01
"""Closures so much larger than a stated repeatability come by chance so seldom."""


def translations_of(walk: StepWalk, lines: MeasuringLines, line: str) -> str:
    """Say where the translations were measured and from what they count.

    Parameters
    ----------
    walk
        The steps.
    lines
        Where the translations were measured.
    line
        From which line straightness counts.

    Returns
    -------
    str
        One sentence.
    """
    x, y, z = walk.centre_mm
    tool = ", ".join(f"{t:g}" for t in lines["x"].tool_offset_mm)
    return (
        f"Translations belong to the lines through the volume's centre ({x:g}, {y:g}, {z:g}) mm "
        f"with tool offset ({tool}) mm; EXX, EYY, EZZ are 0 at their lowest positions by "
        "definition (readings count from each diagonal's start), and straightness counts from the "
        f"{line} line, whose slopes make the squareness."
    )


def notes_of_rotations(chain: Chain, known: Iterable[str]) -> list[str]:
    """Say what the rotations that nobody stated do to the translations of this chain.

    Parameters
    ----------
    chain
        Order of the axes.
    known
        Codes of the angular errors that were removed.

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
    stated = set(known)
    found = []
    for v in chain.axes:
        for u in sorted(chain.acts_on(v) - {v}):
            (w,) = set(LINEAR_LETTERS) - {u, v}
            turn, roll = (
                f"E{ROTATION_LETTERS[LINEAR_LETTERS.index(about)]}{v}".upper() for about in (w, v)
            )
            along, across, even, rolled = (
                f"E{a}{b}".upper() for a, b in ((u, u), (u, v), (v, u), (w, u))
            )
            if turn not in stated:
                found.append(
                    f"{turn} (its even part about the centre in {even}, its odd part in {along}, "
                    f"its change times {v} from the centre in {across})"
                )
            if roll not in stated:
                found.append(f"{roll} (its even part in {rolled})")
    if not found:
        return []
    return [
        f"Rotations that were not stated remain in the translations of the chain {chain.text}, "
        f"their mean at both ends of the axis as end-point squareness: {list_names(found)}."
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
    walk
        The steps.
    closure : ndarray, shape (3, n), optional [µm]
        Closures of four diagonals.
    noise
        What was counted.
    repeatability_um, mirror_angle_urad
        What was stated.

    Returns
    -------
    list of str
        In sentences.
    """
    found = []
    if closure is None:
        found.append(
            f"Three diagonals ({list_names(walk.diagonals)}) leave no closure: noise and a tilted "
            "mirror do not show, variances are twice those of four, and squareness is not free of "
            "the mirror's tilt."
        )
    if closure is not None and walk.steps > 1 and not 0 < noise.degrees_of_freedom < math.inf:
        found.append(
            "The closures do not vary: readings of a coarse scale, or simulated ones, do not show "
            "their noise."
            + ("" if noise.reading_um is None else " The stated repeatability counts.")
        )
    if noise.reading_um is None:
        found.append(
            "No uncertainty: nothing in this measurement shows its noise, and no repeatability_um "
            "was stated."
        )
    if closure is not None and noise.reading_um is not None:
        found += _judged_noise(closure, noise, repeatability_um)
    return found + _judged_mirror(noise, mirror_angle_urad, closure is not None)


def _judged_noise(
    closure: FloatArray, noise: StepNoise, repeatability_um: float | None
) -> list[str]:
    found = []
    neighbours = neighbours_correlation(closure)
    if neighbours is not None and neighbours < -2.0 / closure.size**0.5:
        found.append(
            f"Neighbouring closures correlate by {neighbours:.2f}: the noise is rather that of the "
            "axes' positions than of the readings, and errors far from the start are better known "
            "than their standard errors say."
        )
    freedom = noise.degrees_of_freedom
    if repeatability_um is None or noise.reading_um is None or not 0 < freedom < float("inf"):
        return found
    chi2 = freedom * (noise.reading_um / repeatability_um) ** 2
    if gdtrc(0.5, freedom / 2, chi2) < UNLIKELY:
        found.append(
            f"The closures' noise of {noise.reading_um:.3g} µm exceeds the stated "
            f"{repeatability_um:g} µm: angular errors, drift or reversal are in the readings."
        )
    return found


def _judged_mirror(noise: StepNoise, mirror_angle_urad: float | None, closed: bool) -> list[str]:
    if mirror_angle_urad == 0.0:
        return []
    hidden = "A tilted flat mirror looks like differences between the scales of EXX, EYY, EZZ" + (
        "" if closed else " and like squareness"
    )
    if mirror_angle_urad is not None:
        found = [f"{hidden}: {mirror_angle_urad:g} µrad are counted as stated."]
        if noise.seen_tilt_urad is not None and noise.seen_tilt_urad > 2 * mirror_angle_urad:
            found.append(
                f"The closures' means show {noise.seen_tilt_urad:.3g} µrad, more than was stated."
            )
        return found
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
