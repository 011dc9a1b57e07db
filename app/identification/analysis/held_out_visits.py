"""How visits that were held out fare with what would be adopted."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Final, NamedTuple

import numpy as np
from scipy.stats import norm, t

from app.arrays import BoolArray, FloatArray, rms
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

MOST_NAMED: Final = 3
"""So many components are named."""

FEWEST_GAINS: Final = 5
"""Visits from which a mean gain has a lower bound."""


class Worse(NamedTuple):
    """A visit of one channel that gets markedly worse with what would be adopted."""

    rows: BoolArray
    channel: int
    before: float
    after: float


def markedly_worse(found: FinishedSearch, predicted: FloatArray) -> Iterator[Worse]:
    """List the held-out visits, channel by channel, that get markedly worse."""
    seen = found.use & np.isfinite(predicted)
    set_up = found.set_up[seen]
    count = np.maximum(np.bincount(set_up), 1)
    before, after = (
        np.sqrt(np.bincount(set_up, found.from_zero(found.rows.values - part, seen) ** 2) / count)
        for part in (np.zeros(len(predicted)), predicted)
    )
    for one in np.unique(set_up[predicted[seen] != 0.0]).tolist():
        own = seen & (found.set_up == one)
        c, visit = int(found.rows.channel[own][0]), int(found.rows.visit[own][0])
        of_channel = np.unique(set_up[found.rows.channel[seen] == c]).size
        often = float(norm.isf(ONE_SIDED / of_channel))
        scatter = _scatter_of_visit(found, c, visit, int(count[one]))
        if after[one] - before[one] > max(MARKEDLY * before[one], often * scatter):
            yield Worse(own, c, float(before[one]), float(after[one]))


def _scatter_of_visit(found: FinishedSearch, channel: int, visit: int, count: int) -> float:
    """Say how far a visit lies off as a whole by its set-up and its repeatability."""
    noise, setup = found.scatter(channel)
    is_zeroed = found.rows.datum.get((visit, channel)) is Datum.FIRST
    return float(np.sqrt(setup**2 + noise**2 * (1.0 / count + is_zeroed)))


def size_left(found: FinishedSearch, predicted: FloatArray, own: BoolArray) -> float:
    """Give the root mean square of what a prediction leaves of some rows, from their zero."""
    return rms(found.from_zero(found.rows.values - predicted, own))


def worse_words(found: FinishedSearch, worse: Worse) -> str:
    """Say which visit gets worse, and by how much."""
    rows = found.residuals.rows
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


def is_refit_better(found: FinishedSearch, channels: Collection[int], instead: FloatArray) -> bool:
    """Whether held-out set-ups agree that effects of the model are better fitted anew.

    What was learnt before stays unless the mean by which the squares of its set-ups fall is
    surely above zero. Fitted beside something that resembles it, an effect may fit what was
    measured as well as before, and be wrong on any other day: then it has gained nothing here.

    Parameters
    ----------
    instead : ndarray, shape (n,)
        What is predicted of held-out rows where they stay; NaN: not held out.
    """
    seen = found.use & np.isfinite(found.findings.adopted) & np.isfinite(instead)
    anew, before = (
        gains_of_visits(found, channels, predicted, seen)
        for predicted in (found.findings.adopted, instead)
    )
    return is_above_zero(anew - before, AGREES)


def maps_that_harm(found: FinishedSearch) -> str:
    """Say where what the model says leaves more than no compensation would; empty where nowhere.

    No verification took part in making the maps. By chance, it is said in one campaign of a
    hundred.
    """
    measured = found.residuals.rows.measured
    # Without the model, as if minus what it says were adopted.
    of_maps = found.rows.values - measured
    names = found.residuals.rows.channels
    words = []
    for c in sorted(found.findings.noise):
        own = found.use & (found.rows.channel == c)
        gains = gains_of_visits(found, [c], of_maps, own)
        if is_above_zero(gains, ONE_SIDED / len(found.findings.noise)):
            without, with_maps = (
                size_left(found, said, own) for said in (of_maps, np.zeros(len(measured)))
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
    error = float(np.std(gains, ddof=1)) / np.sqrt(len(gains))
    return bool(np.mean(gains) > t.isf(chance, len(gains) - 1) * error)


def gains_of_visits(
    found: FinishedSearch, channels: Collection[int], predicted: FloatArray, chosen: BoolArray
) -> FloatArray:
    """Sum up by how much the squares of each visit fall, each row in its floor's, shape (v,)."""
    chosen = chosen & np.isin(found.rows.channel, list(channels))
    before, after = (
        found.from_zero(values, chosen)
        for values in (found.rows.values, found.rows.values - predicted)
    )
    gains = (before**2 - after**2) / np.sum(found.scatters[chosen] ** 2, axis=1)
    _, visit = np.unique(found.rows.visit[chosen], return_inverse=True)
    return np.bincount(visit, weights=gains).astype(np.float64)
