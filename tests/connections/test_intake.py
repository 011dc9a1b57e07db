"""What connections hand over: collected, stored once, refused or dropped, and each counted."""

import asyncio
import logging
import threading
from contextlib import asynccontextmanager, suppress
from datetime import datetime, timedelta

import pytest

from app.connections import intake as module
from app.connections.intake import Fate, Intake, Limits, Sender
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
        intake.end()


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


async def test_a_sender_whose_values_are_refused_is_told_of_until_one_is_stored(service):
    async with running_intake(service) as intake:
        sender, other = Sender(intake), Sender(intake)
        await asyncio.gather(
            sender.offer(MACHINE, {"x-middle": 295.0, "y-front": 21.0}),
            sender.offer("lathe", {"bed": 20.0}),
            other.offer(MACHINE, {"z-column": 22.0}),
        )
        lathe, x = sender.troubles
        assert lathe.startswith("bed of 'lathe': ")
        assert x == (
            f"x-middle of {MACHINE!r}: expected a temperature of x-middle from -10 to 80 °C, got "
            "295, which would be 21.85 °C if it was meant in kelvin, and 29.50 °C in tenths of a "
            "degree"
        )
        assert other.troubles == []
        await sender.offer(MACHINE, {"x-middle": 24.5})
        assert sender.troubles == [lathe]


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


async def stored_and_dropped(fates):
    found = await asyncio.gather(*fates)
    return found.count(Fate.STORED), found.count(Fate.DROPPED)


async def test_a_flood_costs_no_other_machine_its_reading(service, monkeypatch):
    away = [True]

    def store_or_not(*asked):
        if away:
            raise StorageUnavailable("the database is away")

    monkeypatch.setattr(module, "store_readings", store_or_not)
    async with running_intake(service, most_kept=10) as intake:
        first = intake.offer("other", {"x-middle": 21.0})
        flood = [intake.offer(MACHINE, {"x-middle": 20.0 + i / 100}) for i in range(100)]
        dropped = 91
        while intake.counts.dropped < dropped - 1:
            await asyncio.sleep(0.01)
        away.clear()
        assert await first is Fate.STORED
        stored, lost = await stored_and_dropped(flood)
        assert (stored + lost, stored) == (100, 9)
        # The newest are those that are kept.
        assert [await fate for fate in flood[-9:]] == [Fate.STORED] * 9


async def test_readings_that_are_collected_are_bounded_too(service, monkeypatch):
    monkeypatch.setattr(module, "MOST_ASKED", 10)
    intake = Intake(lambda: service.state.context, Limits(collect_s=60.0, most_kept=5))
    # Times that differ are readings of their own: each would wait for a minute for more of it.
    for i in range(50):
        intake.offer(MACHINE, {"x-middle": 22.0}, START - timedelta(seconds=i))
    assert (len(intake._open), len(intake._kept)) == (5, 5)
    assert intake.counts.dropped == 40
    # Of values that are alike a reading takes no more than so many.
    for _ in range(30):
        intake.offer(MACHINE, {"x-middle": 22.0})
    assert max(len(one.asked) for one in [*intake._kept, *intake._open.values()]) == 10
    assert all(one.closing.cancelled() for one in intake._kept)
    intake._drop_all()


async def test_a_machine_that_was_deleted_is_asked_for_once(service, monkeypatch):
    asked, deleted, store = [], threading.Event(), module.store_readings

    def counted(*arguments):
        assert deleted.wait(60)
        asked.append(len(arguments[2]))
        return store(*arguments)

    monkeypatch.setattr(module, "store_readings", counted)
    async with running_intake(service) as intake:
        fates = [intake.offer(MACHINE, {"x-middle": 20.0 + i}) for i in range(20)]
        async with client_of(service) as client:
            assert (await client.delete(ROOM)).status_code == 204
        deleted.set()
        assert set(await asyncio.gather(*fates)) == {Fate.REFUSED}
        assert intake.counts.refused == 20
    assert sum(asked) == 20


async def test_what_nobody_can_store_takes_no_other_with_it(service, monkeypatch):
    store = module.store_readings

    def store_or_fail(context, machine, readings):
        if any(one.temperatures_c.get("x-middle") == 23.0 for one in readings):
            raise OverflowError("date value out of range")
        return store(context, machine, readings)

    monkeypatch.setattr(module, "store_readings", store_or_fail)
    async with running_intake(service) as intake:
        fates = [intake.offer(MACHINE, {"x-middle": 20.0 + i}) for i in range(6)]
        found = await asyncio.gather(*fates)
    assert found == [Fate.STORED] * 3 + [Fate.REFUSED] + [Fate.STORED] * 2
    assert "OverflowError: date value out of range" in intake.counts.last_refusal


async def test_while_the_database_hangs_values_are_taken_and_the_rest_goes_on(service, monkeypatch):
    goes_on, store = threading.Event(), module.store_readings

    def store_late(*asked):
        assert goes_on.wait(60)
        return store(*asked)

    monkeypatch.setattr(module, "store_readings", store_late)
    async with running_intake(service, most_kept=10) as intake:
        fates = [intake.offer(MACHINE, {"x-middle": 20.0 + i / 10}) for i in range(5)]
        await asyncio.sleep(2 * SOON)  # the first are being stored
        fates += [intake.offer(MACHINE, {"x-middle": 30.0 + i / 10}) for i in range(50)]
        await asyncio.sleep(2 * SOON)
        assert len(intake._kept) == 10
        assert intake.counts.dropped == 45
        goes_on.set()
        stored, dropped = await stored_and_dropped(fates)
        assert (stored, dropped) == (10, 45)


async def test_the_service_s_clock_may_be_set_right(service, clock):
    async with running_intake(service) as intake:
        clock.advance(365 * 86400)
        assert await intake.offer(MACHINE, {"x-middle": 22.0}) is Fate.STORED
        clock.advance(-365 * 86400)
        # Otherwise all that follows would be stamped a year ahead, and refused.
        assert await intake.offer(MACHINE, {"x-middle": 23.0}) is Fate.STORED
    times = {one["temperatures_c"]["x-middle"]: one["time"] for one in await readings_of(service)}
    assert times[23.0].startswith("2026-03-01T06:00:00")


async def test_of_two_senders_one_wrong_clock_is_said_once(service, caplog, monkeypatch):
    caplog.set_level(logging.WARNING, "thermap")
    seconds = [1000.0]
    monkeypatch.setattr(module, "monotonic", lambda: seconds[0])
    intake = Intake(lambda: service.state.context, Limits(collect_s=60.0))
    for i in range(20):
        for years in (0, 30):
            sent = START - timedelta(days=365 * years, milliseconds=i)
            intake.offer(MACHINE, {"x-middle": 22.0}, sent)
    assert intake.counts.wrong_clocks == 20
    assert caplog.text.count("behind the service's clock") == 1
    assert "right again" not in caplog.text
    seconds[0] += 61
    intake.offer(MACHINE, {"x-middle": 22.0}, START)
    assert caplog.text.count("right again") == 1
    intake._drop_all()


async def test_who_comes_when_it_is_over_is_told_so(service):
    async with running_intake(service) as intake:
        assert await intake.offer(MACHINE, {"x-middle": 21.0}) is Fate.STORED
    assert await asyncio.wait_for(intake.offer(MACHINE, {"x-middle": 22.0}), 60) is Fate.DROPPED
