"""Numbers of the log's entries grow in the order of the commits: who follows them misses none."""

from concurrent.futures import ThreadPoolExecutor
from datetime import timedelta
from threading import Event

import pytest

from app.events.event import EventKind
from app.services.events import ALARM_DUTY
from app.services.keep_readings import KEEPER_DUTY
from app.storage.database import Database
from app.storage.events import (
    ALARMS_KEPT,
    begin_passing,
    count_entries,
    delete_old_alarms,
    end_passing,
    read_tail,
    write_event,
)
from app.storage.log_numbers import NUMBERING
from app.storage.migrate import UPGRADE_LOCK
from tests.service_examples import START

WRITERS, ENTRIES = 6, 25


@pytest.fixture
def database(database_url):
    database = Database(database_url)
    yield database
    database.close()


def write(database, *texts):
    with database.writing() as session:
        for text in texts:
            write_event(session, None, EventKind.MACHINE, text, START)


def tail(database, after=None, most=100):
    with database.reading() as session:
        return read_tail(session, after, most)


def test_no_lock_has_two_meanings():
    assert len({ALARM_DUTY, KEEPER_DUTY, UPGRADE_LOCK, NUMBERING}) == 4


@pytest.mark.slow
def test_who_reads_while_many_write_has_all_each_once_and_in_order(database_url, database):
    ended, found = Event(), []

    def follow():
        last = 0
        while True:
            was_ended = ended.is_set()
            read = tail(database, last, 2 * WRITERS * ENTRIES)
            found.extend(read.entries)
            last = read.newest
            if was_ended and not read.entries:
                return

    def write_some(writer):
        own = Database(database_url)
        for i in range(ENTRIES):
            write(own, f"{writer} {i} a", f"{writer} {i} b")
        own.close()

    with ThreadPoolExecutor(WRITERS + 1) as pool:
        reading = pool.submit(follow)
        for one in [pool.submit(write_some, writer) for writer in range(WRITERS)]:
            one.result()
        ended.set()
        reading.result()
    assert [number for number, _ in found] == list(range(1, 2 * WRITERS * ENTRIES + 1))
    assert len({event.text for _, event in found}) == len(found)


def test_what_is_undone_has_no_number(database):
    write(database, "a")
    with pytest.raises(ZeroDivisionError), database.writing() as session:
        _write_and_fail(session)
    mark = database.log_mark
    write(database, "b")
    assert database.log_mark is not mark
    assert [(n, e.text) for n, e in tail(database).entries] == [(1, "a"), (2, "b")]


def _write_and_fail(session):
    write_event(session, None, EventKind.MACHINE, "undone", START)
    raise ZeroDivisionError


def test_an_alarm_has_a_new_number_each_time_and_the_last_one_is_never_used_again(database):
    def come(minutes=0):
        now = START + timedelta(minutes=minutes)
        with database.writing() as session:
            begin_passing(session, "vmc", EventKind.ALARM, "stale", "stale", now, {})

    def go(minutes):
        with database.writing() as session:
            end_passing(session, "vmc", EventKind.ALARM, (), START + timedelta(minutes=minutes))

    come()
    write(database, "a")
    for step, number in ((lambda: go(1), 3), (lambda: come(2), 4), (lambda: go(3), 5)):
        step()
        assert [n for n, _ in tail(database).entries] == [2, number]
    late = START + ALARMS_KEPT + timedelta(days=1)
    with database.writing() as session:
        delete_old_alarms(session, late)
    assert tail(database).newest == 5
    write(database, "b")
    with database.writing() as session:
        delete_old_alarms(session, late)
    assert [n for n, _ in tail(database).entries] == [2, 6]


def test_the_end_of_a_long_log_and_the_count_of_the_rest(database):
    assert (tail(database).entries, tail(database).newest) == ([], 0)
    write(database, *(str(i) for i in range(10)))
    read = tail(database, after=2, most=5)
    assert ([n for n, _ in read.entries], read.after, read.newest) == ([6, 7, 8, 9, 10], 5, 10)
    assert (tail(database, 10).entries, tail(database, 10).newest) == ([], 10)
    with database.reading() as session:
        assert count_entries(session, 2, 5) == {(None, EventKind.MACHINE, False): 3}
