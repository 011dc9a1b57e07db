"""thermap maps: list, show and delete error maps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Group, RenderableType
from rich.text import Text

from app.cli.answers import facts, listing, or_nothing, temperatures, when
from app.cli.asking import ChosenMachine, Shown, ThermapClient, asks, calls
from app.cli.models import preview_lines
from app.cli.options import YesOption, command_group, confirm
from app.cli.terminal import echo
from app.errors import list_names

if TYPE_CHECKING:
    from thermap.answers import ErrorMapAnswer


maps = command_group()

NumberArgument = Annotated[int, typer.Argument(metavar="NUMBER", help="The map's number.")]


@maps.command("list")
@asks
def list_maps(machine: ChosenMachine) -> Shown:
    """List a machine's error maps in the order in which they were stored.

    Example: `thermap maps list --machine vmc`
    """
    return Shown(calls.error_maps(machine), maps_view)


@maps.command("show")
@asks
def show_map(number: NumberArgument, machine: ChosenMachine) -> Shown:
    """Show an error map: when and how it was measured, at which temperatures, what came out.

    Example: `thermap maps show 2 --machine vmc`
    """
    return Shown(calls.error_map(machine, number), map_view)


@maps.command("delete")
@asks
def delete_map(
    thermap: ThermapClient, number: NumberArgument, machine: ChosenMachine, yes: YesOption = False
) -> None:
    """Take an error map out of use; model versions that were made with it keep it.

    It says before what tables would lose and by how much they would change.

    Example: `thermap maps delete 2 --machine vmc`
    """
    label = thermap.error_map(machine, number).label
    for line in preview_lines(thermap.preview_map_deletion(machine, number)):
        echo(f"without {label!r} tables {line}", err=True)
    confirm(
        f"error map {label!r} was not deleted",
        f"Take error map {label!r} (number {number}) of {machine!r} out of use?",
        yes=yes,
    )
    thermap.delete_error_map(machine, number)
    active = thermap.machine(machine).active_model
    echo(f"error map {label!r} is out of use; the active model version is {active}")


def maps_view(found: Sequence[ErrorMapAnswer]) -> RenderableType:
    """Lay out all maps."""
    table = listing("no.", "label", "measured [UTC]", "in use", "components", right="rllll")
    for error_map in found:
        components = list_names([c.component for c in error_map.components])
        in_use = "yes" if error_map.in_active_model else "no"
        table.add_row(
            str(error_map.id), error_map.label, when(error_map.measured_at), in_use, components
        )
    return or_nothing(table, "no error map is stored yet; `thermap import run1.csv` stores one")


def map_view(error_map: ErrorMapAnswer) -> RenderableType:
    """Lay out one map."""
    from app.cli.measurement_view import components_table  # it needs numpy; completion does not

    rows = [
        ("error map", f"{error_map.label}, number {error_map.id}"),
        ("measured", f"{when(error_map.measured_at)} UTC"),
        ("stored", f"{when(error_map.stored_at)} UTC"),
        ("in use", "yes" if error_map.in_active_model else "no, the active model is without it"),
        ("temperatures [°C]", temperatures(error_map.temperatures_c)),
    ]
    if error_map.instrument:
        rows.append(("instrument", error_map.instrument))
    if error_map.repeatability_um is not None:
        rows.append(("repeatability", f"{error_map.repeatability_um:g} µm"))
    return Group(facts(*rows), Text(), components_table(error_map.components))
