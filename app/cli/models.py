"""thermap models: list, show, activate and compare model versions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Group, RenderableType
from rich.text import Text

from app.cli.answers import facts, listing, or_nothing, show, temperatures, when
from app.cli.model_change_view import difference_lines
from app.cli.options import (
    JsonOption,
    MachineOption,
    UrlOption,
    chosen_machine,
    command_group,
    connect,
)
from app.cli.verifications import VerificationsOption, chosen_verifications
from app.errors import counted, list_names
from thermap import DEFAULT_URL

if TYPE_CHECKING:
    from thermap.answers import ModelAnswer, ModelComparisonAnswer, SizeAnswer

models = command_group()

VersionArgument = Annotated[int, typer.Argument(metavar="VERSION", help="The version's number.")]


@models.callback()
def _describe() -> None:
    """List, show, activate and compare model versions."""


@models.command("list")
def list_models(
    machine: MachineOption = None, json: JsonOption = False, url: UrlOption = DEFAULT_URL
) -> None:
    """List a machine's model versions, oldest first.

    Example: `thermap models list --machine vmc`
    """
    from thermap import calls

    with connect(url) as thermap:
        call = calls.models(chosen_machine(thermap, machine))
        show(thermap, call, models_view, json=json)


@models.command("show")
def show_model(
    version: VersionArgument,
    machine: MachineOption = None,
    json: JsonOption = False,
    url: UrlOption = DEFAULT_URL,
) -> None:
    """Show a model version: its maps, which sensors components follow, adopted effects.

    Example: `thermap models show 3 --machine vmc`
    """
    from thermap import calls

    with connect(url) as thermap:
        call = calls.model(chosen_machine(thermap, machine), version)
        show(thermap, call, model_view, json=json)


@models.command("activate")
def activate_model(
    version: VersionArgument,
    machine: MachineOption = None,
    json: JsonOption = False,
    url: UrlOption = DEFAULT_URL,
) -> None:
    """Compute compensation tables with this version from now on.

    Example: `thermap models activate 2 --machine vmc`
    """
    from thermap import calls

    with connect(url) as thermap:
        chosen = chosen_machine(thermap, machine)
        show(
            thermap,
            calls.activate_model(chosen, version),
            lambda now: Group(
                Text(f"model version {now.version} of {chosen!r} is active: {now.reason}"),
                *map(Text, difference_lines(now)),
            ),
            json=json,
        )


@models.command("compare")
def compare_models(
    versions: Annotated[
        list[int], typer.Argument(metavar="VERSION VERSION…", help="Numbers of the versions.")
    ],
    verification: VerificationsOption = None,
    machine: MachineOption = None,
    json: JsonOption = False,
    url: UrlOption = DEFAULT_URL,
) -> None:
    """Hold model versions against the same verifications, and show what each leaves.

    Example: `thermap models compare 1 3 --machine vmc`
    """
    from thermap import loop_calls

    if len(versions) < 2:
        raise typer.BadParameter("expected two versions or more, came one", param_hint="VERSION")
    with connect(url) as thermap:
        chosen = chosen_machine(thermap, machine)
        verifications = chosen_verifications(thermap, chosen, verification)
        call = loop_calls.compare_models(chosen, verifications, versions)
        show(thermap, call, comparison_view, json=json)


def models_view(found: Sequence[ModelAnswer]) -> RenderableType:
    """Lay out all versions."""
    table = listing("version", "", "made [UTC]", "maps", "effects", "reason", right="rllrrl")
    for one in found:
        numbers = (str(len(one.maps)), str(len(one.effects)))
        table.add_row(str(one.version), _state(one), when(one.created_at), *numbers, one.reason)
    return or_nothing(table, "no model version yet: the first error map makes one")


def _state(one: ModelAnswer) -> str:
    return "active" if one.active else "waiting" if one.waiting else ""


def model_view(one: ModelAnswer) -> RenderableType:
    """Lay out one version."""
    head = facts(
        (
            "version",
            f"{one.version}{', active' if one.active else ', waiting' if one.waiting else ''}",
        ),
        ("made", f"{when(one.created_at)} UTC"),
        ("reason", one.reason),
    )
    maps = listing("map no.", "label", "temperatures [°C]", right="rll")
    for error_map in one.maps:
        maps.add_row(str(error_map.id), error_map.label, temperatures(error_map.temperatures_c))
    follows = listing("sensor", "is followed by")
    for sensor in dict.fromkeys(one.assignment.values()):
        components = [code for code, name in one.assignment.items() if name == sensor]
        follows.add_row(sensor, list_names(components))
    effects = [Text(f"adopted effect: {effect.explanation}") for effect in one.effects]
    return Group(head, Text(), maps, Text(), follows, *([Text(), *effects] if effects else []))


def comparison_view(found: ModelComparisonAnswer) -> RenderableType:
    """Lay out what each version leaves, RMS of each component side by side."""
    headings = [f"version {one.version}" + (" *" if one.active else "") for one in found.versions]
    right = "l" + "r" * len(headings) + "lr"
    table = listing("RMS of residuals", *headings, "unit", "values", right=right)
    for name, sizes in _sizes(found):
        first = sizes[0]
        cells = [f"{size.rms:.2f}" for size in sizes]
        table.add_row(name, *cells, first.unit, str(first.count))
    reasons = [Text(f"version {one.version}: {one.reason}", style="dim") for one in found.versions]
    of = list_names(map(str, found.verifications))
    told = Text(
        f"{counted(found.values, 'value')} that all of them can be held against; "
        f"verifications {of}; * is active"
    )
    return Group(table, Text(), told, *reasons)


def _sizes(found: ModelComparisonAnswer) -> Iterator[tuple[str, Sequence[SizeAnswer]]]:
    """Give each component's sizes in the order of the versions, all lengths last."""
    for i, size in enumerate(found.versions[0].components):
        yield size.component, [one.components[i] for one in found.versions]
    overall = [one.overall for one in found.versions if one.overall is not None]
    if len(overall) == len(found.versions):
        yield "all lengths", overall
