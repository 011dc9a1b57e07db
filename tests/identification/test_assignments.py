"""Another sensor is proposed where one was planted wrong, and nowhere else."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from app.effects.effect import effect_from_json
from app.identification.analysis.analyse import analyse
from app.identification.analysis.analysis import TriedAssignment
from app.identification.analysis.assignments import found_assignments, said_first
from app.identification.campaign import residuals_of
from app.simulation.undeclared import make_campaign
from app.storage.analysis_results import RESULTS
from app.thermal.compile_model import compile_model
from scripts.campaign_of_bodies import campaign_of_bodies
from tests.identification.test_adoption import campaign as rows_of_visits
from tests.identification.test_adoption import stated_search, swinging
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
    """What it leaves is what the model leaves that is so assigned; zeros are anybody's."""
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
        assert one.after_rms == pytest.approx((own**2).mean() ** 0.5, rel=1e-9)


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


def assigned_whole(shown, share, error=0.12, size=2.0, foretold=1.0):
    """Judge an assignment of which set-ups show such a share where another is foretold."""
    rows = rows_of_visits()
    says = swinging(rows, size)
    search = stated_search(shown * says, share * foretold * says, rows=rows)
    search = replace(
        search,
        residuals=SimpleNamespace(rows=rows, projection=None),
        hypotheses={"one": SimpleNamespace(columns=lambda *_: says[:, None])},
    )
    stored = stored_effect("other-sensor", ["EXX"], {"share": share}, {"share": error})
    (lag,) = RESULTS.read(FOUND).effects
    effect = replace(
        lag,
        effect=replace(effect_from_json(stored), sensors=("bed", "x-middle")),
        alternatives=(),
    )
    return found_assignments(search, [effect], [])


def test_an_assignment_says_all_of_what_a_share_was_found_of():
    """What is stated to be left is what the whole leaves: sin² has the mean 1/2."""
    (one,) = assigned_whole(1.35, 1.35, 0.2, size=40.0)
    assert one.proposed_sensor == "x-middle"
    assert one.before_rms == pytest.approx(1.35 * 40.0 * 0.5**0.5, rel=0.1)
    assert one.after_rms == pytest.approx(0.35 * 40.0 * 0.5**0.5, rel=0.1)
    assert one.sentence.endswith("; no set-up would get markedly worse")


def test_no_sensor_is_proposed_where_all_of_it_makes_a_set_up_worse():
    """Of three quarters, which were foretold, none would get worse."""
    of_visit = np.where(rows_of_visits().visit == 1, 0.4, 0.75)
    (one,) = assigned_whole(of_visit, 0.75, size=40.0)
    assert one.after_rms < one.before_rms
    assert one.proposed_sensor is None
    assert one.sentence.startswith("EXX stays on bed: EXX with x-middle instead of bed would leave")
    assert "the residuals of EXX would get worse in 'visit 1'" in one.sentence


def test_no_sensor_is_proposed_that_leaves_no_less():
    (one,) = assigned_whole(0.45, 0.76)
    assert one.after_rms > one.before_rms
    assert one.why_not == "that is no less"


def test_what_no_held_out_set_up_was_foretold_is_not_judged():
    assert assigned_whole(1.0, 1.0, foretold=0.0) == ()


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
