"""Warm-ups with the live compensation on: the motors follow the service's table."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Final

import numpy as np

from app.hal.curves import AXES, CURVES, Nodes, table_of
from app.hal.wiring import curve_name
from examples.linuxcnc.campaign import SEED, STAGES_MIN
from examples.linuxcnc.controller import Controller, NotRunning, running
from examples.linuxcnc.maps import HASTE, LINES, MACHINE, laser_um, targets_of
from examples.linuxcnc.plant import SENSORS, Course
from examples.linuxcnc.shop import Shop, iso

BETWEEN_MM: Final = (25.0, 115.0, 190.0, 280.0)
"""Where Z is measured in a warm-up: not where the maps were."""

RATE_UM_PER_S, EVERY_S = 20.0, 0.3
PATIENCE_S: Final = 120.0
FOLLOWED_UM: Final = 1e-3


@dataclass(frozen=True, slots=True)
class Stage:
    """What one measurement in a warm-up found, with the live compensation on.

    Parameters
    ----------
    minutes
        After the warm-up began [min].
    late_c
        By how much the column is behind its sensor [K].
    moved_um
        What the live compensation moves Z by at the highest position that is measured [µm].
    largest_um
        The largest deviation of Z, from the laser's zero at the lowest position [µm].
    """

    minutes: float
    sensor_c: float
    late_c: float
    moved_um: float
    largest_um: float


@dataclass
class Logger:
    """Sends the plant's temperatures to the service, each reading once.

    Parameters
    ----------
    sent_s
        Until when they are there [s].
    """

    shop: Shop
    course: Course
    sent_s: float = float("-inf")

    def send(self, until_s: float) -> None:
        """Send what the sensors have read until a time."""
        readings = [
            {"time": iso(time_s), "temperatures_c": read_c}
            for time_s, read_c in self.course.read(SEED)
            if self.sent_s < time_s <= until_s
        ]
        self.shop.client.store_readings(MACHINE["id"], readings)
        self.sent_s = until_s


@dataclass(frozen=True)
class Live:
    """A controller with the live compensation, and where the points of its curves are [mm]."""

    controller: Controller
    nodes: Nodes

    def wait_for_table(self, shop: Shop) -> None:
        """Wait until the curves are the service's table at the latest reading.

        Raises
        ------
        NotRunning
            If they do not get there.
        """
        until = time.monotonic() + PATIENCE_S
        while (off_um := self._off_um(shop)) > FOLLOWED_UM:
            if time.monotonic() > until:
                raise NotRunning(f"expected curves at the table, got {off_um:.3f} µm beside it")
            time.sleep(EVERY_S)

    def moved_um(self, z_mm: float) -> float:
        """Say what moves Z at a position, with X and Y at 0 [µm]."""
        return float(np.interp(z_mm, self.nodes["z"], self._curve_um("EZZ")))

    def _off_um(self, shop: Shop) -> float:
        tagged = shop.client.current_table(MACHINE["id"])
        if tagged is None:
            raise NotRunning("expected a compensation table, got none")
        table = table_of(json.loads(tagged.table.model_dump_json()), self.nodes, 500.0)
        return max(
            abs(wanted - held)
            for code in CURVES
            for wanted, held in zip(table.curves[code], self._curve_um(code), strict=True)
        )

    def _curve_um(self, code: str) -> list[float]:
        count = len(self.nodes[CURVES[code][1]])
        names = (f"{curve_name(code)}.y-val-{number:02d}" for number in range(count))
        return [1000.0 * value for value in self.controller.get(*names)]


@contextmanager
def live(shop: Shop) -> Iterator[Live]:
    """Start the controller with the live compensation that `thermap hal wiring` writes."""
    words = ("--url", shop.url, "--rate", RATE_UM_PER_S, "--every", EVERY_S)
    wiring = shop.thermap("hal", "wiring", MACHINE["id"], *words)
    nodes = {
        axis: [float(at) for at in re.findall(rf"thermap-e{axis}{axis}\.x-val-\d+ (\S+)", wiring)]
        for axis in AXES
    }
    with running(wiring=wiring) as controller:
        yield Live(controller, nodes)


def warm_up(
    shop: Shop, machine: Live, logger: Logger, begun_s: float, *, until_now: bool
) -> list[Stage]:
    """Measure Z in the stages of a warm-up while its motor follows the service's table.

    Parameters
    ----------
    begun_s
        When the spindle began to turn [s].
    until_now
        Whether the last stage is measured at present: the sensors' values then come through
        HAL's pins, and the component sends them.
    """
    at = ",".join(f"{mm:g}" for mm in BETWEEN_MM)
    lines = (word for line in LINES["z"] for word in ("--line", line))
    words = (MACHINE["id"], "--axis", "z", "--runs", 1, "--at", at, *lines, *HASTE)
    into = f"warm-up-{begun_s:.0f}"
    program, form = shop.program("positioning", *words, into=into)
    stages = []
    for minutes in STAGES_MIN:
        at_s = begun_s + minutes * 60.0
        if until_now and minutes == STAGES_MIN[-1]:
            at_s = _let_pins_tell(shop, machine.controller, logger)
        else:
            logger.send(at_s)
        machine.wait_for_table(shop)
        warmth = logger.course.at(at_s)
        read = laser_um(machine.controller.run(program), "z", targets_of(form), warmth)
        stages.append(
            Stage(
                (at_s - begun_s) / 60.0,
                warmth.z_column_c,
                warmth.z_column_c - warmth.column_c,
                machine.moved_um(BETWEEN_MM[-1]),
                float(np.abs(read).max()),
            )
        )
    return stages


def _let_pins_tell(shop: Shop, controller: Controller, logger: Logger) -> float:
    """Join the sensors to HAL; give the time of the first reading that the component has sent."""
    logger.send(time.time())
    begun_s = time.time()
    warmth = logger.course.at(begun_s)
    read_c = dict(zip(SENSORS, (warmth.x_middle_c, warmth.z_column_c), strict=True))
    controller.set({f"thermap.temperature.{name}": t_c for name, t_c in read_c.items()})
    until = time.monotonic() + PATIENCE_S
    while not shop.client.readings(MACHINE["id"], since=iso(begun_s)):
        if time.monotonic() > until:
            raise NotRunning("expected a reading by the component, got none")
        time.sleep(EVERY_S)
    return begun_s
