"""What every import decides before it sends, and says before and after."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from app.cli.answers import shell_words
from app.cli.models import preview_lines, waiting_lines
from app.cli.terminal import echo
from app.errors import Conflict, ThermapError, list_names
from app.files.csv_comments import Header
from app.files.delimited_text import UnreadableFile
from app.files.file_kind import FileKind, OtherKind, refuse_other_kind
from app.geometry.components import COMPONENTS, ORDER, parse_component
from thermap import NotListeningError, ThermapClient, ThermapClientError, UnknownThingError

if TYPE_CHECKING:
    from app.api.schemas.machines import MachineSettings
    from app.cli.models import ModelChange
    from app.pages.what_was_read import WhatWasRead
    from thermap.answers import MachineAnswer, PreviewAnswer


class NotImported(ThermapError):
    """The service refused a file's content."""


@dataclass(frozen=True, slots=True)
class ImportMode:
    """What is to become of maps: shown only, stored, stored and used whatever is lost by it.

    Of a drift test maps may be made, its course kept as a verification, or both.
    """

    evaluate_only: bool = False
    preview: bool = False
    accept_losses: bool = False
    as_maps: bool = True
    as_verification: bool = False

    @property
    def store(self) -> bool:
        """Whether anything is stored."""
        return not (self.evaluate_only or self.preview)

    @property
    def makes_map(self) -> bool:
        """Whether something is made of it, be it for a look: it needs a label and a state."""
        return not self.evaluate_only

    @property
    def stores_map(self) -> bool:
        """Whether a map is stored."""
        return self.store and self.as_maps


def expect_one_label(header: Header, files: Sequence[Path]) -> None:
    """Refuse one label for several maps; `files` are those that it would name."""
    if header.label and len(files) > 1:
        raise typer.BadParameter("names one map, got several files", param_hint="--label")


def choose_machine(
    file: Path,
    named: str | None,
    chosen_name: str | None,
    described: Sequence[str] = (),
    *,
    stated_as: str = "--machine",
) -> str:
    """Decide whose it is: the file's word, --machine, or the only machine described.

    Parameters
    ----------
    described
        Machines that are imported together with it.
    stated_as
        What the command calls the machine that the user states.

    Raises
    ------
    typer.BadParameter
        If nobody says it, or the file says otherwise than the option.
    """
    if named and chosen_name and named != chosen_name:
        raise typer.BadParameter(
            f"{file} says that it belongs to {named!r}, got {chosen_name!r}", param_hint=stated_as
        )
    chosen = named or chosen_name or (described[0] if len(described) == 1 else None)
    if not chosen:
        raise typer.BadParameter(
            f"{file} does not say which machine it belongs to", param_hint=stated_as
        )
    return chosen


def expect_sensors(file: Path, machine: str, sensors: Sequence[str], names: Iterable[str]) -> None:
    """Raise NotImported if a file has temperatures of sensors that its machine lacks."""
    for name in names:
        if name not in sensors:
            raise NotImported(
                f"nothing was sent: {file}: machine {machine!r} has no sensor {name!r}; "
                f"it has {list_names(sensors)}"
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


@contextmanager
def refusing_other_kind(expected: FileKind, file: Path) -> Iterator[None]:
    """Say of a file that cannot be read as expected which other kind it holds, where it does."""
    try:
        yield
    except UnreadableFile:
        if file.is_file():
            try:
                refuse_other_kind(expected, file.read_bytes(), file)
            except OtherKind as other:
                raise UnreadableFile(other.detail) from None
        raise


def show_preview(file: Path, preview: PreviewAnswer, *, alone: bool = False) -> None:
    """Say what a map would do to the tables; losses where warnings go.

    With `alone` it is all that is said: also that nothing is stored, and why nothing is known
    of changes.
    """
    for line in preview_lines(preview):
        good = line.startswith(("would gain", "would change", "would have changed"))
        echo(f"{file}: {line}", err=not good)
    if alone:
        if preview.not_compared:
            echo(
                f"{file}: it is not known by how much tables would change ({preview.not_compared})"
            )
        became = (
            "would be active at once"
            if preview.activated
            else "would wait, and tables would stay as they are"
        )
        echo(
            f"{file}: a preview, nothing was stored; the model version that this map makes {became}"
        )


def show_what_was_read(file: Path, read: WhatWasRead) -> None:
    """Say what was read of a file, before anything is made of it."""
    for line in read.lines():
        echo(f"{file}: read {line}")


def report_stored_map(
    thermap: ThermapClient,
    file: Path,
    machine: str,
    label: str,
    number: int | None,
    change: ModelChange,
    *,
    was_there: bool,
) -> None:
    """Say under which number a map is stored, and whether tables follow it."""
    waits = list(waiting_lines(change, machine, number))
    version = change.model_version
    if was_there:
        text = f"error map {label!r} was there already, number {number}"
        text += f"; model version {version} is active" if version and change.activated else ""
    else:
        text = f"error map {label!r} stored as number {number}"
        active = version or thermap.machine(machine).active_model
        text += "" if waits else f", model version {active}"
    echo(f"{file}: {text}")
    for line in waits:
        echo(f"{file}: {line}", err=True)


def settings_of_stored(machine: MachineAnswer) -> MachineSettings:
    """Leave away what only a stored machine has."""
    from app.api.schemas.machines import MachineSettings

    settings = machine.model_dump(include={*MachineSettings.model_fields})
    return MachineSettings.model_validate(settings)


def note_unassigned_components(
    thermap: ThermapClient, machine: MachineSettings, components: Iterable[str]
) -> None:
    """Say once, before maps are stored, which of their components no table will have, and why.

    Nothing is said where every component follows a sensor that is assigned to it or that the
    chapter names.
    """
    described = machine.to_machine()
    try:
        assigned = thermap.sensor_assignment(machine.id)
    except UnknownThingError:
        assigned = {}
    codes = {parse_component(name)[0].code for name in components}
    without = [
        code
        for code in sorted(codes, key=ORDER.__getitem__)
        if code not in assigned and described.default_sensor(code) is None
    ]
    if not without:
        return
    usual = dict.fromkeys(COMPONENTS[code].default_sensor for code in without)
    names = ", ".join(
        f"{sensor} for {list_names([c for c in without if COMPONENTS[c].default_sensor == sensor])}"
        for sensor in usual
        if sensor
    )
    sensors = list(described.sensors)
    first = shell_words([f"{without[0]}={sensors[0] if sensors else 'SENSOR'}"])
    echo(
        f"note: no sensor is assigned to {list_names(without)}: tables will not have them, and "
        "nothing can be compared with them. Machine "
        f"{machine.id!r} has the sensors {list_names(sensors)}"
        + (f", and none that is the usual one ({names})" if names else "")
        + f". `thermap sensors assign {first} … --machine {machine.id}` assigns "
        "them; once maps are stored, `thermap sensors correlate` proposes which.",
        err=True,
    )
