"""From a laser on body diagonals to a compensation table, with the truth beside it.

The simulated machine (app.simulation.example) warms up. In three thermal states a laser steps
along its four body diagonals and an autocollimator reads its angles, both with noise; the service
makes error maps of that. Then the machine is asked at temperatures in between, where
nothing was measured, and its answers are compared with what the machine really does.

A laser on diagonals cannot see where the machine stands and how it lies as a whole: one
displacement and one turn are taken out of every comparison, as aligning a workpiece does.

    python -m examples.step_diagonal_to_table
"""

from __future__ import annotations

import asyncio
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import httpx
import numpy as np

from app.geometry.components import COMPONENTS
from app.geometry.error_field import ErrorField
from app.geometry.error_table import Table
from app.main import create_app
from app.measurement.step_diagonal_readings import step_diagonal_readings
from app.settings import Settings
from app.simulation.example.machine import TRAVEL_MM, example_machine, positions_mm
from app.simulation.example.true_errors import true_errors
from app.simulation.example.warm_up import run_temperatures
from app.thermal.machine import MACHINE
from app.units import MM_PER_M
from thermap import AsyncThermapClient
from thermap.answers import CompensationAnswer

MEASURED_RUNS = (1, 3, 6)
ASKED_RUNS = (2, 4, 5)
STEPS = 20
READING_NOISE_UM = 0.2
ANGLE_NOISE_URAD = 0.5
TOOL_MM = (0.0, 0.0, 160.0)
POINTS = 2000
MEASURED_AT = datetime(2026, 3, 2, 6, 0, tzinfo=UTC)


@dataclass(frozen=True, slots=True)
class Comparison:
    """RMS length of the volumetric error before and after compensation [µm].

    `uncertainty_um` is what the tables' own standard errors of translations and
    squareness amount to at the same points.
    """

    run: int
    before_um: float
    after_um: float
    uncertainty_um: float


async def compare(folder: Path) -> list[Comparison]:
    """Measure, store, ask, compare."""
    service = create_app(Settings(database_url=f"sqlite:///{folder / 'example.db'}"))
    transport = httpx.ASGITransport(app=service)
    machine = example_machine()
    rng = np.random.default_rng(2026)
    try:
        async with AsyncThermapClient("http://localhost", transport=transport) as thermap:
            await thermap.create_machine(MACHINE.dump_python(machine, mode="json"))
            for number in MEASURED_RUNS:
                await measure(thermap, machine.id, number, rng)
            return [await ask(thermap, machine.id, number, rng) for number in ASKED_RUNS]
    finally:
        service.state.context.database.close()


async def measure(
    thermap: AsyncThermapClient, machine: str, number: int, rng: np.random.Generator
) -> None:
    """Read angles and diagonals in one thermal state, and store both."""
    header = {
        "measured_at": MEASURED_AT + timedelta(hours=number),
        "temperatures_c": run_temperatures(number),
    }
    angles = measured_angles(number, rng)
    await thermap.store_error_map(
        machine, header | {"label": f"Angles {number}", "components": angles}
    )
    step_mm = [length / STEPS for length in TRAVEL_MM.values()]
    readings = step_diagonal_readings(
        true_field(run_temperatures(number)),
        (0.0, 0.0, 0.0),
        step_mm,
        STEPS,
        tool_offset_mm=TOOL_MM,
        noise_um=READING_NOISE_UM,
        rng=rng,
    )
    measurement = {
        "label": f"Diagonals {number}",
        "origin_mm": [0, 0, 0],
        "step_mm": step_mm,
        "tool_offset_mm": TOOL_MM,
        "diagonals": readings,
        "angular": angles,
        "mirror_angle_urad": 0,
    }
    await thermap.measure(machine, "step-diagonal", header | measurement, store=True)


async def ask(
    thermap: AsyncThermapClient, machine: str, number: int, rng: np.random.Generator
) -> Comparison:
    """Compare the service's answer at one run's temperatures with the truth."""
    temperatures_c = run_temperatures(number)
    points = rng.uniform((0.0, 0.0, 0.0), tuple(TRAVEL_MM.values()), (POINTS, 3))
    question = {
        "temperatures_c": temperatures_c,
        "points_mm": points,
        "tool_offset_mm": TOOL_MM,
    }
    predicted = await thermap.volumetric_error(machine, question)
    truth, _ = true_field(temperatures_c).at(points, TOOL_MM)
    table = await thermap.compensation(machine, temperatures_c)
    return Comparison(
        run=number,
        before_um=rms_length(without_rigid_motion(points, truth)),
        after_um=rms_length(without_rigid_motion(points, truth - predicted.errors_um)),
        uncertainty_um=stated_uncertainty(table, points),
    )


def stated_uncertainty(table: CompensationAnswer, points_mm: np.ndarray) -> float:
    """Add the variances of translations and squareness at each point; their RMS [µm]."""
    variance = np.zeros(len(points_mm))
    for entry in table.components:
        component = COMPONENTS[entry.component]
        if entry.standard_errors_um is not None:
            along = points_mm[:, "xyz".index(str(component.axis))]
            variance += np.interp(along, entry.positions_mm, entry.standard_errors_um) ** 2
        if entry.standard_error_um_per_m is not None:
            arm_m = points_mm[:, "xyz".index(str(component.times))] / MM_PER_M
            variance += (entry.standard_error_um_per_m * arm_m) ** 2
    return float(np.sqrt(variance.mean()))


def true_field(temperatures_c: Mapping[str, float]) -> ErrorField:
    """What the machine really does."""
    tables = {}
    for code, errors in true_errors(temperatures_c).items():
        axis = COMPONENTS[code].axis
        tables[code] = Table(positions_mm(axis) if axis else (), errors)
    return ErrorField.make(example_machine().chain, tables)


def measured_angles(number: int, rng: np.random.Generator) -> list[dict[str, Any]]:
    """Roll, pitch and yaw as an autocollimator and a level read them."""
    return [
        {
            "component": code,
            "positions_mm": positions_mm(str(COMPONENTS[code].axis)),
            "errors_urad": errors + rng.normal(0.0, ANGLE_NOISE_URAD, errors.size),
        }
        for code, errors in true_errors(run_temperatures(number)).items()
        if COMPONENTS[code].is_rotation
    ]


def without_rigid_motion(points_mm: np.ndarray, errors_um: np.ndarray) -> np.ndarray:
    """Take out the displacement and the small turn that fit the errors best."""
    x, y, z = (points_mm - points_mm.mean(axis=0)).T
    one, none = np.ones_like(x), np.zeros_like(x)
    columns = [
        (one, none, none), (none, one, none), (none, none, one),
        (none, -z, y), (z, none, -x), (-y, x, none),
    ]  # fmt: skip
    design = np.stack([np.concatenate(column) for column in columns], axis=1)
    stacked = errors_um.T.reshape(-1)
    fit, *_ = np.linalg.lstsq(design, stacked)
    return (stacked - design @ fit).reshape(3, -1).T


def rms_length(vectors_um: np.ndarray) -> float:
    """Root mean square of the vectors' lengths [µm]."""
    return float(np.sqrt((vectors_um**2).sum(axis=1).mean()))


def main() -> None:
    """Print the error before and after, and what the tables say of their own uncertainty."""
    with tempfile.TemporaryDirectory() as folder:
        found = asyncio.run(compare(Path(folder)))
    print("volumetric error of the simulated machine [µm], RMS over the work volume")
    print("at the temperatures of   before   after   stated uncertainty of the measurement")
    for row in found:
        print(
            f"Run #{row.run} (not measured)  {row.before_um:7.2f} {row.after_um:7.2f} "
            f"{row.uncertainty_um:7.2f}"
        )


if __name__ == "__main__":
    main()
