"""A measuring program before it is written in a controller's words: moves, dwells, stops."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeAlias


@dataclass(frozen=True, slots=True)
class Move:
    """A straight move to absolute positions of the machine [mm].

    Parameters
    ----------
    feed_mm_per_min
        Along the path; None at rapid traverse.
    """

    to_mm: Mapping[str, float]
    feed_mm_per_min: float | None = None


@dataclass(frozen=True, slots=True)
class Dwell:
    """Standing still [s]."""

    seconds: float


@dataclass(frozen=True, slots=True)
class Stop:
    """The program waits for the operator, who reads why."""

    why: str


@dataclass(frozen=True, slots=True)
class Remark:
    """A comment between the blocks."""

    text: str


@dataclass(frozen=True, slots=True)
class Spindle:
    """The spindle turns clockwise [1/min], or stops at 0."""

    speed_rpm: float


Block: TypeAlias = Move | Dwell | Stop | Remark | Spindle


@dataclass(frozen=True, slots=True)
class Readings:
    """The empty file that the readings are to be filled into.

    Parameters
    ----------
    content
        CSV as docs/methods/files.md or docs/closing-the-loop.md shows it, without values.
    command
        The command that reads it when it is filled in.
    """

    content: str
    command: str


@dataclass(frozen=True, slots=True)
class MeasuringProgram:
    """A program, and the file for what is read while it runs.

    Parameters
    ----------
    name
        Capital letters and digits, as every controller takes it for a file's name.
    number
        The same where programs have numbers.
    head
        Sentences for the comment at its beginning.
    blocks
        In order; all positions are the machine's own and lie in its travel.
    seconds
        How long it takes, without rapid moves, stops and acceleration [s].
    """

    name: str
    number: int
    title: str
    machine: str
    head: tuple[str, ...]
    blocks: tuple[Block, ...]
    readings: Readings
    seconds: float
    notes: tuple[str, ...] = ()
