"""The page of the loop as a browser without JavaScript gets it: every state says what to do."""

import json
import re
from datetime import timedelta
from pathlib import Path

import pytest

from app.files.csv_verification import parse_csv_verification
from app.pages.report_parts.words import sentence
from app.storage.analyses import begin_analysis, fail_analysis, finish_analysis, insert_analysis
from app.storage.analysis_results import RESULTS
from app.storage.records import AnalysisTask
from tests.api.test_api_dashboard import EVIL, Texts, shown
from tests.effect_examples import OUTDATED
from tests.pages.example_analyses import ALL, BACKLASH, LAG, NOTHING, VISITS, rival
from tests.service_examples import ROOM, START, iso, problem, reading

pytestmark = pytest.mark.anyio

PAGE = "/machines/mcfv5050/loop"
SHIFT = LAG | {
    "effect": OUTDATED.to_json(),
    "explanation": "EXX is shifted by 3.0 ± 0.1 µm",
    "helps": True,
    "why_not": None,
    "alternatives": [],
}


def asked(app, version=3):
    with app.state.context.database.writing() as session:
        task = AnalysisTask(version, [1], 0.3, None, 0)
        number = insert_analysis(session, "mcfv5050", task, START).id
        assert begin_analysis(session, number, "somebody", START)
    return number


def done(app, result):
    number = asked(app)
    with app.state.context.database.writing() as session:
        text = RESULTS.text(RESULTS.read_text(json.dumps(result)))
        assert finish_analysis(session, number, "somebody", text, START)
    return number


async def check(client, label, time, measured_um):
    answer = await client.post(f"{ROOM}/readings", json=reading(time, 24.0))
    assert answer.status_code == 201, answer.text
    places = [{"component": "EXX", "position_mm": x, "direction": "+"} for x in (100, 300, 500)]
    body = {
        "label": label,
        "observations": [
            {"time": iso(time), "measured_um": um, **place}
            for place, um in zip(places, measured_um, strict=True)
        ],
    }
    answer = await client.post(f"{ROOM}/verifications", json=body)
    assert answer.status_code == 201, answer.text
    return answer.json()["id"]


async def test_before_anything_is_found_it_says_what_to_do_next(client, empty, app):
    page = await shown(client, PAGE)
    assert "No checks yet." in page.text
    assert "Store a check" in page.text
    number = await check(client, EVIL, START - timedelta(hours=2), [7.0, 12.0, 23.0])
    page = await shown(client, PAGE)
    assert "1 check, not analysed yet." in page.text
    assert EVIL in page.text
    assert f"{ROOM}/verifications/{number}/residuals" in page.addresses
    analysis = asked(app)
    page = await shown(client, PAGE)
    assert f"Analysis {analysis}: begins, 0 %." in page.text
    assert "Cancel analysis" in page.text
    with app.state.context.database.writing() as session:
        why = "the service was stopped while it ran"
        assert fail_analysis(session, analysis, "somebody", why, START)
    page = await shown(client, PAGE)
    assert f"Analysis {analysis} failed: the service was stopped while it ran" in page.text
    assert "Nothing was adopted; the table is not affected." in page.text
    problem(await client.get(f"{PAGE}?analysis=99"), 404)
    problem(await empty.get("/machines/another/loop"), 404)


async def test_a_check_that_came_later_is_ticked_and_one_left_out_is_not(client, app):
    """What is started next takes in what is new; what was left out on purpose stays out."""

    async def ticked():
        page = (await client.get(PAGE)).text
        return re.findall(r'aria-label="(\w+)" checked', page)

    app.state.context.now.time = START
    for number, label in enumerate(("analysed", "omitted")):
        await check(client, label, START - timedelta(hours=4 - number), [7.0, 12.0, 23.0])
    assert await ticked() == ["omitted", "analysed"]
    asked(app)
    assert await ticked() == ["analysed"]
    app.state.context.now.time = START + timedelta(hours=1)
    await check(client, "later", START - timedelta(hours=1), [7.0, 12.0, 23.0])
    assert await ticked() == ["later", "analysed"]


async def test_what_cannot_be_compared_is_said_and_no_error(client, app):
    held = await check(client, "held", START - timedelta(hours=2), [7.0, 15.0, 23.0])
    place = {"component": "EXX", "position_mm": 100, "direction": "+", "measured_um": 1.0}
    before = iso(START - timedelta(days=9))
    body = {"label": "early", "observations": [{"time": before, **place}]}
    early = (await client.post(f"{ROOM}/verifications", json=body)).json()["id"]
    assert "3.00" in (await shown(client, f"{PAGE}/residuals/{held}")).text
    answer = await client.get(f"{PAGE}/residuals/{early}")
    assert answer.status_code == 200, answer.text
    assert "not comparable" in answer.text
    assert "before the first reading" in answer.text
    problem(await client.get(f"{PAGE}/residuals/99"), 404)


@pytest.mark.parametrize("which", ALL)
async def test_every_result_is_shown_with_its_decision(client, app, which):
    done(app, ALL[which])
    answer = await client.get(PAGE)
    page = Texts(answer.text)
    assert answer.status_code == 200
    assert page.tags.count("script") == 4
    for effect in ALL[which]["effects"]:
        assert sentence(effect["explanation"]) in page.text
    for step in ALL[which]["what_next"]:
        assert sentence(step) in page.text
    assert "What would have been seen" in page.text
    assert not re.search(r'<div class="stack">\s*</div>', answer.text), "a column without content"


async def test_visits_to_make_are_a_list_to_print_and_files(client, app):
    number = done(app, ALL["found"] | {"next_visits": VISITS})
    page = await shown(client, PAGE)
    printed = f"{ROOM}/analyses/{number}/visits"
    assert printed in page.addresses
    assert "Print the list: 3 visits" in page.text
    listed = Texts((await client.get(printed)).text)
    assert f"/machines/mcfv5050/loop?analysis={number}" in listed.addresses
    assert "2. While warming: spindle above 31 °C while z-column about 24 °C" in listed.text
    assert "every 20 min, 7 times" in listed.text
    assert "min 0 20 40 60 80 100 120 clock" in " ".join(listed.text.split())
    assert "450" in listed.text, "a field for each position"
    assert "thermap program visit mcfv5050 visit-3.csv -c CONTROLLER" in listed.text
    file = await client.get(f"{printed}/3")
    assert file.headers["content-type"].startswith("text/csv")
    read = parse_csv_verification({"": file.text}, Path("visit-3.csv"), is_planned=True)
    assert (read.body["label"], len(read.body["observations"])) == ("visit 3, warm", 22)
    missing = problem(await client.get(f"{printed}/4"), 404)
    assert missing["detail"].endswith("proposes 3 visits, and no visit 4")


async def test_an_analysis_of_before_has_no_list(client, app):
    """Its next visit said by how many hundredths of a kelvin sensors were to come apart."""
    old = json.loads(RESULTS.text(RESULTS.read_text(json.dumps(ALL["found"]))))
    assert old.pop("next_visits") == []
    number = done(app, old | {"shape": 3, "next_visit": {"sentence": "by 0.011 K"}})
    assert "Print the list" not in (await shown(client, PAGE)).text
    listed = await client.get(f"{ROOM}/analyses/{number}/visits")
    assert "proposes no visit" in listed.text


@pytest.mark.parametrize("verdict", ["nothing-found", "not-judged"])
async def test_nothing_is_never_said_without_what_would_have_been_seen(client, app, verdict):
    done(app, NOTHING | {"verdict": verdict})
    page = await shown(client, PAGE)
    assert "thermal lag: 0.21 to 0.30 µm; 0.40 µrad would have been seen" in page.text
    assert "There is nothing to adopt." in page.text
    done(app, NOTHING | {"verdict": verdict, "detectable": []})
    page = await shown(client, PAGE)
    assert "Nothing could have been seen" in page.text


async def test_a_tie_is_a_second_black_bar_with_what_separates_the_two(client, app):
    tie = rival("backlash", 205.0, tied=True, separating_measurement="measure both ways")
    done(app, ALL["found"] | {"effects": [SHIFT | {"alternatives": [tie]}, BACKLASH]})
    answer = await client.get(PAGE)
    assert answer.text.count('<tr class="black">') >= 2
    assert "cannot tell the bars in bold apart" in answer.text
    assert "measure both ways" in answer.text


async def test_after_adoption_later_visits_are_held_against_both_versions(client, app):
    await check(client, "analysed", START - timedelta(hours=2), [7.0, 15.0, 23.0])
    number = done(app, ALL["found"] | {"effects": [SHIFT]})
    page = await shown(client, PAGE)
    assert "Adopt as v4" in page.text
    adopted = await client.post(f"{ROOM}/analyses/{number}/adopt")
    assert adopted.status_code == 200, adopted.text
    page = await shown(client, PAGE)
    assert "Adopted as v4. No later visits yet" in page.text
    assert "Go back to v3" in page.text
    # At 24 °C the maps say 4, 12 and 20 µm; what was adopted adds 3.
    await check(client, "later", START - timedelta(hours=1), [7.0, 15.0, 23.0])
    page = await shown(client, PAGE)
    assert "Adopted as v4. 1 later visit: 3.00 → 0.00 µm." in page.text
    answer = await client.post(f"{ROOM}/models/3/activate")
    assert answer.status_code == 200, answer.text
    page = await shown(client, PAGE)
    assert "Activate v4" in page.text
    assert "Go back" not in page.text


async def test_what_was_found_on_another_version_is_not_adopted_unasked(client, app):
    number = done(app, ALL["found"] | {"effects": [SHIFT]})
    done(app, ALL["found"] | {"effects": [SHIFT | {"effect": BACKLASH["effect"]}]})
    await client.post(f"{ROOM}/analyses/{number}/adopt")
    page = await shown(client, PAGE)
    assert "v4 is active, but the analysis was made with v3." in page.text
    assert "Analyse again on v4" in page.text
