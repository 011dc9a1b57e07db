"""What a message of an ordinary topic says: of which machine, which sensors, when."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any, Final

from app.connections.mqtt_payloads import Unusable, number_at, read_json, read_text, time_at
from app.connections.mqtt_tables import TopicTable
from app.errors import list_names

LONGEST_NAME: Final = 64
"""Of a machine or a sensor [characters]."""


@dataclass(frozen=True, slots=True)
class MessageValues:
    """What a message states.

    Parameters
    ----------
    time
        The sender's, where it is configured.
    wrong
        What else it says that cannot be read.
    """

    machine: str
    temperatures_c: Mapping[str, float]
    state: Mapping[str, float] = field(default_factory=dict)
    time: datetime | None = None
    wrong: tuple[str, ...] = ()
    without: tuple[str, ...] = ()


def read_message(table: TopicTable, names: Mapping[str, str], payload: bytes) -> MessageValues:
    """Read a message.

    Parameters
    ----------
    names
        What the levels of its topic name.

    Raises
    ------
    Unusable
        If it has nothing that can be used.
    """
    machine, sensor = table.machine or names["machine"], table.sensor or names.get("sensor")
    for name in names.values():
        if not 0 < len(name) <= LONGEST_NAME:
            raise Unusable(
                f"expected names of 1 to {LONGEST_NAME} characters in the topic, got {name!r:.80}"
            )
    if sensor is None:
        return _read_document(table, machine, payload)
    if table.value is None:
        return MessageValues(machine, {sensor: table.to_c(read_text(payload))})
    document = read_json(payload)
    value = number_at(document, table.value)
    if value is None and table.value.is_null(document):
        return MessageValues(machine, {}, without=(sensor,))
    if value is None:
        raise Unusable(f"expected a number at {table.value.text}, got nothing there")
    return MessageValues(machine, {sensor: table.to_c(value)}, time=_time(table, document))


def _read_document(table: TopicTable, machine: str, payload: bytes) -> MessageValues:
    """Read several sensors; those that a document leaves out are not told of, and that is all."""
    document = read_json(payload)
    temperatures_c, state, wrong = {}, {}, []
    without = tuple(
        name
        for name, path_of_sensor in table.sensors.items()
        if path_of_sensor.path.is_null(document)
    )
    for name, place in table.sensors.items():
        try:
            value = number_at(document, place.path)
        except Unusable as why:
            wrong.append(f"{name}: {why.detail}")
            continue
        if value is not None:
            temperatures_c[name] = place.to_c(value)
    for name, path in table.state.items():
        try:
            value = number_at(document, path)
        except Unusable as why:
            wrong.append(f"{name}: {why.detail}")
            continue
        if value is not None:
            state[name] = value
    if not temperatures_c and not state and (wrong or not without):
        paths = [sensor_path.path.text for sensor_path in table.sensors.values()]
        paths += [state_path.text for state_path in table.state.values()]
        raise Unusable("; ".join(wrong) or f"expected a number at {list_names(paths)}, got none")
    time = _time(table, document)
    return MessageValues(machine, temperatures_c, state, time, tuple(wrong), without)


def _time(table: TopicTable, document: Any) -> datetime | None:
    return None if table.time is None else time_at(document, table.time, table.time_form)
