"""thermap models: list, show, activate and compare versions; what a new one does to the tables."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Annotated, Final

import typer
from rich.console import Group, RenderableType
from rich.text import Text

from app.cli.answers import (
    facts,
    followed_sensors,
    listing,
    or_nothing,
    temperatures,
    when,
)
from app.cli.asking import ChosenMachine, Shown, ThermapClient, asks, calls, loop_calls
from app.cli.options import VerificationsOption, chosen_verifications, command_group
from app.errors import counted, list_names
from app.pages.report_parts.words import sentence

if TYPE_CHECKING:
    from datetime import datetime

    from thermap.answers import (
        AdoptedEffectAnswer,
        ChangeThenAnswer,
        ComponentChangeAnswer,
        CoverageAnswer,
        ErrorMapAnswer,
        ModelAnswer,
        ModelChange,
        ModelComparisonAnswer,
        PreviewAnswer,
        SizeAnswer,
        WaitedBeforeAnswer,
    )


models = command_group()

VersionArgument = Annotated[int, typer.Argument(metavar="VERSION", help="The version's number.")]

MOST_CHANGES: Final = 4
"""Components whose change is named; the others change by less."""

MOST_SENSORS: Final = 4
"""Sensors whose temperature is named beside a change."""


@models.command("list")
@asks
def list_models(machine: ChosenMachine) -> Shown:
    """List a machine's model versions, oldest first.

    Example: `thermap models list --machine vmc`
    """
    return Shown(calls.models(machine), models_view)


@models.command("show")
@asks
def show_model(version: VersionArgument, machine: ChosenMachine) -> Shown:
    """Show a model version: its maps, which sensors components follow, adopted effects.

    Example: `thermap models show 3 --machine vmc`
    """
    return Shown(calls.model(machine, version), model_view)


@models.command("activate")
@asks
def activate_model(version: VersionArgument, machine: ChosenMachine) -> Shown:
    """Compute compensation tables with this version from now on.

    Example: `thermap models activate 2 --machine vmc`
    """
    return Shown(
        calls.activate_model(machine, version),
        lambda now: Group(
            Text(f"model version {now.version} of {machine!r} is active: {now.reason}"),
            *map(Text, difference_lines(now)),
        ),
    )


@models.command("compare")
@asks
def compare_models(
    thermap: ThermapClient,
    versions: Annotated[
        list[int], typer.Argument(metavar="VERSION VERSION…", help="Numbers of the versions.")
    ],
    machine: ChosenMachine,
    verification: VerificationsOption = None,
) -> Shown:
    """Hold model versions against the same verifications, and show what each leaves.

    Example: `thermap models compare 1 3 --machine vmc`
    """
    if len(versions) < 2:
        raise typer.BadParameter("expected two versions or more, got one", param_hint="VERSION")
    verifications = chosen_verifications(thermap, machine, verification)
    return Shown(loop_calls.compare_models(machine, verifications, versions), comparison_view)


def models_view(found: Sequence[ModelAnswer]) -> RenderableType:
    """Lay out all versions."""
    table = listing("version", "", "made [UTC]", "maps", "effects", "reason", right="rllrrl")
    for model in found:
        numbers = (str(len(model.maps)), str(len(model.effects)))
        table.add_row(
            str(model.version), _state(model), when(model.created_at), *numbers, model.reason
        )
    return or_nothing(table, "no model version yet: the first error map makes one")


def _state(model: ModelAnswer) -> str:
    return "active" if model.active else "waiting" if model.waiting else ""


def model_view(model: ModelAnswer) -> RenderableType:
    """Lay out one version."""
    head = facts(
        (
            "version",
            ", ".join(filter(None, (str(model.version), _state(model)))),
        ),
        ("made", f"{when(model.created_at)} UTC"),
        ("reason", model.reason),
    )
    maps = listing("map no.", "label", "temperatures [°C]", right="rll")
    for error_map in model.maps:
        maps.add_row(str(error_map.id), error_map.label, temperatures(error_map.temperatures_c))
    follows = followed_sensors(model.assignment)
    effects = [
        Text(f"adopted effect: {sentence(effect.explanation)}{_origin(effect)}")
        for effect in model.effects
    ]
    return Group(head, Text(), maps, Text(), follows, *([Text(), *effects] if effects else []))


def _origin(effect: AdoptedEffectAnswer) -> str:
    """Say which analysis found an effect, and which have fitted it anew."""
    if effect.found_by is None:
        return ""
    anew = list_names(map(str, effect.refitted_by), 6)
    return f" (found by analysis {effect.found_by}{f', refitted by {anew}' if anew else ''})"


def comparison_view(comparison: ModelComparisonAnswer) -> RenderableType:
    """Lay out what each version leaves, RMS of each component side by side."""
    headings = [
        f"version {version.version}" + (" *" if version.active else "")
        for version in comparison.versions
    ]
    right = "l" + "r" * len(headings) + "lr"
    table = listing("RMS of residuals", *headings, "unit", "values", right=right)
    for name, sizes in _sizes(comparison):
        first = sizes[0]
        cells = [f"{size.rms:.2f}" for size in sizes]
        table.add_row(name, *cells, first.unit, str(first.count))
    reasons = [
        Text(f"version {version.version}: {version.reason}", style="dim")
        for version in comparison.versions
    ]
    denied = [
        Text(f"! version {version.version}: {version.contradiction}", style="yellow")
        for version in comparison.versions
        if version.contradiction
    ]
    of = list_names(map(str, comparison.verifications))
    summary = Text(
        f"{counted(comparison.values, 'value')} that can be compared with all of them; "
        f"verifications {of}; * is active"
    )
    return Group(table, Text(), summary, *reasons, *denied)


def _sizes(comparison: ModelComparisonAnswer) -> Iterator[tuple[str, Sequence[SizeAnswer]]]:
    """Give each component's sizes in the order of the versions, all lengths last."""
    for i, size in enumerate(comparison.versions[0].components):
        yield size.component, [version.components[i] for version in comparison.versions]
    overall = [version.overall for version in comparison.versions if version.overall is not None]
    if len(overall) == len(comparison.versions):
        yield "all lengths", overall


def preview_lines(preview: PreviewAnswer) -> Iterator[str]:
    """Say what tables would lose and gain, and by how much they would change now."""
    before = preview.waited_before
    yield from (f"would lose {text}" for text in _together(_new(preview.loses, before)))
    if before is not None and before.loses:
        yield f"{_waited(before)}, and would lose {'; '.join(_together(before.loses))}"
    yield from (f"would gain {text}" for text in _together(preview.gains))
    changes = [change for change in preview.changes if change.change]
    if changes:
        named = list_names(map(_change_text, changes), MOST_CHANGES)
        yield f"would change the errors at the latest reading: {named}"
    if preview.recorded.changes:
        of = counted(preview.recorded.count, "recorded reading")
        named = "; ".join(_changes_then(preview.recorded.changes[:MOST_CHANGES]))
        remaining = len(preview.recorded.changes) - MOST_CHANGES
        more = f"; and {remaining} more by less" if remaining > 0 else ""
        yield f"would have changed the errors at the worst of {of} by more: {named}{more}"


def difference_lines(change: ModelChange) -> Iterator[str]:
    """Say what tables have lost and gained."""
    yield from (f"tables lose {text}" for text in _together(change.loses))
    yield from (f"tables gain {text}" for text in _together(change.gains))


def waiting_lines(
    change: ModelChange | ErrorMapAnswer, machine: str, stored: int | None = None
) -> Iterator[str]:
    """Say that a version waits, and what can be done about it; nothing where none does.

    Parameters
    ----------
    stored
        Number of the map that was stored, where one was.
    """
    if change.activated is not False or change.model_version is None:
        return
    before = change.waited_before
    new = _together(_new(change.loses, before))
    reasons = [f"they would lose {'; '.join(new)}"] if new else []
    if before is not None and before.loses:
        reasons.append(f"{_waited(before)}, and would lose {'; '.join(_together(before.loses))}")
    yield (
        f"model version {change.model_version} waits and tables stay as they are, because "
        f"{'; and '.join(reasons)}"
    )
    culprits = {m.id: f"map {m.label!r}" for m in before.maps} if before and before.loses else {}
    if new and stored is not None:
        culprits[stored] = "the new map"
    ways = [f"`thermap models activate {change.model_version} --machine {machine}` activates it "]
    ways[0] += "all the same"
    ways += [
        f"`thermap maps delete {number} --machine {machine}` takes {what} out of it"
        for number, what in culprits.items()
    ]
    if change.stays_active is not None:
        again = f"`thermap models activate {change.stays_active} --machine {machine}`"
        ways.append(f"{again} gives up all that waits")
    yield f"{'; '.join(ways)}; what is stored meanwhile is added to it"


def _waited(before: WaitedBeforeAnswer) -> str:
    """Say which version waits already, and by which maps it differs."""
    maps = f", with {list_names(f'map {m.label!r}' for m in before.maps)}" if before.maps else ""
    return f"version {before.model_version} waits already{maps}"


def _new(
    loses: Iterable[CoverageAnswer], before: WaitedBeforeAnswer | None
) -> list[CoverageAnswer]:
    """Pick the losses that are not the doing of what waited already."""
    inherited = () if before is None else before.loses
    return [part for part in loses if part not in inherited]


def _together(parts: Iterable[CoverageAnswer]) -> list[str]:
    """Write each part once for all components of which the same is true."""
    codes: dict[str, list[str]] = {}
    for part in parts:
        pattern = part.text.replace(part.component, "{}") if part.component else part.text
        codes.setdefault(pattern, []).append(part.component or "")
    return [pattern.replace("{}", _names(codes[pattern])) for pattern in codes]


def _names(codes: Sequence[str]) -> str:
    return list_names(codes, 30)


def _changes_then(changes: Iterable[ChangeThenAnswer]) -> Iterator[str]:
    """Write recorded changes, those of one moment together."""
    of_moments: dict[datetime, list[ChangeThenAnswer]] = {}
    for change in changes:
        of_moments.setdefault(change.time, []).append(change)
    for time, then in of_moments.items():
        sensors = then[0].temperatures_c.items()
        at = list_names((f"{name} {value:.1f} °C" for name, value in sensors), MOST_SENSORS)
        yield f"{list_names(map(_change_text, then))} ({when(time)} UTC: {at})"


def _change_text(change: ComponentChangeAnswer) -> str:
    where = "" if change.position_mm is None else f" at {change.position_mm:g} mm"
    return f"{change.component} by {change.change:+.2f} {change.unit}{where}"
