"""What somebody is told of alarms: which machines, what is the matter, since when, what to do."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, tzinfo
from enum import StrEnum
from typing import Final
from urllib.parse import quote

from app.errors import counted
from app.status.machine_status import State, Verdict

MOST_MACHINES: Final = 20
"""Of which a message says more than their number."""

_VERDICTS: Final = {
    Verdict.NOT_TRUSTED: "not trusted",
    Verdict.LIMITED: "limited",
    Verdict.TRUSTED: "trusted",
}

_LOOK_AT_SENDER: Final = (
    "see whether the sensors and the program that sends their temperatures are running, and "
    "reach thermap"
)
_MEASURE_A_MAP: Final = (
    "let the machine come back to the temperatures of its maps, or measure a map at these"
)

WHAT_TO_DO: Final[Mapping[State, str]] = {
    State.NO_MODEL: "store an error map",
    State.NO_READING: _LOOK_AT_SENDER,
    State.SENSOR_FAULT: "check the sensor, its cable and its place; exchange it if it is broken",
    State.OUTSIDE_MAPS: _MEASURE_A_MAP,
    State.STALE: _LOOK_AT_SENDER,
    State.EXTRAPOLATED: _MEASURE_A_MAP,
    State.CLAMPED: _MEASURE_A_MAP,
    State.HELD: "check the machine in this state, and analyse the check",
    State.EFFECT_MISSING: "let the machine's state, which the adopted effect needs, be sent again",
    State.INCOMPLETE: "store maps of the components that are missing, or assign their sensors",
    State.LATE: _LOOK_AT_SENDER,
    State.DRIFTING: "analyse the checks and adopt what helps, or measure new maps",
    State.CHECK_OFF: "repeat the check; if it is off again, analyse the checks",
    State.EFFECT_NOT_ADOPTED: "look at what the analysis found, and adopt it",
}
"""By the state of an alarm; those that are none are missing."""


class News(StrEnum):
    """What is told of a machine."""

    CAME = "came"
    LASTS = "lasts"
    OVER = "over"
    PASSED = "passed"
    """It came and went while the receiver, or the service, was away."""


@dataclass(frozen=True, slots=True)
class MachineNews:
    """What is told of one machine.

    Parameters
    ----------
    name
        Its name, or its id where it is no longer stored.
    state
        The worst of its alarms.
    until
        None while it lasts.
    verdict_now
        Its verdict when this was written; None where it is no longer stored.
    sentences
        What is the matter, the worst first.
    """

    machine: str
    name: str
    news: News
    state: State
    since: datetime
    until: datetime | None
    verdict_now: Verdict | None
    sentences: Sequence[str]

    @property
    def is_over(self) -> bool:
        """Whether its alarms are over."""
        return self.until is not None

    @property
    def verdict(self) -> str:
        """What it is now, in words."""
        if not self.is_over:
            return _VERDICTS[self.state.verdict]
        if self.verdict_now is None:
            return "no longer stored"
        return (
            "trusted again"
            if self.verdict_now is Verdict.TRUSTED
            else f"{_VERDICTS[self.verdict_now]} now"
        )


@dataclass(frozen=True, slots=True)
class Message:
    """A message as it is sent: plain text."""

    title: str
    text: str
    is_good: bool
    """Whether it says only that something is over."""


def alarm_message(news: Sequence[MachineNews], zone: tzinfo | None, link: str) -> Message:
    """Write one message of what is new of all machines, the worst first.

    Parameters
    ----------
    zone
        Of its times; None: that of this computer.
    link
        Address of the service; empty for a message without links.
    """
    ordered = sorted(news, key=lambda item: (item.is_over, item.state.gravity, item.name))
    parts = ["\n".join(_lines(item, zone, link)) for item in ordered[:MOST_MACHINES]]
    if len(ordered) > MOST_MACHINES:
        rest = counted(len(ordered) - MOST_MACHINES, "more machine")
        parts.append(f"… and {rest}" + (f": {link}/" if link else ""))
    return Message(
        _title(ordered), "\n\n".join(parts) + "\n", all(item.is_over for item in ordered)
    )


def trial_message(receiver: str, at: datetime, zone: tzinfo | None, link: str) -> Message:
    """Write what shows that messages arrive."""
    where = [f"{link}/"] if link else []
    sentence = f"This is a test, asked for at {local_time(at, zone)}."
    rest = f"Alarms of machines will come to “{receiver}” like this."
    return Message("thermap: test", "\n".join([sentence, rest, *where]) + "\n", is_good=True)


def local_time(time: datetime, zone: tzinfo | None) -> str:
    """Write a time as people on the shop floor read it, with its zone.

    >>> from zoneinfo import ZoneInfo
    >>> local_time(datetime.fromisoformat("2026-07-01T12:00:00Z"), ZoneInfo("Europe/Prague"))
    'Wed 1 Jul 2026, 14:00 CEST'
    """
    there = time.astimezone(zone)
    return f"{there:%a} {there.day} {there:%b %Y, %H:%M %Z}"


def _title(ordered: Sequence[MachineNews]) -> str:
    first = ordered[0]
    if len(ordered) == 1:
        return f"thermap: {first.name} {_verdict(first)}"
    counts = Counter(item.verdict for item in ordered)
    verdicts = ", ".join(f"{count} {verdict}" for verdict, count in counts.items())
    return f"thermap: {counted(len(ordered), 'machine')}: {verdicts}"


def _verdict(item: MachineNews) -> str:
    match item.news:
        case News.LASTS:
            return f"still {item.verdict}"
        case News.PASSED:
            return f"was {_VERDICTS[item.state.verdict]}, is {item.verdict}"
        case _:
            return item.verdict


def _lines(item: MachineNews, zone: tzinfo | None, link: str) -> Iterator[str]:
    name = item.name if item.name == item.machine else f"{item.name} ({item.machine})"
    since = local_time(item.since, zone)
    if item.until is None:
        yield f"{name}: {_verdict(item)}, since {since}"
        yield from item.sentences
        if item.state in WHAT_TO_DO:
            yield f"To do: {WHAT_TO_DO[item.state]}."
    else:
        yield f"{name}: {_verdict(item)}"
        words = _VERDICTS[item.state.verdict]
        yield f"It was {words} from {since} to {local_time(item.until, zone)}:"
        yield from item.sentences
    if link:
        yield f"{link}/machines/{quote(item.machine, safe='')}"
