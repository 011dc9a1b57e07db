"""A fleet: a given effect tried on sisters, and what analyses say together."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from app.effects.effect import Effect
from app.effects.registry import KINDS
from app.identification.analysis.tried_effect import (
    LEAST_SHARE,
    MISTAKEN,
    TriedEffect,
    _judged,
    _TrialRows,
    try_effect,
)
from app.identification.fleet import Member, Trial, judge_fleet, trials
from app.pages.fleet_report import fleet_report
from app.storage.analysis_results import RESULTS
from tests.pages.example_analyses import FOUND, NOTHING

ALIKE = ("XYFZ", (("x", 0.0, 500.0),), ("bed", "x-middle"))
OTHER = ("YFXZ", (("x", 0.0, 500.0),), ("bed", "x-middle"))


def example(body, **changed):
    return replace(RESULTS.read_text(json.dumps(body)), **changed)


WITH_LAG = example(FOUND)
WITHOUT = example(NOTHING)
LAG = next(i for i, e in enumerate(WITH_LAG.effects) if e.helps)
"""Its place among the effects that were found."""


def member(name, result, likeness=ALIKE, **more):
    named = {"watch": "within", "has_verifications": True, "analysis": 7} | more
    return Member(name, name, likeness, result=result, **named)


FLEET = [
    member("one", WITH_LAG),
    member("two", WITH_LAG, analysis=9, watch="beyond"),
    member("three", WITHOUT),
    member("four", None, why_not="analysis 7 failed: <b>too few</b>"),
    member("unmeasured", None, has_verifications=False, why_not="nothing was measured"),
    member("gantry", WITHOUT, OTHER),
]


def tried(verdict):
    return TriedEffect(verdict, "because", 12, "µm", 3.0, 1.0, (1.5, 2.5), 0.9, (0.7, 1.1))


def test_what_helps_is_tried_on_sisters_that_did_not_find_it_and_were_measured():
    wanted = [t for t in trials(FLEET) if t.effect == LAG]
    assert {t.on for t in wanted} == {"three", "four"}
    assert {(t.machine, t.analysis) for t in wanted} == {("one", 7)}


def test_one_machines_own_history_and_what_does_not_help_are_tried_on_nobody():
    one = WITH_LAG.effects[LAG]
    drift = replace(one, effect=replace(one.effect, kind="drift"))
    useless = replace(one, helps=False)
    for found in (drift, useless):
        fleet = [member("one", replace(WITH_LAG, effects=(found,))), *FLEET[2:]]
        assert trials(fleet) == []


def test_no_mistake_and_nothing_that_comes_with_time_is_of_a_type_of_machines():
    of_the_type = [kind for kind in KINDS.values() if kind.of_the_type]
    assert len(of_the_type) > 5
    assert not any(kind.trending or kind.not_adopted for kind in of_the_type)


def test_what_is_said_is_no_more_than_was_found_and_tried():
    results = {
        Trial("one", 7, LAG, "three"): tried("no"),
        Trial("one", 7, LAG, "four"): tried("yes"),
    }
    judgement = judge_fleet(FLEET, results)
    shared = next(e for e in judgement.effects if e.kind == WITH_LAG.effects[LAG].kind)
    assert shared.summary == "found on 2 of 5, tried on 2 of the other 3: no on 1, yes on 1"
    assert shared.not_tried_on == {"unmeasured": "nothing was measured there"}
    assert [f.machine for f in shared.found_on] == ["one", "two"]
    assert judgement.tried_together == 2
    by_id = {m.machine: m for m in judgement.machines}
    assert by_id["gantry"].sisters == ()
    assert set(by_id["one"].sisters) == {"two", "three", "four", "unmeasured"}
    assert judgement.machines[0].machine == "two"
    assert "exceed the limits" in judgement.machines[0].drifts
    assert by_id["three"].drifts is None


def test_a_machine_without_sisters_is_said_to_have_none():
    judgement = judge_fleet([member("alone", WITH_LAG)], {})
    assert {e.summary for e in judgement.effects} == {"found on 1, which has no sisters"}


def test_the_page_has_every_answer_and_escapes_what_came():
    results = {
        Trial("one", 7, LAG, "three"): tried("no"),
        Trial("one", 7, LAG, "four"): tried("cannot-be-told"),
    }
    page = fleet_report(judge_fleet(FLEET, results))
    assert page == fleet_report(judge_fleet(FLEET, results))
    assert "found on 2 of 5, tried on 2 of the other 3" in page.replace("Found", "found")
    assert "+2.00 µm (+1.50 to +2.50)" in page
    assert "0.90 (0.70 to 1.10)" in page
    assert "cannot be told" in page
    assert "&lt;b&gt;too few" in page
    assert "<b>too few" not in page
    assert "Nothing was found on any machine" in fleet_report(judge_fleet(FLEET[2:4], {}))


SETUPS, EACH = 12, 30


def observations(share, seed, *, scatter=0.3, setups=SETUPS):
    """Residuals that hold a share of what is predicted, with noise and set-ups that differ."""
    random = np.random.default_rng(seed)
    visit = np.repeat(np.arange(setups), EACH)
    predicted = random.normal(0.0, 2.0, setups)[visit] + random.normal(0.0, 0.5, visit.size)
    noise = random.normal(0.0, 0.5, visit.size) + random.normal(0.0, scatter, setups)[visit]
    return share * predicted + noise, predicted, visit


def judged(residuals, predicted, visit, tried_together=1):
    units = np.full(visit.size, "µm")
    shown = _TrialRows(residuals, predicted, visit, units)
    return _judged(shown, np.zeros(visit.size, dtype=int), tried_together)


@pytest.mark.parametrize("variant", ["at once", "late"])
def test_what_a_model_has_in_another_form_is_not_tried_on_it(variant):
    """The residuals are what it leaves: they would seem to speak against the effect."""
    given = Effect("additional-sensor", ("EXX",), ("bed",), variant="late")
    campaign = SimpleNamespace(effects=(replace(given, variant=variant),))
    assert try_effect(campaign, given).verdict == "adopted"


def test_shares_of_a_given_effect_are_told_apart():
    assert judged(*observations(1.0, 1), 1).verdict == "yes"
    assert judged(*observations(0.0, 2), 1).verdict == "no"
    lost = judged(*observations(1.0, 3, scatter=20.0), 1)
    assert lost.verdict == "cannot-be-told"
    assert lost.share_interval[0] < 0.0 < LEAST_SHARE < lost.share_interval[1]
    few = judged(*observations(1.0, 4, setups=7), 1)
    assert (few.verdict, few.share_interval) == ("cannot-be-told", None)


def test_the_figures_are_those_of_the_residuals():
    residuals, predicted, visit = observations(0.8, 5)
    found = judged(residuals, predicted, visit)
    assert found.before_rms == pytest.approx(np.sqrt(np.mean(residuals**2)))
    assert found.after_rms == pytest.approx(np.sqrt(np.mean((residuals - predicted) ** 2)))
    assert found.gain_ci95[0] < found.gain < found.gain_ci95[1]
    assert found.setups == SETUPS


def test_the_more_are_tried_together_the_wider_the_interval():
    one, many = (judged(*observations(1.0, 6), n).share_interval for n in (1, 20))
    assert many[0] < one[0] < one[1] < many[1]


@pytest.mark.parametrize("together", [1, 10])
def test_who_does_not_have_it_is_hardly_ever_said_to_have_it(together):
    count = 400
    wrong = sum(
        judged(*observations(0.0, 1000 + i, scatter=1.5), together).verdict == "yes"
        for i in range(count)
    )
    # The chance of one trial is MISTAKEN / 2 / together; three standard deviations are allowed.
    expected = count * MISTAKEN / 2.0 / together
    assert wrong <= expected + 3.0 * np.sqrt(expected) + 1.0


def test_an_angle_that_shows_it_is_not_lost_among_lengths_that_do_not():
    random = np.random.default_rng(8)
    residuals, predicted, visit = observations(1.0, 7)
    noise = random.normal(0.0, 50.0, visit.size)
    shown = _TrialRows(
        np.concatenate([residuals, noise]),
        np.concatenate([predicted, 0.01 * predicted]),
        np.concatenate([visit, visit]),
        np.repeat(["µrad", "µm"], visit.size),
    )
    found = _judged(shown, np.repeat([0, 1], visit.size), 1)
    assert (found.verdict, found.unit) == ("yes", "µrad")
    assert found.before_rms == pytest.approx(np.sqrt(np.mean(residuals**2)))
