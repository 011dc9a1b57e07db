"""A verification from a file that came over HTTP."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from app.api.contract_json import json_of
from app.api.verification_check import check_verification, complain_of_fields
from app.effects.observations import Verification
from app.errors import FieldError, InvalidContent
from app.files.csv_verification import parse_csv_verification
from app.files.delimited_text import Problems, UnreadableFile, sheets_of
from app.files.file_kind import FileKind, is_json, refuse_other_kind


@dataclass(frozen=True, slots=True)
class UploadedVerification:
    """What one file holds, checked, and where in it each observation stands.

    Parameters
    ----------
    remarks
        What of the file was not read.
    """

    file: Path
    verification: Verification
    remarks: Sequence[str]
    lines: Sequence[int]

    def refusal(self, error: InvalidContent) -> InvalidContent:
        """Say what is refused of the observations by the lines in which they stand."""
        problems = Problems(self.file)
        complain_of_fields(problems, self.lines, ((e.field, e.message) for e in error.errors))
        return _of_lines(problems.listed())


def read_uploaded_verification(content: bytes, name: str, machine: str) -> UploadedVerification:
    """Read a verification from what is in a file: CSV, an Excel workbook, or a request's JSON.

    Parameters
    ----------
    name
        The file's name, under which complaints stand; without a label it is called so.

    Raises
    ------
    InvalidContent
        With an entry, under `file`, for everything that is wrong in the words of the command
        line: line, column, what was expected and what came; if an instrument wrote it; if it
        is another machine's.
    """
    file = Path(Path(name).name or "file.csv")
    try:
        if is_json(content, file):
            problems = Problems(file)
            verification = check_verification(json_of(content, problems), problems)
            return UploadedVerification(file, verification, (), ())
        read = parse_csv_verification(sheets_of(content, file), file)
        if read.machine not in (None, machine):
            raise UnreadableFile(
                f"{file} says that it belongs to {read.machine!r}, got {machine!r}"
            )
        verification = check_verification(read.body, Problems(file), read.lines)
    except UnreadableFile as error:
        refuse_other_kind(FileKind.CHECK, content, file)
        raise _of_lines(error.wrong) from None
    return UploadedVerification(file, verification, read.remarks, read.lines)


def _of_lines(lines: Sequence[str]) -> InvalidContent:
    return InvalidContent("\n".join(lines), [FieldError("file", line) for line in lines])
