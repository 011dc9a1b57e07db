"""Whether a machine still is as its model says: every new verification is judged on arrival.

Of each component's residuals a level and slopes along the axes are followed from visit to
visit. What is expected of them: the scatter of observations and set-ups, and one constant that
the maps' own uncertainty allows. How much set-ups scatter, and how much each resembles the one
before, is not known beforehand: it is learnt from visit to visit, a lasting change apart.
The evidence of all numbers is averaged; the mean of e-values is an e-value, whatever their
dependence, so no allowance for their number is lost.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import hypot
from typing import Annotated, Final, Literal

import numpy as np
from pydantic import Field
from scipy import sparse
from scipy.special import chdtri

from app.answer import IN_ITS_UNIT, Answer, UnitSymbol
from app.arrays import FloatArray, IntArray, SparseArray
from app.geometry.components import LINEAR_LETTERS
from app.identification.campaign import Campaign, residuals_of
from app.identification.residuals.map_uncertainty import ChannelEntries, channel_entries
from app.identification.residuals.residuals import Residuals, channel_unit
from app.identification.watch.e_process import EProcess, likelihood_ratio
from app.identification.watch.figures import CheckFigures, WatchFigures, latest_residuals
from app.identification.watch.lone_values import LoneValue, lone_values, lone_words
from app.identification.watch.setups import PAIRS, Track, believed, learn, scatter_of_setups
from app.search.common_scatter import side_of
from app.search.priors import DECLARED_WEIGHT
from app.search.rows import Datum, Rows
from app.units import Unit

PLAINLY: Final = 2.0
"""A visit shows a change by itself where it is off by so many standard deviations."""

FAR_OFF: Final = 5.0
"""Off by so many standard deviations of one observation and the maps, a visit is said to be so,
although set-ups may scatter as much: nobody is told that it agrees with the model."""

CHECK_ALARM: Final = 0.05
"""Probability that scatter alone takes one check beyond what is expected of it, at most: of few
values; of many it is far less."""

FALSE_ALARM: Final = 0.01
"""Probability that a machine that has not changed is ever called changed."""

LIMIT: Final = 2.0 / FALSE_ALARM
"""Evidence that an unchanged machine reaches with that probability: counted, not proved.

With a known scatter it would be half as much (Ville's inequality). The other half pays for the
set-up scatter, which is only being learnt in the first visits: `tests/identification/
test_watching.py` counts the alarms of unchanged machines whose set-ups scatter up to six
repeatabilities.
"""

FEWEST_FREEDOM: Final = 8
"""Before so much is known of a component's scatter, nothing is said of it."""

MOST_NAMED: Final = 6

LEVEL: Final = "level"

NUMBERS: Final = (LEVEL, *(f"slope along {axis.upper()}" for axis in LINEAR_LETTERS))
"""What is followed of a component."""

FEWEST_SEEN_AGAIN: Final = 5
"""Before so many numbers were seen again nothing is known of what set-ups scatter by."""

KEY: Final = "|"
"""Between component and number in the key of a stream."""


@dataclass(frozen=True, slots=True)
class Stream:
    """One followed number: what is known of its parts, and the evidence for a change.

    Parameters
    ----------
    unchanged, learnt
        Filters that know of no change, by which it is judged; filters that allow for one, by
        which the scatter of set-ups is learnt.
    likelihoods
        Log likelihood of each pair of set-up scatter and correlation.
    value
        Latest value [the component's unit].
    expected
        Standard deviation that was to be expected of it [the component's unit].
    """

    unchanged: Track
    learnt: Track
    likelihoods: tuple[float, ...] = (0.0,) * PAIRS
    process: EProcess = field(default_factory=EProcess)
    value: float | None = None
    expected: float = 0.0

    @classmethod
    def begin(cls, variance: float) -> Stream:
        """Begin with a constant that the maps allow, of that variance."""
        track = Track.begin(0.0, variance)
        return cls(track, track)

    def after(self, number: VisitNumber, repeatability: float) -> Stream:
        """Take the number of one more visit.

        Parameters
        ----------
        repeatability
            Standard deviation of one observation [the component's unit].
        """
        is_first = not self.process.steps
        # The maps' error is constant where temperatures are: half of it may change with them.
        scatter = number.scatter + 0.5 * number.maps
        foretold = self.unchanged.foretell(repeatability, is_first)
        likelihoods = np.array(self.likelihoods)
        # Judged by what was believed before this visit: a far one makes wide scatters likely, and
        # would excuse itself.
        weights = believed(likelihoods)
        variances = foretold.variance + scatter
        ratio = likelihood_ratio(foretold.away(number.value), variances, weights)
        learnt, likelihood = learn(
            self.learnt.foretell(repeatability, is_first), number.value, scatter, repeatability
        )
        if not is_first:  # The first number says more of the maps than of set-ups.
            likelihoods += likelihood
            likelihoods -= likelihoods.max()
        return Stream(
            foretold.after(number.value, scatter).track(),
            learnt.track(),
            tuple(likelihoods.tolist()),
            self.process.after(ratio),
            number.value,
            float(np.sqrt(weights @ variances)),
        )


@dataclass(frozen=True, slots=True)
class Noise:
    """Squares that level and slopes leave within visits, and their degrees of freedom.

    Parameters
    ----------
    expected
        Squares that are to be expected of what is stated and of the maps' uncertainty; where
        nothing is stated, those that are left.
    """

    squares: float = 0.0
    freedom: int = 0
    expected: float = 0.0

    def plus(self, fit: _Fit, repeatability: float | None, maps: SparseArray) -> Noise:
        """Add what one more visit leaves.

        Parameters
        ----------
        maps
            Change of the visit's rows for one standard error of each entry, shape (m, p).
        """
        expected = fit.squares
        if repeatability is not None:
            expected = fit.freedom * repeatability**2 + fit.left_of(maps)
        return Noise(
            self.squares + fit.squares, self.freedom + fit.freedom, self.expected + expected
        )

    @property
    def ratio(self) -> float:
        """By how many times what is left exceeds what was to be expected."""
        return float(np.sqrt(self.squares / self.expected)) if self.expected > 0.0 else 1.0

    def variance(self, repeatability: float | None) -> float | None:
        """Give the variance of one observation; None where too little is known.

        Parameters
        ----------
        repeatability
            A stated standard deviation: it counts as much as so many observations.
        """
        if repeatability is not None:
            return (self.squares + DECLARED_WEIGHT * repeatability**2) / (
                self.freedom + DECLARED_WEIGHT
            )
        if self.freedom < FEWEST_FREEDOM:
            return None
        # A variance from few observations may be too small by chance: two sigma up.
        return self.squares / self.freedom * (1.0 + 2.0 * float(np.sqrt(2.0 / self.freedom)))


@dataclass(frozen=True, slots=True)
class Followed(Answer, published_as="FollowedNumber"):
    """One number that is followed from visit to visit."""

    component: Annotated[str, Field(examples=["EZZ"])]
    """Component code, or `points x`"""

    what: Annotated[str, Field(examples=["level"])]
    """`level`, or a slope along an axis"""

    unit: UnitSymbol
    """Unit of its deviation"""

    deviation: Annotated[float, Field(description=f"Latest measured minus predicted {IN_ITS_UNIT}")]
    expected_sd: Annotated[
        float,
        Field(description=f"Standard deviation that was expected of it {IN_ITS_UNIT}"),
    ]
    evidence: float
    """Evidence that it has changed, as an e-value"""


@dataclass(frozen=True)
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
    checks
        Component to its latest visit; empty in states that an earlier version stored.
    figures
        What is told of all that; None before the first verification, and of states that an earlier
        version stored.
    """

    streams: Mapping[str, Stream] = field(default_factory=dict)
    noise: Mapping[str, Noise] = field(default_factory=dict)
    beyond_since_s: float | None = None
    checks: Mapping[str, CheckFigures] = field(default_factory=dict)
    figures: WatchFigures | None = None

    def contradiction(self) -> str | None:
        """Say so where nearly all lengths contradict the repeatability that is stated.

        The limits are not changed by that: an unchanged machine is called changed as rarely, as
        what set-ups seem to scatter by makes good what observations seem not to.
        """
        lengths = (name for name in self.noise if channel_unit(name) is Unit.UM)
        length_noise = [self.noise[name] for name in lengths]
        ratios = np.array([channel_noise.ratio for channel_noise in length_noise])
        side = side_of(
            ratios, np.array([float(channel_noise.freedom) for channel_noise in length_noise])
        )
        if side == 0:
            return None
        return (
            "The stated repeatability is contradicted: within their visits nearly all lengths "
            f"scatter by {np.median(ratios):.2g} times what it and the maps' uncertainty allow. "
            "The watch goes on from what is stated, and learns only slowly what they show: false "
            "alarms stay as rare, but a change may be seen later. An analysis says what to state."
        )

    def most_sigmas(self) -> float | None:
        """Give the largest latest deviation over what was to be expected of it."""
        ratios = [
            abs(stream.value) / stream.expected
            for stream in self.streams.values()
            if stream.value is not None and stream.expected > 0.0
        ]
        return max(ratios, default=None)

    def setup_scatter(self, what: str) -> float:
        """Say by what set-ups scatter in a level or slope [repeatabilities].

        All components together; 0 before enough of them were seen again.
        """
        name = f"{KEY}{what}"
        seen = [stream for key, stream in self.streams.items() if key.endswith(name)]
        if sum(stream.process.steps - 1 for stream in seen) < FEWEST_SEEN_AGAIN:
            return 0.0
        return scatter_of_setups(np.sum([stream.likelihoods for stream in seen], axis=0))

    def evidence(self) -> float:
        """Average the evidence of all streams; 1 without any."""
        values = [s.process.evidence for s in self.streams.values()]
        return float(np.mean(values)) if values else 1.0

    def followed(self, key: str) -> Followed:
        """Tell of one stream by its key."""
        component, _, what = key.partition(KEY)
        stream, unit = self.streams[key], channel_unit(component).symbol
        value, evidence = stream.value or 0.0, stream.process.evidence
        return Followed(component, what, unit, value, stream.expected, evidence)

    def all_followed(self) -> list[Followed]:
        """Tell of all streams, the strongest evidence first."""
        return sorted(map(self.followed, self.streams), key=lambda item: -item.evidence)


@dataclass(frozen=True, slots=True)
class Judgement(Answer, published_as="JudgementAnswer"):
    """What a verification says of the model that was active when it was judged.

    That is when it came; or, where it had no readings then, once these are there.
    """

    model_version: int | None
    """That version; null where there was none"""

    status: Literal["within", "beyond", "not-judged"]
    """`within` or `beyond` the limits of a sequential test over this and all earlier verifications;
    `not-judged`, with the reason in `summary`"""

    evidence: float | None
    """Evidence from all verifications so far, as an e-value"""

    limit: float | None
    """Evidence that an unchanged machine ever reaches only with probability `false_alarm`"""

    false_alarm: float | None
    """Probability that an unchanged machine is ever called changed"""

    summary: str
    """In plain sentences"""

    beyond: tuple[Followed, ...]
    """What has changed since the model was made, the clearest first"""

    visits: int
    """Number of visits in the verification that were looked at"""

    awaits_readings: bool = False
    """Whether it was stored before its readings, and is judged once they are there"""


def not_judged(
    model_version: int | None, reason: str, *, awaits_readings: bool = False
) -> Judgement:
    """Say why a verification was not judged.

    Parameters
    ----------
    model_version
        The active version; None where there was none.
    reason
        Part of a sentence.
    awaits_readings
        Whether it is judged once there are readings of its time.
    """
    if awaits_readings:
        summary = (
            f"It is not judged yet: {reason}. It will be, against the model that is active then, "
            "as soon as there are readings up to its last observation. Analyses do without a "
            "judgement."
        )
        nothing = (None, None, None)
        return Judgement(model_version, "not-judged", *nothing, summary, (), 0, awaits_readings)
    summary = (
        f"It could not be judged: {reason}. A judgement is made when a verification is stored: "
        "once that is mended, delete this one and store it again. Analyses do without a judgement."
    )
    return Judgement(model_version, "not-judged", None, None, None, summary, (), 0)


def watch(
    campaign: Campaign, state: WatchState, model_version: int
) -> tuple[Judgement, WatchState]:
    """Judge new verifications against the active model, after those that came before.

    Parameters
    ----------
    campaign
        The new verifications alone, with the readings around them and the adopted effects.
    state
        What the verifications before have left; a new one for a new model version.

    Returns
    -------
    state : WatchState
        To be kept for the next verification.

    Raises
    ------
    InvalidContent
        If nothing can be compared with the model, or values are in another unit.
    """
    sheet = _Sheet.make(campaign)
    rows, times_s = sheet.rows, sheet.residuals.rows.times_s
    judged, farthest, lone = False, None, list[LoneValue]()
    visits, checks = np.unique(rows.visit).tolist(), dict(state.checks)
    for visit in visits:
        here = rows.visit == visit
        before = state
        for channel in np.unique(rows.channel[here]).tolist():
            state, taken, apart = _after_channel(state, sheet, visit, channel)
            lone += apart
            judged |= bool(taken)
            farthest = max([*taken, *([farthest] if farthest else [])], key=_farness, default=None)
            check = _check_figures(before, state, sheet, visit, channel)
            if check is not None:
                checks[check.component] = check
        if state.beyond_since_s is None and state.evidence() >= LIMIT:
            state = replace(state, beyond_since_s=float(times_s[here].min()))
    latest = latest_residuals(sheet.residuals)
    worst = max(checks.values(), key=lambda item: item.off / item.at_most, default=None)
    figures = WatchFigures(state.evidence(), state.most_sigmas(), latest, worst)
    state = replace(state, figures=figures, checks=checks)
    judgement = _judgement(state, judged, farthest, len(visits), model_version)
    summary = judgement.summary + lone_words(lone, sheet.residuals.rows)
    return replace(judgement, summary=summary), state


@dataclass(frozen=True, eq=False)
class _Sheet:
    """New verifications as rows, with what each row is judged by."""

    residuals: Residuals
    rows: Rows
    tilt: FloatArray
    entries: Mapping[int, ChannelEntries]

    @classmethod
    def make(cls, campaign: Campaign) -> _Sheet:
        residuals = residuals_of(campaign)
        entries = channel_entries(residuals.projection, campaign.maps)
        return cls(
            residuals,
            residuals.as_rows(),
            _along_travels(residuals),
            {entry.channel: entry for entry in entries},
        )

    def of(self, visit: int, channel: int) -> tuple[IntArray, float | None, bool]:
        """Give a channel's rows in a visit, what is stated of it, and if its zero is unknown."""
        rows = self.rows
        declared, datum = rows.noise.get(channel), rows.datum.get((visit, channel))
        return (
            np.flatnonzero((rows.visit == visit) & (rows.channel == channel)),
            declared.repeatability if declared else None,
            datum not in (None, Datum.ABSOLUTE),
        )

    def maps(self, channel: int, rows: IntArray) -> SparseArray:
        """Give what the maps' uncertainty may do to some rows of a channel, shape (m, p)."""
        if channel not in self.entries:
            return sparse.csr_array((len(rows), 0))
        entries = self.entries[channel]
        here = entries.columns[np.searchsorted(entries.rows, rows)]
        return here[:, np.unique(here.indices)]


@dataclass(frozen=True, slots=True)
class _Away:
    """A visit's number, and the standard deviation of one observation and the maps."""

    component: str
    what: str
    value: float
    sd: float

    @property
    def words(self) -> str:
        """What it is off by, as part of a sentence."""
        unit = channel_unit(self.component).symbol
        return (
            f"the {self.what} of {self.component} is off by {self.value:.2g} {unit}, where one "
            f"observation scatters by ±{self.sd:.2g} {unit}, the maps' uncertainty included"
        )


def _farness(number: _Away) -> float:
    return abs(number.value) / number.sd


def _after_channel(
    state: WatchState, sheet: _Sheet, visit: int, channel: int
) -> tuple[WatchState, list[_Away], list[LoneValue]]:
    """Take one channel of one visit; give its numbers too, none where too little is known.

    Last come its lone values, which take no part: one mistyped value would make the watch blind
    for all visits after it.
    """
    rows, name = sheet.rows, sheet.residuals.rows.channels[channel]
    rows_of_channel, repeatability, is_zeroed = sheet.of(visit, channel)
    fit = _Fit.of(rows.values[rows_of_channel], sheet.tilt[rows_of_channel])
    lone = lone_values(rows_of_channel.tolist(), fit.residuals, repeatability)
    if lone:
        rows_of_channel = np.setdiff1d(rows_of_channel, [value.row for value in lone])
        fit = _Fit.of(rows.values[rows_of_channel], sheet.tilt[rows_of_channel])
    maps = sheet.maps(channel, rows_of_channel)
    noise = state.noise.get(name, Noise()).plus(fit, repeatability, maps)
    state = replace(state, noise={**state.noise, name: noise})
    variance = noise.variance(repeatability)
    if variance is None:
        return state, [], lone
    streams, taken = dict(state.streams), []
    for number in fit.numbers(variance, maps, is_zeroed):
        key = f"{name}{KEY}{number.what}"
        before = streams.get(key, Stream.begin(number.maps))
        streams[key] = before.after(number, float(np.sqrt(variance)))
        taken.append(_Away(name, number.what, number.value, float(np.sqrt(variance + number.maps))))
    return replace(state, streams=streams), taken, lone


def _check_figures(
    before: WatchState, state: WatchState, sheet: _Sheet, visit: int, channel: int
) -> CheckFigures | None:
    """Hold one channel of a visit, value by value, against what its values scatter by.

    By what set-ups scatter is what visits before it have shown: it does not excuse itself. Lone
    values are counted, and so is what neither a level nor a slope describes, as a reversal.
    """
    rows, name = sheet.rows, sheet.residuals.rows.channels[channel]
    rows_of_channel, repeatability, is_zeroed = sheet.of(visit, channel)
    values, freedom = rows.values[rows_of_channel], len(rows_of_channel)
    if is_zeroed:
        values, freedom = values - values.mean(), freedom - 1
    variance = state.noise[name].variance(None) if repeatability is None else repeatability**2
    if variance is None or not freedom:
        return None
    maps = sheet.maps(channel, rows_of_channel).power(2).sum() / len(rows_of_channel)
    setups = variance * sum(
        before.setup_scatter(what) ** 2 * float(np.mean(column**2))
        for what, column in zip(
            NUMBERS, (np.ones(len(rows_of_channel)), *sheet.tilt[rows_of_channel].T), strict=True
        )
    )
    scatter, setup_scatter = float(np.sqrt(variance + maps)), float(np.sqrt(setups))
    of_each = CHECK_ALARM / np.unique(rows.channel[rows.visit == visit]).size
    return CheckFigures(
        name,
        channel_unit(name).symbol,
        float(sheet.residuals.rows.times_s[rows_of_channel].max()),
        len(rows_of_channel),
        float(np.sqrt(np.sum(values**2) / freedom)),
        scatter,
        setup_scatter,
        # A set-up shifts all of its values at once.
        hypot(_most(freedom, of_each) * scatter, _most(1, of_each) * setup_scatter),
    )


def _most(freedom: int, probability: float) -> float:
    """How many standard deviations a root mean square of so much freedom may be."""
    return max(PLAINLY, float(np.sqrt(chdtri(freedom, probability) / freedom)))


def _along_travels(residuals: Residuals) -> FloatArray:
    """Scale positions from −1 to 1 over the travels, or over what was observed: shape (n, 3).

    Slopes of different verifications are then the same quantity.
    """
    points = residuals.rows.points_mm
    along = np.zeros(points.shape)
    for i, axis in enumerate(LINEAR_LETTERS):
        present = ~np.isnan(points[:, i])
        travel = residuals.projection.model.machine.axes.get(axis)
        ends = (travel.min_mm, travel.max_mm) if travel else _ends(points[present, i])
        if ends[1] > ends[0]:
            along[present, i] = (2.0 * points[present, i] - sum(ends)) / (ends[1] - ends[0])
    return along


def _ends(positions_mm: FloatArray) -> tuple[float, float]:
    return (float(positions_mm.min()), float(positions_mm.max())) if positions_mm.size else (0, 0)


@dataclass(frozen=True, slots=True)
class VisitNumber:
    """One followed number of one visit: its value, and its variances by observations and maps."""

    what: str
    value: float
    scatter: float
    maps: float


@dataclass(frozen=True, eq=False)
class _Fit:
    """Level and slopes of one channel in one visit, by least squares."""

    names: tuple[str, ...]
    columns: FloatArray
    inverse: FloatArray
    values: FloatArray
    residuals: FloatArray
    squares: float
    freedom: int

    @classmethod
    def of(cls, values: FloatArray, tilt: FloatArray) -> _Fit:
        columns = np.column_stack([np.ones(len(values)), tilt])
        chosen = [0, *(j for j in range(1, columns.shape[1]) if np.ptp(columns[:, j]) > 0)]
        if len(chosen) >= len(values):
            chosen = [0]
        columns = columns[:, chosen]
        inverse = np.linalg.pinv(columns)
        solution = inverse @ values
        residuals = values - columns @ solution
        return cls(
            tuple(NUMBERS[j] for j in chosen),
            columns,
            inverse,
            solution,
            residuals,
            float(np.sum(residuals**2)),
            len(values) - len(chosen),
        )

    def left_of(self, maps: SparseArray) -> float:
        """Give the squares that level and slopes leave of errors with columns of shape (m, p)."""
        columns = maps.toarray()
        return float(np.sum((columns - self.columns @ (self.inverse @ columns)) ** 2))

    def numbers(self, variance: float, maps: SparseArray, is_zeroed: bool) -> list[VisitNumber]:
        """Give each number with its scatter by observations; of an unknown zero not the level."""
        scatter = variance * np.sum(self.inverse**2, axis=1)
        of_maps = np.sum(np.asarray(self.inverse @ maps) ** 2, axis=1)
        return [
            VisitNumber(name, *(float(x) for x in numbers))
            for name, *numbers in zip(self.names, self.values, scatter, of_maps, strict=True)
            if not (is_zeroed and name == LEVEL)
        ]


def _judgement(
    state: WatchState, judged: bool, farthest: _Away | None, visits: int, model_version: int
) -> Judgement:
    is_beyond = state.beyond_since_s is not None
    named = state.all_followed()[:MOST_NAMED] if is_beyond else []
    changed = [followed for followed in named if followed.evidence >= LIMIT] or named[:1]
    sentence = _sentence(
        changed,
        judged,
        farthest if farthest and _farness(farthest) > FAR_OFF else None,
        is_first=all(s.process.steps <= 1 for s in state.streams.values()),
    )
    return Judgement(
        model_version,
        "beyond" if is_beyond else "within" if judged else "not-judged",
        state.evidence(),
        LIMIT,
        FALSE_ALARM,
        " ".join(filter(None, [sentence, state.contradiction()])),
        tuple(changed),
        visits,
    )


def _sentence(
    changed: Sequence[Followed], judged: bool, far: _Away | None, *, is_first: bool
) -> str:
    if not changed and not judged:
        return (
            "It could not be judged: the scatter of these measurements is not known yet. State "
            "repeatability_um, or measure more."
        )
    if not changed and is_first:
        starts = (
            "The watch starts here: no deviation is large enough for a first visit to show it, "
            "and there are no earlier visits to compare with."
        )
        return f"{starts} But {far.words}." if far else starts
    if not changed and far:
        return (
            f"No lasting change is proved, but {far.words}: set-ups may scatter so much, or the "
            "model lacks something that an analysis may find."
        )
    if not changed:
        return (
            "The machine agrees with its model within the scatter of measurement, set-up and maps."
        )
    strongest = changed[0]
    latest = f"{strongest.deviation:.2g} {strongest.unit}"
    expected = f"±{strongest.expected_sd:.2g} {strongest.unit}"
    # The evidence is of all visits: the latest alone may be where one visit was expected.
    how = (
        f"is off by {latest}, where {expected} was expected"
        if abs(strongest.deviation) > PLAINLY * strongest.expected_sd
        else (
            f"has changed, as several visits together show (in the latest it is off by {latest}, "
            f"where {expected} was expected of a single visit)"
        )
    )
    return (
        f"The machine no longer agrees with its model: the {strongest.what} of "
        f"{strongest.component} {how}. A "
        f"false alarm ever happens on at most {FALSE_ALARM:.0%} of unchanged machines."
    )
