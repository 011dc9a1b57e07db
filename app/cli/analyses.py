"""thermap analyses: list, show, cancel and delete what `thermap analyse` asked for."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Group, RenderableType
from rich.text import Text

from app.cli.answers import facts, listing, or_nothing, show_view, when
from app.cli.asking import ChosenMachine, Shown, ThermapClient, asks, loop_calls
from app.cli.options import (
    JsonOption,
    ReportOption,
    YesOption,
    command_group,
    confirm,
    write_file,
)
from app.cli.terminal import echo, write_json
from app.errors import list_names

if TYPE_CHECKING:
    from app.storage.analysis_results import AnalysisWithResult
    from thermap.answers import AnalysisHead

analyses = command_group()

NumberArgument = Annotated[int, typer.Argument(metavar="NUMBER", help="The analysis' number.")]


@analyses.command("list")
@asks
def list_analyses(machine: ChosenMachine) -> Shown:
    """List a machine's analyses, oldest first.

    Example: `thermap analyses list --machine vmc`
    """
    return Shown(loop_calls.analyses(machine), analyses_view)


@analyses.command("show")
@asks
def show_analysis(
    thermap: ThermapClient,
    number: NumberArgument,
    machine: ChosenMachine,
    output: ReportOption = None,
    json: JsonOption = False,
) -> None:
    """Show how far an analysis is and, once it is done, what it found.

    Example: `thermap analyses show 1 --machine vmc -o report.html`
    """
    from pydantic import TypeAdapter

    from app.storage.analysis_results import AnalysisWithResult

    content = thermap.content(loop_calls.analysis(machine, number))
    if json:
        write_json(content)
    else:
        # As the pages read it too: views are of the service's own classes.
        show_view(analysis_view(TypeAdapter(AnalysisWithResult).validate_json(content)))
    if output is not None:
        write_file(output, thermap.analysis_report(machine, number))
        echo(f"{output}: the report of analysis {number}", err=True)


@analyses.command("cancel")
@asks
def cancel_analysis(number: NumberArgument, machine: ChosenMachine) -> Shown:
    """Stop an analysis that waits or runs.

    Example: `thermap analyses cancel 2 --machine vmc`
    """
    return Shown(
        loop_calls.cancel_analysis(machine, number),
        lambda now: Text(f"analysis {now.id}: {now.status}"),
    )


@analyses.command("delete")
@asks
def delete_analysis(
    thermap: ThermapClient, number: NumberArgument, machine: ChosenMachine, yes: YesOption = False
) -> None:
    """Delete an analysis with its report; a model version that was made of it stays.

    Example: `thermap analyses delete 1 --machine vmc`
    """
    present = thermap.analysis(machine, number)
    confirm(
        f"analysis {number} was not deleted",
        f"Delete analysis {number} of {machine!r} ({present.status}) with its report?",
        yes=yes,
    )
    thermap.delete_analysis(machine, number)
    echo(f"analysis {number} deleted")


def analyses_view(found: Sequence[AnalysisHead]) -> RenderableType:
    """Lay out all analyses."""
    table = listing(
        *("no.", "asked for [UTC]", "status", "done [%]", "of version", "verifications", "adopted"),
        right="rllrrlr",
    )
    for analysis in found:
        adopted = "–" if analysis.adopted_version is None else f"version {analysis.adopted_version}"
        table.add_row(
            *(
                str(analysis.id),
                when(analysis.created_at),
                str(analysis.status),
                f"{100.0 * analysis.progress:.0f}",
            ),
            *(
                str(analysis.model_version),
                list_names(map(str, analysis.verifications), 6),
                adopted,
            ),
        )
    return or_nothing(table, "no analysis yet; `thermap analyse` asks for one")


def analysis_view(job: AnalysisWithResult) -> RenderableType:
    """Lay out one analysis."""
    from app.cli.analyse_view import analysis_view as result_view

    adopted = job.adopted_version
    rows = [
        ("analysis", f"{job.id}, {job.status}"),
        ("of", f"model version {job.model_version}"),
        ("verifications", list_names(map(str, job.verifications))),
        ("adopted", "no" if adopted is None else f"as model version {adopted}"),
    ]
    if job.message:
        rows.append(("says", job.message))
    if job.result is None:
        return facts(*rows, ("done", f"{100.0 * job.progress:.0f} %"))
    return Group(facts(*rows), Text(), result_view(job.result))
