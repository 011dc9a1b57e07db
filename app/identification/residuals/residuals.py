"""Measured minus predicted, and what had to be left out before, each with its reason."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from app.answer import Answer
from app.arrays import BoolArray, FloatArray, IntArray, rms
from app.effects.adopted.contributions import contributions
from app.effects.adopted.faulty_sensors import set_faulty_aside
from app.effects.adopted.prediction import AskedPlaces, predict_maps
from app.effects.conditions import Conditions
from app.effects.effect import Effect, acting_on
from app.effects.observations import POINT_CHANNELS, ObservationRows, repeated_rows
from app.effects.projection import Projection, missing_at_points
from app.errors import InvalidContent
from app.geometry.components import COMPONENTS
from app.identification.residuals.frozen_observations import FROZEN, frozen_rows
from app.identification.residuals.rounding import rounding
from app.search.rows import DeclaredNoise, Rows
from app.thermal.bracket import Status
from app.thermal.compiled_model import CompiledModel
from app.thermal.group import Group
from app.thermal.machine import Machine
from app.thermal.map_weights import NO_READING, OUTSIDE_MAPS
from app.thermal.prediction import Predicted
from app.thermal.sensor_health import believed, without_stuck
from app.thermal.temperature_history import TemperatureHistory
from app.units import SECONDS_PER_MIN, UM_PER_MM, Unit

Reasons: TypeAlias = NDArray[np.object_]
"""A sentence for each row, empty where nothing is the matter."""

BEFORE_THE_FIRST: Final = "before the first reading"
NONE_NEAR: Final = "no reading near enough in time"

FEWEST_FOR_UNIT: Final = 5
"""From fewer values nothing is said about their unit."""

MOST_ON_STAND_INS: Final = 0.5
"""Rows that a stand-in's temperature predicts say little of the model: they are left out, unless
so many lean on one that the machine lives with it."""

SLACK: Final = 5.0
"""Values in a wrong unit are a thousand times off, within this factor."""

BEYOND_THE_MAPS: Final = "outside the maps' temperatures"
"""Why values took no part that the maps do not reach."""

LEAST_UM: Final = 1.0
"""Predictions below this are too small to tell a wrong unit from a good machine."""


class WrongUnit(InvalidContent):
    """Measured values that are evidently in another unit than stated."""


class NoReadingsThen(InvalidContent):
    """Nothing can be compared, and some for want of readings of its time, which may yet come."""


@dataclass(frozen=True, slots=True)
class LeftOut(Answer, published_as="ExcludedAnswer"):
    """Values that took no part, with the reason."""

    reason: Annotated[str, Field(examples=["frozen"])]
    """Why"""

    count: int
    """How many values"""


@dataclass(frozen=True, eq=False)
class Residuals:
    """What the model leaves, at the rows that can be judged.

    Parameters
    ----------
    predicted : ndarray, shape (n,)
        What the model says, its adopted effects included [the channels' units].
    kept : ndarray, shape (all rows,)
        Which of the original rows are left.
    counted_as_zero
        Components that the model lacks and rows at points need: what was measured is not
        refused for that, but a residual there contains them whole.
    """

    projection: Projection
    predicted: FloatArray
    left_out: tuple[LeftOut, ...]
    kept: BoolArray
    counted_as_zero: tuple[str, ...]

    @property
    def rows(self) -> ObservationRows:
        """The rows that are left."""
        return self.projection.rows

    @property
    def values(self) -> FloatArray:
        """Measured minus predicted, shape (n,) [the channels' units]."""
        return self.rows.measured - self.predicted

    @property
    def temperature_ranges(self) -> dict[str, tuple[float, float]]:
        """The lowest and the highest temperature of each sensor at the rows [°C]."""
        known = self.projection.conditions.temperatures_c.items()
        return {
            name: (float(np.nanmin(t)), float(np.nanmax(t)))
            for name, t in known
            if np.isfinite(t).any()
        }

    def as_rows(self) -> Rows:
        """Hand the residuals to the search."""
        rows = self.rows
        return Rows(
            values=self.values,
            visit=rows.visit,
            channel=rows.channel,
            tilt=tilt_columns(self.projection),
            replicate=rows.replicate,
            noise=_declared(rows),
            datum=rows.datum(),
            alike={i: str(channel_unit(name)) for i, name in enumerate(rows.channels)},
            minutes=(rows.times_s - rows.times_s.min()) / SECONDS_PER_MIN,
        )


def compute_residuals(
    model: CompiledModel,
    rows: ObservationRows,
    conditions: Conditions,
    effects: Sequence[Effect] = (),
    readings: TemperatureHistory | None = None,
    *,
    older_readings: bool = False,
) -> Residuals:
    """Subtract what the model says from what was measured.

    Parameters
    ----------
    conditions
        What held at each row; temperatures as far as they can be believed.
    readings
        The readings as they came, believable or not: to say why there is no temperature.
    older_readings
        Whether there are readings from before these, so that nothing is before the first.

    Raises
    ------
    InvalidContent
        If nothing is left, or measured values are evidently in another unit.
    """
    aside = set_faulty_aside(model, effects, conditions)
    predicted = _predict(model, rows, aside.conditions, effects)
    status = np.array(predicted.status, dtype=object)
    leaning = (status == Status.STAND_IN) & ~_any_of(aside.effects.values(), len(rows))
    if leaning.mean() <= MOST_ON_STAND_INS:
        status[leaning] = NO_READING
    reasons = _reasons(model, rows, conditions, status, readings)
    if older_readings:
        reasons[reasons == BEFORE_THE_FIRST] = NONE_NEAR
    total = predicted.values
    if effects:
        added = contributions(Projection(model, rows, conditions), effects)
        total = total + added.errors
        reasons[(reasons == "") & added.is_lacking] = (
            "an adopted effect lacks a reading or a state that it needs"
        )
    are_compared = reasons == ""
    left_out = tuple(
        LeftOut(str(reason), int((reasons == reason).sum()))
        for reason in np.unique(reasons[~are_compared])
    )
    if not are_compared.any():
        counts = ", ".join(f"{e.reason}: {e.count}" for e in left_out)
        lacks_readings = not {NONE_NEAR, BEFORE_THE_FIRST}.isdisjoint(reasons)
        raise (NoReadingsThen if lacks_readings else InvalidContent).of_field(
            "observations",
            f"expected some that can be compared with the model, got none ({counts})",
        )
    _refuse_wrong_unit(rows.take(are_compared), total[are_compared])
    projection = Projection(
        model, rows.take(are_compared), conditions.take(np.flatnonzero(are_compared))
    )
    missing = _counted_as_zero(model, projection.rows, effects)
    return Residuals(projection, total[are_compared], left_out, are_compared, missing)


def _counted_as_zero(
    model: CompiledModel, rows: ObservationRows, effects: Sequence[Effect]
) -> tuple[str, ...]:
    points = [number for number, name in enumerate(rows.channels) if name in POINT_CHANNELS]
    tools_mm = rows.tool_offsets_mm[np.isin(rows.channel, points)]
    return tuple(missing_at_points(model, effects, tools_mm)) if len(tools_mm) else ()


def tilt_columns(projection: Projection) -> FloatArray:
    """Make the columns along which a visit may tilt: positions from −1 to 1 over their range.

    Returns
    -------
    ndarray, shape (n, q), q ≤ 3
        x, y and z; zero where a row does not know a coordinate. Columns that are zero
        everywhere are left out.
    """
    points = projection.rows.points_mm
    columns = np.zeros(points.shape)
    for i in range(points.shape[1]):
        present = ~np.isnan(points[:, i])
        if present.any() and np.ptp(points[present, i]) > 0:
            low, high = points[present, i].min(), points[present, i].max()
            columns[present, i] = (2.0 * points[present, i] - low - high) / (high - low)
    return columns[:, columns.any(axis=0)]


def _predict(
    model: CompiledModel,
    rows: ObservationRows,
    conditions: Conditions,
    effects: Sequence[Effect],
) -> Predicted:
    """Predict what the maps say alone of each row (`predict_maps`)."""
    values = np.full(len(rows), np.nan)
    status = np.full(len(rows), "not in the model", dtype=object)
    have = {code for group in model.groups for code in group.codes} | acting_on(effects)
    for channel in rows.channels:
        component = None if channel in POINT_CHANNELS else channel
        if component is not None and component not in have:
            continue
        chosen = rows.of_channel(channel)
        where = (rows.points_mm, rows.tool_offsets_mm, rows.directions)
        places = AskedPlaces(component, *(part[chosen] for part in where))
        prediction = predict_maps(model, effects, places, conditions.take(chosen))
        values[chosen] = (
            prediction.values
            if component is not None
            else prediction.values[:, POINT_CHANNELS.index(channel)]
        )
        status[chosen] = [str(s) for s in prediction.status]
    return Predicted(values, status.tolist())


def _any_of(masks: Iterable[BoolArray], n: int) -> BoolArray:
    union: BoolArray = np.any([np.zeros(n, dtype=np.bool_), *masks], axis=0)
    return union


def _reasons(
    model: CompiledModel,
    rows: ObservationRows,
    conditions: Conditions,
    predicted: Reasons,
    readings: TemperatureHistory | None,
) -> Reasons:
    """Say of each row why it cannot be judged, empty where it can."""
    reasons = np.full(len(rows), "", dtype=object)
    reasons[predicted == "not in the model"] = "the model does not have the component"
    reasons[predicted == OUTSIDE_MAPS] = BEYOND_THE_MAPS
    reasons[(predicted == Status.CLAMPED) & _far_outside(model, rows, conditions)] = BEYOND_THE_MAPS
    silent = predicted == NO_READING
    reasons[silent] = NONE_NEAR
    if readings is not None and silent.any():
        at = np.flatnonzero(silent)
        reasons[at] = _why_silent(model, rows.times_s[at], readings)
    reasons[(reasons == "") & repeated_rows(rows)] = "an exact copy of another observation"
    reasons[(reasons == "") & frozen_rows(rows, conditions)] = FROZEN
    return reasons


def _why_silent(model: CompiledModel, times_s: FloatArray, readings: TemperatureHistory) -> Reasons:
    """Tell missing readings from readings that cannot be believed."""
    machine = model.machine
    without_frozen = without_stuck(machine, readings)
    trusted = believed(machine, readings)
    reasons = np.full(times_s.shape, NONE_NEAR, dtype=object)
    for name in {group.sensor for group in model.groups}:
        age_s = machine.sensor(name).max_age_s
        present = ~np.isnan(readings.at(name, times_s, age_s))
        lost = present & np.isnan(trusted.at(name, times_s, age_s))
        frozen = present & np.isnan(without_frozen.at(name, times_s, age_s))
        reasons[lost] = f"readings of {name} were not credible"
        reasons[frozen] = "frozen"
    first = readings.times_s[0] if readings.times_s.size else np.inf
    reasons[times_s < first] = BEFORE_THE_FIRST
    return reasons


def _far_outside(model: CompiledModel, rows: ObservationRows, conditions: Conditions) -> BoolArray:
    """Find rows that lie further beyond the maps than the sensor resolves."""
    beyond = {id(group): _beyond(model.machine, group, conditions) for group in model.groups}
    outside = np.zeros(len(rows), dtype=np.bool_)
    for number, channel in enumerate(rows.channels):
        concerned = [g for g in model.groups if channel in POINT_CHANNELS or channel in g.codes]
        for group in concerned:
            outside |= (rows.channel == number) & beyond[id(group)]
    return outside


def _beyond(machine: Machine, group: Group, conditions: Conditions) -> BoolArray:
    beyond = np.zeros(len(conditions), dtype=np.bool_)
    undecided = np.ones(len(conditions), dtype=np.bool_)
    for scale in group.scales:
        t = conditions.temperature(scale.sensor)
        margin = machine.sensor(scale.sensor).resolution_c
        outside = (t < scale.temperatures_c[0] - margin) | (t > scale.temperatures_c[-1] + margin)
        beyond |= undecided & outside
        undecided &= np.isnan(t)
    return beyond


def _refuse_wrong_unit(rows: ObservationRows, predicted: FloatArray) -> None:
    """Refuse a verification whose values are a thousand times too small or too large."""
    lengths = np.array([channel_unit(name) is Unit.UM for name in rows.channels])[rows.channel]
    for i, verification in enumerate(rows.verifications):
        lengths_of_verification = (rows.verification == i) & lengths
        if lengths_of_verification.sum() < FEWEST_FOR_UNIT:
            continue
        came, expected = (
            _size(values[lengths_of_verification], rows.channel[lengths_of_verification])
            for values in (rows.measured, predicted)
        )
        if expected < LEAST_UM or came == 0.0:
            continue
        ratio = came / expected
        if ratio < SLACK / UM_PER_MM or ratio > UM_PER_MM / SLACK:
            unit = "mm" if ratio < 1.0 else "nm"
            raise WrongUnit.of_field(
                "measured_um",
                f"expected values in µm in verification {verification.label!r}, where the model "
                f"says up to {expected:.3g} µm, got no more than {came:.3g}: were they meant in "
                f"{unit}?",
            )


def _size(values: FloatArray, channels: IntArray) -> float:
    """The largest range within a channel, or distance from zero if that is smaller."""
    sizes = [
        max(float(np.ptp(values[channels == c])), 0.0)
        if (channels == c).sum() > 1
        else float(np.abs(values[channels == c]).max())
        for c in np.unique(channels)
    ]
    return max(sizes)


def channel_unit(channel: str) -> Unit:
    """Give the unit of a channel: the component's, or µm at points."""
    return Unit.UM if channel in POINT_CHANNELS else COMPONENTS[channel].unit


def _declared(rows: ObservationRows) -> Mapping[int, DeclaredNoise]:
    """Take the repeatability that verifications state, for channels in µm, and what is rounded.

    What an instrument reads in coarse steps scatters by its rounding too, and stated is how well
    it repeats. In steps of two repeatabilities the variance is a third larger.
    """
    declared = {}
    units = [channel_unit(channel) for channel in rows.channels]
    # Few values of one channel do not show a step that those of all in its unit together do.
    common = {
        unit: rounding(rows.measured[np.array([unit is unit_ for unit_ in units])[rows.channel]])
        for unit in set(units)
    }
    for number, unit in enumerate(units):
        of_channel = rows.channel == number
        which = rows.verification[of_channel]
        repeatabilities = [rows.verifications[i].repeatability_um for i in which.tolist()]
        declared_um = [s for s in repeatabilities if s is not None]
        rounded = common[unit] or rounding(rows.measured[of_channel])
        if unit is Unit.UM and declared_um and len(declared_um) == len(repeatabilities):
            scatter = float(np.hypot(rms(np.array(declared_um)), rounded))
            declared[number] = DeclaredNoise(repeatability=scatter, rounding=rounded)
        elif rounded:
            declared[number] = DeclaredNoise(rounding=rounded)
    return declared
