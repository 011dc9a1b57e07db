"""Whether all is well with a database and the machines in it, one sentence for each thing.

It looks and changes nothing: an older database stays as it is, and no service need run on it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from datetime import datetime, timedelta
from enum import StrEnum
from pathlib import Path
from time import sleep
from typing import TYPE_CHECKING, Final, Protocol

from app.access.keys import Role
from app.errors import (
    InvalidContent,
    StorageTooNew,
    StorageUnavailable,
    ThermapError,
    capitalised,
    counted,
)
from app.services.access_keys import show_keys
from app.services.carry_analyses import PATIENCE_S
from app.services.context import CLOCKS_DIFFER, FUTURE_TOLERANCE, Context, utc_now
from app.services.status import show_status
from app.storage.backup import SEAL, SEAL_BYTES, check_backup
from app.storage.condition import Queue, clock_ahead, damage, queue, revision_of, space
from app.storage.database import Database
from app.storage.machines import list_machines
from app.storage.migrate import newest_revision

if TYPE_CHECKING:
    from collections.abc import Sequence

FEW_BYTES: Final = 100_000_000
"""With less free than this writing may end soon [bytes]."""

SOON_BYTES: Final = 1_000_000_000
"""With less free than this somebody should look [bytes]."""

MOST_MACHINES: Final = 1000
"""As many as `/metrics` tells of: each is brought into memory to be judged."""

OLD_BACKUP: Final = timedelta(days=7)

LONG_WAIT: Final = timedelta(hours=1)
"""An analysis takes minutes: one that waits longer waits for something else."""

BEAT_S: Final = 3.0
"""How often running analyses are looked at: after three of their beats [s]."""

GONE_S: Final = PATIENCE_S + 3.0 * BEAT_S
"""Within this a service that runs has taken up again what a process left that is gone, even one
that has only just started [s]."""


class Grade(StrEnum):
    """How something fares."""

    OK = "ok"
    WARNING = "warning"
    TROUBLE = "trouble"


@dataclass(frozen=True, slots=True)
class Finding:
    """What was looked at, how it fares, and that in a sentence."""

    about: str
    grade: Grade
    sentence: str


class Judged(Protocol):
    """As much of a machine's status as the doctor tells, from here or from a service."""

    @property
    def machine(self) -> str:
        """The machine's id."""

    @property
    def verdict(self) -> str:
        """`trusted`, `limited` or `not-trusted`."""

    @property
    def state(self) -> str:
        """The worst of what is the matter."""

    @property
    def sentences(self) -> Sequence[str]:
        """What is the matter, the worst first."""


def ok(about: str, sentence: str) -> Finding:
    """Say that something is well."""
    return Finding(about, Grade.OK, sentence)


def warning(about: str, sentence: str) -> Finding:
    """Say that somebody should look at something."""
    return Finding(about, Grade.WARNING, sentence)


def trouble(about: str, sentence: str) -> Finding:
    """Say that something does not do what it is there for."""
    return Finding(about, Grade.TROUBLE, sentence)


def worst(findings: Iterable[Finding]) -> Grade:
    """Give the worst grade; `ok` where there is nothing."""
    order = list(Grade)
    return max((finding.grade for finding in findings), key=order.index, default=Grade.OK)


def examine_database(database_url: str) -> Iterator[Finding]:
    """Look at a database, whether a service runs on it or not.

    Raises
    ------
    InvalidContent
        If the URL is none of a lasting database.
    """
    try:
        database = Database(database_url, may_be_new=False)
    except StorageUnavailable as error:
        yield trouble("database", f"{capitalised(error.detail)}.")
        return
    try:
        yield from _examine(database)
    except StorageUnavailable as error:
        yield trouble("database", f"{capitalised(error.detail)}.")
    finally:
        database.close()


def _examine(database: Database) -> Iterator[Finding]:
    name = database.name.removeprefix("sqlite:///").replace("+psycopg", "", 1)
    try:
        revision = revision_of(database)
    except StorageTooNew as error:
        yield trouble("database", f"{capitalised(error.detail)}.")
        return
    if revision is None:
        yield trouble(
            "database", f"{name} is reachable, but holds nothing of thermap: is it the right one?"
        )
        return
    problems = damage(database)
    if problems:
        yield trouble(
            "database", f"{name} is damaged, restore a backup: {'; '.join(problems[:3])}."
        )
    else:
        whole = ", and all of it was read without an error" if database.is_sqlite else ""
        yield ok("database", f"{name} is reachable{whole}.")
    yield _space(database)
    yield from _clock(database)
    if revision != newest_revision():
        yield warning(
            "migrations",
            f"The database is of an older thermap (revision {revision}): `thermap serve` upgrades "
            "it when it starts; until then nothing more is looked at.",
        )
        return
    yield ok("migrations", f"The tables are this version's (revision {revision}).")
    yield _keys(database)
    yield from _analyses(database)
    yield from examine_machines(_statuses(database))


def examine_machines(statuses: Iterable[Judged]) -> Iterator[Finding]:
    """Say which machines cannot be trusted, each with its first reason; the others are counted.

    A machine that has no model or no reading yet is being set up, and no trouble.
    """
    trusted = total = 0
    for status in statuses:
        total += 1
        if status.verdict == "trusted":
            trusted += 1
            continue
        reason = next(iter(status.sentences), status.state)
        say = warning
        if status.verdict == "not-trusted" and status.state not in ("no-model", "no-reading"):
            say = trouble
        yield say(f"machine {status.machine}", reason)
    if trusted:
        yield ok("machines", f"{trusted} of {counted(total, 'machine')} can be trusted now.")
    elif not total:
        yield ok("machines", "No machine is stored yet.")


def examine_clock(about: str, whose: str, ahead: timedelta, unsure: timedelta) -> Finding:
    """Judge a clock that is ahead of this computer's, known to within `unsure`."""
    seconds = ahead.total_seconds()
    off = max(abs(ahead) - unsure, timedelta(0))
    direction = "ahead of" if seconds > 0 else "behind"
    words = f"{whose} clock is {abs(seconds):.1f} s {direction} this computer's"
    if off > FUTURE_TOLERANCE:
        return trouble(about, f"{words}: times of readings and maps do not fit each other.")
    if off > CLOCKS_DIFFER:
        return warning(about, f"{words}: readings of sensors here may be taken for old or early.")
    return ok(about, f"{words}.")


def examine_backups(folder: Path) -> Finding:
    """Look for the newest backup in a folder, by what is in the files and not by their names."""
    try:
        files = [file for file in folder.iterdir() if file.is_file() and _has_seal(file)]
    except OSError as error:
        return trouble("backups", f"{folder} cannot be read: {error.strerror}.")
    if not files:
        return trouble("backups", f"There is no backup in {folder}.")
    newest = max(files, key=lambda file: file.stat().st_mtime)
    try:
        check_backup(newest)
    except InvalidContent as error:
        return trouble("backups", f"{capitalised(error.detail)}.")
    age = utc_now() - datetime.fromtimestamp(newest.stat().st_mtime, utc_now().tzinfo)
    words = f"The newest backup, {newest}, is whole and {_span(age)} old"
    if age > OLD_BACKUP:
        return warning("backups", f"{words}: what came since is in no backup.")
    return ok("backups", f"{words}.")


def examine_disk(about: str, free_bytes: int, taken_bytes: int | None = None) -> Finding:
    """Judge what is free on a database's disk, and what it takes, where that is known."""
    words = f"{free_bytes / 1e6:,.0f} MB are free on the disk of the database"
    if taken_bytes is not None:
        words = f"{words}, which takes {taken_bytes / 1e6:,.0f} MB"
    if free_bytes < FEW_BYTES:
        return trouble(about, f"{words}: soon nothing can be stored.")
    if free_bytes < max(SOON_BYTES, taken_bytes or 0):
        return warning(about, f"{words}: too little for an upgrade or a backup beside it.")
    return ok(about, f"{words}.")


def _space(database: Database) -> Finding:
    sizes = space(database)
    if sizes.free_bytes is None:
        taken = f"The database takes {sizes.taken_bytes / 1e6:,.0f} MB"
        return ok("disk", f"{taken}; how much its server's disk has left is not known here.")
    return examine_disk("disk", sizes.free_bytes, sizes.taken_bytes)


def _clock(database: Database) -> Iterator[Finding]:
    ahead = clock_ahead(database, utc_now)
    if ahead is not None:
        yield examine_clock("clock of the database", "The database's", ahead, timedelta(0))


def _keys(database: Database) -> Finding:
    keys = show_keys(database)
    if not keys:
        return ok(
            "keys", "There is no key: a service that other computers reach makes the first itself."
        )
    if not any(key.role is Role.ADMIN for key in keys):
        return trouble(
            "keys",
            f"There are {counted(len(keys), 'key')}, none of an admin: nobody can make machines "
            "where keys are asked for; `thermap keys create NAME --role admin` makes one.",
        )
    used = [key.last_used_at for key in keys if key.last_used_at is not None]
    last = "none was used yet" if not used else f"one was last used {max(used):%Y-%m-%d %H:%M} UTC"
    return ok("keys", f"There are {counted(len(keys), 'key')}; {last}.")


def _analyses(database: Database) -> Iterator[Finding]:
    """Look at the queue: for `GONE_S` where something in it may have been left by everybody.

    After a restart a service leaves what its predecessor ran alone for a while, as it may be
    another's; so nothing is said of it before a service would have taken it up again.
    """
    with database.reading() as session:
        jobs = queue(session)
    stuck, watched_s = dict(jobs.running), 0.0
    while stuck and watched_s < GONE_S:
        sleep(BEAT_S)
        watched_s += BEAT_S
        with database.reading() as session:
            jobs = queue(session)
        stuck = {n: beats for n, beats in stuck.items() if jobs.running.get(n) == beats}
    if stuck:
        them = "them" if len(stuck) > 1 else "it"
        yield trouble(
            "analyses",
            f"{_named(sorted(stuck))} running, but nobody works on {them}: in {GONE_S:.0f} s there "
            f"was no sign of life, and no service took {them} up again; one that starts does.",
        )
        return
    if _waits_long(jobs) and not jobs.running:
        sleep(BEAT_S)  # what is taken up again was asked for long ago, and waits for a moment
        with database.reading() as session:
            jobs = queue(session)
    yield _waiting(jobs)


def _waiting(jobs: Queue) -> Finding:
    words = f"{counted(jobs.waiting, 'analysis', 'analyses')} waiting"
    if jobs.running or not _waits_long(jobs):
        words = f"{counted(len(jobs.running), 'analysis', 'analyses')} running, {words}"
    if _waits_long(jobs) and jobs.oldest_at is not None:
        words = f"{words}, the oldest for {_span(utc_now() - jobs.oldest_at)}"
        # While one runs somebody does work: then it is only the queue that is long.
        end = "." if jobs.running else ": does a service run?"
        return warning("analyses", f"{words}{end}")
    return ok("analyses", f"{words}.")


def _waits_long(jobs: Queue) -> bool:
    return jobs.oldest_at is not None and utc_now() - jobs.oldest_at > LONG_WAIT


def _statuses(database: Database) -> Iterator[Judged]:
    context = Context(database)
    with database.reading() as session:
        names = [stored.machine.id for stored in list_machines(session)]
    for name in names[:MOST_MACHINES]:
        try:
            yield show_status(context, name)
        except StorageUnavailable:
            raise
        except ThermapError as error:
            yield _NotJudged(name, [f"{capitalised(error.detail)}."])
    if len(names) > MOST_MACHINES:
        rest = counted(len(names) - MOST_MACHINES, "machine")
        yield _NotJudged(f"{names[MOST_MACHINES]} and after", [f"{rest} not looked at."], "limited")


@dataclass(frozen=True, slots=True)
class _NotJudged:
    machine: str
    sentences: list[str]
    verdict: str = "not-trusted"
    state: str = "not-judged"


def _has_seal(file: Path) -> bool:
    with file.open("rb") as opened:
        opened.seek(max(file.stat().st_size - SEAL_BYTES, 0))
        return opened.read(len(SEAL)) == SEAL


def _named(numbers: list[int]) -> str:
    several = len(numbers) > 1
    listed = ", ".join(map(str, numbers))
    return f"{'Analyses' if several else 'Analysis'} {listed} {'are' if several else 'is'}"


def _span(time: timedelta) -> str:
    hours = time.total_seconds() / 3600.0
    if hours < 1.0:
        return counted(int(60.0 * hours), "minute")
    return counted(int(hours), "hour") if hours < 48.0 else counted(int(hours / 24.0), "day")
