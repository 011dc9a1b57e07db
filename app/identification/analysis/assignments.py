"""Whether a component's maps, read by another of the machine's sensors, would leave less.

The sensor that a component follows was chosen of a few maps. Verifications may know better: the
same maps are interpolated over every other sensor whose temperatures they state, as a table would
be if it were assigned, and what that leaves of each set-up is held against what the assigned
sensor leaves. No number is estimated, but a sensor is chosen among many, and so

- the sensor that a set-up is judged by is the one that all others choose;
- the gain must be larger than any sensor's on any component would be by chance: the signs of
  whole set-ups are drawn anew, and the largest statistic of all pairs counts (P. Westfall,
  S. Young, Resampling-Based Multiple Testing (1993));
- no set-up may get markedly worse;
- no one effect of the library may explain as much on the sensor that is assigned
  (`assignment_rivals`): a structure that answers late looks like one that follows another sensor.

Points show many components at once. What a proposal explains is therefore taken off before the
other components are judged.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np

from app.arrays import BoolArray, FloatArray, IntArray, rms
from app.effects.campaign_view import KNOWN_SHARE
from app.effects.kinds.other_sensor import OtherSensor
from app.effects.projection import View
from app.errors import ThermapError, list_names
from app.geometry.components import COMPONENTS, ORDER
from app.identification.analysis.analysis import Analysis, TriedAssignment
from app.identification.analysis.assignment_rivals import Rivals
from app.identification.analysis.found_effect import FoundEffect
from app.identification.analysis.response_judged import (
    LEAST_GAIN,
    SURE,
    WORSE_BESIDE_OTHERS,
    WORSE_SHARE,
)
from app.identification.analysis.set_ups import SetUps
from app.identification.campaign import Campaign
from app.identification.residuals.residuals import Residuals
from app.search.scatter import FEWEST_BLOCKS
from app.thermal.compile_model import compile_model
from app.thermal.compiled_model import CompiledModel
from app.thermal.prediction import predict_component
from app.units import Unit

DRAWN: Final = 4000
"""So often the signs of all set-ups are drawn."""

SEED: Final = 0
"""Of the signs: the same campaign gives the same answer, whatever else is drawn."""

AS_GOOD: Final = 0.05
"""Share of a root mean square by which sensors differ that do as well."""

ROUNDING: Final = 1e-9


def judge_assignments(campaign: Campaign, residuals: Residuals) -> tuple[TriedAssignment, ...]:
    """Test for each component whether another sensor would leave markedly less.

    Parameters
    ----------
    campaign
        The campaign.
    residuals
        What the campaign's model leaves, adopted effects included.

    Returns
    -------
    tuple of TriedAssignment
        One for each component that has maps in two states and shows in the observations: first
        those with a proposal, the one that explains most before the others.
    """
    set_ups = SetUps(residuals, residuals.values)
    refused, open_ = [], []
    for one in _readings(campaign, residuals):
        why = _why_not_judged(campaign, set_ups, one)
        if why:
            refused.append(_not_judged(one, set_ups, why))
        else:
            open_.append(one)
    rivals = Rivals(campaign, residuals)
    proposed: list[TriedAssignment] = []
    while True:
        trials = sorted((_Trial(set_ups, one) for one in open_), key=lambda trial: -trial.gain)
        accepted, answers = _first_proposal(trials, rivals)
        if accepted is None:
            break
        proposed += answers
        set_ups = accepted.taken_off
        open_ = [one for one in open_ if one is not accepted.reading]
    others = sorted([*answers, *refused], key=lambda one: ORDER[one.component])
    return (*proposed, *others)


def said_first(answer: Analysis, tried: Sequence[TriedAssignment], machine_id: str) -> Analysis:
    """Set the proposals before everything else that an analysis says.

    An effect on a component for which another sensor is proposed was found on top of the wrong
    tables: nobody can say that it helps on the right ones. Only `other-sensor` with that sensor
    does what the assignment would do, and may serve until then.

    Parameters
    ----------
    answer
        What the analysis says otherwise.
    tried
        What it says of the sensors.
    machine_id
        Whose they are.
    """
    proposals = [one for one in tried if one.proposed_sensor]
    answer = replace(answer, assignments=tuple(tried))
    if not proposals:
        return answer
    moved = {one.component: (one.proposed_sensor, *one.as_good) for one in proposals}
    pairs = [f"{one.component}={one.proposed_sensor}" for one in proposals]
    words = " ".join(f'"{pair}"' if " " in pair else pair for pair in pairs)  # for a shell
    what = (
        f"Change the sensor assignment first: `thermap sensors assign {words} --machine "
        f"{machine_id}` makes the next model version. Then analyse again, because effects of "
        f"{list_names([one.component for one in proposals], 4)} were looked for with the present "
        "assignment."
    )
    return replace(
        answer,
        summary=" ".join([*(f"{one.sentence}." for one in proposals), answer.summary]),
        effects=tuple(
            replace(
                effect,
                helps=False,
                why_not="another sensor is proposed for "
                f"{list_names([code for code in effect.components if code in moved], 4)}: "
                "change the assignment first, and analyse again",
            )
            if effect.helps
            and not moved.keys().isdisjoint(effect.components)
            and not _does_the_same(effect, moved)
            else effect
            for effect in answer.effects
        ),
        what_next=(what, *answer.what_next),
    )


def _does_the_same(effect: FoundEffect, proposed: Mapping[str, Sequence[str | None]]) -> bool:
    """Whether an effect reads the maps by the sensors that are proposed, and does nothing else."""
    return effect.kind == OtherSensor.kind and all(
        effect.sensors[-1] in proposed.get(code, ()) for code in effect.components
    )


@dataclass(frozen=True, eq=False)
class _Reading:
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
    own: str
    view: View
    sensors: tuple[str, ...]
    changes: FloatArray


@dataclass(frozen=True, eq=False)
class _Trial:
    """One component over all other sensors, held against what its own sensor leaves."""

    set_ups: SetUps
    reading: _Reading

    @cached_property
    def shows(self) -> IntArray:
        """All rows of the channels in which it shows: a zero may move them all, shape (m,)."""
        return np.flatnonzero(np.isin(self.set_ups.channel, self.reading.view.channels))

    @cached_property
    def left(self) -> FloatArray:
        """What its own sensor, then each other one leaves, from each zero, shape (1 + S, m)."""
        own = self.set_ups.left[self.shows]
        others = [self._without(k).left[self.shows] for k in range(len(self.reading.sensors))]
        return np.array([own, *others])

    def _without(self, which: int) -> SetUps:
        return self.set_ups.without(self.reading.view.rows, self.reading.changes[which])

    @cached_property
    def scale(self) -> FloatArray:
        """What the best sensor leaves of each row's channel, shape (m,) [its unit]."""
        channel = self.set_ups.channel[self.shows]
        found = np.ones(len(channel))
        for number in np.unique(channel):
            here = channel == number
            found[here] = np.sqrt(np.mean(self.left[:, here] ** 2, axis=1)).min() or 1.0
        return found

    @cached_property
    def _place(self) -> IntArray:
        return self.set_ups.place[self.shows]

    @cached_property
    def losses(self) -> FloatArray:
        """Sum of the squares that are left of each set-up, over the scale's, shape (1 + S, V)."""
        scaled = (self.left / self.scale) ** 2
        return np.array(
            [np.bincount(self._place, weights=one, minlength=self.set_ups.count) for one in scaled]
        )

    @cached_property
    def shares(self) -> FloatArray:
        """By how much less root of that each other sensor leaves of each set-up, shape (S, V).

        The root, as single set-ups would else be nearly all of a sum.
        """
        found: FloatArray = np.sqrt(self.losses[0]) - np.sqrt(self.losses[1:])
        return found

    @cached_property
    def chosen(self) -> IntArray:
        """The other sensor that all other set-ups choose, for each set-up, shape (V,)."""
        others = self.losses[1:].sum(axis=1)[:, None] - self.losses[1:]
        found: IntArray = np.argmin(others, axis=0)
        return found

    @cached_property
    def best(self) -> int:
        """The other sensor that leaves least of all set-ups."""
        return int(np.argmin(self.losses[1:].sum(axis=1)))

    @property
    def sensor(self) -> str:
        """Its name."""
        return self.reading.sensors[self.best]

    @property
    def as_good(self) -> tuple[str, ...]:
        """The sensors that leave nearly as little as the best, in the rows that figures are of."""
        sizes = [rms(left[self.shown]) for left in self.left[1:]]
        return tuple(
            name
            for name, size in zip(self.reading.sensors, sizes, strict=True)
            if name != self.sensor and size <= (1.0 + AS_GOOD) * sizes[self.best]
        )

    @cached_property
    def after(self) -> FloatArray:
        """What the sensor leaves that the other set-ups choose, shape (m,)."""
        found: FloatArray = self.left[1 + self.chosen[self._place], np.arange(len(self.shows))]
        return found

    @cached_property
    def losses_after(self) -> FloatArray:
        """Of each set-up the loss by the sensor that the others choose, shape (V,)."""
        found: FloatArray = self.losses[1 + self.chosen, np.arange(self.set_ups.count)]
        return found

    @property
    def gain(self) -> float:
        """By how much the loss of all set-ups gets smaller, each held out."""
        return float(self.losses[0].sum() - self.losses_after.sum())

    @property
    def statistic(self) -> float:
        """The gain of set-ups held out for its own size: as `_largest_by_chance` has it."""
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

    @cached_property
    def shown(self) -> BoolArray:
        """The rows that figures are of: of the component itself, or else at points, shape (m,)."""
        return _shown(self.set_ups, self.reading, self.shows)


def _readings(campaign: Campaign, residuals: Residuals) -> Iterator[_Reading]:
    """Predict each component by every other sensor, where its maps can be read by that."""
    model = campaign.model
    assigned = {code: group.sensor for group in model.groups for code in group.codes}
    by_sensor = {name: _by(campaign, assigned, name) for name in model.machine.sensors}
    for code in sorted(assigned, key=ORDER.__getitem__):
        view = residuals.projection.view(code)
        if not view.rows.size:
            continue
        own = _predicted(model, code, view)
        found: dict[str, FloatArray] = {}
        for name, model_of in by_sensor.items():
            other = model_of(code) if name != assigned[code] else None
            if other is None:
                continue
            change = view.gains * (_predicted(other, code, view) - own)
            # Where a reading is missing a stand-in serves, or nothing is moved; where many are,
            # nothing is known of the sensor itself.
            known = np.isfinite(view.conditions.temperature(name)) & np.isfinite(change)
            if known.mean() >= KNOWN_SHARE:
                found[name] = np.nan_to_num(change, nan=0.0)
        changes = np.array(list(found.values())).reshape(len(found), view.rows.size)
        yield _Reading(code, assigned[code], view, tuple(found), changes)


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


def _why_not_judged(campaign: Campaign, set_ups: SetUps, one: _Reading) -> str:
    """Say why nothing can be said of a component, empty where something can."""
    count = np.unique(set_ups.place[one.view.rows]).size
    if any(one.code in effect.components for effect in campaign.effects):
        return f"the model has effects on it that were learnt with {one.own}"
    if count < FEWEST_BLOCKS:
        return f"needs at least {FEWEST_BLOCKS} set-ups in which it shows, got {count}"
    if not np.any(np.abs(set_ups.left[one.view.rows]) > ROUNDING):
        return "each set-up has one value of it and a zero of its own: no two can be compared"
    if not one.sensors:
        return "no other sensor has readings there and can tell its maps apart"
    return ""


def _first_proposal(
    trials: Sequence[_Trial], rivals: Rivals
) -> tuple[_Trial | None, list[TriedAssignment]]:
    """Find the first component for which another sensor is proposed.

    Returns
    -------
    trial, answers
        The component, and what is said of it; or None, and what is said of all.
    """
    largest = _largest_by_chance(trials)
    answers = []
    for trial in trials:
        beyond = np.count_nonzero(largest >= trial.statistic - ROUNDING)
        answer = _answer(trial, float(1 + beyond) / (1 + DRAWN), rivals)
        if answer.proposed_sensor:
            return trial, [answer]
        answers.append(answer)
    return None, answers


def _largest_by_chance(trials: Sequence[_Trial]) -> FloatArray:
    """Draw the largest statistic of any sensor on any component if gains had no sign."""
    if not trials:
        return np.zeros(DRAWN)
    gains = np.concatenate([trial.shares for trial in trials])
    sizes = np.sqrt(np.sum(gains**2, axis=1, keepdims=True))
    gains = gains / np.where(sizes > 0.0, sizes, 1.0)
    signs = np.random.default_rng(SEED).choice([-1.0, 1.0], (DRAWN, gains.shape[1]))
    found: FloatArray = (signs @ gains.T).max(axis=1)
    return found


def _answer(trial: _Trial, chance: float, rivals: Rivals) -> TriedAssignment:
    reading, shown = trial.reading, trial.shown
    before, after = trial.left[0][shown], trial.after[shown]
    place = trial.set_ups.place[trial.shows][shown]
    sizes = [
        (rms(after[place == at]) - rms(before[place == at]), int(at)) for at in np.unique(place)
    ]
    worst = max(sizes)[1]
    found = TriedAssignment(
        component=reading.code,
        present_sensor=reading.own,
        other_sensor=trial.sensor,
        as_good=trial.as_good,
        unit=_unit(reading, trial.set_ups),
        at_points=not _is_direct(reading, trial.set_ups),
        setups=len(trial.each[0]),
        before_rms=rms(before),
        after_rms=rms(after),
        worst_setup=trial.set_ups.label(worst),
        worst_before_rms=rms(before[place == worst]),
        worst_after_rms=rms(after[place == worst]),
        p_global=chance,
        why_not=None,
        sentence="",
    )
    why = _why_not(trial, found, chance, rivals)
    if why:
        words = f"{reading.code} stays on {reading.own}: {why}"
        return replace(found, why_not=why, sentence=words)
    also = f"; {list_names(found.as_good, 4)} would do as well" if found.as_good else ""
    words = f"{_over(found)}; no set-up would get markedly worse{also}"
    return replace(found, sentence=words)


def _why_not(trial: _Trial, found: TriedAssignment, chance: float, rivals: Rivals) -> str:
    """Say why the other sensor is not proposed, empty where it is."""
    before, after = found.before_rms, found.after_rms
    if after is None or after > (1.0 - LEAST_GAIN) * before:
        return f"{_over(found)}, not markedly less"
    if chance > SURE:
        return (
            f"{_over(found)}, but some sensor would gain as evenly by chance with probability "
            f"{chance:.2g}"
        )
    if trial.harmed is not None:
        return f"{_over(found)}, but set-up {trial.set_ups.label(trial.harmed)!r} would get worse"
    rival = rivals.explaining_as_much(
        trial.set_ups, trial.reading.code, trial.shows, trial.scale, trial.gain
    )
    if rival:
        return f"{_over(found)}, but {rival} explains as much"
    return ""


def _over(found: TriedAssignment) -> str:
    """Say what the other sensor leaves.

    The numbers are of set-ups held out.
    """
    where = " at points" if found.at_points else ""
    return (
        f"{found.component} with {found.other_sensor} instead of {found.present_sensor} would "
        f"leave {found.after_rms:.3g} instead of {found.before_rms:.3g} {found.unit}{where} on "
        "held-out set-ups"
    )


def _not_judged(one: _Reading, set_ups: SetUps, why: str) -> TriedAssignment:
    shows = np.flatnonzero(np.isin(set_ups.channel, one.view.channels))
    own = set_ups.left[shows][_shown(set_ups, one, shows)]
    return TriedAssignment(
        component=one.code,
        present_sensor=one.own,
        other_sensor=None,
        as_good=(),
        unit=_unit(one, set_ups),
        at_points=not _is_direct(one, set_ups),
        setups=int(np.unique(set_ups.place[one.view.rows]).size),
        before_rms=rms(own),
        after_rms=None,
        worst_setup=None,
        worst_before_rms=None,
        worst_after_rms=None,
        p_global=None,
        why_not=why,
        sentence=f"{one.code} was not tried with a sensor other than {one.own}: {why}",
    )


def _is_direct(one: _Reading, set_ups: SetUps) -> bool:
    """Say whether values of the component by itself are judged; else those at points.

    One value in a set-up is that set-up's zero: nothing is left of it whatever the sensor.
    """
    direct = _of_itself(one, set_ups)
    tells = np.any(np.abs(set_ups.left[direct]) > ROUNDING)
    return bool(tells or direct[one.view.rows].all())


def _shown(set_ups: SetUps, one: _Reading, shows: IntArray) -> BoolArray:
    direct = _of_itself(one, set_ups)[shows]
    return direct if _is_direct(one, set_ups) else ~direct


def _of_itself(one: _Reading, set_ups: SetUps) -> BoolArray:
    channels = set_ups.residuals.rows.channels
    number = channels.index(one.code) if one.code in channels else -1
    found: BoolArray = set_ups.channel == number
    return found


def _unit(one: _Reading, set_ups: SetUps) -> str:
    unit = COMPONENTS[one.code].unit if _is_direct(one, set_ups) else Unit.UM
    return unit.symbol
