"""Checking long lists in pieces, between which others have their turn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any, Final

import numpy as np
from pydantic import GetCoreSchemaHandler, ValidationError, ValidatorFunctionWrapHandler
from pydantic_core import (
    CoreSchema,
    InitErrorDetails,
    PydanticCustomError,
    PydanticKnownError,
    core_schema,
)

ENTRIES_AT_ONCE: Final = 50
"""Entries checked in one call: some hundred microseconds."""

ENOUGH_ERRORS: Final = 100
"""Errors after which a list is not looked at any further."""

MOST_ERRORS: Final = 1000
"""Errors that are looked at one by one; nobody reads more, and each takes memory and time."""


@dataclass(frozen=True, slots=True)
class InPieces:
    """Marks a list that is checked in pieces, until enough of it is wrong.

    Parameters
    ----------
    most
        Entries that are allowed; at least one is needed.
    as_array
        Whether an array of double precision is made of it.
    """

    most: int
    at_once: int = ENTRIES_AT_ONCE
    as_array: bool = False

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        """Wrap the list's own check, which is made of each piece."""
        entries: Any = {**handler(source), "min_length": 1, "max_length": self.most}
        return core_schema.no_info_wrap_validator_function(self._check, entries)

    def _check(self, values: Any, check: ValidatorFunctionWrapHandler) -> Any:
        if not isinstance(values, list) or not values:
            return check(values)
        if len(values) > self.most:
            length = {"max_length": self.most, "actual_length": len(values)}
            raise PydanticKnownError("too_long", {"field_type": "List", **length})
        pieces: list[Any] = []
        wrong: list[InitErrorDetails] = []
        for first in range(0, len(values), self.at_once):
            try:
                piece = check(values[first : first + self.at_once])
            except ValidationError as error:
                wrong += _moved(error, first)
                if len(wrong) > ENOUGH_ERRORS:
                    break
                continue
            pieces.append(np.array(piece, dtype=np.float64) if self.as_array else piece)
        if wrong:
            raise ValidationError.from_exception_data("list", wrong)
        return np.concatenate(pieces) if self.as_array else list(chain.from_iterable(pieces))


def shown_errors(error: ValidationError) -> Sequence[Any]:
    """List what is wrong; where that is very much, say so instead."""
    count = error.error_count()
    if count <= MOST_ERRORS:
        return error.errors(include_url=False)
    return [
        {
            "type": "too_many_errors",
            "loc": (),
            "msg": "what is documented",
            "input": f"{count} errors",
        }
    ]


def _moved(error: ValidationError, first: int) -> list[InitErrorDetails]:
    """Name the entries of a piece by their places in the list."""
    moved: list[InitErrorDetails] = []
    for raw_error in shown_errors(error):
        place, *more = raw_error["loc"] or (0,)
        # An exception leads by its traceback to the frame of `_check`, and from there back to the
        # problem: into which the collector cannot see, so that the body would be held for ever.
        context = {
            k: v for k, v in raw_error.get("ctx", {}).items() if not isinstance(v, Exception)
        }
        problem = PydanticCustomError(
            raw_error["type"], "{said}", {**context, "said": raw_error["msg"]}
        )
        moved.append({"type": problem, "loc": (first + place, *more), "input": raw_error["input"]})
    return moved
