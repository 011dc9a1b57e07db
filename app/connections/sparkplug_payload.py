"""Payloads of Sparkplug B: the messages of its specification that temperatures need.

Eclipse Sparkplug 3.0, 6.4: `Payload`, and of each `Metric` its names, times and numbers. Fields
that are not described here are passed over.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any, Final

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from google.protobuf.message import DecodeError

from app.connections.mqtt_payloads import LONGEST_EXCERPT, Unusable
from app.units import MS_PER_S, time_since_1970

MOST_METRICS: Final = 10_000
"""Of one message."""

REBIRTH: Final = "Node Control/Rebirth"
SESSION: Final = "bdSeq"
"""Metric that says which birth a death belongs to."""

_FIELD: Final = descriptor_pb2.FieldDescriptorProto
_UINT64, _UINT32, _BOOL = _FIELD.TYPE_UINT64, _FIELD.TYPE_UINT32, _FIELD.TYPE_BOOL

_METRIC_FIELDS: Final = (
    ("name", 1, _FIELD.TYPE_STRING),
    ("alias", 2, _UINT64),
    ("timestamp", 3, _UINT64),
    ("datatype", 4, _UINT32),
    ("is_historical", 5, _BOOL),
    ("is_null", 7, _BOOL),
    ("int_value", 10, _UINT32),
    ("long_value", 11, _UINT64),
    ("float_value", 12, _FIELD.TYPE_FLOAT),
    ("double_value", 13, _FIELD.TYPE_DOUBLE),
    ("boolean_value", 14, _BOOL),
)
_FIRST_VALUE: Final = 10
"""From this number on a metric's fields are its value, of which it has one."""

_SIGNED_BITS: Final = {1: 8, 2: 16, 3: 32, 4: 64}
"""Of the datatypes Int8 to Int64, which are sent as unsigned numbers."""

_BOOLEAN: Final = 11


def _messages() -> tuple[Any, Any]:
    file = descriptor_pb2.FileDescriptorProto(
        name="thermap/sparkplug_b.proto", package="thermap.sparkplug", syntax="proto2"
    )
    metric = file.message_type.add(name="Metric")
    metric.oneof_decl.add(name="value")
    for name, number, kind in _METRIC_FIELDS:
        field = metric.field.add(name=name, number=number, type=kind, label=_FIELD.LABEL_OPTIONAL)
        if number >= _FIRST_VALUE:
            field.oneof_index = 0
    payload = file.message_type.add(name="Payload")
    for name, number in (("timestamp", 1), ("seq", 3)):
        payload.field.add(name=name, number=number, type=_UINT64, label=_FIELD.LABEL_OPTIONAL)
    payload.field.add(
        name="metrics",
        number=2,
        type=_FIELD.TYPE_MESSAGE,
        label=_FIELD.LABEL_REPEATED,
        type_name=".thermap.sparkplug.Metric",
    )
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    descriptors = (
        pool.FindMessageTypeByName(f"thermap.sparkplug.{name}") for name in ("Payload", "Metric")
    )
    made, of_metric = (message_factory.GetMessageClass(descriptor) for descriptor in descriptors)
    return made, of_metric


_PAYLOAD, _METRIC = _messages()


@dataclass(frozen=True, slots=True)
class Metric:
    """A metric as it was sent: by name, by alias, or both.

    `value` is None where it is null or no number. `datatype` is 0 where it is not stated, as in
    all but births; `time` is None where none that can be read is.
    """

    name: str
    alias: int | None
    datatype: int
    value: float | None
    time: datetime | None = None
    is_historical: bool = False


@dataclass(frozen=True, slots=True)
class Payload:
    """What a message says; `seq` is None in deaths."""

    seq: int | None
    metrics: Sequence[Metric]


def read_payload(content: bytes) -> Payload:
    """Read a payload.

    Raises
    ------
    Unusable
        If it is none.
    """
    message = _PAYLOAD()
    try:
        message.ParseFromString(content)
    except DecodeError:
        raise Unusable(
            f"expected a payload of Sparkplug B, got {content[:LONGEST_EXCERPT]!r} ({len(content)} "
            "bytes)"
        ) from None
    if len(message.metrics) > MOST_METRICS:
        raise Unusable(f"expected at most {MOST_METRICS} metrics, got {len(message.metrics)}")
    seq = message.seq if message.HasField("seq") else None
    return Payload(seq, [_metric(metric) for metric in message.metrics])


def signed(value: float, datatype: int) -> float:
    """Read the number of a signed datatype, which is sent in two's complement.

    >>> signed(2**32 - 5, 3), signed(251, 1), signed(7, 7)
    (-5, -5, 7)
    """
    bits = _SIGNED_BITS.get(datatype)
    if bits is None or not float(value).is_integer():
        return value
    unsigned = int(value) & ((1 << bits) - 1)
    return unsigned - (1 << bits) if unsigned >> (bits - 1) else unsigned


def rebirth_command() -> bytes:
    """Write the payload that asks an edge node to tell anew what it has."""
    message = _PAYLOAD()
    message.metrics.add(name=REBIRTH, datatype=_BOOLEAN, boolean_value=True)
    content: bytes = message.SerializeToString()
    return content


def _metric(message: Any) -> Metric:
    kind = message.WhichOneof("value")
    is_number = kind is not None and kind != "boolean_value" and not message.is_null
    value = getattr(message, kind) if is_number else None
    return Metric(
        name=message.name,
        alias=message.alias if message.HasField("alias") else None,
        datatype=message.datatype,
        value=value if value is not None and math.isfinite(value) else None,
        time=_time(message.timestamp) if message.HasField("timestamp") else None,
        is_historical=message.is_historical,
    )


def _time(epoch_ms: int) -> datetime | None:
    try:
        return time_since_1970(epoch_ms / MS_PER_S)
    except ValueError:
        return None
