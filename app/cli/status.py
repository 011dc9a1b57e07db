"""thermap status: whether machines can be trusted now, in the service's own words."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Annotated, Final

import typer
from rich.console import Group, RenderableType
from rich.text import Text

from app.cli.answers import listing, or_nothing, when
from app.cli.asking import Shown, asks, calls

if TYPE_CHECKING:
    from thermap.answers import LargestValue, MachineStatus, SensorNow

WORDS: Final = {"trusted": "Trusted", "limited": "Limited", "not-trusted": "Not trusted"}
_STYLES: Final = {"trusted": "", "limited": "bold yellow", "not-trusted": "bold red"}


@asks
def status(
    machine: Annotated[
        str | None,
        typer.Argument(
            metavar="MACHINE",
            envvar="THERMAP_MACHINE",
            help="The machine's id; without it all machines, a line each.",
        ),
    ] = None,
) -> Shown:
    """Say whether machines can be trusted now, and why not.

    The verdict and its sentences are the service's: pages and streams say the same.

    Example: `thermap status mcfv5050`
    """
    if machine is None:
        return Shown(calls.statuses(), statuses_view)
    return Shown(calls.status(machine), status_view)


def statuses_view(statuses: Sequence[MachineStatus]) -> RenderableType:
    """Lay out all machines, those that cannot be trusted first."""
    table = listing("machine", "verdict", "state", "since (UTC)", "why")
    order = list(reversed(WORDS))
    for one in sorted(statuses, key=lambda m: order.index(m.verdict)):
        table.add_row(
            one.machine, _verdict(one), one.state, when(one.since), " ".join(one.sentences[:1])
        )
    return or_nothing(table, "no machine is stored yet; `thermap import machine.json` stores one")


def status_view(one: MachineStatus) -> RenderableType:
    """Lay out one machine: the verdict, why, and the sensors."""
    head = Text.assemble(_verdict(one), f" · {one.state}")
    if one.since is not None:
        head.append(f" since {when(one.since)} UTC")
    sentences = [Text(sentence) for sentence in one.sentences]
    return Group(
        head, *sentences, Text(), *(Text(fact) for fact in _facts(one)), _sensors(one.sensors)
    )


def _verdict(one: MachineStatus) -> Text:
    return Text(WORDS[one.verdict], style=_STYLES[one.verdict])


def _facts(one: MachineStatus) -> Iterator[str]:
    if one.largest is not None:
        yield f"largest compensation {_value(one.largest)}"
    if one.change_per_h is not None:
        yield f"at the present rates it changes by {_value(one.change_per_h)} in an hour"
    check = one.last_check
    yield f"last check: {'none of this version' if check is None else check.text}"
    if one.watch == "beyond":
        yield "verifications prove a lasting change"
    if one.analysis is not None:
        yield f"analysis {one.analysis.id} at {one.analysis.progress:.0%}"


def _value(value: LargestValue) -> str:
    place = "" if value.axis is None else f" at {value.axis.upper()} {value.position_mm:g}"
    sign = "−" if value.value < 0 else "+"
    return f"{value.component} {sign}{abs(value.value):.1f} {value.unit}{place}"


def _sensors(sensors: Sequence[SensorNow]) -> RenderableType:
    table = listing("sensor", "°C", "K/h", "age", "maps °C", "health", right="lrrrll")
    for sensor in sensors:
        maps = "–" if sensor.maps_c is None else f"{sensor.maps_c[0]:g} to {sensor.maps_c[1]:g}"
        table.add_row(
            sensor.sensor,
            _number(sensor.temperature_c, ".2f"),
            _number(sensor.rate_k_per_h, "+.1f"),
            _number(sensor.age_s, ".0f", " s"),
            maps,
            sensor.detail or _health(sensor),
        )
    return or_nothing(table, "no sensors")


def _health(sensor: SensorNow) -> str:
    if sensor.no_value_since is not None:
        return "no value"
    return "late" if sensor.is_late else str(sensor.health)


def _number(value: float | None, form: str, unit: str = "") -> str:
    return "–" if value is None else f"{value:{form}}{unit}".replace("-", "−")
