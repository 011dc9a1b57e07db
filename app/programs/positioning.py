"""Positioning of a linear axis by ISO 230-2: targets, runs, both directions.

References
----------
ISO 230-2:2014, on target positions and the test cycle up to 2 m: at least five targets per metre
and five altogether, at P_i = (i − 1) p + r with r different at each target and within ± 30 % of p,
so that periodic errors are sampled; five runs in each direction.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from app.errors import InvalidContent, counted
from app.geometry.components import LINEAR_LETTERS
from app.measurement.positioning import RUNS_OF_THE_STANDARD, TARGETS_OF_THE_STANDARD
from app.programs.path import (
    DECIMALS,
    Manner,
    Path,
    Place,
    expect_whole,
    middle_of,
    place_words,
    travel_of,
    whole_step,
)
from app.programs.program import MeasuringProgram, Readings
from app.programs.readings_file import map_head
from app.thermal.machine import Machine
from app.units import MM_PER_M

SCATTER: Final = 0.3
"""Largest random offset of a target, in intervals: the standard's where nothing is known of the
period of periodic errors."""

MOST_TARGETS: Final = 1000
MOST_RUNS: Final = 100

USUAL_TARGETS: Final = 11
"""More than the standard asks of a short axis: an interval that its errors are followed in."""


def choose_targets(
    begin_mm: float, end_mm: float, count: int | None = None, *, seed: int = 0
) -> list[float]:
    """Spread targets over a range, each with its own random offset.

    Parameters
    ----------
    begin_mm, end_mm
        No target lies outside [mm].
    count
        How many; None: eleven, or five per metre where that is more.
    seed
        The same gives the same targets.

    Returns
    -------
    list of float
        Increasing, in whole µm [mm].

    Raises
    ------
    InvalidContent
        If the range is empty, or the count cannot be right.

    Examples
    --------
    >>> choose_targets(0.0, 100.0, 5, seed=1)
    [0.018, 31.757, 44.662, 81.73, 99.718]
    """
    length = end_mm - begin_mm
    if not (math.isfinite(length) and length > 0.0):
        raise InvalidContent.of_field(
            "range", f"expected a range that increases, got {begin_mm:g} to {end_mm:g} mm"
        )
    of_the_standard = math.ceil(length / MM_PER_M * TARGETS_OF_THE_STANDARD)
    number = max(USUAL_TARGETS, of_the_standard) if count is None else count
    if not 2 <= number <= MOST_TARGETS:
        raise InvalidContent.of_field(
            "targets", f"expected 2 to {MOST_TARGETS} targets, got {number}"
        )
    interval = length / (number - 1)
    offsets = np.random.default_rng(seed).uniform(-SCATTER, SCATTER, number) * interval
    # The ends move inwards, and a tenth as far: a map reaches no further than its targets.
    offsets[0], offsets[-1] = abs(offsets[0]) / 10, -abs(offsets[-1]) / 10
    places = begin_mm + np.arange(number) * interval + offsets
    low, high = -whole_step(-begin_mm), whole_step(end_mm)
    return [min(max(round(float(place), DECIMALS), low), high) for place in places]


def positioning_program(
    machine: Machine,
    manner: Manner,
    axis: str,
    *,
    targets_mm: Sequence[float] | None = None,
    count: int | None = None,
    runs: int = RUNS_OF_THE_STANDARD,
    line_mm: Place | None = None,
    seed: int = 0,
) -> MeasuringProgram:
    """Write the test cycle of ISO 230-2 along one axis.

    Parameters
    ----------
    axis
        `x`, `y` or `z`.
    targets_mm
        Strictly increasing [mm]; None: chosen over the whole travel less the overrun.
    count, seed
        Of targets that are chosen.
    runs
        In each direction.
    line_mm
        Positions of the other axes; the middle of their travel where not stated [mm].

    Returns
    -------
    MeasuringProgram
        Its readings are those of `thermap import --method positioning`.

    Raises
    ------
    InvalidContent
        If a position lies outside the travel, targets do not increase or are too close for
        the instrument, or a number cannot be right.
    """
    travel = travel_of(machine, axis)
    if not 1 <= runs <= MOST_RUNS:
        raise InvalidContent.of_field("runs", f"expected 1 to {MOST_RUNS} runs, got {runs}")
    if targets_mm is None:
        begin, end = travel.min_mm + manner.overrun_mm, travel.max_mm - manner.overrun_mm
        chosen: Sequence[float] = choose_targets(begin, end, count, seed=seed)
        origin = f"random offsets up to {SCATTER:.0%} of the interval, seed {seed}"
    else:
        chosen, origin = targets_mm, "targets as stated"
    targets = expect_targets(chosen, manner)
    line = middle_of(machine, line_mm or {}, but=axis)
    path = Path(machine, manner)
    _walk(path, axis, targets, runs, line)
    name = axis.upper()
    return MeasuringProgram(
        name=f"POS{name}",
        number=7001 + LINEAR_LETTERS.index(axis),
        title=f"positioning of {name} by ISO 230-2",
        machine=machine.id,
        head=(
            f"{counted(len(targets), 'target')}, {counted(runs, 'run')} in each direction",
            origin,
            f"line: {place_words(line)}",
            *manner.sentences(),
            path.order_of_axes(),
            f"travel used: {path.travel_used()}",
        ),
        blocks=tuple(path.blocks),
        readings=Readings(
            _readings(machine, axis, targets, runs),
            f"thermap import --method positioning FILE --machine {machine.id}",
        ),
        seconds=path.seconds,
    )


def expect_targets(targets_mm: Sequence[float], manner: Manner) -> list[float]:
    """Refuse targets that do not increase, or that an instrument could confuse.

    Returns
    -------
    list of float
        The targets [mm].

    Raises
    ------
    InvalidContent
        If there are fewer than two, or one has more decimals than controllers take.
    """
    targets = [expect_whole("targets", mm) for mm in targets_mm]
    gaps = np.diff(targets)
    if not gaps.size or gaps.min() <= 0.0:
        raise InvalidContent.of_field(
            "targets", f"expected at least two increasing targets in mm, got {list(targets)}"
        )
    manner.expect_apart(float(gaps.min()), "targets")
    return targets


def _walk(path: Path, axis: str, targets: Sequence[float], runs: int, line: Place) -> None:
    """Run up and down, each end overrun so that its target is approached from one side."""
    below = targets[0] - path.manner.overrun_mm
    above = targets[-1] + path.manner.overrun_mm
    name = axis.upper()
    path.arrive({**line, axis: below})
    path.go({axis: targets[0]})
    path.stop(f"align the instrument along {name}; it stands at {name} {targets[0]:g}: zero it")
    path.go({axis: below})
    for run in range(1, runs + 1):
        path.remark(f"run {run} forward")
        for target in targets:
            path.go({axis: target})
            path.read()
        path.go({axis: above})
        path.remark(f"run {run} backward")
        for target in reversed(targets):
            path.go({axis: target})
            path.read()
        path.go({axis: below})
    path.retract()


def _readings(machine: Machine, axis: str, targets: Sequence[float], runs: int) -> str:
    lines = [*map_head(machine), f"# axis: {axis}", "target_mm,run,direction,deviation_um"]
    for run in range(1, runs + 1):
        lines += [f"{target!r},{run},+," for target in targets]
        lines += [f"{target!r},{run},-," for target in reversed(targets)]
    return "".join(f"{line}\n" for line in lines)
