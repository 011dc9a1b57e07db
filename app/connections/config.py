"""The file that says which connections there are: read and checked whole before anything starts."""

from __future__ import annotations

import tomllib
from importlib.util import find_spec
from pathlib import Path

from pydantic import Field, ValidationError, model_validator
from pydantic_core import ErrorDetails

from app.connections.connection import ConnectionTable, Table
from app.connections.intake import Limits
from app.connections.mqtt_tables import MqttTable
from app.connections.mtconnect_connection import MtconnectTable
from app.connections.notify_receiver import NotifyTable
from app.connections.opcua_connection import OpcuaTable
from app.connections.opcua_security import OpcuaServerTable
from app.errors import FieldError, InvalidContent, repeated


class IntakeTable(Table):
    """`[intake]`: how values become readings."""

    collect_s: float = Field(0.2, gt=0.0, le=60.0)
    most_kept: int = Field(10_000, ge=1, le=1_000_000)

    @property
    def limits(self) -> Limits:
        """The same as the intake takes it."""
        return Limits(collect_s=self.collect_s, most_kept=self.most_kept)


class ConnectionsFile(Table):
    """All of the file; a kind of connection is one field, and its place in `connections`."""

    intake: IntakeTable = Field(default_factory=IntakeTable)
    mtconnect: tuple[MtconnectTable, ...] = Field((), strict=False)
    opcua: tuple[OpcuaTable, ...] = Field((), strict=False)
    mqtt: tuple[MqttTable, ...] = Field((), strict=False)
    notify: tuple[NotifyTable, ...] = Field((), strict=False, max_length=50)
    opcua_server: OpcuaServerTable | None = None

    @property
    def connections(self) -> tuple[MtconnectTable | OpcuaTable | MqttTable, ...]:
        """All connections, kind by kind."""
        return (*self.mtconnect, *self.opcua, *self.mqtt)

    @property
    def named(self) -> tuple[MtconnectTable | OpcuaTable | MqttTable | NotifyTable, ...]:
        """All that has a name: connections, and receivers of alarms."""
        return (*self.connections, *self.notify)

    @model_validator(mode="after")
    def _each_name_once(self) -> ConnectionsFile:
        twice = repeated(table.name for table in self.named)
        if twice:
            raise ValueError(f"expected each name once, got {twice[0]!r} again")
        return self


def read_connections(path: Path) -> ConnectionsFile:
    """Read and check the file.

    Raises
    ------
    InvalidContent
        That names the file, the table and the key, what was expected and what came; or the
        extra that is not installed.
    """
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise InvalidContent(f"config: {path} cannot be read: {error.strerror}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InvalidContent(f"config: {path}: expected TOML in UTF-8: {error}") from error
    try:
        connections_file = ConnectionsFile.model_validate(content, context={"folder": path.parent})
    except ValidationError as error:
        errors = [
            FieldError(".".join(map(str, detail["loc"])), _words(detail))
            for detail in error.errors(include_url=False)
        ]
        words = "; ".join(
            f"{problem.field}: {problem.message}".removeprefix(": ") for problem in errors[:5]
        )
        raise InvalidContent(f"config: {path}: {words}", errors) from None
    for table in connections_file.named:
        if find_spec(table.library) is None:
            raise InvalidContent(
                f"config: {path}: {table.name!r} needs the extra {table.extra}: "
                f'pip install "thermap[{table.extra}]"'
            )
        _expect_usable(path, repr(table.name), table)
    if connections_file.opcua_server is not None and find_spec(OpcuaTable.library) is not None:
        _expect_usable(path, "opcua_server", connections_file.opcua_server)
    return connections_file


def _expect_usable(
    path: Path, where: str, table: ConnectionTable | NotifyTable | OpcuaServerTable
) -> None:
    try:
        table.expect_usable()
    except ValueError as why:
        raise InvalidContent(f"config: {path}: {where}: {why}") from None


def _words(error: ErrorDetails) -> str:
    """Say what was expected and what came, but nothing that could be a password."""
    text = error["msg"].removeprefix("Value error, ")
    if "got " in text:
        return text
    text = f"{text[0].lower()}{text[1:]}"
    came = error["input"]
    if error["type"] in ("missing", "extra_forbidden") or isinstance(came, dict):
        return text
    return f"{text}, got {came!r:.80}"
