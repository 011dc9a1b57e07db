"""Files of verifications: read and checked before any of them is sent, and stored."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from app.api.contract_json import read_json
from app.api.schemas.verifications import VerificationRequest
from app.api.verification_check import check_verification, complain_of_fields
from app.cli.import_checks import choose_machine, naming, refusing_other_kind, show_what_was_read
from app.cli.terminal import echo
from app.errors import counted, list_names
from app.files.csv_verification import read_csv_verification
from app.files.delimited_text import Problems, UnreadableFile
from app.files.file_kind import FileKind
from app.geometry.components import parse_component
from app.pages.what_was_read import read_of_verification
from thermap import FieldError, InvalidContentError, ThermapClient

_VALUE: Final = "measured_"
"""Fields that begin so hold what was measured."""


@dataclass(frozen=True, slots=True)
class VerificationFile:
    """What one file holds, checked.

    Parameters
    ----------
    lines
        Line of each observation, where the file has lines.
    """

    file: Path
    body: Mapping[str, Any]
    remarks: Sequence[str] = ()
    lines: Sequence[int] = ()

    @property
    def components(self) -> set[str]:
        """Codes of the components that were measured; points are none."""
        named = (o.get("component") for o in self.body["observations"])
        return {parse_component(name)[0].code for name in named if name}

    @property
    def has_points(self) -> bool:
        """Whether errors were measured at points of the work volume."""
        return any(o.get("point_mm") for o in self.body["observations"])

    def complaints(self, errors: Iterable[FieldError]) -> list[str]:
        """Write what the service refuses with file, line and column; `errors` name its fields."""
        problems = Problems(self.file)
        complain_of_fields(problems, self.lines, ((e.field, e.message) for e in errors))
        return problems.listed()


def read_verifications(
    files: Sequence[Path], machine: str, *, is_planned: bool = False
) -> list[VerificationFile]:
    """Read every file, and complain of all that is wrong in any.

    Parameters
    ----------
    files
        CSV as docs/closing-the-loop.md shows, or the request's body as JSON.
    machine
        The machine that was measured; a file that names another is refused.
    is_planned
        Whether they are yet to be measured: measured values are not looked at.

    Raises
    ------
    UnreadableFile
        With file, line and column of everything that is wrong.
    """
    read_files: list[VerificationFile] = []
    complaints: list[str] = []
    for file in files:
        try:
            with refusing_other_kind(FileKind.CHECK, file):
                read_files.append(_read(file, machine, is_planned))
        except UnreadableFile as error:
            complaints.append(error.detail)
    if complaints:
        raise UnreadableFile("\n".join(["nothing was sent:", *complaints]))
    return read_files


def preview_verifications(files: Sequence[VerificationFile]) -> None:
    """Show what was read of files that hold verifications; nothing is sent."""
    for verification_file in files:
        for remark in verification_file.remarks:
            echo(f"{verification_file.file}: note: {remark}", err=True)
        shape = VerificationRequest.model_validate(verification_file.body)
        show_what_was_read(verification_file.file, read_of_verification(shape.to_verification()))
        echo(f"{verification_file.file}: a preview, nothing was stored")


def store_verifications(
    thermap: ThermapClient, machine: str, files: Sequence[VerificationFile], stored: list[int]
) -> None:
    """Store the files' verifications, and say what the service says of each.

    Parameters
    ----------
    stored
        Their numbers are appended as they come, so that they are known if one fails. The same
        content again is the one that is stored.

    Raises
    ------
    UnreadableFile
        With line and column of what the service refuses.
    """
    for i, verification_file in enumerate(files):
        for remark in verification_file.remarks:
            echo(f"{verification_file.file}: note: {remark}", err=True)
        unsent = [later.file for later in files[i + 1 :]]
        with naming(verification_file.file, unsent):
            try:
                answer = thermap.store_verification(machine, verification_file.body)
            except InvalidContentError as error:
                if not (verification_file.lines and error.errors):
                    raise
                reason = verification_file.complaints(error.errors)
                reason += [f"not sent after it: {list_names(map(str, unsent))}"] if unsent else []
                raise UnreadableFile("\n".join(reason)) from error
        for warning in answer.warnings:
            if warning not in verification_file.remarks:
                echo(f"{verification_file.file}: note: {warning}", err=True)
        echo(
            f"{verification_file.file}: verification {answer.label!r}, number {answer.id}, "
            f"{counted(answer.count, 'observation')}"
            + (f". {answer.judgement.summary}" if answer.judgement else ""),
            err=True,
        )
        stored.append(answer.id)


def _read(file: Path, machine: str, is_planned: bool) -> VerificationFile:
    problems = Problems(file)
    if file.suffix.lower() == ".json":
        body = read_json(file, problems)
        if is_planned:
            body = _without_values(body)
        checked = check_verification(body, problems, is_planned=is_planned)
        return VerificationFile(file, body, checked.remarks)
    read = read_csv_verification(file, is_planned=is_planned)
    choose_machine(file, read.machine, machine, stated_as="MACHINE")
    checked = check_verification(read.body, problems, read.lines, is_planned=is_planned)
    return VerificationFile(file, read.body, [*read.remarks, *checked.remarks], read.lines)


def _without_values(body: Any) -> Any:
    """Leave measured values out of a body; one of another shape stays, to be refused."""
    if not isinstance(body, dict) or not isinstance(body.get("observations"), list):
        return body
    planned = [
        {k: v for k, v in o.items() if not k.startswith(_VALUE)} if isinstance(o, dict) else o
        for o in body["observations"]
    ]
    return {**body, "observations": planned}
