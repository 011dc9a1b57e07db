"""thermap analyse: measured data in, what the model lacks out, as a report that a person reads."""

from __future__ import annotations

import signal
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Annotated, Final

import typer
from pydantic import TypeAdapter
from rich.progress import TaskProgressColumn, TimeElapsedColumn

from app.cli.analyse_view import analysis_view, plan_view
from app.cli.answers import show_view
from app.cli.asking import ThermapClient, asks
from app.cli.check_files import look_at_checks, look_at_visits, store_checks
from app.cli.console import console, progress_bar
from app.cli.fleet import cancel_every_analysis, judge_every_machine
from app.cli.models import preview_lines, waiting_lines
from app.cli.options import (
    ReportOption,
    VisitsOption,
    chosen_verifications,
    refuse_if,
    write_file,
)
from app.cli.terminal import echo, write_json
from app.errors import ThermapError, list_names
from app.identification.analysis.analysis import Analysis
from app.identification.plan.plan import Plan
from app.identification.plan.visit import NextVisit
from app.pages.report_parts.words import sentence
from app.storage.analysis_results import AnalysisWithResult
from thermap import ThermapClientError, loop_calls
from thermap.answers import VerificationPreview

_PLAN: Final = TypeAdapter(Plan)


class NotAnalysed(ThermapError):
    """The analysis came to no answer."""


class _Interrupted(Exception):
    """Ctrl-C was pressed while the analysis was waited for."""


@asks
def analyse(
    thermap: ThermapClient,
    machine: Annotated[
        str,
        typer.Argument(
            metavar="[MACHINE]",
            envvar="THERMAP_MACHINE",
            show_default=False,
            help="The machine's id; none with --fleet.",
        ),
    ] = "",
    verification: Annotated[
        list[Path] | None,
        typer.Option(
            "--verification",
            "-v",
            envvar="THERMAP_VERIFICATIONS",
            metavar="FILE",
            help=(
                "Measured data as CSV, or as JSON of the HTTP contract; repeat for each file. "
                "Without it, all stored verifications are used."
            ),
        ),
    ] = None,
    effects: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KIND",
            help=(
                "A kind of effect to look for, such as thermal-lag; repeat for more. Without it, "
                "all kinds."
            ),
        ),
    ] = None,
    holdout: Annotated[
        float,
        typer.Option(
            min=0.05, max=0.85, help="Share of the visits that take no part in the search."
        ),
    ] = 0.3,
    adopt: Annotated[
        bool,
        typer.Option(
            "--adopt", help="Make a model version with the effects that help on held-out visits."
        ),
    ] = False,
    plan: Annotated[
        bool,
        typer.Option(
            "--plan",
            help=(
                "Show what these observations could reveal before they are measured: the files "
                "need no values, and nothing is stored."
            ),
        ),
    ] = False,
    fleet: Annotated[
        bool,
        typer.Option(
            "--fleet",
            help=(
                "Analyse every machine from its stored verifications, and try what was found on "
                "its sister machines. After an interruption, the same command continues."
            ),
        ),
    ] = False,
    cancel: Annotated[
        bool,
        typer.Option(
            "--cancel",
            help="With --fleet: cancel its waiting and running analyses; finished ones stay.",
        ),
    ] = False,
    output: ReportOption = None,
    visits: VisitsOption = None,
    json: Annotated[bool, typer.Option("--json", help="Write the service's JSON.")] = False,
) -> None:
    """Find what the model lacks: compare it with measured data, and write a report.

    Example: `thermap analyse mcfv5050 --verification night-shift.csv -o report.html`
    """
    refuse_if(
        plan and (adopt or output is not None or visits is not None),
        "a plan has no report, no visits and nothing to adopt: leave out --adopt, --output and "
        "--visits",
        "--plan",
    )
    refuse_if(
        not fleet and not machine,
        "expected a machine's id, or --fleet for all of them, got none",
        "MACHINE",
    )
    refuse_if(
        fleet and (machine or verification or visits is not None or plan or adopt),
        "a fleet is judged by what is stored, and nothing is adopted: leave out MACHINE (and "
        "THERMAP_MACHINE), --verification, --visits, --plan and --adopt",
        "--fleet",
    )
    refuse_if(
        cancel and not fleet,
        "expected --fleet with it, got none; `thermap analyses cancel NUMBER --machine "
        "MACHINE` cancels one machine's analysis",
        "--cancel",
    )
    refuse_if(
        cancel and (json or output is not None),
        "there is no answer to show: leave out --json and --output",
        "--cancel",
    )
    if cancel:
        cancel_every_analysis(thermap, effects=effects, holdout=holdout)
        return
    if fleet:
        judge_every_machine(thermap, effects=effects, holdout=holdout, output=output, json=json)
        return
    # An unknown machine is told before anything is stored.
    thermap.machine(machine)
    if plan:
        _show_plan(thermap, machine, verification or [], json=json)
        return
    stored: list[int] = []
    read = look_at_checks(thermap, machine, verification or [])
    _expect_comparable(thermap, machine, [check for _, check in read])
    with _naming_what_is_stored(machine, stored):
        store_checks(thermap, read, stored)
        ids = stored or chosen_verifications(thermap, machine, None)
        question = {"verifications": ids, "holdout_fraction": holdout, "effects": effects}
        with _CtrlC() as ctrl_c:
            # Noted from here on: pressed before the answer comes, nobody would know which to
            # cancel.
            job = thermap.analyse(machine, question)
            _follow(thermap, machine, job.id, ctrl_c)
    content = thermap.content(loop_calls.analysis(machine, job.id))
    result = _result(content)
    if not json:
        show_view(analysis_view(result))
    try:
        if adopt:
            _adopt(thermap, machine, job.id, result)
            content = thermap.content(loop_calls.analysis(machine, job.id))
    finally:
        if json:
            write_json(content)
    if output is not None:
        write_file(output, thermap.analysis_report(machine, job.id))
        echo(f"{output}: the report of analysis {job.id}", err=True)
    if visits is not None:
        write_visits(thermap, visits, machine, job.id, result.next_visits)


def _result(content: bytes) -> Analysis:
    """Read what was found, of an analysis that is done, as the pages read it too."""
    result = TypeAdapter(AnalysisWithResult).validate_json(content).result
    if result is None:
        raise NotAnalysed("the analysis has no result")
    return result


@contextmanager
def _naming_what_is_stored(machine: str, stored: Sequence[int]) -> Iterator[None]:
    """Say of an analysis that came to nothing which verifications the service keeps."""
    try:
        yield
    except (ThermapError, ThermapClientError):
        if stored:
            echo(
                f"verification {list_names(map(str, stored))} stays stored; "
                f"`thermap verifications delete {stored[-1]} --machine {machine}` deletes it",
                err=True,
            )
        raise


def _show_plan(thermap: ThermapClient, machine: str, files: Sequence[Path], *, json: bool) -> None:
    """Ask what the files' observations, or those that are stored, could see."""
    visits = [visit.planned for visit in look_at_visits(thermap, machine, files)]
    question = (
        {"planned": visits}
        if visits
        else {"verifications": chosen_verifications(thermap, machine, None)}
    )
    call = loop_calls.plan_analysis(machine, question)
    with console(stderr=True).status("planning"):
        content = thermap.content(call)
    if json:
        write_json(content)
    else:
        show_view(plan_view(_PLAN.validate_json(content)))


def _expect_comparable(
    thermap: ThermapClient, machine: str, checks: Sequence[VerificationPreview]
) -> None:
    """Refuse before anything is stored what the model can be held against in nothing.

    Raises
    ------
    NotAnalysed
        With what the service says of it.
    """
    active = thermap.machine(machine).active_model
    covered = () if active is None else thermap.model_coverage(machine, active).components
    if checks and {*covered, "points"}.isdisjoint(c for check in checks for c in check.components):
        why = "; ".join(dict.fromkeys(words for check in checks for words in check.warnings))
        raise NotAnalysed(f"nothing was sent, as there is nothing to compare it with: {why}")


def _follow(thermap: ThermapClient, machine: str, analysis_id: int, ctrl_c: _CtrlC) -> None:
    """Show how far it is until it is done; Ctrl-C cancels it."""
    with progress_bar(TaskProgressColumn(), TimeElapsedColumn()) as progress:
        task = progress.add_task("waiting", total=1.0)

        def show(share: float, words: str) -> None:
            progress.update(task, completed=share, description=words)
            # Also where it is done by now: whoever interrupts wants nothing adopted.
            if ctrl_c.is_pressed:
                raise _Interrupted

        try:
            thermap.wait_for_analysis(machine, analysis_id, progress=show)
        except _Interrupted:
            _cancel(thermap, machine, analysis_id)
            raise typer.Exit(130) from None


class _CtrlC:
    """Notes that Ctrl-C was pressed; pressed again it interrupts as ever.

    Raised where an answer's shape is compiled, at the first answer, the interrupt would come out as
    an error of the shape.
    """

    def __init__(self) -> None:
        self.is_pressed = False

    def __enter__(self) -> _CtrlC:
        self._before = signal.signal(signal.SIGINT, self._press)
        return self

    def __exit__(self, *_: object) -> None:
        signal.signal(signal.SIGINT, self._before)

    def _press(self, *_: object) -> None:
        self.is_pressed = True
        signal.signal(signal.SIGINT, self._before)


def _cancel(thermap: ThermapClient, machine: str, analysis_id: int) -> None:
    outcome = f"analysis {analysis_id} was told to stop"
    with suppress(ThermapClientError):
        thermap.cancel_analysis(machine, analysis_id)
        outcome = f"analysis {analysis_id} cancelled"
    echo(outcome, err=True)


def _adopt(thermap: ThermapClient, machine: str, analysis_id: int, result: Analysis) -> None:
    """Adopt what helps; say what was left, and first which sensors should be assigned."""
    if result.proposals:
        echo(result.what_next[0], err=True)
    for effect in result.effects:
        if not effect.helps:
            echo(f"not adopted: {sentence(effect.explanation)}: {effect.why_not}", err=True)
    if not any(one.helps for one in result.effects) and not result.is_refit_due:
        echo("nothing was adopted: no effect is known to help", err=True)
        return
    for moved in result.refitted:
        if moved.outcome != "left":
            echo(sentence(moved.explanation), err=True)
    for line in preview_lines(thermap.preview_adoption(machine, analysis_id)):
        echo(line, err=True)
    model = thermap.adopt_analysis(machine, analysis_id)
    if model.active:
        echo(f"adopted: model version {model.version} is active", err=True)
    for line in waiting_lines(model, machine):
        echo(line, err=True)


def write_visits(
    thermap: ThermapClient, folder: Path, machine: str, analysis: int, visits: Sequence[NextVisit]
) -> None:
    """Write the visits that an analysis proposes, or say that it proposes none."""
    if not visits:
        echo(f"{folder}: nothing written: the analysis proposes no visit", err=True)
        return
    folder.mkdir(parents=True, exist_ok=True)
    for number, visit in enumerate(visits, start=1):
        file = folder / f"visit-{number}.csv"
        write_file(file, thermap.visit_file(machine, analysis, number))
        echo(f"{file}: {visit.sentence}", err=True)
    echo(f"`thermap program visit {machine} {file} -c CONTROLLER` writes its NC program", err=True)
