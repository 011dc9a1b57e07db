"""The report of an analysis: complete, honest, with no text that acts, and figures that draw."""

import ast
import copy
import json
import re
import subprocess
import sys
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import pytest
from plotly.graph_objects import Figure

import app
from app import __version__
from app.errors import InvalidContent
from app.identification.analysis.analyse import VERDICTS as GIVEN
from app.pages.analysis_report import analysis_report
from app.pages.report_parts.effect_names import MARKS, STATUSES, TESTS, VERDICTS
from app.search import findings
from app.search.findings import Status
from app.storage.analysis_results import RESULTS
from tests.pages.example_analyses import (
    ALL,
    BACKLASH,
    BACKLASH_CURVE,
    EXCHANGED,
    FOUND,
    HEAD,
    LAG,
    LAG_CURVE,
    MOVED,
    NOTHING,
    UNEXPLAINED,
    component,
    visits,
)
from tests.pages.page_reader import Reader

ADDRESS = "/docs-assets/plotly.min.js"
EVIL = "</title></script><script>alert('1')</script><img src=x onerror=alert(2)> & \"Mill\""


def read(result, head=HEAD, **options):
    return Reader(written(result, head, **options))


def written(result, head=HEAD, **options):
    """The page of a result as it is stored."""
    return analysis_report(
        head, RESULTS.read_text(json.dumps(result)), **{"plotly_js": ADDRESS} | options
    )


@pytest.mark.parametrize("name", ALL)
def test_every_page_is_whole_html_with_its_figures(name):
    found = read(ALL[name])
    assert found.open == []
    places = [attrs["id"] for _, attrs in found.elements if attrs.get("class") == "plot"]
    assert sorted(places) == sorted(found.figures)
    assert len(set(found.attributes("id"))) == len(found.attributes("id"))
    for attrs in (attrs for _, attrs in found.elements if attrs.get("class") == "plot"):
        assert attrs["role"] == "img"
        assert len(attrs["aria-label"]) > 20
    for figure in found.figures.values():
        # plotly refuses what it does not know.
        Figure(figure)


def test_a_page_with_its_own_plotly_asks_nobody():
    found = read(FOUND, plotly_js="inline")
    assert found.attributes("src") == []
    assert found.attributes("href") == []


def test_a_page_is_small_beside_plotly_and_always_the_same():
    page = written(UNEXPLAINED)
    assert page == written(UNEXPLAINED)
    assert len(page) < 60_000


def test_another_address_is_refused():
    with pytest.raises(InvalidContent, match="plotly_js"):
        written(NOTHING, plotly_js="javascript:alert(1)")


def test_the_top_says_whose_it_is_and_the_answer():
    told = read(FOUND, replace(HEAD, adopted_version=4)).told
    for words in (
        "MCFV5050LN",
        "mcfv5050 (XYFZ)",
        "version 3",
        "night shift, week 9",
        "480 values of 6 visits",
        "2026-03-14 17:05 UTC, seed 0",
        "as model version 4",
        "✓ Effects found",
        FOUND["summary"],
    ):
        assert words in told
    assert "before 2.36 µm RMS on held-out visits, 95 % interval 2.08 to 2.54 µm" in told
    assert "noise floor 0.63 µm" in told
    assert "chance below 0.01 %" in told


def test_the_top_is_that_of_a_certificate():
    named = {"serial_number": "5050-1274", "instruments": ["XL-80"], "operators": ["M. Weber"]}
    measured = tuple(datetime(2026, 3, day, 6, tzinfo=UTC) for day in (1, 7))
    head = replace(HEAD, analysis_id=3, measured=measured, **named)
    told = read(FOUND | {"temperatures_c": {"spindle": [20.06, 31.24]}}, head, back="/loop").told
    for words in (
        "serial number 5050-1274",
        "instrument XL-80",
        "operator M. Weber",
        "measured 2026-03-01 06:00 UTC to 2026-03-07 06:00 UTC",
        "temperatures spindle 20.1 to 31.2 °C",
        f"thermap {__version__}",
        "Measured by Checked by Date",
        "← Loop",
    ):
        assert words in told
    assert "serial number not stated instrument not stated operator not stated" in read(FOUND).told


def test_the_top_says_which_effects_were_there_and_which_came():
    had = "EYY follows bed 20 ± 3 min late"
    told = read(FOUND, replace(HEAD, had=[had])).told
    assert f"version 3, with 1 adopted effect: {had}" in told
    assert "adopted nothing of this analysis" in told
    told = read(FOUND, replace(HEAD, adopted_version=4, adopted=[LAG["explanation"]])).told
    assert f"as model version 4: {LAG['explanation']}" in told
    told = read(NOTHING | {"visits": 1, "values": 1}).told
    assert "observations 1 value of 1 visit " in told
    assert "1 value of 1 visit took part" in told


def test_where_nothing_was_found_the_page_says_what_that_is_worth():
    told = read(NOTHING).told
    assert "– Nothing found" in told
    assert "chance 34 %" in told
    assert "What the model lacks" not in told
    assert "after" not in told.split("Residuals by component")[1].split("EZZ")[0]
    smallest = told.index("The smallest effects that would have been seen")
    assert smallest < told.index("Residuals by component") < told.index("Over time")
    assert "thermal lag 0.21 to 0.30 0.40" in told
    assert "No structure that stands out of the noise is left" in told
    assert "Nothing was left out" in told


def test_reasons_that_several_kinds_share_stand_once():
    told = read(NOTHING).told
    assert "drift, step EBX needs 8 visits, got 6" in told
    assert "angular – the maps already have every rotation" in told


def test_components_stand_by_unit_with_their_figures():
    told = read(UNEXPLAINED).told
    table = told.split("Before and after")[1].split("What the model lacks")[0]
    order = [table.index(word) for word in ("[µm]", "EZZ", "points, Y", "[µrad]", "[µm/m]", "SXY")]
    assert order == sorted(order)
    assert "largest before largest after" in table
    assert "EZZ D_z(z) 4.10 0.64 14.35 1.92 0.63 0.61 (declared) ±1.28 240" in table
    assert "SXY S_xy 7.40† 0.80†" in table
    assert "† All visits, because nothing could be held out" in table
    assert "95 % within, after" in table
    assert "declared: what the verifications state" in table
    assert "replicates: " not in table
    assert "replicates: from repeats at the same place" in read(NOTHING).told
    # Nothing stands for a floor that is not known.
    assert "EBX A_y(x) 1.20 1.20 4.20 3.60 unknown" in table


def test_each_unit_is_a_table_whose_head_repeats_it():
    page = written(UNEXPLAINED)
    assert page.count("[µm]</th></tr></thead>") == 1
    assert page.count("[µm/m]</th></tr></thead>") == 1


def test_one_value_is_not_drawn_as_if_it_were_perfect():
    one = NOTHING | {"components": [component("SXY", 0.0, 0.0, "µm/m", count=1)]}
    assert "±0.00 1 one value" in read(one).told


def test_an_effect_is_told_with_its_figures():
    told = read(FOUND).told
    for words in (
        "EZZ follows z-column 41 ± 2 min late",
        "✓ confirmed on held-out visits",
        "4.10 → 0.64 µm RMS",
        "show 0.98 ± 0.08 of what it predicts (1 is right, 0 is nothing); found again in 100 %",
        "time constant 41 ± 2 min",
        "share of what the tables say that follows late: 1 for all of it, 0 for none 1.01 ± 0.03",
        "Late minus present: what the sensor read some time ago, less what it reads now.",
        "thermal lag: EZZ with z-column – this effect 209",
        "sensor gradient: EZZ with spindle, bed – tied 208",
        "other sensor: EZZ with spindle – behind by 160 50",
        "Further behind: 1 more.",
        "cannot tell it from sensor gradient: EZZ with spindle, bed (evidence 208 against 209)",
        "To separate the two, heat spindle without z-column.",
    ):
        assert words in told


def test_warnings_and_what_is_not_confirmed_are_told_in_words():
    told = read(UNEXPLAINED).told
    for words in (
        "? Something unexplained",
        "? suspected: held-out visits, an unexplained remainder or a tie leave its name open",
        "≈ proxy",
        "Something unexplained remains beside it",
        "71% of the evidence stands on two visits ('a' and 'b').",
        "say nothing about it",
        "changed at 2026-03-04 00:00 UTC",
        "step −7.3 ± 0.3 µm/m",
        "SXY changed by −7.3",
        "– not confirmable: the held-out visits cannot show it",
        "reversal, rise from mid-travel to the end 0.4 ± 0.2 µm",
        "EYZ 1.40 µm 0.60 µm the rate of z-column it varies smoothly with something that was "
        "recorded; held-out",
        "frozen 112",
        "outlier 3",
    ):
        assert words in told


def test_a_mistake_is_to_be_put_right_and_nothing_is_said_of_adopting_it():
    told = read(FOUND | {"effects": [EXCHANGED, LAG], "plots": NOTHING["plots"]}).told
    mistake, lag = told.split("0. x-middle and bed")[1].split("1. EZZ follows")
    assert "It is never adopted; correct it at its source: it is a mistake" in mistake
    assert "Swap the plugs of x-middle and bed" in mistake
    for absent in ("by default", "learnt in", "°C"):
        assert absent not in mistake
    assert "is adopted by default" in lag


def test_what_does_not_help_is_adopted_only_by_its_number():
    told = read(UNEXPLAINED).told
    assert "It is not adopted by default, only if you name it: SXY would get worse in 'a'" in told


def test_a_fault_that_the_readings_show_has_no_figures_and_no_rivals():
    found = read(UNEXPLAINED)
    told = found.told.split("3. x-middle is stuck")[1].split("What to measure")[0]
    assert "✓ seen in the readings themselves" in told
    assert "in the readings it stood still for 9 h" in told
    for absent in ("held-out", "by chance", "2 ln B", "None"):
        assert absent not in told
    assert not [name for name in found.figures if name.startswith("effect-4")]


def test_residuals_are_drawn_over_the_driver_before_and_after_on_one_scale():
    figures = read(FOUND).figures
    before, after = figures["effect-1-before"], figures["effect-1-after"]
    rings, says = before["data"]
    (filled,) = after["data"]
    assert rings["x"] == filled["x"] == says["x"] == LAG_CURVE["driver"]
    assert (rings["y"], says["y"]) == (LAG_CURVE["before"], LAG_CURVE["explained"])
    assert filled["y"] == LAG_CURVE["after"]
    assert before["layout"] == after["layout"]
    low, high = before["layout"]["yaxis"]["range"]
    assert low == -high
    assert high >= max(map(abs, LAG_CURVE["before"]))
    assert before["layout"]["xaxis"]["title"]["text"] == "z-column, late minus present [K]"
    assert before["layout"]["yaxis"]["title"]["text"] == "residual [µm]"
    # Not by colour alone.
    assert rings["marker"]["symbol"] != filled["marker"]["symbol"] != says["marker"]["symbol"]


def test_time_is_drawn_as_dates_and_directions_as_triangles():
    found = read(UNEXPLAINED)
    step = found.figures["effect-2-after"]
    assert step["layout"]["xaxis"]["type"] == "date"
    assert step["layout"]["xaxis"]["title"]["text"] == "time [UTC]"
    assert step["data"][0]["x"][0] == "2026-03-01 00:00:00"
    (filled,) = found.figures["effect-3-after"]["data"]
    assert filled["marker"]["symbol"] == [
        "triangle-up",
        "triangle-down",
        "triangle-up",
        "circle",
    ]
    assert "Triangles point the way of approach" in found.told


def test_visits_of_found_effects_are_drawn_first_then_what_stands_out():
    found = read(FOUND)
    titles = re.findall(r"UTC\. (.*?) What remains", found.told)[0]
    assert titles.split() == ["EZZ", "EBX"]
    band, rings, filled = found.figures["visits-1"]["data"]
    assert (len(rings["y"]), len(filled["y"]), len(band["x"])) == (6, 6, 12)
    # Two standard deviations of a mean of 40: set-ups scatter by 0.63² − 0.61², and the maps are
    # known to 0.1. Older results say the first by their floor, and do not say the second.
    scatter = 0.61**2 / 40 + 0.63**2 - 0.61**2
    assert max(band["y"]) == pytest.approx(2 * (scatter + 0.1**2) ** 0.5, abs=1e-5)
    older = json.loads(json.dumps(FOUND)) | {"shape": 2}
    for curve in older["plots"]["visits"]:
        del curve["expected"]
    assert max(read(older).figures["visits-1"]["data"][0]["y"]) == pytest.approx(
        2 * scatter**0.5, abs=1e-5
    )
    assert len(read(NOTHING).figures["visits-1"]["data"]) == 2


def test_directions_of_a_reversal_are_drawn_apart_over_time():
    curve = visits("EXX", [1.0, -1.0] * 3, [0.1, -0.1] * 3) | {"direction": [1.0, -1.0] * 3}
    result = UNEXPLAINED | {
        "components": [component("EXX", 1.0, 0.1)],
        "effects": [BACKLASH],
        "plots": {"effects": [BACKLASH_CURVE], "visits": [curve]},
    }
    found = read(result)
    _, before, after = found.figures["visits-1"]["data"]
    assert before["marker"]["symbol"][:2] == ["triangle-up-open", "triangle-down-open"]
    assert after["marker"]["symbol"][:2] == ["triangle-up", "triangle-down"]
    assert "Triangles point the way of approach, where an error reverses" in found.told


def test_nothing_to_draw_is_no_figure():
    bare = copy.deepcopy(FOUND)
    for name in ("driver", "before", "after", "explained", "components", "direction"):
        bare["plots"]["effects"][0][name] = []
    bare["plots"]["visits"] = []
    bare["detectable"] = []
    bare["not_testable"] = []
    found = read(bare)
    assert found.figures == {}
    for heading in ("Over time", "What could not be tested", "The smallest effects"):
        assert heading not in found.told


@pytest.mark.slow
def test_texts_of_users_are_shown_and_do_not_act():
    evil = copy.deepcopy(UNEXPLAINED)
    evil["summary"] = evil["what_next"][0] = EVIL
    for effect in evil["effects"]:
        effect |= {"explanation": EVIL, "leverage_warning": EVIL}
        effect["effect"] |= {"sensors": [EVIL], "states": [EVIL], "variant": EVIL}
        effect["effect"]["parameters"] = {EVIL: 1.0}
    evil["effects"][0]["alternatives"][0] |= {"sensors": [EVIL], "separating_measurement": EVIL}
    evil["excluded"][0]["reason"] = evil["unexplained"][0]["leads"][0] = EVIL
    evil["unexplained"][0]["component"] = evil["components"][0]["component"] = EVIL
    evil["plots"]["effects"][0] |= {"over": EVIL, "over_unit": EVIL, "components": [EVIL] * 4}
    evil["plots"]["visits"][0]["component"] = EVIL
    evil["not_testable"][0] |= {"on": EVIL, "reason": EVIL}
    evil["detectable"][0]["component"] = EVIL
    head = replace(HEAD, machine_name=EVIL, machine_id=EVIL, chain=EVIL, verifications=[EVIL])
    found, plain = read(evil, head), read(UNEXPLAINED)
    names = [tag for tag, _ in found.elements]
    assert names.count("script") == [tag for tag, _ in plain.elements].count("script")
    assert "img" not in names
    assert EVIL in found.told
    # plotly reads some markup in texts of its figures.
    assert "<img" not in json.dumps(found.figures)


def test_few_visits_and_no_lengths_have_a_page_too():
    few = NOTHING | {
        "noise_um": None,
        "floor_um": None,
        "before": figures_without_hold_out(),
        "after": figures_without_hold_out(),
        "components": [],
        "plots": {"effects": [], "visits": []},
    }
    found = read(few)
    assert "RMS of all visits; none held out" in found.told
    assert "noise floor unknown" in found.told


def test_one_held_out_visit_has_no_interval():
    of_one = figures_without_hold_out() | {"holdout_rms_um": 1.3}
    found = read(NOTHING | {"before": of_one, "after": of_one})
    assert "RMS of what was held out, of one visit alone" in found.told
    assert "95 % interval" not in found.told


def figures_without_hold_out():
    return {"rms_um": 1.2, "p95_um": 2.0, "holdout_rms_um": None, "holdout_rms_ci95_um": None}


@pytest.mark.slow
def test_plotly_is_imported_only_for_its_javascript():
    program = (
        "import json, sys; from app.pages.analysis_report import analysis_report; "
        "from app.storage.analysis_results import RESULTS; "
        "from tests.pages.example_analyses import FOUND, HEAD; "
        "result = RESULTS.read_text(json.dumps(FOUND)); "
        "analysis_report(HEAD, result, plotly_js='/p.js'); sys.exit('plotly' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0


def names_of_tests():
    """Read off the source which tests the search says something of."""
    for path in Path(app.__file__).parent.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.Call) and ast.unparse(node.func) == "Unexplained":
                test = node.args[0]
                is_named = isinstance(test, ast.Name)
                yield getattr(findings, test.id) if is_named else ast.literal_eval(test)


@pytest.mark.slow
def test_every_test_of_the_search_has_words():
    names = set(names_of_tests())
    assert len(names) >= 6
    assert names == set(TESTS)


def test_every_verdict_and_every_status_has_words_and_a_mark():
    assert set(VERDICTS) == {*GIVEN.values(), "not-judged"}
    assert set(STATUSES) == set(Status)
    assert set(MARKS) == set(VERDICTS) | set(STATUSES)


def test_what_becomes_of_effects_that_the_model_had_is_told():
    assert "backlash of EXX is dropped" in written(FOUND)
    assert "What the model had already" not in written(NOTHING)


def test_another_sensor_is_said_before_the_figures_on_the_present_one():
    page = written(MOVED)
    at = page.index("EZZ with column-rear instead of z-column: 7.6 → 5.1 µm on held-out set-ups")
    assert at < page.index("Before and after</h2>")
    assert "what is said of EXZ" in page
    assert "Which sensor each component follows" not in written(FOUND)


def test_the_finding_and_its_picture_come_before_all_else():
    told = read(FOUND).told
    found = told.index("What the model lacks")
    assert found < told.index("Before this effect") < told.index("parameter")
    assert found < told.index("What to measure or check next") < told.index("Before and after")


def test_a_page_without_a_chart_does_not_carry_what_draws_one():
    plots = {"effects": [], "visits": []}
    page = analysis_report(HEAD, RESULTS.read_text(json.dumps(NOTHING | {"plots": plots})))
    assert len(page) < 200_000
    assert page.count("<script") == 3


def test_values_that_were_left_out_are_named_with_place_and_size():
    page = written(UNEXPLAINED)
    section = page[page.index("Left out</h2>") :].partition("</section>")[0]
    assert "250 mm" in section
    assert "−31.2 µm" in section
    assert "250, 100, 300 mm" in section
