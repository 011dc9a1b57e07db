"""What a service refuses, as exceptions that carry its own words.

    ThermapClientError
     ├─ UnknownThingError        404: a machine, map, model … that does not exist
     ├─ ConflictError            409: it contradicts what is stored
     ├─ TooLargeError            413: send it in parts
     ├─ InvalidContentError      422: the content cannot be right
     ├─ NotAllowedError          401, 403: refused for who asks, or from where
     ├─ TooManyRequestsError     429: come back later; wrong keys came too often
     ├─ ServiceUnavailableError  503, or no answer in time: try again
     │   └─ NotListeningError        nobody listens at the URL
     ├─ NotAnalysedError         the analysis that was waited for failed or was cancelled
     └─ UnexpectedAnswerError    any other status, or an answer that is not thermap's

Each has the sentence, the status and the fields that are to blame.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import httpx


@dataclass(frozen=True, slots=True)
class FieldError:
    """One field that is to blame: its path, and what was expected, what came, the unit."""

    field: str
    message: str


class ThermapClientError(Exception):
    """Anything that kept a call from being answered.

    Attributes
    ----------
    detail : str
        The reason in a sentence, the service's own where there is one.
    status : int or None
        HTTP status, None where there was no answer.
    errors : sequence of FieldError
        The fields that are to blame, each with what was expected and what came.
    """

    def __init__(
        self, detail: str, status: int | None = None, errors: Iterable[FieldError] = ()
    ) -> None:
        super().__init__(detail)
        self.detail = detail
        self.status = status
        self.errors: Sequence[FieldError] = tuple(errors)

    @property
    def sentence(self) -> str:
        """The detail, and the fields that are to blame where it does not name them."""
        unnamed = [error.field for error in self.errors if error.field not in self.detail]
        if not unnamed:
            return self.detail
        more = f" and {len(unnamed) - 3} more" if len(unnamed) > 3 else ""
        return f"{self.detail} (at {', '.join(unnamed[:3])}{more})"


class UnknownThingError(ThermapClientError):
    """404: something that does not exist was named; the sentence lists what exists."""


class ConflictError(ThermapClientError):
    """409: the request contradicts what is stored, or there is no reading yet."""


class TooLargeError(ThermapClientError):
    """413: the body is larger than the service takes."""


class InvalidContentError(ThermapClientError):
    """422: the content cannot be right; `errors` says where."""


class NotAllowedError(ThermapClientError):
    """401 or 403: who asks, or from where, is not allowed this.

    State a key: `ThermapClient(key=…)`, or THERMAP_KEY in the environment.
    """


class TooManyRequestsError(ThermapClientError):
    """429: wrong keys came too often from this address, or a proxy has had too many requests."""


class ServiceUnavailableError(ThermapClientError):
    """503, 507 (its disk is full), or no answer in time: the same call may succeed later."""


class NotListeningError(ServiceUnavailableError):
    """Nobody listens at the URL."""


class NotAnalysedError(ThermapClientError):
    """An analysis that was waited for failed, or somebody cancelled it."""


class UnexpectedAnswerError(ThermapClientError):
    """An answer that the client does not understand: perhaps another service's."""


_BY_STATUS: Final[Mapping[int, type[ThermapClientError]]] = {
    401: NotAllowedError,
    403: NotAllowedError,
    404: UnknownThingError,
    409: ConflictError,
    413: TooLargeError,
    422: InvalidContentError,
    429: TooManyRequestsError,
    **dict.fromkeys((502, 503, 504, 507), ServiceUnavailableError),
}
_OF_THE_SERVICE_ALONE: Final = frozenset({404, 409, 422, 507})
"""What means this from the service alone, and not from what stands between client and service."""


def error_of(response: httpx.Response) -> ThermapClientError:
    """Read the error out of an answer that is not the one hoped for.

    Parameters
    ----------
    response
        A whole answer with a status other than success.

    Returns
    -------
    ThermapClientError
        Of the kind that the status means, with the problem's text (RFC 9457).
    """
    status = response.status_code
    problem = _problem(response)
    if problem is not None:
        kind = _BY_STATUS.get(status, UnexpectedAnswerError)
        errors = [
            FieldError(str(e.get("field", "")), str(e.get("message", "")))
            for e in problem.get("errors", [])
            if isinstance(e, dict)
        ]
        return kind(str(problem["detail"]), status, errors)
    kind = _BY_STATUS.get(status, UnexpectedAnswerError)
    if status in _OF_THE_SERVICE_ALONE:
        kind = UnexpectedAnswerError
    return kind(
        f"{response.url} answered {status} {response.reason_phrase}{_target(response)}, "
        "and not as a thermap does",
        status,
    )


def unreadable(response: httpx.Response, reason: object) -> UnexpectedAnswerError:
    """Say that an answer has the right status and the wrong content."""
    return UnexpectedAnswerError(
        f"the answer of {response.url} is not one of thermap's: {reason}", response.status_code
    )


def _problem(response: httpx.Response) -> dict[str, Any] | None:
    """Read a problem document, None where the answer is something else."""
    if not response.headers.get("content-type", "").startswith("application/problem+json"):
        return None
    try:
        document = json.loads(response.content)
    except ValueError:  # also text that is no UTF-8
        return None
    return document if isinstance(document, dict) and "detail" in document else None


def _target(response: httpx.Response) -> str:
    location = response.headers.get("location")
    return f" (to {location})" if location else ""
