"""A second source of heat that one run shows: learnt of stretches, and found on another run."""

import json
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest

from app.arrays import rms
from app.effects.effect import effect_from_json
from app.effects.observations import Observation, Verification
from app.geometry.chain import Chain
from app.geometry.components import COMPONENTS
from app.identification.analysis.response_rows import STRETCHES, response_rows
from app.identification.analysis.responses import find_responses
from app.identification.campaign import Campaign, residuals_of
from app.thermal.compile_model import compile_model
from app.thermal.error_map import ComponentTable, ErrorMap
from app.thermal.machine import Machine, Sensor, sensors_by_name
from app.thermal.temperature_history import TemperatureHistory

NAMES = ("frame", "bed", "chamber", "nozzle")
START_S = datetime(2026, 3, 2, 6, tzinfo=UTC).timestamp()
STEP_S = 60.0
MAPPED = (0, 25, 60, 120)
BED_UM_PER_K, FRAME_UM_PER_K = 1.5, -6.0


def late(values, minutes):
    found, state = np.empty(values.size), values[0]
    for i, value in enumerate(values):
        state += (value - state) * (1.0 - np.exp(-STEP_S / (60.0 * minutes))) * (i > 0)
        found[i] = state
    return found


def run(seed, room_c=22.0, hot_min=130, bed_c=100.0, day=0, minutes=300):
    """One run of a heated bed: it heats within minutes, the frame within an hour; then off."""
    random = np.random.default_rng(seed)
    t = np.arange(minutes)
    target = np.where(t < hot_min, bed_c, room_c)
    bed = np.empty(t.size)
    bed[0] = room_c
    for i in range(1, t.size):
        falls = target[i] + (bed[i - 1] - target[i]) * np.exp(-1.0 / 35.0)
        bed[i] = min(bed[i - 1] + 9.0, target[i]) if target[i] > bed[i - 1] else falls
    chamber = room_c + 0.3 * (late(bed, 15.0) - room_c)
    frame = room_c + 0.45 * (late(chamber, 30.0) - room_c)
    nozzle = np.minimum(room_c + 40.0 * t, 100.0)
    z = FRAME_UM_PER_K * frame + BED_UM_PER_K * late(bed, 6.0)
    truth = z - FRAME_UM_PER_K * 22.0 - BED_UM_PER_K * 22.0
    temperatures = {
        name: own + random.normal(0.0, 0.03, t.size)
        for name, own in zip(NAMES, (frame, bed, chamber, nozzle), strict=True)
    }
    return START_S + 86400.0 * day + STEP_S * t, temperatures, truth + random.normal(0, 1.0, t.size)


def campaign(*runs, maps_of=None, z=None):
    """Maps from four samples of the first run; each run is one verification."""
    machine = Machine(
        id="printer",
        name="A printer",
        chain=Chain.parse("XYFZ"),
        sensors=sensors_by_name([Sensor(name, max_rate_c_per_min=100.0) for name in NAMES]),
    )
    times_s, temperatures, values = maps_of or runs[0]
    maps = [
        ErrorMap(
            label=f"sample {i}",
            measured_at=datetime.fromtimestamp(float(times_s[i]), UTC),
            temperatures_c={name: float(own[i]) for name, own in temperatures.items()},
            tables={
                "EZZ": ComponentTable.make(
                    COMPONENTS["EZZ"], [float((values if z is None else z)[i])], [0.0]
                )
            },
            repeatability_um=1.0,
        )
        for i in MAPPED
    ]
    verifications = [
        Verification(
            f"run {number}",
            [
                Observation(float(t), (float(v),), "EZZ", 0.0)
                for t, v in zip(one[0], one[2] if z is None else z, strict=True)
            ],
        )
        for number, one in enumerate(runs)
    ]
    every = runs if maps_of is None else (maps_of, *runs)
    history = TemperatureHistory(
        np.concatenate([one[0] for one in every]),
        {name: np.concatenate([one[1][name] for one in every]) for name in NAMES},
    )
    return Campaign(compile_model(machine, maps, {"EZZ": "frame"}), maps, verifications, history)


def learnt(seed=0):
    known = run(seed)
    found = find_responses(campaign(known))
    return known, found


def test_one_run_without_history_predicts_another_start():
    known, found = learnt()
    (offered,) = found.offered
    assert set(offered.effect.sensors) == set(NAMES)
    assert offered.found.helps
    # Twelve stretches gain, and all of them are one record's.
    assert offered.judged.chance < 0.01
    assert offered.found.status == "suspected"
    assert len(offered.judged.rows.set_ups) == STRETCHES
    other = run(9, room_c=21.0, hot_min=70, bed_c=85.0, day=3, minutes=240)
    asked = campaign(other, maps_of=known)
    before = rms(residuals_of(asked).values)
    after = rms(residuals_of(replace(asked, effects=[offered.effect])).values)
    assert before > 20.0
    assert after < before / 4.0


def test_it_is_stored_and_read_as_it_was():
    _, found = learnt()
    effect = found.offered[0].effect
    again = effect_from_json(json.loads(json.dumps(effect.to_json())))
    assert again == effect
    asked = campaign(run(4, day=1))
    one, other = (residuals_of(replace(asked, effects=[e])).values for e in (effect, again))
    assert np.array_equal(one, other)


def test_samples_sent_one_by_one_are_the_record_that_they_would_be_together():
    known = campaign(run(0))
    (whole,) = known.verifications
    apart = [Verification(f"sample {i}", [o]) for i, o in enumerate(whole.observations)]
    one, other = (
        response_rows(residuals_of(replace(known, verifications=each)), "EZZ")
        for each in ([whole], apart)
    )
    assert one.columns == other.columns
    for a, b in zip(one.set_ups, other.set_ups, strict=True):
        np.testing.assert_array_equal(a.values, b.values)
        np.testing.assert_array_equal(a.found.values, b.found.values)
        assert a.record == b.record == 0


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "wander_um"), [(0, 3.0), (1, 10.0)])
def test_of_values_that_only_wander_nothing_is_named(seed, wander_um):
    times_s, temperatures, _ = run(seed)
    random = np.random.default_rng(100 + seed)
    apart = np.abs(np.subtract.outer(times_s, times_s)) / 1800.0
    root = np.linalg.cholesky(wander_um**2 * np.exp(-apart) + 1e-6 * np.eye(times_s.size))
    z = root @ random.normal(size=times_s.size) + random.normal(0.0, 1.0, times_s.size)
    assert not find_responses(campaign((times_s, temperatures, z), z=z)).offered
