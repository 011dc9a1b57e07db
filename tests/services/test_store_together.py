"""Readings that several want to have stored at the same time."""

import math
import threading
from contextlib import contextmanager
from dataclasses import replace
from datetime import timedelta

import psycopg
import pytest
from pydantic import TypeAdapter
from sqlalchemy import make_url

from app.errors import InvalidContent, StorageBusy, StorageUnavailable
from app.live.unseen_numbers import UnseenNumbers
from app.services.context import Context
from app.services.machines import create_machine
from app.services.readings import ReadingBatch, _Together, store_readings
from app.services.together import MOST_TOGETHER, Together, Wanted
from app.storage import postgresql
from app.storage.database import Database
from app.storage.limits import Limits
from app.storage.machines import find_machine, stored_machine, update_machine
from app.storage.readings import list_readings
from app.thermal.machine import Machine
from app.thermal.reading import Reading
from tests.service_examples import MACHINE, START

MACHINE_ID = MACHINE["id"]
BEGINNING = START - timedelta(hours=1)
PATIENCE_S = 60.0


def readings(first_s, count=3, spindle_c=20.0):
    times = [BEGINNING + timedelta(seconds=first_s + i) for i in range(count)]
    return [Reading(time, {"spindle": spindle_c}, {"rpm": 8000.0}) for time in times]


def stored(context):
    with context.database.reading() as session:
        return list(list_readings(session, MACHINE_ID))


def together(context, *batches):
    """Store batches in one transaction; say of each whether it was."""
    group = _Together(context)
    group.store(batches)
    group.follow(batches)
    return [batch.outcome is not None for batch in batches]


def test_what_is_plainly_new_is_stored_and_the_rest_left(app):
    context = app.state.context
    store_readings(context, MACHINE_ID, readings(0))
    new, other = readings(100), readings(200)
    unknown_sensor = [Reading(BEGINNING + timedelta(seconds=300), {"nose": 20.0}, {})]
    done = together(
        context,
        ReadingBatch(MACHINE_ID, new),
        ReadingBatch("nobody", readings(400)),
        ReadingBatch(MACHINE_ID, unknown_sensor),
        ReadingBatch(MACHINE_ID, readings(0)),
        ReadingBatch(MACHINE_ID, readings(101)),
        ReadingBatch(MACHINE_ID, readings(100, spindle_c=21.0)),
        ReadingBatch(MACHINE_ID, other),
    )
    assert done == [True, False, False, False, False, False, True]
    assert stored(context) == [*readings(0), *new, *other]
    held = context.live.get(MACHINE_ID).readings.held.used
    assert held[-1] == other[-1]


def test_of_one_that_is_known_in_part_nothing_is_left(app):
    context = app.state.context
    store_readings(context, MACHINE_ID, readings(0))
    partly = ReadingBatch(MACHINE_ID, readings(1, spindle_c=21.0))
    assert together(context, ReadingBatch(MACHINE_ID, readings(100)), partly) == [False, False]
    assert stored(context) == readings(0)


def test_a_machine_that_memory_has_not_followed_yet_is_judged_as_it_is(app):
    context = app.state.context
    store_readings(context, MACHINE_ID, readings(0))
    with context.database.writing() as session:
        row = find_machine(session, MACHINE_ID)
        machine = stored_machine(row).machine
        sensors = {"nose": replace(machine.sensor("spindle"), name="nose")}
        update_machine(row, replace(machine, sensors=sensors))
    assert together(context, ReadingBatch(MACHINE_ID, readings(100))) == [False]
    with pytest.raises(InvalidContent, match="no sensor 'spindle'"):
        store_readings(context, MACHINE_ID, readings(100))
    by_nose = [replace(reading, temperatures_c={"nose": 20.0}) for reading in readings(100)]
    assert store_readings(context, MACHINE_ID, by_nose).stored == 3
    assert stored(context) == [*readings(0), *by_nose]


@contextmanager
def two_machines(url, limits):
    """Make two machines, both in memory."""
    context = Context(Database(url, limits))
    machine = TypeAdapter(Machine).validate_python(MACHINE)
    for name in "ab":
        create_machine(context, replace(machine, id=name, name=name))
        store_readings(context, name, readings(0))
    try:
        yield context
    finally:
        context.database.close()


def another(url):
    plain = make_url(url).set(drivername="postgresql", query={})
    return psycopg.connect(plain.render_as_string(hide_password=False))


@pytest.mark.slow
def test_who_met_somebody_else_lets_nobody_wait_as_long_as_he_may_himself(postgresql_url):
    outcomes = []
    with two_machines(postgresql_url, Limits(lock_s=3600.0, statement_s=3600.0)) as context:
        met, free = ReadingBatch("a", readings(100)), ReadingBatch("b", readings(100))
        with another(postgresql_url) as other:
            other.execute(
                "INSERT INTO reading (machine_id, time, temperatures_c, state) "
                "VALUES ('a', %s, '{}', '{}')",
                [met.readings[0].time],
            )
            thread = threading.Thread(
                target=lambda: outcomes.extend(together(context, met, free)), daemon=True
            )
            thread.start()
            thread.join(PATIENCE_S)
            assert outcomes == [False, False]
            assert store_readings(context, "b", free.readings).stored == 3
            other.rollback()
        assert store_readings(context, "a", met.readings).stored == 3


@pytest.mark.parametrize("kept_for_s", [-1.0, math.inf], ids=["asked first", "used just now"])
def test_a_connection_that_is_kept_may_be_lost(postgresql_url, monkeypatch, kept_for_s):
    with two_machines(postgresql_url, Limits()) as context:
        monkeypatch.setattr(postgresql, "KEPT_FOR_S", kept_for_s)
        assert together(context, ReadingBatch("a", readings(100))) == [True]
        with another(postgresql_url) as other:
            other.execute(
                "SELECT pg_terminate_backend(pid, 10000) FROM pg_stat_activity "
                "WHERE datname = current_database() AND application_name = 'thermap'"
            )
        if kept_for_s > 0.0:
            with pytest.raises(StorageUnavailable):
                together(context, ReadingBatch("a", readings(200)))
        assert together(context, ReadingBatch("a", readings(200))) == [True]


def test_what_must_be_new_and_is_there_all_the_same_goes_alone(postgresql_url):
    with two_machines(postgresql_url, Limits()) as context:
        there, free = readings(100), readings(100)
        with another(postgresql_url) as other:
            other.execute(
                "INSERT INTO reading (machine_id, time, temperatures_c, state) "
                "VALUES ('a', %s, %s, %s)",
                [there[1].time, '{"spindle": 20.0}', '{"rpm": 8000.0}'],
            )
        assert context.live.get("a").has_none_from(there[0].time)
        done = together(context, ReadingBatch("a", there), ReadingBatch("b", free))
        assert done == [False, False]
        outcome = store_readings(context, "a", there)
        assert (outcome.stored, outcome.duplicates) == (2, 1)
        assert store_readings(context, "b", free).stored == 3
        assert not context.live.get("b").has_none_from(free[-1].time)
        assert context.live.get("b").has_none_from(free[-1].time + timedelta(microseconds=1))


def test_all_that_is_wanted_at_once_is_stored_once_and_in_memory(app):
    context = app.state.context
    wanted = [readings(10 * (i % 20)) for i in range(24)]
    outcomes = []
    threads = [
        threading.Thread(target=lambda w=w: outcomes.append(store_readings(context, MACHINE_ID, w)))
        for w in wanted
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(PATIENCE_S)
    assert sum(o.stored for o in outcomes) == 60
    assert sum(o.duplicates for o in outcomes) == 12
    expected = [r for i in range(20) for r in readings(10 * i)]
    assert stored(context) == expected
    assert context.live.get(MACHINE_ID).readings.latest == expected[-1]


def test_its_own_readings_are_not_read_again(app):
    context = app.state.context
    store_readings(context, MACHINE_ID, readings(0))
    numbers = context.live.stored_here.take()
    assert len(numbers) == 3
    unseen = UnseenNumbers(min(numbers) - 1)
    unseen.mark_known(numbers, START)
    assert (unseen.highest, unseen.gaps) == (max(numbers), [])
    assert context.live.stored_here.take() == []


class Slow:
    """Work that waits until it is let go, and remembers what was done together."""

    def __init__(self, error=None):
        self.began, self.goes_on = threading.Event(), threading.Event()
        self.groups, self.error = [], error

    def __call__(self, group):
        self.groups.append(list(group))
        self.began.set()
        assert self.goes_on.wait(PATIENCE_S)
        if self.error is not None:
            raise self.error


def run_many(work, count):
    """Have one thing done, and meanwhile as many more; give what each came to."""
    gathered, results = Together(), {}

    def run(i):
        try:
            gathered.run(i, work, lambda _: None)
            results[i] = "done"
        except (StorageUnavailable, ZeroDivisionError) as error:
            results[i] = type(error)

    threads = [threading.Thread(target=run, args=(i,)) for i in range(count + 1)]
    threads[0].start()
    assert work.began.wait(PATIENCE_S)
    for thread in threads[1:]:
        thread.start()
    while len(gathered._waiting) < count:
        threading.Event().wait(0.005)
    work.goes_on.set()
    for thread in threads:
        thread.join(PATIENCE_S)
        assert not thread.is_alive()
    return results


def test_what_comes_meanwhile_is_done_together():
    work = Slow()
    assert set(run_many(work, MOST_TOGETHER + 7).values()) == {"done"}
    assert [len(group) for group in work.groups] == [1, MOST_TOGETHER, 7]


def begin_many(work, count):
    """Have one thing done, and meanwhile as many more, without waiting; give how each ended."""
    gathered, ends = Together(), []
    done = threading.Semaphore(0)
    for i in range(count + 1):
        wanted = Wanted(i, done.release)
        ends.append(wanted)
        gathered.begin(wanted, work, lambda _: None)
        assert work.began.wait(PATIENCE_S)
    assert gathered.has_room == (count < MOST_TOGETHER)
    work.goes_on.set()
    for _ in ends:
        assert done.acquire(timeout=PATIENCE_S)
    assert not done.acquire(blocking=False), "one has ended twice"
    assert gathered.has_room
    return ends


def test_who_does_not_wait_is_told_of_the_end():
    work = Slow()
    for one in begin_many(work, MOST_TOGETHER + 7):
        one.expect_database()
    assert [len(group) for group in work.groups] == [1, MOST_TOGETHER, 7]


def test_who_does_not_wait_is_told_that_the_database_is_away():
    work = Slow(StorageUnavailable("away"))
    for one in begin_many(work, 5):
        with pytest.raises(StorageUnavailable, match="away"):
            one.expect_database()
    assert len(work.groups) == 1


@pytest.mark.parametrize("many", [run_many, begin_many])
def test_what_goes_wrong_unexpectedly_leaves_nobody_waiting(many, caplog):
    work = Slow(ZeroDivisionError("nobody expects it"))
    many(work, 3)
    assert sum(len(group) for group in work.groups) == 4
    if many is begin_many:
        assert "nobody expects it" in caplog.text


@pytest.mark.parametrize(
    ("error", "asked"), [(StorageUnavailable("away"), 1), (StorageBusy("busy"), 2)]
)
def test_where_the_database_is_away_nobody_waits_for_it_again(error, asked):
    work = Slow(error)
    assert set(run_many(work, 5).values()) == {type(error)}
    assert len(work.groups) == asked
