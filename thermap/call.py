"""One request to the service: how its body is written, and how its answer is read."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from datetime import datetime
from functools import cache
from inspect import Parameter, Signature, signature
from typing import Any, Generic, TypeAlias, TypeVar, cast

import httpx
from pydantic import BaseModel, TypeAdapter, ValidationError

from thermap.errors import error_of, unreadable

Answer = TypeVar("Answer")

Content: TypeAlias = BaseModel | Mapping[str, Any]
"""What a body may be: a mapping with the fields that `/docs` shows, or a shape of an answer."""


@dataclass(frozen=True, slots=True)
class Call(Generic[Answer]):
    """One request and how its answer is read.

    `answered_by` lists the statuses beyond success that carry an answer and no problem;
    `patience_s` is for an answer that takes longer than others to be made [s].
    """

    method: str
    path: str
    read: Callable[[httpx.Response], Answer]
    body: Any = None
    query: Mapping[str, Any] = field(default_factory=dict)
    headers: Mapping[str, str] = field(default_factory=dict)
    answered_by: frozenset[int] = frozenset()
    patience_s: float = 0.0

    def request(self, timeout_s: float) -> dict[str, Any]:
        """Write the arguments of httpx' `request`; `timeout_s` is the client's limit."""
        sent: dict[str, Any] = {"method": self.method, "url": self.path, "headers": self.headers}
        sent["timeout"] = self.waits_s(timeout_s)
        if self.query:
            sent["params"] = {
                k: [_text(item) for item in v] if isinstance(v, list) else _text(v)
                for k, v in self.query.items()
                if v is not None
            }
        if self.body is not None:
            is_file = isinstance(self.body, bytes)
            sent["content"] = (
                self.body if is_file else json.dumps(_plain(self.body), default=_plain).encode()
            )
            kind = "application/octet-stream" if is_file else "application/json"
            sent["headers"] = {**self.headers, "Content-Type": kind}
        return sent

    def waits_s(self, timeout_s: float) -> float:
        """Give how long to wait for the answer [s]; `timeout_s` is the client's limit."""
        return max(timeout_s, self.patience_s)

    def checked(self, response: httpx.Response) -> httpx.Response:
        """Return the response, or raise the error that it carries."""
        if response.is_success or response.status_code in self.answered_by:
            return response
        raise error_of(response)

    def answer(self, response: httpx.Response) -> Answer:
        """Read the answer, or raise the error that the response carries."""
        try:
            return self.read(self.checked(response))
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            where = ".".join(map(str, first["loc"])) or "body"
            raise unreadable(response, f"{where}: {first['msg']}") from error


def of_method(call: Callable[..., Call[Any]]) -> Signature:
    """Give the signature of a client's method that sends such a call, and gives its answer."""
    described = signature(call)  # its annotations are text: the answer's is within `Call[]`
    answer = str(described.return_annotation).removeprefix("Call[").removesuffix("]")
    itself = Parameter("self", Parameter.POSITIONAL_ONLY)
    return Signature([itself, *described.parameters.values()], return_annotation=answer)


def reader_of(kind: type[Answer]) -> Callable[[httpx.Response], Answer]:
    """Make the reader of a JSON answer; fields that a newer service adds are passed over."""

    def read(response: httpx.Response) -> Answer:
        adapter = _adapter(cast("Any", kind))
        answer: Answer = adapter.validate_json(response.content, extra="ignore")
        return answer

    return read


def parsed(kind: type[Answer], data: str) -> Answer:
    """Read JSON as an answer is read that comes alone."""
    answer: Answer = _adapter(cast("Any", kind)).validate_json(data, extra="ignore")
    return answer


def nothing(_response: httpx.Response) -> None:
    """Read an answer that has no content."""


@cache
def _adapter(kind: Any) -> TypeAdapter[Any]:
    return TypeAdapter(kind)


def _text(value: Any) -> str:
    return value.isoformat() if isinstance(value, datetime) else str(value)


def _plain(value: Any) -> Any:
    """Write what JSON does not know: schemas, arrays, times.

    Of a schema only the fields that were stated are sent: the service has the
    defaults, and in a PATCH the others are to stay. NaN goes out as NaN, for the
    service to refuse; null would be accepted where a field may be empty.
    """
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json", exclude_unset=True, by_alias=True)
    if callable(tolist := getattr(value, "tolist", None)):
        return tolist()  # an array or number of numpy, which need not be there
    if isinstance(value, datetime):
        return value.isoformat()
    if isinstance(value, Mapping):
        return dict(value)
    if isinstance(value, Iterable) and not isinstance(value, str | bytes):
        return list(value)
    raise TypeError(f"expected something that JSON can carry, got {type(value).__name__}")
