"""Which adopted effects the next model version keeps, and what they then say."""

from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest

from app.effects.adopted.carry_over import Change, carry_over
from app.effects.adopted.live_effects import corrected_tables
from app.effects.adopted.live_lags import LiveLags
from app.effects.conditions import Conditions
from app.effects.driver import Curvature
from app.effects.kinds.drift import Drift
from app.effects.low_pass import LagState
from app.effects.past import needed_past
from app.effects.registry import KINDS, explain
from app.geometry.components import COMPONENTS
from app.thermal.compile_model import compile_model
from app.thermal.error_map import ComponentTable, ErrorMap
from tests.effects.example_campaign_view import ASSIGNMENT, POSITIONS, START_S, machine, maps
from tests.effects.test_effects_all_kinds import EACH, fitted

BEFORE = compile_model(machine(), maps(), ASSIGNMENT)
OUTDATED = [each for each in EACH if each.startswith("outdated-map")]
LATER = datetime(2026, 4, 1, tzinfo=UTC)


def new_map(*codes, t=27.0, measured_at=LATER, backward=False, **temperatures):
    along = np.array(POSITIONS)
    both = along / 100.0 if backward else None
    tables = {
        code: ComponentTable.make(
            COMPONENTS[code],
            *((along / 100.0, along, both) if COMPONENTS[code].is_table else ([1.0], ())),
        )
        for code in codes
    }
    read = {"x-middle": t, "y-front": t - 1.0, "z-column": t + 2.0, "spindle": 2.0 * t - 10.0}
    return ErrorMap("Run #9", measured_at, read | temperatures, tables)


def change(*new_maps, assignment=ASSIGNMENT, without=()):
    together = [*(m for m in maps() if m.label not in without), *new_maps]
    return Change(BEFORE, compile_model(machine(), together, assignment), together, list(new_maps))


def test_a_map_of_another_component_leaves_every_effect_as_it_is():
    for each in EACH:
        kept, notes = carry_over([fitted(each)], change(new_map("EXY")))
        assert (kept, notes) == ([fitted(each)], [])


@pytest.mark.parametrize("each", EACH)
def test_what_is_kept_can_be_evaluated_and_told(each):
    """With a new map of everything: kept and true to the new maps, or left out and said."""
    effect = fitted(each)
    changed = change(new_map(*BEFORE_CODES))
    kept, notes = carry_over([effect], changed)
    assert len(kept) + len(notes) >= 1
    moment = Conditions.of_moment(START_S + 86400.0 * 9, _temperatures(26.0), {"spindle_rpm": 1.0})
    for one in kept:
        assert explain(one) == explain(replace(effect, components=one.components))
        reasons = [m.reason for m in corrected_tables(changed.after, [one], moment).missing]
        assert not [r for r in reasons if "history" not in r]


BEFORE_CODES = [code for group in BEFORE.groups for code in group.codes]


def _temperatures(t):
    return {"x-middle": t, "y-front": t - 1.0, "z-column": t + 2.0, "spindle": 2.0 * t - 10.0}


@pytest.mark.parametrize(
    "each", ["outdated-map|shift", "outdated-map|profile", "drift|since the maps"]
)
def test_what_a_new_map_has_measured_along_is_left_out(each):
    effect = fitted(each)
    (code,) = effect.components
    kept, notes = carry_over([effect], change(new_map(code)))
    assert kept == []
    assert notes == [f"{effect.kind} of {code} left out: it was measured again in map 'Run #9'"]


@pytest.mark.parametrize("along", [True, False])
def test_a_new_kind_says_of_itself_whether_a_new_map_contains_it(monkeypatch, along):
    monkeypatch.setitem(KINDS, "creeping", type("Creeping", (Drift,), {"measured_along": along})())
    effect = replace(fitted("drift|since the maps"), kind="creeping")
    kept, _ = carry_over([effect], change(new_map(*effect.components)))
    assert kept == ([] if along else [effect])


def test_a_step_is_left_out_if_the_map_is_from_after_it():
    step = fitted("step|")
    (code,) = step.components
    at = datetime.fromtimestamp(step.parameters["changed_at_unix_s"], UTC)
    assert carry_over([step], change(new_map(code, measured_at=at)))[0] == []
    earlier = new_map(code, measured_at=at.replace(year=2025))
    assert carry_over([step], change(earlier))[0] == [step]


def test_a_reversal_is_left_out_if_the_map_has_both_directions():
    effect = fitted("backlash|constant")
    (code,) = effect.components
    assert carry_over([effect], change(new_map(code)))[0] == [effect]
    assert carry_over([effect], change(new_map(code, backward=True)))[0] == []


def test_a_fingerprint_loses_the_component_that_follows_another_sensor():
    lag = fitted("thermal-lag|")
    many = replace(
        lag,
        components=("EXX", "EYX"),
        sensors=("x-middle",),
        terms=tuple(replace(lag.terms[0], component=code) for code in ("EXX", "EYX")),
    )
    kept, notes = carry_over([many], change(assignment=ASSIGNMENT | {"EXX": "spindle"}))
    assert [e.components for e in kept] == [("EYX",)]
    assert [t.component for t in kept[0].terms] == ["EYX"]
    assert notes == ["thermal-lag of EXX left out: EXX follows spindle now"]


@pytest.mark.parametrize(
    "each", ["backlash|constant", "outdated-map|shift", "drift|since the maps", "step|"]
)
def test_what_no_sensor_drives_stays_whatever_a_component_follows(each):
    effect = fitted(each)
    assignment = ASSIGNMENT | dict.fromkeys(effect.components, "spindle")
    assert carry_over([effect], change(assignment=assignment)) == ([effect], [])


def test_a_rotation_goes_when_two_maps_have_it():
    """One map alone cannot be interpolated: until then the effect is all there is."""
    roll = fitted("angular|constant")
    (code,) = roll.components
    first = new_map(code)
    assert carry_over([roll], change(first))[0] == [roll]
    second = replace(new_map(code, t=33.0), label="Run #10")
    kept, notes = carry_over([roll], change(first, second))
    assert (kept, notes) == ([], [f"angular of {code} left out: the maps have {code} now"])


def test_curvature_between_maps_is_zero_in_the_new_map_too():
    effect = fitted("temperature-curvature|between maps")
    (code,) = effect.components
    sensor = BEFORE.find(code)[0].sensor
    changed = change(new_map(code))
    (kept,), notes = carry_over([effect], changed)
    assert notes == []
    there = changed.new_maps[0].temperatures_c[sensor]
    assert isinstance(kept.terms[0].driver, Curvature)
    assert there in kept.terms[0].driver.temperatures_c
    moment = Conditions.of_moment(START_S, {sensor: there})
    (correction,) = corrected_tables(changed.after, [kept], moment).tables
    assert not correction.errors.any()


WRONG = "wrong-map|Run #6: shift"


def test_a_wrong_map_stays_wrong_beside_a_new_one_and_is_zero_there():
    effect = fitted(WRONG)
    (code,), (sensor,) = effect.components, effect.sensors
    changed = change(new_map(code))
    (kept,), notes = carry_over([effect], changed)
    assert notes == []
    there = changed.new_maps[0].temperatures_c[sensor]
    moment = Conditions.of_moment(START_S, {sensor: there})
    (correction,) = corrected_tables(changed.after, [kept], moment).tables
    assert not correction.errors.any()


def test_a_wrong_map_that_was_measured_again_is_no_longer_corrected():
    effect = fitted(WRONG)
    (code,), (sensor,) = effect.components, effect.sensors
    was_c = effect.terms[0].driver.map_c
    gone = carry_over([effect], change(without=("Run #6",)))
    assert gone == (
        [],
        [f"wrong-map of {code} left out: its map is gone, or counts as one state with another map"],
    )
    again = new_map(code, **{sensor: was_c})
    kept, notes = carry_over([effect], change(again, without=("Run #6",)))
    assert kept == []
    assert notes == [f"wrong-map of {code} left out: it was measured again in map 'Run #9'"]


@pytest.mark.parametrize(
    "each",
    [
        "temperature-curvature|over all maps",
        "additional-sensor|since the maps",
        "sensor-gradient|since the maps",
        "additional-sensor|since the maps, late",
    ],
)
def test_what_a_new_map_shows_and_the_effect_cannot_know_is_left_out(each):
    effect = fitted(each)
    kept, notes = carry_over([effect], change(new_map(*effect.components)))
    assert kept == []
    assert all("measured again in map 'Run #9'" in note for note in notes)


def in_balance(effect, temperatures_c):
    """Temperatures at which the machine has stood for long: what is late has caught up."""
    past = needed_past([effect])
    lags = {
        (signal, tau_s): LagState(tau_s, 0.0, START_S, t, t)
        for signal, tau_s in past.lags
        for t in [temperatures_c[signal.name]]
    }
    return Conditions.of_moment(START_S, temperatures_c, lags=LiveLags(lags))


@pytest.mark.parametrize("each", [e for e in EACH if "beyond" in e])
def test_second_sensors_learn_what_they_were_in_the_new_map(each):
    effect = fitted(each)
    (code,) = effect.components
    changed = change(new_map(code, **{"spindle": 61.0, "y-front": 29.0, "z-column": 33.0}))
    (kept,), notes = carry_over([effect], changed)
    assert notes == []
    moment = in_balance(kept, changed.new_maps[0].temperatures_c)
    (correction,) = corrected_tables(changed.after, [kept], moment).tables
    # In the new map's own thermal state the table is right as it is.
    np.testing.assert_allclose(correction.errors, 0.0, atol=1e-12)
    (old,) = corrected_tables(changed.after, [effect], moment).tables
    assert np.abs(old.errors).max() > 0.01


def test_what_is_known_of_the_past_at_older_maps_stays_known():
    effect = fitted("additional-sensor|beyond the maps, late")
    term = effect.terms[0]
    known = tuple((own, there - 1.5) for own, there in term.driver.in_maps_c)
    terms = tuple(replace(t, driver=replace(t.driver, in_maps_c=known)) for t in effect.terms)
    (kept,), _ = carry_over([replace(effect, terms=terms)], change(new_map(*effect.components)))
    driver = kept.terms[0].driver
    assert driver.time_constant_s == term.driver.time_constant_s
    assert set(known) < set(driver.in_maps_c)
    ((_, there),) = set(driver.in_maps_c) - set(known)
    assert there == changed_reading(effect.sensors[0])


def changed_reading(sensor):
    return new_map().temperatures_c[sensor]


def test_a_lag_knows_how_late_older_maps_were_and_takes_a_new_one_as_settled():
    """Also one that has the label of a map that is gone."""
    in_maps_k = (("Run #1", -1.0), ("Run #3", 0.5), ("Run #9", 7.0))
    lag = fitted("thermal-lag|")
    terms = [replace(t, shape=replace(t.shape, in_maps_k=in_maps_k)) for t in lag.terms]
    codes = {t.component for t in terms}
    (found,), notes = carry_over(
        [replace(lag, terms=tuple(terms))], change(new_map(*codes), without=("Run #3",))
    )
    assert notes == []
    assert {t.shape.in_maps_k for t in found.terms} == {(("Run #1", -1.0),)}


def test_another_sensor_reads_the_new_map_too():
    effect = fitted("other-sensor|")
    changed = change(new_map(*effect.components))
    (kept,), _ = carry_over([effect], changed)
    moment = Conditions.of_moment(START_S, _temperatures(26.0))
    assert corrected_tables(changed.after, [effect], moment).missing
    assert not corrected_tables(changed.after, [kept], moment).missing


def test_another_sensor_that_cannot_tell_the_new_map_from_an_old_one_ends_the_exchange():
    effect = fitted("other-sensor|")
    code, (_, other) = effect.components[0], effect.sensors
    same = {other: maps()[-1].temperatures_c[other]}
    kept, notes = carry_over([effect], change(new_map(*effect.components, **same)))
    assert kept == []
    assert notes[0] == (
        f"other-sensor of {code} left out: maps 'Run #9' and 'Run #6' are only 0 °C apart at "
        f"{other}, too close for that sensor to resolve"
    )


@pytest.mark.parametrize("without", [(), ("Run #1", "Run #3"), ("Run #1", "Run #3", "Run #6")])
def test_a_bias_goes_when_all_maps_state_what_the_sensor_wrongly_read(without):
    """And with maps from before and after it, it stays and is said."""
    bias = fitted("sensor-fault|bias")
    codes = bias.components
    first, second = new_map(*codes), replace(new_map(*codes, t=33.0), label="Run #10")
    kept, notes = carry_over([bias], change(first, second, without=without))
    if len(without) == 3:
        told = f"all maps were measured after it, and state what {bias.sensors[0]} read"
        assert kept == []
        assert notes == [f"sensor-fault of {code} left out: {told}" for code in codes]
    else:
        assert kept == [bias]
        assert len(notes) == 1
        assert "only some of their maps were measured after it" in notes[0]
    before = datetime(2026, 2, 2, tzinfo=UTC)
    earlier = [replace(m, measured_at=before) for m in (first, second)]
    assert carry_over([bias], change(*earlier, without=without)) == ([bias], [])


def test_a_map_that_does_not_state_the_other_sensor_ends_what_needs_it():
    effect = fitted("other-sensor|")
    own, _ = effect.sensors
    whole = new_map(*effect.components)
    silent = replace(whole, temperatures_c={own: whole.temperatures_c[own]})
    kept, notes = carry_over([effect], change(silent))
    assert kept == []
    assert all("does not state the temperatures" in note for note in notes)


def test_without_the_component_in_the_maps_an_effect_waits():
    effect = fitted("thermal-lag|")
    changed = change(without=("Run #3", "Run #6"))
    assert carry_over([effect], changed) == ([effect], [])


def test_what_adds_nothing_is_kept():
    stuck = replace(fitted("sensor-fault|bias"), variant="stuck", terms=())
    assert carry_over([stuck], change(new_map(*BEFORE_CODES))) == ([stuck], [])
