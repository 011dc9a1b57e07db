"""Measured minus predicted; what is left out before, and why."""

from dataclasses import replace

import numpy as np
import pytest

from app.effects.conditions import recorded_conditions
from app.effects.driver import Always
from app.effects.effect import Effect
from app.effects.observations import Observation, Verification, observation_rows
from app.effects.shape import Everywhere
from app.effects.term import Term
from app.errors import InvalidContent
from app.identification.residuals.residuals import compute_residuals
from app.identification.residuals.summary import summarise
from app.thermal.compile_model import compile_model
from app.thermal.machine import OutOfRange
from app.thermal.prediction import predict_component, predict_points
from app.thermal.sensor_health import believed
from app.thermal.temperature_history import TemperatureHistory
from tests.effects.example_campaign_view import (
    ASSIGNMENT,
    START_S,
    example_view,
    machine,
    maps,
    observations,
    readings,
)

NOON = START_S + 43200.0


def residuals_of(verifications, history=None, effects=(), model=None):
    raw, states = readings()
    raw = history or raw
    model = model or example_view().model
    rows = observation_rows(verifications)
    trusted = believed(model.machine, raw)
    conditions = recorded_conditions(
        model.machine.sensors, trusted, states, rows.times_s, rows.states
    )
    return compute_residuals(model, rows, conditions, effects, raw)


def measured(verifications, scale=1.0, plus=0.0):
    """Let the instrument read what the model says, times and plus something."""
    own = residuals_of(verifications)
    assert own.kept.all()
    flat = iter((own.predicted * scale + plus).tolist())
    return [
        replace(
            v,
            observations=[
                replace(o, measured=tuple(next(flat) for _ in o.measured)) for o in v.observations
            ],
        )
        for v in verifications
    ]


def test_residuals_are_measured_minus_predicted():
    own = residuals_of(observations())
    assert not own.left_out
    where = example_view()
    for channel in ("EXX", "EZZ", "SXY"):
        rows = own.rows.of_channel(channel)
        axis = "xyz".index(channel[-1].lower()) if channel != "SXY" else 0
        expected = predict_component(
            where.model,
            channel,
            {n: t[rows] for n, t in where.conditions.temperatures_c.items()},
            own.rows.points_mm[rows, axis],
            own.rows.directions[rows, axis],
        )
        np.testing.assert_allclose(own.values[rows], -expected.values)
    rows = own.rows.of_channel("points z")
    expected = predict_points(
        where.model,
        {n: t[rows] for n, t in where.conditions.temperatures_c.items()},
        own.rows.points_mm[rows],
        own.rows.tool_offsets_mm[rows],
        own.rows.directions[rows],
    )
    np.testing.assert_allclose(own.values[rows], -expected.values[:, 2])


def test_adopted_effects_are_part_of_the_prediction():
    shift = Effect("outdated-map", ("EXX",), terms=(Term("EXX", Always(), Everywhere(), 3.0),))
    without, with_it = residuals_of(observations()), residuals_of(observations(), effects=[shift])
    change = with_it.predicted - without.predicted
    assert change[with_it.rows.of_channel("EXX")] == pytest.approx(3.0)
    assert change[with_it.rows.of_channel("points x")] == pytest.approx(3.0)
    assert change[with_it.rows.of_channel("EZZ")] == pytest.approx(0.0)


def line(begin_s, code="EXX"):
    return [Observation(begin_s + 60.0 * i, (1.0,), code, 50.0 * i) for i in range(6)]


def reasons(own):
    return {left.reason: left.count for left in own.left_out}


def test_what_is_left_out_is_counted_with_its_reason():
    raw, _ = readings()
    gone = raw.times_s[(raw.times_s < NOON) | (raw.times_s > NOON + 7200.0)]
    keep = np.isin(raw.times_s, gone)
    thin = TemperatureHistory(gone, {n: t[keep] for n, t in raw.temperatures_c.items()})
    verifications = [
        Verification("early", line(START_S - 3600.0)),
        Verification("in the gap", line(NOON + 3600.0)),
        Verification("good", line(NOON + 20000.0) + line(NOON + 20000.0)),
        Verification("unknown", line(NOON + 30000.0, "EZY")),
    ]
    own = residuals_of(verifications, history=thin)
    assert reasons(own) == {
        "before the first reading": 6,
        "no reading near enough in time": 6,
        "an exact copy of another observation": 6,
        "the model does not have the component": 6,
    }
    assert len(own.rows) == 6


def test_a_frozen_sensor_is_told_from_missing_readings():
    raw, _ = readings()
    frozen = {n: t.copy() for n, t in raw.temperatures_c.items()}
    late = raw.times_s > NOON
    frozen["x-middle"][late] = frozen["x-middle"][late][0]
    stuck = TemperatureHistory(raw.times_s, frozen)
    own = residuals_of(
        [Verification("good", line(NOON - 3600.0)), Verification("bad", line(NOON + 86400.0))],
        history=stuck,
    )
    assert reasons(own) == {"frozen": 6}


def test_what_lies_outside_the_maps_is_another_question():
    raw, _ = readings()
    warm = TemperatureHistory(raw.times_s, {n: t + 6.0 for n, t in raw.temperatures_c.items()})
    rows = [Verification("warm", line(NOON)), Verification("good", line(START_S + 12600.0))]
    own = residuals_of(rows, history=warm)
    assert reasons(own) == {"outside the maps' temperatures": 6}
    # Where the machine extrapolates, it is the same question.
    reaching = compile_model(
        machine(out_of_range=OutOfRange.EXTRAPOLATE),
        maps(),
        ASSIGNMENT,
    )
    assert not residuals_of(rows, history=warm, model=reaching).left_out


@pytest.mark.parametrize(("scale", "unit"), [(1e-3, "mm"), (1e3, "nm")])
def test_a_wrong_unit_is_refused_with_a_hint(scale, unit):
    with pytest.raises(InvalidContent, match=f"were they meant in {unit}"):
        residuals_of(measured(observations(), scale))


def test_a_machine_that_hardly_errs_is_not_taken_for_a_wrong_unit():
    assert not residuals_of(measured(observations(), 0.05)).left_out


def test_nothing_left_is_refused_with_the_reasons():
    with pytest.raises(InvalidContent, match="before the first reading: 6"):
        residuals_of([Verification("early", line(START_S - 90000.0))])


def test_rows_for_the_search():
    verifications = [replace(v, repeatability_um=0.8) for v in measured(observations(), plus=0.25)]
    own = residuals_of(verifications)
    rows = own.as_rows()
    assert rows.values == pytest.approx(0.25)
    assert rows.tilt.shape == (len(own.rows), 3)
    assert np.abs(rows.tilt).max() == 1.0
    assert rows.noise[own.rows.channels.index("EXX")].repeatability == pytest.approx(0.8)
    assert own.rows.channels.index("SXY") not in rows.noise


# Summed up for a page.


def test_summaries_by_hand():
    own = residuals_of(observations())
    values = np.where(own.rows.directions[:, 0] > 0, 3.0, -1.0)
    found = {s.over: s for s in summarise(own, values, np.full(len(values), 2.0))}
    exx = next(b for b in found["component"].bins if b.label == "EXX")
    # Half of the rows came from each side.
    assert (exx.count, exx.mean, exx.p95, exx.share_above_repeatability) == (96, 1.0, 3.0, 0.5)
    assert exx.rms == pytest.approx(np.sqrt(5.0))
    squareness = next(b for b in found["component"].bins if b.label == "SXY")
    assert squareness.share_above_repeatability is None
    # From both sides along the line, from below at the points.
    assert {b.label: b.mean for b in found["direction x"].bins} == {"+": 3.0, "−": -1.0}
    assert [b.label for b in found["state spindle_rpm"].bins] == ["0", "4000", "9000"]
    assert "state payload_kg" not in found
    temperature = found["temperature x-middle [°C]"]
    lengths = int((own.rows.channel != own.rows.channels.index("SXY")).sum())
    assert sum(b.count for b in temperature.bins) == lengths
    assert all(
        a.high <= b.low for a, b in zip(temperature.bins, temperature.bins[1:], strict=False)
    )
    assert "rate z-column [°C/h]" in found
