"""Files that are sent as they are: the service reads each, and all before any of them is stored."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Generic, TypeVar

import httpx
import typer

from app.cli.terminal import echo
from app.errors import ThermapError, list_names
from thermap import NotListeningError, ThermapClient, ThermapClientError, calls
from thermap.call import Call

Answer = TypeVar("Answer")

Beside = Mapping[str, Any]
"""What is said of a file beside it, as the query of `…/files` has it."""

_MACHINE: Final = re.compile(r"^[\s\"']*#\s*machine\s*[:=;,\t]\s*([^\r\n\"]+)", re.I | re.M)
_BEGINNING: Final = 10_000
"""Characters of a text in which its machine stands, if anywhere."""


class NotImported(ThermapError):
    """The service refused a file's content, or the file could not be read."""


@dataclass(frozen=True, slots=True)
class Upload:
    """A file, or one entry of it, and the machine that it belongs to."""

    file: Path
    machine: str
    content: bytes
    place: str = ""
    """Which entry of a list, such as `entry 3: `."""

    def call(self, beside: Beside, storing: calls.Storing) -> Call[calls.ImportedFile]:
        """Write the request that sends it."""
        return calls.send_file(self.machine, self.file.as_posix(), self.content, beside, storing)


@dataclass(frozen=True, slots=True)
class Sent(Generic[Answer]):
    """What the service answered, as it came too, and whether anything is stored that was not."""

    answer: Answer
    content: bytes
    is_new: bool


def send(thermap: ThermapClient, call: Call[Answer]) -> Sent[Answer]:
    """Send what may be stored already."""

    def read(response: httpx.Response) -> Sent[Answer]:
        return Sent(call.read(response), response.content, response.status_code == 201)

    return thermap.send(Call(call.method, call.path, read, call.body, call.query))


def read_bytes(files: Sequence[Path]) -> dict[Path, bytes]:
    """Read files as they are.

    Raises
    ------
    NotImported
        With every file that cannot be read.
    """
    contents: dict[Path, bytes] = {}
    wrong = []
    for file in files:
        try:
            contents[file] = file.read_bytes()
        except OSError as error:
            wrong.append(f"{file}: {error.strerror}")
    raise_if_any(wrong)
    return contents


def raise_if_any(wrong: Sequence[str], nothing: str = "nothing") -> None:
    """Raise NotImported with all that keeps files from being stored, and what is not stored."""
    if wrong:
        raise NotImported("\n".join([f"{nothing} was stored:", *wrong]))


def look_at_all(
    thermap: ThermapClient, uploads: Sequence[Upload], beside: Beside, storing: calls.Storing
) -> list[Sent[calls.ImportedFile]]:
    """Ask of every file what `storing` without storing anything gives.

    Raises
    ------
    NotImported
        With all that is wrong in any of them.
    """
    looks = []
    wrong: list[str] = []
    for upload in uploads:
        try:
            looks.append(send(thermap, upload.call(beside, storing)))
        except NotListeningError:
            raise
        except ThermapClientError as error:
            wrong += complaints(upload.file, error, upload.place)
    # The machine that the files belong to may have been stored just before.
    raise_if_any(list(dict.fromkeys(wrong)), "no map or check")
    return looks


def complaints(file: Path, error: ThermapClientError, place: str = "") -> list[str]:
    """Write what the service refuses of a file, each line with the file's name."""
    named = file.as_posix()
    lines = [error.sentence]
    if error.detail.startswith(named):
        lines = error.detail.splitlines()
    elif error.errors:
        of_file = ("" if e.field == "file" else f"{e.field}: " for e in error.errors)
        lines = [field + e.message for field, e in zip(of_file, error.errors, strict=True)]
    return [
        line
        if line.startswith(named) and not place
        else f"{named}: {place}{line.removeprefix(f'{named}: ')}"
        for line in lines
    ]


def say_what_was_read(file: Path, answer: object) -> None:
    """Say what the service notes of a file, and what it read of it."""
    for warning in getattr(answer, "warnings", ()):
        echo(f"{file}: note: {warning}", err=True)
    for line in getattr(answer, "read", ()):
        echo(f"{file}: read {line}")


@contextmanager
def naming(file: Path, unsent: Sequence[Path] = ()) -> Iterator[None]:
    """Tell a refusal with the name of the file, and of those that were not sent after it."""
    try:
        yield
    except NotListeningError:
        raise
    except ThermapClientError as error:
        later = list(dict.fromkeys(str(other) for other in unsent if other != file))
        rest = f" (not sent after it: {list_names(later)})" if later else ""
        raise NotImported("\n".join(complaints(file, error)) + rest) from error


def machine_in(content: bytes) -> str | None:
    r"""Give the machine that a text names in its comment lines; a workbook's are not looked at.

    >>> machine_in(b"# label: Run 1\n# machine: vmc\ncomponent,position_mm,error_um\n")
    'vmc'
    """
    is_wide = content[:2] in (b"\xff\xfe", b"\xfe\xff")
    text = content.decode("utf-16" if is_wide else "latin-1", errors="replace")
    match = _MACHINE.search(text[:_BEGINNING])
    return match[1].strip(" ;,\t") if match else None


def choose_machine(
    file: Path, named: str | None, chosen_name: str | None, described: Sequence[str] = ()
) -> str:
    """Decide whose it is: the file's word, --machine, or the only machine described.

    Parameters
    ----------
    described
        Machines that are imported together with it.

    Raises
    ------
    typer.BadParameter
        If nobody says it, or the file says otherwise than the option.
    """
    if named and chosen_name and named != chosen_name:
        raise typer.BadParameter(
            f"{file} says that it belongs to {named!r}, got {chosen_name!r}",
            param_hint="--machine",
        )
    chosen = named or chosen_name or (described[0] if len(described) == 1 else None)
    if not chosen:
        raise typer.BadParameter(
            f"{file} does not say which machine it belongs to", param_hint="--machine"
        )
    return chosen
