"""What every kind of connection is: a table of the file, and what runs by it.

A kind is a table (`ConnectionTable`), which names the extra that it needs and has its field in
`ConnectionsFile`, and what runs by it (`RunningConnection`), which `Connections` makes.
"""

from __future__ import annotations

import os
from collections.abc import AsyncGenerator, Callable
from dataclasses import dataclass
from datetime import datetime
from typing import Annotated, Any, ClassVar, Final, NamedTuple, Protocol, TypeAlias

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    SecretStr,
    field_validator,
)

from app.answer import Answer
from app.errors import list_names
from app.units import TemperatureUnit

ShortName: TypeAlias = Annotated[str, Field(min_length=1, max_length=64)]


def _expect_set(name: str) -> str:
    if not os.environ.get(name):
        raise ValueError(f"expected a variable of the environment, got {name!r}: it is unset")
    return name


def _read_secret(raw: object) -> SecretStr:
    if not isinstance(raw, str):
        raise ValueError("expected a text, got another type")
    return SecretStr(raw)


Variable: TypeAlias = Annotated[
    str, Field(min_length=1, max_length=200), AfterValidator(_expect_set)
]
"""Name of a variable of the environment that has a secret."""

Secret: TypeAlias = Annotated[SecretStr, BeforeValidator(_read_secret)]
"""What is written nowhere, neither in errors."""


def _read_unit(raw: object) -> TemperatureUnit:
    if not isinstance(raw, str) or raw not in list(TemperatureUnit):
        raise ValueError(f"expected one of {list_names(TemperatureUnit)}, got {raw!r:.80}")
    return TemperatureUnit(raw)


StatedUnit: TypeAlias = Annotated[TemperatureUnit, BeforeValidator(_read_unit)]
"""A unit of temperature by its name."""

LARGEST_TERM: Final = 1e6
"""Of what a raw number is multiplied by, and of what is added to it."""

DECIMALS_C: Final = 9
"""Of a temperature that was converted [°C]: 243 tenths are 24.3, and not 24.300000000000004."""


@dataclass(frozen=True, slots=True)
class Connection(Answer):
    """A connection and how it fares."""

    name: str
    """Its name in the file"""
    kind: str
    """`mtconnect`, `opcua` or `mqtt`"""
    machines: tuple[str, ...]
    """Ids of the machines whose sensors it reads; where topics name them, of those heard so far"""
    endpoint: str
    """Where it reads"""
    connected: bool
    """Whether there is contact now"""
    last_value_at: datetime | None
    """When the last value came, null before the first"""
    known: int
    """How many of its sensors and states have a value now"""
    trouble: str
    """What is the matter, empty where nothing"""
    lost: int
    """Observations that were gone before they could be read, as far as the sender tells"""
    taken: int = 0
    """Messages whose values were stored since the service began; one may say of several sensors"""
    dropped: int = 0
    """Messages whose values were dropped, as too many waited for the database"""
    refused: int = 0
    """Messages or values that were refused"""


class TableEvent(NamedTuple):
    """What is new of a machine.

    `kind` is `table`, `state` (the table is another one in more than its values, or there is
    none) or `status`; `content` is JSON.
    """

    machine: str
    kind: str
    content: bytes


FollowTables: TypeAlias = Callable[[float, float | None], AsyncGenerator[TableEvent, None]]
"""Follow all machines' tables, with the smallest change that is told and the largest step [the
value's unit]; at first all that there is."""


class RunningConnection(Protocol):
    """A connection at work."""

    async def run(self) -> None:
        """Make contact and read until it is lost, which is raised."""

    def lost(self, words: str) -> None:
        """Take note of why there is no contact."""

    def now(self) -> Connection:
        """Say how it fares."""


class TellsTables:
    """A connection that tells tables, too: `follow_tables` is there when it runs."""

    follow_tables: FollowTables


class Table(BaseModel):
    """A table of the file: no key but those that there are, no type but the one expected."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class TemperatureTable(Table):
    """How a sender writes a temperature: raw number times `factor` plus `offset`, in `unit`.

    Parameters
    ----------
    unit
        None: what the sender states of the value, or °C.
    """

    unit: StatedUnit | None = None
    factor: float = Field(1.0, ge=-LARGEST_TERM, le=LARGEST_TERM, allow_inf_nan=False)
    offset: float = Field(0.0, ge=-LARGEST_TERM, le=LARGEST_TERM, allow_inf_nan=False)

    @field_validator("factor")
    @classmethod
    def _is_not_0(cls, factor: float) -> float:
        if factor == 0.0:
            raise ValueError("expected a factor other than 0, got 0")
        return factor

    def to_c(self, raw: float, raw_unit: TemperatureUnit | None = None) -> float:
        """Convert a raw number to °C; `raw_unit` is the sender's unit, where the file has none.

        >>> TemperatureTable(factor=0.1).to_c(243.0)
        24.3
        >>> TemperatureTable(factor=0.1, offset=-40.0, unit="FAHRENHEIT").to_c(1080.0)
        20.0
        """
        unit = self.unit or raw_unit or TemperatureUnit.CELSIUS
        return round(unit.to_c(raw * self.factor + self.offset), DECIMALS_C)


PLAIN: Final = TemperatureTable()
"""A temperature that the file says nothing of."""


def each(key: str) -> BeforeValidator:
    """Let `x-middle = "Xtemp"` stand for `x-middle = { KEY = "Xtemp" }` in a table of tables."""

    def expand(raw: Any) -> Any:
        if not isinstance(raw, dict):
            return raw
        return {k: {key: v} if isinstance(v, str) else v for k, v in raw.items()}

    return BeforeValidator(expand)


class ConnectionTable(Table):
    """`[[KIND]]`: one connection."""

    extra: ClassVar[str]
    """Brings the library that is needed"""
    library: ClassVar[str]
    """Its module"""

    name: ShortName

    def expect_usable(self) -> None:
        """Refuse what only its library sees to be wrong, with ValueError."""
