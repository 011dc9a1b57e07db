"""Judgements of verifications, and the states of watches, as JSON."""

from __future__ import annotations

from typing import Final

from app.identification.watch.setups import PAIRS
from app.identification.watch.watching import Judgement, WatchState
from app.search.priors import WATCH_CORRELATIONS
from app.storage.stored_shapes import Fields, StoredShape, unchanged


def _with_correlated_setups(stored: Fields) -> Fields:
    """Go on from a state that took set-ups as independent.

    What it knew of the scatter is taken for each correlation; the correlation is learnt from
    now on.
    """
    return stored | {
        "streams": {key: _tracked(stream) for key, stream in stored["streams"].items()}
    }


def _tracked(stream: Fields) -> Fields:
    nothing = [0.0] * PAIRS
    track = {
        "constants": [stream["mean"]] * PAIRS,
        "setups": nothing,
        "of_constants": [stream["variance"]] * PAIRS,
        "of_both": nothing,
        # Of the latest set-up itself nothing was kept: it may have been anything.
        "of_setups": [stream["expected"] ** 2] * PAIRS,
    }
    return {
        "unchanged": track,
        "learnt": track,
        "likelihoods": [likelihood for likelihood in stream["setups"] for _ in WATCH_CORRELATIONS],
        **{key: stream[key] for key in ("process", "value", "expected")},
    }


def _with_expected_squares(stored: Fields) -> Fields:
    """Go on from a state that did not know what scatter was stated: nothing contradicts it yet."""
    noise = {key: entry | {"expected": entry["squares"]} for key, entry in stored["noise"].items()}
    return stored | {"noise": noise}


JUDGEMENTS: Final = StoredShape(Judgement, "a judgement of a verification", [unchanged])
WATCH_STATES: Final = StoredShape(
    WatchState, "the state of a watch", [unchanged, _with_correlated_setups, _with_expected_squares]
)
