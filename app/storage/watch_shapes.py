"""Judgements of verifications, and the states of watches, as JSON."""

from __future__ import annotations

from typing import Final

from app.identification.watch.watching import Judgement, WatchState
from app.storage.stored_shapes import StoredShape, unchanged

JUDGEMENTS: Final = StoredShape(Judgement, "a judgement of a verification", [unchanged])
WATCH_STATES: Final = StoredShape(WatchState, "the state of a watch", [unchanged])
