"""Six errors of a linear axis, read together by a laser of six degrees of freedom.

The instrument's reflector sits in the tool holder and the axis moves along a line beside
its own: the translations that are read contain the rotations times the offset of that
line. Y.-Y. Hsu leaves them in, and counts the lever arms of the model from the line. No
offset inside the machine has to be known then: the model is independent of kinematic
parameters.

References
----------
Y.-Y. Hsu, *Kinematic parameter-independent modeling and measuring of three-axis machine
tools*, vol. 5, no. 7 (2011), section III B and C, equations 17–25, Table II.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from app.arrays import FloatArray
from app.errors import InvalidContent
from app.geometry.components import COMPONENTS, LINEAR_LETTERS, ROTATION_LETTERS, Kind
from app.geometry.measuring_line import MeasuringLines
from app.measurement.reference_line import LINES, expect_line, slope_of, without_line
from app.measurement.result import MeasurementResult
from app.measurement.run_means import BothWays, means_of_both_ways, straightened, table_of_means
from app.measurement.stated_numbers import as_standard_deviation, suspiciously_small
from app.measurement.stated_runs import as_positions, as_runs, expect_linear_axis, stated_line
from app.thermal.error_map import ComponentTable

AsReadOrLine: TypeAlias = Literal["as-read", "least-squares", "end-points"]
BACKWARD: Final = "backward_"


def evaluate_six_dof(
    axis: str,
    positions_mm: ArrayLike,
    linear_um: ArrayLike | None = None,
    straightness_um: Mapping[str, ArrayLike] | None = None,
    angular_urad: Mapping[str, ArrayLike] | None = None,
    *,
    backward_linear_um: ArrayLike | None = None,
    backward_straightness_um: Mapping[str, ArrayLike] | None = None,
    backward_angular_urad: Mapping[str, ArrayLike] | None = None,
    measuring_line_mm: ArrayLike | None = None,
    tool_offset_mm: ArrayLike = (0.0, 0.0, 0.0),
    straightness_line: AsReadOrLine = "as-read",
    repeatability_um: float | None = None,
    repeatability_urad: float | None = None,
) -> MeasurementResult:
    """Make an axis' error components from the readings of a six-degree-of-freedom laser.

    Parameters
    ----------
    axis
        `x`, `y` or `z`.
    positions_mm : array-like, shape (m,) [mm]
        Where it was read, strictly increasing.
    linear_um : array-like, shape (m,), or (n, m) for repeated runs, optional [µm]
        Actual minus nominal position along the axis.
    straightness_um
        `x`, `y` or `z`, other than the axis, to readings of the same shapes [µm].
    angular_urad
        `a`, `b`, `c` (about X, Y, Z) to readings of the same shapes, positive by the
        right-hand rule [µrad].
    backward_linear_um, backward_straightness_um, backward_angular_urad
        The same, approached in the negative direction.
    measuring_line_mm, tool_offset_mm : array-like, shape (3,), optional [mm]
        A point of the line on which the axes stood, and the offset of the reflector as a
        tool. Without it the translations are taken as free of the rotations' effect.
    straightness_line
        `as-read`, or the line that is taken out of the straightness readings, the same
        of both directions.
    repeatability_um, repeatability_urad
        Standard deviation of one reading, for components that were read once [µm; µrad].

    Returns
    -------
    MeasurementResult
        The components that were read, in both directions where both were.

    Raises
    ------
    InvalidContent
        If nothing was read, an axis or direction has another name, or numbers are
        missing, not finite or implausibly large.

    Notes
    -----
    A laser that is not parallel to the axis adds a slope to the straightness; `as-read`
    keeps it, together with the axis' squareness to the laser. Covariances are those of
    `mean_of_runs`; a line that is taken out takes its part of them, and what both
    directions of a run share.

    Examples
    --------
    >>> result = evaluate_six_dof(
    ...     "x", [0.0, 500.0], [0.0, 4.0], {"y": [0.0, 1.0]}, {"b": [0.0, 12.0]},
    ...     measuring_line_mm=[0, 250, 100], tool_offset_mm=[0, 0, 160],
    ... )
    >>> [table.component.code for table in result.tables]
    ['EXX', 'EYX', 'EBX']
    """
    expect_linear_axis(axis)
    positions = as_positions("positions_mm", positions_mm)
    _expect_straightness_line(straightness_line, positions)
    spreads = {
        "um": as_standard_deviation("repeatability_um", repeatability_um, "µm"),
        "urad": as_standard_deviation("repeatability_urad", repeatability_urad, "µrad"),
    }
    forward = _readings(axis, positions, linear_um, straightness_um, angular_urad, "")
    backward = _readings(
        axis,
        positions,
        backward_linear_um,
        backward_straightness_um,
        backward_angular_urad,
        BACKWARD,
    )
    _expect_forward(forward, backward)
    forward = {code: forward[code] for code in COMPONENTS if code in forward}
    means = {
        code: means_of_both_ways(
            positions, runs, backward.get(code), spreads[COMPONENTS[code].unit.value]
        )
        for code, runs in forward.items()
    }
    lines: MeasuringLines = {}
    if measuring_line_mm is not None:
        lines = {axis: stated_line(axis, measuring_line_mm, tool_offset_mm)}
    return MeasurementResult(
        tables=tuple(
            _table(code, positions, both, straightness_line) for code, both in means.items()
        ),
        figures=_figures(positions, means),
        notes=notes_on(axis, forward, straightness_line, on_a_line=bool(lines)),
        measuring_lines=lines,
    )


def _expect_straightness_line(straightness_line: str, positions_mm: FloatArray) -> None:
    expect_line("straightness_line", straightness_line, ("as-read", *LINES))
    if straightness_line != "as-read" and positions_mm.size < 2:
        raise InvalidContent.of_field(
            "straightness_line", "expected as-read with one position, which has no line"
        )


def _readings(
    axis: str,
    positions_mm: FloatArray,
    linear_um: ArrayLike | None,
    straightness_um: Mapping[str, ArrayLike] | None,
    angular_urad: Mapping[str, ArrayLike] | None,
    prefix: str,
) -> dict[str, FloatArray]:
    """Sort what came of one direction by component code, as runs over the positions."""
    sideways = LINEAR_LETTERS.replace(axis, "")
    got: dict[str, tuple[str, ArrayLike]] = {}
    if linear_um is not None:
        got[f"E{axis}{axis}".upper()] = (f"{prefix}linear_um", linear_um)
    for field, measured, letters in (
        (f"{prefix}straightness_um", straightness_um, sideways),
        (f"{prefix}angular_urad", angular_urad, ROTATION_LETTERS),
    ):
        for letter, readings in (measured or {}).items():
            if letter not in tuple(letters):
                raise InvalidContent.of_field(
                    field,
                    f"expected {', '.join(letters)} as directions of axis {axis}, got {letter!r}",
                )
            got[f"E{letter}{axis}".upper()] = (f"{field}.{letter}", readings)
    return {
        code: as_runs(field, readings, positions_mm, COMPONENTS[code].unit.symbol)
        for code, (field, readings) in got.items()
    }


def _expect_forward(forward: Mapping[str, FloatArray], backward: Mapping[str, FloatArray]) -> None:
    if not forward:
        raise InvalidContent.of_field(
            "linear_um", "expected readings of at least one component, got none"
        )
    alone = [code for code in backward if code not in forward]
    if alone:
        raise InvalidContent.of_field(
            "linear_um",
            f"expected forward readings of what was read backward, got none of {alone[0]}",
        )


def _table(
    code: str, positions_mm: FloatArray, both: BothWays, straightness_line: AsReadOrLine
) -> ComponentTable:
    """Make a component's table; a straightness loses its line, if one is to be taken out."""
    if straightness_line != "as-read" and COMPONENTS[code].kind is Kind.STRAIGHTNESS:
        both = straightened(positions_mm, both, straightness_line)
    return table_of_means(code, positions_mm, both.forward, both.backward)


def _figures(positions_mm: FloatArray, means: Mapping[str, BothWays]) -> dict[str, float]:
    figures: dict[str, float] = {}
    for code, both in means.items():
        component = COMPONENTS[code]
        unit = component.unit.value
        read = np.array([way.mean for way in both.directions])
        figures[f"{code}_range_{unit}"] = float(np.ptp(read))
        if both.backward is not None:
            figures[f"{code}_reversal_{unit}"] = float(np.abs(read[0] - read[1]).max())
        repeated = [way.scatter.noise**2 for way in both.directions if way.scatter]
        if repeated:
            figures[f"{code}_noise_{unit}"] = math.sqrt(float(np.mean(repeated)))
        if component.kind is Kind.STRAIGHTNESS and positions_mm.size > 1:
            figures |= _straightness(code, positions_mm, read.mean(axis=0))
    return figures


def _straightness(code: str, positions_mm: FloatArray, mean_um: FloatArray) -> dict[str, float]:
    """Slope as read, and ISO 230-1's straightness about the least-squares line."""
    deviations = without_line(positions_mm, "least-squares") @ mean_um
    return {
        f"{code}_slope_um_per_m": slope_of(positions_mm, mean_um),
        f"{code}_straightness_um": float(np.ptp(deviations)),
    }


def notes_on(
    axis: str, readings: Mapping[str, FloatArray], straightness_line: str, *, on_a_line: bool
) -> tuple[str, ...]:
    """Say what was taken for granted and what looks wrong.

    Parameters
    ----------
    readings
        Code of each component that was read to its forward runs [µm; µrad].
    straightness_line
        `as-read`, or the line that was taken out of the straightness.
    on_a_line
        Whether the measuring line was stated.
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
