"""Machine descriptions, error maps and readings from JSON files, as the HTTP contract has them.

What the service answers is taken too: the fields that it adds are left away.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final, TypeAlias, TypeVar

from pydantic import ValidationError

from app.api.schemas.base import Schema
from app.api.schemas.error_maps import (
    ComponentAnswer,
    ComponentSchema,
    ErrorMapAnswer,
    ErrorMapSchema,
)
from app.api.schemas.machines import MachineAnswer, MachineSettings
from app.api.schemas.readings import ReadingSchema
from app.errors import InvalidContent, list_names
from app.field_errors import field_error
from app.files.delimited_text import Problems, read_text
from app.json_text import NoJsonError, RepeatedNameError
from app.json_text import read_json as read_sent_json

Content: TypeAlias = MachineSettings | ErrorMapSchema | ReadingSchema
_Shape = TypeVar("_Shape", bound=Schema)

_ADDED: Final = {
    MachineSettings: MachineAnswer.model_fields.keys() - MachineSettings.model_fields.keys(),
    ErrorMapSchema: ErrorMapAnswer.model_fields.keys() - ErrorMapSchema.model_fields.keys(),
    ComponentSchema: ComponentAnswer.model_fields.keys() - ComponentSchema.model_fields.keys(),
}
"""Fields of an answer that nobody states."""


def read_contract_json(file: Path) -> list[Content]:
    """Read what a JSON file holds, one thing or a list of them, and check all of it.

    Raises
    ------
    UnreadableFile
        With line and column where it is no JSON, else with the field that is wrong,
        what was expected and what came.
    """
    problems = Problems(file)
    return check_contract(read_json(file, problems), problems)


def check_contract(document: Any, problems: Problems) -> list[Content]:
    """Check what a JSON document holds, as `read_contract_json` does."""
    entries = document if isinstance(document, list) else [document]
    if not entries:
        problems.add("expected a machine, an error map or readings, got an empty list")
    contents = []
    for i, entry in enumerate(entries):
        prefix = f"entry {i + 1}: " if isinstance(document, list) else ""
        try:
            contents.append(_read_entry(entry))
        except _Refused as refused:
            for message in refused.messages:
                problems.add(prefix + message)
    problems.raise_if_any()
    return contents


def read_json(file: Path, problems: Problems) -> Any:
    """Read a JSON file.

    Raises
    ------
    UnreadableFile
        With line and column where it is no JSON; or where an object has a name twice, of which
        one would count and nobody knows which was meant.
    """
    try:
        document = json.loads(read_text(file), object_pairs_hook=_each_name_once)
    except _Refused as refused:
        for message in refused.messages:
            problems.add(message)
        problems.raise_if_any()
    except json.JSONDecodeError as error:
        problems.add(f"expected JSON: {error.msg}", error.lineno, f"column {error.colno}")
        problems.raise_if_any()
    return document


def json_of(content: bytes, problems: Problems) -> Any:
    """Read JSON that came over HTTP, within its limits.

    Raises
    ------
    UnreadableFile
        If it is none, or an object has a name twice.
    """
    try:
        return read_sent_json(content)
    except (NoJsonError, RepeatedNameError) as error:
        problems.add(f"expected JSON, got none: {error}")
    problems.raise_if_any()
    return None


class _Refused(Exception):
    """What is wrong with one entry."""

    def __init__(self, *messages: str) -> None:
        super().__init__(*messages)
        self.messages = messages


def _each_name_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Make an object of its names and values, as the service does: none of them twice."""
    by_name = dict(pairs)
    if len(by_name) < len(pairs):
        twice = [name for name, count in Counter(name for name, _ in pairs).items() if count > 1]
        raise _Refused(f"expected each name once in an object, got {list_names(twice)} twice")
    return by_name


def _read_entry(entry: Any) -> Content:
    if isinstance(entry, dict) and "configuration" in entry:
        return _checked(MachineSettings, entry, MachineSettings.to_machine)
    if isinstance(entry, dict) and ("components" in entry or "measured_at" in entry):
        return _checked(ErrorMapSchema, entry, ErrorMapSchema.to_error_map)
    if isinstance(entry, dict) and "time" in entry:
        return _checked(ReadingSchema, entry, ReadingSchema.to_reading)
    got = f"fields {', '.join(entry)}" if isinstance(entry, dict) else type(entry).__name__
    raise _Refused(
        "expected a machine (with configuration), an error map (with components) or a reading "
        f"(with time and temperatures_c), got {got}"
    )


def _checked(
    shape: type[_Shape],
    entry: Mapping[str, Any],
    to_domain: Callable[[_Shape], object],
) -> _Shape:
    """Make what the service would make of an entry, or say what it would refuse."""
    try:
        content = shape.model_validate(_as_stated(shape, entry))
        to_domain(content)
    except ValidationError as error:
        problems = map(field_error, error.errors())
        raise _Refused(*(f"{e.field}: {e.message}" for e in problems)) from None
    except InvalidContent as error:
        placed = [f"{e.field}: {e.message}" for e in error.errors]
        raise _Refused(*(placed or [error.detail])) from None
    return content


def _as_stated(shape: type[Schema], entry: Mapping[str, Any]) -> dict[str, Any]:
    """Leave away what an answer has beyond what is stated."""
    fields = {name: value for name, value in entry.items() if name not in _ADDED.get(shape, ())}
    if shape is ErrorMapSchema and isinstance(fields.get("components"), list):
        fields["components"] = [
            _as_stated(ComponentSchema, component) if isinstance(component, dict) else component
            for component in fields["components"]
        ]
    return fields
