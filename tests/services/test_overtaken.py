"""Transactions that meet: no two wait for each other, and the one that gives way begins anew."""

import ast
import asyncio
import inspect
import sqlite3
import threading
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path

import psycopg
import pytest
from pydantic import TypeAdapter
from sqlalchemy import make_url, select

from app import services
from app.errors import StorageOvertaken, StorageUnavailable
from app.services.change_model import changing_machine
from app.services.context import TIMES, Context, repeated
from app.services.machines import create_machine
from app.storage.database import Database
from app.storage.limits import Limits
from app.storage.machines import RowLock, find_machine
from app.storage.tables import MachineRow
from app.thermal.machine import Machine
from tests.service_examples import (
    MACHINE,
    ROOM,
    START,
    client_of,
    error_map,
    problem,
    reading,
)

pytestmark = pytest.mark.anyio

SOON_S = 60.0
"""A machine may be slow, but nothing hangs."""

READINGS = f"{ROOM}/readings"

MACHINES = select(MachineRow.id)

VERIFICATION = {
    "label": "night shift",
    "datum": "absolute",
    "repeatability_um": 0.5,
    "observations": [
        {
            "time": START.isoformat(),
            "component": "EXX",
            "position_mm": 100.0 * i,
            "measured_um": 0.1 * i,
        }
        for i in range(5)
    ],
}

WRITERS = {
    "machine": ("POST", "/v1/machines", MACHINE | {"id": "other"}, 201),
    "settings": ("PATCH", ROOM, {"name": "renamed"}, 200),
    "map": ("POST", f"{ROOM}/error-maps", error_map("Run #9", 40.0), 201),
    "map's deletion": ("DELETE", f"{ROOM}/error-maps/1", None, 204),
    "assignment": ("PUT", f"{ROOM}/sensor-assignment", {"EXX": "spindle"}, 200),
    "activation": ("POST", f"{ROOM}/models/1/activate", None, 200),
    "readings": ("POST", READINGS, reading(START, 25.0), 201),
    "verification": ("POST", f"{ROOM}/verifications", VERIFICATION, 201),
    "machine's deletion": ("DELETE", ROOM, None, 204),
}
"""A request, its body, and the answer where it is not overtaken."""

ONCE = {f"{ROOM}/error-maps": 4, READINGS: 1, f"{ROOM}/verifications": 1}
"""How many there are once one was added."""


@contextmanager
def another(url):
    """Somebody else at the same database."""
    plain = make_url(url).set(drivername="postgresql", query={})
    with psycopg.connect(plain.render_as_string(hide_password=False)) as connection:
        yield connection


@pytest.fixture
def overtake(postgresql_example):
    """Let PostgreSQL undo the next transactions that write to any table."""
    with another(postgresql_example) as other:
        tables = other.execute(
            "SELECT tablename FROM pg_tables WHERE schemaname = 'public' "
            "AND tablename <> 'alembic_version'"
        ).fetchall()

        def so_often(count, sqlstate):
            # What a sequence has counted stays counted when a transaction is undone.
            other.execute("CREATE SEQUENCE public.overtaken")
            other.execute(
                "CREATE FUNCTION public.overtake() RETURNS trigger LANGUAGE plpgsql AS $$ BEGIN "
                f"IF nextval('public.overtaken') <= {count} THEN "
                f"RAISE EXCEPTION 'overtaken' USING ERRCODE = '{sqlstate}'; "
                "END IF; RETURN NULL; END $$"
            )
            for (table,) in tables:
                other.execute(
                    f"CREATE TRIGGER overtake AFTER INSERT OR UPDATE OR DELETE ON public.{table} "
                    "FOR EACH STATEMENT EXECUTE FUNCTION public.overtake()"
                )
            other.commit()

        def times_seen():
            with another(postgresql_example) as fresh:
                return fresh.execute("SELECT last_value FROM public.overtaken").fetchone()[0]

        so_often.seen = times_seen
        yield so_often
        other.rollback()
        for (table,) in tables:
            other.execute(f"DROP TRIGGER IF EXISTS overtake ON public.{table}")
        other.execute("DROP FUNCTION IF EXISTS public.overtake()")
        other.execute("DROP SEQUENCE IF EXISTS public.overtaken")
        other.commit()


@pytest.fixture
def without_pauses(monkeypatch):
    monkeypatch.setattr("app.services.context.LONGEST_PAUSE_S", 0.0)


@pytest.mark.slow
@pytest.mark.usefixtures("without_pauses")
@pytest.mark.parametrize("sqlstate", ["40P01", "40001"])
@pytest.mark.parametrize("writer", WRITERS)
async def test_a_writer_that_was_undone_begins_anew(
    new_app, postgresql_example, overtake, writer, sqlstate
):
    method, path, body, status = WRITERS[writer]
    service = new_app(postgresql_example)
    overtake(TIMES - 1, sqlstate)
    async with client_of(service) as client:
        answer = await client.request(method, path, json=body)
        assert answer.status_code == status, answer.text
        assert overtake.seen() >= TIMES
        if path in ONCE:
            listed = (await client.get(path)).json()
            assert len(listed) == ONCE[path], "what was undone is not there as well"


@pytest.mark.usefixtures("without_pauses")
async def test_whoever_is_undone_every_time_is_told(new_app, postgresql_example, overtake):
    service = new_app(postgresql_example)
    overtake(10**6, "40P01")
    async with client_of(service) as client:
        answer = await client.post(READINGS, json=reading(START, 25.0))
        assert problem(answer, 503)["title"] == "The database is busy"
        assert int(answer.headers["retry-after"]) > 0
    assert overtake.seen() == TIMES


@pytest.mark.slow
@pytest.mark.parametrize("again", [True, False], ids=["repeated", "once"])
def test_of_two_that_wait_for_each_other_one_begins_anew(postgresql_url, again):
    """Two machines locked in opposite order: a deadlock for certain, the first time."""
    database = Database(postgresql_url)
    context = Context(database)
    _make_two_machines(context)
    both_hold_one = threading.Barrier(2)
    outcomes = []

    def lock_both(first, second):
        tries = []

        def lock():
            tries.append(first)
            with database.writing() as session:
                find_machine(session, first, RowLock.CHANGED)
                if len(tries) == 1:
                    both_hold_one.wait(SOON_S)
                find_machine(session, second, RowLock.CHANGED).name += f", by {first}"

        try:
            (repeated(lock) if again else lock)()
        except StorageOvertaken as overtaken:
            tries.append(overtaken)
        outcomes.append(tries)

    threads = [threading.Thread(target=lock_both, args=order) for order in (("a", "b"), ("b", "a"))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(SOON_S)
    with database.reading() as session:
        names = [find_machine(session, one).name for one in "ab"]
    database.close()
    counts = sorted(len(tries) for tries in outcomes)
    if again:
        # Whoever begins anew may take its first machine before the other has woken for it: then
        # they wait for each other once more.
        assert max(counts) >= 2
        assert names == ["a, by b", "b, by a"]
    else:
        assert counts == [1, 2]
        ((_, overtaken),) = [tries for tries in outcomes if len(tries) == 2]
        assert "deadlock" in overtaken.detail


def _make_two_machines(context):
    machine = TypeAdapter(Machine).validate_python(MACHINE)
    for name in "ab":
        create_machine(context, replace(machine, id=name, name=name))


async def test_readings_hold_nothing_before_they_hold_their_machine(new_app, postgresql_example):
    """Or who waits for them lets somebody wait who wants the machine, for which they wait."""
    service = new_app(postgresql_example)
    async with client_of(service) as client:
        with another(postgresql_example) as other:
            other.execute("SELECT FROM machine FOR UPDATE")
            storing = asyncio.create_task(client.post(READINGS, json=reading(START, 25.0)))
            held = await _held_by_who_waits(postgresql_example)
            other.rollback()
        assert (await storing).status_code == 201
    assert ("machine", "RowShareLock") in held
    assert not [lock for lock in held if lock[0] == "reading"]


async def _held_by_who_waits(url):
    waits = "SELECT pid FROM pg_stat_activity WHERE wait_event_type = 'Lock' AND datname = %s"
    locks = (
        "SELECT relation::regclass::text, mode FROM pg_locks WHERE granted "
        "AND locktype = 'relation' AND pid = %s"
    )
    async with asyncio.timeout(SOON_S):
        with another(url) as looking:
            while not (found := looking.execute(waits, [make_url(url).database]).fetchall()):
                looking.rollback()
                await asyncio.sleep(0.01)
            ((pid,),) = found
            return looking.execute(locks, [pid]).fetchall()


async def test_readings_need_not_wait_for_a_new_model(new_app, postgresql_example):
    service = new_app(postgresql_example, lock_limit_s=0.3)
    async with client_of(service) as client:
        with changing_machine(service.state.context, "mcfv5050") as change:
            change.row.name = "renamed"
            change.session.flush()
            answer = await client.post(READINGS, json=reading(START, 25.0))
            assert answer.status_code == 201, answer.text
            # Another change has to.
            answer = await client.patch(ROOM, json={"name": "by another"})
            assert "lock timeout" in problem(answer, 503)["detail"]
        assert (await client.get(ROOM)).json()["name"] == "renamed"


def test_a_file_that_lets_nobody_wait_is_asked_again(sqlite_url, monkeypatch):
    """SQLite lets nobody change its journal while another connection writes.

    Connections try for as long as the database may take; these give up long before the writer
    would.
    """
    file = make_url(sqlite_url).database
    database = Database(sqlite_url, Limits(lock_s=0.05))
    with closing(sqlite3.connect(file, isolation_level=None)) as other:
        other.execute("PRAGMA journal_mode = DELETE")
        other.execute("BEGIN IMMEDIATE")
        pauses = []

        def pause(seconds):
            pauses.append(seconds)
            if len(pauses) == 2:
                other.execute("ROLLBACK")

        monkeypatch.setattr("app.services.context.sleep", pause)

        @repeated
        def write():
            with database.writing(Limits(lock_s=SOON_S)) as session:
                return session.scalars(MACHINES).all()

        assert write() == []
    database.close()
    assert len(pauses) == 2


def test_whoever_has_waited_for_a_locked_file_does_not_wait_again(sqlite_url):
    database = Database(sqlite_url, Limits(lock_s=0.1))
    with closing(sqlite3.connect(make_url(sqlite_url).database, isolation_level=None)) as other:
        with database.reading() as session:
            session.scalars(MACHINES).all()
        other.execute("BEGIN IMMEDIATE")
        with (
            pytest.raises(StorageUnavailable, match="locked") as raised,
            database.writing() as session,
        ):
            session.scalars(MACHINES).all()
        other.execute("ROLLBACK")
    database.close()
    assert not isinstance(raised.value, StorageOvertaken)


def test_every_use_case_that_writes_begins_anew():
    writing = {}
    for path in Path(inspect.getfile(services)).parent.glob("*.py"):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            text = ast.unparse(node)
            if isinstance(node, ast.FunctionDef) and (
                ".writing(" in text or "with changing_machine(" in text
            ):
                marks = [ast.unparse(mark) for mark in node.decorator_list]
                writing[node.name] = "repeated" in marks
    assert writing.pop("changing_machine") is False, "its callers are"
    assert len(writing) > 10
    assert all(writing.values()), [name for name, is_repeated in writing.items() if not is_repeated]
