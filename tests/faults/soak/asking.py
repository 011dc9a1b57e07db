"""Requests that are sent until they are answered, whatever becomes of the service meanwhile."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass, field
from typing import Any

import httpx

from tests.faults.soak.tally import Tally

PATIENCE_S = 60.0
AGAIN_AFTER_S = 0.2
AWAY = (503, 507)


class Ended(Exception):
    """The soak is over: nobody waits for an answer any more."""


@dataclass
class Shop:
    """What all of one soak share: where the service is now, and whether they shall work."""

    url: str
    tally: Tally
    ended: threading.Event = field(default_factory=threading.Event)
    working: threading.Event = field(default_factory=threading.Event)


@dataclass(frozen=True)
class Answered:
    """An answer, and between which times [s since 1970] it was made.

    `began_s` is when it was first asked for: what is written can have been there since then.
    """

    status: int
    content: Any
    began_s: float
    sent_s: float
    received_s: float
    is_repeated: bool


class Asker:
    """Asks one thing after the other, over a connection that is kept."""

    def __init__(self, shop: Shop) -> None:
        self._shop = shop
        self._client = httpx.Client(timeout=PATIENCE_S, trust_env=False)

    def close(self) -> None:
        self._client.close()

    def ask(self, method: str, path: str, body: Any = None, **query: Any) -> Answered:
        """Ask until there is an answer that is not of a service that is away.

        Raises
        ------
        Ended
            If the soak ends before.
        """
        began_s = time.time()
        is_repeated = False
        while True:
            sent_s = time.time()
            try:
                answer = self._client.request(
                    method, self._shop.url + path, json=body, params=query or None
                )
                self._shop.tally.answer(answer.status_code)
                if answer.status_code not in AWAY:
                    break
            except httpx.TransportError:
                self._shop.tally.answer(0)
            is_repeated = True
            if self._shop.ended.wait(AGAIN_AFTER_S):
                raise Ended
        received_s = time.time()
        if answer.status_code >= 500:
            self._shop.tally.find(f"{method} {path}: {answer.status_code} {answer.text[:300]}")
        kind = answer.headers.get("content-type", "")
        content = answer.json() if "json" in kind and answer.content else answer.text
        return Answered(answer.status_code, content, began_s, sent_s, received_s, is_repeated)
