"""A verification from a file that came over HTTP."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from pydantic import ValidationError

from app.api.schemas.analyses import PlannedVerification
from app.api.schemas.verifications import VerificationRequest
from app.effects.observations import Verification
from app.errors import FieldError, InvalidContent
from app.field_errors import field_error
from app.files.csv_verification import parse_csv_verification
from app.files.delimited_text import Problems, UnreadableFile, sheets_of
from app.files.file_kind import FileKind, is_json, json_of, refuse_other_kind

_PLACE: Final = re.compile(r"observations\.(\d+)\b\.?(.*)")
_VALUE: Final = "measured_"
"""Fields that begin so hold what was measured."""


@dataclass(frozen=True, slots=True)
class UploadedVerification:
    """What one file holds, checked, and where in it each observation stands.

    Parameters
    ----------
    body
        The request's, as the file has it.
    remarks
        What of the file was not read.
    """

    file: Path
    verification: Verification
    body: Any
    remarks: Sequence[str]
    lines: Sequence[int]

    def refusal(self, error: InvalidContent) -> InvalidContent:
        """Say what is refused of the observations by the lines in which they stand."""
        problems = Problems(self.file)
        _complain(problems, self.lines, ((e.field, e.message) for e in error.errors))
        return _of_lines(problems.listed())


def read_uploaded_verification(
    content: bytes, name: str, machine: str, *, is_planned: bool = False
) -> UploadedVerification:
    """Read a verification from what is in a file: CSV, an Excel workbook, or a request's JSON.

    Parameters
    ----------
    name
        The file's name, under which complaints stand; without a label it is called so.
    is_planned
        Whether it is yet to be measured: measured values are not looked at.

    Raises
    ------
    InvalidContent
        With an entry, under `file`, for everything that is wrong in the words of the command
        line: line, column, what was expected and what came; if an instrument wrote it; if it
        is another machine's.
    """
    file = Path(name or "file.csv")
    try:
        if is_json(content, file):
            problems = Problems(file)
            body = json_of(content, problems)
            if is_planned:
                body = _without_values(body)
            verification = _checked(body, problems, is_planned=is_planned)
            return UploadedVerification(file, verification, body, (), ())
        read = parse_csv_verification(sheets_of(content, file), file, is_planned=is_planned)
        if read.machine not in (None, machine):
            raise UnreadableFile(
                f"{file} says that it belongs to {read.machine!r}, got {machine!r}"
            )
        body = _without_values(read.body) if is_planned else read.body
        verification = _checked(body, Problems(file), read.lines, is_planned=is_planned)
    except UnreadableFile as error:
        refuse_other_kind(FileKind.CHECK, content, file)
        raise _of_lines(error.wrong) from None
    return UploadedVerification(file, verification, body, read.remarks, read.lines)


def _of_lines(lines: Sequence[str]) -> InvalidContent:
    return InvalidContent("\n".join(lines), [FieldError("file", line) for line in lines])


def _without_values(body: Any) -> Any:
    """Leave out of a body what was measured, and by whom; one of another shape is refused later."""
    if not isinstance(body, dict) or not isinstance(body.get("observations"), list):
        return body
    planned = [
        {k: v for k, v in o.items() if not k.startswith(_VALUE)} if isinstance(o, dict) else o
        for o in body["observations"]
    ]
    stated = {k: v for k, v in body.items() if k not in ("instrument", "operator")}
    return stated | {"observations": planned}


def _checked(
    body: Any, problems: Problems, lines: Sequence[int] = (), *, is_planned: bool = False
) -> Verification:
    """Make of a body what the service does, so that what it would refuse is known here.

    Parameters
    ----------
    lines
        Line of each observation, where the file has lines.
    is_planned
        Whether it is yet to be measured, and has no values.

    Raises
    ------
    UnreadableFile
        With everything that is wrong, also what was in `problems` before.
    """
    shape = PlannedVerification if is_planned else VerificationRequest
    verification = None
    try:
        verification = shape.model_validate(body).to_verification()
    except ValidationError as error:
        wrong = map(field_error, error.errors())
        _complain(problems, lines, ((problem.field, problem.message) for problem in wrong))
    except InvalidContent as error:
        _complain(problems, lines, ((problem.field, problem.message) for problem in error.errors))
    problems.raise_if_any()
    assert verification is not None  # else there were problems
    return verification


def _complain(problems: Problems, lines: Sequence[int], errors: Iterable[tuple[str, str]]) -> None:
    """Note messages under the line of their observation where there are lines, else the field."""
    for field, message in errors:
        place = _PLACE.fullmatch(field)
        if place and lines:
            problems.add(message, lines[int(place[1])], place[2])
        else:
            problems.add(f"{field}: {message}")
