"""The lathe by the way that a shop has: every third run unseen, the others analysed and adopted.

All goes over HTTP, as a shop would send it: the machine, two error maps, what sensors and spindle
read during the runs and nothing between them, and a verification of each run. Analysing and
adopting what helps, which is what `thermap analyse --adopt` does, is repeated until an analysis
has nothing to add; then the runs that nobody has seen are sent, and held against the first model
and the last. Each run counts from its first observation, where the instrument was zeroed. Three
splits, from each of the first three runs on, let every run but that of the maps be unseen once.
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

from app.arrays import FloatArray, rms
from app.identification.analysis.response_rows import response_rows
from app.identification.campaign import residuals_of
from app.main import create_app
from app.settings import Settings
from app.thermal.machine import MACHINE
from examples.measured.black_boxes import black_boxes, left_of, print_left
from examples.measured.lathe import MAPPED, Lathe, make_lathe
from examples.measured.lathe_runs import DISPLACEMENTS, Run, read_runs
from thermap import AsyncThermapClient
from thermap.answers import AnalysisResult

UNSEEN_EACH: Final = 3
FIRST_UNSEEN: Final = ("20200615", "20200616", "20200618")
"""The first runs: every third from each of them on, and each run is unseen once."""

MOST_ROUNDS: Final = 8
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


@dataclass(frozen=True, eq=False)
class Split:
    """Unseen runs of one component: measured, and left by each thing that corrects them."""

    measured: list[FloatArray]
    left: dict[str, list[FloatArray]]

    def print(self, title: str) -> None:
        """Print each of them, and the run that it makes worse by most, or better by least."""
        print(f"  {title}, {len(self.measured)} unseen runs, from their zero [µm]")
        for name, left in self.left.items():
            print_left(name, self.measured, left)

    @classmethod
    def pooled(cls, splits: Sequence[Split]) -> Split:
        """Put the runs of several splits together."""
        return cls(
            [run for split in splits for run in split.measured],
            {
                name: [run for split in splits for run in split.left[name]]
                for name in splits[0].left
            },
        )


def print_report(data: Path, since: Sequence[str] = FIRST_UNSEEN) -> None:
    """Print what each analysis adopted, and the unseen runs before and after.

    Parameters
    ----------
    data
        The folder of measured data.
    since
        The first unseen run of each split.
    """
    lathe = make_lathe(read_runs(data))
    splits = [_print_split(lathe, one) for one in since]
    if len(splits) > 1:
        for code in DISPLACEMENTS:
            Split.pooled([split[code] for split in splits]).print(f"{code}, all splits")


def unseen_dates(lathe: Lathe, since: str) -> list[str]:
    """List every third run from one on; the run that the maps are states of is always known."""
    if since not in FIRST_UNSEEN:
        raise ValueError(f"expected one of {', '.join(FIRST_UNSEEN)}, got {since}")
    dates = [run.date for run in lathe.runs]
    return [date for date in dates[dates.index(since) :: UNSEEN_EACH] if date != MAPPED]


def _print_split(lathe: Lathe, since: str) -> dict[str, Split]:
    unseen = unseen_dates(lathe, since)
    print(f"  unseen: {', '.join(unseen)}", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        seen, first, last = asyncio.run(close_and_hold(Path(folder), lathe, unseen))
    for number, one in enumerate(seen, 1):
        print(f"  analysis {number}: {one.result.summary}")
        for effect in one.result.effects:
            print(f"    {'adopted' if effect.helps else 'left   '} {effect.explanation}")
        for moved in one.result.refitted:
            print(f"    {moved.outcome:7} {moved.explanation}")
    residuals = residuals_of(lathe.campaign([run.date for run in lathe.runs]))
    found = {}
    for code in DISPLACEMENTS:
        measured = [first[date, code].measured for date in unseen]
        left = {
            "uncompensated": measured,
            "maps": [first[date, code].left for date in unseen],
            "after adoption": [last[date, code].left for date in unseen],
        }
        set_ups = response_rows(residuals, code).set_ups
        known = [one.course for one in set_ups if one.label not in unseen]
        asked = [one.course for one in set_ups if one.label in unseen]
        for name, learn in black_boxes().items():
            left[name] = left_of(learn, known, asked)
        found[code] = Split(measured, left)
        found[code].print(f"{code}, split from {since}")
        for date, *each in zip(unseen, *left.values(), strict=True):
            print(f"      {date}: {', '.join(f'{rms(one):.2f}' for one in each)}", flush=True)
    return found


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
    await thermap.create_machine(MACHINE.dump_python(machine, mode="json"))
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
        result = (await thermap.wait_for_analysis(machine, job.id)).result
        if result is None:
            raise RuntimeError(f"analysis {job.id} came to no answer")
        version = None
        is_refit_due = any(one.is_changed for one in result.refitted)
        if is_refit_due or any(effect.helps for effect in result.effects):
            version = (await thermap.adopt_analysis(machine, job.id)).version
        seen.append(Seen(result, version))
        if version is None:
            break
    return seen


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
