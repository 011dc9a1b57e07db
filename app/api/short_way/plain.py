"""Plain requests: which they are, and reading them without taking them from the ordinary way."""

from __future__ import annotations

from collections import deque
from collections.abc import Awaitable, Callable
from typing import Final, NamedTuple

from starlette.types import Message, Receive, Scope

from app.api.media_types import JSON
from app.services.context import Context

MACHINES: Final = "/v1/machines/"
_JSON: Final = JSON.encode()


class Answer(NamedTuple):
    """What a short way answers: JSON."""

    status: int
    content: bytes


class ShortWay(NamedTuple):
    """A short way past the framework, for requests with a body of at most so many bytes.

    `answer` is handed the context, the machine's id and the body. It gives None where anything is
    not as it should be, which the ordinary way looks at again and puts into words; it raises
    StorageUnavailable where the database is away.
    """

    route: str
    longest: int
    answer: Callable[[Context, str, bytes], Awaitable[Answer | None]]


def machine_and_room(scope: Scope) -> tuple[str, str] | None:
    """Take a plain request's path apart: the machine's id and what comes after; else None."""
    if (
        scope["method"] != "POST"
        or scope["query_string"]
        or not scope["path"].startswith(MACHINES)
        or scope.get("root_path")
        or [v for k, v in scope["headers"] if k == b"content-type"] != [_JSON]
        # What a page of another site may read is said in headers that the ordinary way writes.
        or any(k == b"origin" for k, _ in scope["headers"])
    ):
        return None
    machine_id, _, room = scope["path"][len(MACHINES) :].partition("/")
    return machine_id, room


def may_be_short(scope: Scope, longest: int) -> bool:
    """Say whether a request's head leaves its body short: a long one is refused before it comes."""
    stated = next((v for k, v in scope["headers"] if k == b"content-length"), b"0")
    return stated.isdigit() and int(stated) <= longest


async def read_short(receive: Receive, longest: int) -> tuple[list[Message], bytes | None]:
    """Read a short body whole, or as much of a long one as shows that it is long (None)."""
    messages = []
    body = b""
    while True:
        message = await receive()
        messages.append(message)
        body += message.get("body", b"")
        # A sender who went away is the ordinary way's as well: it has been told, and ends.
        if len(body) > longest or message["type"] != "http.request":
            return messages, None
        if not message.get("more_body", False):
            return messages, body


def again(read: list[Message], receive: Receive) -> Receive:
    """Hand out once more what has been read, then whatever follows."""
    waiting = deque(read)

    async def receive_again() -> Message:
        return waiting.popleft() if waiting else await receive()

    return receive_again
