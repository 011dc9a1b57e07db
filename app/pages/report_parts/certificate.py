"""What a report says as a certificate: which machine, measured with what, by whom, when."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from datetime import UTC, datetime

from markupsafe import Markup

from app import __version__
from app.pages.wording import _, listed, message, said

NOT_STATED = message("not stated")


def machine_facts(machine_id: str, chain: str, serial_number: str | None) -> dict[str, str]:
    """Say which machine it is."""
    return {
        _("machine"): f"{machine_id} ({chain})",
        _("serial number"): serial_number or _(NOT_STATED),
    }


def measured_facts(
    instruments: Iterable[str | None],
    operators: Iterable[str | None],
    measured: tuple[datetime, datetime] | None,
    temperatures_c: Mapping[str, tuple[float, float]],
) -> dict[str, str]:
    """Say with what, by whom, when and in which conditions was measured.

    Parameters
    ----------
    temperatures_c
        The lowest and the highest of each sensor meanwhile.
    """
    ends = [] if measured is None else [_minute(time) for time in measured]
    return {
        _("instrument"): _names(instruments),
        _("operator"): _names(operators),
        _("measured"): said(" to ".join(dict.fromkeys(ends)) or NOT_STATED),
        _("temperatures"): Markup("; ").join(
            said(f"{sensor} {low:.1f} to {high:.1f} °C")
            for sensor, (low, high) in temperatures_c.items()
        ),
    }


def written_by() -> str:
    """Name the software."""
    return f"thermap {__version__}"


def _names(names: Iterable[str | None]) -> str:
    named = list(dict.fromkeys(filter(None, names)))
    return listed(named) if named else _(NOT_STATED)


def _minute(time: datetime) -> str:
    return f"{time.astimezone(UTC):%Y-%m-%d %H:%M} UTC"
