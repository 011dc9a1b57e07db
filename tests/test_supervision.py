"""Whatever raises in what runs for long: it goes on, and it is said."""

import ast
import asyncio
import logging
import threading
from contextlib import asynccontextmanager, suppress
from pathlib import Path

import pytest

import app
from app import supervision
from app.connections.config import ConnectionsFile
from app.connections.connection import Connection
from app.connections.intake import Fate, Intake, Sender
from app.connections.running import Connections
from app.errors import ThermapError
from app.hal.component import Exchange
from app.services import events, judge_verifications, keep_readings
from app.supervision import keep_running
from tests.service_examples import furnish_database

pytestmark = pytest.mark.anyio


class Unforeseen(Exception):
    """As anything may raise."""


@pytest.fixture(autouse=True)
def hurried(monkeypatch):
    monkeypatch.setattr(supervision, "FIRST_PAUSE_S", 0.01)
    monkeypatch.setattr(supervision, "LONGEST_PAUSE_S", 0.02)


@asynccontextmanager
async def beside(coroutine):
    task = asyncio.create_task(coroutine)
    try:
        yield task
    finally:
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task


async def until(is_so):
    async with asyncio.timeout(60):
        while not is_so():
            await asyncio.sleep(0.01)


@pytest.mark.parametrize(
    ("why", "words"),
    [
        (Unforeseen("a\x1b[2Jb" + "x" * 10_000), "Unforeseen: a\\x1b[2Jbxxx"),
        (RecursionError(), "RecursionError"),
        (ThermapError("contact is lost"), "contact is lost"),
        (OSError("http://me:s3cret@h refused"), "http://me:***@h refused"),
        (ExceptionGroup("", [ExceptionGroup("", [ThermapError("inside")])]), "inside"),
        (None, "it ended"),
    ],
)
async def test_what_ends_is_begun_again_and_said_once(why, words, caplog):
    times = 0

    async def end():
        nonlocal times
        times += 1
        if why is not None:
            raise why

    with caplog.at_level(logging.WARNING, "thermap"):
        async with beside(keep_running("a task", end)):
            await until(lambda: times > 5)
    said = [one for one in caplog.records if one.levelno == logging.WARNING]
    assert [one.getMessage() for one in said] == [said[0].getMessage()]
    assert said[0].getMessage().startswith(f"a task: {words}")
    assert len(said[0].getMessage()) < 1000
    assert "s3cret" not in caplog.text


async def test_what_ends_those_who_wait_is_let_through_also_out_of_a_group():
    async def end():
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(asyncio.sleep(60))
            raise ThermapError("contact is lost")

    with pytest.raises(ExceptionGroup):
        await keep_running("a task", end, lets_through=(ThermapError,))


class Failing:
    """A connection that raises what nobody foresaw each second time."""

    def __init__(self):
        self.times, self.words = 0, ""

    async def run(self):
        self.times += 1
        if self.times % 2:
            raise Unforeseen("out of the blue")

    def lost(self, words):
        self.words = words

    def now(self):
        return Connection("c", "mqtt", (), "mqtt://me:s3cret@h", False, None, 0, self.words, 0)


async def test_a_connection_goes_on_and_says_what_ended_it():
    connections = Connections(ConnectionsFile(), lambda: None, None)
    failing = Failing()
    connections._connections.append((Sender(connections._intake), failing))
    async with connections.running():
        await until(lambda: failing.words.startswith("Unforeseen") and failing.times > 4)
        (now,) = connections.now().connections
    assert (now.connected, now.endpoint) == (False, "mqtt://me:***@h")
    assert now.trouble == "Unforeseen: out of the blue"


async def test_the_intake_goes_on(monkeypatch):
    connections = Connections(ConnectionsFile(), lambda: None, None)
    connections._connections.append((Sender(connections._intake), Failing()))
    intake, wrong = connections._intake, [Unforeseen()]

    async def store(self):
        if wrong:
            raise wrong.pop()
        for one in list(self._kept):
            self._settle(one, Fate.STORED)

    monkeypatch.setattr(Intake, "_store_next", store)
    monkeypatch.setattr(intake, "_own_time", lambda _machine, now: now)
    intake._context = lambda: type("Context", (), {"now": staticmethod(lambda: None)})
    async with connections.running():
        fate = intake.offer("vmc", {"x": 20.0})
        assert await asyncio.wait_for(fate, 60) is Fate.STORED


def exchange_with(service):
    nodes = {"x": (0.0, 1.0)}
    return Exchange(service, nodes, 0.001, 10.0)


@pytest.mark.parametrize(
    "why", [RecursionError("too deep"), Unforeseen("x"), OverflowError(), AttributeError("y")]
)
def test_the_component_of_hal_goes_on(why, capsys):
    asked, done = [], threading.Event()

    class Service:
        def table(self):
            asked.append(1)
            if len(asked) == 1:
                raise why
            done.set()

        def forget(self):
            pass

    exchange = exchange_with(Service())
    exchange.tell({}, {})
    exchange.start()
    assert done.wait(60)
    assert "not connected, the last compensation is held" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("make", "looks", "module"),
    [
        (lambda context: events.AlarmLog(context), "look_if_ours", events),
        (lambda context: keep_readings.ReadingKeeper(context, 31, None, 60.0), "look", None),
    ],
)
def test_what_looks_in_a_thread_goes_on(make, looks, module, monkeypatch, new_app, databases):
    service = new_app(databases.prepared("sqlite", furnish_database))
    one, asked, done = make(service.state.context), [], threading.Event()

    def look(*_asked):
        asked.append(1)
        if len(asked) == 1:
            raise Unforeseen
        done.set()

    monkeypatch.setattr(type(one), looks, look)
    monkeypatch.setattr(module or keep_readings, "LOOK_EVERY_S", 0.01)
    one.start()
    assert done.wait(60)
    one.stop()


def test_the_late_judge_goes_on(monkeypatch, new_app, databases):
    service = new_app(databases.prepared("sqlite", furnish_database))
    asked, done = [], threading.Event()

    def judge(_context):
        asked.append(1)
        if len(asked) == 1:
            raise Unforeseen
        done.set()

    monkeypatch.setattr(judge_verifications, "judge_awaiting", judge)
    monkeypatch.setattr(judge_verifications, "LOOK_EVERY_S", 0.01)
    one = judge_verifications.LateJudge(service.state.context)
    one.start()
    assert done.wait(60)
    one.stop()


BEGIN_A_TASK = ("create_task", "ensure_future")

SUPERVISED = {"keep_running", "_while_contact"}

OF_THEIR_OWN = {
    "api/streams.py": "begun again by the next who follows; a look that raises is said",
    "api/turns.py": "one question, whose askers get what it raises",
    "services/handed_analyses.py": "its thread begins it all anew",
    "connections/mtconnect_connection.py": "in a group, which `run` is",
    "connections/mqtt_connection.py": "in a group, which `run` is",
    "connections/mqtt_publisher.py": "in a group, which `run` is",
}
"""Tasks that nobody begins again, and why not."""


def test_every_task_is_one_that_begins_again():
    """A new task either is kept running, or says here who notices its end."""
    package = Path(app.__file__).parent
    bare = {
        str(path.relative_to(package))
        for path in package.rglob("*.py")
        if any(name in (text := path.read_text(encoding="utf-8")) for name in BEGIN_A_TASK)
        for call in ast.walk(ast.parse(text))
        if isinstance(call, ast.Call)
        and getattr(call.func, "attr", "") in BEGIN_A_TASK
        and not (
            isinstance(call.args[0], ast.Call)
            and getattr(call.args[0].func, "id", getattr(call.args[0].func, "attr", ""))
            in SUPERVISED
        )
    }
    assert bare == OF_THEIR_OWN.keys()
