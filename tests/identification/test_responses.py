"""Responses of many drivers: found where they are, adopted, used on other days; else nothing."""

from dataclasses import replace
from datetime import UTC, datetime
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pytest

from app.arrays import rms
from app.effects.adopted.carry_over import without_replaced
from app.effects.observations import Observation, Verification
from app.effects.response_columns import MAPS
from app.geometry.chain import Chain
from app.geometry.components import COMPONENTS
from app.identification.analysis import response_rows as response_rows_module
from app.identification.analysis.analyse import analyse
from app.identification.analysis.response_judged import Judged, judge
from app.identification.analysis.response_rows import response_rows, unrecorded_states
from app.identification.analysis.responses import find_responses, that_leave_less
from app.identification.campaign import Campaign, residuals_of
from app.search.findings import Status
from app.search.rows import Datum
from app.thermal.compile_model import compile_model
from app.thermal.error_map import ComponentTable, ErrorMap
from app.thermal.machine import Machine, OutOfRange, Sensor, sensors_by_name
from app.thermal.temperature_history import TemperatureHistory

NAMES = ("room", "bed", "spindle", "column")
START_S = datetime(2026, 3, 2, 6, tzinfo=UTC).timestamp()
DAY_S, STEP_S, LONG_S = 86400.0, 120.0, 4 * 3600.0


def machine():
    return Machine(
        id="lathe",
        name="A lathe",
        chain=Chain.parse("FZX"),
        sensors=sensors_by_name([Sensor(name, max_age_s=1800.0) for name in NAMES]),
        out_of_range=OutOfRange.EXTRAPOLATE,
        extrapolation_margin_c=30.0,
    )


def maps(slope_um_per_k=0.0):
    return [
        ErrorMap(
            label=f"{t:g} °C",
            measured_at=datetime(2026, 2, 1, tzinfo=UTC),
            temperatures_c=dict.fromkeys(NAMES, t),
            tables={"EXX": ComponentTable.make(COMPONENTS["EXX"], [slope_um_per_k * t], [0.0])},
        )
        for t in (15.0, 35.0)
    ]


def late(values, tau_s, first):
    found, state = np.empty(values.size), first
    for i, value in enumerate(values):
        state += (value - state) * (1.0 - np.exp(-STEP_S / tau_s)) * (i > 0)
        found[i] = state
    return found


def campaign(seed, runs=12, drives=0.0, wander=2.0, effects=(), first_day=0, slope=0.0):
    """Runs of four hours on as many days: the error follows the room late, and the speed."""
    random = np.random.default_rng(seed)
    times = np.arange(0.0, LONG_S + 1.0, STEP_S)
    readings, states, verifications = [], [], []
    for run in range(runs):
        at_s = START_S + DAY_S * (first_day + run)
        speed = random.choice([1000.0, 2000.0, 3000.0]) * (
            times < random.uniform(0.3, 1.0) * LONG_S
        )
        room = 22.0 + random.normal(0, 2) + random.normal(0, 3) * np.minimum(times / LONG_S, 0.5)
        spindle = room[0] + late(8e-3 * speed, 2400.0, 0.0) + late(room - room[0], 6000.0, 0.0)
        bed = late(room, 9000.0, room[0] + random.normal(0, 1.0))
        column = late(0.7 * room + 0.3 * spindle, 4000.0, room[0])
        temperatures = np.column_stack([room, bed, spindle, column])
        temperatures = np.round(temperatures + random.normal(0, 0.03, temperatures.shape), 2)
        true = 5.0 * (late(room, 1800.0, room[0]) - room[0]) + 6e-3 * late(speed, 3600.0, 0.0)
        kernel = np.exp(-np.abs(times[:, None] - times[None, :]) / 7200.0)
        walk = (
            wander
            * np.linalg.cholesky(kernel + 1e-9 * np.eye(times.size))
            @ random.normal(size=times.size)
        )
        measured = drives * true + walk + random.normal(0, 0.3, times.size)
        readings += [
            (at_s + t, dict(zip(NAMES, row, strict=True)))
            for t, row in zip(times.tolist(), temperatures.tolist(), strict=True)
        ]
        states += [
            (at_s + t, {"spindle_rpm": rpm})
            for t, rpm in zip(times.tolist(), speed.tolist(), strict=True)
        ]
        observations = [
            Observation(at_s + times[i], (float(measured[i] - measured[0]),), "EXX", 0.0)
            for i in range(0, times.size, 6)
        ]
        verifications.append(Verification(f"run {run}", observations, Datum.FIRST))
    return Campaign(
        compile_model(machine(), maps(slope), {"EXX": "bed"}),
        maps(slope),
        verifications,
        TemperatureHistory.of_readings(machine().sensors, readings),
        states,
        list(effects),
    )


def from_zero(asked):
    """Root mean square of what is left of each run from its first observation."""
    residuals = residuals_of(asked)
    left = residuals.values
    for which in np.unique(residuals.rows.verification):
        own = residuals.rows.verification == which
        left[own] -= left[own][0]
    return float(np.sqrt(np.mean(left**2)))


@pytest.fixture(scope="module")
def answer():
    return analyse(campaign(1, drives=1.0), kinds=["response"])


def test_a_response_is_found_and_said_as_what_it_is(answer):
    (found,) = answer.effects
    assert (found.kind, found.components, found.status) == ("response", ("EXX",), "confirmed")
    assert set(found.sensors) == set(NAMES)
    assert found.states == ("spindle_rpm",)
    assert found.after_rms < 0.5 * found.before_rms
    assert found.helps
    assert "EXX responds to 5 sensors and states together" in found.explanation
    assert "12 set-ups, each held out in turn" in found.explanation
    assert answer.verdict != "nothing-found"


def test_its_causes_are_said_with_what_they_amount_to(answer):
    """Room and speed drive; the spindle's sensor stands in for the speed."""
    (found,) = answer.effects
    sentences = [c.sentence for c in found.causes]
    (temperatures,) = (one for one in sentences if "temperatures" in one)
    assert "µm (root mean square)" in temperatures
    assert [c.names for c in found.causes if c.names] == [("spindle_rpm",)]
    assert any("not needed" in one for one in sentences)


def test_adopted_it_helps_on_days_that_nobody_has_seen(answer):
    later = campaign(2, runs=6, drives=1.0, first_day=40)
    effects = [found.effect for found in answer.effects]
    assert from_zero(replace(later, effects=effects)) < 0.5 * from_zero(later)


def test_adopted_it_is_not_offered_again_before_something_new_is_measured(answer):
    effects = [found.effect for found in answer.effects]
    assert not find_responses(campaign(1, drives=1.0, effects=effects)).offered


def test_what_is_found_beside_an_adopted_response_is_not_confirmed(answer):
    """Its residuals are of set-ups that it was learnt from: nothing of them is held out."""
    effects = [found.effect for found in answer.effects]
    again = analyse(campaign(1, drives=1.0, effects=effects))
    assert all(found.status != "confirmed" and not found.helps for found in again.effects)


@pytest.mark.slow
def test_with_new_days_it_is_learnt_anew_and_takes_the_place_of_the_old(answer):
    old = [found.effect for found in answer.effects]
    more = campaign(1, runs=14, drives=1.0, effects=old)
    (offered,) = find_responses(more).offered
    assert offered.effect.parameters["set_ups"] == 14
    assert without_replaced(old, [offered.effect]) == []
    assert offered.judged.before_rms == pytest.approx(from_zero(replace(more, effects=[])), rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("wander", [0.0, 3.0])
def test_where_nothing_drives_nothing_is_found(wander):
    for seed in range(10, 12):
        assert not find_responses(campaign(seed, wander=wander)).offered


@pytest.mark.slow
def test_one_odd_run_hardly_changes_what_is_corrected_in_others():
    """One run in which the instrument crept away by 60 µm: it counts less, and is foretold none."""
    asked = campaign(6, drives=1.0)
    odd = asked.verifications[4]
    moved = [
        replace(o, measured=(o.measured[0] + 60.0 * i / len(odd.observations),))
        for i, o in enumerate(odd.observations)
    ]
    strange = [*asked.verifications[:4], replace(odd, observations=moved), *asked.verifications[5:]]
    plain, strained = (
        judge(response_rows(residuals_of(one), "EXX"))
        for one in (asked, replace(asked, verifications=strange))
    )
    assert strained.fitted.response.weights[4] < 0.4
    assert not strained.why_not
    others = [i for i in range(12) if i != 4]
    after = [rms(np.concatenate([one.after[i] for i in others])) for one in (plain, strained)]
    before = rms(np.concatenate([plain.before[i] for i in others]))
    assert after[0] < 0.4 * before
    assert after[1] < 0.6 * before


@pytest.mark.slow
def test_maps_that_harm_are_not_what_is_fallen_back_on():
    """Maps of −10 µm/K over the bed, which the machine does not follow at all."""
    rows = response_rows(residuals_of(campaign(4, drives=1.0, slope=-10.0)), "EXX")
    judged = judge(rows)
    assert not judged.why_not
    raw, by_maps, after = judged.each
    assert (by_maps > raw).sum() >= 3
    assert (after < 1.1 * raw + 1.0).all()


@pytest.mark.slow
def test_what_is_judged_of_maps_is_what_a_live_table_makes_of_them():
    asked = campaign(4, drives=1.0, slope=-10.0)
    rows = response_rows(residuals_of(asked), "EXX")
    judged = judge(rows)
    driver = rows.driver(judged.fitted)
    conditions = residuals_of(asked).projection.conditions
    live = dict(zip(conditions.times_s.tolist(), driver.at(conditions).tolist(), strict=True))
    by_maps = [c.form for c in rows.columns].index(MAPS)
    for one in rows.set_ups:
        began_s = np.full(len(one.times_s), one.began_s)
        told = driver.expected_of(one.found, began_s)
        # A record begins when something first moves, which its first row does not know yet.
        np.testing.assert_allclose(told.corrected, [live[t] for t in one.times_s], atol=1e-3)
        learnt = judged.fitted.predict(one.found.values, one.began_s)
        np.testing.assert_allclose(told.mean, learnt.mean, atol=1e-4)
        said = one.measured - one.values
        maps = one.found.values[:, by_maps]
        np.testing.assert_allclose(maps - maps[0], said - said[0], atol=1e-3)


def test_where_the_policy_allows_no_maps_they_are_held(monkeypatch):
    """Asked a hundred kelvins beyond them, where the machine extrapolates 30 K."""
    monkeypatch.setattr(response_rows_module, "BEYOND", 10.0)
    rows = response_rows(residuals_of(campaign(4, drives=1.0, slope=-10.0)), "EXX")
    temperatures_c, errors = np.array(rows.zero.maps).T
    assert np.isfinite(errors).all()
    assert len(errors) < response_rows_module.MAP_STEPS
    assert temperatures_c.min() > 15.0 - 31.0


def test_runs_that_one_verification_states_as_set_ups_are_as_many_courses():
    """A shop may store a whole campaign at once, with a name for each set-up."""
    asked = campaign(5, runs=8, drives=1.0)
    stated = [
        replace(one, setup=run.label) for run in asked.verifications for one in run.observations
    ]
    together = replace(asked, verifications=[Verification("spring", stated, Datum.FIRST)])
    each, whole = (response_rows(residuals_of(one), "EXX") for one in (asked, together))
    assert [one.label for one in whole.set_ups] == [f"spring, run {i}" for i in range(8)]
    assert whole.columns == each.columns
    for a, b in zip(each.set_ups, whole.set_ups, strict=True):
        assert b.is_zeroed
        np.testing.assert_array_equal(a.course.values, b.course.values)
        np.testing.assert_array_equal(a.course.columns, b.course.columns)


def test_one_set_up_far_worse_than_foretold_is_reason_enough():
    """The others gain by half; one goes from 2 to 9 µm where an error of 3 µm was foretold."""
    sizes = [*([10.0] * 11), 2.0]
    set_ups = [SimpleNamespace(is_zeroed=True, label=f"run {i}") for i in range(12)]
    before = [np.array([size, -size]) for size in sizes]
    rows = SimpleNamespace(set_ups=set_ups)

    def judged(last, raw=before, foretold=3.0):
        after = [*(one / 2.0 for one in before[:-1]), np.array([last, -last])]
        return Judged(rows, None, raw, before, after, np.full(12, foretold))

    assert judged(7.9).why_not == ""
    assert "'run 11' would be left with 9" in judged(9.0).why_not
    assert "go from 9.59 to" in judged(9.0).why_not
    assert judged(9.0, foretold=3.6).why_not == ""
    # Worse than without any correction, although better than by the maps.
    raw = [*(one / 10.0 for one in before[:-1]), before[-1]]
    assert "no correction 1," in judged(2.0, raw, foretold=1.0).why_not


def test_what_is_not_adopted_says_what_set_ups_would_be_left_with():
    (said,) = find_responses(campaign(12, wander=3.0)).not_testable
    assert said.reason.startswith("held-out set-ups would go from ")
    assert "gain" in said.reason or "chance" in said.reason


class Named(NamedTuple):
    """What the search has named, as far as it matters here."""

    key: str
    status: Status = Status.SUSPECTED
    channels: tuple[int, ...] = (0, 1)


@pytest.mark.parametrize(
    ("status", "unexplained", "left", "expected"),
    [
        (Status.SUSPECTED, [], {"EXX": 9.0, "EZZ": 9.0}, ["EXX", "EZZ"]),
        (Status.CONFIRMED, [], {"EXX": 9.0, "EZZ": 9.0}, []),
        (Status.CONFIRMED, [1], {"EXX": 9.0, "EZZ": 9.0}, ["EXX", "EZZ"]),
        (Status.SUSPECTED, [], {"EXX": 9.0, "EZZ": 3.0}, []),
        (Status.SUSPECTED, [], {"EXX": None, "EZZ": None}, ["EXX", "EZZ"]),  # none is adopted
    ],
)
def test_what_acts_on_two_components_goes_only_if_both_have_a_better_response(
    status, unexplained, left, expected
):
    """Clocks apart show in X and Z; each has a response that leaves 5 µm."""
    clocks = SimpleNamespace(kind="clock-offset", components=("EXX", "EZZ"))
    other = SimpleNamespace(kind="additional-sensor", components=("EXX",))
    found = SimpleNamespace(
        hypotheses={"clocks": clocks, "other": other},
        findings=SimpleNamespace(terms=[Named("clocks", status), Named("other")]),
        is_unexplained_at=lambda channels: bool({*channels} & {*unexplained}),
    )
    offered = [
        SimpleNamespace(code=code, judged=SimpleNamespace(after_rms=5.0)) for code in ("EXX", "EZZ")
    ]
    assert [one.code for one in that_leave_less(found, offered, left)] == expected


def test_a_state_that_only_observations_state_is_said_to_take_no_part():
    """How long it has held is not known of it, and a live table would never be told it."""
    asked = campaign(3, runs=8, drives=1.0)
    speeds = dict(asked.state_readings)
    verifications = [
        replace(
            run, observations=[replace(o, state=speeds[float(o.time_s)]) for o in run.observations]
        )
        for run in asked.verifications
    ]
    beside = replace(asked, verifications=verifications, state_readings=())
    both = replace(asked, verifications=verifications)
    assert unrecorded_states(residuals_of(beside).projection.conditions) == ["spindle_rpm"]
    assert unrecorded_states(residuals_of(both).projection.conditions) == []
    said = {one.on: one.reason for one in find_responses(beside).not_testable}
    assert "takes no part" in said["spindle_rpm"]


def test_few_set_ups_are_said():
    found = find_responses(campaign(3, runs=5, drives=1.0))
    assert not found.offered
    assert "needs at least 6 set-ups" in found.not_testable[0].reason


def test_a_component_of_which_no_observation_can_be_used_is_said():
    one = campaign(3, runs=8)
    early = Observation(START_S - 30 * DAY_S, (1.0,), "EYY", 0.0)
    lone = Verification("before the record", [early], Datum.FIRST)
    found = find_responses(replace(one, verifications=[*one.verifications, lone]))
    assert {"EYY": "none of its observations can be used"}.items() <= {
        refused.on: refused.reason for refused in found.not_testable
    }.items()
