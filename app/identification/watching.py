"""Whether a machine still is as its model says: every new verification is judged on arrival.

Of each component's residuals a level and slopes along the axes are followed from visit to
visit. What is expected of them: the scatter of observations and set-ups, and one constant that
the maps' own uncertainty allows. The evidence of all of them is averaged; the mean of e-values
is an e-value, whatever their dependence, so no allowance for their number is lost.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np

from app.arrays import FloatArray, IntArray
from app.errors import InvalidContent
from app.geometry.components import LINEAR_LETTERS
from app.identification.analysis import plain
from app.identification.campaign import Campaign, residuals_of
from app.identification.e_process import EProcess
from app.identification.map_uncertainty import map_uncertainty
from app.identification.residuals import Residuals, channel_unit
from app.identification.search.rows import Datum, Nuisance, Rows

FALSE_ALARM: Final = 0.01
"""Probability that a machine that has not changed is ever called changed."""

LIMIT: Final = 1.0 / FALSE_ALARM
"""Evidence that an unchanged machine reaches with that probability at most."""

ASSUMED_SETUP: Final = 0.5
"""Set-up scatter of level and slopes, in repeatabilities."""

STATED_WEIGHT: Final = 20.0
"""A stated repeatability counts as much as so many observations."""

FEWEST_FREEDOM: Final = 8
"""Before so much is known of a component's scatter, nothing is said of it."""

MOST_NAMED: Final = 6

LEVEL: Final = "level"

KEY: Final = "|"
"""Between component and number in the key of a stream."""


@dataclass(frozen=True, slots=True)
class Stream:
    """One followed number: what is known of its constant part, and the evidence for a change.

    Parameters
    ----------
    mean, variance
        Of the constant that the maps' uncertainty allows [the component's unit, squared].
    process
        The evidence.
    last
        Latest deviation from what was expected [the component's unit].
    """

    mean: float
    variance: float
    process: EProcess = field(default_factory=EProcess)
    last: float = 0.0


@dataclass(frozen=True, slots=True)
class Noise:
    """Squares that level and slopes leave within visits, and their degrees of freedom."""

    squares: float = 0.0
    freedom: int = 0

    def plus(self, fit: _Fit) -> Noise:
        """Add what one more visit leaves."""
        return Noise(self.squares + fit.squares, self.freedom + fit.freedom)

    def variance(self, stated: float | None) -> float | None:
        """Give the variance of one observation; None where too little is known.

        Parameters
        ----------
        stated
            A stated standard deviation: it counts as much as so many observations.
        """
        if stated is not None:
            return (self.squares + STATED_WEIGHT * stated**2) / (self.freedom + STATED_WEIGHT)
        if self.freedom < FEWEST_FREEDOM:
            return None
        # A variance from few observations may be too small by chance: two sigma up.
        return self.squares / self.freedom * (1.0 + 2.0 * float(np.sqrt(2.0 / self.freedom)))


@dataclass(frozen=True, slots=True)
class Followed:
    """One followed number as it stands: whose, which, how far it is off, and its e-value.

    Parameters
    ----------
    component, what
        `EZZ` or `points x`, and `level` or a slope along an axis.
    unit
        Symbol of the deviation's unit.
    deviation
        Latest deviation from what was expected [unit].
    evidence
        Its e-value.
    """

    component: str
    what: str
    unit: str
    deviation: float
    evidence: float


@dataclass(frozen=True, eq=False)
class WatchState:
    """Everything that goes from one verification to the next; one for each model version.

    Parameters
    ----------
    streams
        `component|what` to stream.
    noise
        Component to what its visits have left beside level and slopes.
    beyond_since_s
        When the limits were first exceeded [s]; None while they are not.
    """

    streams: Mapping[str, Stream] = field(default_factory=dict)
    noise: Mapping[str, Noise] = field(default_factory=dict)
    beyond_since_s: float | None = None

    def evidence(self) -> float:
        """Average the evidence of all streams; 1 without any."""
        values = [s.process.evidence for s in self.streams.values()]
        return float(np.mean(values)) if values else 1.0

    def followed(self, key: str) -> Followed:
        """Tell of one stream by its key."""
        component, _, what = key.partition(KEY)
        stream, unit = self.streams[key], channel_unit(component).symbol
        return Followed(component, what, unit, stream.last, stream.process.evidence)

    def all_followed(self) -> list[Followed]:
        """Tell of all streams, the strongest evidence first."""
        return sorted(map(self.followed, self.streams), key=lambda one: -one.evidence)

    def to_json(self) -> dict[str, Any]:
        """Write it down."""
        found: dict[str, Any] = plain(self)
        return found


@dataclass(frozen=True, slots=True)
class Beyond:
    """Something that changed: which number, how far it is off, and what was to be expected."""

    component: str
    what: str
    unit: str
    deviation: float
    expected_sd: float
    evidence: float


@dataclass(frozen=True, slots=True)
class Judgement:
    """What a verification says of the active model.

    Parameters
    ----------
    status
        `within` or `beyond`.
    evidence, limit
        The e-value and the limit 1/α that it may reach by chance with probability α at most.
    false_alarm
        α: probability that an unchanged machine is ever called changed.
    summary
        One sentence.
    beyond
        What changed most, the clearest first; empty while within.
    visits
        How many visits of this verification were looked at.
    """

    status: str
    evidence: float
    limit: float
    false_alarm: float
    summary: str
    beyond: tuple[Beyond, ...]
    visits: int

    def to_json(self) -> dict[str, Any]:
        """Write it down: JSON's own types, every number finite."""
        found: dict[str, Any] = plain(self)
        return found


def watch(campaign: Campaign, state: WatchState) -> tuple[Judgement, WatchState]:
    """Judge new verifications against the active model, after those that came before.

    Parameters
    ----------
    campaign
        The new verifications alone, with the readings around them and the adopted effects.
    state
        What the verifications before have left; a new one for a new model version.

    Returns
    -------
    judgement : Judgement
    state : WatchState
        To be kept for the next verification.

    Raises
    ------
    InvalidContent
        If nothing can be compared with the model, or values are in another unit.
    """
    sheet = _Sheet.of(campaign)
    rows, times_s = sheet.rows, sheet.residuals.rows.times_s
    sizes: dict[str, float] = {}
    visits = np.unique(rows.visit).tolist()
    for visit in visits:
        here = rows.visit == visit
        for channel in np.unique(rows.channel[here]).tolist():
            state, expected = _after_channel(state, sheet, visit, channel)
            sizes |= expected
        if state.beyond_since_s is None and state.evidence() >= LIMIT:
            state = replace(state, beyond_since_s=float(times_s[here].min()))
    return _judgement(state, sizes, len(visits)), state


def watch_state_from_json(stored: Mapping[str, Any]) -> WatchState:
    """Read a state as `WatchState.to_json` wrote it.

    Parameters
    ----------
    stored
        The stored form.

    Raises
    ------
    InvalidContent
        If something is missing.
    """
    try:
        streams = {
            name: Stream(s["mean"], s["variance"], EProcess(**s["process"]), s["last"])
            for name, s in stored["streams"].items()
        }
        noise = {name: Noise(**n) for name, n in stored["noise"].items()}
        return WatchState(streams, noise, stored["beyond_since_s"])
    except (KeyError, TypeError, AttributeError) as error:
        raise InvalidContent.of_field(
            "watch", f"expected a stored state, came one that lacks or mistakes {error}"
        ) from None


@dataclass(frozen=True, eq=False)
class _Sheet:
    """New verifications as rows, with what each row is judged by."""

    residuals: Residuals
    rows: Rows
    tilt: FloatArray
    nuisance: Mapping[int, Nuisance]

    @classmethod
    def of(cls, campaign: Campaign) -> _Sheet:
        residuals = residuals_of(campaign)
        nuisance = map_uncertainty(residuals.projection, campaign.maps)
        return cls(
            residuals,
            residuals.as_rows(),
            _along_travels(residuals),
            {one.channel: one for one in nuisance},
        )

    def maps(self, channel: int, own: IntArray) -> FloatArray:
        """Give what the maps' uncertainty may do to some rows of a channel, shape (m, p)."""
        if channel not in self.nuisance:
            return np.zeros((len(own), 0))
        nuisance = self.nuisance[channel]
        return nuisance.columns[np.searchsorted(nuisance.rows, own)] * nuisance.prior


def _after_channel(
    state: WatchState, sheet: _Sheet, visit: int, channel: int
) -> tuple[WatchState, dict[str, float]]:
    """Take one channel of one visit; also give what deviation was to be expected of each number."""
    rows, name = sheet.rows, sheet.residuals.rows.channels[channel]
    own = np.flatnonzero((rows.visit == visit) & (rows.channel == channel))
    fit = _Fit.of(rows.values[own], sheet.tilt[own])
    noise = state.noise.get(name, Noise()).plus(fit)
    state = replace(state, noise={**state.noise, name: noise})
    declared = rows.noise.get(channel)
    variance = noise.variance(declared.repeatability if declared else None)
    if variance is None:
        return state, {}
    is_zeroed = rows.datum.get((visit, channel), Datum.ABSOLUTE) is not Datum.ABSOLUTE
    return _taken(state, name, fit.numbers(variance, sheet.maps(channel, own), is_zeroed))


def _along_travels(residuals: Residuals) -> FloatArray:
    """Scale positions from −1 to 1 over the travels, or over what was observed: shape (n, 3).

    Slopes of different verifications are then the same quantity.
    """
    points = residuals.rows.points_mm
    found = np.zeros(points.shape)
    for i, axis in enumerate(LINEAR_LETTERS):
        known = ~np.isnan(points[:, i])
        travel = residuals.projection.model.machine.axes.get(axis)
        ends = (travel.min_mm, travel.max_mm) if travel else _ends(points[known, i])
        if ends[1] > ends[0]:
            found[known, i] = (2.0 * points[known, i] - sum(ends)) / (ends[1] - ends[0])
    return found


def _ends(positions_mm: FloatArray) -> tuple[float, float]:
    return (float(positions_mm.min()), float(positions_mm.max())) if positions_mm.size else (0, 0)


@dataclass(frozen=True, slots=True)
class _Number:
    """One followed number of one visit: its value, its scatter, and the maps' part of it."""

    what: str
    value: float
    scatter: float
    maps: float


@dataclass(frozen=True, eq=False)
class _Fit:
    """Level and slopes of one channel in one visit, by least squares."""

    names: tuple[str, ...]
    inverse: FloatArray
    values: FloatArray
    squares: float
    freedom: int

    @classmethod
    def of(cls, values: FloatArray, tilt: FloatArray) -> _Fit:
        names = [LEVEL, *(f"slope along {axis.upper()}" for axis in LINEAR_LETTERS)]
        columns = np.column_stack([np.ones(len(values)), tilt])
        kept = [0, *(j for j in range(1, columns.shape[1]) if np.ptp(columns[:, j]) > 0)]
        if len(kept) >= len(values):
            kept = [0]
        inverse = np.linalg.pinv(columns[:, kept])
        found = inverse @ values
        left = values - columns[:, kept] @ found
        return cls(
            tuple(names[j] for j in kept),
            inverse,
            found,
            float(np.sum(left**2)),
            len(values) - len(kept),
        )

    def numbers(self, variance: float, maps: FloatArray, is_zeroed: bool) -> list[_Number]:
        """Give each number with its scatter; of an unknown zero not the level."""
        scatter = variance * (np.sum(self.inverse**2, axis=1) + ASSUMED_SETUP**2)
        known = np.sum((self.inverse @ maps) ** 2, axis=1)
        return [
            _Number(name, *(float(x) for x in numbers))
            for name, *numbers in zip(self.names, self.values, scatter, known, strict=True)
            if not (is_zeroed and name == LEVEL)
        ]


def _taken(
    state: WatchState, name: str, numbers: Sequence[_Number]
) -> tuple[WatchState, dict[str, float]]:
    """Take the numbers of one visit; also give what deviation was to be expected of each."""
    streams, sizes = dict(state.streams), {}
    for number in numbers:
        key = f"{name}{KEY}{number.what}"
        before = streams.get(key, Stream(0.0, number.maps))
        # The maps' error is constant where temperatures are: half of it may change with them.
        own = number.scatter + 0.5 * number.maps
        variance = before.variance + own
        away = number.value - before.mean
        gain = before.variance / variance
        streams[key] = Stream(
            before.mean + gain * away,
            before.variance * (1.0 - gain),
            before.process.after(away / float(np.sqrt(variance))),
            away,
        )
        sizes[key] = float(np.sqrt(variance))
    return replace(state, streams=streams), sizes


def _judgement(state: WatchState, sizes: Mapping[str, float], visits: int) -> Judgement:
    is_beyond = state.beyond_since_s is not None
    order = sorted(sizes, key=lambda key: -state.streams[key].process.evidence)
    beyond = tuple(_beyond(state, key, sizes[key]) for key in order[:MOST_NAMED])
    told = tuple(b for b in beyond if b.evidence >= LIMIT) or beyond[:1]
    return Judgement(
        "beyond" if is_beyond else "within",
        state.evidence(),
        LIMIT,
        FALSE_ALARM,
        _sentence(told if is_beyond else ()),
        told if is_beyond else (),
        visits,
    )


def _beyond(state: WatchState, key: str, size: float) -> Beyond:
    one = state.followed(key)
    return Beyond(one.component, one.what, one.unit, one.deviation, size, one.evidence)


def _sentence(beyond: Sequence[Beyond]) -> str:
    if not beyond:
        return (
            "The machine is as its model says, within the scatter of measurement, set-up and maps."
        )
    one = beyond[0]
    return (
        f"The machine is no longer as its model says: the {one.what} of {one.component} is off by "
        f"{one.deviation:.2g} {one.unit}, where ±{one.expected_sd:.2g} {one.unit} were expected "
        f"(by chance in at most {FALSE_ALARM:.0%} of all unchanged machines, ever)."
    )
