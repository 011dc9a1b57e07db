"""What an OPC UA server says of a node: a number that is good, or why there is none."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Final

from asyncua import ua

from app.errors import existing_names
from app.units import LATEST_TIME, TemperatureUnit

_NO_TIME_BEFORE: Final = datetime(1970, 1, 1, tzinfo=UTC)
"""A source that states no time says the year 1601."""

_UNITS: Final = {
    4408652: TemperatureUnit.CELSIUS,
    4604232: TemperatureUnit.FAHRENHEIT,
    4932940: TemperatureUnit.KELVIN,
}
"""UNECE's CEL, FAH and KEL as OPC UA counts them (Part 8, 5.6.4.3)."""

_SIGNS: Final = {
    "°C": TemperatureUnit.CELSIUS,
    "℃": TemperatureUnit.CELSIUS,
    "°F": TemperatureUnit.FAHRENHEIT,
    "℉": TemperatureUnit.FAHRENHEIT,
    "K": TemperatureUnit.KELVIN,
}
"""What servers without UNECE's number show to people."""


@dataclass(frozen=True, slots=True)
class Observed:
    """A number, or None and why not."""

    value: float | None
    words: str = ""


def observe(data_value: ua.DataValue) -> Observed:
    """Read what a server says of a node; no value unless its status is Good."""
    status = data_value.StatusCode
    if status is not None and not status.is_good():
        return Observed(None, f"expected a good value, got {status_words(status)} from the server")
    variant = data_value.Value
    if variant is None or variant.Value is None:
        return Observed(None, "expected a number, got nothing")
    value = variant.Value
    if variant.is_array or isinstance(value, list | tuple):
        return Observed(None, f"expected one number, got an array of {len(value)}")
    if isinstance(value, bool) or not isinstance(value, int | float):
        return Observed(
            None, f"expected a number, got the {variant.VariantType.name} {value!r:.80}"
        )
    if not math.isfinite(value):
        return Observed(None, f"expected a finite number, got {value!r}")
    return Observed(float(value))


def status_words(status: ua.StatusCode) -> str:
    """Name a status; its number where it has no name."""
    has_name = status.name not in ("Good", "Uncertain", "Bad") or status.value == 0
    return status.name if has_name else f"{status.name} (0x{status.value:08X})"


def source_time(data_value: ua.DataValue) -> datetime | None:
    """Read when the source measured it, None where the server does not say."""
    timestamp: datetime | None = data_value.SourceTimestamp
    if timestamp is None:
        return None
    time = timestamp if timestamp.tzinfo is not None else timestamp.replace(tzinfo=UTC)
    return time if _NO_TIME_BEFORE < time < LATEST_TIME else None


def node_of(text: str, namespaces: Sequence[str]) -> ua.NodeId | str:
    """Find a node's id, or say why there is none.

    Parameters
    ----------
    text
        `ns=2;s=…`, or `nsu=URI;s=…`, which holds whatever number the URI has in this server.
    namespaces
        The server's URIs, in the order of their numbers.
    """
    if text.startswith("nsu="):
        uri, _, identifier = text.removeprefix("nsu=").partition(";")
        if uri not in namespaces:
            return f"expected a namespace of the server, got {uri!r}; {existing_names(namespaces)}"
        text = f"ns={namespaces.index(uri)};{identifier}"
    try:
        return ua.NodeId.from_string(text)
    except (ua.UaError, ValueError) as why:
        return f"expected a node id as ns=2;s=NAME, got {text!r}: {why}"


def stated_unit(units: object) -> TemperatureUnit | str | None:
    """Read a node's EngineeringUnits: a unit of temperature, or what else it is; None: unsaid."""
    if not isinstance(units, ua.EUInformation):
        return None
    display_name = (units.DisplayName.Text or "").strip()
    unit = _UNITS.get(units.UnitId) or _SIGNS.get(display_name)
    return unit or display_name or None
