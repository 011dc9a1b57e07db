"""The drive: an ISO 230-2 table of the first cycle, and what later cycles show beside it.

The points' times were not recorded, only their order: a minute each is assumed, so that a
drift is right in what it adds up to and not in its rate. Seen first with a cycle as one visit
(both directions under one set-up), which shows reversal; then with each run as one visit, as
a drift is only tested with eight visits or more.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from itertools import groupby
from pathlib import Path

import numpy as np

from app.effects.observations import Observation, Verification
from app.geometry.components import COMPONENTS
from app.identification.campaign import Campaign
from app.thermal.error_map import ComponentTable
from app.thermal.machine import Travel
from app.units import UM_PER_MM
from examples.measured.constant_model import constant_model
from examples.measured.loop import Round, close_the_loop, effects_of

FOLDER = "ess-target-drive"
TESTS = {"x": "b02_x_target_x", "y": "week42_22_xyz_target_y_report_ILD50"}
START_S = datetime(2022, 4, 6, 12, tzinfo=UTC).timestamp()
POINT_S = 60.0
REPEATABILITY_UM = 3.0
SIGNS = {"forward": 1, "backward": -1}


@dataclass(frozen=True, slots=True)
class Point:
    """One target, once approached."""

    cycle: int
    sign: int
    target_mm: float
    deviation_um: float
    time_s: float


def read_points(data: Path, axis: str) -> list[Point]:
    """Read one test in the order in which the drive travelled."""
    with (data / FOLDER / "iso230_2_deviations.csv").open(encoding="utf-8", newline="") as lines:
        rows = [row for row in csv.DictReader(lines) if row["test"] == TESTS[axis]]
    found = []
    for row in rows:
        target = float(row["target_mm"])
        deviation = (float(row["measured_mm"]) - target) * UM_PER_MM
        found.append(Point(int(row["cycle"]), SIGNS[row["direction"]], target, deviation, 0.0))
    found.sort(key=lambda p: (p.cycle, -p.sign, p.sign * p.target_mm))
    return [replace(p, time_s=START_S + POINT_S * i) for i, p in enumerate(found)]


def verifications(axis: str, points: list[Point], by_run: bool) -> list[Verification]:
    """Make a verification of each cycle, or of each of its two runs."""

    def name(p: Point) -> str:
        return f"cycle {p.cycle}" + (f", {'+' if p.sign > 0 else '−'}" if by_run else "")

    return [
        Verification(label, [_observation(axis, p) for p in together])
        for label, together in groupby(points, name)
    ]


def campaign(axis: str, points: list[Point], learn: list[Point], by_run: bool) -> Campaign:
    """Take the mean of the first cycle's two runs as the table, some points to learn from."""
    targets = sorted({p.target_mm for p in points})
    means = [
        float(np.mean([p.deviation_um for p in points if p.cycle == 1 and p.target_mm == t]))
        for t in targets
    ]
    code = component(axis)
    table = ComponentTable.make(COMPONENTS[code], means, targets)
    travels = {axis: Travel(targets[0], targets[-1])}
    model, maps, readings = constant_model(
        "drive", travels, {code: table}, START_S, REPEATABILITY_UM
    )
    return Campaign(model, maps, verifications(axis, learn, by_run), readings)


def close_both_ways(axis: str, points: list[Point], learn: list[Point]) -> list[Round]:
    """Close the loop over cycles, then over runs with what was found."""
    of_cycles = close_the_loop(campaign(axis, points, learn, by_run=False))
    of_runs = campaign(axis, points, learn, by_run=True)
    return of_cycles + close_the_loop(replace(of_runs, effects=effects_of(of_runs, of_cycles)))


def component(axis: str) -> str:
    """Name the positioning error of an axis."""
    return f"E{axis.upper()}{axis.upper()}"


def _observation(axis: str, p: Point) -> Observation:
    x, y, z = (p.sign if letter == axis else 0 for letter in "xyz")
    return Observation(
        p.time_s, (p.deviation_um,), component(axis), p.target_mm, directions=(x, y, z)
    )
