"""From a campaign to an answer: found, nothing, what is left out, what stops it."""

import json
import pickle
from dataclasses import replace
from datetime import datetime
from functools import cache

import numpy as np
import pytest

from app.effects.effect import effect_from_json
from app.effects.flexible import HYSTERESIS
from app.errors import InvalidContent
from app.identification.analysis.analyse import analyse
from app.identification.campaign import residuals_of
from app.search.rows import Datum
from app.simulation.undeclared import make_campaign
from app.storage.analysis_results import RESULTS
from app.thermal.temperature_history import TemperatureHistory
from scripts.campaign_of_bodies import campaign_of_bodies

FEW_KINDS = ("backlash", "drift", "outdated-map", "thermal-lag")


@cache
def campaign_with(planted=None, amplitude=3.0, seed=5, **conditions):
    made = make_campaign(seed, planted, amplitude, **{"visits": 20, "days": 4, **conditions})
    return made, campaign_of_bodies(
        made.machine, made.error_maps, made.readings, made.verifications
    )


def answer_of(campaign, kinds=FEW_KINDS, **how):
    found = json.loads(RESULTS.text(analyse(campaign, kinds=kinds, **how)))
    json.dumps(found, allow_nan=False)
    return found


@pytest.fixture(scope="module")
def with_lag():
    made, campaign = campaign_with("thermal-lag:sensor")
    return made, campaign, answer_of(campaign, kinds=None)


@pytest.mark.slow
def test_an_effect_is_found_named_and_measured(with_lag):
    made, _, found = with_lag
    (effect,) = found["effects"]
    (true,) = made.truth.effects
    assert found["verdict"] == "effects-found"
    assert (effect["helps"], effect["why_not"]) == (True, None)
    assert found["after"]["zero"] == "absolute"
    assert effect["kind"] == "thermal-lag"
    assert set(effect["components"]) == set(true["components"])
    assert effect["sensors"] == true["sensors"]
    tau = true["parameters"]["time_constant_min"]
    error = effect["standard_errors"]["time_constant_min"]
    assert abs(effect["parameters"]["time_constant_min"] - tau) < 4 * error
    assert effect["status"] == "confirmed"
    assert not effect["is_proxy"]
    assert effect["evidence"]["p_global"] < 1e-6
    assert 0.7 < effect["evidence"]["calibration_slope"] < 1.3


@pytest.mark.slow
def test_before_and_after_stand_beside_the_noise(with_lag):
    _, _, found = with_lag
    before, after = found["before"], found["after"]
    assert after["holdout_rms_um"] < 0.75 * before["holdout_rms_um"]
    low, high = after["holdout_rms_ci95_um"]
    assert low < after["holdout_rms_um"] < high
    # Repeats of 25 degrees of freedom know the floor to 14 %.
    assert found["floor_um"] < after["holdout_rms_um"] < 1.35 * found["floor_um"]
    assert found["after_with_maps_refitted"]["holdout_rms_um"] < after["holdout_rms_um"]
    (effect,) = found["effects"]
    assert effect["after_rms_um"] < 0.7 * effect["before_rms_um"]
    assert {c["component"] for c in found["components"]} >= {"EXX", "points x", "SXY"}
    assert "follow" in found["summary"]
    assert found["what_next"]


@pytest.mark.slow
def test_plots_can_be_drawn_without_the_data(with_lag):
    _, _, found = with_lag
    (curve,) = found["plots"]["effects"]
    n = len(curve["driver"])
    assert 50 < n <= 400
    assert all(len(curve[k]) == n for k in ("before", "after", "explained", "components"))
    assert np.std(curve["after"]) < 0.85 * np.std(curve["before"])
    assert np.corrcoef(curve["before"], curve["explained"])[0, 1] > 0.6
    visits = {v["component"]: v for v in found["plots"]["visits"]}
    assert len(visits["points x"]["time_s"]) == 20


@pytest.mark.slow
def test_what_is_adopted_explains_the_residuals(with_lag):
    made, campaign, found = with_lag
    effects = [effect_from_json(e["effect"]) for e in found["effects"]]
    without = residuals_of(campaign)
    adopted = residuals_of(replace(campaign, effects=effects))
    removed = without.values - adopted.values
    true = made.truth.contribution_um[without.kept]
    assert np.sqrt(np.mean((removed - true) ** 2)) < 0.3 * np.sqrt(np.mean(true**2))


@pytest.mark.slow
def test_a_drift_says_where_it_was_learnt_and_until_when_it_may_be_used():
    """It goes on for two thirds as long again; what it may then be wrong by reaches a deviation."""
    _, campaign = campaign_with("drift")
    found = answer_of(campaign, kinds=["drift"])
    (effect,) = found["effects"]
    valid, code = effect["valid"], effect["components"][0]
    first, last, until = (
        datetime.fromisoformat(valid[name]).timestamp() for name in ("from", "to", "use_until")
    )
    rows = residuals_of(campaign).rows
    assert rows.times_s.min() <= first < last <= rows.times_s.max()
    assert last - first > 0.8 * np.ptp(rows.times_s)
    goes_on = effect_from_json(effect["effect"]).valid.grows_until_s
    assert goes_on - last == pytest.approx(2.0 / 3.0 * (last - first))
    days, continued = (until - goes_on) / 86400.0, (goes_on - last) / 86400.0
    own = [c for c in found["components"] if c["component"] == code]
    slopes = [abs(v) for v in effect["parameters"].values()]
    errors = list(effect["standard_errors"].values())
    if own:  # no faster than all of it at once, no slower than its larger part for sure
        scatter = own[0]["noise"]
        left = scatter - 2 * sum(errors) * continued
        assert 0.5 * left / (sum(slopes) + 2 * sum(errors)) < days
        assert days < 2.0 * scatter / max(slopes)
    else:
        assert days > 0.0
    assert code in effect["measure_again"]
    assert f"{effect['measure_again']}." in found["what_next"]
    assert effect_from_json(effect["effect"]).valid.use_until_s == until


@pytest.mark.slow
def test_a_lag_knows_the_temperatures_and_how_far_behind_they_were(with_lag):
    _, campaign, found = with_lag
    (effect,) = found["effects"]
    (sensor,) = effect["sensors"]
    low, high = effect["valid"]["temperatures_c"][sensor]
    seen = campaign.readings.temperatures_c[sensor]
    assert np.nanmin(seen) - 0.1 <= low < high <= np.nanmax(seen) + 0.1
    (behind,) = effect["valid"]["made_of"].items()
    assert behind[0].endswith(f"late minus {sensor} [K]")
    assert low - high < behind[1][0] < 0.0 < behind[1][1] < high - low
    assert effect["valid"]["use_until"] is None
    assert effect["measure_again"] is None


@pytest.mark.slow
def test_without_an_effect_nothing_is_found_and_it_tells_how_far_it_is():
    _, campaign = campaign_with()
    told = []
    found = answer_of(campaign, progress=lambda share, _words: told.append(share))
    assert told == sorted(told)
    assert (told[0], told[-1]) == (0.0, 1.0)
    assert found["verdict"] == "nothing-found"
    assert found["effects"] == []
    assert found["unexplained"] == []
    assert found["detectable"]
    assert all(one["smallest_rms"] > 0 for one in found["detectable"])
    assert "Nothing was found" in found["summary"]


@pytest.mark.slow
def test_the_same_campaign_gives_the_same_answer_in_another_process_too():
    _, campaign = campaign_with("backlash:constant")
    sent = pickle.loads(pickle.dumps(campaign))
    assert answer_of(campaign, ["backlash"]) == answer_of(sent, ["backlash"])


@pytest.mark.slow
def test_what_is_left_out_is_counted():
    _, campaign = campaign_with()
    first = campaign.verifications[0]
    early = [replace(o, time_s=o.time_s - 30 * 86400.0) for o in first.observations[:4]]
    twice = list(first.observations[:1])
    changed = replace(first, observations=[*first.observations, *twice, *early])
    campaign = replace(campaign, verifications=[changed, *campaign.verifications[1:]])
    answer = answer_of(campaign, kinds=["backlash"])
    excluded = {e["reason"]: e["count"] for e in answer["excluded"]}
    assert excluded["before the first reading"] >= 4
    assert excluded["an exact copy of another observation"] >= 1


@pytest.mark.slow
def test_a_verification_in_another_unit_is_refused():
    _, campaign = campaign_with()
    in_mm = [
        replace(
            v,
            observations=[
                replace(o, measured=tuple(m / 1000.0 for m in o.measured)) for o in v.observations
            ],
        )
        for v in campaign.verifications
    ]
    with pytest.raises(InvalidContent, match="were they meant in mm"):
        analyse(replace(campaign, verifications=in_mm))


@pytest.mark.slow
def test_an_unknown_kind_is_refused():
    _, campaign = campaign_with()
    with pytest.raises(InvalidContent, match="thermal-lag"):
        analyse(campaign, kinds=["wear"])


@pytest.mark.slow
def test_few_visits_are_no_error():
    _, campaign = campaign_with("backlash:constant")
    found = answer_of(replace(campaign, verifications=campaign.verifications[:5]))
    reasons = {n["reason"] for n in found["not_testable"]}
    assert "needs 8 visits or moments of long ones, got 5" in reasons
    one = answer_of(replace(campaign, verifications=campaign.verifications[:1]))
    assert one["before"]["holdout_rms_um"] is None


@pytest.mark.slow
def test_an_unknown_zero_hides_what_changes_from_visit_to_visit():
    _, campaign = campaign_with("backlash:constant", datum="free")
    assert all(v.datum is Datum.FREE for v in campaign.verifications)
    found = answer_of(campaign)
    assert found["before"]["zero"] == "removed"
    assert {one["zero"] for one in found["components"]} == {"removed"}
    assert [e["kind"] for e in found["effects"]] == ["backlash"]
    assert found["after"]["holdout_rms_um"] < 1.4


# Faults that the readings themselves show.


@pytest.mark.slow
@pytest.mark.parametrize("variant", ["stuck", "spikes"])
def test_a_faulty_sensor_is_named(variant):
    made, campaign = campaign_with(f"sensor-fault:{variant}", 2.0, seed=3, days=8)
    found = answer_of(campaign)
    (effect,) = found["effects"]
    (true,) = made.truth.effects
    assert (effect["kind"], effect["variant"]) == ("sensor-fault", variant)
    assert effect["sensors"] == true["sensors"]
    assert effect["sensors"][0] in effect["evidence"]["seen_in_readings"]
    assert found["verdict"] == "effects-found"
    if variant == "stuck":
        # What a stand-in predicts meanwhile says nothing of the model.
        assert [one["reason"] for one in found["excluded"]] == ["frozen"]
    if variant == "spikes":
        assert effect["after_rms_um"] < effect["before_rms_um"]
        share = true["parameters"]["share_of_readings"]
        assert effect["parameters"]["share"] == pytest.approx(share, rel=0.25)


@pytest.mark.slow
def test_heating_that_begins_is_no_spike():
    _, campaign = campaign_with()
    times = campaign.readings.times_s
    heating = 20.0 + 2.0 * np.minimum(np.abs((times / 3600.0) % 4.0 - 2.0), 1.0)
    changed = {**campaign.readings.temperatures_c, "spindle": np.round(heating, 2)}
    campaign = replace(campaign, readings=TemperatureHistory(times, changed))
    assert answer_of(campaign, kinds=["backlash"])["effects"] == []


# What the figures are in.


def only(campaign, components, **changes):
    """Keep some components' observations, and change each verification."""
    verifications = [
        replace(v, observations=[o for o in v.observations if o.component in components], **changes)
        for v in campaign.verifications
    ]
    kept = [v for v in verifications if v.observations]
    return replace(campaign, verifications=kept)


@pytest.mark.slow
def test_angles_alone_are_told_in_their_unit():
    _, campaign = campaign_with("backlash:constant", seed=7)
    found = answer_of(only(campaign, ("EAX", "EBX", "ECX")), kinds=["backlash"])
    assert found["unit"] == "µrad"
    assert "µrad (root mean square)" in found["summary"]
    assert "µm" not in found["summary"]
    assert "among the kinds looked for (backlash)" in found["summary"]


@pytest.mark.slow
def test_what_would_have_been_seen_does_not_hang_on_what_was_declared():
    """The same data, called twice as scattered or half: the fitted scatter decides.

    Half is denied by what was measured twice, so that the scatter is learnt, and less sure.
    """
    _, campaign = campaign_with(seed=8)
    told = {}
    for declared in (0.5, 2.0):
        stated = [replace(v, repeatability_um=declared) for v in campaign.verifications]
        found = answer_of(replace(campaign, verifications=stated), kinds=["backlash"])
        told[declared] = np.mean([one["smallest_rms"] for one in found["detectable"]])
    assert told[0.5] == pytest.approx(told[2.0], rel=0.5)


@pytest.mark.slow
def test_an_unknown_zero_is_no_part_of_what_is_left():
    """Hysteresis is in no family; the instrument's zeros lie 100 µm apart."""
    _, campaign = campaign_with("chirped-pitch", amplitude=6.0, seed=9)
    moved = []
    for i, v in enumerate(campaign.verifications):
        far = [
            replace(o, measured=tuple(m + 100.0 * (-1) ** i for m in o.measured))
            for o in v.observations
        ]
        moved.append(replace(v, observations=far, datum=Datum.FREE))
    found = answer_of(replace(campaign, verifications=moved), kinds=["backlash"])
    assert found["verdict"] == "unexplained"
    assert all(one["rms_um"] < 20.0 for one in found["unexplained"])


@pytest.mark.slow
def test_a_late_difference_that_imitates_a_hysteresis_is_not_sure():
    """Held-out visits show the late difference as well: it would be confirmed and wrong."""
    made = make_campaign(53, "hysteresis", 2.0, visits=15, days=4, observations_per_visit=40)
    found = answer_of(
        campaign_of_bodies(made.machine, made.error_maps, made.readings, made.verifications),
        kinds=["sensor-gradient"],
    )
    (effect,) = found["effects"]
    assert effect["status"] == "suspected"
    assert HYSTERESIS in effect["doubts"]
    assert found["verdict"] == "unexplained", found["summary"]


@pytest.mark.slow
def test_a_lag_is_no_hysteresis():
    """Both are behind their temperature; a lag by how fast it moves, not by where it turned."""
    made = make_campaign(
        820, "thermal-lag:component", 2.0, visits=24, days=7, observations_per_visit=40
    )
    found = answer_of(
        campaign_of_bodies(made.machine, made.error_maps, made.readings, made.verifications)
    )
    (effect,) = found["effects"]
    assert (effect["kind"], effect["status"], effect["doubts"]) == ("thermal-lag", "confirmed", [])
    assert found["verdict"] == "effects-found"


@pytest.mark.slow
@pytest.mark.parametrize("twin", ["", "the same readings"])
def test_what_a_twin_would_explain_as_well_is_not_confirmed_and_helps_all_the_same(twin):
    """Held-out visits show both: they cannot say which of the two sensors it is."""
    made = make_campaign(5, "additional-sensor", 3.0, visits=20, days=4)
    (true,) = made.truth.effects
    (sensor,) = true["sensors"]
    machine, maps, readings = made.machine, made.error_maps, made.readings
    if twin:
        own = next(one for one in machine["sensors"] if one["name"] == sensor)
        machine = machine | {"sensors": [*machine["sensors"], own | {"name": twin}]}
        maps, readings = (
            [
                one
                | {"temperatures_c": one["temperatures_c"] | {twin: one["temperatures_c"][sensor]}}
                for one in each
            ]
            for each in (maps, readings)
        )
    campaign = campaign_of_bodies(machine, maps, readings, made.verifications)
    effect = analyse(campaign, kinds=["additional-sensor"]).effects[0]
    known = {name for one in (effect, *effect.ties) for name in one.sensors}
    assert effect.status == ("suspected" if twin else "confirmed")
    assert {sensor, twin} - {""} <= known
    assert effect.helps
