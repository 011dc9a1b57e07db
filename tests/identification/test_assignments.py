"""Another sensor is proposed where one was planted wrong, and nowhere else."""

from dataclasses import replace
from functools import cache

import pytest

from app.effects.effect import effect_from_json
from app.identification.analysis.analyse import analyse
from app.identification.analysis.analysis import TriedAssignment
from app.identification.analysis.assignments import said_first
from app.identification.campaign import residuals_of
from app.simulation.undeclared import make_campaign
from app.storage.analysis_results import RESULTS
from app.thermal.compile_model import compile_model
from scripts.campaign_of_bodies import campaign_of_bodies
from tests.pages.example_analyses import FOUND, stored_effect

KINDS = ("other-sensor", "thermal-lag", "additional-sensor", "sensor-gradient")


@cache
def campaign_of(planted=None, seed=1, **conditions):
    made = make_campaign(
        *(seed, planted, 3.0),
        **{"visits": 16, "days": 4, "observations_per_visit": 40} | conditions,
    )
    return campaign_of_bodies(made.machine, made.error_maps, made.readings, made.verifications)


def assigned(campaign, **sensors):
    """The same campaign, some components mapped over other sensors."""
    present = {code: group.sensor for group in campaign.model.groups for code in group.codes}
    machine = campaign.model.machine
    return replace(campaign, model=compile_model(machine, campaign.maps, {**present, **sensors}))


def judged(campaign):
    return {one.component: one for one in analyse(campaign, kinds=KINDS).assignments}


def proposals(campaign):
    return {code: one.proposed_sensor for code, one in judged(campaign).items() if not one.why_not}


@pytest.mark.slow
@pytest.mark.parametrize("datum", ["absolute", "first", "free"])
def test_a_wrong_assignment_is_found_and_the_right_one_proposed(datum):
    """What it leaves is what the model leaves that is so assigned, share and set-ups apart."""
    right = campaign_of(datum=datum)
    found = judged(assigned(right, EXX="bed"))
    one = found["EXX"]
    assert (one.present_sensor, one.proposed_sensor) == ("bed", "x-middle")
    assert one.after_rms < 0.5 * one.before_rms
    assert one.unit == "µm"
    assert one.sentence.startswith("EXX with x-middle instead of bed would leave ")
    assert [code for code, other in found.items() if other.proposed_sensor] == ["EXX"]
    if datum == "absolute":
        residuals = residuals_of(right)
        own = residuals.values[residuals.rows.of_channel("EXX")]
        assert one.after_rms == pytest.approx((own**2).mean() ** 0.5, rel=0.1)


@pytest.mark.slow
def test_all_components_of_a_sensor_may_be_wrong():
    campaign = assigned(campaign_of(), EXX="bed", EYY="bed")
    assert proposals(campaign) == {"EXX": "x-middle", "EYY": "x-middle"}


@pytest.mark.slow
@pytest.mark.parametrize(
    "planted",
    [None, "thermal-lag:sensor", "thermal-lag:component", "additional-sensor", "sensor-gradient"],
)
def test_where_the_assignment_is_right_none_is_proposed(planted):
    assert proposals(campaign_of(planted)) == {}


@pytest.mark.parametrize("how", [{"visits": 6}, {"datum": "free", "visits": 5}])
def test_few_set_ups_propose_nothing(how):
    answer = analyse(assigned(campaign_of(**how), EXX="bed"), kinds=KINDS)
    assert answer.assignments == ()
    assert "other-sensor" in {one.kind for one in answer.not_testable}


@pytest.mark.slow
def test_a_component_with_effects_of_its_own_is_left_where_they_were_learnt():
    effect = effect_from_json(
        stored_effect("step", ["EXX"], {"changed_at_unix_s": 0.0, "step_um": 1.0}, {})
    )
    campaign = replace(assigned(campaign_of(), EXX="bed"), effects=[effect])
    one = judged(campaign)["EXX"]
    assert "learnt with bed" in one.why_not
    assert one.sentence.startswith("EXX stays on bed: EXX with x-middle instead of bed would leave")


@pytest.mark.slow
def test_a_sensor_that_maps_do_not_state_is_not_tried():
    campaign = assigned(campaign_of(), EXX="bed")
    maps = [
        replace(m, temperatures_c={k: v for k, v in m.temperatures_c.items() if k != "x-middle"})
        if number == 0
        else m
        for number, m in enumerate(campaign.maps)
    ]
    wrong = {code: "bed" for group in campaign.model.groups for code in group.codes}
    model = compile_model(campaign.model.machine, maps, wrong)
    for one in judged(replace(campaign, maps=maps, model=model)).values():
        assert one.other_sensor != "x-middle"
        assert "x-middle" not in one.as_good


def tried(component, sensor, why_not=None):
    words = f"{component} over {sensor}"
    return TriedAssignment(component, "TC06", sensor, (), "µm", 7.6, 5.1, why_not, words)


def test_a_proposal_is_said_before_effects_which_may_serve_until_then():
    """They end with the assignment (`tests/effects/test_carry_over.py`)."""
    answer = RESULTS.read(FOUND)
    (lag,) = answer.effects
    assert lag.helps
    both = (tried("EZZ", "TC07"), tried("EXX", "TC01", "by chance"))
    first = said_first(replace(answer, assignments=both), "vmc")
    assert first.summary == f"EZZ over TC07. {answer.summary}"
    assert "`thermap sensors assign EZZ=TC07 --machine vmc`" in first.what_next[0]
    assert first.what_next[1:] == answer.what_next
    assert first.effects == answer.effects
    assert [one.component for one in first.proposals] == ["EZZ"]
    assert RESULTS.read_text(RESULTS.text(first)).assignments == first.assignments


def test_without_a_proposal_nothing_else_changes():
    answer = replace(RESULTS.read(FOUND), assignments=(tried("EZZ", "TC07", "by chance"),))
    assert said_first(answer, "vmc") == answer
