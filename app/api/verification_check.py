"""What the service would refuse of a verification, said with the line of the file it stands in."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import Any, Final

from pydantic import ValidationError

from app.api.schemas.analyses import PlannedVerification
from app.api.schemas.verifications import VerificationRequest
from app.effects.observations import Verification
from app.errors import InvalidContent
from app.field_errors import field_error
from app.files.delimited_text import Problems

_PLACE: Final = re.compile(r"observations\.(\d+)\b\.?(.*)")


def check_verification(
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
        complain_of_fields(problems, lines, ((problem.field, problem.message) for problem in wrong))
    except InvalidContent as error:
        complain_of_fields(
            problems, lines, ((problem.field, problem.message) for problem in error.errors)
        )
    problems.raise_if_any()
    assert verification is not None  # else there were problems
    return verification


def complain_of_fields(
    problems: Problems, lines: Sequence[int], errors: Iterable[tuple[str, str]]
) -> None:
    """Note messages under the line of their observation where there are lines, else the field."""
    for field, message in errors:
        place = _PLACE.fullmatch(field)
        if place and lines:
            problems.add(message, lines[int(place[1])], place[2])
        else:
            problems.add(f"{field}: {message}")
