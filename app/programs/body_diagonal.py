"""The four body diagonals of a work volume, all axes together, both ways (ISO 230-6)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from app.arrays import FloatArray
from app.errors import InvalidContent, counted
from app.geometry.body_diagonal import DIAGONALS
from app.geometry.components import LINEAR_LETTERS
from app.programs.path import DECIMALS, Manner, Path
from app.programs.positioning import MOST_RUNS
from app.programs.program import MeasuringProgram, Readings
from app.programs.readings_file import map_head
from app.programs.step_diagonal import diagonal_box, place_of
from app.thermal.machine import Machine

RUNS: Final = 2
"""Fewer show no repeatability."""


def body_diagonal_program(
    machine: Machine,
    manner: Manner,
    *,
    steps: int = 10,
    runs: int = RUNS,
    origin_mm: Sequence[float] | None = None,
    step_mm: Sequence[float] | None = None,
) -> MeasuringProgram:
    """Write runs there and back along the four body diagonals.

    Parameters
    ----------
    steps
        Equal parts of each diagonal.
    origin_mm, step_mm
        Lowest corner, and what x, y and z move in one part; over the travel less the
        overrun where not stated [mm].

    Returns
    -------
    MeasuringProgram
        Its readings are those of `thermap import --method body-diagonal`.

    Raises
    ------
    InvalidContent
        If the machine lacks an axis, a position lies outside the travel, or parts are too
        short for the instrument.
    """
    origin, step = diagonal_box(machine, manner, steps, origin_mm, step_mm)
    if not 1 <= runs <= MOST_RUNS:
        raise InvalidContent.of_field("runs", f"expected 1 to {MOST_RUNS} runs, got {runs}")
    part = float(np.linalg.norm(step))
    manner.expect_apart(part, "readings along the diagonal")
    path = Path(machine, manner)
    for diagonal in DIAGONALS:
        _walk(path, diagonal, origin, step, steps, runs)
    path.retract()
    high = origin + steps * step
    return MeasuringProgram(
        name="BODYDIA",
        number=7012,
        title="body diagonals by ISO 230-6",
        machine=machine.id,
        head=(
            f"diagonals {', '.join(DIAGONALS)}, {counted(steps + 1, 'position')} "
            f"{part:.{DECIMALS}f} mm apart, {counted(runs, 'run')} there and back",
            "volume: "
            + ", ".join(
                f"{axis} {low:g} to {top:g} mm"
                for axis, low, top in zip(LINEAR_LETTERS, origin, high, strict=True)
            ),
            *manner.sentences(),
            path.order_of_axes(),
            f"travel used: {path.travel_used()}",
        ),
        blocks=tuple(path.blocks),
        readings=Readings(
            _readings(machine, origin, high, part, steps, runs),
            f"thermap import --method body-diagonal FILE --machine {machine.id}",
        ),
        seconds=path.seconds,
    )


def _walk(
    path: Path, diagonal: str, origin: FloatArray, step: FloatArray, steps: int, runs: int
) -> None:
    way = np.array([1.0 if letter == "p" else -1.0 for letter in diagonal])
    start = np.where(way > 0, origin, origin + steps * step)
    places = [place_of(start + number * way * step) for number in range(steps + 1)]
    ray = way * step / np.linalg.norm(step)
    before = place_of(start - ray * path.manner.overrun_mm)
    behind = place_of(start + steps * way * step + ray * path.manner.overrun_mm)
    path.arrive(before)
    # Coming from before it, as the runs do: reversal is not in the zero.
    path.go(places[0])
    path.stop(f"diagonal {diagonal}: align the beam along it, and zero the instrument here")
    path.go(before)
    for run in range(1, runs + 1):
        path.remark(f"{diagonal}, run {run} forward")
        for place in places:
            path.go(place)
            path.read()
        path.go(behind)
        path.remark(f"{diagonal}, run {run} backward")
        for place in reversed(places):
            path.go(place)
            path.read()
        path.go(before)


def _readings(
    machine: Machine, low: FloatArray, high: FloatArray, part: float, steps: int, runs: int
) -> str:
    lines = map_head(machine)
    for axis, bottom, top in zip(LINEAR_LETTERS, low, high, strict=True):
        lines.append(f"# volume_{axis}_mm: {bottom:.{DECIMALS}f}; {top:.{DECIMALS}f}")
    lines.append("diagonal,position_mm,run,forward_um,backward_um")
    lines += [
        f"{name},{number * part:.6f},{run},,"
        for name in DIAGONALS
        for run in range(1, runs + 1)
        for number in range(steps + 1)
    ]
    return "".join(f"{line}\n" for line in lines)
