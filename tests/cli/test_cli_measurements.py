"""thermap import --method and thermap simulate: readings to maps, maps to readings.

What each method computes is tested in tests/measurement, its files in
tests/files/test_csv_measurements.py; here is what the command line does with both.
"""

import json
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from app.api.methods.registry import METHODS
from app.cli.measurement_view import figure_text
from tests.files.test_csv_measurements import EXAMPLES
from tests.files.test_renishaw_rtl import BOTH_WAYS
from tests.service_examples import START, iso, reading, temperatures

HOT = ("-t", "x-middle=25.5", "-t", "z-column=27.5", "--missing-as-zero")

STATE = """\
# label: Measured
# measured_at: 2026-03-01T06:00:00Z
# temperature x-middle: 50
# temperature y-front: 49
# temperature z-column: 52
# temperature spindle: 55
"""

POSITIONING = EXAMPLES["positioning"][0]


@pytest.fixture
def write(tmp_path):
    def write_file(name, content):
        file = tmp_path / name
        file.write_text(content if isinstance(content, str) else json.dumps(content))
        return file

    return write_file


def words(text):
    """Lines with single blanks."""
    return [" ".join(line.split()) for line in text.splitlines()]


@pytest.mark.slow
def test_a_measurement_is_stored_once_and_shown(thermap, client, write):
    """The means by hand: forward 0.05 and 1.3 µm, backward −0.75 and −0.2 µm."""
    file = write("x.csv", STATE + POSITIONING)
    first = thermap("import", "--method", "positioning", file, "-m", "mcfv5050", "--accept-losses")
    assert first.exit_code == 0
    assert first.stderr.startswith(f"{file}: would lose EXX from 100 to 500 mm")
    stored = client.error_maps("mcfv5050")[-1]
    lines = words(first.stdout)
    assert f"{file}: error map 'Measured' stored as number {stored.id}, model version 4" in lines
    (entry,) = stored.components
    assert entry.errors_um == pytest.approx([0.05, 1.3])
    assert entry.backward_errors_um == pytest.approx([-0.75, -0.2])
    up, down = (
        f"{max(errors):.2f}"
        for errors in (entry.standard_errors_um, entry.backward_standard_errors_um)
    )
    assert f"EXX + D_x(x) +0.05 +1.30 {up} µm 2: x 0 to 100 mm" in lines
    assert f"EXX - D_x(x) -0.75 -0.20 {down} µm 2: x 0 to 100 mm" in lines
    assert "B_um 1.5 µm" in lines
    assert "noise_degrees_of_freedom 2" in lines
    assert "note: ISO 230-2 asks for at least 5 targets here, got 2." in lines
    second = thermap("import", "--method", "positioning", file, "-m", "mcfv5050")
    assert words(second.stdout)[0] == (
        f"{file}: error map 'Measured' was there already, number {stored.id}"
    )
    assert len(client.error_maps("mcfv5050")) == 4


@pytest.mark.slow
@pytest.mark.parametrize("columns", [80, 140])
@pytest.mark.parametrize("method", METHODS)
def test_each_method_is_evaluated_without_a_thermal_state(thermap, client, write, method, columns):
    file = write("readings.csv", EXAMPLES[method][0])
    found = thermap(
        "import", "--method", method, file, "-m", "mcfv5050", "--evaluate-only", columns=columns
    )
    assert (found.exit_code, found.stderr) == (0, "")
    lines = words(found.stdout)
    assert lines[0] == f"{file}: {method} evaluated, nothing stored"
    assert max(map(len, found.stdout.splitlines()[1:])) <= columns
    assert len(client.error_maps("mcfv5050")) == 3
    answer = json.loads(
        thermap(
            "import", "--method", method, file, "-m", "mcfv5050", "--evaluate-only", "--json"
        ).stdout
    )
    for component in answer["components"]:
        assert any(line.startswith(component["component"]) for line in lines)
    for name, value in answer["figures"].items():
        assert any(line.startswith(f"{name} {figure_text(value)}") for line in lines)
    assert sum(line.startswith("note: ") for line in lines) == len(answer["notes"])


def test_squareness_is_one_value_and_an_unknown_uncertainty_is_a_dash(thermap, write):
    file = write("bd.csv", EXAMPLES["body-diagonal"][0])
    found = thermap("import", "--method", "body-diagonal", file, "-m", "mcfv5050",
                    "--evaluate-only")  # fmt: skip
    # Means of both directions, end less start: 1.15, −0.75, 0.5, 0.6 µm over 70.7 mm.
    sxy = 5000 / 70.7 * (1.15 + 0.75 - 0.5 + 0.6) / (4 * 50 * 40) * 1000
    assert f"SXY S_xy {sxy:+.2f} – µm/m" in words(found.stdout)


def test_one_position_and_one_standard_error(thermap, write):
    body = {"axis": "x", "positions_mm": [250], "linear_um": [1.5], "repeatability_um": 0.3}
    file = write("six.json", body)
    found = thermap("import", "--method", "six-dof", file, "-m", "mcfv5050", "--evaluate-only")
    assert "EXX D_x(x) +1.50 +1.50 0.30 µm x 250 mm" in words(found.stdout)


def test_json_is_the_services_own_a_line_for_each_file(thermap, client, write):
    header = {"measured_at": iso(START), "instrument": "laser"}
    bodies = [
        EXAMPLES["positioning"][1] | header | {"label": label, "temperatures_c": temperatures(t_c)}
        for label, t_c in (("one", 50.0), ("two", 55.0))
    ]
    files = [write(f"{i}.json", body) for i, body in enumerate(bodies)]
    found = thermap("import", "--method", "positioning", *files, "-m", "mcfv5050", "--json")
    assert (found.exit_code, found.stderr) == (0, "")
    answers = [json.loads(line) for line in found.stdout.splitlines()]
    stored = client.error_maps("mcfv5050")[-2:]
    assert [m.label for m in stored] == ["one", "two"]
    assert [a["map_id"] for a in answers] == [m.id for m in stored]
    assert answers[0]["targets"][1]["mean_forward_um"] == pytest.approx(1.3)


def test_the_command_line_goes_before_the_files(thermap, client, write):
    options = ("--label", "bare", "--measured-at", iso(START), "-t", "x-middle=50,5")
    body = EXAMPLES["positioning"][1] | {"label": "other", "temperatures_c": {"z-column": 52}}
    for file in (write("bare.csv", POSITIONING), write("body.json", body)):
        found = thermap("import", "--method", "positioning", file, "-m", "mcfv5050", *options,
                        "-t", "z-column=52")  # fmt: skip
        assert found.exit_code == 0, found.output
    stored = client.error_maps("mcfv5050")[-1]
    assert (stored.label, stored.temperatures_c) == ("bare", {"x-middle": 50.5, "z-column": 52.0})
    assert "'bare' was there already" in found.stdout


def test_without_a_thermal_state_nothing_can_be_stored(thermap, client, write):
    files = [write("bare.csv", POSITIONING), write("bare.json", EXAMPLES["positioning"][1])]
    found = thermap("import", "--method", "positioning", *files, "-m", "mcfv5050")
    assert (found.exit_code, found.stdout) == (1, "")
    csv, body = files
    assert found.stderr.startswith(
        f"thermap: no map or check was stored:\n{csv}: expected a label, got"
    )
    for what, option in (
        ("a label", "--label"),
        ("every sensor's temperature in °C", "--temperature"),
    ):
        assert f"{body}: expected {what}, got none: state it or give {option}\n" in found.stderr


def test_a_file_of_another_method_says_which_columns_it_lacks(thermap, write):
    file = write("positioning.csv", "# origin_mm: 0 0 0\n# step_mm: 1 1 1\n" + POSITIONING)
    found = thermap("import", "--method", "step-diagonal", file, "-m", "mcfv5050",
                    "--evaluate-only")  # fmt: skip
    assert found.exit_code == 1
    assert (
        f"{file}, line 4: expected the columns diagonal, after_x_um, after_y_um, after_z_um"
        in found.stderr
    )


def test_what_a_method_refuses_in_one_file_keeps_all_from_being_stored(thermap, client, write):
    """Two diagonals are too few, which only the method knows."""
    right = write("right.csv", STATE + EXAMPLES["step-diagonal"][0])
    rows = EXAMPLES["step-diagonal"][0].splitlines()
    few = "\n".join(row for row in rows if not row.startswith(("pnp", "ppn")))
    wrong = write("wrong.csv", STATE.replace("Measured", "Few") + few)
    found = thermap("import", "--method", "step-diagonal", right, wrong, "-m", "mcfv5050")
    assert (found.exit_code, found.stdout) == (1, "")
    assert found.stderr.startswith(
        f"thermap: no map or check was stored:\n{wrong}: diagonals: expected"
    )
    assert len(client.error_maps("mcfv5050")) == 3


def test_remarks_of_the_reader_are_seen(thermap, write):
    file = write("x.csv", POSITIONING.replace("deviation_mm", "deviation_mm,operator"))
    found = thermap("import", "--method", "positioning", file, "-m", "mcfv5050",
                    "--evaluate-only")  # fmt: skip
    assert found.stderr == f"{file}: note: columns that are not read: operator\n"


def test_the_machine_is_named_by_the_file_or_the_option(thermap, write):
    unnamed = write("unnamed.csv", POSITIONING)
    named = write("named.csv", "# machine: mcfv5050\n" + POSITIONING)
    asked = ("import", "--method", "positioning", "--evaluate-only")
    assert thermap(*asked, named).exit_code == 0
    without = thermap(*asked, unnamed)
    assert without.exit_code == 2
    assert "does not say which machine" in without.stderr
    nobody = thermap(*asked, unnamed, "-m", "nobody")
    assert nobody.exit_code == 1
    assert "mcfv5050" in nobody.stderr


@pytest.mark.parametrize(
    ("arguments", "exit_code", "said"),
    [
        (("--method", "dowsing"), 1, "expected one of positioning, six-dof, step-diagonal, "
         "body-diagonal, machined-part, drilled-plate, rotary-axis, thermal-drift, got 'dowsing'"),
        (("--method", "positioning", "other.csv", "--label", "one"), 2, "names one map"),
        (("--as", "both"), 2, "with --method thermal-drift"),
    ],
)  # fmt: skip
def test_wrong_usage_is_told(thermap, write, arguments, exit_code, said):
    found = thermap("import", write("x.csv", POSITIONING), "-m", "mcfv5050", *arguments)
    assert found.exit_code == exit_code
    assert said in " ".join(found.stderr.replace("│", " ").split())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        ('{"axis": "x",\n "targets_mm" }', ": expected JSON, got none: expected `:` at line 2"),
        ({"axis": "x", "targets_mm": [0, 1]}, ": forward_um: expected a value in µm, got nothing"),
    ],
)  # fmt: skip
def test_json_that_cannot_be_right(thermap, write, content, complaint):
    file = write("wrong.json", content)
    found = thermap("import", "--method", "positioning", file, "-m", "mcfv5050",
                    "--evaluate-only")  # fmt: skip
    assert (found.exit_code, found.stdout) == (1, "")
    assert found.stderr.startswith(f"thermap: no map or check was stored:\n{file}{complaint}")


def test_the_sources_points_of_its_a_axis_turn_about_y_and_are_refused(thermap, write):
    """Hsieh 2024, Table 2: the circle of G0, G3 and G4, of which Table 3 takes the A axis.

    Its plane is y = 104.79 mm; from its centre G3 and G4 lie −86 and −42.6° from G0.
    """
    places = [[0.311, 104.794, -183.893], [-104.1525, 104.791, -284.729],
              [-71.3045, 104.791, -213.293]]  # fmt: skip
    assert np.ptp(places, axis=0).round(3).tolist() == [104.464, 0.003, 100.836]
    points = [{"angle_deg": angle, "position_mm": place}
              for angle, place in zip([0, -85.973, -42.636], places, strict=True)]  # fmt: skip
    file = write("a.json", {"axis": "A", "points": points})
    found = thermap("import", "--method", "rotary-axis", file, "-m", "mcfv5050",
                    "--evaluate-only")  # fmt: skip
    assert (found.exit_code, found.stdout) == (1, "")
    assert "1.56 rad; perhaps it is the B axis" in found.stderr


@pytest.mark.parametrize(
    "arguments",
    [("import", "--method", "positioning", "-m", "mill"),
     ("simulate", "step-diagonal", "mill", "-o", "laser.csv")],
)  # fmt: skip
def test_nobody_listens(run, no_service_url, write, monkeypatch, tmp_path, arguments):
    file = write("x.csv", STATE + POSITIONING)
    monkeypatch.chdir(tmp_path)
    files = [file] if arguments[0] == "import" else []
    found = run(*arguments, *files, "--url", no_service_url)
    assert found.exit_code == 1
    assert found.stderr.endswith("is `thermap serve` running there?\n")
    assert not (tmp_path / "laser.csv").exists()


# -- thermap simulate ----------------------------------------------------------------------


RIGID = ("simulate", "step-diagonal", "rigid", "-t", "x-middle=22", "-t", "z-column=24",
         "--missing-as-zero")  # fmt: skip


def test_written_and_read_it_is_what_the_service_said(thermap, client, tmp_path):
    """Noise, a coarse resolution, a tilted mirror, thirds of a millimetre, a tool."""
    file = tmp_path / "laser.csv"
    found = thermap(
        "simulate", "step-diagonal", "mcfv5050", *HOT, "--tool", "0,0,160.5", "--steps", 7,
        "--origin", "10,20,30", "--step", "33.3333333333333,40,50", "--noise", 0.3,
        "--resolution", 0.0137, "--seed", 3, "--mirror-tilt", "ppn=10,-5.5", "--target",
        "flat-mirror", "-o", file,
    )  # fmt: skip
    assert found.exit_code == 0, found.output
    plan = {
        "temperatures_c": {"x-middle": 25.5, "z-column": 27.5},
        "missing_components": "zero",
        "tool_offset_mm": [0, 0, 160.5],
        "steps": 7,
        "origin_mm": [10, 20, 30],
        "step_mm": [33.3333333333333, 40, 50],
        "noise_um": 0.3,
        "resolution_um": 0.0137,
        "seed": 3,
        "mirror_tilts_urad": {"ppn": [10, -5.5]},
        "target": "flat-mirror",
    }
    said = client.simulate_step_diagonal("mcfv5050", plan)
    read = METHODS["step-diagonal"].read(file.read_text(encoding="utf-8"), complete=True)
    (unread,) = read.remarks
    assert (read.machine, unread[:33]) == ("mcfv5050", "comment lines that are not read: ")
    age = datetime.now(UTC) - datetime.fromisoformat(read.body["measured_at"])
    assert timedelta(0) <= age < timedelta(minutes=5)
    assert read.body["label"] == "laser"
    assert read.body["instrument"] == "simulation"
    for name in ("origin_mm", "step_mm", "tool_offset_mm", "target", "temperatures_c"):
        assert read.body[name] == getattr(said, name)
    for diagonal, rows in said.diagonals.items():
        np.testing.assert_allclose(read.body["diagonals"][diagonal], rows, rtol=0, atol=5.1e-7)
    sent = {name: getattr(said, name) for name in ("origin_mm", "step_mm", "tool_offset_mm",
                                                   "target", "diagonals")}  # fmt: skip
    theirs = client.measure("mcfv5050", "step-diagonal", sent)
    ours = client.measure("mcfv5050", "step-diagonal", read.body)
    assert ours.figures.keys() == theirs.figures.keys()
    for one, other in zip(ours.components, theirs.components, strict=True):
        for field in ("errors_um", "standard_errors_um", "value_um_per_m"):
            if getattr(other, field) is not None:
                np.testing.assert_allclose(getattr(one, field), getattr(other, field), atol=1e-4)


def test_the_file_says_that_it_is_simulated(thermap, tmp_path):
    file = tmp_path / "laser.csv"
    thermap("simulate", "step-diagonal", "mcfv5050", *HOT, "-o", file, "--label", "Training",
            "--noise", 0.2, "--seed", 4)  # fmt: skip
    comments = [line for line in file.read_text().splitlines() if line.startswith("#")]
    assert comments[0] == "# label: Training"
    assert "# Simulated from model version 3, for training, not measured" in comments
    assert "# Simulated with noise of 0.2 µm (seed 4)" in comments
    assert any(c.startswith("# No two maps have EYX") for c in comments)


@pytest.mark.slow
def test_at_the_latest_reading(thermap, client, tmp_path):
    file = tmp_path / "laser.csv"
    asked = ("simulate", "step-diagonal", "mcfv5050", "--missing-as-zero", "-o", file)
    found = thermap(*asked)
    assert found.exit_code == 1
    assert "no reading yet" in found.stderr
    assert not file.exists()
    client.store_readings("mcfv5050", reading(datetime.now(UTC), 22.0))
    assert thermap(*asked).exit_code == 0
    body = METHODS["step-diagonal"].read(file.read_text(encoding="utf-8")).body
    assert body["temperatures_c"]["x-middle"] == 22.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((), "--output"),
        (("-o", "laser.json"), "expected a CSV file"),
        (("-o", "no/such/folder/laser.csv"), "cannot write"),
        (("-o", "laser.csv", "--origin", "1,2"), "X,Y,Z in mm, such as 0,0,0, got '1,2'"),
        (("-o", "laser.csv", "--step", "a,b,c"), "X,Y,Z in mm, such as 50,50,40"),
        (("-o", "laser.csv", "--target", "cube"), "expected one of 'point', 'flat-mirror'"),
        (("-o", "laser.csv", "--label", 'in "quotes"'), "expected a name in one line"),
        (("-o", "laser.csv", "--mirror-tilt", "nnn=1,2"), "expected one of ppp, "),
        (("-o", "laser.csv", "--mirror-tilt", "ppp=1"), "expected DIAGONAL=A,B with two angles"),
        (("-o", "laser.csv", "--mirror-tilt", "ppp=1,2", "--mirror-tilt", "ppp=1,2"), "twice"),
    ],
)
def test_wrong_usage_of_simulate_is_told(thermap, tmp_path, monkeypatch, arguments, said):
    monkeypatch.chdir(tmp_path)
    found = thermap("simulate", "step-diagonal", "mcfv5050", *HOT, *arguments)
    assert found.exit_code == 2, found.output
    assert said in " ".join(found.stderr.replace("│", " ").split())
    assert list(tmp_path.iterdir()) == []


def test_what_the_service_refuses_is_told_in_its_words(thermap, tmp_path):
    file = tmp_path / "laser.csv"
    beyond = thermap("simulate", "step-diagonal", "mcfv5050", *HOT, "--step", "99,9,9", "-o", file)
    assert beyond.exit_code == 1
    assert "inside x 0 to 500 mm" in beyond.stderr
    missing = thermap("simulate", "step-diagonal", "mcfv5050", *HOT[:-1], "-o", file)
    assert missing.exit_code == 1
    assert "EYX" in missing.stderr
    assert not file.exists()


def test_an_instruments_file_is_imported(thermap, tmp_path):
    path = tmp_path / "cold.rtl"
    path.write_text(BOTH_WAYS, encoding="cp1252")
    looked = thermap("import", path, "--machine", "mcfv5050", "--evaluate-only")
    assert looked.exit_code == 0
    assert "compare the first value" in " ".join(looked.stderr.split())
    lacking = thermap("import", path, "--machine", "mcfv5050")
    assert lacking.exit_code == 1
    assert "--measured-at" in lacking.stderr
    stated = ("--measured-at", "2026-03-01T06:30:00Z", "-t", "x-middle=35", "-t", "z-column=36")
    stored = thermap("import", path, "--machine", "mcfv5050", *stated, "--label", "rtl")
    assert stored.exit_code == 0
    assert "error map 'rtl' stored" in stored.stdout
    other = thermap("import", path, "-m", "mcfv5050", "--method", "six-dof")
    assert other.exit_code == 1
    assert "expected positioning, which" in " ".join(other.stderr.split())


@pytest.mark.parametrize("options", [("--evaluate-only",), ("--axis", "x")])
def test_what_goes_with_readings_alone_is_refused_of_a_map(thermap, write, options):
    file = write("map.csv", STATE + "component,position_mm,error_um\nEXX,0,0\nEXX,500,8\n")
    found = thermap("import", file, "-m", "mcfv5050", *options)
    assert found.exit_code == 1
    assert "expected with readings alone, but map.csv holds a map".replace(
        "map.csv", str(file)
    ) in (" ".join(found.stderr.split()))
