"""thermap sensors: which sensor each component follows, and which the maps speak for."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Group, RenderableType
from rich.text import Text

from app.cli.answers import (
    followed_sensors,
    listing,
    or_nothing,
    shell_words,
    show,
    show_of_machine,
)
from app.cli.models import waiting_lines
from app.cli.options import (
    JsonOption,
    MachineOption,
    UrlOption,
    chosen_machine,
    command_group,
    connect,
)
from app.cli.terminal import echo
from app.errors import list_names
from thermap import DEFAULT_URL

if TYPE_CHECKING:
    from thermap.answers import CorrelationAnswer, ProposalAnswer, WaitingAssignmentAnswer

sensors = command_group()


@sensors.callback()
def _describe() -> None:
    """Show, assign and correlate the sensors that components follow."""


@sensors.command("show")
def show_assignment(
    machine: MachineOption = None, json: JsonOption = False, url: UrlOption = DEFAULT_URL
) -> None:
    """Show which sensor each component of the active model follows.

    Example: `thermap sensors show --machine vmc`
    """
    from thermap import calls

    show_of_machine(url, machine, calls.sensor_assignment, assignment_view, json=json)


@sensors.command("assign")
def assign_sensors(
    assignment: Annotated[
        list[str],
        typer.Argument(
            metavar="COMPONENT=SENSOR…", help="Such as EXX=x-middle or E*X=bed; others stay."
        ),
    ],
    machine: MachineOption = None,
    json: JsonOption = False,
    url: UrlOption = DEFAULT_URL,
) -> None:
    """Let components follow other sensors; this makes the next model version.

    `E*X` stands for all components of the maps whose code fits.

    Example: `thermap sensors assign "E*X=x-middle" EZZ=z-column --machine vmc`
    """
    from thermap import calls

    assigned = _read_assignment(assignment)
    with connect(url) as thermap:
        chosen = chosen_machine(thermap, machine)
        show(
            thermap,
            calls.assign_sensors(chosen, assigned),
            lambda answer: assigned_view(answer, chosen),
            json=json,
        )
        if not json:
            active = thermap.machine(chosen).active_model
            echo(f"\nthe active model version of {chosen!r} is {active}")


@sensors.command("correlate")
def correlate_sensors(
    machine: MachineOption = None,
    apply: Annotated[
        bool, typer.Option("--apply", help="Assign the sensors that are proposed.")
    ] = False,
    json: JsonOption = False,
    url: UrlOption = DEFAULT_URL,
) -> None:
    """Show which sensors the maps themselves speak for; nothing is changed without `--apply`.

    Where the maps do not tell sensors apart, a component keeps the one that it follows; one that
    follows none is given the first of the best.

    Example: `thermap sensors correlate --apply --machine vmc`
    """
    from thermap import calls

    if not apply:
        show_of_machine(url, machine, calls.correlate_sensors, correlation_view, json=json)
        return
    with connect(url) as thermap:
        chosen = chosen_machine(thermap, machine)
        proposals = thermap.send(calls.correlate_sensors(chosen)).components
        proposed = {
            proposal.component: proposal.proposed
            for proposal in proposals
            if proposal.proposed not in (None, proposal.current)
        }
        if not proposed:
            echo("nothing to assign: every component follows the sensor that the maps speak for")
            return
        show(
            thermap,
            calls.assign_sensors(chosen, proposed),
            lambda answer: assigned_view(answer, chosen),
            json=json,
        )


def _read_assignment(texts: list[str]) -> dict[str, str]:
    assignment: dict[str, str] = {}
    for text in texts:
        component, equals, sensor = (part.strip() for part in text.partition("="))
        if not component or not equals or not sensor:
            raise typer.BadParameter(
                f"expected COMPONENT=SENSOR such as EXX=x-middle, got {text!r}",
                param_hint="COMPONENT=SENSOR",
            )
        if component in assignment:
            raise typer.BadParameter(f"{component} is stated twice", param_hint="COMPONENT=SENSOR")
        assignment[component] = sensor
    return assignment


def assigned_view(
    answer: Mapping[str, str] | WaitingAssignmentAnswer, machine: str
) -> RenderableType:
    """Lay out what is assigned, and say so where tables do not follow it yet."""
    if isinstance(answer, Mapping):
        return assignment_view(answer)
    waiting = map(Text, waiting_lines(answer, machine))
    return Group(assignment_view(answer.assignment), Text(), *waiting)


def assignment_view(assignment: Mapping[str, str]) -> RenderableType:
    """Lay out which components follow which sensor."""
    table = followed_sensors(assignment, limit=100)
    return or_nothing(table, "no sensor is assigned to any component yet")


def correlation_view(correlations: CorrelationAnswer) -> RenderableType:
    """Lay out what the maps say about each component's sensor."""
    table = listing(
        "component", "follows", "proposed", "r", "95 % from, to", "maps", right="lllrrr"
    )
    for proposed in correlations.components:
        table.add_row(
            proposed.component,
            proposed.current or "–",
            proposed.proposed or "–",
            *_strength(proposed),
            str(proposed.maps),
        )
    reasons = [
        Text(f"{one.component}: {one.reason}", style="dim")
        for one in correlations.components
        if one.reason
    ]
    differing = [one for one in correlations.components if one.proposed not in (None, one.current)]
    advice = []
    if clear := [f"{one.component}={one.proposed}" for one in differing if not _ties(one)]:
        advice.append(f"\n`thermap sensors assign {shell_words(clear)}` assigns as proposed")
    if tied := [one.component for one in differing if _ties(one)]:
        advice.append(
            f"\nThe maps do not tell the sensors of {list_names(tied)} apart: assign the one that "
            f"is nearest to what heats it (`thermap sensors assign {tied[0]}=SENSOR …`)"
        )
    body = or_nothing(table, "no error map is stored yet")
    return Group(body, *reasons, *map(Text, advice))


def _ties(proposal: ProposalAnswer) -> bool:
    """Whether other sensors explain a component as well as the one that is proposed."""
    return sum(c.ties_with_best for c in proposal.correlations) > 1


def _strength(proposal: ProposalAnswer) -> tuple[str, str]:
    """Write r and its interval of the sensor that is proposed."""
    for c in proposal.correlations:
        if c.sensor == proposal.proposed and c.r is not None:
            low, high = c.confidence_95 or (None, None)
            interval = "–" if low is None or high is None else f"{low:+.2f}, {high:+.2f}"
            return f"{c.r:+.3f}", interval
    return "–", "–"
