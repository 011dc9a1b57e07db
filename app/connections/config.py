"""The file that says which connections there are: read and checked whole before anything starts."""

from __future__ import annotations

import tomllib
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any, Final

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator

from app.connections.intake import Limits
from app.errors import FieldError, InvalidContent

_URL: Final = r"https?://[^\s]+"


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class IntakeTable(_Table):
    """`[intake]`: how values become readings."""

    collect_s: float = Field(1.0, gt=0.0, le=60.0)
    most_kept: int = Field(10_000, ge=1, le=1_000_000)

    @property
    def limits(self) -> Limits:
        """The same as the intake takes it."""
        return Limits(collect_s=self.collect_s, most_kept=self.most_kept)


class ItemTable(_Table):
    """A data item of an agent: its id or name, and its unit where the agent states none."""

    item: Annotated[str, Field(min_length=1, max_length=200)]
    unit: str | None = None

    @field_validator("unit")
    @classmethod
    def _known_unit(cls, unit: str | None) -> str | None:
        if unit not in (None, "CELSIUS", "FAHRENHEIT", "KELVIN"):
            raise ValueError(f"expected CELSIUS, FAHRENHEIT or KELVIN, got {unit!r}")
        return unit


class MtconnectTable(_Table):
    """`[[mtconnect]]`: an agent, and which of its data items are which sensors of a machine."""

    name: Annotated[str, Field(min_length=1, max_length=64)]
    machine: Annotated[str, Field(min_length=1, max_length=64)]
    url: Annotated[str, Field(pattern=_URL, max_length=500)]
    sensors: Annotated[dict[str, ItemTable], Field(min_length=1, max_length=200)]
    state: dict[str, ItemTable] = Field(default_factory=dict)
    every_s: float = Field(1.0, ge=0.1, le=3600.0)
    stream: bool = False

    @field_validator("sensors", "state", mode="before")
    @classmethod
    def _items_by_name(cls, stated: Any) -> Any:
        """Let `x-middle = "Xtemp"` stand for `x-middle = { item = "Xtemp" }`."""
        if not isinstance(stated, dict):
            return stated
        return {k: {"item": v} if isinstance(v, str) else v for k, v in stated.items()}


class ConnectionsFile(_Table):
    """All of the file."""

    intake: IntakeTable = Field(default_factory=IntakeTable)
    mtconnect: tuple[MtconnectTable, ...] = Field((), strict=False)

    @field_validator("mtconnect")
    @classmethod
    def _each_name_once(cls, tables: tuple[MtconnectTable, ...]) -> tuple[MtconnectTable, ...]:
        names = [table.name for table in tables]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"expected each name once, got {name!r} {names.count(name)} times")
        return tables


def read_connections(path: Path) -> ConnectionsFile:
    """Read and check the file.

    Raises
    ------
    InvalidContent
        That names the file, the table and the key, what was expected and what came.
    """
    try:
        stated = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InvalidContent(f"config: {path} cannot be read: {error.strerror}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InvalidContent(f"config: {path}: expected TOML in UTF-8: {error}") from error
    try:
        found = ConnectionsFile.model_validate(stated)
    except ValidationError as error:
        errors = [
            FieldError(".".join(map(str, one["loc"])), _words(one["msg"], one["input"]))
            for one in error.errors(include_url=False)
        ]
        words = "; ".join(f"{one.field}: {one.message}" for one in errors[:5])
        raise InvalidContent(f"config: {path}: {words}", errors) from None
    if found.mtconnect and find_spec("defusedxml") is None:
        raise InvalidContent(
            f'config: {path}: mtconnect needs the extra mtconnect: pip install "thermap[mtconnect]"'
        )
    return found


def _words(message: str, came: object) -> str:
    text = message.removeprefix("Value error, ")
    return text if "got " in text else f"{text[0].lower()}{text[1:]}, got {came!r:.80}"
