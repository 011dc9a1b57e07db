"""thermap analyse: from files to the answer, the report and the adopted effect; and refusals."""

import json
import re
import signal
import time
from io import StringIO

import httpx
import pytest
from rich.console import Console

from app.cli.analyse_view import analysis_view
from app.cli.listening import listening, serving, url_of
from app.files.csv_writing import csv_of_check
from app.services.observations import VerificationRequest
from app.storage.analysis_results import RESULTS
from tests.campaign_examples import (
    LATER,
    MACHINE_ID,
    campaign_database,
    small_campaign,
    store_sister,
)
from tests.cli.conftest import ended
from tests.files.test_renishaw_rtl import BOTH_WAYS
from tests.pages.example_analyses import EXCHANGED, FOUND, LAG, MOVED, NOTHING, UNEXPLAINED
from tests.service_examples import MACHINE, Clock, error_map, running
from thermap import ThermapClient

QUICK = ("--effects", "backlash")
"""One kind of effect: the whole library takes longer than a test should."""


@pytest.fixture
def service_url(databases):
    """A running service with the campaign's machine, maps, readings and verifications."""
    database_url = databases.prepared("sqlite", campaign_database)
    with (
        running(database_url, Clock(LATER)) as service,
        listening("127.0.0.1", 0, "serve") as opened,
        serving(service, opened, "warning"),
    ):
        yield url_of(opened)
    databases.give_back(database_url)


def as_csv(body, file):
    check = VerificationRequest.model_validate(body).to_verification()
    file.write_text(csv_of_check(MACHINE_ID, check), encoding="utf-8")
    return file


def as_json(body, file):
    file.write_text(json.dumps(body), encoding="utf-8")
    return file


def options(files):
    return [word for file in files for word in ("--verification", file)]


def plain(text):
    return " ".join(text.replace("│", " ").split())


@pytest.mark.slow
def test_from_files_to_the_report_and_the_adopted_effect(thermap, client, tmp_path):
    """Of every other visit CSV: it is the same content, so nothing is stored a second time."""
    bodies = small_campaign().verifications
    files = [
        as_csv(b, tmp_path / f"{i}.csv") if i % 2 else as_json(b, tmp_path / f"{i}.json")
        for i, b in enumerate(bodies)
    ]
    report = tmp_path / "report.html"
    asked = ("--adopt", "--json", "-o", report)
    found = thermap("analyse", MACHINE_ID, *options(files), *QUICK, *asked)
    assert found.exit_code == 0, found.stderr
    assert json.loads(found.stdout)["adopted_version"] == 4
    assert len(client.verifications(MACHINE_ID)) == len(bodies)
    shown = thermap("analyses", "show", "1", "--machine", MACHINE_ID)
    assert shown.exit_code == 0, shown.output
    assert "adopted as model version 4" in plain(shown.stdout)
    told = plain(shown.stdout)
    assert "Effects found" in told or "Something unexplained" in told
    assert "0. EZX has a reversal value of" in told
    assert "confirmed on held-out visits" in told
    assert re.search(r"EZX \d+\.\d+ \d+\.\d+ (\d+\.\d+|–) µm", told)
    assert client.models(MACHINE_ID)[-1].active
    page = report.read_text(encoding="utf-8")
    assert "EZX has a reversal value of" in page
    assert "as model version 4" in page
    assert bodies[0]["label"] in page
    assert "<script src" not in page
    again = thermap("analyse", MACHINE_ID, *QUICK)
    assert again.exit_code == 0, again.stderr
    answer = client.analysis(MACHINE_ID, 2)
    assert (answer.status, answer.model_version, answer.result.effects) == ("done", 4, [])
    assert answer.verifications == [v.id for v in client.verifications(MACHINE_ID)]
    shown = thermap("analyses", "show", "2", "--machine", MACHINE_ID)
    assert plain(again.stdout) in plain(shown.stdout)


@pytest.mark.slow
def test_the_proposed_visit_is_written_and_planned(thermap, client, tmp_path):
    """Few visits leave open what changes from one to the next."""
    bodies = small_campaign().verifications[:3]
    files = [as_csv(b, tmp_path / f"{i}.csv") for i, b in enumerate(bodies)]
    folder = tmp_path / "visits"
    found = thermap("analyse", MACHINE_ID, *options(files), *QUICK, "--visits", folder)
    assert found.exit_code == 0, found.stderr
    visit = next(iter(sorted(folder.iterdir())))
    assert str(visit) in found.stderr.replace("\n", "")
    planned = thermap("analyse", MACHINE_ID, "--plan", "--verification", visit)
    assert planned.exit_code == 0, planned.stderr
    assert "1 visit with" in plain(planned.stdout)


def test_nothing_is_sent_where_a_file_is_wrong(thermap, client, tmp_path):
    good = as_json(small_campaign().verifications[0] | {"label": "new"}, tmp_path / "good.json")
    bad = tmp_path / "bad.csv"
    bad.write_text(
        "time,component,position_mm,direction,measured_um\n"
        "2026-02-03T06:00:00Z,EXX,100,+,1.2\n"
        "2026-02-03T06:01:00,EXY,,up,much\n",
        encoding="utf-8",
    )
    before = client.verifications(MACHINE_ID)
    found = thermap("analyse", MACHINE_ID, *options([good, bad]), *QUICK)
    assert found.exit_code == 1
    told = plain(found.stderr)
    assert "no map or check was stored" in told
    assert "line 3, column 1 (time): expected a time with its zone" in told
    assert "column 4 (direction): expected + or -, got 'up'" in told
    assert "column 5 (measured_um): expected a number in µm, got 'much'" in told
    assert client.verifications(MACHINE_ID) == before


def test_what_the_service_would_refuse_is_told_with_its_line(thermap, tmp_path):
    file = tmp_path / "huge.csv"
    file.write_text(
        "time,component,position_mm,measured [m]\n2026-02-03T06:00:00Z,EXX,100,12\n",
        encoding="utf-8",
    )
    found = thermap("analyse", MACHINE_ID, "-v", file)
    assert found.exit_code == 1
    assert "huge.csv, line 2: expected errors within ±10000 µm, got 1.2e+07 µm" in plain(
        found.stderr
    )


def test_another_verification_of_the_same_label_is_refused(thermap, tmp_path):
    first, second = small_campaign().verifications[:2]
    file = as_json(first | {"observations": second["observations"]}, tmp_path / "again.json")
    found = thermap("analyse", MACHINE_ID, "-v", file)
    assert found.exit_code == 1
    assert "again.json" in found.stderr
    assert "choose another label" in plain(found.stderr)


@pytest.mark.slow
def test_a_failed_analysis_says_why(thermap, client, tmp_path):
    """Everything lies before the machine's first reading."""
    file = tmp_path / "early.csv"
    lines = [f"2020-01-01T00:0{i}:00Z,SXY,{i}" for i in range(3)]
    file.write_text("\n".join(["time,component,measured_um", *lines]), encoding="utf-8")
    report = tmp_path / "report.html"
    found = thermap("analyse", MACHINE_ID, "-v", file, "-o", report)
    assert found.exit_code == 1
    assert "failed: " in plain(found.stderr)
    assert "before the first reading" in plain(found.stderr)
    number = client.verifications(MACHINE_ID)[-1].id
    assert f"verification {number} stays stored" in plain(found.stderr)
    assert f"`thermap verifications delete {number} --machine {MACHINE_ID}`" in plain(found.stderr)
    assert not report.exists()


@pytest.mark.slow
def test_what_nothing_can_be_compared_with_is_told_once_before_it_is_stored(
    thermap, client, tmp_path
):
    """Neither sensor is one that the chapter's components follow, and none was assigned."""
    sensors = [{"name": "bed"}, {"name": "column"}]
    client.create_machine(MACHINE | {"id": "mill", "sensors": sensors})
    for t_c in (20.0, 25.0):
        bed = {"bed": t_c, "column": t_c + 1.0}
        client.store_error_map("mill", error_map(f"at {t_c}", t_c, temperatures_c=bed))
    files = []
    for label in ("one", "two"):
        file = tmp_path / f"{label}.csv"
        file.write_text(
            "time,component,position_mm,measured_um\n"
            "2026-02-20T06:00:00Z,EXX,100,1\n2026-02-20T06:01:00Z,EZZ,100,2\n",
            encoding="utf-8",
        )
        files += ["-v", file]
    found = thermap("analyse", "mill", *files)
    assert found.exit_code == 1
    told = plain(found.stderr)
    assert told.startswith("thermap: nothing was sent, as there is nothing to compare it with: ")
    assert told.count("has EXX, EZZ, and nothing is compared with them") == 1
    assert "EXX: no sensor is assigned to it" in told
    assert client.verifications("mill") == []
    client.assign_sensors("mill", {"EXX": "bed"})
    found = thermap("analyse", "mill", *files)
    assert "has EZZ, and nothing is compared with them" in plain(found.stderr)
    assert len(client.verifications("mill")) == 2


def test_an_unknown_machine_and_a_service_that_is_away(thermap, run, no_service_url, tmp_path):
    file = as_json(small_campaign().verifications[0], tmp_path / "v.json")
    found = thermap("analyse", "nope", "-v", file)
    assert found.exit_code == 1
    assert MACHINE_ID in found.stderr
    away = run("analyse", MACHINE_ID, "-v", file, THERMAP_URL=no_service_url)
    assert away.exit_code == 1
    assert "thermap serve" in away.stderr


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (("-o", "report.pdf"), 2, "ends in .html"),
        (("--holdout", "0.95"), 2, "0.85"),
        (("-v", "no/such/file.csv"), 1, "No such file"),
        (("--effects", "gremlins"), 1, "thermal-lag"),
        (("--holdout", "nan"), 2, "got 'nan'"),
        (("-o", "no/such/folder/r.html"), 2, "cannot write"),
        (("--plan", "--adopt"), 2, "leave out --adopt"),
    ],
)
def test_wrong_usage_is_told(thermap, arguments, code, said):
    found = thermap("analyse", MACHINE_ID, *arguments)
    assert found.exit_code == code
    assert said in plain(found.stderr)


@pytest.mark.parametrize("name", ["x.rtl", "renamed.txt"])
def test_an_instruments_file_is_sent_where_it_goes(thermap, client, tmp_path, name):
    file = tmp_path / name
    file.write_text(BOTH_WAYS, encoding="utf-8")
    found = thermap("analyse", MACHINE_ID, "-v", file, columns=300)
    assert (found.exit_code, found.stdout) == (1, "")
    told = plain(found.stderr)
    assert "expected check measurements with their times, got an error map" in told
    assert f"`thermap import {file}` makes a map of it" in told


def test_the_table_counts_what_its_figures_are_of():
    """Angles are not in an RMS of lengths; nothing stands for a floor that is not known."""
    terminal = StringIO()
    result = NOTHING | {"floor_um": None, "floor_unknown": "nothing was repeated"}
    Console(width=100, file=terminal).print(analysis_view(RESULTS.read_text(json.dumps(result))))
    told = plain(terminal.getvalue())
    assert "all in µm 0.65 0.65 – µm 240" in told
    assert "floor unknown: nothing was repeated" in told


def test_a_mistake_is_to_be_put_right_and_nothing_is_said_of_adopting_it():
    terminal = StringIO()
    result = FOUND | {"effects": [EXCHANGED, LAG], "plots": NOTHING["plots"]}
    Console(width=100, file=terminal).print(analysis_view(RESULTS.read_text(json.dumps(result))))
    told = plain(terminal.getvalue())
    mistake, lag = told.split("0. x-middle and bed")[1].split("1. EZZ follows")
    assert "It is never adopted; correct it at its source: it is a mistake" in mistake
    assert "Swap the plugs of x-middle and bed" in mistake
    for absent in ("by default", "learnt over", "edge"):
        assert absent not in mistake
    assert "is adopted by default" in lag


def test_a_negative_number_in_a_sentence_has_a_true_minus_here_too():
    terminal = StringIO()
    Console(width=100, file=terminal).print(
        analysis_view(RESULTS.read_text(json.dumps(UNEXPLAINED)))
    )
    told = plain(terminal.getvalue())
    assert "SXY changed by −7.3 ± 0.3 µm/m" in told
    assert " -7.3" not in told


def test_what_only_the_service_knows_is_told_with_its_line_too(thermap, tmp_path):
    file = tmp_path / "beyond.csv"
    file.write_text(
        "time,component,position_mm,measured_um\n"
        "2026-02-03T06:00:00Z,EXX,100,1.2\n"
        "2026-02-03T06:01:00Z,EXX,9999.0001,1.3\n",
        encoding="utf-8",
    )
    for plan in ((), ("--plan",)):
        found = thermap("analyse", MACHINE_ID, "-v", file, *plan, columns=300)
        assert found.exit_code == 1
        told = plain(found.stderr)
        assert f"{file}, line 3, position_mm: expected x within the axis' travel" in told
        assert "got 9999.0001 mm" in told


def test_another_machines_file_is_refused(thermap, tmp_path):
    file = tmp_path / "other.csv"
    file.write_text(
        "# machine: nope\ntime,component,measured_um\n2026-02-03T06:00:00Z,SXY,1\n",
        encoding="utf-8",
    )
    found = thermap("analyse", MACHINE_ID, "-v", file)
    assert found.exit_code == 1
    assert f"{file} says that it belongs to 'nope', got '{MACHINE_ID}'" in plain(found.stderr)


@pytest.mark.slow
def test_a_machine_without_verifications(thermap, client):
    for one in client.verifications(MACHINE_ID):
        client.delete_verification(MACHINE_ID, one.id)
    found = thermap("analyse", MACHINE_ID)
    assert found.exit_code == 2
    assert "no verification yet" in plain(found.stderr)


@pytest.mark.slow
def test_ctrl_c_cancels_it(client, start, service_url):
    process = start("analyse", MACHINE_ID, "--url", service_url)
    deadline = time.monotonic() + 60.0
    while not (jobs := [job for job in client.analyses(MACHINE_ID) if job.status == "running"]):
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.05)
    code, _, err = ended(process, signal.SIGINT)
    assert code == 130, err
    assert "cancelled" in err
    assert client.analysis(MACHINE_ID, jobs[0].id).status == "cancelled"


@pytest.mark.slow
def test_ctrl_c_while_an_answers_shape_is_compiled_ends_it_too(thermap, client, monkeypatch):
    """Compiled code turns an interrupt into an error of its own. Nothing is adopted after it."""
    client.store_verification(MACHINE_ID, small_campaign().verifications[0])
    before = client.machine(MACHINE_ID).active_model
    follow = ThermapClient.analysis

    def pressed_meanwhile(self, machine, analysis):
        while (job := follow(self, machine, analysis)).status != "done":
            time.sleep(0.05)
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            raise ValueError("the shape cannot be compiled") from None
        return job

    monkeypatch.setattr(ThermapClient, "analysis", pressed_meanwhile)
    found = thermap("analyse", MACHINE_ID, "--adopt", "--effects", "backlash")
    assert found.exit_code == 130, found.output
    assert "analysis 1" in found.stderr
    assert client.machine(MACHINE_ID).active_model == before


def test_ctrl_c_before_the_service_has_answered_cancels_what_it_began(thermap, client, monkeypatch):
    client.store_verification(MACHINE_ID, small_campaign().verifications[0])
    ask = ThermapClient.analyse

    def pressed_meanwhile(self, *question):
        job = ask(self, *question)
        signal.raise_signal(signal.SIGINT)
        return job

    monkeypatch.setattr(ThermapClient, "analyse", pressed_meanwhile)
    found = thermap("analyse", MACHINE_ID, "--effects", "backlash")
    assert found.exit_code == 130, found.output
    assert "analysis 1" in found.stderr
    assert client.analysis(MACHINE_ID, 1).status not in ("waiting", "running")


@pytest.mark.slow
def test_a_plan_says_what_would_be_seen_and_stores_nothing(thermap, client, tmp_path):
    """From CSV without a value, and from JSON whose values are not looked at."""
    bodies = small_campaign().verifications
    rows = [o for o in bodies[0]["observations"] if "component" in o]
    file = tmp_path / "planned.csv"
    lines = [
        f"{o['time']},{o['component']},{o.get('position_mm', '')},{o.get('direction', '')}"
        for o in rows
    ]
    head = ["# instrument: XL-80", "time,component,position_mm,direction"]
    file.write_text("\n".join([*head, *lines]), encoding="utf-8")
    other = as_json(bodies[1], tmp_path / "planned.json")
    before = client.verifications(MACHINE_ID)
    found = thermap("analyse", MACHINE_ID, "--plan", *options([file, other]), columns=120)
    assert found.exit_code == 0, found.stderr
    told = plain(found.stdout)
    assert told.startswith("2 visits with ")
    assert re.search(r"backlash \d+\.\d\d to \d+\.\d\d", told)
    assert re.search(r"cannot be tested: [a-z, ]*drift", told)
    assert client.verifications(MACHINE_ID) == before
    assert client.analyses(MACHINE_ID) == []
    whole = json.loads(thermap("analyse", MACHINE_ID, "--plan", "-v", other, "--json").stdout)
    assert whole["visits"] == 1


def test_another_sensor_is_said_before_what_was_found():
    terminal = StringIO()
    Console(width=300, file=terminal).print(analysis_view(RESULTS.read_text(json.dumps(MOVED))))
    told = plain(terminal.getvalue())
    proposal = (
        "EZZ with column-rear instead of z-column: 7.6 → 5.1 µm on held-out set-ups, and none of "
        "them gets markedly worse."
    )
    assert proposal in told
    assert told.index(proposal) < told.index("RMS of residuals")
    assert "what is said of EXZ" in told


@pytest.mark.slow
def test_a_fleet_is_judged_and_asked_again_it_serves(thermap, service_url, tmp_path):
    """Sisters that both show an effect are said to; what was analysed is not analysed again."""
    with httpx.Client(base_url=service_url, trust_env=False, timeout=60) as client:
        store_sister(client, "sister")
        store_sister(client, "unmeasured", 0)
        report = tmp_path / "fleet.html"
        found = thermap("analyse", "--fleet", *QUICK, "--json", "-o", report)
        judged = json.loads(found.stdout)
        by_id = {one["machine"]: one for one in judged["machines"]}
        assert by_id["unmeasured"]["why_not"] == "no check of it is stored"
        assert by_id[MACHINE_ID]["sisters"] == ["sister", "unmeasured"]
        (effect,) = judged["effects"]
        assert (effect["kind"], effect["components"]) == ("backlash", ["EZX"])
        assert {one["machine"] for one in effect["found_on"]} == {MACHINE_ID, "sister"}
        assert "EZX" in report.read_text()
        again = json.loads(thermap("analyse", "--fleet", *QUICK, "--json").stdout)
        assert again == judged
        assert len(client.get(f"/v1/machines/{MACHINE_ID}/analyses").json()) == 1
        page = client.get("/fleet", params={"effects": "backlash"}).text
        assert judged["summary"] in page
        assert "found on 2 of 3" in page
        shown = client.get("/v1/fleet", params={"effects": "backlash"}).json()
        assert shown["judgement"] == judged
        nothing = thermap("analyse", "--fleet", *QUICK, "--cancel")
        assert plain(nothing.stderr).strip() == "nothing was going on"


@pytest.mark.parametrize(
    ("options", "said"),
    [(["campaign", "--cancel"], "--fleet"), (["--fleet", "--cancel", "--json"], "--json")],
)
def test_cancelling_is_for_a_fleet_and_has_no_answer(thermap, options, said):
    found = thermap("analyse", *options, columns=200)
    assert found.exit_code == 2
    assert said in plain(found.stderr)
