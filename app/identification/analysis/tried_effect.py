"""A given effect, found elsewhere, compared with a machine's own observations.

Nothing is fitted: form, parameters and size are stated before anybody looks. So every set-up of
this machine is held out, and the question is one test, not one of a library. What is estimated
is how much of the effect the machine shows, each set-up being one piece of evidence
(M. Quenouille, Biometrika 43, 353, 1956; R. Miller, Biometrika 61, 1, 1974: the jackknife).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Final, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy.special import stdtrit

from app.answer import Answer, Range, UnitSymbol
from app.arrays import FloatArray, IntArray, rms
from app.effects.effect import Effect
from app.effects.registry import do_the_same
from app.errors import InvalidContent, list_names
from app.identification.campaign import Campaign, residuals_of
from app.identification.residuals.residuals import channel_unit
from app.search.figures import RESAMPLED
from app.search.scatter import FEWEST_BLOCKS
from app.search.zeros import unknown_zeros, without_zeros

MISTAKEN: Final = 0.05
"""Of all machines on which an effect is tried together, the chance that one of those that do not
have it is said to have it, or one that has it not to."""

LEAST_SHARE: Final = 0.5
"""A machine that surely shows less of an effect than this does not have it in this size."""

CanTell: TypeAlias = Literal["yes", "no", "cannot-be-told", "adopted"]


@dataclass(frozen=True, slots=True)
class TriedEffect(Answer, published_as="TriedEffectAnswer"):
    """Whether a machine shows an effect that was found on another one."""

    verdict: CanTell
    """`yes`: it certainly reduces this machine's residuals too; `no`: the machine certainly shows
    less than half of it; `cannot-be-told`; `adopted`: this machine's model already has such an
    effect"""

    reason: str
    """One plain sentence"""

    setups: int
    """Set-ups that took part; none of them was used in finding it"""

    unit: UnitSymbol | None
    """Unit of the figures: the one in which the effect shows best; null where there are none"""

    before_rms: Annotated[float | None, Field(alias="before_rms_um")]
    """Root mean square of residuals where it acts [µm]; see `unit`"""

    after_rms: Annotated[float | None, Field(alias="after_rms_um")]
    """The same with the effect as it was found [µm]; see `unit`"""

    gain_ci95: Annotated[Range | None, Field(alias="gain_ci95_um")]
    """95 % interval of the reduction, over set-ups [µm]; see `unit`"""

    share: float | None
    """How much of the effect this machine shows: 1 is all of it, 0 nothing"""

    share_interval: Range | None
    """Interval of `share`; it widens with the number of machines tried together"""

    @property
    def gain(self) -> float | None:
        """By how much less is left; None where there are no figures."""
        if self.before_rms is None or self.after_rms is None:
            return None
        return self.before_rms - self.after_rms


def try_effect(campaign: Campaign, effect: Effect, tried_together: int = 1) -> TriedEffect:
    """Hold a given effect, as it stands, against a machine's observations.

    Parameters
    ----------
    campaign
        The machine's model, observations and readings; the effect has no part in them.
    tried_together
        On how many machines effects are tried in all, for the threshold.
    """
    if any(do_the_same(effect, adopted) for adopted in campaign.effects):
        return _untold(
            "adopted", "its model already has an effect of this kind on the same components"
        )
    sensors = campaign.model.machine.sensors
    if lacking := [name for name in effect.sensors if name not in sensors]:
        return _untold("cannot-be-told", f"it has no sensor {list_names(lacking)}")
    try:
        before = residuals_of(campaign)
        after = residuals_of(replace(campaign, effects=(*campaign.effects, effect)))
    except InvalidContent as error:
        return _untold("cannot-be-told", f"its observations cannot be compared: {error.detail}")
    rows = before.as_rows()
    residuals_after = np.full(len(before.kept), np.nan)
    residuals_after[after.kept] = after.values
    zeros = unknown_zeros(rows)
    comparable = np.isfinite(residuals_after[before.kept])
    plain = without_zeros(zeros, np.where(comparable, before.values, np.nan))
    corrected = without_zeros(zeros, np.where(comparable, residuals_after[before.kept], np.nan))
    predicted = plain - corrected
    acts = np.unique(rows.channel[comparable & (np.abs(predicted) > 0.0)])
    use = comparable & np.isin(rows.channel, acts)
    # A set-up in which it would not show is no evidence.
    use &= np.isin(rows.visit, np.unique(rows.visit[use & (np.abs(predicted) > 0.0)]))
    if not use.any():
        return _untold("cannot-be-told", "no observation shows the components on which it acts")
    units = np.array([channel_unit(name).symbol for name in before.rows.channels])
    return _judged(
        _TrialRows(plain[use], predicted[use], rows.visit[use], units[rows.channel[use]]),
        rows.channel[use],
        tried_together,
    )


@dataclass(frozen=True, eq=False)
class _TrialRows:
    """Residuals, what the effect predicts of them, their set-ups and units, shape (n,) each."""

    residuals: FloatArray
    predicted: FloatArray
    visit: IntArray
    units: NDArray[np.str_]


def _judged(trial: _TrialRows, channel: IntArray, tried_together: int) -> TriedEffect:
    """Judge residuals by what the effect predicts of them, set-up by set-up.

    The share is of all rows, each by what its channel scatters; figures are of the unit in which
    the effect shows best.
    """
    scale = _scatter(trial, channel)
    _, group = np.unique(trial.visit, return_inverse=True)
    agree = np.bincount(group, weights=trial.residuals * trial.predicted / scale**2)
    full = np.bincount(group, weights=(trial.predicted / scale) ** 2)
    setups, share = len(full), float(agree.sum() / full.sum())
    symbols, numbers = np.unique(trial.units, return_inverse=True)
    best = int(np.bincount(numbers, weights=(trial.predicted / scale) ** 2).argmax())
    of_channel = numbers == best
    residuals, residuals_after = (
        trial.residuals[of_channel],
        (trial.residuals - trial.predicted)[of_channel],
    )

    def answered(
        verdict: CanTell, reason: str, interval: Range | None, gain: Range | None
    ) -> TriedEffect:
        unit, before, after = str(symbols[best]), rms(residuals), rms(residuals_after)
        return TriedEffect(verdict, reason, setups, unit, before, after, gain, share, interval)

    if setups < FEWEST_BLOCKS:
        few = f"expected {FEWEST_BLOCKS} set-ups in which it would show, got {setups}"
        return answered("cannot-be-told", few, None, None)
    interval = _interval(agree.astype(np.float64), full.astype(np.float64), tried_together)
    gain = _gain(residuals, residuals_after, trial.visit[of_channel])
    shows = f"this machine shows {share:.2f} of the effect ({interval[0]:.2f} to {interval[1]:.2f})"
    if interval[0] > 0.0 and gain[0] > 0.0:
        return answered("yes", f"{shows}, and its residuals fall", interval, gain)
    if interval[1] < LEAST_SHARE:
        return answered("no", f"{shows}: less than half", interval, gain)
    why = "something moves alike, but it is not certain that residuals would fall"
    why = why if interval[0] > 0.0 else "its set-ups cannot decide"
    return answered("cannot-be-told", f"{shows}: {why}", interval, gain)


def _scatter(trial: _TrialRows, channel: IntArray) -> FloatArray:
    """Give what each row's channel scatters, with or without the effect, shape (n,)."""
    count = np.maximum(np.bincount(channel), 1)
    squares = [
        np.bincount(channel, weights=values**2) / count
        for values in (trial.residuals, trial.residuals - trial.predicted)
    ]
    least = np.sqrt(np.minimum(*squares))
    scatter: FloatArray = np.maximum(least, np.finfo(np.float64).tiny)[channel]
    return scatter


def _interval(agree: FloatArray, full: FloatArray, tried_together: int) -> Range:
    """Give the interval of the share, by leaving each set-up out once."""
    n = len(full)
    without = (agree.sum() - agree) / (full.sum() - full)
    error = float(np.sqrt((n - 1) / n * np.sum((without - without.mean()) ** 2)))
    reach = error * float(stdtrit(n - 1, 1.0 - MISTAKEN / tried_together / 2.0))
    share = float(agree.sum() / full.sum())
    return share - reach, share + reach


def _gain(residuals: FloatArray, residuals_after: FloatArray, visit: IntArray) -> Range:
    """Give the 95 % interval of the gain, drawing whole set-ups again."""
    _, group = np.unique(visit, return_inverse=True)
    count = np.bincount(group)
    n = len(count)
    picks = np.random.default_rng(0).multinomial(n, np.full(n, 1.0 / n), RESAMPLED)
    before, after = (
        np.sqrt(picks @ np.bincount(group, weights=values**2) / (picks @ count))
        for values in (residuals, residuals_after)
    )
    low, high = np.quantile(before - after, [0.025, 0.975])
    return float(low), float(high)


def _untold(verdict: CanTell, reason: str) -> TriedEffect:
    return TriedEffect(verdict, reason, 0, None, None, None, None, None, None)
