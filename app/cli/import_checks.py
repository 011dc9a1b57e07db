"""What every import decides before it sends: whose a file is, and what a refusal says."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import typer

from app.cli.csv_comments import Stated
from app.client import NotListeningError, ThermapClientError
from app.errors import Conflict, ThermapError, list_names


class NotImported(ThermapError):
    """The service refused a file's content."""


def expect_one_label(stated: Stated, files: Sequence[Path]) -> None:
    """Refuse one label for several maps; `files` are those that it would name."""
    if stated.label and len(files) > 1:
        raise typer.BadParameter("names one map, came several files", param_hint="--label")


def choose_machine(
    file: Path,
    named: str | None,
    stated: str | None,
    described: Sequence[str] = (),
    *,
    stated_as: str = "--machine",
) -> str:
    """Decide whose it is: the file's word, --machine, or the only machine described.

    Parameters
    ----------
    file, named
        The file, and the machine that it names.
    stated
        Value of --machine.
    described
        Machines that are imported together with it.
    stated_as
        What the command calls the machine that the user states.

    Raises
    ------
    typer.BadParameter
        If nobody says it, or the file says otherwise than the option.
    """
    if named and stated and named != stated:
        raise typer.BadParameter(
            f"{file} says that it belongs to {named!r}, came {stated!r}", param_hint=stated_as
        )
    chosen = named or stated or (described[0] if len(described) == 1 else None)
    if not chosen:
        raise typer.BadParameter(
            f"{file} does not say which machine it belongs to", param_hint=stated_as
        )
    return chosen


def expect_sensors(file: Path, machine: str, known: Sequence[str], names: Iterable[str]) -> None:
    """Raise NotImported if a file has temperatures of sensors that its machine lacks."""
    for name in names:
        if name not in known:
            raise NotImported(
                f"nothing was sent: {file}: machine {machine!r} has no sensor {name!r}; "
                f"it has {list_names(known)}"
            )


@contextmanager
def naming(file: Path, unsent: Sequence[Path] = (), before: str = "") -> Iterator[None]:
    """Tell a refusal with the name of the file, and of those that were not sent after it."""
    try:
        yield
    except NotListeningError:
        raise
    except (ThermapClientError, Conflict) as error:
        rest = f" (not sent after it: {list_names(map(str, unsent))})" if unsent else ""
        why = error.sentence if isinstance(error, ThermapClientError) else error.detail
        raise NotImported(f"{before}{file}: {why}{rest}") from error
