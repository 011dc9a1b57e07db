"""Talk to a thermap service from Python: one method a route, answers with types.

>>> from app.client import ThermapClient
>>> with ThermapClient("http://127.0.0.1:8000") as thermap:
...     table = thermap.compensation("mcfv5050", {"x-middle": 24.1})  # doctest: +SKIP
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from app.client.awaiting import AsyncThermapClient
    from app.client.blocking import ThermapClient
    from app.client.calls import TaggedTable, VolumetricErrors
    from app.client.errors import (
        ConflictError,
        InvalidContentError,
        NotAllowedError,
        NotListeningError,
        ServiceUnavailableError,
        ThermapClientError,
        TooLargeError,
        TooManyRequestsError,
        UnexpectedAnswerError,
        UnknownThingError,
    )

DEFAULT_URL: Final = "http://127.0.0.1:8000"
URL_VARIABLE: Final = "THERMAP_URL"
"""The variable of the environment that says where the service is."""

__all__ = [
    "DEFAULT_URL",
    "URL_VARIABLE",
    "AsyncThermapClient",
    "ConflictError",
    "InvalidContentError",
    "NotAllowedError",
    "NotListeningError",
    "ServiceUnavailableError",
    "TaggedTable",
    "ThermapClient",
    "ThermapClientError",
    "TooLargeError",
    "TooManyRequestsError",
    "UnexpectedAnswerError",
    "UnknownThingError",
    "VolumetricErrors",
]

_HOMES: Final = {
    "AsyncThermapClient": "awaiting",
    "ConflictError": "errors",
    "InvalidContentError": "errors",
    "NotAllowedError": "errors",
    "NotListeningError": "errors",
    "ServiceUnavailableError": "errors",
    "TaggedTable": "calls",
    "ThermapClient": "blocking",
    "ThermapClientError": "errors",
    "TooLargeError": "errors",
    "TooManyRequestsError": "errors",
    "UnexpectedAnswerError": "errors",
    "UnknownThingError": "errors",
    "VolumetricErrors": "calls",
}


def __getattr__(name: str) -> Any:
    """Load a client when it is asked for: the shapes of all answers take their time."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
