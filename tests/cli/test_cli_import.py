"""thermap import: all files are checked, then sent, once each."""

import json
import re
from datetime import timedelta

import pytest

from tests.service_examples import MACHINE, START, error_map, reading

CSV = """\
# label: Run #7
# measured_at: 2026-03-01T06:00:00Z
# temperature x-middle: 34
# temperature z-column: 36
component,position_mm,error_um
EXX,0,0
EXX,500,70
EZZ,0,0
EZZ,500,140
"""


@pytest.fixture
def write(tmp_path):
    def write_file(name, content):
        file = tmp_path / name
        file.write_text(content if isinstance(content, str) else json.dumps(content))
        return file

    return write_file


def test_a_csv_map_is_stored_once(thermap, client, write):
    file = write("run-7.csv", CSV)
    first = thermap("import", file, "--machine", "mcfv5050")
    note = f"{file}: note: without a temperature, y-front cannot stand in for x-middle\n"
    assert (first.exit_code, first.stderr) == (0, note)
    number = client.error_maps("mcfv5050")[-1].id
    assert first.stdout.splitlines() == [
        f"{file}: would gain maps of EXX between 30 and 34 °C of x-middle",
        f"{file}: would gain maps of EZZ between 32 and 36 °C of z-column",
        f"{file}: error map 'Run #7' stored as number {number}, model version 4",
    ]
    second = thermap("import", file, "--machine", "mcfv5050")
    assert second.exit_code == 0
    assert second.stdout == f"{file}: error map 'Run #7' was there already, number {number}\n"
    assert len(client.models("mcfv5050")) == 4


def test_what_is_unusual_about_several_maps_is_said_once(thermap, write):
    """Every map has both components at one position."""
    files = []
    for i, (label, t_c) in enumerate((("Run #7", 34), ("Run #8", 38))):
        lines = [line for line in CSV.splitlines(keepends=True) if ",500," not in line]
        text = "".join(lines).replace("Run #7", label).replace("x-middle: 34", f"x-middle: {t_c}")
        files.append(write(f"{i}.csv", text.replace("z-column: 36", f"z-column: {t_c + 2}")))
    found = thermap("import", *files, "--machine", "mcfv5050", "--accept-losses")
    assert found.exit_code == 0, found.output
    said = [line for line in found.stderr.splitlines() if ": note: " in line]
    assert [line.removeprefix(f"{files[0]}: note: ") for line in said] == [
        "EXX, EZZ have one position each: their errors count as the same on the whole axis",
        "without a temperature, y-front cannot stand in for x-middle",
    ]


def test_a_wrong_file_keeps_the_right_ones_from_being_sent(thermap, client, write):
    right, wrong = write("right.csv", CSV), write("wrong.csv", CSV + "EYX,0,much\n")
    found = thermap("import", right, wrong, "--machine", "mcfv5050")
    assert (found.exit_code, found.stdout) == (1, "")
    assert found.stderr == (
        "thermap: no map or check was stored:\n"
        f"{wrong}, line 10, column 3 (error_um): expected a number in µm, got 'much'\n"
    )
    assert len(client.error_maps("mcfv5050")) == 3


def test_a_machine_with_maps_and_readings_in_any_order(thermap, client, write):
    readings = write("readings.json", [reading(START, 22.0), reading(START, 22.0)])
    maps = write("maps.json", [error_map("a", 20.0), error_map("b", 25.0)])
    machine = write("machine.json", MACHINE | {"id": "mill"})
    found = thermap("import", readings, maps, machine)
    assert (found.exit_code, found.stderr) == (0, "")
    assert found.stdout.splitlines() == [
        f"{machine}: machine mill stored",
        f"{readings}: 1 reading stored, 1 there already",
        f"{maps}: error map 'a' stored as number {client.error_maps('mill')[0].id}, "
        "model version 1",
        f"{maps}: would gain EXX, EBX, EZZ, SXY",
        f"{maps}: error map 'b' stored as number {client.error_maps('mill')[1].id}, "
        "model version 2",
    ]
    again = thermap("import", machine, maps)
    assert again.stdout.count("was there already") == 3


def test_what_the_service_answers_can_be_imported(thermap, client, write):
    machine = client.machine("mcfv5050").model_dump(mode="json") | {"id": "copy"}
    maps = [m.model_dump(mode="json", exclude_none=True) for m in client.error_maps("mcfv5050")]
    found = thermap("import", write("machine.json", machine), write("maps.json", maps))
    assert found.exit_code == 0, found.output
    copied = client.error_maps("copy")
    assert [m.components for m in copied] == [m.components for m in client.error_maps("mcfv5050")]


def test_a_machine_that_is_there_with_other_settings(thermap, write):
    file = write("machine.json", MACHINE | {"name": "Another"})
    found = thermap("import", file)
    assert found.exit_code == 1
    assert f"{file}: there is a machine 'mcfv5050' with other settings; change it by `thermap " in (
        found.stderr
    )


def test_what_is_there_otherwise_keeps_all_files_from_being_stored(thermap, client, write):
    first = write("first.csv", CSV)
    second = write("second.json", error_map("Run #1", 20.5))
    found = thermap("import", first, second, "--machine", "mcfv5050")
    assert (found.exit_code, found.stdout) == (1, "")
    why = "machine 'mcfv5050' has another error map 'Run #1' (number 1); choose another label"
    assert found.stderr.startswith(f"thermap: no map or check was stored:\n{second}: {why}")
    assert len(client.error_maps("mcfv5050")) == 3


def test_a_sensor_that_the_machine_lacks_is_found_before_anything_is_sent(thermap, client, write):
    right = write("right.csv", CSV)
    wrong = write("wrong.csv", CSV.replace("z-column", "bed"))
    found = thermap("import", right, wrong, "--machine", "mcfv5050")
    assert found.exit_code == 1
    assert found.stderr.startswith(
        "thermap: no map or check was stored:\n"
        f"{wrong}: temperatures_c.bed: machine 'mcfv5050' has no "
    )
    assert len(client.error_maps("mcfv5050")) == 3


def test_whose_map_it_is_has_to_be_said_once(thermap, write):
    unnamed = write("unnamed.csv", CSV)
    found = thermap("import", unnamed)
    assert found.exit_code == 2
    assert "does not say which machine" in found.stderr
    named = write("named.csv", "# machine: mcfv5050\n" + CSV)
    other = thermap("import", named, "--machine", "other")
    assert other.exit_code == 2
    assert thermap("import", named).exit_code == 0
    assert "was there already" in thermap("import", unnamed, THERMAP_MACHINE="mcfv5050").stdout


def test_flags_for_a_bare_table(thermap, client, write):
    bare = write("bare.csv", CSV[CSV.index("component") :])
    found = thermap(
        "import", bare, "-m", "mcfv5050", "--label", "bare", "--measured-at",
        "2026-03-01T06:00:00Z", "-t", "x-middle=40,5", "-t", "z-column=41",
    )  # fmt: skip
    assert found.exit_code == 0, found.output
    assert client.error_maps("mcfv5050")[-1].temperatures_c == {"x-middle": 40.5, "z-column": 41.0}


def test_warnings_of_the_service_are_seen(thermap, write):
    beyond = write("beyond.csv", CSV.replace("500", "600"))
    found = thermap("import", beyond, "-m", "mcfv5050")
    assert found.exit_code == 0
    assert "beyond the axis' travel" in found.stderr


def test_a_machine_is_stored_although_its_map_is_refused(thermap, client, write):
    """What was not stored is said of the map alone."""
    machine = write("m.json", '{"id": "m", "name": "M", "configuration": "XYFZ"}')
    found = thermap("import", machine, write("wrong.csv", CSV + "EYX,0,much\n"))
    assert (found.exit_code, found.stdout) == (1, f"{machine}: machine m stored\n")
    assert found.stderr.startswith("thermap: no map or check was stored:\n")
    assert client.machine("m").name == "M"
    assert client.error_maps("m") == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        ('{"id": "m",\n "name" }', ": expected JSON: expected `:` at line 2 column 9"),
        ('[{"id": "m", "id": "n"}]', ": expected each name once in an object, got id twice"),
        ("[]", ": expected a machine, an error map or readings, got an empty list"),
        ('[{"hello": 1}, 7]', ": entry 1: expected a machine (with configuration), an error map"),
        ('{"configuration": "XYFZ", "id": "m"}', ": name: expected a value, got nothing"),
        (json.dumps([reading(START, 20.0) | {"time": "noon"}]), ": 0.time: expected "),
        (json.dumps(error_map("a", 20.0, components=[{"component": "EXQ"}])), "components.0"),
    ],
)
def test_json_that_cannot_be_right(thermap, write, content, complaint):
    file = write("wrong.json", content)
    found = thermap("import", file, "-m", "mcfv5050")
    assert (found.exit_code, found.stdout) == (1, "")
    said = re.sub(r"^(nothing|no map or check) was stored:\n", "", found.stderr[len("thermap: ") :])
    assert said.startswith(str(file))
    assert complaint in said


def test_a_file_that_is_not_there(thermap, tmp_path):
    found = thermap("import", tmp_path / "no.csv", "-m", "mcfv5050")
    assert found.exit_code == 1
    assert "no.csv: No such file or directory" in found.stderr


SHORT = """\
# measured_at: 2026-03-01T06:00:00Z
component,position_mm,error_um
EXX,0,0
EXX,100,12
"""


def short_of(t_c):
    """A map of EXX from 0 to 100 mm, where the example's maps reach 500."""
    return f"# label: at {t_c}\n# temperature x-middle: {t_c}\n# temperature y-front: 20\n{SHORT}"


def test_what_tables_would_lose_is_shown_before_and_the_map_waits(thermap, client, write):
    file = write("short.csv", short_of(40))
    found = thermap("import", file, "-m", "mcfv5050")
    assert found.exit_code == 0
    told = found.stderr.splitlines()
    assert told[0].startswith(f"{file}: would lose EXX from 100 to 500 mm")
    assert told[1].startswith(f"{file}: model version 4 waits and tables stay as they are")
    assert "`thermap models activate 4 --machine mcfv5050` activates it all the same" in told[2]
    assert found.stdout.splitlines()[-1].startswith(f"{file}: error map 'at 40' stored as number")
    assert "/v1/" not in found.output
    machine = client.machine("mcfv5050")
    assert (machine.active_model, machine.waiting_model) == (3, 4)


def test_a_complete_map_is_not_blamed_for_what_waits_already(thermap, client, write):
    short = write("short.csv", short_of(40))
    assert thermap("import", short, "-m", "mcfv5050").exit_code == 0
    number = max(stored.id for stored in client.error_maps("mcfv5050"))
    whole = write("whole.csv", short_of(50).replace("EXX,100,12", "EXX,500,60"))
    found = thermap("import", whole, "-m", "mcfv5050")
    assert found.exit_code == 0
    first, waits, ways = found.stderr.splitlines()
    inherited = "version 4 waits already, with map 'at 40', and would lose EXX from 100 to 500 mm"
    assert first.startswith(f"{whole}: {inherited}")
    assert waits.startswith(f"{whole}: model version 5 waits and tables stay as they are, because")
    assert inherited in waits
    assert "they would lose" not in waits
    for way in (
        "`thermap models activate 5 --machine mcfv5050` activates it all the same",
        f"`thermap maps delete {number} --machine mcfv5050` takes map 'at 40' out of it",
        "`thermap models activate 3 --machine mcfv5050` gives up all that waits",
    ):
        assert way in ways
    assert thermap("maps", "delete", number, "-m", "mcfv5050", "--yes").exit_code == 0
    assert client.machine("mcfv5050").waiting_model is None
    assert {m.label: m.in_active_model for m in client.error_maps("mcfv5050")}["at 50"]


def test_short_maps_imported_one_after_another_are_activated_together(thermap, client, write):
    files = [write(f"{t_c}.csv", short_of(t_c)) for t_c in (35, 40, 45)]
    assert thermap("import", *files, "-m", "mcfv5050").exit_code == 0
    assert client.machine("mcfv5050").active_model == 3
    again = thermap("import", files[0], "-m", "mcfv5050", "--accept-losses")
    assert again.stdout.splitlines()[-1].endswith("; model version 6 is active")
    assert client.machine("mcfv5050").active_model == 6
    assert all(stored.in_active_model for stored in client.error_maps("mcfv5050"))


def test_a_preview_says_what_would_change_and_stores_nothing(thermap, client, write):
    client.store_readings("mcfv5050", reading(START, 40.0))
    file = write("run-7.csv", CSV)
    found = thermap("import", file, "-m", "mcfv5050", "--preview")
    assert f"{file}: read map ‘" in found.stdout
    assert f"{file}: read EXX: " in found.stdout
    assert found.exit_code == 0
    assert "would gain maps of EXX between 30 and 34 °C of x-middle" in found.stdout
    # At 40 °C tables are held at 30 °C (EXX 50 µm at 500 mm), then at 34 °C (70 µm).
    assert "EXX by +20.00 µm at 500 mm" in found.stdout
    assert "by more" not in found.stdout
    assert "nothing was stored" in found.stdout
    assert len(client.error_maps("mcfv5050")) == 3


def test_a_preview_says_what_would_have_changed_by_more_before(thermap, client, write):
    client.store_readings("mcfv5050", reading(START - timedelta(hours=1), 40.0))
    client.store_readings("mcfv5050", reading(START, 24.0))
    found = thermap("import", write("run-7.csv", CSV), "-m", "mcfv5050", "--preview")
    said = "of 2 recorded readings by more: EZZ by +40.00 µm at 500 mm, EXX by +20.00 µm at 500 mm "
    said += "(2026-03-01 "
    assert said + "05:00 UTC: x-middle 40.0 °C, " in found.stdout


def test_maps_of_a_machine_whose_sensors_nobody_assigned_are_told_of_once(thermap, write):
    """Neither sensor has the name of one that the chapter's components follow."""
    sensors = [{"name": "T1 bed"}, {"name": "column"}]
    machine = write("machine.json", MACHINE | {"id": "mill", "sensors": sensors})
    maps = write(
        "maps.json",
        [
            error_map(f"m{t}", t, temperatures_c={"T1 bed": t, "column": t + 1})
            for t in (20.0, 25.0)
        ],
    )
    found = thermap("import", machine, maps)
    assert found.exit_code == 0, found.output
    (note,) = [line for line in found.stderr.splitlines() if "no sensor is assigned" in line]
    assert "note: no sensor is assigned to EXX, EBX, EZZ, SXY: tables will not have them" in note
    assert "`thermap sensors assign`" in note
    shown = thermap("sensors", "show", "--machine", "mill")
    assert shown.stdout.strip() == "no sensor is assigned to any component yet"
    proposed = " ".join(thermap("sensors", "correlate", "--machine", "mill").stdout.split())
    assert "The maps do not tell the sensors of EXX, EBX, EZZ, SXY apart" in proposed
    assert "`thermap sensors assign EXX=SENSOR …`" in proposed
    assert "assigns as proposed" not in proposed


def test_a_sensor_that_the_maps_tell_from_others_is_proposed_with_its_command(thermap, write):
    """EXX moves by 1 µm/K with the bed; the column goes its own way."""
    sensors = [{"name": "T1 bed"}, {"name": "column"}]
    machine = write("machine.json", MACHINE | {"id": "mill", "sensors": sensors})
    of_column = (21.0, 19.0, 22.0, 20.0, 19.5, 21.5)
    maps = write(
        "maps.json",
        [
            error_map(f"m{n}", 20.0 + n, temperatures_c={"T1 bed": 20.0 + n, "column": t})
            for n, t in enumerate(of_column)
        ],
    )
    assert thermap("import", machine, maps).exit_code == 0
    proposed = " ".join(thermap("sensors", "correlate", "--machine", "mill").stdout.split())
    assert '`thermap sensors assign "EXX=T1 bed" ' in proposed
    assert "assigns as proposed" in proposed
    assert "do not tell" not in proposed
    applied = thermap("sensors", "correlate", "--apply", "--machine", "mill")
    assert applied.exit_code == 0, applied.output
    shown = thermap("sensors", "show", "--machine", "mill").stdout
    assert "T1 bed" in shown
    assert "EXX" in shown
    again = thermap("sensors", "correlate", "--apply", "--machine", "mill").stdout
    assert again.startswith("nothing to assign")
    assigned = thermap("sensors", "assign", "E*X=column", "--machine", "mill")
    assert assigned.exit_code == 0, assigned.output
    wrong = thermap("sensors", "assign", "E*A=column", "--machine", "mill")
    assert wrong.exit_code != 0
    assert "fits components of the machine's maps" in " ".join(wrong.output.split())
