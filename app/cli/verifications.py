"""thermap verifications: store, list and delete them, and show what the model leaves of them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer
from rich.console import Group, RenderableType
from rich.text import Text

from app.cli.answers import listing, or_nothing, show, when
from app.cli.asking import ChosenMachine, Shown, ThermapClient, asks, loop_calls
from app.cli.options import (
    JsonOption,
    YesOption,
    chosen_verifications,
    command_group,
    confirm,
    page_option,
    write_file,
)
from app.cli.terminal import echo
from app.errors import counted, list_names
from app.pages.report_parts.words import zeros_text

if TYPE_CHECKING:
    from thermap.answers import ResidualsAnswer, SizeAnswer, VerificationAnswer

verifications = command_group()


@verifications.command("store")
@asks
def store_verification_files(
    thermap: ThermapClient,
    files: Annotated[
        list[Path],
        typer.Argument(
            exists=True,
            dir_okay=False,
            metavar="FILE…",
            help="Measured data as CSV or Excel, or as JSON of the HTTP contract.",
        ),
    ],
    machine: ChosenMachine,
    preview: Annotated[
        bool,
        typer.Option("--preview", help="Show what was read of the files, and store nothing."),
    ] = False,
) -> None:
    """Store check measurements, each judged against the model as it comes; nothing is analysed.

    Example: `thermap verifications store night-shift.csv --machine vmc --preview`
    """
    from app.cli.check_files import look_at_checks, show_checks, store_checks

    read = look_at_checks(thermap, machine, files)
    if preview:
        show_checks(read)
    else:
        store_checks(thermap, read, [])


@verifications.command("list")
@asks
def list_verifications(machine: ChosenMachine) -> Shown:
    """List a machine's verifications, oldest first, and what they said of the model.

    Example: `thermap verifications list --machine vmc`
    """
    return Shown(loop_calls.verifications(machine), verifications_view)


@verifications.command("residuals")
@asks
def show_residuals(
    thermap: ThermapClient,
    machine: ChosenMachine,
    numbers: Annotated[
        list[int] | None,
        typer.Argument(metavar="NUMBER…", help="Of the verifications; all without it."),
    ] = None,
    model_version: Annotated[
        int | None,
        typer.Option(metavar="VERSION", help="The active one without it."),
    ] = None,
    output: Annotated[
        Path | None, page_option("Write a page with plots, which needs no internet.")
    ] = None,
    json: JsonOption = False,
) -> None:
    """Show what a model version leaves of verifications: measured minus predicted.

    Example: `thermap verifications residuals 1 2 --machine vmc -o residuals.html`
    """
    chosen = chosen_verifications(thermap, machine, numbers)
    call = loop_calls.residuals(machine, chosen, model_version, 0)
    show(thermap, call, residuals_view, json=json)
    if output is not None:
        write_file(output, thermap.residuals_page(machine, chosen, model_version))
        echo(f"{output}: residuals as a page", err=True)


@verifications.command("delete")
@asks
def delete_verification(
    thermap: ThermapClient,
    number: Annotated[int, typer.Argument(metavar="NUMBER", help="The verification's number.")],
    machine: ChosenMachine,
    yes: YesOption = False,
) -> None:
    """Delete a verification; analyses of it keep their results.

    Example: `thermap verifications delete 2 --machine vmc`
    """
    present = thermap.verification(machine, number)
    confirm(
        f"verification {present.label!r} was not deleted",
        f"Delete verification {present.label!r} (number {number}) of {machine!r} with "
        f"{counted(present.count, 'observation')}?",
        yes=yes,
    )
    thermap.delete_verification(machine, number)
    echo(f"verification {present.label!r} deleted")


def verifications_view(found: Sequence[VerificationAnswer]) -> RenderableType:
    """Lay out all verifications."""
    table = listing(
        *("no.", "label", "measured [UTC]", "count", "components", "model"), right="rllrll"
    )
    for verification in found:
        judged = verification.judgement.status if verification.judgement else "not judged"
        same_day = verification.first_at.date() == verification.last_at.date()
        end = f"{verification.last_at:%H:%M}" if same_day else when(verification.last_at)
        span = f"{when(verification.first_at)} to {end}"
        components = list_names(verification.components)
        table.add_row(
            str(verification.id),
            verification.label,
            span,
            str(verification.count),
            components,
            judged,
        )
    return or_nothing(table, "no verification is stored yet")


def residuals_view(residuals: ResidualsAnswer) -> RenderableType:
    """Lay out the sizes of residuals, component by component."""
    table = listing(
        *("residuals", "unit", "values", "mean", "RMS", "95 % below", "repeatability"),
        right="llrrrrr",
    )
    overall = [residuals.overall] if residuals.overall else []
    for size in [*residuals.components, *overall]:
        table.add_row(*_cells(size), style="bold" if size in overall else "")
    of = list_names(map(str, residuals.verifications))
    head = Text(
        f"measured minus predicted by model version {residuals.model_version}; verifications {of}"
    )
    left_out = [
        Text(f"! left out: {counted(group.count, 'value')}, {group.reason}", style="yellow")
        for group in residuals.excluded
    ]
    if residuals.contradiction:
        left_out.insert(0, Text(f"! {residuals.contradiction}", style="yellow"))
    if residuals.counted_as_zero:
        codes = list_names(residuals.counted_as_zero)
        left_out.append(
            Text(
                f"! counted as zero at points, no two maps have them: {codes}; the residuals there "
                "contain them whole",
                style="yellow",
            )
        )
    guessed = [Text(zeros_text(str(size.zero) for size in residuals.components), style="dim")]
    guessed += [Text(_ORIGIN_NOTE, style="dim")] if _is_any_guessed(residuals) else []
    sizes = or_nothing(table, "nothing of them can be compared with the model")
    return Group(head, Text(), sizes, *left_out, *guessed)


_ORIGIN_NOTE: Final = "~ repeatability guessed from the residuals within visits: nobody stated it"


def _is_any_guessed(residuals: ResidualsAnswer) -> bool:
    return any("residuals" in size.repeatability_origin for size in residuals.components)


def _cells(size: SizeAnswer) -> list[str]:
    guessed = "~" if "residuals" in size.repeatability_origin else ""
    repeatability = "–" if size.repeatability is None else f"{guessed}{size.repeatability:.2f}"
    name = "all lengths" if size.component == "all" else size.component
    numbers = (f"{size.mean:+z.2f}", f"{size.rms:.2f}", f"{size.p95:.2f}", repeatability)
    return [name, size.unit, str(size.count), *numbers]
