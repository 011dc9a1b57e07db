"""The thermal network, the duty and the sensors."""

import numpy as np
import pytest

from app.simulation.undeclared.duty_cycle import make_duty_cycle
from app.simulation.undeclared.history import SENSORS, low_pass
from app.simulation.undeclared.thermal_network import BODIES, make_network


def test_a_network_at_rest_stays_at_rest():
    room = np.full(3000, 21.0)
    for series in make_network(np.random.default_rng(0)).temperatures(room, {}).values():
        np.testing.assert_allclose(series, 21.0, atol=1e-9)


def test_in_the_end_all_heat_goes_into_the_room():
    network = make_network(np.random.default_rng(0))
    n = 20_000
    rise = network.temperatures(np.full(n, 20.0), {"spindle": np.full(n, 300.0)})
    into_the_room_w = sum(
        network.to_air[i] * (rise[body][-1] - 20.0) for i, body in enumerate(BODIES)
    )
    assert into_the_room_w == pytest.approx(300.0, rel=1e-6)


def test_a_step_in_the_room_is_the_sum_of_the_modes():
    network = make_network(np.random.default_rng(3))
    room = np.full(400, 20.0)
    room[1:] = 25.0
    found = network.temperatures(room, {})
    rates, shapes = network.modes()
    root = np.sqrt(network.capacities)
    # T = T∞ − V·e^(−Λt)·Vᵀ·(T∞ − T0) in the symmetrised coordinates; 398 minutes after the step.
    left = shapes @ (np.exp(-rates * 398 * 60.0) * (shapes.T @ (5.0 * root))) / root
    for i, body in enumerate(BODIES):
        assert found[body][-1] == pytest.approx(25.0 - left[i], abs=1e-9)


def test_the_slowest_body_takes_hours():
    rates, _ = make_network(np.random.default_rng(1)).modes()
    assert 2.0 < 1.0 / rates[0] / 3600.0 < 8.0


def test_low_pass_of_a_ramp_lags_by_its_time_constant():
    ramp = np.arange(2000.0)
    assert low_pass(ramp, 40.0)[-1] == pytest.approx(1999.0 - 40.0, abs=1e-6)


def test_the_machine_rests_at_night_and_every_seventh_day():
    duty = make_duty_cycle(np.random.default_rng(5), 14)
    by_day = duty.working.reshape(14, 1440)
    assert not by_day[:, : 6 * 60].any()
    assert not by_day[:, 21 * 60 :].any()
    assert by_day.any(axis=1).tolist() == [True] * 6 + [False] + [True] * 6 + [False]
    speed = duty.state["spindle_rpm"]
    assert speed.min() == 0.0
    assert 9000.0 <= speed.max() <= 12_000.0
    assert not speed[~duty.working].any()


def visit_temperatures(campaign):
    _, first = np.unique(campaign.truth.observations.visit, return_index=True)
    times = campaign.truth.observations.time_min[first]
    return np.array([campaign.history.temperature(s, times) for s in SENSORS])


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_sensors_are_collinear_as_on_a_machine(campaign_of, seed):
    r = np.corrcoef(visit_temperatures(campaign_of(seed, visits=60, days=12)))

    def between(one, other):
        return r[SENSORS.index(one), SENSORS.index(other)]

    assert between("x-middle", "y-front") > 0.95
    assert 0.9 < between("z-column", "column-rear") < 0.995
    assert 0.85 < between("z-column", "bed") < 0.99
    assert 0.65 < between("x-middle", "z-column") < 0.95
    assert 0.0 < between("spindle", "bed") < 0.8
    assert r[~np.eye(len(SENSORS), dtype=bool)].max() < 0.999


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_temperatures_range_as_on_a_machine(campaign_of, seed):
    history = campaign_of(seed, visits=60, days=12).history
    spans = {s: np.ptp(history.since_first_reading(t)) for s, t in history.temperatures_c.items()}
    assert 3.0 < spans["ambient"] < 9.0
    assert 6.0 < spans["z-column"] < 15.0
    assert 6.0 < spans["x-middle"] < 15.0
    assert 15.0 < spans["spindle"] < 45.0


def test_readings_are_noisy_and_rounded(campaign_of, rms):
    record, history = campaign_of(quantum_c=0.05).record, campaign_of(quantum_c=0.05).history
    for sensor in SENSORS:
        said = record.temperatures_c[sensor]
        true = history.since_first_reading(history.temperatures_c[sensor])
        np.testing.assert_allclose(said / 0.05, np.round(said / 0.05), atol=1e-6)
        # Noise of 0.02 K and rounding to 0.05 K: √(0.02² + 0.05²/12).
        assert rms(said - true) == pytest.approx(0.0247, rel=0.05)


def test_a_sensor_that_stands_still_repeats_itself(campaign_of):
    still_campaign = campaign_of(frozen=2)
    record = still_campaign.record
    assert len(record.standstills) == 2
    for still in record.standstills:
        during = (record.minutes > still.from_min) & (record.minutes < still.to_min)
        assert np.ptp(record.temperatures_c[still.sensor][during]) == 0.0
    assert 0 < still_campaign.truth.is_frozen.sum() < still_campaign.truth.is_frozen.size


def test_the_maps_reach_beyond_all_temperatures_of_the_campaign(campaign_of):
    campaign = campaign_of()
    for sensor, nodes in campaign.maps.temperatures_c.items():
        assert (np.diff(nodes) > 1.0).all()
        assert nodes[0] < campaign.record.temperatures_c[sensor].min()
        assert campaign.record.temperatures_c[sensor].max() < nodes[-1]
