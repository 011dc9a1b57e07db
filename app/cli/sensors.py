"""thermap sensors: which sensor each component follows, and which the maps speak for."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Group, RenderableType
from rich.text import Text

from app.cli.answers import followed_sensors, listing, or_nothing, shell_words, show
from app.cli.asking import ChosenMachine, Shown, ThermapClient, asks, calls
from app.cli.models import waiting_lines
from app.cli.options import JsonOption, Named, command_group, named
from app.cli.terminal import echo
from app.errors import list_names

if TYPE_CHECKING:
    from thermap.answers import CorrelationAnswer, ProposalAnswer, WaitingAssignmentAnswer

sensors = command_group()


@sensors.command("show")
@asks
def show_assignment(machine: ChosenMachine) -> Shown:
    """Show which sensor each component of the active model follows.

    Example: `thermap sensors show --machine vmc`
    """
    return Shown(calls.sensor_assignment(machine), assignment_view)


@sensors.command("assign")
@asks
def assign_sensors(
    thermap: ThermapClient,
    assignment: Annotated[
        Named,
        typer.Argument(
            metavar="COMPONENT=SENSOR…",
            parser=named("COMPONENT=SENSOR such as EXX=x-middle", first=True),
            help="Such as EXX=x-middle or E*X=bed; others stay.",
        ),
    ],
    machine: ChosenMachine,
    json: JsonOption = False,
) -> None:
    """Let components follow other sensors; this makes the next model version.

    `E*X` stands for all components of the maps whose code fits.

    Example: `thermap sensors assign "E*X=x-middle" EZZ=z-column --machine vmc`
    """
    call = calls.assign_sensors(machine, assignment)
    show(thermap, call, lambda answer: assigned_view(answer, machine), json=json)
    if not json:
        active = thermap.machine(machine).active_model
        echo(f"\nthe active model version of {machine!r} is {active}")


@sensors.command("correlate")
@asks
def correlate_sensors(
    thermap: ThermapClient,
    machine: ChosenMachine,
    apply: Annotated[
        bool, typer.Option("--apply", help="Assign the sensors that are proposed.")
    ] = False,
) -> Shown | None:
    """Show which sensors the maps themselves speak for; nothing is changed without `--apply`.

    Where the maps do not tell sensors apart, a component keeps the one that it follows; one that
    follows none is given the first of the best.

    Example: `thermap sensors correlate --apply --machine vmc`
    """
    if not apply:
        return Shown(calls.correlate_sensors(machine), correlation_view)
    proposed = {
        proposal.component: proposal.proposed
        for proposal in thermap.correlate_sensors(machine).components
        if proposal.proposed not in (None, proposal.current)
    }
    if not proposed:
        echo("nothing to assign: every component follows the sensor that the maps speak for")
        return None
    return Shown(
        calls.assign_sensors(machine, proposed), lambda answer: assigned_view(answer, machine)
    )


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
