"""Close the loop on a machine with an effect that its model lacks.

A simulated machine (app.simulation.undeclared) answers one of its sensors late; nobody tells the
service. It gets the machine, its error maps, what the sensors read, and 30 visits of
measurements. It finds the effect, which is adopted. Ten later visits, of which the service
knew nothing, are then held against the model as it was and as it is.

    python -m examples.close_the_loop [report.html]
"""

from __future__ import annotations

import asyncio
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx

from app.main import create_app
from app.settings import Settings
from app.simulation.undeclared import make_campaign
from app.simulation.undeclared.campaign import Campaign
from thermap import AsyncThermapClient

PLANTED = "thermal-lag:component"
SIZE = 3.0
"""Standard deviation of the effect over that of one observation."""

SEED = 12
LEARNT_FROM, LATER = 30, 10
READINGS_AT_ONCE = 10_000


@dataclass(frozen=True, slots=True)
class Closed:
    """What was planted, what was found, and the error of later visits before and after [µm]."""

    planted: dict[str, Any]
    summary: str
    status: str
    before_um: float
    after_um: float
    report: str


async def close_the_loop(
    folder: Path, planted: str = PLANTED, learnt_from: int = LEARNT_FROM, later: int = LATER
) -> Closed:
    """Store, analyse, adopt, compare.

    Parameters
    ----------
    folder
        Where the service's database is made.
    planted
        Which effect (app.simulation.undeclared).
    learnt_from, later
        How many visits the service learns from, and how many come after.
    """
    made = make_campaign(SEED, planted, SIZE, visits=learnt_from + later)
    service = create_app(Settings(database_url=f"sqlite:///{folder / 'example.db'}"))
    transport = httpx.ASGITransport(app=service)
    machine = made.machine["id"]
    try:
        async with AsyncThermapClient("http://localhost", transport=transport) as thermap:
            await furnish(thermap, made)
            known = await store(thermap, machine, made.verifications[:learnt_from])
            job = await thermap.analyse(machine, {"verifications": known})
            analysis = await thermap.wait_for_analysis(machine, job.id)
            assert analysis.result is not None
            before = analysis.model_version
            after = (await thermap.adopt_analysis(machine, job.id)).version
            new = await store(thermap, machine, made.verifications[learnt_from:])
            compared = await thermap.compare_models(machine, new, [before, after])
            sizes = [one.overall.rms for one in compared.versions if one.overall is not None]
            report = await thermap.analysis_report(machine, job.id)
    finally:
        service.state.runner.stop()
        service.state.context.database.close()
    (effect,) = made.truth.effects
    status = analysis.result.effects[0].status
    return Closed(effect, analysis.result.summary, status, sizes[0], sizes[1], report)


async def furnish(thermap: AsyncThermapClient, made: Campaign) -> None:
    """Store the machine, its maps and what the sensors read."""
    machine = made.machine["id"]
    await thermap.create_machine(made.machine)
    for error_map in made.error_maps:
        await thermap.store_error_map(machine, error_map)
    for first in range(0, len(made.readings), READINGS_AT_ONCE):
        await thermap.store_readings(machine, made.readings[first : first + READINGS_AT_ONCE])


async def store(
    thermap: AsyncThermapClient, machine: str, verifications: Sequence[Any]
) -> list[int]:
    """Store verifications; give their numbers."""
    return [(await thermap.store_verification(machine, one)).id for one in verifications]


def main() -> None:
    """Print what was planted and found, and the error before and after."""
    with tempfile.TemporaryDirectory() as folder:
        closed = asyncio.run(close_the_loop(Path(folder)))
    kind, parameters = closed.planted["kind"], closed.planted["parameters"]
    told = ", ".join(f"{name} {value:.3g}" for name, value in parameters.items())
    print(f"planted  {kind} on {' '.join(closed.planted['components'])}: {told}")
    print(f"found    {closed.summary}")
    print(
        f"adopted  {LATER} later visits, of which the service knew nothing: "
        f"{closed.before_um:.2f} µm before, {closed.after_um:.2f} µm after (RMS)"
    )
    if len(sys.argv) > 1:
        Path(sys.argv[1]).write_text(closed.report, encoding="utf-8")
        print(f"report   {sys.argv[1]}")


if __name__ == "__main__":
    main()
