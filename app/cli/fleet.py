"""thermap analyse --fleet: every machine of a service analysed, and what that says together.

The analyses are jobs of the service, and stay. Asked again, those that asked the same of the same
model and verifications serve, whether they are done or go on: so what was interrupted goes on.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

import typer
from pydantic import TypeAdapter
from rich.progress import MofNCompleteColumn, Progress, TaskID, TimeElapsedColumn

from app.cli.answers import listing
from app.cli.console import console, progress_bar
from app.cli.options import write_file
from app.cli.terminal import echo, write_json
from app.errors import list_names
from app.identification.fleet import FleetJudgement
from app.pages.fleet_report import fleet_report
from app.pages.report_parts.words import sentence
from app.services.fleet import GOING_ON, FleetView
from thermap import ServiceUnavailableError, ThermapClient, loop_calls
from thermap.call import Call

POLL_S: Final = 0.5
ROOM_S: Final = 5.0
"""When a service whose queue is full is asked again [s]."""

_VIEW: Final = TypeAdapter(FleetView)
_JUDGEMENT: Final = TypeAdapter(FleetJudgement)


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
    try:
        judgement = _judged(thermap, _question(effects, holdout))
    except KeyboardInterrupt:
        echo(
            "interrupted: the analyses that were asked for go on. The same command continues "
            "with them; with --cancel it ends them",
            err=True,
        )
        raise typer.Exit(130) from None
    if json:
        write_json(_JUDGEMENT.dump_json(judgement))
    else:
        _show(judgement)
    if output is not None:
        write_file(output, fleet_report(judgement))
        echo(f"{output}: the report of {len(judgement.machines)} machines", err=True)


def cancel_every_analysis(
    thermap: ThermapClient, *, effects: Sequence[str] | None, holdout: float
) -> None:
    """Cancel the analyses of a fleet that wait or run."""
    answer = _read(thermap, loop_calls.cancel_fleet(_question(effects, holdout)))
    _say_refused(answer)
    words = f"cancelled: {list_names(answer.done)}" if answer.done else "nothing was going on"
    echo(words, err=True)


def _question(effects: Sequence[str] | None, holdout: float) -> dict[str, Any]:
    return {"effects": None if effects is None else list(effects), "holdout_fraction": holdout}


def _read(thermap: ThermapClient, call: Call[Any]) -> FleetView:
    """Read an answer with the application's own shapes, which the report is written from."""
    return _VIEW.validate_json(thermap.content(call))


def _say_refused(answer: FleetView) -> None:
    for machine, why in answer.refused.items():
        echo(f"{machine}: {why}", err=True)


def _judged(thermap: ThermapClient, question: Mapping[str, Any]) -> FleetJudgement:
    """Ask for what is missing, and follow it until there is a judgement."""
    with progress_bar(MofNCompleteColumn(), TimeElapsedColumn()) as progress:
        task = progress.add_task("analysing", total=None)
        while True:
            answer = _read(thermap, loop_calls.analyse_fleet(question))
            judged = _follow(thermap, question, answer, progress, task)
            if not answer.queue_full:
                _say_refused(answer)
                return judged
            progress.update(task, description="waiting: too many analyses wait")
            time.sleep(ROOM_S)


def _follow(
    thermap: ThermapClient,
    question: Mapping[str, Any],
    answer: FleetView,
    progress: Progress,
    task: TaskID,
) -> FleetJudgement:
    """Look at it until nothing goes on; a service that is away for a while is waited for."""
    call = loop_calls.fleet(question["effects"], question["holdout_fraction"])
    while answer.judgement is None:
        if answer.wanted:
            words, total, done = "trying on sisters", answer.wanted, answer.tried
        else:
            total = len(answer.machines)
            words, done = "analysing", total - len(_going_on(answer))
        progress.update(task, description=words, total=total, completed=done)
        time.sleep(POLL_S)
        with suppress(ServiceUnavailableError):
            answer = _read(thermap, call)
    return answer.judgement


def _going_on(answer: FleetView) -> list[str]:
    """List the machines whose analysis waits or runs."""
    jobs = [(machine.machine, machine.analysis) for machine in answer.machines]
    return [machine for machine, job in jobs if job is not None and job.status in GOING_ON]


def _show(judgement: FleetJudgement) -> None:
    """Write the findings for a person."""
    terminal = console()
    terminal.print(judgement.summary)
    table = listing("machine", "verdict", "drifts", "found")
    for machine in judgement.machines:
        outcome = machine.why_not or "; ".join(machine.found) or "–"
        table.add_row(
            machine.machine,
            machine.verdict or "not judged",
            "yes" if machine.drifts else "–",
            outcome,
        )
    terminal.print(table)
    for effect in judgement.effects:
        terminal.print(f"\n{sentence(effect.explanation)}\n  {effect.summary}")
        for trial in effect.tried_on:
            terminal.print(f"  {trial.machine}: {trial.result.verdict}; {trial.result.reason}")
