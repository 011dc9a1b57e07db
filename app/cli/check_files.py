"""Files of check measurements: all looked at before any of them is stored."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final, cast

from app.cli.terminal import echo
from app.cli.uploads import (
    Beside,
    Sent,
    Upload,
    look_at_all,
    naming,
    read_bytes,
    say_what_was_read,
    send,
)
from app.errors import counted
from app.services.observations import VisitPreview
from thermap import ThermapClient, calls
from thermap.answers import StoredVerificationAnswer, VerificationPreview

_BESIDE: Final = {"kind": "check"}
_PLANNED: Final = {"planned": "true"}


def look_at_checks(
    thermap: ThermapClient, machine: str, files: Sequence[Path]
) -> list[tuple[Upload, VerificationPreview]]:
    """Let the service read every file.

    Raises
    ------
    NotImported
        With file, line and column of everything that is wrong in any.
    """
    looks = _looks(thermap, machine, files, _BESIDE)
    return [(upload, cast("VerificationPreview", look.answer)) for upload, look in looks]


def show_checks(read: Sequence[tuple[Upload, VerificationPreview]]) -> None:
    """Show what was read of files; nothing is stored."""
    for upload, preview in read:
        say_what_was_read(upload.file, preview)
        echo(f"{upload.file}: a preview, nothing was stored")


def store_checks(
    thermap: ThermapClient,
    read: Sequence[tuple[Upload, VerificationPreview]],
    stored: list[int],
) -> None:
    """Store the files' verifications, and say what the service says of each.

    Parameters
    ----------
    stored
        Their numbers are appended as they come, so that they are known if one fails. The same
        content again is the one that is stored.

    Raises
    ------
    NotImported
        With what the service refuses.
    """
    for i, (upload, _) in enumerate(read):
        with naming(upload.file, [later.file for later, _ in read[i + 1 :]]):
            sent = send(thermap, upload.call(_BESIDE, calls.Storing(store=True)))
        answer = cast("StoredVerificationAnswer", sent.answer)
        say_what_was_read(upload.file, answer)
        echo(
            f"{upload.file}: verification {answer.label!r}, number {answer.id}, "
            f"{counted(answer.count, 'observation')}"
            + (f". {answer.judgement.summary}" if answer.judgement else ""),
            err=True,
        )
        stored.append(answer.id)


def look_at_visits(
    thermap: ThermapClient, machine: str, files: Sequence[Path]
) -> list[VisitPreview]:
    """Let the service read files of what is yet to be measured.

    Raises
    ------
    NotImported
        With file, line and column of everything that is wrong in any.
    """
    visits = []
    for upload, look in _looks(thermap, machine, files, _PLANNED):
        visits.append(VisitPreview.model_validate_json(look.content))
        say_what_was_read(upload.file, visits[-1])
    return visits


def _looks(
    thermap: ThermapClient, machine: str, files: Sequence[Path], beside: Beside
) -> Iterator[tuple[Upload, Sent[calls.ImportedFile]]]:
    """Let the service read every file, and store none."""
    uploads = [Upload(file, machine, content) for file, content in read_bytes(files).items()]
    looks = look_at_all(thermap, uploads, beside, calls.Storing(preview=True))
    return zip(uploads, looks, strict=True)
