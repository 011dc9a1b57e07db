"""One soak from beginning to end, and what came of it."""

from __future__ import annotations

import os
import re
import signal
import time
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from types import MappingProxyType

import psycopg
from sqlalchemy import make_url

from tests.faults.soak.adopting import Adopter
from tests.faults.soak.asking import Shop
from tests.faults.soak.followers import Follower
from tests.faults.soak.owner import Owner
from tests.faults.soak.process import Growth, Sample, Watch, growth_of, look_at
from tests.faults.soak.tally import Tally
from tests.faults.soak.trouble import Trouble

ENDING_SHARE = 1.0 / 3.0
"""In the first third the service is killed and ended; afterwards one process lives to the end."""

WARM_SHARE = 0.1
"""Of the time, at most `WARM_S`: what a process needs until it holds all that it will."""

WARM_S = 300.0
QUIET_S = 8.0
"""After this without a client a process holds only what it keeps for itself: followers need
`SILENCE_S` of it to see that they shall stop."""

HANDLES_MORE = 6
"""So many more at the end than at the beginning may be chance: pooled connections, workers."""

THREADS_MORE = 8
GROWTH_JUDGED_AFTER_H = 0.25
GROWTH_MIB_PER_H = 30.0
SAMPLES_EVERY_S = 1.0
MOST_S = 600.0
"""No longer is waited for answers [s]."""

ORPHAN = re.compile(
    r"^Traceback \(most recent call last\):\n(?: .*\n)*?.* in spawn_main\n(?: .*\n)*"
    r"(?:EOFError: Ran out of input|_pickle\.UnpicklingError: pickle data was truncated)\n?",
    re.MULTILINE,
)


@dataclass(frozen=True)
class Soaked:
    """What came of a soak; `first` and `last` are of the process that lived to the end.

    `filling` is how its memory grew in the first half of that time, while what it remembers of
    tables fills, and `growth` in the second.
    """

    seconds: float
    machines: int
    tally: Tally
    rounds_of_adoption: int
    first: Sample
    last: Sample
    filling: Growth | None
    growth: Growth | None
    samples: list[Sample]
    log_errors: list[str]

    @property
    def leaks(self) -> list[str]:
        """Say what the process holds more and more of; an empty list where nothing."""
        found = []
        if self.last.handles > self.first.handles + HANDLES_MORE:
            found.append(f"{self.first.handles} open handles became {self.last.handles}")
        if self.last.threads > self.first.threads + THREADS_MORE:
            found.append(f"{self.first.threads} threads became {self.last.threads}")
        growth = self.growth
        if (
            growth is not None
            and growth.hours >= GROWTH_JUDGED_AFTER_H
            and growth.rate - 2.0 * growth.standard_error > GROWTH_MIB_PER_H
        ):
            found.append(f"memory grows by {growth.rate:.0f} MiB/h")
        return found

    @property
    def is_well(self) -> bool:
        return not (self.tally.wrong or self.leaks or self.log_errors)

    def page(self) -> str:
        """Write all of it on one page."""
        tally = self.tally
        checked = sum(tally.checked.values())
        lines = [
            f"{self.seconds / 60.0:.1f} min, {self.machines} machines; load {_load()}",
            f"answers checked: {checked:,}, wrong: {tally.wrong}",
            *(f"    {number:>9,}  {kind}" for kind, number in tally.checked.most_common()),
            "all answers by status: "
            + ", ".join(f"{status} {n:,}" for status, n in sorted(tally.statuses.items()))
            + f"; {tally.unanswered:,} requests without an answer, sent again",
            "faults:",
            *(f"    {number:>9,}  {kind}" for kind, number in tally.faults.most_common()),
            f"rounds of adoption: {self.rounds_of_adoption}",
            "the process that lived to the end, without a client, at begin and end:",
            *(
                f"    {name:<12} {first:>8.{digits}f} {last:>8.{digits}f}"
                for name, first, last, digits in (
                    ("handles", self.first.handles, self.last.handles, 0),
                    ("threads", self.first.threads, self.last.threads, 0),
                    ("memory MiB", self.first.resident_mib, self.last.resident_mib, 1),
                    ("database MiB", self.first.database_mib, self.last.database_mib, 1),
                )
            ),
            "memory under load, first half: " + _growth_words(self.filling),
            "memory under load, second half: " + _growth_words(self.growth),
            *(f"LEAK: {words}" for words in self.leaks),
            *(f"WRONG: {words}" for words in tally.words),
            *(f"LOG: {words}" for words in self.log_errors[:20]),
            "well" if self.is_well else "not well",
        ]
        return "\n".join(lines)


def soak(
    database_url: str,
    folder: Path,
    *,
    seconds: float,
    machines: int = 10,
    seed: int = 14,
    pause_s: float = 0.1,
    least: Mapping[str, int] = MappingProxyType({}),
    say: Callable[[str], None] = lambda words: None,
) -> Soaked:
    """Let a fleet work for a while, with faults, and check what it is answered.

    Parameters
    ----------
    database_url
        An empty database.
    folder
        Where the service's log is written.
    pause_s
        How long on the average who works with a machine waits between two steps.
    least
        So many answers of each kind are waited for, on a machine that is busy.
    say
        Told about once a minute how far it is.
    """
    log = folder / "service.log"
    shop = Shop("", Tally())
    rooms = [f"/v1/machines/soak-{i}" for i in range(machines)]
    trouble = Trouble(shop, database_url, log, rooms, seed)
    owners = [Owner(shop, f"soak-{i}", seed + i, pause_s) for i in range(machines)]
    followers = [Follower(shop, owner) for owner in owners[: max(1, machines // 2)]]
    adopter = Adopter(shop, seed, every_s=max(5.0, min(45.0, seconds / 8.0)))
    began = time.monotonic()

    def look() -> Sample | None:
        return look_at(trouble.service.pid, time.monotonic() - began, _database_mib(database_url))

    watch = Watch(look, SAMPLES_EVERY_S)
    working = [*owners, *followers, adopter]
    shop.working.set()
    for thread in [*working, watch]:
        thread.start()
    for owner in owners:
        while not owner.is_ready.wait(0.5) and owner.is_alive():
            continue
    trouble.start()
    try:
        _wait(shop, began, ENDING_SHARE * seconds, say)
        trouble.may_end = False
        with trouble.pause:
            trouble.end(signal.SIGKILL)
        warm_s = min(WARM_S, WARM_SHARE * seconds)
        _wait(shop, began, ENDING_SHARE * seconds + warm_s, say)
        first = _in_quiet(shop, trouble, look)
        _wait(shop, began, seconds, say)
        while not Counter(least) <= shop.tally.checked and time.monotonic() - began < MOST_S:
            _wait(shop, began, time.monotonic() - began + 1.0, say)
        last = _in_quiet(shop, trouble, look, goes_on=False)
    finally:
        shop.ended.set()
        shop.working.set()
        watch.end()
        for thread in [*working, trouble]:
            thread.join(60.0)
        trouble.service.end(signal.SIGKILL)
    alive = [thread.name for thread in [*working, trouble] if thread.is_alive()]
    if alive:
        shop.tally.find(f"still not ended: {alive}")
    lived = [s for s in watch.samples if s.pid == last.pid and first.at_s < s.at_s < last.at_s]
    return Soaked(
        seconds=time.monotonic() - began,
        machines=machines,
        tally=shop.tally,
        rounds_of_adoption=adopter.rounds,
        first=first,
        last=last,
        filling=growth_of(lived[: len(lived) // 2]),
        growth=growth_of(lived[len(lived) // 2 :]),
        samples=watch.samples,
        log_errors=errors_in(log),
    )


def _wait(shop: Shop, began: float, until_s: float, say: Callable[[str], None]) -> None:
    while (elapsed := time.monotonic() - began) < until_s:
        shop.ended.wait(min(60.0, until_s - elapsed))
        checked = sum(shop.tally.checked.values())
        say(
            f"{(time.monotonic() - began) / 60.0:5.1f} min: {checked:,} answers checked, "
            f"{shop.tally.wrong} wrong, {sum(shop.tally.faults.values())} faults"
        )


def _in_quiet(
    shop: Shop, trouble: Trouble, look: Callable[[], Sample | None], *, goes_on: bool = True
) -> Sample:
    """Let all clients go, wait a little, and see what the service then holds."""
    with trouble.pause:
        shop.working.clear()
        time.sleep(QUIET_S)
        sample = look()
        if goes_on:
            shop.working.set()
    if sample is None:
        raise RuntimeError("the service ended by itself")
    return sample


def _database_mib(database_url: str) -> float:
    url = make_url(database_url)
    if url.get_backend_name() == "sqlite":
        size = 0
        for name in (f"{url.database}", f"{url.database}-wal"):
            with suppress(OSError):
                size += Path(name).stat().st_size
        return size / 2**20
    plain = url.set(drivername="postgresql").render_as_string(hide_password=False)
    with suppress(psycopg.Error), psycopg.connect(plain, connect_timeout=5) as connection:
        row = connection.execute("SELECT pg_database_size(current_database())").fetchone()
        return float(row[0]) / 2**20 if row else 0.0
    return 0.0


def errors_in(log: Path) -> list[str]:
    """Find what a service never may write: that something was raised which nobody expected.

    A process for an analysis that had hardly begun when its service was killed finds nothing to
    read any more, and says so: that is expected.
    """
    if not log.exists():
        return []
    text = ORPHAN.sub("", log.read_text(encoding="utf-8", errors="replace"))
    found = re.finditer(r"^Traceback.*|^.*\bCRITICAL\b.*|^\S*Error: .*", text, re.MULTILINE)
    return [one[0].strip()[:300] for one in islice(found, 100)]


def _growth_words(growth: Growth | None) -> str:
    if growth is None:
        return "too short to tell"
    return (
        f"{growth.rate:+.1f} ± {growth.standard_error:.1f} MiB/h over {60 * growth.hours:.0f} min"
    )


def _load() -> str:
    return f"{os.getloadavg()[0]:.0f}"
