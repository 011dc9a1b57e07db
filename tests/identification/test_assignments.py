"""Another sensor is proposed where one was planted wrong, and nowhere else."""

from dataclasses import replace
from functools import cache

import pytest

from app.api.schemas.campaigns import campaign_of_bodies
from app.effects.effect import effect_from_json
from app.identification.analysis.analysis import TriedAssignment
from app.identification.analysis.assignments import judge_assignments, said_first
from app.identification.campaign import residuals_of
from app.simulation.undeclared import make_campaign
from app.storage.analysis_results import RESULTS
from app.thermal.compile_model import compile_model
from tests.pages.example_analyses import FOUND, stored_effect


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
    found = judge_assignments(campaign, residuals_of(campaign))
    return {one.component: one for one in found}


def proposals(campaign):
    return {code: one.proposed_sensor for code, one in judged(campaign).items() if not one.why_not}


@pytest.mark.slow
@pytest.mark.parametrize("datum", ["absolute", "first", "free"])
def test_a_wrong_assignment_is_found_and_the_right_one_proposed(datum):
    campaign = assigned(campaign_of(datum=datum), EXX="bed")
    found = judged(campaign)
    one = found["EXX"]
    assert next(iter(found)) == "EXX"  # said first
    assert (one.present_sensor, one.proposed_sensor) == ("bed", "x-middle")
    assert one.after_rms < 0.5 * one.before_rms
    assert one.setups == 16
    assert one.p_global <= 0.01
    assert one.unit == "µm"
    assert one.sentence.startswith("EXX with x-middle instead of bed would leave ")
    assert [code for code, other in found.items() if other.proposed_sensor] == ["EXX"]


@pytest.mark.slow
def test_what_another_sensor_leaves_is_what_its_tables_would_leave():
    """Every set-up chooses x-middle: the figure is that of a model that is so assigned."""
    campaign = campaign_of()
    one = judged(assigned(campaign, EXX="bed"))["EXX"]
    right, wrong = (residuals_of(c) for c in (campaign, assigned(campaign, EXX="bed")))
    for residuals, figure in ((right, one.after_rms), (wrong, one.before_rms)):
        own = residuals.values[residuals.rows.of_channel("EXX")]
        assert (own**2).mean() ** 0.5 == pytest.approx(figure, rel=1e-9)


@pytest.mark.slow
def test_all_components_of_a_sensor_may_be_wrong():
    campaign = assigned(campaign_of(), EXX="bed", EYY="bed")
    assert proposals(campaign) == {"EXX": "x-middle", "EYY": "x-middle"}


@pytest.mark.parametrize(
    "planted",
    [None, "thermal-lag:sensor", "thermal-lag:component", "additional-sensor", "sensor-gradient"],
)
def test_where_the_assignment_is_right_none_is_proposed(planted):
    assert proposals(campaign_of(planted)) == {}


def test_one_value_in_each_set_up_with_its_own_zero_tells_nothing():
    campaign = campaign_of(datum="free")
    cut = []
    for one in campaign.verifications:
        others = [o for o in one.observations if o.component and o.component != "EYY"]
        alone = replace(others[0], component="EYY", position_mm=200.0)
        cut.append(replace(one, observations=[*others, alone]))
    found = judged(replace(campaign, verifications=cut))
    assert found["EYY"].why_not == (
        "each set-up has one value of it and a zero of its own: no two can be compared"
    )


def test_one_value_in_each_set_up_leaves_the_figures_to_points():
    campaign = campaign_of(datum="free")
    cut = []
    for one in campaign.verifications:
        others = [o for o in one.observations if o.component != "EYY"]
        alone = replace(next(o for o in others if o.component), component="EYY", position_mm=200.0)
        cut.append(replace(one, observations=[*others, alone]))
    found = judged(replace(campaign, verifications=cut))["EYY"]
    assert found.at_points
    assert found.before_rms > 0.1
    assert "0 instead of 0" not in found.sentence


def test_few_set_ups_say_why_nothing_is_judged():
    found = judged(assigned(campaign_of(visits=6), EXX="bed"))
    assert found["EXX"].why_not == "needs at least 8 set-ups in which it shows, got 6"
    assert all(one.after_rms is None and one.other_sensor is None for one in found.values())


def test_a_component_with_effects_of_its_own_is_not_judged():
    effect = effect_from_json(
        stored_effect("step", ["EXX"], {"changed_at_unix_s": 0.0, "step_um": 1.0}, {})
    )
    campaign = replace(assigned(campaign_of(), EXX="bed"), effects=[effect])
    assert "learnt with bed" in judged(campaign)["EXX"].why_not


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
    campaign = replace(campaign, maps=maps, model=model)
    one = judged(campaign)["EXX"]
    assert one.other_sensor != "x-middle"
    assert "x-middle" not in one.as_good


def tried(component, sensor, why_not=None):
    sizes = (7.6, 5.1, "w", 3.1, 3.3, 0.001)
    words = f"{component} over {sensor}"
    return TriedAssignment(component, "TC06", sensor, (), "µm", False, 28, *sizes, why_not, words)


def test_a_proposal_is_said_before_effects_which_may_serve_until_then():
    """They end with the assignment (`tests/effects/test_carry_over.py`)."""
    answer = RESULTS.read(FOUND)
    (lag,) = answer.effects
    assert lag.helps
    first = said_first(answer, [tried("EZZ", "TC07"), tried("EXX", "TC01", "by chance")], "vmc")
    assert first.summary == f"EZZ over TC07. {answer.summary}"
    assert "`thermap sensors assign EZZ=TC07 --machine vmc`" in first.what_next[0]
    assert first.what_next[1:] == answer.what_next
    assert first.effects == answer.effects
    assert [one.component for one in first.proposals] == ["EZZ"]
    assert RESULTS.read_text(RESULTS.text(first)).assignments == first.assignments


def test_without_a_proposal_nothing_else_changes():
    answer = RESULTS.read(FOUND)
    said = said_first(answer, [tried("EZZ", "TC07", "by chance")], "vmc")
    assert (said.summary, said.effects, said.what_next) == (
        *(answer.summary, answer.effects),
        answer.what_next,
    )
