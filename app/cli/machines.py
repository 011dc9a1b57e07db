"""thermap machines: list, show, change and delete them."""

from __future__ import annotations

import json as json_text
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer
from rich.console import Group, RenderableType
from rich.text import Text

from app.cli.answers import facts, listing, or_nothing, when
from app.cli.asking import Shown, ThermapClient, asks, calls
from app.cli.options import MachineArgument, YesOption, command_group, confirm
from app.cli.terminal import echo
from app.errors import counted, list_names

if TYPE_CHECKING:
    from thermap.answers import MachineAnswer, NeededAnswer, SensorSchema

machines = command_group()

SETTINGS: Final = (
    *("name", "serial_number", "configuration", "out_of_range", "extrapolation_margin_c"),
    *("extrapolation_error_ratio", "same_temperature"),
    "axes.AXIS.min_mm",
    "axes.AXIS.max_mm",
    "sensors.SENSOR.FIELD",
)
"""What `thermap machines set` changes."""

_WORDS: Final = (
    *("name", "serial_number", "configuration", "out_of_range", "same_temperature"),
    "stand_in",
)
"""Settings that are words, also where they look like numbers."""


@machines.command("list")
@asks
def list_machines() -> Shown:
    """List all machines.

    Example: `thermap machines list`
    """
    return Shown(calls.machines(), machines_view)


@machines.command("show")
@asks
def show_machine(machine: MachineArgument) -> Shown:
    """Show a machine: its axes, its sensors, what happens outside its maps.

    Example: `thermap machines show vmc`
    """
    return Shown(calls.machine(machine), machine_view)


@machines.command("needs")
@asks
def needed_components(
    machine: MachineArgument,
    preset: Annotated[
        str | None,
        typer.Option(
            metavar="KIND",
            help="A kind of machine that is not rigid: horizontal-counterweight or large-gantry.",
        ),
    ] = None,
    tool_length: Annotated[
        float, typer.Option(metavar="MM", help="Tool offset along z [mm].")
    ] = 0.0,
) -> Shown:
    """List the errors that have to be measured, and which of them the model lacks.

    Example: `thermap machines needs vmc --preset large-gantry`
    """
    return Shown(calls.needed_components(machine, preset, tool_length), needed_view)


@machines.command("set")
@asks
def set_machine(
    thermap: ThermapClient,
    machine: MachineArgument,
    changes: Annotated[
        list[str], typer.Argument(metavar="KEY=VALUE…", help="Settings and their new values.")
    ],
) -> Shown:
    """Change settings of a machine; all of them or, if one is wrong, none.

    Keys: `name`, `serial_number`, `configuration`, `out_of_range` (clamp, extrapolate, reject),
    `extrapolation_margin_c`, `extrapolation_error_ratio`, `same_temperature`, `axes.x.min_mm`,
    `axes.x.max_mm`, and of each sensor `sensors.NAME.stand_in`, `….min_c`, `….max_c`,
    `….max_age_s` and so on, as `thermap machines show` lists them. A value `null` takes away.

    Example: `thermap machines set vmc out_of_range=extrapolate sensors.x-middle.max_age_s=60`
    """
    patch = patch_of(thermap.machine(machine), changes)
    return Shown(calls.change_machine(machine, patch), machine_view)


@machines.command("delete")
@asks
def delete_machine(
    thermap: ThermapClient, machine: MachineArgument, yes: YesOption = False
) -> None:
    """Delete a machine with all its maps, models, readings and verifications.

    Example: `thermap machines delete vmc`
    """
    present = thermap.machine(machine)
    maps = counted(len(thermap.error_maps(machine)), "error map")
    confirm(
        f"machine {machine!r} was not deleted",
        f"Delete {machine!r} ({present.name}) with {maps}, all model versions, readings, "
        "verifications and analyses?",
        yes=yes,
    )
    thermap.delete_machine(machine)
    echo(f"machine {machine!r} deleted")


def machines_view(answers: Sequence[MachineAnswer]) -> RenderableType:
    """Lay out all machines."""
    table = listing("machine", "name", "configuration", "sensors", "model", "watch", right="lllrrl")
    for machine in answers:
        model = "–" if machine.active_model is None else str(machine.active_model)
        sensors = str(len(machine.sensors))
        table.add_row(
            machine.id, machine.name, machine.configuration, sensors, model, machine.watch or "–"
        )
    return or_nothing(table, "no machine is stored yet; `thermap import machine.json` stores one")


def machine_view(machine: MachineAnswer) -> RenderableType:
    """Lay out one machine."""
    margin = (
        f" up to {machine.extrapolation_margin_c:g} °C beyond, as long as the standard error stays "
        f"below {machine.extrapolation_error_ratio:g} times the maps' own "
        "(extrapolation_error_ratio)"
    )
    head = facts(
        ("machine", machine.id),
        ("name", machine.name),
        ("serial number", machine.serial_number or "–"),
        ("configuration", machine.configuration),
        (
            "axes",
            ", ".join(f"{a} {t.min_mm:g} to {t.max_mm:g} mm" for a, t in machine.axes.items()),
        ),
        (
            "outside maps",
            machine.out_of_range + (margin if machine.out_of_range == "extrapolate" else ""),
        ),
        ("same temperature", machine.same_temperature),
        ("active model", "none yet" if machine.active_model is None else str(machine.active_model)),
        ("watch", machine.watch or "not judged yet"),
        ("created", f"{when(machine.created_at)} UTC"),
    )
    return Group(head, Text(), or_nothing(_sensors(machine.sensors), "no sensors"))


def needed_view(found: NeededAnswer) -> RenderableType:
    """Lay out what has to be measured."""
    kind = "a rigid machine"
    if found.preset is not None:
        kind = f"{found.preset.name}: {found.preset.reason} ({found.preset.equations})"
    table = listing("component", "chapter", "group", "unit", "in the model")
    for component in found.components:
        table.add_row(
            component.component,
            component.chapter,
            component.kind,
            component.unit,
            "yes" if component.in_model else "missing",
        )
    needed = counted(len(found.components), "component")
    counts = f"{needed} to be measured, {len(found.missing)} missing"
    head = Text(f"{found.machine}, {found.configuration}; {kind}\n{counts}\n")
    warnings = [Text(f"! {warning}", style="yellow") for warning in found.warnings]
    return Group(head, table, *warnings)


def _sensors(sensors: Iterable[SensorSchema]) -> Any:
    table = listing(
        *("sensor", "stand_in", "min_c\n[°C]", "max_c\n[°C]", "max_\nage_s\n[s]"),
        *("resolution_\nc\n[°C]", "stuck_\nafter_s\n[s]", "max_rate_\nc_per_min\n[°C/min]"),
        right="llrrrrrr",
    )
    for sensor in sensors:
        numbers = (sensor.min_c, sensor.max_c, sensor.max_age_s, sensor.resolution_c)
        stuck = "–" if sensor.stuck_after_s is None else f"{sensor.stuck_after_s:g}"
        cells = [f"{number:g}" for number in numbers]
        table.add_row(
            sensor.name, sensor.stand_in or "–", *cells, stuck, f"{sensor.max_rate_c_per_min:g}"
        )
    return table


def patch_of(machine: MachineAnswer, settings: Iterable[str]) -> dict[str, Any]:
    """Write the changes of `KEY=VALUE` for a machine as it is now.

    Raises
    ------
    typer.BadParameter
        If there is no such setting, axis or sensor.
    """
    patch: dict[str, Any] = {}
    for text in settings:
        key, equals, written = (part.strip() for part in text.partition("="))
        first, *further = key.split(".")
        if not equals or first not in {key.partition(".")[0] for key in SETTINGS}:
            raise _unknown(text)
        if first == "axes" and len(further) == 2 and further[1] in ("min_mm", "max_mm"):
            axes = patch.setdefault("axes", {})
            present = machine.axes.get(further[0])
            axis = axes.setdefault(further[0], present.model_dump() if present else {})
            axis[further[1]] = _value(further[1], written)
        elif first == "sensors" and len(further) >= 2:
            sensors = patch.setdefault(
                "sensors", [sensor.model_dump() for sensor in machine.sensors]
            )
            sensor = _sensor_in(sensors, ".".join(further[:-1]), text)
            if further[-1] not in sensor or further[-1] == "name":
                raise _unknown(text, list_names(sorted(sensor.keys() - {"name"})))
            sensor[further[-1]] = _value(further[-1], written)
        elif not further and first not in ("axes", "sensors"):
            patch[first] = _value(first, written)
        else:
            raise _unknown(text)
    return patch


def _sensor_in(sensors: Iterable[dict[str, Any]], name: str, text: str) -> dict[str, Any]:
    for sensor in sensors:
        if sensor["name"] == name:
            return sensor
    names = list_names(sensor["name"] for sensor in sensors)
    raise typer.BadParameter(
        f"expected one of the sensors {names}, got {text!r}", param_hint="KEY=VALUE"
    )


def _unknown(text: str, allowed: str = "") -> typer.BadParameter:
    expected = allowed or list_names(SETTINGS)
    return typer.BadParameter(
        f"expected KEY=VALUE with one of {expected}, got {text!r}", param_hint="KEY=VALUE"
    )


def _value(field: str, written: str) -> Any:
    """Read a value as JSON has it; a word, or what is none of JSON's, is text."""
    if written == "null":
        return None
    if field in _WORDS:
        return written
    try:
        return json_text.loads(written)
    except ValueError:
        return written
