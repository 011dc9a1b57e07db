"""Talk to a thermap service from Python: one method a route, answers with types.

>>> from app.client import ThermapClient
>>> with ThermapClient("http://127.0.0.1:8000") as thermap:
...     table = thermap.compensation("mcfv5050", {"x-middle": 24.1})  # doctest: +SKIP
"""

from app.client.awaiting import AsyncThermapClient
from app.client.blocking import ThermapClient
from app.client.calls import TaggedTable, VolumetricErrors
from app.client.connection import DEFAULT_URL
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

__all__ = [
    "DEFAULT_URL",
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
