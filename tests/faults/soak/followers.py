"""Who follows a machine's stream, and hands what came to its owner."""

from __future__ import annotations

import json
import queue
import threading
import time
from contextlib import suppress

import httpx

from tests.faults.soak.asking import AGAIN_AFTER_S, Shop
from tests.faults.soak.owner import Owner

SILENCE_S = 4.0
"""After so long without an event the stream is followed anew: whether to go on is looked at."""


class Follower(threading.Thread):
    """Follows one stream, and again where it breaks off."""

    def __init__(self, shop: Shop, owner: Owner) -> None:
        super().__init__(name=f"follower of {owner.room}", daemon=True)
        self._shop, self._owner = shop, owner

    def run(self) -> None:
        self._owner.is_ready.wait()
        while not self._shop.ended.is_set():
            self._shop.working.wait()
            with suppress(httpx.HTTPError):
                self._follow()
            self._shop.ended.wait(AGAIN_AFTER_S)

    def _follow(self) -> None:
        url = f"{self._shop.url}{self._owner.room}/compensation/stream"
        with (
            httpx.Client(timeout=SILENCE_S, trust_env=False) as client,
            client.stream("GET", url, params={"min_change_um": 0.1}) as answer,
        ):
            kind = ""
            for line in answer.iter_lines():
                if self._shop.ended.is_set() or not self._shop.working.is_set():
                    return
                if line.startswith("event:"):
                    kind = line.removeprefix("event:").strip()
                elif line.startswith("data:") and kind == "table":
                    came = json.loads(line.removeprefix("data:"))
                    with suppress(queue.Full):
                        self._owner.told.put_nowait((time.time(), came))
