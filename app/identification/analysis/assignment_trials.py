"""A component's maps read by every other sensor, held against what its own sensor leaves.

The numbers of `app.identification.analysis.assignments`, which says what follows from them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from app.arrays import BoolArray, FloatArray, IntArray, rms
from app.effects.campaign_view import KNOWN_SHARE
from app.effects.projection import View
from app.errors import ThermapError
from app.geometry.components import COMPONENTS, ORDER
from app.identification.analysis.set_ups import SetUps
from app.identification.campaign import Campaign
from app.identification.residuals.residuals import Residuals
from app.thermal.compile_model import compile_model
from app.thermal.compiled_model import CompiledModel
from app.thermal.prediction import predict_component
from app.units import Unit

DRAWN: Final = 4000
"""So often the signs of all set-ups are drawn."""

SEED: Final = 0
"""Of the signs: the same campaign gives the same answer, whatever else is drawn."""

SURE: Final = 0.01
"""Probability that as many set-ups get better by chance."""

LEAST_GAIN: Final = 0.1
"""Share of the root mean square that another sensor must take away."""

WORSE_SHARE, WORSE_BESIDE_OTHERS = 0.1, 0.5
"""A set-up gets markedly worse if it loses more than the first share of itself and more than the
second of what the middle one is left with."""

AS_GOOD: Final = 0.05
"""Share of a root mean square by which sensors differ that do as well."""

ROUNDING: Final = 1e-9
"""Residuals and statistics that differ by no more are the same."""


@dataclass(frozen=True, eq=False)
class OtherSensors:
    """One component, and what other sensors would change in the rows in which it shows.

    Parameters
    ----------
    view
        The rows in which it shows.
    sensors
        Those that its maps can be read by in nearly all of these rows.
    changes : ndarray, shape (S, m)
        What each of them adds to what is predicted, in the rows of the view [the rows' units].
    """

    code: str
    present: str
    view: View
    sensors: tuple[str, ...]
    changes: FloatArray


@dataclass(frozen=True, eq=False)
class Trial:
    """One component over all other sensors, held against what its own sensor leaves."""

    set_ups: SetUps
    other: OtherSensors

    @cached_property
    def shows(self) -> IntArray:
        """All rows of the channels in which it shows: a zero may move them all, shape (m,)."""
        return np.flatnonzero(np.isin(self.set_ups.channel, self.other.view.channels))

    @cached_property
    def _of_itself(self) -> BoolArray:
        """Which of all rows are of the component by itself."""
        channels = self.set_ups.residuals.rows.channels
        number = channels.index(self.other.code) if self.other.code in channels else -1
        of_itself: BoolArray = self.set_ups.channel == number
        return of_itself

    @cached_property
    def is_direct(self) -> bool:
        """Whether values of the component by itself are judged; else those at points.

        One value in a set-up is that set-up's zero: nothing is left of it whatever the sensor.
        """
        tells = np.any(np.abs(self.set_ups.remaining[self._of_itself]) > ROUNDING)
        return bool(tells or self._of_itself[self.other.view.rows].all())

    @cached_property
    def compared(self) -> BoolArray:
        """The rows that figures are of: of the component itself, or else at points, shape (m,)."""
        of_itself = self._of_itself[self.shows]
        return of_itself if self.is_direct else ~of_itself

    @property
    def unit(self) -> str:
        """Unit of figures: the component's, or µm at points."""
        return (COMPONENTS[self.other.code].unit if self.is_direct else Unit.UM).symbol

    @cached_property
    def remaining(self) -> FloatArray:
        """What its own sensor, then each other one leaves, from each zero, shape (1 + S, m)."""
        present = self.set_ups.remaining[self.shows]
        others = [self._without(k).remaining[self.shows] for k in range(len(self.other.sensors))]
        return np.array([present, *others])

    def _without(self, which: int) -> SetUps:
        return self.set_ups.without(self.other.view.rows, self.other.changes[which])

    @cached_property
    def scale(self) -> FloatArray:
        """What the best sensor leaves of each row's channel, shape (m,) [its unit]."""
        channel = self.set_ups.channel[self.shows]
        scale = np.ones(len(channel))
        for number in np.unique(channel):
            here = channel == number
            scale[here] = np.sqrt(np.mean(self.remaining[:, here] ** 2, axis=1)).min() or 1.0
        return scale

    @cached_property
    def _place(self) -> IntArray:
        return self.set_ups.place[self.shows]

    @cached_property
    def losses(self) -> FloatArray:
        """Sum of the squares that are left of each set-up, over the scale's, shape (1 + S, V)."""
        scaled = (self.remaining / self.scale) ** 2
        return np.array(
            [np.bincount(self._place, weights=row, minlength=self.set_ups.count) for row in scaled]
        )

    @cached_property
    def shares(self) -> FloatArray:
        """By how much less root of that each other sensor leaves of each set-up, shape (S, V).

        The root, as single set-ups would else be nearly all of a sum.
        """
        gains: FloatArray = np.sqrt(self.losses[0]) - np.sqrt(self.losses[1:])
        return gains

    @cached_property
    def chosen(self) -> IntArray:
        """The other sensor that all other set-ups choose, for each set-up, shape (V,)."""
        # The sum over all set-ups less each by itself: what all others lose.
        others = self.losses[1:].sum(axis=1)[:, None] - self.losses[1:]
        best: IntArray = np.argmin(others, axis=0)
        return best

    @cached_property
    def best(self) -> int:
        """The other sensor that leaves least of all set-ups."""
        return int(np.argmin(self.losses[1:].sum(axis=1)))

    @property
    def sensor(self) -> str:
        """Its name."""
        return self.other.sensors[self.best]

    @property
    def as_good(self) -> tuple[str, ...]:
        """The sensors that leave nearly as little as the best, in the rows that figures are of."""
        sizes = [rms(residuals[self.compared]) for residuals in self.remaining[1:]]
        return tuple(
            name
            for name, size in zip(self.other.sensors, sizes, strict=True)
            if name != self.sensor and size <= (1.0 + AS_GOOD) * sizes[self.best]
        )

    @cached_property
    def after(self) -> FloatArray:
        """What the sensor leaves that the other set-ups choose, shape (m,)."""
        residuals_after: FloatArray = self.remaining[
            1 + self.chosen[self._place], np.arange(len(self.shows))
        ]
        return residuals_after

    @cached_property
    def losses_after(self) -> FloatArray:
        """Of each set-up the loss by the sensor that the others choose, shape (V,)."""
        losses: FloatArray = self.losses[1 + self.chosen, np.arange(self.set_ups.count)]
        return losses

    @property
    def gain(self) -> float:
        """By how much the loss of all set-ups gets smaller, each held out."""
        return float(self.losses[0].sum() - self.losses_after.sum())

    @property
    def statistic(self) -> float:
        """The gain of set-ups held out for its own size: as `largest_by_chance` has it."""
        gains = np.sqrt(self.losses[0]) - np.sqrt(self.losses_after)
        size = float(np.sqrt(np.sum(gains**2)))
        return float(gains.sum()) / size if size else 0.0

    @cached_property
    def each(self) -> tuple[IntArray, FloatArray, FloatArray]:
        """The set-ups in which it shows: places, and root mean squares before and after."""
        counts = np.bincount(self._place, minlength=self.set_ups.count)
        here = np.flatnonzero(counts)
        before, after = (
            np.sqrt(losses[here] / counts[here]) for losses in (self.losses[0], self.losses_after)
        )
        return here, before, after

    @property
    def harmed(self) -> int | None:
        """The set-up that gets worst of those that get markedly worse; None where none does."""
        places, before, after = self.each
        may = np.maximum(WORSE_SHARE * before, WORSE_BESIDE_OTHERS * float(np.median(after)))
        excess = after - before - may
        return int(places[np.argmax(excess)]) if excess.max() > 0.0 else None

    @property
    def taken_off(self) -> SetUps:
        """What is left where the best other sensor is assigned."""
        return self._without(self.best)


def read_by_others(campaign: Campaign, residuals: Residuals) -> Iterator[OtherSensors]:
    """Predict each component by every other sensor, where its maps can be read by that."""
    model = campaign.model
    assigned = {code: group.sensor for group in model.groups for code in group.codes}
    by_sensor = {name: _by(campaign, assigned, name) for name in model.machine.sensors}
    for code in sorted(assigned, key=ORDER.__getitem__):
        view = residuals.projection.view(code)
        if not view.rows.size:
            continue
        present = _predicted(model, code, view)
        changes_by_sensor: dict[str, FloatArray] = {}
        for name, model_of in by_sensor.items():
            other = model_of(code) if name != assigned[code] else None
            if other is None:
                continue
            change = view.gains * (_predicted(other, code, view) - present)
            # Where a reading is missing a stand-in serves, or nothing is moved; where many are,
            # nothing is known of the sensor itself.
            usable = np.isfinite(view.conditions.temperature(name)) & np.isfinite(change)
            if usable.mean() >= KNOWN_SHARE:
                changes_by_sensor[name] = np.nan_to_num(change, nan=0.0)
        changes = np.array(list(changes_by_sensor.values())).reshape(
            len(changes_by_sensor), view.rows.size
        )
        yield OtherSensors(code, assigned[code], view, tuple(changes_by_sensor), changes)


def _by(
    campaign: Campaign, assigned: Mapping[str, str], sensor: str
) -> Callable[[str], CompiledModel | None]:
    """Compile the maps over one sensor: once for all components, or each that it can be by itself.

    Returns
    -------
    callable
        Code to a model that has it so, None where its maps cannot be read by the sensor.
    """

    def compiled(codes: Sequence[str]) -> CompiledModel | None:
        wanted = {**assigned, **dict.fromkeys(codes, sensor)}
        try:
            return compile_model(campaign.model.machine, campaign.maps, wanted)
        except ThermapError:
            return None

    together = compiled(list(assigned))

    def of(code: str) -> CompiledModel | None:
        model = compiled([code]) if together is None else together
        return model if model is not None and model.find(code) is not None else None

    return of


def _predicted(model: CompiledModel, code: str, view: View) -> FloatArray:
    return predict_component(model, code, view.conditions.temperatures_c, *view.places).values


def largest_by_chance(trials: Sequence[Trial]) -> FloatArray:
    """Draw the largest statistic of any sensor on any component if gains had no sign."""
    if not trials:
        return np.zeros(DRAWN)
    gains = np.concatenate([trial.shares for trial in trials])
    sizes = np.sqrt(np.sum(gains**2, axis=1, keepdims=True))
    gains = gains / np.where(sizes > 0.0, sizes, 1.0)
    # One sign for each set-up, the same in all components and for all sensors: these gain together,
    # and the largest of many that are alike is no larger than one of them.
    signs = np.random.default_rng(SEED).choice([-1.0, 1.0], (DRAWN, gains.shape[1]))
    largest: FloatArray = (signs @ gains.T).max(axis=1)
    return largest
