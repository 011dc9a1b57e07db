"""What a plan could see, before anything is measured."""

from dataclasses import replace
from datetime import timedelta

import numpy as np
import pytest
from pydantic import TypeAdapter

from app.effects.driver import Always
from app.effects.effect import Effect
from app.effects.observations import Observation, Verification
from app.effects.shape import Everywhere
from app.effects.term import Term
from app.errors import InvalidContent
from app.identification.campaign import Campaign
from app.identification.plan.added_visits import choose_added_visits
from app.identification.plan.plan import Plan
from app.identification.plan.planning import plan
from app.thermal.temperature_history import TemperatureHistory
from tests.effects.example_campaign_view import START_S, example_view, observations, readings


def campaign_of(verifications, **changes):
    own = example_view()
    history, states = readings()
    return replace(Campaign(own.model, own.maps, verifications, history, states), **changes)


@pytest.fixture(scope="module")
def planned():
    return plan(campaign_of(observations(visits_a_day=2)), 3)


@pytest.mark.slow
def test_every_kind_has_its_smallest_effect(planned):
    kinds = {e.kind for e in planned.effects}
    assert {"backlash", "thermal-lag", "drift", "step", "outdated-map", "angular"} <= kinds
    for effect in planned.effects:
        assert effect.smallest_rms > 0
        told = effect.distinguishable_rms
        assert told is None or told >= effect.smallest_rms * 0.999
    reversal = next(e for e in planned.effects if e.kind == "backlash" and e.components == ("EXX",))
    # Both directions at every position: next to nothing imitates it.
    assert reversal.distinguishable_rms == pytest.approx(reversal.smallest_rms)


def test_collinear_rivals_are_named_with_what_separates_them(planned):
    hard = [e for e in planned.effects if e.rival and e.rival.overlap > 0.9]
    assert hard
    assert all(e.rival.separating_measurement for e in hard)


@pytest.mark.slow
def test_a_sensor_that_reads_in_coarse_steps_lets_less_be_seen(planned):
    """Of what follows it alone: a reversal is as small as before."""
    history, _ = readings()
    read = dict(history.temperatures_c)
    read["x-middle"] = 2.0 * np.round(read["x-middle"] / 2.0)
    coarse = TemperatureHistory(history.times_s, read)
    found = plan(campaign_of(observations(visits_a_day=2), readings=coarse), 3)

    def smallest(of, kind, code):
        own = (e.smallest_rms for e in of.effects if e.kind == kind and e.components == (code,))
        return next(own)

    def ratio(kind, code):
        return smallest(found, kind, code) / smallest(planned, kind, code)

    assert ratio("drift", "EXX") > 1.1
    assert ratio("backlash", "EXX") == pytest.approx(1.0, abs=0.05)
    # The column reads as finely as before.
    assert ratio("drift", "EZZ") == pytest.approx(1.0, abs=0.02)


def test_a_visit_to_add_is_suggested_and_helps(planned):
    for suggestion in planned.suggestions:
        visit = suggestion.visit
        assert visit.decides.startswith("lowers the smallest ")
        assert visit.sentence.endswith(f" It {visit.decides}.")
        assert all(h.after_rms < h.before_rms for h in suggestion.helped)
        assert visit.temperatures_c
        assert (visit.like_time.year, visit.like_time.month) == (2026, 3)
        assert visit.like_time.utcoffset() == timedelta(0)
    assert planned.suggestions


@pytest.mark.parametrize("steady_c", [19.7, 20.1, 21.3])
def test_a_sensor_that_never_changes_decides_nothing(steady_c):
    """Rounding gave the mean of equal readings a spread in one sum, and none in another."""
    history, _ = readings()
    read = {**history.temperatures_c, "spindle": np.full(len(history.times_s), steady_c)}
    steady = TemperatureHistory(history.times_s, read)
    added = choose_added_visits(campaign_of(observations(visits_a_day=2), readings=steady))
    assert added
    assert all("spindle" not in one.leading for one in added)


def test_it_can_be_stored(planned):
    shape = TypeAdapter(Plan)
    assert shape.validate_json(shape.dump_json(planned)) == planned
    assert planned.summary.startswith("8 visits with 392 values would show ")
    assert any("repeatability" in note for note in planned.notes)


@pytest.mark.slow
def test_more_visits_see_smaller_effects(planned):
    more = plan(campaign_of(observations(visits_a_day=4)), 3)
    before = {(e.kind, e.components, e.sensors, e.states): e.smallest_rms for e in planned.effects}
    after = {(e.kind, e.components, e.sensors, e.states): e.smallest_rms for e in more.effects}
    shared = before.keys() & after.keys()
    assert np.median([after[k] / before[k] for k in shared]) < 0.9


@pytest.mark.slow
def test_days_to_come_are_planned_on_recorded_days():
    later = [
        replace(
            v, observations=[replace(o, time_s=o.time_s + 100 * 86400.0) for o in v.observations]
        )
        for v in observations(visits_a_day=2)
    ]
    found = plan(campaign_of(later), 3)
    assert any("lie outside the record" in note for note in found.notes)
    assert found.visits == 8
    assert not found.excluded


@pytest.mark.slow
def test_what_is_yet_to_be_measured_is_not_screened_by_value():
    one = observations(with_points=False)[0]
    weeks = [
        replace(
            one,
            label=f"week {week}",
            is_planned=True,
            observations=[replace(o, time_s=o.time_s + week * 604800.0) for o in one.observations],
        )
        for week in range(20)
    ]
    found = plan(campaign_of(weeks), 3)
    assert (found.visits, found.values) == (20, 20 * len(one.observations))
    assert not found.excluded


def test_an_hour_at_one_place_is_planned_whole():
    readings_of_one_place = [
        Observation(START_S + 86400.0 + 180.0 * i, (0.0,), "EXX", 250.0) for i in range(20)
    ]
    asked = [Verification("warming up", readings_of_one_place, is_planned=True)]
    assert plan(campaign_of(asked), 3).values == 20


def test_without_a_record_there_is_nothing_to_plan_with():
    empty = TemperatureHistory(np.empty(0), {})
    with pytest.raises(InvalidContent, match="record some days first"):
        plan(campaign_of(observations(), readings=empty), 3)


def visits_to_come(hours):
    """One planned file of observations at these hours after the record's first day began."""
    like = observations(with_points=False)[0]
    at = [replace(like.observations[0], time_s=START_S + 3600.0 * h) for h in hours]
    return [replace(like, label="to come", is_planned=True, observations=at)]


def first_hours(hours):
    history, _ = readings()
    kept = history.times_s <= history.times_s[0] + 3600.0 * hours
    return TemperatureHistory(
        history.times_s[kept], {name: t[kept] for name, t in history.temperatures_c.items()}
    )


def test_a_record_that_is_too_short_says_how_long_it_is_and_what_is_needed():
    tomorrow = campaign_of(visits_to_come([36.0, 40.0]), readings=first_hours(6.0))
    with pytest.raises(InvalidContent) as refused:
        plan(tomorrow, 3)
    assert "the record is too short: expected 28 h of readings or more" in str(refused.value)
    assert str(refused.value).endswith("got 6 h")


@pytest.mark.slow
def test_hours_that_the_record_lacks_are_left_out():
    found = plan(campaign_of(visits_to_come([26.0, 40.0]), readings=first_hours(6.0)), 3)
    assert [(one.count, one.reason) for one in found.excluded] == [
        (1, "no reading near enough in time")
    ]
    assert any("the record is too short: expected 38 h" in note for note in found.notes)


@pytest.mark.slow
def test_a_visit_of_days_is_placed_wherever_it_fits():
    """It lasts 2.8 days of a record of 3.9, and begins half a day into one."""
    lasting = visits_to_come([276.0, 343.0])
    found = plan(campaign_of(lasting, readings=first_hours(93.6)), 3)
    assert not found.excluded


def test_where_the_maps_know_nothing_only_the_instrument_can_be_seen():
    """A rotation that points have shown, measured by itself: the maps know nothing of it."""
    roll = Effect("angular", ("EAX",), parameters={"angle_urad": 5.0}, variant="constant")
    roll = replace(roll, terms=(Term("EAX", Always(), Everywhere(), 5.0),))
    visits = [
        Verification(
            f"visit {v}",
            [
                Observation(START_S + 86400.0 * (1 + v) + 120.0 * i, (0.0,), "EAX", 50.0 * i)
                for i in range(8)
            ],
        )
        for v in range(3)
    ]
    found = plan(campaign_of(visits, effects=[roll]), 3)
    assert found.values == 24
    assert [e.kind for e in found.effects] == ["instrument-warm-up"]


@pytest.mark.slow
def test_what_is_not_seen_of_one_map_is_said_of_that_map():
    """Else the same components stand there again and again, beside those that are seen."""
    found = plan(campaign_of(observations()[:1]), 1)
    (subjects,) = (n.on for n in found.not_testable if n.kind == "map-factor")
    assert "SXY of map 'Run #1', SXY of map 'Run #3'" in subjects
