"""The sequential step diagonals: x, then y, then z, along each body diagonal [V; W 8.3.2.2]."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from app.arrays import FloatArray
from app.errors import InvalidContent, counted
from app.geometry.body_diagonal import DIAGONALS
from app.geometry.components import LINEAR_LETTERS
from app.measurement.step_diagonal_input import StepWalk
from app.programs.path import DECIMALS, Manner, Path, expect_three_axes, expect_whole, whole_step
from app.programs.program import MeasuringProgram, Readings
from app.programs.readings_file import map_head
from app.thermal.machine import Machine

MOST_STEPS: Final = 1000


def step_diagonal_program(
    machine: Machine,
    manner: Manner,
    *,
    steps: int = 10,
    origin_mm: Sequence[float] | None = None,
    step_mm: Sequence[float] | None = None,
) -> MeasuringProgram:
    """Write the walk along the four diagonals, in the order of the importer.

    Parameters
    ----------
    steps
        Of each axis.
    origin_mm, step_mm
        Lowest corner, and positive steps X, Y, Z; over the travel less the overrun where
        not stated [mm].

    Returns
    -------
    MeasuringProgram
        Its readings are those of `thermap import --method step-diagonal`.

    Raises
    ------
    InvalidContent
        If the machine lacks an axis, a position lies outside the travel, or steps are too
        short for the instrument.
    """
    origin, step = diagonal_box(machine, manner, steps, origin_mm, step_mm)
    walk = StepWalk(origin, step, steps, DIAGONALS)
    shortest = float(np.abs(walk.rays * step).min())
    manner.expect_apart(shortest, "readings along the diagonal")
    path = Path(machine, manner)
    for diagonal, way, places in zip(DIAGONALS, walk.ways, walk.positions_mm(), strict=True):
        before = places[0] - way * manner.overrun_mm
        path.arrive(place_of(before))
        path.go(place_of(places[0]))
        path.stop(f"diagonal {diagonal}: align the beam along it, and zero the instrument here")
        for number, place in enumerate(places[1:]):
            if number % 3 == 0:
                path.remark(f"{diagonal}, step {number // 3 + 1}")
            path.go(place_of(place))
            path.read()
    path.retract()
    corner, sides = _text(origin), _text(step)
    return MeasuringProgram(
        name="STEPDIA",
        number=7011,
        title="sequential step diagonals",
        machine=machine.id,
        head=(
            f"diagonals {', '.join(DIAGONALS)}, {counted(steps, 'step')} of each axis, x then y "
            "then z; p runs up, n down",
            f"lowest corner {corner} mm, steps {sides} mm",
            *manner.sentences(),
            path.order_of_axes(),
            f"travel used: {path.travel_used()}",
        ),
        blocks=tuple(path.blocks),
        readings=Readings(
            _readings(machine, corner, sides, steps),
            f"thermap import --method step-diagonal FILE --machine {machine.id}",
        ),
        seconds=path.seconds,
    )


def diagonal_box(
    machine: Machine,
    manner: Manner,
    steps: int,
    origin_mm: Sequence[float] | None,
    step_mm: Sequence[float] | None,
) -> tuple[FloatArray, FloatArray]:
    """Lay equal steps into the travel, less the overrun at both ends.

    Parameters
    ----------
    steps
        Of each axis.
    origin_mm, step_mm
        Lowest corner and steps of x, y, z, where they are stated [mm].

    Returns
    -------
    origin, step : ndarray, shape (3,) [mm]
        In whole µm, so that all positions are exact.

    Raises
    ------
    InvalidContent
        If the machine lacks an axis, or a number cannot be right.
    """
    expect_three_axes(machine)
    if not 1 <= steps <= MOST_STEPS:
        raise InvalidContent.of_field("steps", f"expected 1 to {MOST_STEPS} steps, got {steps}")
    origin, step = [], []
    for i, axis in enumerate(LINEAR_LETTERS):
        travel = machine.axes[axis]
        low = -whole_step(-travel.min_mm - manner.overrun_mm)
        begin = low if origin_mm is None else expect_whole(f"origin.{axis}", origin_mm[i])
        free = (travel.max_mm - manner.overrun_mm - begin) / steps
        stride = whole_step(free) if step_mm is None else expect_whole(f"step.{axis}", step_mm[i])
        if stride <= 0.0:
            raise InvalidContent.of_field(
                f"step.{axis}",
                f"expected a step above 0 mm within the travel of {travel.min_mm:g} to "
                f"{travel.max_mm:g} mm less {manner.overrun_mm:g} mm of overrun, got {stride:g} mm",
            )
        origin.append(begin)
        step.append(stride)
    return np.array(origin), np.array(step)


def place_of(point_mm: FloatArray) -> dict[str, float]:
    """Name the coordinates of a point.

    Parameters
    ----------
    point_mm : ndarray, shape (3,) [mm]

    Returns
    -------
    dict
        Axis to position [mm].
    """
    return dict(zip(LINEAR_LETTERS, map(float, point_mm), strict=True))


def _text(numbers: FloatArray) -> str:
    return ", ".join(f"{number:.{DECIMALS}f}" for number in numbers)


def _readings(machine: Machine, corner: str, sides: str, steps: int) -> str:
    lines = [*map_head(machine), f"# origin_mm: {corner}", f"# step_mm: {sides}"]
    lines.append("diagonal,step,after_x_um,after_y_um,after_z_um")
    lines += [f"{name},{number},,," for name in DIAGONALS for number in range(1, steps + 1)]
    return "".join(f"{line}\n" for line in lines)
