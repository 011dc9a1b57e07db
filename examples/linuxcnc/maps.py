"""Maps of two temperatures, and the table between them as the controller's own files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from examples.linuxcnc.controller import Ran, run_program
from examples.linuxcnc.plant import HOUR_S, SENSORS, Warmth, actual_mm
from examples.linuxcnc.shop import Shop, filled, rows_of, zeroed

MACHINE: Final[Mapping[str, Any]] = {
    "id": "vmc",
    "name": "VMC on LinuxCNC",
    "configuration": "XYFZ",
    "axes": {
        "x": {"min_mm": 0, "max_mm": 100},
        "y": {"min_mm": 0, "max_mm": 100},
        "z": {"min_mm": 0, "max_mm": 300},
    },
    # Days pass here in minutes: readings come with stated times, and are old when they come.
    "sensors": [{"name": name, "max_age_s": 10 * 24 * HOUR_S} for name in SENSORS],
}

TARGETS_MM: Final = {"x": (10.0, 24.0, 41.0, 55.0, 72.0), "z": (20.0, 81.0, 149.0, 222.0, 285.0)}
LINES: Final = {"x": ("y=9", "z=290"), "z": ("x=50", "y=50")}

MAPS_C: Final = {"cold": 18.0, "warm": 34.0}
WORKING_C: Final = 26.0

HASTE: Final = ("--feed", 20_000, "--dwell", 0.5, "--reading", 0.2)
"""A simulated machine needs no time to settle, and its laser none to average."""


@dataclass(frozen=True, slots=True)
class Axis:
    """An axis' largest deviation by one program, without compensation and with it [µm]."""

    name: str
    before_um: float
    after_um: float


def map_axis(shop: Shop, axis: str) -> tuple[str, str, Ran]:
    """Measure an axis' positioning at two temperatures, and store the maps.

    Without compensation the motors rest at the same places whatever the temperature is: the
    program runs once, and the laser reads the plant at both.
    """
    at = ",".join(f"{mm:g}" for mm in TARGETS_MM[axis])
    lines = (word for line in LINES[axis] for word in ("--line", line))
    words = (MACHINE["id"], "--axis", axis, "--runs", 1, "--at", at, *lines, *HASTE)
    program, form = shop.program("positioning", *words, into=f"map-{axis}")
    ran = run_program(program)
    for label, t_c in MAPS_C.items():
        read = laser_um(ran, axis, targets_of(form), Warmth.steady(t_c))
        head = {"label": f"{label} {axis}", "measured_at": "2026-01-05T06:00:00Z"}
        head |= {f"temperature {sensor}": f"{t_c:g}" for sensor in SENSORS}
        file = shop.folder / f"{label}-{axis}.csv"
        file.write_text(filled(form, "deviation_um", read, head))
        shop.thermap("import", "--method", "positioning", file, "--machine", MACHINE["id"])
    return program, form, ran


def targets_of(form: str) -> list[float]:
    """Read the targets of a positioning file, in the order of its lines [mm]."""
    return [float(row["target_mm"]) for row in rows_of(form)]


def laser_um(ran: Ran, axis: str, nominal_mm: Sequence[float], warmth: Warmth) -> list[float]:
    """Read the plant at each rest of a program, from the laser's zero at the first [µm]."""
    return zeroed([actual_mm(rest, warmth)[axis] for rest in ran.rests], nominal_mm)


def export(shop: Shop, mapped: Mapping[str, tuple[str, str, Ran]]) -> list[Axis]:
    """Let the controller load the table of a temperature between the maps, and measure again."""
    out = shop.folder / "cnc"
    words = [word for sensor in SENSORS for word in ("-t", f"{sensor}={WORKING_C:g}")]
    shop.thermap("export", MACHINE["id"], "-c", "linuxcnc", *words, "--output", out)
    files = {path.name: path.read_text() for path in out.iterdir()}
    warmth = Warmth.steady(WORKING_C)
    found = []
    for axis, (program, form, without) in mapped.items():
        targets = targets_of(form)
        compensated = run_program(program, files)
        sizes = [
            float(np.abs(laser_um(ran, axis, targets, warmth)).max())
            for ran in (without, compensated)
        ]
        found.append(Axis(axis, *sizes))
    return found
