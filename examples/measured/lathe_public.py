"""The lathe by the way that a shop has: every third run unseen, the others analysed and adopted.

All goes over HTTP, as a shop would send it: the machine, two error maps, what sensors and spindle
read during the runs and nothing between them, and a verification of each run. Analysing and
adopting what helps, which is what `thermap analyse --adopt` does, is repeated until an analysis
has nothing to add; then the runs that nobody has seen are sent, and held against the first model
and the last. Each run counts from its first observation, where the instrument was zeroed.
"""

from __future__ import annotations

import asyncio
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

import httpx
import numpy as np

from app.api.schemas.machines import settings_of
from app.arrays import FloatArray
from app.identification.analysis.response_rows import response_rows
from app.identification.campaign import residuals_of
from app.main import create_app
from app.search.figures import rms
from app.settings import Settings
from examples.measured.black_boxes import black_boxes, left_of, print_left
from examples.measured.lathe import Lathe, make_lathe
from examples.measured.lathe_runs import DISPLACEMENTS, Run, read_runs
from thermap import AsyncThermapClient
from thermap.answers import AnalysisAnswer, AnalysisResult

UNSEEN_EACH: Final = 3
MOST_ROUNDS: Final = 8
LOOK_EVERY_S: Final = 0.5
MOST_ROWS: Final = 10_000


@dataclass(frozen=True, eq=False)
class Seen:
    """One analysis: what it found, and which model version its adoption made, if any."""

    result: AnalysisResult
    version: int | None


@dataclass(frozen=True, eq=False)
class Held:
    """One unseen run and component against a model: measured and left, from its zero."""

    measured: FloatArray
    left: FloatArray


def print_report(data: Path, _: int) -> None:
    """Print what each analysis adopted, and the unseen runs before and after."""
    lathe = make_lathe(read_runs(data))
    unseen = [run.date for run in lathe.runs][1::UNSEEN_EACH]
    with tempfile.TemporaryDirectory() as folder:
        seen, first, last = asyncio.run(close_and_hold(Path(folder), lathe, unseen))
    for number, one in enumerate(seen, 1):
        print(f"  analysis {number}: {one.result.summary}")
        for effect in one.result.effects:
            print(f"    {'adopted' if effect.helps else 'left   '} {effect.explanation}")
    print(f"  unseen: {', '.join(unseen)}")
    residuals = residuals_of(lathe.campaign([run.date for run in lathe.runs]))
    for code in DISPLACEMENTS:
        print(f"  {code}, unseen runs, from their zero [µm]; the run that loses most")
        measured = [first[date, code].measured for date in unseen]
        print_left("uncompensated", measured, measured)
        print_left("maps", measured, [first[date, code].left for date in unseen])
        print_left("after adoption", measured, [last[date, code].left for date in unseen])
        for date in unseen:
            maps, adopted = first[date, code], last[date, code]
            print(
                f"      {date}: {rms(maps.measured):.1f}, maps {rms(maps.left):.1f}, "
                f"after adoption {rms(adopted.left):.1f}"
            )
        set_ups = response_rows(residuals, code).set_ups
        known = [one.course for one in set_ups if one.label not in unseen]
        asked = [one.course for one in set_ups if one.label in unseen]
        for name, learn in black_boxes().items():
            print_left(name, measured, left_of(learn, known, asked))


async def close_and_hold(
    folder: Path, lathe: Lathe, unseen: Sequence[str]
) -> tuple[list[Seen], dict[tuple[str, str], Held], dict[tuple[str, str], Held]]:
    """Learn from the runs that are known, then send the others.

    Parameters
    ----------
    folder
        Where the service's database is made.
    unseen
        Dates of the runs that are sent at the end.

    Returns
    -------
    seen, first, last
        The analyses, and the unseen runs by date and component: held against the model of the
        maps alone, and against the last one.
    """
    service = create_app(Settings(database_url=f"sqlite:///{folder / 'lathe.db'}"))
    transport = httpx.ASGITransport(app=service)
    machine = lathe.model.machine.id
    try:
        async with AsyncThermapClient("http://localhost", transport=transport) as thermap:
            await _furnish(thermap, lathe)
            for run in lathe.runs:
                if run.date not in unseen:
                    await thermap.store_readings(machine, _readings(run))
                    await thermap.store_verification(machine, _verification(lathe, run))
            first = (await thermap.machine(machine)).active_model
            seen = await _close(thermap, machine)
            last = next((one.version for one in reversed(seen) if one.version), first)
            stored = {}
            for run in lathe.runs:
                if run.date in unseen:
                    await thermap.store_readings(machine, _readings(run))
                    body = _verification(lathe, run)
                    stored[run.date] = (await thermap.store_verification(machine, body)).id
            held = [await _held(thermap, machine, stored, version) for version in (first, last)]
    finally:
        service.state.runner.stop()
        service.state.context.database.close()
    return seen, held[0], held[1]


async def _furnish(thermap: AsyncThermapClient, lathe: Lathe) -> None:
    """Store the machine, its maps, and which sensor each component follows."""
    machine = lathe.model.machine
    await thermap.create_machine(settings_of(machine))
    for error_map in lathe.maps:
        body = {
            "label": error_map.label,
            "measured_at": error_map.measured_at,
            "temperatures_c": dict(error_map.temperatures_c),
            "components": [
                {
                    "component": code,
                    "positions_mm": table.positions_mm.tolist(),
                    "errors_um": table.errors.tolist(),
                }
                for code, table in error_map.tables.items()
            ],
            "repeatability_um": error_map.repeatability_um,
        }
        await thermap.store_error_map(machine.id, body)
    assignment = {code: group.sensor for group in lathe.model.groups for code in group.codes}
    await thermap.assign_sensors(machine.id, assignment)


async def _close(thermap: AsyncThermapClient, machine: str) -> list[Seen]:
    """Analyse and adopt what helps, until there is nothing."""
    seen: list[Seen] = []
    for _ in range(MOST_ROUNDS):
        known = [one.id for one in await thermap.verifications(machine)]
        job = await thermap.analyse(machine, {"verifications": known})
        result = (await _finished(thermap, machine, job.id)).result
        if result is None:
            raise RuntimeError(f"analysis {job.id} came to no answer")
        version = None
        if any(effect.helps for effect in result.effects):
            version = (await thermap.adopt_analysis(machine, job.id)).version
        seen.append(Seen(result, version))
        if version is None:
            break
    return seen


async def _finished(thermap: AsyncThermapClient, machine: str, number: int) -> AnalysisAnswer:
    while True:
        analysis = await thermap.analysis(machine, number)
        if analysis.status not in ("queued", "running"):
            return analysis
        await asyncio.sleep(LOOK_EVERY_S)


async def _held(
    thermap: AsyncThermapClient, machine: str, stored: Mapping[str, int], version: int | None
) -> dict[tuple[str, str], Held]:
    """Hold verifications against a model version, each from its first observation."""
    found = {}
    for date, number in stored.items():
        answer = await thermap.verification_residuals(
            machine, number, model_version=version, rows=MOST_ROWS
        )
        for code in DISPLACEMENTS:
            own = sorted((r for r in answer.rows if r.component == code), key=lambda r: r.time)
            measured = np.array([row.measured for row in own])
            predicted = np.array([row.predicted for row in own])
            left = measured - predicted
            found[date, code] = Held(
                (measured - measured[0])[1:],
                (left - left[0])[1:],
            )
    return found


def _readings(run: Run) -> list[dict[str, Any]]:
    """Write what was read during a run."""
    return [
        {
            "time": datetime.fromtimestamp(time_s, UTC),
            "temperatures_c": {name: float(t[i]) for name, t in run.temperatures_c.items()},
            "state": {"spindle_rpm": float(run.spindle_rpm[i])},
        }
        for i, time_s in enumerate(run.times_s.tolist())
    ]


def _verification(lathe: Lathe, run: Run) -> dict[str, Any]:
    """Write a run as a verification."""
    (one,) = lathe.verifications([run.date])
    return {
        "label": one.label,
        "datum": one.datum,
        "observations": [
            {
                "time": datetime.fromtimestamp(each.time_s, UTC),
                "component": each.component,
                "position_mm": each.position_mm,
                "measured_um": each.measured[0],
            }
            for each in one.observations
        ],
    }
