"""What few long records show: a component also follows a second sensor, late by several times.

One run of a machine is one set-up, and nobody knows from it how set-ups differ. It shows all the
same that a component follows a second source of heat through bodies of its own, because that bends
what the maps leave as nothing that wanders does. One sensor is named, the one that makes the values
most likely, with how far it is from what it was in the maps, at once and late. It is judged by
evidence against a wander, and by stretches of the records that are held out in turn.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np

from app.arrays import BoolArray, FloatArray, IntArray, rms
from app.effects.campaign_view import beyond_maps
from app.effects.conditions import Conditions
from app.effects.map_tables import maps_of_label
from app.effects.response_columns import OFF_MAPS, Column, Columns, InMaps, Zero, columns_at
from app.identification.analysis.response_judged import AGAIN, CARES, LEAST_GAIN, Judged
from app.identification.analysis.response_rows import (
    FEWEST_ROWS,
    KNOWN,
    SHORTEST_MIN,
    ResponseRows,
    SetUp,
)
from app.identification.campaign import Campaign
from app.identification.residuals.residuals import Residuals
from app.search.response import Course, Learnt, Posterior, Response
from app.search.response_average import Average, Priors, Stretch, caution
from app.search.rows import Datum
from app.thermal.machine import OutOfRange
from app.units import SECONDS_PER_MIN

OFF_MAPS_MIN: Final = (0.0, 4.0, 15.0, 60.0)
"""Time constants, each four times as long as the one before [min]. Wider apart, a body between two
of them is missed; closer together, neighbours take each other back."""

GAP_S: Final = 3600.0
"""What counts from one zero is one record while no pause is longer [s]."""

MOST_ROWS: Final = 150
"""Rows of one record: more of them are averaged, as all columns are, which is exact."""

STRETCHES: Final = 10
"""So many stretches of a single record are held out in turn."""

USUAL: Final = (0.02, 0.98)
"""Quantiles between which a sensor must change. One that moved only when the machine was switched
on tells the first map from all others, and nothing of what it drives."""

CLEARLY: Final = 10.0
"""Sensor resolutions that it must change by, as `Sensor` calls it clear."""

EVIDENCE: Final = 100.0
"""2 ln B from which a second sensor is believed rather than a wander: far above what chance needs,
because a sensor that stands for another cause in one run does so no more in the next. Of one to
three runs of a measured lathe, single sensors had 21 to 44 and made later runs worse by up to 16
micrometres; the second source of heat of two measured printers had 187 to 645. The limit lies
between, and was chosen on these machines."""

TIED: Final = 6.0
"""2 ln B within which another sensor would do as well."""


@dataclass(frozen=True, eq=False)
class JudgedRecords(Judged):
    """A second sensor of few records; the set-ups of its rows are the stretches.

    Parameters
    ----------
    evidence
        2 ln B against a wander alone.
    tried
        So many sensors were tried.
    tied
        Sensors that would do as well.
    records
        So many records there are.
    record : ndarray, shape (m,)
        To which record each stretch belongs; −1 where that counts from no zero of its own.
    """

    evidence: float = 0.0
    tried: int = 1
    tied: tuple[str, ...] = ()
    records: int = 1
    record: IntArray = field(default_factory=lambda: np.empty(0, dtype=np.intp))

    @cached_property
    def each(self) -> tuple[FloatArray, FloatArray]:
        """Root mean square of every stretch before and after, each record about its own mean.

        Of a record that was zeroed at its first observation: what happens in its first minutes
        would else be in every stretch of it.
        """
        before, after = list(self.before), list(self.after)
        for values in (before, after):
            for number in set(self.record.tolist()) - {-1}:
                own = np.flatnonzero(self.record == number).tolist()
                mean = float(np.concatenate([values[i] for i in own]).mean())
                for i in own:
                    values[i] = values[i] - mean
        return np.array([rms(v) for v in before]), np.array([rms(v) for v in after])

    @property
    def why_not(self) -> str:
        """Say why it is not to be adopted, empty where it is."""
        if self.evidence < EVIDENCE:
            return (
                f"{self.rows.columns[0].name} has 2 ln B of {self.evidence:.0f} against a wander, "
                f"and {EVIDENCE:.0f} is needed"
            )
        return super().why_not

    @property
    def is_worse_than_none(self) -> BoolArray:
        """Say nothing of stretches: uncompensated, their zero is of another time."""
        return np.zeros(len(self.after), dtype=np.bool_)

    @property
    def chance(self) -> float:
        """Bound on the probability of so much evidence by chance, for any of the sensors tried."""
        return float(min(1.0, self.tried * np.exp(-self.evidence / 2.0)))

    @property
    def is_by_chance(self) -> bool:
        """Whether a wander would do, or stretches held out gain too little."""
        is_small = self.after_rms > (1.0 - LEAST_GAIN) * self.before_rms
        return is_small or self.evidence < EVIDENCE


class _Record(NamedTuple):
    """Rows that count from one zero, in order of time, and whether the first is that zero."""

    rows: IntArray
    is_zeroed: bool


@dataclass(frozen=True, eq=False)
class _Tried:
    """One sensor: its columns, and what all records together say of it."""

    rows: ResponseRows
    found: Columns
    learnt: Learnt
    response: Response


class _HeldOut(NamedTuple):
    """A stretch: its record, its rows, what the others say of it, and how it surprises them."""

    record: int
    rows: IntArray
    learnt: Posterior
    surprise: float


def judge_records(campaign: Campaign, residuals: Residuals, code: str) -> JudgedRecords | str:
    """Learn which second sensor a component follows, and hold stretches out.

    Parameters
    ----------
    campaign
        With the maps.
    residuals
        What the model leaves without any response.
    code
        The component, observed at one place.

    Returns
    -------
    JudgedRecords or str
        Why there is nothing to judge, empty where that goes without saying.
    """
    own = residuals.rows.of_channel(code)
    conditions = residuals.projection.conditions.take(own)
    known = [
        (rows, found)
        for rows in _candidates(campaign, code, conditions)
        for found in [columns_at(rows.columns, rows.zero, conditions)]
        if np.isfinite(found.values).all(axis=1).mean() >= KNOWN
    ]
    if not known:
        return "none changes clearly and has a temperature in every map"
    # All sensors are asked of the same rows, or their evidence could not be compared.
    usable = np.isfinite(np.hstack([found.values for _, found in known])).all(axis=1)
    records = _records(residuals, own, usable & np.isfinite(residuals.values[own]))
    if not records:
        return f"no record lasts {SHORTEST_MIN:.0f} min with sensor readings"
    values = residuals.values[own]
    tried = []
    for rows, found in known:
        response = _response(_courses(records, found.values, values, conditions), len(rows.columns))
        tried.append(_Tried(rows, found, response.learn(), response))
    nought = np.zeros((own.size, 1))
    nothing = _response(_courses(records, nought, values, conditions), 1)
    tried.sort(key=lambda one: one.learnt.misfit)
    best = tried[0]
    # The likelihood has several maxima in the wander: what a driver's own wander would do without
    # the driver is no evidence for it.
    noise = best.learnt.prior.noise
    starts = [None, nothing.begin()._replace(noise=noise)]
    without = min(nothing.learn(start).misfit for start in starts)
    tied = tuple(
        one.rows.columns[0].name
        for one in tried[1:]
        if 2.0 * (one.learnt.misfit - best.learnt.misfit) < TIED
    )
    evidence = 2.0 * (without - best.learnt.misfit)
    held_out = _held_out(best, records, _stretches(best, records, conditions), values, conditions)
    if not held_out:
        return "nothing is left to learn from while a stretch is held out"
    judged = [
        _judged(best, records, held_out, values, conditions, residuals, own, care)
        for care in (CARES if evidence >= EVIDENCE else CARES[:1])
    ]
    typical = float(np.median(judged[0].each[1]))  # the same measure for all
    judged = [replace(one, typical=typical) for one in judged]
    chosen = next((one for one in judged if not one.is_worse.any()), judged[0])
    return replace(chosen, evidence=evidence, tried=len(tried), tied=tied, records=len(records))


def _records(residuals: Residuals, own: IntArray, usable: BoolArray) -> list[_Record]:
    """Part a component's usable rows into records that last long enough."""
    rows = residuals.rows
    times_s, verification = rows.times_s[own], rows.verification[own]
    order = np.argsort(times_s, kind="stable")
    order = order[usable[order]]
    is_absolute = np.array(
        [rows.verifications[v].datum is Datum.ABSOLUTE for v in verification.tolist()]
    )
    parts = [
        (order[~is_absolute[order] & (verification[order] == v)], True)
        for v in np.unique(verification[~is_absolute])
    ]
    together = order[is_absolute[order]]
    pauses = np.flatnonzero(np.diff(times_s[together]) > GAP_S) + 1
    parts += [(part, False) for part in np.split(together, pauses)]
    return [
        _Record(part, is_zeroed)
        for part, is_zeroed in parts
        if part.size >= FEWEST_ROWS and np.ptp(times_s[part]) >= SHORTEST_MIN * SECONDS_PER_MIN
    ]


def _candidates(campaign: Campaign, code: str, conditions: Conditions) -> list[ResponseRows]:
    """List the second sensors that changed clearly, with what they were in the maps."""
    model = campaign.model
    group = model.find(code)
    if group is None:
        return []
    own_sensor = group[0].sensor
    labels = [group[0].labels[row] for row in group[0].scales[0].rows]
    found = []
    for name, sensor in model.machine.sensors.items():
        here_c = conditions.temperature(name)
        here_c = here_c[np.isfinite(here_c)]
        beyond = beyond_maps(model, campaign.maps, code, name)
        if name == own_sensor or beyond is None or not here_c.size:
            continue
        low_c, high_c = np.quantile(here_c, USUAL)
        if high_c - low_c <= CLEARLY * sensor.resolution_c:
            continue
        columns = tuple(Column(OFF_MAPS, name, minutes) for minutes in OFF_MAPS_MIN)
        own_c, stated_c = zip(*beyond.in_maps_c, strict=True)
        at_s = [
            next(
                m for m in maps_of_label(campaign.maps, label) if code in m.tables
            ).measured_at.timestamp()
            for label in labels
        ]
        in_maps = InMaps(
            own_sensor,
            tuple(own_c),
            tuple(_in_maps(column, stated_c, at_s, conditions) for column in columns),
            goes_on=model.machine.out_of_range is OutOfRange.EXTRAPOLATE,
        )
        zero = Zero(references_c=(0.0,) * len(columns), in_maps=in_maps)
        found.append(ResponseRows(code, own_sensor, columns, zero, ()))
    return found


def _in_maps(
    column: Column, stated_c: Sequence[float], at_s: Sequence[float], conditions: Conditions
) -> tuple[float, ...]:
    """Say what a column was in each map: late as its record knows, else as the map states it."""
    if not column.minutes:
        return tuple(stated_c)
    tau_s = SECONDS_PER_MIN * column.minutes
    found = []
    for t_s, stated in zip(at_s, stated_c, strict=True):
        known = np.full(1, np.nan)
        if conditions.lags.record_before_s(column.signal, t_s) > 0.0:
            known = conditions.lags.from_start(column.signal, tau_s, np.array([t_s])).outputs
        # A map from before the record counts as measured when all had settled.
        found.append(float(known[0]) if np.isfinite(known[0]) else stated)
    return tuple(found)


def _courses(
    records: Sequence[_Record],
    columns: FloatArray,
    values: FloatArray,
    conditions: Conditions,
    without: IntArray | None = None,
) -> list[Course]:
    """Lay records out, their rows averaged where there are many, without those held out.

    A record that was zeroed at its first row has a level that is not known, in a column of its own
    behind the others: what the first minutes do by themselves would else weigh on all that follows.
    """
    zeroed = [number for number, record in enumerate(records) if record.is_zeroed]
    found = []
    for number, record in enumerate(records):
        kept = record.rows if without is None else record.rows[~np.isin(record.rows, without)]
        if not kept.size:
            continue
        parts = np.array_split(kept, min(MOST_ROWS, kept.size))
        times_s, rows, results = (
            np.array([of[part].mean(axis=0) for part in parts])
            for of in (conditions.times_s, columns, values)
        )
        level = np.tile([float(number == other) for other in zeroed], (len(parts), 1))
        began_s = float(conditions.times_s[record.rows[0]])
        since_min = (times_s - began_s) / SECONDS_PER_MIN
        found.append(Course(since_min, np.hstack([rows, level]), results, False, began_s))
    return found


def _response(courses: Sequence[Course], drivers: int) -> Response:
    """Learn of courses: the scale of what drives them is one, that of their levels another."""
    groups = np.arange(courses[0].columns.shape[1]) >= drivers
    return Response(courses, groups.astype(np.intp))


def _stretches(
    best: _Tried, records: Sequence[_Record], conditions: Conditions
) -> list[tuple[int, IntArray]]:
    """Cut one record into stretches, of equal shares of its time and of what drives them.

    Of several records each is held out whole: that is what another run will be. Cut by time alone,
    one stretch of a warm-up would hold nearly all that happens, and what is learnt from the others
    would be asked of what none of them has seen.
    """
    each = STRETCHES if len(records) == 1 else 1
    found = []
    for number, record in enumerate(records):
        steps = np.abs(np.diff(best.found.values[record.rows], axis=0)).sum(axis=1)
        time = np.diff(conditions.times_s[record.rows])
        share = 0.5 * time / time.sum() + 0.5 * steps / max(float(steps.sum()), 1e-12)
        at = np.concatenate([[0.0], np.cumsum(share)])
        which = np.minimum((at * each).astype(np.intp), each - 1)
        found += [(number, record.rows[which == k]) for k in np.unique(which)]
    return found


def _held_out(
    best: _Tried,
    records: Sequence[_Record],
    stretches: Sequence[tuple[int, IntArray]],
    values: FloatArray,
    conditions: Conditions,
) -> list[_HeldOut]:
    """Learn of every stretch's others what they say of it."""
    p, prior, columns = len(best.rows.columns), best.learnt.prior, best.found.values
    zeroed = [i for i, record in enumerate(records) if record.is_zeroed]
    found = []
    for number, rows in stretches:
        left = _courses(records, columns, values, conditions, without=rows)
        if not left:
            continue
        response = _response(left, p)
        learnt = response.learn(prior, AGAIN).prior
        without = response.posterior(learnt, weighs=False)
        asked = np.zeros((rows.size, without.mean.size))
        asked[:, :p] = columns[rows]
        if number in zeroed:
            asked[:, p + zeroed.index(number)] = 1.0
        variance = np.einsum("ij,jk,ik->i", asked, without.covariance, asked)
        noise = learnt.noise
        variance += float(noise.over(np.zeros(1))[0]) + noise.white**2
        error = values[rows] - asked @ without.mean
        surprise = float(np.mean(error**2) / np.mean(variance))
        found.append(_HeldOut(number, rows, _of_drivers(without, p), surprise))
    return found


def _judged(
    best: _Tried,
    records: Sequence[_Record],
    held_out: Sequence[_HeldOut],
    values: FloatArray,
    conditions: Conditions,
    residuals: Residuals,
    own: IntArray,
    care: float,
) -> JudgedRecords:
    """Predict every stretch by what was learnt without it."""
    prior = best.learnt.prior
    p = len(best.rows.columns)
    posterior = _of_drivers(best.response.posterior(prior, weighs=False), p)
    average = Average(
        Priors(prior, {}),
        prior.noise,
        [Stretch(float("inf"), posterior.mean, posterior.covariance)],
        {None: 1.0},
        posterior.weights,
        best.learnt.misfit,
    )
    columns = best.found.values
    doubt = max(1.0, float(np.mean([one.surprise for one in held_out])))
    set_ups, uncompensated, before, after = [], [], [], []
    for number, rows, without, _ in held_out:
        record = records[number]
        zero = record.rows[:1] if record.is_zeroed else rows[:0]
        asked = np.concatenate([zero, rows])
        mean = columns[asked] @ without.mean
        size = np.sqrt(
            np.maximum(
                np.einsum("ij,jk,ik->i", columns[asked], without.covariance, columns[asked]), 0.0
            )
        )
        corrected = mean * caution(mean, np.sqrt(care * doubt) * size, np.zeros(mean.shape))
        left = values[asked] - corrected
        measured = residuals.rows.measured[own[asked]]
        was = values[asked]
        if zero.size:
            left, measured, was = ((v - v[0])[1:] for v in (left, measured, was))
        before.append(was)
        after.append(left)
        uncompensated.append(measured)
        set_ups.append(_set_up(residuals, own, rows, columns, values, conditions))
    return JudgedRecords(
        rows=replace(best.rows, set_ups=set_ups),
        average=average,
        doubt=doubt,
        usual=doubt,
        care=care,
        spares_maps=True,
        typical=0.0,
        uncompensated=uncompensated,
        before=before,
        after=after,
        record=np.array([n if records[n].is_zeroed else -1 for n, _, _, _ in held_out]),
    )


def _of_drivers(posterior: Posterior, p: int) -> Posterior:
    """Leave the levels of records out."""
    return posterior._replace(mean=posterior.mean[:p], covariance=posterior.covariance[:p, :p])


def _set_up(
    residuals: Residuals,
    own: IntArray,
    rows: IntArray,
    columns: FloatArray,
    values: FloatArray,
    conditions: Conditions,
) -> SetUp:
    label = residuals.rows.verifications[int(residuals.rows.verification[own[rows[0]]])].label
    return SetUp(
        label,
        conditions.times_s[rows],
        values[rows],
        residuals.rows.measured[own[rows]],
        np.zeros(rows.size),
        Columns(columns[rows], np.zeros(rows.size)),
        False,
    )
