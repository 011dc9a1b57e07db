"""What connections hand over: collected, stored once, refused or dropped, and each counted."""

import asyncio
import logging
from contextlib import asynccontextmanager, suppress
from datetime import datetime, timedelta

import pytest

from app.connections import intake as module
from app.connections.intake import Fate, Intake, Limits
from app.errors import StorageUnavailable
from tests.service_examples import ROOM, START, client_of, furnish_database

pytestmark = pytest.mark.anyio

MACHINE = "mcfv5050"
SOON = 0.05


@pytest.fixture
def service(new_app, databases):
    url = databases.prepared("sqlite", furnish_database)
    yield new_app(url)
    databases.give_back(url)


@asynccontextmanager
async def running_intake(service, **limits):
    intake = Intake(
        lambda: service.state.context, Limits(collect_s=SOON, first_pause_s=SOON, **limits)
    )
    task = asyncio.create_task(intake.run())
    try:
        yield intake
    finally:
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task


async def readings_of(service):
    async with client_of(service) as client:
        answer = await client.get(f"{ROOM}/readings")
        return answer.json()


async def test_sensors_that_arrive_apart_become_one_reading(service):
    async with running_intake(service) as intake:
        fates = [
            intake.offer(MACHINE, {"x-middle": 22.0}),
            intake.offer(MACHINE, {"y-front": 21.0}, state={"spindle_rpm": 4000}),
        ]
        assert await asyncio.gather(*fates) == [Fate.STORED] * 2
    (reading,) = await readings_of(service)
    assert reading["temperatures_c"] == {"x-middle": 22.0, "y-front": 21.0}
    assert reading["state"] == {"spindle_rpm": 4000}


async def test_every_value_of_a_flood_is_a_reading_though_the_clock_stands(service):
    async with running_intake(service) as intake:
        fates = [intake.offer(MACHINE, {"x-middle": 20.0 + i / 10}) for i in range(30)]
        assert set(await asyncio.gather(*fates)) == {Fate.STORED}
    stored = await readings_of(service)
    assert sorted(r["temperatures_c"]["x-middle"] for r in stored) == pytest.approx(
        [20.0 + i / 10 for i in range(30)]
    )


@pytest.mark.parametrize(
    "value", [float("nan"), float("inf"), "22", True, pytest.param(10**400, id="huge")]
)
async def test_what_is_no_number_is_refused_at_once(service, value):
    async with running_intake(service) as intake:
        assert await intake.offer(MACHINE, {"x-middle": value}) is Fate.REFUSED
        assert "expected a finite number in °C" in intake.counts.last_refusal
    assert await readings_of(service) == []


async def test_a_refused_sensor_takes_no_other_with_it(service):
    async with running_intake(service) as intake:
        fates = [
            intake.offer(MACHINE, {"x-middle": 295.0}),  # kelvin
            intake.offer(MACHINE, {"nowhere": 20.0}),
            intake.offer(MACHINE, {"y-front": 21.0}),
        ]
        assert await asyncio.gather(*fates) == [Fate.REFUSED, Fate.REFUSED, Fate.STORED]
        assert intake.counts.refused
    (reading,) = await readings_of(service)
    assert reading["temperatures_c"] == {"y-front": 21.0}


async def test_an_unknown_machine_is_refused_and_holds_nobody_up(service):
    async with running_intake(service) as intake:
        assert await intake.offer("lathe", {"x-middle": 22.0}) is Fate.REFUSED
        assert await intake.offer(MACHINE, {"x-middle": 22.0}) is Fate.STORED
        assert "lathe" in intake.counts.last_refusal


async def test_the_sender_s_time_is_kept_and_a_wrong_clock_is_told(service, caplog):
    caplog.set_level(logging.WARNING, "thermap")  # whatever a service before it was told
    sent = START - timedelta(minutes=10)
    async with running_intake(service) as intake:
        fates = [
            intake.offer(MACHINE, {"x-middle": 22.0}, sent),
            intake.offer(MACHINE, {"y-front": 21.0}, sent),
        ]
        assert await asyncio.gather(*fates) == [Fate.STORED] * 2
        assert intake.counts.wrong_clocks == 2
    assert caplog.text.count("600.0 s behind the service's clock") == 1
    (reading,) = await readings_of(service)
    assert reading["time"].startswith("2026-03-01T05:50:00")


async def test_what_the_database_cannot_take_is_kept_and_the_oldest_dropped(service, monkeypatch):
    store, away = module.store_readings, [True]

    def store_or_not(*asked):
        if away:
            raise StorageUnavailable("the database is away")
        return store(*asked)

    monkeypatch.setattr(module, "store_readings", store_or_not)
    async with running_intake(service, most_kept=3) as intake:
        fates = [intake.offer(MACHINE, {"x-middle": 20.0 + i}) for i in range(5)]
        assert [await fates[0], await fates[1]] == [Fate.DROPPED] * 2
        away.clear()
        assert await asyncio.gather(*fates[2:]) == [Fate.STORED] * 3
        assert (intake.counts.dropped, intake.counts.stored) == (2, 3)
    stored = await readings_of(service)
    assert sorted(r["temperatures_c"]["x-middle"] for r in stored) == [22.0, 23.0, 24.0]


async def test_who_waits_when_it_ends_is_told(service):
    async with running_intake(service) as intake:
        fate = intake.offer(MACHINE, {"x-middle": 22.0})
        await asyncio.sleep(0)
    assert await fate is Fate.DROPPED


async def test_a_reading_that_has_all_that_there_usually_is_does_not_wait(service):
    async with running_intake(service) as intake:
        first = [
            intake.offer(MACHINE, {"x-middle": 22.0}),
            intake.offer(MACHINE, {"y-front": 21.0}),
        ]
        await asyncio.gather(*first)
        intake._limits = Limits(collect_s=3600.0)
        part = intake.offer(MACHINE, {"x-middle": 22.5})
        await asyncio.sleep(SOON)
        assert not part.done()
        async with asyncio.timeout(60):
            assert await intake.offer(MACHINE, {"y-front": 21.5}) is Fate.STORED
        assert await part is Fate.STORED
    assert len(await readings_of(service)) == 2


async def test_what_comes_late_for_a_time_goes_behind_it_or_is_refused(service):
    sent = START - timedelta(seconds=1)
    async with running_intake(service) as intake:
        assert await intake.offer(MACHINE, {"x-middle": 22.0}, sent) is Fate.STORED
        assert await intake.offer(MACHINE, {"y-front": 21.0}, sent) is Fate.STORED
        assert await intake.offer(MACHINE, {"z-column": 20.0}, sent) is Fate.STORED
        # As a broker tells again what it was not told had arrived.
        assert await intake.offer(MACHINE, {"y-front": 21.0}, sent) is Fate.STORED
        assert await intake.offer(MACHINE, {"x-middle": 22.1}, sent) is Fate.REFUSED
    stored = await readings_of(service)
    stored.sort(key=lambda one: datetime.fromisoformat(one["time"]))
    assert [one["temperatures_c"] for one in stored] == [
        {"x-middle": 22.0},
        {"y-front": 21.0},
        {"z-column": 20.0},
    ]


async def test_of_many_refusals_few_are_logged_and_all_are_counted(service, caplog):
    caplog.set_level(logging.WARNING, "thermap")
    async with running_intake(service) as intake:
        for _ in range(100):
            intake.refuse("topic 'a'", "expected a number, got 'x'")
        assert intake.counts.refused == 100
        assert intake.counts.last_refusal == "topic 'a': expected a number, got 'x'"
    assert caplog.text.count("refused from a connection") == 1
