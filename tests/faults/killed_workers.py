"""Workers that are killed while they analyse: every analysis comes to an end, and one at a time.

A service on PostgreSQL is asked for analyses without pause, of several machines, and leaves them to
workers that are killed with -9 at random times and started again. What became of each analysis is
held against what it was without a kill. PostgreSQL notes every change of an analysis' status in a
table of our own, so that nothing is missed between two looks.
"""

from __future__ import annotations

import random
import signal
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from uuid import uuid4

import httpx
import psycopg
from sqlalchemy import make_url

from tests.faults.reversing import EFFECTS, ReversingMachine, found_reversal
from tests.faults.service import Service, Worker, words_of
from tests.faults.soak.run import errors_in
from tests.faults.writers import Lost, client_of

WORKERS = 2
MOST_TAKES = 3
"""What was begun so often, and lost its process each time, fails (docs/fleet.md)."""

TAKEN_UP_AFTER_S = 15.0
"""Nobody takes up sooner what a killed worker ran (docs/fleet.md): until then it is to be gone."""

NOTHING_ENDS_S = 240.0
"""Where nothing comes to an end for so long, something hangs: three takes need less."""

EXACT_UM = 0.5
"""36 observations of 0.3 µm say the reversal value far better."""

LOST = f"begun {MOST_TAKES} times, and each time the process that ran it was gone"

NOTES = """
CREATE TABLE public.turn (
    place bigserial PRIMARY KEY, analysis integer, machine text, status text);
CREATE FUNCTION public.note_turn() RETURNS trigger LANGUAGE plpgsql AS $$ BEGIN
    INSERT INTO public.turn (analysis, machine, status) VALUES (NEW.id, NEW.machine_id, NEW.status);
    RETURN NULL;
END $$;
CREATE TRIGGER note_turn AFTER INSERT OR UPDATE OF status ON public.analysis
    FOR EACH ROW EXECUTE FUNCTION public.note_turn();
"""


@dataclass(frozen=True)
class Turn:
    """One change of an analysis' status, as PostgreSQL noted it."""

    analysis: int
    machine: str
    status: str


@dataclass(frozen=True)
class Killed:
    """What came of it.

    `takes` counts how often an analysis was begun; `in_the_middle` of them lost their worker.
    """

    times: int
    asked: int
    done: int
    failed: int
    takes: int
    in_the_middle: int


def kill_workers(
    database_url: str,
    folder: Path,
    times: int,
    *,
    machine_count: int = 5,
    asked_ahead: int = 3,
    seed: int = 1,
    say: Callable[[str], None] = lambda words: None,
) -> Killed:
    """Kill workers so often in all while analyses are asked for, and look at each analysis.

    Parameters
    ----------
    database_url
        An empty database on PostgreSQL.
    folder
        Where workers' logs are written.
    asked_ahead
        So many analyses of each machine wait or run at any time.
    say
        Told how far it is.

    Raises
    ------
    Lost
        If an analysis was lost, hangs, ran twice at once, was given another result than it has
        without kills, or failed without having been begun three times.
    """
    chance = random.Random(seed)
    log = folder / "workers.log"
    service = Service(database_url, THERMAP_ANALYSES="false")
    try:
        with (
            psycopg.connect(_plain(database_url), autocommit=True) as connection,
            client_of(service.url) as client,
        ):
            connection.execute(NOTES)
            machines = [
                _furnish(client, ReversingMachine(f"reverses-{i}", chance))
                for i in range(machine_count)
            ]
            expected, longest_s = _in_calm(client, database_url, log, machines)
            say(f"undisturbed, three analyses are done {longest_s:.1f} s after workers are begun")
            kills = _Kills(database_url, log, times, longest_s, say)
            asked = _ask_while(kills, client, machines, asked_ahead, seed)
            with _workers(database_url, log):
                _wait_for_all(client, machines)
                _expect_empty_queue(connection)
            answers = {number: _answer(client, of, number) for number, of in asked.items()}
            turns = _turns(connection)
    finally:
        service.end()
    noted = [turn for turn in turns if turn.analysis in answers]
    mistakes = mistakes_in(noted, answers, expected) + errors_in(log)
    if mistakes:
        raise Lost("; ".join(mistakes[:5]))
    ended = Counter(answer["status"] for answer in answers.values())
    takes = sum(turn.status == "running" for turn in noted)
    return Killed(
        kills.times, len(asked), ended["done"], ended["failed"], takes, takes - ended["done"]
    )


def mistakes_in(
    turns: Sequence[Turn],
    answers: Mapping[int, Mapping[str, Any]],
    expected: Mapping[str, Any],
) -> list[str]:
    """Say what must not be; an empty list where all is as it should.

    Parameters
    ----------
    turns
        Changes of status of the analyses in `answers`, in their order.
    answers
        What the service says of every analysis that it accepted, by number.
    expected
        The result that each machine's analysis has without kills.
    """
    found = []
    runs: dict[str, int] = {}
    takes: Counter[int] = Counter()
    ends: Counter[int] = Counter()
    for turn in turns:
        if runs.get(turn.machine) == turn.analysis:
            del runs[turn.machine]
        if turn.status == "running":
            if turn.machine in runs:
                found.append(f"{turn.analysis} began while {runs[turn.machine]} ran: one machine")
            if ends[turn.analysis]:
                found.append(f"{turn.analysis} began again after its end")
            runs[turn.machine] = turn.analysis
            takes[turn.analysis] += 1
        elif turn.status != "queued":
            ends[turn.analysis] += 1
    for number, answer in answers.items():
        status = answer["status"]
        if status not in ("done", "failed"):
            found.append(f"{number} of {answer['machine']} is {status}: {answer['message']}")
        elif ends[number] != 1:
            found.append(f"{number} came to an end {ends[number]} times")
        elif takes[number] > MOST_TAKES:
            found.append(f"{number} was begun {takes[number]} times")
        elif status == "failed" and (takes[number] != MOST_TAKES or LOST not in answer["message"]):
            found.append(f"{number}, begun {takes[number]} times, failed: {answer['message']}")
        elif status == "done" and answer["result"] != expected[answer["machine"]]:
            found.append(f"{number} has another result than without kills")
    return found


@dataclass(frozen=True)
class _Furnished:
    """A machine in the service, and the verification that is to be analysed."""

    machine: ReversingMachine
    verification: int

    @property
    def path(self) -> str:
        return f"{self.machine.room}/analyses"


def _furnish(client: httpx.Client, machine: ReversingMachine) -> _Furnished:
    room = machine.room
    _post(client, "/v1/machines", machine.body)
    for one in machine.maps():
        _post(client, f"{room}/error-maps", one)
    _post(client, f"{room}/readings", machine.readings())
    return _Furnished(machine, _post(client, f"{room}/verifications", machine.verification())["id"])


def _post(client: httpx.Client, path: str, body: object) -> Any:
    answer = client.post(path, json=body)
    if answer.status_code not in (201, 202):
        raise Lost(f"POST {path}: expected 201 or 202, got {answer.text[:300]}")
    return answer.json()


def _ask(client: httpx.Client, of: _Furnished) -> int:
    body = {"verifications": [of.verification], "effects": EFFECTS}
    number: int = _post(client, of.path, body)["id"]
    return number


def _answer(client: httpx.Client, of: _Furnished, number: int) -> dict[str, Any]:
    answer = client.get(f"{of.path}/{number}")
    if answer.status_code != 200:
        raise Lost(f"analysis {number} was accepted, and is not there: {answer.text[:300]}")
    return {**answer.json(), "machine": of.machine.body["id"]}


def _unfinished(client: httpx.Client, of: _Furnished) -> list[dict[str, Any]]:
    listed = client.get(of.path).raise_for_status().json()
    return [one for one in listed if one["status"] in ("queued", "running")]


def _in_calm(
    client: httpx.Client, database_url: str, log: Path, machines: Sequence[_Furnished]
) -> tuple[dict[str, Any], float]:
    """Analyse every machine once without a kill.

    Returns
    -------
    dict
        Each machine's result, which has the reversal that it has.
    float
        How long workers took to begin and to finish three analyses [s].
    """
    began = time.monotonic()
    asked = [(of, _ask(client, of)) for of in machines]
    with _workers(database_url, log):
        done_after_s: list[float] = []
        while len(done_after_s) < len(asked):
            left = sum(len(_unfinished(client, of)) for of in machines)
            now_s = time.monotonic() - began
            done_after_s += [now_s] * (len(asked) - left - len(done_after_s))
            if now_s > NOTHING_ENDS_S:
                raise Lost("undisturbed workers do not end what they are asked for")
            time.sleep(0.05)
    expected = {}
    for of, number in asked:
        answer = _answer(client, of, number)
        found_um = found_reversal(answer["result"]) if answer["status"] == "done" else None
        if found_um is None or abs(found_um - of.machine.reversal_um) > EXACT_UM:
            raise Lost(f"expected a reversal of {of.machine.reversal_um:.2f} µm, got {answer}")
        expected[of.machine.body["id"]] = answer["result"]
    return expected, done_after_s[min(2, len(asked) - 1)]


class _Kills:
    """Lanes in each of which one worker after the other lives for a random time, at most so long.

    With `longest_s` [s] some are killed while they begin, and some with their third analysis.
    """

    def __init__(
        self,
        database_url: str,
        log: Path,
        times: int,
        longest_s: float,
        say: Callable[[str], None],
    ) -> None:
        self._url, self._log, self._times, self._longest_s = database_url, log, times, longest_s
        self._say = say
        self._count = 0
        self._lock = threading.Lock()
        self.are_over = threading.Event()

    def run(self, seed: int) -> None:
        """Be one lane, until all lanes together have killed often enough."""
        chance = random.Random(seed)
        try:
            while not self.are_over.is_set():
                worker = Worker(self._url, log=self._log)
                try:
                    self.are_over.wait(chance.uniform(0.0, self._longest_s))
                    worker.expect_alive()
                finally:
                    analyses = worker.analyses()
                    worker.end(signal.SIGKILL)
                self._note()
                _expect_gone(analyses)
        finally:
            self.are_over.set()  # a lane that failed ends the others

    def _note(self) -> None:
        with self._lock:
            self._count += 1
            if self._count <= self._times and self._count % 10 == 0:
                self._say(f"killed {self._count} times")
            if self._count >= self._times:
                self.are_over.set()

    @property
    def times(self) -> int:
        return self._count


def _expect_gone(analyses: Iterable[int]) -> None:
    """Expect what a killed worker began to end long before somebody takes it up."""
    deadline = time.monotonic() + TAKEN_UP_AFTER_S
    while left := [pid for pid in analyses if "spawn_main" in words_of(pid)]:
        if time.monotonic() > deadline:
            raise Lost(f"analyses of a killed worker go on: {left}")
        time.sleep(0.05)


def _ask_while(
    kills: _Kills,
    client: httpx.Client,
    machines: Sequence[_Furnished],
    asked_ahead: int,
    seed: int,
) -> dict[int, _Furnished]:
    """Ask for analyses of all machines until the kills are over; whose each number is."""
    asked: dict[int, _Furnished] = {}
    with ThreadPoolExecutor(WORKERS) as pool:
        lanes = [pool.submit(kills.run, seed + i) for i in range(WORKERS)]
        try:
            while not kills.are_over.is_set():
                for of in machines:
                    for _ in range(asked_ahead - len(_unfinished(client, of))):
                        asked[_ask(client, of)] = of
                kills.are_over.wait(0.5)
        finally:
            kills.are_over.set()
        for lane in lanes:
            lane.result()
    return asked


@contextmanager
def _workers(database_url: str, log: Path) -> Iterator[None]:
    """Let workers run that are told to end, and do, with 0."""
    running = [Worker(database_url, log=log) for _ in range(WORKERS)]
    codes: list[int] = []
    try:
        yield
        for one in running:
            one.expect_alive()
        codes += [one.end(signal.SIGTERM) for one in running]
    finally:
        for one in running:
            one.end(signal.SIGKILL)
    if any(codes):
        raise Lost(f"expected exit code 0 of workers after SIGTERM, got {codes}")


def _wait_for_all(client: httpx.Client, machines: Sequence[_Furnished]) -> None:
    """Wait until nothing waits or runs; Lost where nothing comes to an end for long."""
    before, since = -1, time.monotonic()
    while left := [one for of in machines for one in _unfinished(client, of)]:
        if len(left) != before:
            before, since = len(left), time.monotonic()
        if time.monotonic() - since > NOTHING_ENDS_S:
            raise Lost(f"analyses that hang: {left[:3]}")
        time.sleep(0.5)


def _expect_empty_queue(connection: psycopg.Connection[Any]) -> None:
    """Expect nothing to be left of what was handed out."""
    deadline = time.monotonic() + NOTHING_ENDS_S
    jobs = "SELECT status::text, count(*) FROM thermap_jobs.procrastinate_jobs GROUP BY status"
    while left := connection.execute(jobs).fetchall():
        if time.monotonic() > deadline:
            raise Lost(f"nothing waits or runs, but the queue has {left}")
        time.sleep(0.5)


def _turns(connection: psycopg.Connection[Any]) -> list[Turn]:
    noted = connection.execute("SELECT analysis, machine, status FROM public.turn ORDER BY place")
    return [Turn(*row) for row in noted]


def _plain(url: str) -> str:
    """Give a URL as psycopg takes it."""
    plain = make_url(url).set(drivername="postgresql", query={})
    return plain.render_as_string(hide_password=False)


@contextmanager
def scratch_database(server: str) -> Iterator[str]:
    """Make a database on a PostgreSQL server, give its URL, and drop it after."""
    name = f"thermap_faults_{uuid4().hex[:12]}"
    with psycopg.connect(_plain(server), autocommit=True) as connection:
        connection.execute(f'CREATE DATABASE "{name}"')
        try:
            yield make_url(server).set(database=name).render_as_string(hide_password=False)
        finally:
            connection.execute(f'DROP DATABASE "{name}" WITH (FORCE)')
