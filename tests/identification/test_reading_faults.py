"""Sensors that read wrong by their own record, before and after that was adopted."""

from dataclasses import replace

import numpy as np
import pytest

from app.identification.analysis.reading_faults import reading_faults
from app.identification.campaign import Campaign
from app.thermal.compile_model import compile_model
from app.thermal.machine import sensors_by_name
from app.thermal.temperature_history import TemperatureHistory
from tests.effects.example_campaign_view import ASSIGNMENT, machine, maps, readings

SENSOR = "x-middle"


def campaign(variant, begin, until=None):
    """A record in which x-middle stands still, or spikes, between two of its rows."""
    sensors = [replace(s, stuck_after_s=3600.0) for s in machine().sensors.values()]
    own = replace(machine(), sensors=sensors_by_name(sensors))
    history, states = readings()
    values = history.temperatures_c[SENSOR].copy()
    if variant == "stuck":
        values[begin:until] = values[begin]
    else:
        values[begin:until:40] += 8.0
    record = TemperatureHistory(history.times_s, {**history.temperatures_c, SENSOR: values})
    return Campaign(compile_model(own, maps(), ASSIGNMENT), maps(), (), record, states)


def cut(whole, begin, end):
    """The same record, from one row to another."""
    kept = {s: t[begin:end] for s, t in whole.readings.temperatures_c.items()}
    return replace(whole, readings=TemperatureHistory(whole.readings.times_s[begin:end], kept))


@pytest.mark.parametrize(("variant", "until"), [("stuck", 1500), ("stuck", None), ("spikes", None)])
def test_what_was_adopted_is_not_found_again(variant, until):
    """Nor where the record begins later, or has gone on since."""
    whole = campaign(variant, 1000, until)
    found = reading_faults(cut(whole, 0, 2500))
    assert [e.variant for e in found.effects] == [variant]
    for record in (cut(whole, 0, 2500), cut(whole, 1200, 2500), whole):
        again = reading_faults(replace(record, effects=found.effects))
        assert (again.effects, again.words) == ((), ())
        plain = reading_faults(record).campaign.readings.temperatures_c[SENSOR]
        np.testing.assert_array_equal(again.campaign.readings.temperatures_c[SENSOR], plain)


def test_another_episode_sensor_or_matter_is_found_beside_what_was_adopted():
    whole = campaign("stuck", 1000, 1500)
    (known,) = reading_faults(whole).effects
    later = reading_faults(replace(campaign("stuck", 2500, 3000), effects=(known,)))
    assert [e.variant for e in later.effects] == ["stuck"]
    elsewhere = replace(known, sensors=("spindle",))
    assert reading_faults(replace(whole, effects=(elsewhere,))).effects == (known,)
    spikes = reading_faults(replace(campaign("spikes", 0), effects=(known,)))
    assert [e.variant for e in spikes.effects] == ["spikes"]


@pytest.mark.parametrize(("step_c", "found"), [(0.5, []), (-0.5, []), (4.0, ["stuck"])])
def test_a_sensor_that_goes_on_by_one_of_its_steps_had_not_stopped(step_c, found):
    whole = campaign("stuck", 1000, 1500)
    values = whole.readings.temperatures_c[SENSOR].copy()
    values = np.round(values * 2) / 2
    values[1500] = values[1499] + step_c
    others = {**whole.readings.temperatures_c, SENSOR: values}
    record = TemperatureHistory(whole.readings.times_s, others)
    assert [e.variant for e in reading_faults(replace(whole, readings=record)).effects] == found


@pytest.mark.parametrize(("spike_k", "found"), [(0.0, ()), (8.0, ("spikes",))])
def test_what_changes_by_one_step_between_two_readings_is_no_spike(spike_k, found):
    """Whole degrees of a sensor that scatters by a tenth jump away and back now and then."""
    whole = campaign("spikes", 0)
    history, _ = readings()
    values = history.temperatures_c[SENSOR]
    slow = np.repeat([22.3, 23.3, 24.3], -(-len(values) // 3))[: len(values)]
    read = np.round(slow + np.random.default_rng(1).normal(0.0, 0.1, len(values)))
    read[::40] += spike_k
    record = TemperatureHistory(history.times_s, {**history.temperatures_c, SENSOR: read})
    said = reading_faults(replace(whole, readings=record)).effects
    assert tuple(e.variant for e in said) == found
