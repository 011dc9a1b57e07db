"""The daily verbs: list, show, change, delete, against a running service."""

import json
import os
from datetime import UTC, datetime, timedelta

import httpx
import pytest

from tests.service_examples import MACHINE, START, iso, reading, temperatures

pytestmark = pytest.mark.slow

SECOND = MACHINE | {"id": "mill", "name": "Mill"}

VERIFICATION = {
    "label": "night shift",
    "datum": "absolute",
    "observations": [
        {
            "time": iso(START + timedelta(minutes=i)),
            "component": "EXX",
            "position_mm": 250,
            "direction": "+" if i % 2 else "-",
            "measured_um": 10.5 + 0.1 * i,
        }
        for i in range(5)
    ],
}


def lines(found):
    assert found.exit_code == 0, found.output
    assert max(map(len, found.stdout.splitlines())) <= 80
    return [" ".join(line.split()) for line in found.stdout.splitlines()]


def answered(found):
    assert found.exit_code == 0, found.output
    return json.loads(found.stdout)


@pytest.fixture
def measured(client):
    """Readings around the verification's observations, and the verification."""
    client.store_readings(
        "mcfv5050", [reading(START + timedelta(minutes=i), 24.0) for i in range(6)]
    )
    return client.store_verification("mcfv5050", VERIFICATION).id


# -- whether they can be trusted -------------------------------------------------------------


def test_whether_machines_can_be_trusted(thermap, client):
    client.create_machine(SECOND)
    client.store_readings("mcfv5050", [reading(START, 24.0)])
    why = "No reading since 2026-03-01 06:00 UTC. The table has stood still since then."
    said = " ".join(lines(thermap("status")))
    assert said.startswith("machine verdict state since (UTC) why mcfv5050 Not trusted no-reading")
    assert "mill Not trusted no-model" in said
    shown = lines(thermap("status", "mcfv5050"))
    assert shown[:2] == ["Not trusted · no-reading since 2026-03-01 06:00 UTC", why]
    assert "largest compensation EZZ −40.0 µm at Z 500" in shown
    assert "last check: none of this version" in shown
    assert answered(thermap("status", "mcfv5050", "--json"))["sentences"] == [why]
    assert "mill" in thermap("status", "another").output


# -- machines ------------------------------------------------------------------------------


def test_what_a_machine_needs_measured_is_listed(thermap, client):
    shown = lines(thermap("machines", "needs", "mcfv5050", "--preset", "large-gantry"))
    assert shown[0].startswith("mcfv5050, XYFZ; large-gantry: weight that shifts along a long x")
    assert "EXX D_x(x) linear displacement µm yes" in shown
    assert "EXY^x D_x^x(y) nonrigid slope µm/m missing" in shown
    found = answered(thermap("machines", "needs", "mcfv5050", "--json"))
    assert found["preset"] is None


def test_machines_are_listed(thermap, client):
    client.create_machine(SECOND)
    assert lines(thermap("machines", "list")) == [
        "machine name configuration sensors model watch",
        "mcfv5050 MCFV5050LN XYFZ 4 3 –",
        "mill Mill XYFZ 4 – –",
    ]
    listed = answered(thermap("machines", "list", "--json"))
    assert listed == [m.model_dump(mode="json") for m in client.machines()]


def test_a_machine_is_shown(thermap):
    shown = lines(thermap("machines", "show", "mcfv5050"))
    assert "axes x 0 to 500 mm, y 0 to 500 mm, z 0 to 500 mm" in shown
    assert "outside maps clamp" in shown
    assert "x-middle y-front -10 80 120 0.1 3600 5" in shown
    assert any(line.startswith("spindle – ") for line in shown)


def test_settings_are_changed_together(thermap, client):
    found = thermap(
        *("machines", "set", "mcfv5050", "out_of_range=extrapolate", "name=007"),
        *("extrapolation_error_ratio=5", "serial_number=12345"),
        *("axes.x.max_mm=510", "sensors.x-middle.max_age_s=60"),
        *("sensors.z-column.stand_in=spindle", "--json"),
    )
    assert answered(found)["id"] == "mcfv5050"
    now = client.machine("mcfv5050")
    assert (now.out_of_range, now.name) == ("extrapolate", "007")
    assert now.extrapolation_error_ratio == 5.0
    shown = " ".join(thermap("machines", "show", "mcfv5050").stdout.split())
    assert "serial number 12345" in shown
    assert "below 5 times the maps' own (extrapolation_error_ratio)" in shown
    assert (now.axes["x"].min_mm, now.axes["x"].max_mm) == (0, 510)
    assert now.axes["y"].max_mm == 500
    by_name = {sensor.name: sensor for sensor in now.sensors}
    assert by_name["x-middle"].max_age_s == 60
    assert by_name["x-middle"].max_c == 80, "what was not named stays"
    assert by_name["z-column"].stand_in == "spindle"
    thermap("machines", "set", "mcfv5050", "sensors.z-column.stand_in=null", "serial_number=null")
    assert client.machine("mcfv5050").serial_number is None
    assert {s.name: s.stand_in for s in client.machine("mcfv5050").sensors}["z-column"] is None


@pytest.mark.parametrize(
    ("change", "code", "words"),
    [
        ("colour=red", 2, "extrapolation_margin_c"),
        ("name", 2, "KEY=VALUE"),
        ("axes.x=500", 2, "axes.AXIS.max_mm"),
        ("sensors.nose.max_c=5", 2, "x-middle, y-front, z-column, spindle"),
        ("sensors.spindle.name=tool", 2, "max_age_s"),
        ("extrapolation_margin_c=far", 1, "expected a number in °C, got 'far'"),
        ("name=null", 1, "expected a value, got null"),
    ],
)
def test_settings_that_cannot_be(thermap, client, change, code, words):
    before = client.machine("mcfv5050")
    found = thermap("machines", "set", "mcfv5050", "axes.x.max_mm=510", change, columns=300)
    assert (found.exit_code, found.stdout) == (code, "")
    assert words in found.stderr
    assert client.machine("mcfv5050") == before


def test_an_unknown_machine_lists_what_there_is(thermap):
    found = thermap("machines", "show", "mill")
    assert (found.exit_code, found.stdout) == (1, "")
    assert "mcfv5050" in found.stderr


# -- what destroys asks --------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(
    "words", [("machines", "delete", "mcfv5050"), ("maps", "delete", "1"),
              ("verifications", "delete", "1")],
)  # fmt: skip
def test_nothing_is_destroyed_without_a_word(thermap, client, measured, words):
    found = thermap(*words)
    assert (found.exit_code, found.stdout) == (1, "")
    assert "was not deleted: there is no terminal to ask on; --yes" in found.stderr
    assert len(client.error_maps("mcfv5050")) == 3
    assert len(client.verifications("mcfv5050")) == 1
    assert thermap(*words, "--yes").exit_code == 0
    left = {
        "machines": lambda: client.machines(),
        "maps": lambda: [m for m in client.error_maps("mcfv5050") if m.id == 1],
        "verifications": lambda: client.verifications("mcfv5050"),
    }[words[0]]()
    assert left == []


@pytest.mark.slow
@pytest.mark.parametrize(("said", "is_there"), [("n\n", True), ("y\n", False)])
def test_on_a_terminal_it_asks(start_on_terminal, service_url, client, said, is_there):
    process, ours = start_on_terminal(
        24, 80, "machines", "delete", "mcfv5050", "--url", service_url
    )
    asked = b""
    while b"[y/N]" not in asked:
        asked += os.read(ours, 1000)
    assert b"3 error maps" in asked
    os.write(ours, said.encode())
    assert process.wait(timeout=60) == (1 if is_there else 0)
    assert bool(client.machines()) == is_there


# -- which machine is meant ----------------------------------------------------------------


def test_with_one_machine_nobody_has_to_name_it(thermap, client):
    assert len(answered(thermap("maps", "list", "--json"))) == 3
    client.create_machine(SECOND)
    found = thermap("maps", "list", columns=200)
    assert (found.exit_code, found.stdout) == (2, "")
    assert "several machines are stored: expected one of mcfv5050, mill, got none" in found.stderr
    assert len(answered(thermap("maps", "list", "--machine", "mcfv5050", "--json"))) == 3
    assert answered(thermap("maps", "list", "--json", THERMAP_MACHINE="mill")) == []


def test_without_any_machine(thermap, client):
    client.delete_machine("mcfv5050")
    assert lines(thermap("machines", "list")) == [
        "no machine is stored yet; `thermap import machine.json` stores one"
    ]
    found = thermap("models", "list", columns=200)
    assert (found.exit_code, found.stdout) == (2, "")
    assert "no machine is stored yet" in found.stderr


# -- maps, models, sensors -----------------------------------------------------------------


def test_maps(thermap, client):
    listed = lines(thermap("maps", "list"))
    assert listed[1] == "1 Run #1 2026-02-28 06:00 yes EXX, EBX, EZZ, SXY"
    shown = lines(thermap("maps", "show", "3"))
    assert "error map Run #6, number 3" in shown
    assert "temperatures [°C] x-middle 30.00, y-front 29.00, z-column 32.00, spindle 35.00" in shown
    # At x-middle 30 °C EXX is (30 − 20)·x/100 µm: 50 µm at 500 mm.
    assert "EXX D_x(x) 0.00 +50.00 – µm 3: x 0 to 500 mm" in shown
    url = f"{client.base_url}/v1/machines/mcfv5050/error-maps"
    assert answered(thermap("maps", "list", "--json")) == httpx.get(url, trust_env=False).json()
    deleted = thermap("maps", "delete", "3", "--yes")
    assert "without 'Run #6' tables would lose " in deleted.stderr
    assert deleted.stdout.startswith("error map 'Run #6' is out of use; the active model version")
    assert [one.id for one in client.error_maps("mcfv5050")] == [1, 2]


def test_models(thermap, client):
    listed = lines(thermap("models", "list"))
    assert listed[0] == "version made [UTC] maps effects reason"
    assert [line.split()[0] for line in listed[1:]] == ["1", "2", "3"]
    active = client.machine("mcfv5050").active_model
    assert next(line for line in listed if " active " in line).startswith(f"{active} active")
    assert thermap("models", "activate", "1").stdout.startswith("model version 1 of 'mcfv5050'")
    assert client.machine("mcfv5050").active_model == 1
    shown = lines(thermap("models", "show", "2"))
    assert "x-middle EXX, EBX, SXY" in shown
    found = thermap("models", "activate", "9")
    assert (found.exit_code, found.stdout) == (1, "")


def test_versions_are_compared(thermap, client, measured):
    versions = [one.version for one in client.models("mcfv5050")][-2:]
    found = lines(thermap("models", "compare", *versions))
    # EXX at 24 °C and 250 mm is 10 µm; 10.5, 10.6 … 10.9 were measured: RMS √0.51 µm.
    assert "EXX 0.71 0.71 µm 5" in found
    assert "5 values that can be compared with all of them; verifications 1; * is active" in found
    assert thermap("models", "compare", "2").exit_code == 2


def test_sensors(thermap, client):
    assert "x-middle EXX, EBX, SXY" in lines(thermap("sensors", "show"))
    before = client.machine("mcfv5050").active_model
    found = lines(thermap("sensors", "assign", "EXX=y-front"))
    assert "y-front EXX" in found
    assert found[-1] == f"the active model version of 'mcfv5050' is {before + 1}"
    assert client.sensor_assignment("mcfv5050")["EXX"] == "y-front"
    assert client.sensor_assignment("mcfv5050")["EZZ"] == "z-column"
    correlated = lines(thermap("sensors", "correlate"))
    assert correlated[0] == "component follows proposed r 95 % from, to maps"
    assert any(line.startswith("EXX: ") for line in correlated), "it says why"
    assert thermap("sensors", "assign", "EXX").exit_code == 2
    assert thermap("sensors", "assign", "EXX=a", "EXX=b").exit_code == 2
    refused = thermap("sensors", "assign", "EXX=nose")
    assert refused.exit_code == 1
    assert "x-middle" in refused.stderr


# -- readings, verifications, analyses -----------------------------------------------------


def test_readings(thermap, client, measured):
    found = lines(thermap("readings", "list", "--from", iso(START)))
    assert found[1].startswith("2026-03-01 06:00:00 x-middle 24.00, y-front 23.00, z-column")
    assert len(answered(thermap("readings", "list", "--from", iso(START), "--json"))) == 6
    few = thermap("readings", "list", "--from", iso(START), "--limit", "2")
    assert "the first 2; there may be more" in few.stdout
    none = thermap("readings", "list", columns=200)
    assert none.stdout.startswith("no reading since")
    recent = datetime.now(UTC) - timedelta(minutes=5)
    client.store_readings("mcfv5050", [{"time": iso(recent), "temperatures_c": temperatures(24)}])
    assert f"{recent:%H:%M:%S}" in thermap("readings", "list").stdout
    assert thermap("readings", "list", "--from", "yesterday").exit_code == 2


def test_readings_are_withdrawn(thermap, client, measured):
    unasked = thermap("readings", "withdraw", "--time", iso(START), columns=200)
    assert (unasked.exit_code, unasked.stdout) == (1, "")
    assert "1 reading of 'mcfv5050' was not withdrawn: there is no terminal" in unasked.stderr
    assert len(client.readings("mcfv5050")) == 6
    one = thermap("readings", "withdraw", "--time", iso(START), "--yes")
    assert one.stdout == "1 reading of 2026-03-01T06:00:00Z withdrawn\n"
    assert client.readings("mcfv5050")[0].time == START + timedelta(minutes=1)
    span = ("--from", "2026-03-01T07:01:00+01:00", "--to", iso(START + timedelta(minutes=3)))
    several = thermap("readings", "withdraw", *span, "--yes")
    assert several.exit_code == 0, several.output
    assert several.stdout == (
        "3 readings from 2026-03-01T06:01:00Z to 2026-03-01T06:03:00Z withdrawn\n"
    )
    left = [one.time - START for one in client.readings("mcfv5050")]
    assert left == [timedelta(minutes=4), timedelta(minutes=5)]
    again = thermap("readings", "withdraw", *span, "--yes")
    assert again.stdout.startswith("0 readings from ")


def test_withdrawn_readings_are_listed(thermap, client, measured):
    words = ("readings", "list", "--withdrawn")
    assert thermap(*words).stdout == "no reading was withdrawn\n"
    client.withdraw_reading("mcfv5050", START)
    header, one, *_ = lines(thermap(*words))
    assert header == "time [UTC] withdrawn [UTC] temperatures [°C]"
    assert one.startswith("2026-03-01 06:00:00 ")
    (listed,) = answered(thermap(*words, "--json"))
    assert listed["time"] == iso(START)
    assert listed["withdrawn_at"] >= iso(START)


def test_a_reading_is_withdrawn_by_the_time_that_the_list_shows(thermap, client):
    client.store_readings("mcfv5050", [reading(START + timedelta(milliseconds=250), 24.0)])
    shown = lines(thermap("readings", "list", "--from", iso(START)))[1]
    assert shown.startswith("2026-03-01 06:00:00.25 x-middle")
    rough = thermap("readings", "withdraw", "--time", iso(START), "--yes", columns=300)
    assert (rough.exit_code, rough.stdout) == (1, "")
    assert "no reading of 2026-03-01T06:00:00Z" in rough.stderr
    exact = thermap("readings", "withdraw", "--time", shown[:22] + "Z", "--yes")
    assert exact.stdout == "1 reading of 2026-03-01T06:00:00.250000Z withdrawn\n"
    assert client.readings("mcfv5050") == []


@pytest.mark.parametrize(
    "stated",
    [
        (),
        ("--from", iso(START)),
        ("--to", iso(START)),
        ("--time", iso(START), "--from", iso(START), "--to", iso(START)),
        ("--time", "yesterday"),
    ],
)
def test_readings_to_withdraw_are_stated_at_both_ends(thermap, client, measured, stated):
    found = thermap("readings", "withdraw", *stated, "--yes")
    assert (found.exit_code, found.stdout) == (2, "")
    assert len(client.readings("mcfv5050")) == 6


def test_a_span_of_readings_that_ends_before_it_begins(thermap, client, measured):
    span = ("--from", iso(START + timedelta(minutes=1)), "--to", iso(START))
    found = thermap("readings", "withdraw", *span, "--yes", columns=300)
    assert (found.exit_code, found.stdout) == (1, "")
    assert "expected a time not before 2026-03-01T06:01:00Z" in found.stderr


def test_readings_are_counted_before_they_are_withdrawn(
    start_on_terminal, service_url, client, measured
):
    span = ("--from", iso(START), "--to", iso(START + timedelta(minutes=3)))
    words = ("readings", "withdraw", *span, "--url", service_url)
    process, ours = start_on_terminal(24, 300, *words)
    asked = b""
    while b"[y/N]" not in asked:
        asked += os.read(ours, 1000)
    assert b"Withdraw 4 readings of 'mcfv5050' from 2026-03-01T06:00:00Z to" in asked
    os.write(ours, b"n\n")
    assert process.wait(60.0) == 1
    assert len(client.readings("mcfv5050")) == 6


def test_verifications(thermap, client, measured, tmp_path):
    listed = lines(thermap("verifications", "list"))
    assert listed[1].startswith("1 night shift 2026-03-01 06:00 to 06:04 5 EXX")
    # 10.5 … 10.9 µm were measured where the model says 10: mean 0.7, RMS √0.51 = 0.714 µm.
    residuals = lines(thermap("verifications", "residuals", "1"))
    assert any(line.startswith("EXX µm 5 +0.70 0.71") for line in residuals)
    page = tmp_path / "residuals.html"
    whole = thermap("verifications", "residuals", "--json", "-o", page)
    assert answered(whole)["components"][0]["mean"] == pytest.approx(0.7)
    assert page.read_text(encoding="utf-8").startswith("<!doctype html>")
    older = thermap("verifications", "residuals", "--model-version", "2", "--json")
    assert answered(older)["model_version"] == 2
    assert thermap("verifications", "residuals", "-o", tmp_path / "x.csv").exit_code == 2
    assert thermap("verifications", "residuals", "9").exit_code == 1


VISIT = "time,component,position_mm,direction,measured_um\n2026-03-01T06:00:00Z,EXX,250,+,10.3\n"


def test_a_verification_is_stored_without_an_analysis(thermap, client, tmp_path):
    for name in ("morning.csv", "copy.csv"):
        (tmp_path / name).write_text(VISIT, encoding="utf-8")
    shown = thermap("verifications", "store", tmp_path / "morning.csv", "--preview", columns=300)
    assert "zero absolute: the model's own; repeatability not stated" in shown.stdout
    assert "a preview, nothing was stored" in shown.stdout
    first = thermap("verifications", "store", tmp_path / "morning.csv", columns=300)
    assert (first.exit_code, first.stdout) == (0, "")
    assert "verification 'morning', number 1, 1 observation" in first.stderr
    assert "note: " not in first.stderr
    copied = thermap("verifications", "store", tmp_path / "copy.csv", columns=300)
    assert "note: verification 'morning' (number 1) has the same observations" in copied.stderr
    assert [one.label for one in client.verifications("mcfv5050")] == ["morning", "copy"]
    assert client.analyses("mcfv5050") == []
    (tmp_path / "wrong.csv").write_text(VISIT.replace("250", "2500"), encoding="utf-8")
    refused = thermap("verifications", "store", tmp_path / "wrong.csv", columns=300)
    assert refused.exit_code == 1
    assert "wrong.csv, line 2" in refused.stderr
    assert "got 2500 mm" in refused.stderr


def test_a_verification_among_maps_is_told_with_the_command_that_stores_it(
    thermap, client, tmp_path
):
    (tmp_path / "visit.csv").write_text(VISIT, encoding="utf-8")
    found = thermap("import", tmp_path / "visit.csv", "-m", "mcfv5050", columns=300)
    assert found.exit_code == 1
    assert f"`thermap verifications store {tmp_path / 'visit.csv'}` stores them" in found.stderr
    assert client.verifications("mcfv5050") == []


def test_residuals_without_a_verification(thermap):
    found = thermap("verifications", "residuals", columns=200)
    assert (found.exit_code, found.stdout) == (2, "")
    assert "has no verification yet; `thermap verifications store FILE " in found.stderr


@pytest.mark.slow
def test_analyses(thermap, client, measured, tmp_path):
    assert lines(thermap("analyses", "list")) == ["no analysis yet; `thermap analyse` asks for one"]
    number = client.analyse("mcfv5050", {"verifications": [measured]}).id
    assert thermap("analyses", "cancel", number).stdout in (
        f"analysis {number}: cancelled\n",
        f"analysis {number}: done\n",
    )
    listed = lines(thermap("analyses", "list"))
    assert listed[1].startswith(f"{number} 20")
    assert f"analysis {number}, cancelled" in lines(thermap("analyses", "show", number))
    assert answered(thermap("analyses", "show", number, "--json"))["id"] == number
    assert thermap("analyses", "delete", number).exit_code == 1
    assert thermap("analyses", "delete", number, "--yes").stdout == f"analysis {number} deleted\n"
    assert client.analyses("mcfv5050") == []
