"""How visits that were held out fare with what would be adopted."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Final, NamedTuple

import numpy as np
from scipy.special import ndtri, stdtrit

from app.arrays import BoolArray, FloatArray, rms
from app.effects.words import MOST_NAMED
from app.errors import list_names
from app.identification.analysis.finished_search import FinishedSearch
from app.identification.residuals.residuals import channel_unit
from app.search.rows import Datum

ONE_SIDED: Final = 0.01
"""Probability by which a gain counts as one, and a visit as worse, although it is not."""

MARKEDLY: Final = 0.1
"""A visit is not markedly worse by less than this share of what it was."""

AGREES: Final = 0.05
"""Probability by which held-out set-ups seem to agree with a refit although it gains nothing."""

FEWEST_GAINS: Final = 5
"""Visits from which a mean gain has a lower bound."""


class Worse(NamedTuple):
    """A visit of one channel that gets markedly worse with what would be adopted."""

    rows: BoolArray
    channel: int
    before: float
    after: float


def markedly_worse(finished: FinishedSearch, predicted: FloatArray) -> Iterator[Worse]:
    """List the held-out visits, channel by channel, that get markedly worse."""
    seen = finished.use & np.isfinite(predicted)
    set_up = finished.set_up[seen]
    count = np.maximum(np.bincount(set_up), 1)
    before, after = (
        np.sqrt(
            np.bincount(set_up, finished.from_zero(finished.rows.values - part, seen) ** 2) / count
        )
        for part in (np.zeros(len(predicted)), predicted)
    )
    for which in np.unique(set_up[predicted[seen] != 0.0]).tolist():
        of_setup = seen & (finished.set_up == which)
        c, visit = int(finished.rows.channel[of_setup][0]), int(finished.rows.visit[of_setup][0])
        # Of many visits one is worse by chance more often than of one: each has its share of
        # ONE_SIDED.
        of_channel = np.unique(set_up[finished.rows.channel[seen] == c]).size
        often = -float(ndtri(ONE_SIDED / of_channel))
        scatter = _scatter_of_visit(finished, c, visit, int(count[which]))
        if after[which] - before[which] > max(MARKEDLY * before[which], often * scatter):
            yield Worse(of_setup, c, float(before[which]), float(after[which]))


def _scatter_of_visit(finished: FinishedSearch, channel: int, visit: int, count: int) -> float:
    """Say how far a visit lies off as a whole by its set-up and its repeatability."""
    noise, setup = finished.scatter(channel)
    is_zeroed = finished.rows.datum.get((visit, channel)) is Datum.FIRST
    # The noise of a first observation that is the zero is in all the others.
    return float(np.sqrt(setup**2 + noise**2 * (1.0 / count + is_zeroed)))


def size_left(finished: FinishedSearch, predicted: FloatArray, chosen: BoolArray) -> float:
    """Give the root mean square of what a prediction leaves of some rows, from their zero."""
    return rms(finished.from_zero(finished.rows.values - predicted, chosen))


def worse_words(finished: FinishedSearch, worse: Worse) -> str:
    """Say which visit gets worse, and by how much."""
    rows = finished.residuals.rows
    first = int(np.flatnonzero(worse.rows)[0])
    verification = rows.verifications[int(rows.verification[first])]
    setup = verification.observations[int(rows.observation[first])].setup
    name = rows.channels[worse.channel]
    where = list_names(
        [repr(verification.label), *([] if setup is None else [f"set-up {setup!r}"])]
    )
    return (
        f"the residuals of {name} would get worse in {where}, which was held out: from "
        f"{worse.before:.3g} to {worse.after:.3g} {channel_unit(name).symbol}"
    )


def is_refit_better(
    finished: FinishedSearch, channels: Collection[int], instead: FloatArray
) -> bool:
    """Whether held-out set-ups agree that effects of the model are better fitted anew.

    What was learnt before stays unless the mean by which the squares of its set-ups fall is
    surely above zero. Fitted beside something that resembles it, an effect may fit what was
    measured as well as before, and be wrong on any other day: then it has gained nothing here.

    Parameters
    ----------
    instead : ndarray, shape (n,)
        What is predicted of held-out rows where they stay; NaN: not held out.
    """
    seen = finished.use & np.isfinite(finished.findings.adopted) & np.isfinite(instead)
    anew, before = (
        gains_of_visits(finished, channels, predicted, seen)
        for predicted in (finished.findings.adopted, instead)
    )
    return is_above_zero(anew - before, AGREES)


def maps_that_harm(finished: FinishedSearch) -> str:
    """Say where what the model says leaves more than no compensation would; empty where nowhere.

    No verification took part in making the maps. By chance, it is said in one campaign of a
    hundred.
    """
    measured = finished.residuals.rows.measured
    # Without the model, as if minus what it says were adopted.
    of_maps = finished.rows.values - measured
    names = finished.residuals.rows.channels
    words = []
    for c in sorted(finished.findings.noise):
        of_channel = finished.use & (finished.rows.channel == c)
        gains = gains_of_visits(finished, [c], of_maps, of_channel)
        if is_above_zero(gains, ONE_SIDED / len(finished.findings.noise)):
            without, with_maps = (
                size_left(finished, prediction, of_channel)
                for prediction in (of_maps, np.zeros(len(measured)))
            )
            unit = channel_unit(names[c]).symbol
            words.append(f"{names[c]} {with_maps:.3g} instead of {without:.3g} {unit}")
    if not words:
        return ""
    return (
        "The present model makes these set-ups worse than no compensation: it leaves of "
        f"{list_names(words, MOST_NAMED)} (root mean square). "
    )


def is_above_zero(gains: FloatArray, chance: float) -> bool:
    """Whether the mean gain of set-ups is above zero but for a chance; not known of a few."""
    if len(gains) < FEWEST_GAINS:
        return False
    # Student's t, one-sided; the quantile of so small a probability is negative.
    error = float(np.std(gains, ddof=1)) / np.sqrt(len(gains))
    return bool(np.mean(gains) > -stdtrit(len(gains) - 1, chance) * error)


def gains_of_visits(
    finished: FinishedSearch, channels: Collection[int], predicted: FloatArray, chosen: BoolArray
) -> FloatArray:
    """Sum up by how much the squares of each visit fall, each row in its floor's, shape (v,)."""
    chosen = chosen & np.isin(finished.rows.channel, list(channels))
    before, after = (
        finished.from_zero(values, chosen)
        for values in (finished.rows.values, finished.rows.values - predicted)
    )
    gains = (before**2 - after**2) / np.sum(finished.scatters[chosen] ** 2, axis=1)
    _, visit = np.unique(finished.rows.visit[chosen], return_inverse=True)
    return np.bincount(visit, weights=gains).astype(np.float64)
