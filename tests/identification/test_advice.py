"""What an answer says and advises is as sure as the name of what was found, not more."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from app.identification.analysis.advice import mistakes_first, summary, what_next, what_to_do
from app.identification.analysis.analyse import analyse
from app.identification.analysis.analysis import UnexplainedPart
from app.identification.analysis.far_values import asked_again, left_out_words
from app.identification.analysis.found_effects import PROXY
from app.identification.residuals.residuals import BEYOND_THE_MAPS
from app.pages.report_parts.effect_names import adoption_text
from app.simulation.undeclared import make_campaign
from app.storage.analysis_results import RESULTS
from scripts.campaign_of_bodies import campaign_of_bodies
from tests.pages.example_analyses import EXCHANGED, FOUND, LAG, STEP, rival

SWAP = "wap the plugs of x-middle and bed"


def read(*effects):
    stored = FOUND | {"effects": list(effects), "refitted": []}
    return RESULTS.read_text(json.dumps(stored))


def summed_up(*effects):
    result = read(*effects)
    after, before = result.after, result.before
    return summary("effects-found", result.effects, (), (), before, after, 0.6, "µm", None)


def advised(*effects):
    return what_next(read(*effects).effects, (), visits=30)


def test_a_mistake_that_is_sure_comes_first():
    for effects in ((LAG, EXCHANGED), (EXCHANGED, LAG)):
        first, *others = advised(*effects)
        assert first.startswith(f"S{SWAP}")
        assert not any(SWAP in other for other in others)


def test_nobody_swaps_plugs_on_a_suspicion():
    suspected = EXCHANGED | {"status": "suspected"}
    first, second = advised(suspected)
    assert first.startswith("To confirm the exchanged-sensors effect on EXX, EYX, now suspected: ")
    assert second.startswith(f"If it is confirmed, s{SWAP}")
    (effect,) = read(suspected).effects
    assert f". If it is confirmed, s{SWAP}" in adoption_text(effect)


def test_a_name_that_is_not_sure_says_so_in_the_answers_first_sentence():
    assert summed_up(LAG).startswith("EZZ follows z-column 41 ± 2 min late. The")
    suspected = LAG | {"status": "suspected"}
    assert summed_up(suspected).startswith("EZZ follows z-column 41 ± 2 min late (suspected). The")
    # A proxy says by itself that it stands for something unexplained.
    assert "(suspected)" not in summed_up(STEP)


def test_held_out_figures_are_told_also_where_nothing_is_left():
    result = read(LAG)
    after = replace(result.after, holdout_rms=0.0)
    said = summary("effects-found", result.effects, (), (), result.before, after, 0.6, "µm", None)
    assert " to 0 µm on held-out visits" in said


def test_a_summary_names_what_matters_and_counts_the_rest():
    proxy = LAG | {"is_proxy": True, "status": "suspected", "explanation": "Proxy", "helps": False}
    said = summed_up(*[proxy] * 5, LAG, EXCHANGED)
    assert said.index("are swapped") < said.index("late; Proxy; and 4 more (4 suspected). With")
    assert said.lower().count("proxy") == 1
    assert "more" not in summed_up(LAG, LAG, LAG)


def test_of_several_effects_advice_says_which_it_is_about():
    doubted = LAG | {"doubts": ["they change over time"], "leverage_warning": "two visits carry it"}
    alone, several = advised(doubted), advised(STEP, doubted)
    assert any(one.startswith("The measured values do not quite fit this effect") for one in alone)
    assert any(one.startswith("Two visits carry it") for one in alone)
    assert any(one.startswith("Effect 1: the measured values do not quite") for one in several)
    assert any(one.startswith("Effect 1: two visits carry it") for one in several)


def test_two_of_one_kind_are_told_apart_by_what_they_act_on():
    other = rival("thermal-lag", 208.0, tied=True, sensors=["bed"])
    (step, *_) = advised(LAG | {"alternatives": [other]})
    assert "(this separates thermal-lag of EZZ with z-column from that of EZZ with bed)" in step


def test_a_proxy_that_is_named_second_goes_on_in_the_sentence():
    proxy = LAG | {"is_proxy": True, "explanation": f"{PROXY}EZZ is late"}
    said = summed_up(proxy, proxy)
    assert said.startswith(f"P{PROXY[1:]}EZZ is late; {PROXY}EZZ is late. ")


def test_a_sensor_s_name_keeps_its_letters_at_the_beginning_of_a_sentence():
    stuck = LAG | {"explanation": "z-column was stuck for 5 h"}
    assert summed_up(stuck).startswith("z-column was stuck for 5 h. ")


def test_what_nobody_knows_more_of_is_looked_at_together():
    unknown = [
        UnexplainedPart(code, 2.0, 1.0, "µm", moves_with, ("held-out",))
        for code, moves_with in (("EXX", ()), ("EYY", ("feed",)), ("EZZ", ()))
    ]
    first, second = what_next((), unknown, visits=30)
    assert first.startswith("Look at EYY: it moves with feed. Record")
    assert second.startswith("Look at EXX, EZZ. Record")


@pytest.mark.parametrize(
    ("visits", "is_short", "asks"),
    [(7, False, True), (8, False, False), (8, True, True), (19, True, True), (20, True, False)],
)
def test_more_visits_are_asked_for_while_something_lacks_them(visits, is_short, asks):
    first, *_ = what_next((), (), visits=visits, is_short_of_visits=is_short)
    assert first.startswith("Add visits at other temperatures: ") is asks


def test_values_that_were_left_out_are_named_with_their_size():
    far = read().far_values
    said = left_out_words(far)
    assert "3 values were left out because they lie far from what the others say" in said
    assert "EXX at 250 mm in 'night shift' (-31 µm)" in said
    assert "points z at 250, 100, 300 mm" in said
    (step,) = asked_again(far)
    assert step.startswith("Look at the 3 values that were left out as slips")
    assert left_out_words(()) == ""
    assert asked_again(()) == []
    (step,) = asked_again(far[:1])
    assert step == (
        "Look at the value that was left out as a slip, and measure there again if it matters: "
        "EXX at 250 mm in 'night shift' (-31 µm)."
    )


def test_until_when_it_may_be_used_is_said_of_what_helps():
    until = "It may be used until Friday"
    assert f"{until}." in advised(LAG | {"measure_again": until})
    refused = {"helps": False, "why_not": "a walk would look the same"}
    assert f"{until}." not in advised(LAG | refused | {"measure_again": until})


@pytest.mark.slow
def test_an_answer_says_that_it_is_not_about_most_of_the_values():
    made = make_campaign(7, None, 3.0, visits=10, days=3)
    sensors = [sensor["name"] for sensor in made.machine["sensors"]]
    hot = [
        body | {"temperatures_c": {name: body["temperatures_c"][name] + 30.0 for name in sensors}}
        for body in made.readings
    ]
    begins = made.verifications[6]["observations"][0]["time"]
    readings = [h if b["time"] >= begins else b for b, h in zip(made.readings, hot, strict=True)]
    machine = made.machine | {"out_of_range": "clamp"}
    campaign = campaign_of_bodies(machine, made.error_maps, readings, made.verifications)
    answer = analyse(campaign, kinds=["backlash"])
    out = sum(one.count for one in answer.excluded if one.reason == BEYOND_THE_MAPS)
    count = sum(len(body["observations"]) for body in made.verifications)
    assert out > count // 5
    assert "values took no part (" in answer.summary
    assert BEYOND_THE_MAPS in answer.summary
    assert any(step.startswith("Measure maps at the temperatures of") for step in answer.what_next)
    assert not any(step.startswith("Nothing needs to be done") for step in answer.what_next)


def test_values_that_are_off_by_the_same_send_people_to_what_was_on():
    far = [replace(one, is_alike=True) for one in read().far_values[:1]] * 3
    (step,) = asked_again(far)
    assert step.startswith("Find out what was on when EXX was off by about -31 µm in 3 values")


def test_a_visit_that_was_left_out_is_measured_again():
    far = [replace(read().far_values[0], count=8)]
    assert left_out_words(far).endswith("far from all other visits: EXX in 'night shift'.")
    (step,) = asked_again(far)
    assert step.endswith("left out as a slip; measure it again.")


def test_visits_at_one_hour_of_the_day_are_said_to_tell_nothing_of_others():
    morning_s = 86400.0 * np.arange(12.0) + 34200.0
    (words,) = what_next((), (), visits=30, times_s=morning_s)
    assert "between 09:30 and 09:30 UTC" in words
    (words,) = what_next((), (), visits=30, times_s=morning_s + 9000.0 * np.arange(12.0))
    assert words.startswith("Nothing needs to be done")


def test_what_is_left_far_above_the_scatter_is_no_reason_to_do_nothing():
    """Eight visits of a spindle's growth were “nothing found”, and nothing was to be done."""
    component = SimpleNamespace(component="EZZ", unit="µm", noise=0.67)
    for left, setup_scatter, is_said in ((1.76, 1.4, True), (1.76, 0.3, False), (1.3, 1.4, False)):
        component.shown_rms, component.setup_scatter = (left, left), setup_scatter
        (words,) = what_next((), (), visits=30, components=[component])
        says = "EZZ keeps 1.76 µm where one observation scatters by 0.67 µm"
        assert words.startswith(says if is_said else "Nothing needs to be done")


@pytest.mark.parametrize(
    ("status", "is_proxy", "tied", "is_first"),
    [
        ("suspected", False, "instrument-compensation", True),
        ("suspected", False, "other-sensor", False),
        ("suspected", True, "instrument-compensation", False),
        ("not-confirmable", False, "instrument-compensation", False),
    ],
)
def test_people_are_sent_to_the_instrument_only_where_nothing_else_speaks_against_it(
    status, is_proxy, tied, is_first
):
    effect = SimpleNamespace(
        kind="instrument-compensation",
        status=status,
        is_proxy=is_proxy,
        doubts=(),
        ties=(SimpleNamespace(kind=tied),),
        effect=SimpleNamespace(sensors=("bed",)),
    )
    assert bool(mistakes_first([effect])) is is_first
    assert bool(what_to_do(effect)) is is_first
