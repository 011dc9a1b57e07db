"""thermap analyses: list, show, cancel and delete what `thermap analyse` asked for."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Group, RenderableType
from rich.text import Text

from app.cli.answers import facts, listing, or_nothing, show_of_machine, show_view, when
from app.cli.options import (
    JsonOption,
    MachineOption,
    ReportOption,
    UrlOption,
    YesOption,
    chosen_machine,
    command_group,
    confirm,
    connect,
    expect_page,
    write_file,
)
from app.cli.terminal import echo, write_document
from app.errors import list_names
from thermap import DEFAULT_URL

if TYPE_CHECKING:
    from app.storage.analysis_results import AnalysisWithResult
    from thermap.answers import AnalysisHead

analyses = command_group()

NumberArgument = Annotated[int, typer.Argument(metavar="NUMBER", help="The analysis' number.")]


@analyses.callback()
def _describe() -> None:
    """List, show, cancel and delete analyses."""


@analyses.command("list")
def list_analyses(
    machine: MachineOption = None, json: JsonOption = False, url: UrlOption = DEFAULT_URL
) -> None:
    """List a machine's analyses, oldest first.

    Example: `thermap analyses list --machine vmc`
    """
    from thermap import loop_calls

    show_of_machine(url, machine, loop_calls.analyses, analyses_view, json=json)


@analyses.command("show")
def show_analysis(
    number: NumberArgument,
    machine: MachineOption = None,
    output: ReportOption = None,
    json: JsonOption = False,
    url: UrlOption = DEFAULT_URL,
) -> None:
    """Show how far an analysis is and, once it is done, what it found.

    Example: `thermap analyses show 1 --machine vmc -o report.html`
    """
    from pydantic import TypeAdapter

    from app.storage.analysis_results import AnalysisWithResult
    from thermap import loop_calls

    if output is not None:
        expect_page(output)
    with connect(url) as thermap:
        chosen = chosen_machine(thermap, machine)
        content = thermap.content(loop_calls.analysis(chosen, number))
        if json:
            write_document(content.decode() + "\n")
        else:
            # As the pages read it too: views are of the service's own classes.
            show_view(analysis_view(TypeAdapter(AnalysisWithResult).validate_json(content)))
        if output is not None:
            write_file(output, thermap.analysis_report(chosen, number))
            echo(f"{output}: the report of analysis {number}", err=True)


@analyses.command("cancel")
def cancel_analysis(
    number: NumberArgument,
    machine: MachineOption = None,
    json: JsonOption = False,
    url: UrlOption = DEFAULT_URL,
) -> None:
    """Stop an analysis that waits or runs.

    Example: `thermap analyses cancel 2 --machine vmc`
    """
    from thermap import loop_calls

    show_of_machine(
        url,
        machine,
        lambda chosen: loop_calls.cancel_analysis(chosen, number),
        lambda now: Text(f"analysis {now.id}: {now.status}"),
        json=json,
    )


@analyses.command("delete")
def delete_analysis(
    number: NumberArgument,
    machine: MachineOption = None,
    yes: YesOption = False,
    url: UrlOption = DEFAULT_URL,
) -> None:
    """Delete an analysis with its report; a model version that was made of it stays.

    Example: `thermap analyses delete 1 --machine vmc`
    """
    with connect(url) as thermap:
        chosen = chosen_machine(thermap, machine)
        present = thermap.analysis(chosen, number)
        confirm(
            f"analysis {number} was not deleted",
            f"Delete analysis {number} of {chosen!r} ({present.status}) with its report?",
            yes=yes,
        )
        thermap.delete_analysis(chosen, number)
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
