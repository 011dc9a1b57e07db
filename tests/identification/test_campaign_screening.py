"""What a campaign leaves out before it is analysed: a doubtful sensor, a stopped log."""

from dataclasses import replace

import numpy as np
import pytest

from app.effects.observations import Observation, Verification
from app.identification.campaign import Campaign, residuals_of
from app.identification.doubted_sensors import comparisons, doubts, trusted_readings
from app.identification.residuals.frozen_observations import FROZEN
from app.thermal.temperature_history import TemperatureHistory
from tests.effects.example_campaign_view import (
    DAYS,
    START_S,
    example_view,
    maps,
    observations,
    readings,
)

MIDDLE_S = START_S + 86400.0 * (DAYS + 1) / 2.0


def campaign(verifications=None, off=None):
    """The example's campaign; `off` is a sensor that reads 40 K too high in the second half."""
    history, states = readings()
    temperatures = dict(history.temperatures_c)
    if off is not None:
        temperatures[off] = temperatures[off] + 40.0 * (history.times_s >= MIDDLE_S)
    return Campaign(
        example_view().model,
        maps(),
        verifications or observations(),
        TemperatureHistory(history.times_s, temperatures),
        states,
    )


def test_a_doubtful_sensor_that_nothing_follows_drives_nothing():
    asked = campaign(off="y-front")
    trusted = trusted_readings(asked.model, asked.readings)
    lost = np.isnan(trusted.temperatures_c["y-front"])
    assert lost[trusted.times_s >= MIDDLE_S].all()
    assert not lost[trusted.times_s < MIDDLE_S - 3600.0].any()
    conditions = residuals_of(asked).projection.conditions
    late = conditions.times_s >= MIDDLE_S
    assert np.isnan(conditions.temperature("y-front")[late]).all()


def test_a_sensor_that_components_follow_is_left_to_the_search():
    """Only the jump itself is not believed; the effect sensor-fault says what came of it."""
    asked = campaign(off="x-middle")
    trusted = trusted_readings(asked.model, asked.readings)
    assert np.isnan(trusted.temperatures_c["x-middle"]).sum() < 10


@pytest.mark.parametrize(
    ("sensor", "used"), [("y-front", "are not used"), ("x-middle", "used as they are")]
)
def test_a_doubtful_sensor_is_named(sensor, used):
    asked = campaign(off=sensor)
    # The jump itself is not believed, as a sensor's temperature cannot change so fast.
    (named,) = doubts(asked.model, asked.readings)
    assert named.on == sensor
    assert "+40" in named.reason or "+39" in named.reason
    assert used in named.reason
    assert comparisons([named])[0].startswith(f"Compare {sensor} with a calibrated thermometer")
    assert doubts(asked.model, campaign().readings) == ()


def test_a_stopped_log_is_left_out_and_counted():
    times = START_S + 86400.0 + 120.0 * np.arange(60)
    values = np.random.default_rng(4).normal(0.0, 1.0, 60)
    values[20:41] = values[20]
    warm_up = Verification(
        "warm-up",
        [
            Observation(float(t), (float(v),), "EZZ", 250.0)
            for t, v in zip(times, values, strict=True)
        ],
    )
    own = residuals_of(campaign([*observations(), warm_up]))
    (frozen,) = (one for one in own.left_out if one.reason == FROZEN)
    assert frozen.count == 20


@pytest.mark.parametrize("scale", [0.0, 1.0])
def test_equal_values_at_different_places_take_part(scale):
    still = [
        replace(
            v,
            observations=[
                replace(o, measured=tuple(scale for _ in o.measured)) for o in v.observations
            ],
        )
        for v in observations()
    ]
    assert not residuals_of(campaign(still)).left_out
