"""A campaign in warm-ups: what nobody declared is measured, found and adopted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from examples.linuxcnc.controller import NotRunning, run_program
from examples.linuxcnc.maps import HASTE, MACHINE
from examples.linuxcnc.plant import HOUR_S, LASER_UM, Course, actual_mm
from examples.linuxcnc.shop import Shop, filled, iso, zeroed

SEED: Final = 5

DAYS: Final = 5.0
WARM_UP_MIN: Final = 120.0
STAGES_MIN: Final = (10.0, 30.0, 60.0, 120.0, 150.0)
"""When a warm-up is measured; the last one is half an hour of cooling."""

CAMPAIGN_H: Final = (30.0, 54.0, 78.0)
"""When the campaign's days begin, after the course does; between them the machine rests."""

WORK_H: Final = ((0.0, 2.5), (4.0, 7.0), (8.0, 10.0))
"""From when to when of a day the spindle turns."""

LATE_H: Final = (0.25, 0.1, -0.05)
"""How late the work of each day begins: visits find it in other states."""

VISITS_H: Final = (0.5, 2.2, 3.2, 4.8, 6.8, 7.7, 9.9, 11.6)
"""When of a day somebody comes to measure: warming up, warm, and cooling down."""

VISITS: Final = len(CAMPAIGN_H) * len(VISITS_H)
VISIT_MM: Final = (30.0, 150.0, 270.0, 270.0)
"""Where Z is measured in a visit; twice at the top, which shows how it repeats."""


@dataclass(frozen=True, slots=True)
class Found:
    """What the analysis says of the effect that nobody declared."""

    summary: str
    status: str
    late_min: float
    version: int


def course_until(end_s: float, now_s: float) -> Course:
    """Make the days before now: a first warm-up, the campaign's work, and a last warm-up.

    Parameters
    ----------
    end_s
        How far it goes on beyond now [s since 1970-01-01 UTC].
    now_s
        When the last stage of the last warm-up is [s since 1970-01-01 UTC].
    """
    start_s = now_s - DAYS * 24 * HOUR_S
    work = [(begun, begun + WARM_UP_MIN * 60.0) for begun in warm_ups_s(now_s)]
    for day_h, late_h in zip(CAMPAIGN_H, LATE_H, strict=True):
        day_s = start_s + (day_h + late_h) * HOUR_S
        work += [(day_s + begun * HOUR_S, day_s + ended * HOUR_S) for begun, ended in WORK_H]
    return Course.of_work(start_s, end_s, work)


def warm_ups_s(now_s: float) -> tuple[float, float]:
    """Say when the first warm-up begins, and when the last, whose last stage is now [s].

    At the same hour of the day, because of the room.
    """
    last_s = now_s - STAGES_MIN[-1] * 60.0
    return last_s - (DAYS - 1) * 24 * HOUR_S, last_s


def visits_s(now_s: float) -> list[float]:
    """Say when somebody comes to measure [s]."""
    start_s = now_s - DAYS * 24 * HOUR_S
    return [start_s + (day_h + h) * HOUR_S for day_h in CAMPAIGN_H for h in VISITS_H]


def analyse(shop: Shop, course: Course, now_s: float) -> Found:
    """Visit the machine through days of warming up, look what the model lacks, and adopt it.

    One program makes all visits: before each it waits for the operator, who mounts the laser and
    zeroes it.
    """
    planned = shop.folder / "planned.csv"
    visits = visits_s(now_s)
    planned.write_text(_plan(visits))
    words = (MACHINE["id"], planned, "--line", "x=50", "--line", "y=50", *HASTE)
    program, form = shop.program("visit", *words, into="visits")
    rests = run_program(program).rests
    if len(rests) != VISITS * (len(VISIT_MM) + 1):
        raise NotRunning(
            f"expected {VISITS} visits of {len(VISIT_MM)} readings, "
            f"each with the laser's zero before them, got {len(rests)} rests"
        )
    read: list[float] = []
    for number, at_s in enumerate(visits):
        own = rests[number * (len(VISIT_MM) + 1) :][: len(VISIT_MM) + 1]
        stood = [actual_mm(rest, course.at(at_s))["z"] for rest in own]
        read += zeroed(stood, VISIT_MM)
    scatter = np.random.default_rng(SEED).normal(0.0, LASER_UM, len(read))
    file = shop.folder / "visits.csv"
    file.write_text(filled(form, "measured_um", np.add(read, scatter)))
    shop.thermap("analyse", MACHINE["id"], "--verification", file, "--adopt")
    (head,) = shop.client.analyses(MACHINE["id"])
    result = shop.client.analysis(MACHINE["id"], head.id).result
    if result is None or not result.effects or result.effects[0].kind != "thermal-lag":
        raise RuntimeError(f"expected a late answer, got: {result and result.summary}")
    effect = result.effects[0]
    late_min = effect.parameters["time_constant_min"]
    version = shop.client.models(MACHINE["id"])[-1].version
    return Found(result.summary, effect.status, late_min, version)


def _plan(visits: Sequence[float]) -> str:
    """Write the observations of all visits; what follows in a visit is a second later."""
    lines = ["# label: warm-ups", "# datum: first", "time,component,position_mm,direction,setup"]
    for number, at_s in enumerate(visits):
        lines += [
            f"{iso(at_s + later)},EZZ,{mm!r},+,visit {number + 1}"
            for later, mm in enumerate(VISIT_MM)
        ]
    return "".join(f"{line}\n" for line in lines)
