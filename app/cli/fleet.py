"""thermap analyse --fleet: every machine of a service analysed, and what that says together.

The analyses are jobs of the service, and stay. Asked again, those that asked the same of the same
model and verifications serve, whether they are done or go on: so what was interrupted goes on.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import typer
from pydantic import TypeAdapter
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from app.api.schemas import analyses
from app.cli.options import write_file
from app.identification.analysis.tried_effect import TriedEffect
from app.identification.fleet import FleetJudgement, Member, Trial, judge_fleet, trials
from app.pages.fleet_report import fleet_report
from app.pages.report_parts.words import sentence
from thermap import (
    ServiceUnavailableError,
    ThermapClient,
    ThermapClientError,
    TooManyRequestsError,
    loop_calls,
)
from thermap.answers import AnalysisHead, MachineAnswer

POLL_S: Final = 0.5
ROOM_S: Final = 5.0
"""When a service whose queue is full is asked again [s]."""

LOOKED_AT: Final = 20
"""So many analyses are looked at between two pauses: a service runs few at a time."""

_GOING_ON: Final = ("queued", "running")
_TRIED: Final = TypeAdapter(TriedEffect)
_JUDGEMENT: Final = TypeAdapter(FleetJudgement)


@dataclass(frozen=True)
class _Asked:
    """A machine, its verifications, and its analysis as far as there is one."""

    member: Member
    verifications: list[int]
    job: AnalysisHead | None = None


def judge_every_machine(
    thermap: ThermapClient,
    *,
    effects: Sequence[str] | None,
    holdout: float,
    output: Path | None,
    json: bool,
) -> None:
    """Analyse every machine, try on sisters what was found, and show it on one page.

    Ctrl-C leaves the analyses to the service; the same command goes on with them.
    """
    question = {"holdout_fraction": holdout, "effects": None if effects is None else list(effects)}
    try:
        judgement = _judged(thermap, question)
    except KeyboardInterrupt:
        typer.echo("interrupted: what was asked for goes on, and the same again goes on", err=True)
        raise typer.Exit(130) from None
    if json:
        typer.echo(_JUDGEMENT.dump_json(judgement).decode())
    else:
        _show(judgement)
    if output is not None:
        write_file(output, fleet_report(judgement))
        typer.echo(f"{output}: the report of {len(judgement.machines)} machines", err=True)


def _judged(thermap: ThermapClient, question: dict[str, Any]) -> FleetJudgement:
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    console = Console(stderr=True)
    with Progress(
        *columns, TimeElapsedColumn(), console=console, disable=not console.is_terminal
    ) as progress:
        machines = thermap.machines()
        asking = progress.add_task("asking", total=len(machines))
        asked = []
        for machine in machines:
            asked.append(_ask(thermap, machine, question))
            progress.advance(asking)
        analysing = progress.add_task("analysing", total=len(machines))
        done = []
        for one in _ended(thermap, asked):
            done.append(one)
            progress.advance(analysing)
        order = [machine.id for machine in machines]
        done.sort(key=lambda one: order.index(one.member.id))
        members = [one.member for one in done]
        verifications = {one.member.id: one.verifications for one in done}
        wanted = trials(members)
        trying = progress.add_task("trying on sisters", total=len(wanted))
        tried = {}
        for trial in wanted:
            tried[trial] = _try(thermap, trial, verifications[trial.on], len(wanted))
            progress.advance(trying)
    return judge_fleet(members, tried)


def _ask(thermap: ThermapClient, machine: MachineAnswer, question: dict[str, Any]) -> _Asked:
    """Ask for a machine's analysis, or find the one that asked the same."""
    member = _member(machine)
    if machine.active_model is None:
        return _Asked(replace(member, why_not="it has no model yet"), [])
    numbers = [one.id for one in thermap.verifications(machine.id)]
    if not numbers:
        return _Asked(replace(member, why_not="nothing was measured to judge it by"), [])
    member = replace(member, has_verifications=True)
    for job in reversed(thermap.analyses(machine.id)):
        same = (job.model_version, job.verifications, job.holdout_fraction, job.effects, job.seed)
        wanted = (machine.active_model, numbers, question["holdout_fraction"], question["effects"])
        if same == (*wanted, 0) and job.status in (*_GOING_ON, "done"):
            return _Asked(member, numbers, job)
    while True:
        try:
            job = thermap.analyse(machine.id, {"verifications": numbers, **question})
        except (TooManyRequestsError, ServiceUnavailableError):
            time.sleep(ROOM_S)
        except ThermapClientError as error:
            return _Asked(replace(member, why_not=error.sentence), numbers)
        else:
            return _Asked(member, numbers, job)


def _member(machine: MachineAnswer) -> Member:
    travels = sorted((axis, t.min_mm, t.max_mm) for axis, t in machine.axes.items())
    sensors = sorted(sensor.name for sensor in machine.sensors)
    likeness = (machine.configuration, tuple(travels), tuple(sensors))
    return Member(machine.id, machine.name, likeness, machine.watch)


def _ended(thermap: ThermapClient, asked: Iterable[_Asked]) -> Iterator[_Asked]:
    """Give each machine as its analysis has ended, in the order in which they do."""
    going_on = []
    for one in asked:
        if one.job is None:
            yield one
        else:
            going_on.append(one)
    while going_on:
        looked_at, going_on = going_on[:LOOKED_AT], going_on[LOOKED_AT:]
        still = []
        for one in looked_at:
            found = _result(thermap, one)
            if found is None:
                still.append(one)
            else:
                yield found
        going_on = still + going_on
        if len(still) == len(looked_at):
            time.sleep(POLL_S)


def _result(thermap: ThermapClient, one: _Asked) -> _Asked | None:
    """Read an analysis that has ended; None where it goes on."""
    assert one.job is not None
    try:
        content = thermap.content(loop_calls.analysis(one.member.id, one.job.id))
    except ServiceUnavailableError:
        return None
    except ThermapClientError as error:
        return replace(one, member=replace(one.member, why_not=error.sentence))
    job = analyses.AnalysisAnswer.model_validate_json(content, extra="ignore")
    if job.status in _GOING_ON:
        return None
    why_not = None if job.result else f"analysis {job.id} {job.status}: {job.message}"
    member = replace(one.member, analysis=job.id, result=job.result, why_not=why_not)
    return replace(one, member=member)


def _try(
    thermap: ThermapClient, trial: Trial, verifications: list[int], together: int
) -> TriedEffect:
    question = {
        "machine": trial.machine,
        "analysis": trial.analysis,
        "effect": trial.effect,
        "on": trial.on,
        "verifications": verifications,
        "tried_together": together,
    }
    return _TRIED.validate_json(thermap.content(loop_calls.try_effect(question)))


def _show(judgement: FleetJudgement) -> None:
    """Write the findings for a person."""
    console = Console(highlight=False)
    console.print(judgement.summary)
    table = Table("machine", "verdict", "drifts", "found", box=None, pad_edge=False)
    for machine in judgement.machines:
        found = machine.why_not or "; ".join(machine.found) or "–"
        table.add_row(
            machine.machine,
            machine.verdict or "not judged",
            "yes" if machine.drifts else "–",
            found,
        )
    console.print(table)
    for effect in judgement.effects:
        console.print(f"\n{sentence(effect.explanation)}\n  {effect.summary}")
        for one in effect.tried_on:
            console.print(f"  {one.machine}: {one.result.verdict}; {one.result.reason}")
