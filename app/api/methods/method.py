"""What a method of measuring is, over HTTP, in files and on pages: one record, in a file each."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from pydantic import ValidationError

from app.answer import fields_of
from app.errors import InvalidContent
from app.field_errors import field_error
from app.files.csv_measurements import read_csv_measurement
from app.files.csv_measurements.formats import Format
from app.files.read_body import ReadBody
from app.measurement.result import Evaluated
from app.services.context import Context
from app.services.measurements import (
    MeasurementAnswer,
    MeasurementRequest,
    Storing,
    store_measurement,
)
from app.thermal.machine import Machine

Request = TypeVar("Request", bound=MeasurementRequest)
Result = TypeVar("Result", bound=Evaluated)


def store_as_map(
    method: Method[Any, Any],
    context: Context,
    machine: Machine,
    body: MeasurementRequest,
    evaluated: Evaluated,
    storing: Storing,
) -> MeasurementAnswer:
    """Store a result as one error map, if that is asked for, and answer with it.

    Raises
    ------
    InvalidContent, Conflict
        As `store_measurement`.
    """
    fields = store_measurement(context, machine, method.name, body, evaluated, storing)
    return method.answer(**(fields_of(evaluated) | fields))


@dataclass(frozen=True, slots=True, eq=False)
class Method(Generic[Request, Result]):
    """One method, and all that is said of it.

    Parameters
    ----------
    name
        In URLs, on the command line, and in maps whose instrument nobody states.
    title
        On pages.
    summary, about
        Of its operation in the OpenAPI document.
    file
        The comment lines and columns of its tables.
    evaluate
        What makes a result of a body. It takes long with many readings, and waits for no database.
    store
        What stores the result as `Storing` has it, and answers.
    has_course
        Whether it lasts for hours, and its course can be stored as a verification.
    """

    name: str
    title: str
    summary: str
    about: str
    request: type[Request]
    file: Format
    evaluate: Callable[[Context, Machine, Request], Result]
    answer: type[MeasurementAnswer] = MeasurementAnswer
    store: Callable[
        [Method[Any, Any], Context, Machine, Request, Result, Storing], MeasurementAnswer
    ] = store_as_map
    has_course: bool = False

    @property
    def makes_one_map(self) -> bool:
        """Whether its result is one error map, and can be looked at as one."""
        return self.store is store_as_map

    def read(self, text: str, **named: Any) -> ReadBody:
        """Read a table of its readings, as `read_csv_measurement` does."""
        return read_csv_measurement(self.file, text, **named)

    def checked(self, fields: Mapping[str, Any]) -> Request:
        """Check a body that was read from a file, as one that came as JSON is.

        Raises
        ------
        InvalidContent
            With the body's fields that cannot be right.
        """
        try:
            return self.request.model_validate(fields)
        except ValidationError as error:
            problems = [field_error(raw) for raw in error.errors()]
            sentence = "; ".join(f"{problem.field}: {problem.message}" for problem in problems)
            raise InvalidContent(sentence, problems) from None
