"""Talk to a thermap service from Python: one method a route, answers with types.

>>> from thermap import ThermapClient
>>> with ThermapClient("http://127.0.0.1:8000") as client:
...     table = client.compensation("mcfv5050", {"x-middle": 24.1})  # doctest: +SKIP

Answers are the shapes of `thermap.answers`, which is generated from the service's OpenAPI document;
bodies are mappings with the fields that the service's `/docs` shows.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from thermap._async.client import AsyncThermapClient
    from thermap._sync.client import ThermapClient
    from thermap.calls import TaggedTable, VolumetricErrors
    from thermap.errors import (
        ConflictError,
        FieldError,
        InvalidContentError,
        NotAllowedError,
        NotAnalysedError,
        NotListeningError,
        ServiceUnavailableError,
        ThermapClientError,
        TooLargeError,
        TooManyRequestsError,
        UnexpectedAnswerError,
        UnknownThingError,
    )
    from thermap.following import Told

__version__ = "0.1.0"

DEFAULT_URL: Final = "http://127.0.0.1:8000"
URL_VARIABLE: Final = "THERMAP_URL"
"""The variable of the environment that says where the service is."""

KEY_VARIABLE: Final = "THERMAP_KEY"
"""The variable of the environment that has the key, where the service asks for one."""

__all__ = [
    "DEFAULT_URL",
    "KEY_VARIABLE",
    "URL_VARIABLE",
    "AsyncThermapClient",
    "ConflictError",
    "FieldError",
    "InvalidContentError",
    "NotAllowedError",
    "NotAnalysedError",
    "NotListeningError",
    "ServiceUnavailableError",
    "TaggedTable",
    "ThermapClient",
    "ThermapClientError",
    "Told",
    "TooLargeError",
    "TooManyRequestsError",
    "UnexpectedAnswerError",
    "UnknownThingError",
    "VolumetricErrors",
    "__version__",
]

_HOMES: Final = {
    "AsyncThermapClient": "_async.client",
    "ThermapClient": "_sync.client",
    "TaggedTable": "calls",
    "VolumetricErrors": "calls",
    "Told": "following",
} | dict.fromkeys((name for name in __all__ if name.endswith("Error")), "errors")


def __getattr__(name: str) -> Any:
    """Load a client when it is asked for: httpx and the shapes of all answers take their time."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
