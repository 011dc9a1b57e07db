"""What a person must know of a reading of six degrees of freedom, in sentences."""

from __future__ import annotations

from collections.abc import Mapping

from app.arrays import FloatArray
from app.geometry.components import COMPONENTS, ROTATION_LETTERS, Kind
from app.measurement.stated_numbers import suspiciously_small


def notes_on(
    axis: str, readings: Mapping[str, FloatArray], straightness_line: str, *, on_a_line: bool
) -> tuple[str, ...]:
    """Say what was taken for granted and what looks wrong.

    Parameters
    ----------
    axis
        `x`, `y` or `z`.
    readings
        Code of each component that was read to its forward runs [µm; µrad].
    straightness_line
        `as-read`, or the line that was taken out of the straightness.
    on_a_line
        Whether the measuring line was stated.

    Returns
    -------
    tuple of str
    """
    notes = _notes_on_the_line(axis, readings, on_a_line)
    straightness = any(COMPONENTS[code].kind is Kind.STRAIGHTNESS for code in readings)
    if straightness_line == "as-read" and straightness:
        notes.append(
            "Straightness as read: its slope is the axis' squareness to the laser beam, and "
            "none if the beam was aligned to this axis. With squareness from elsewhere take the "
            "line out."
        )
    for code, runs in readings.items():
        if not COMPONENTS[code].is_rotation:
            notes += suspiciously_small(f"the readings of {code}", runs)
    return tuple(notes)


def _notes_on_the_line(axis: str, readings: Mapping[str, FloatArray], on_a_line: bool) -> list[str]:
    rotations = [f"E{letter}{axis}".upper() for letter in ROTATION_LETTERS]
    missing = [code for code in rotations if code not in readings]
    translations = [code for code in readings if code not in rotations]
    if on_a_line and missing:
        return [
            f"{', '.join(missing)} not read: away from the measuring line the model counts "
            "them as zero."
        ]
    if not on_a_line and translations and len(missing) < len(rotations):
        return [
            f"No measuring line is stated: the translations of {axis} are taken as free of the "
            "rotations' effect, as if the reflector had run on the axis itself."
        ]
    return []
