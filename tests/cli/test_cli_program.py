"""thermap program: both files are written or none, and what was filled in is imported again."""

import pytest


def fill_with_zeros(path):
    """Write 0 for each reading of a map's file."""
    lines = path.read_text().splitlines()
    start = next(i for i, line in enumerate(lines) if not line.startswith("#"))
    missing = sum(name.endswith("_um") for name in lines[start].split(","))
    for i in range(start + 1, len(lines)):
        kept = lines[i].split(",")[:-missing]
        lines[i] = ",".join([*kept, *["0"] * missing])
    path.write_text("\n".join(lines))


@pytest.mark.parametrize(
    ("command", "method", "name"),
    [
        (("positioning", "--axis", "x", "--targets", "5"), "positioning", "POSX"),
        (("step-diagonal", "--steps", "3"), "step-diagonal", "STEPDIA"),
        (("body-diagonal", "--steps", "3"), "body-diagonal", "BODYDIA"),
    ],
)
def test_a_program_and_its_readings(thermap, tmp_path, command, method, name):
    folder = tmp_path / "out"
    wanted = (command[0], "mcfv5050", *command[1:], "-c", "heidenhain", "--output", folder)
    found = thermap("program", *wanted)
    assert (found.exit_code, found.stderr) == (0, "")
    assert sorted(path.name for path in folder.iterdir()) == [f"{name}.H", f"{name}.csv"]
    assert (folder / f"{name}.H").read_text().startswith(f"0 BEGIN PGM {name} MM\n")
    assert f"thermap import --method {method} {folder / name}.csv" in found.stdout.replace("\n", "")
    readings = ("import", "--method", method, folder / f"{name}.csv", "--evaluate-only")
    empty = thermap(*readings)
    assert (empty.exit_code, "got none" in empty.stderr) == (1, True)
    fill_with_zeros(folder / f"{name}.csv")
    assert thermap(*readings).exit_code == 0
    stored = thermap(*readings[:-1])
    assert stored.exit_code == 1
    assert "expected a label" in stored.stderr
    again = thermap("program", *wanted)
    assert (again.exit_code, "nothing was written" in again.stderr) == (1, True)


def test_a_warm_up_with_its_options(thermap, tmp_path):
    found = thermap(
        "program", "warm-up", "mcfv5050", "-c", "fanuc", "--spindle", "4000=10",
        "--spindle", "8000=10", "--cooling", "10", "--place", "250,200,100", "--every", "10",
        "--start", "2026-03-01T07:00:00+01:00", "--output", tmp_path,
    )  # fmt: skip
    assert found.exit_code == 0
    assert "4 readings" in found.stdout
    readings = tmp_path / "WARMUP.csv"
    lines = [line.split(",") for line in readings.read_text().splitlines()]
    # With a label and values it is a drift test.
    rows = [[cell or "21.5" for cell in line] for line in lines if line[0].startswith("2026")]
    assert len(rows) == 4
    head = [",".join(line).replace("label: ", "label: warm-up") for line in lines[: -len(rows)]]
    readings.write_text("\n".join([*head, *(",".join(row) for row in rows)]))
    found = thermap("import", "--method", "thermal-drift", readings, "--evaluate-only")
    assert found.exit_code == 0, found.stderr
    assert "d_Z_running" in found.stdout
    wrong = ("program", "warm-up", "mcfv5050", "-c", "fanuc", "--place", "250,200,100")
    assert thermap(*wrong, "--spindle", "fast=10").exit_code == 2


def test_a_moving_axis_with_its_options(thermap, tmp_path):
    found = thermap(
        "program", "moving-axis", "mcfv5050", "-c", "siemens", "--axis", "X", "--moving", "12000=5",
        "--moving", "6000=5", "--cooling", "10", "--from", "50", "--to", "450", "--every", "5",
        "--at", "60,440", "--line", "y=100", "--start", "2026-03-01T07:00:00+01:00",
        "--output", tmp_path,
    )  # fmt: skip
    assert found.exit_code == 0, found.stderr
    assert "12000 mm/min for 5 min, 6000 mm/min for 5 min, 0 mm/min for 10 min" in found.stdout
    text = (tmp_path / "MOVEX.MPF").read_text()
    # 400 mm: 30 strokes a minute at 12 m/min, 15 at 6 m/min, in pairs.
    assert text.count("SUPA G1 X450.000 F12000.0") == 75
    assert text.count("SUPA G1 X50.000 F6000.0") == 38
    readings = tmp_path / "MOVEX.csv"
    lines = readings.read_text().splitlines()
    rows = [line.split(",") for line in lines if line.startswith("2026-03-01T06:")]
    assert len(rows) == 4 * 5  # cold, two steps, twice in the cooling
    assert [row[3:5] for row in rows[:4]] == [
        ["60.0", "+"],
        ["440.0", "+"],
        ["440.0", "-"],
        ["60.0", "-"],
    ]
    wrong = ("program", "moving-axis", "mcfv5050", "-c", "siemens", "--axis", "x")
    assert thermap(*wrong, "--moving", "fast=10").exit_code == 2
    assert "lower to a higher position" in thermap(
        *wrong, "--moving", "9000=5", "--from", "450", "--to", "50"
    ).stderr.replace("\n", " ")


def test_a_visit_of_planned_observations(thermap, tmp_path):
    planned = tmp_path / "planned.csv"
    planned.write_text(
        "# label: Monday\ntime,component,position_mm,direction\n"
        "2026-03-01T06:00:00Z,EXX,250,+\n2026-03-01T06:01:00Z,SXY,,\n"
    )
    found = thermap(
        "program", "visit", "mcfv5050", planned, "-c", "siemens", "--output", tmp_path / "out"
    )
    assert found.exit_code == 0
    assert "SXY: no position" in found.stderr
    assert "SUPA G1 X250.000" in (tmp_path / "out" / "VISIT.MPF").read_text()


def test_what_is_refused_writes_nothing(thermap, tmp_path):
    wanted = ("program", "positioning", "mcfv5050", "--output", tmp_path / "out")
    for words, said in (
        (("--axis", "x", "-c", "okuma"), "siemens, heidenhain, fanuc, linuxcnc, got 'okuma'"),
        (("--axis", "x", "-c", "fanuc", "--at", "0,100"), "got X -5 mm, 5.000 mm beyond 0 mm"),
        (("--axis", "w", "-c", "fanuc"), "got 'w'"),
    ):
        found = thermap(*wanted, *words)
        assert found.exit_code == 1
        assert said in " ".join(found.stderr.split())
    assert thermap(*wanted, "--axis", "x", "-c", "fanuc", "--at", "0;1").exit_code == 2
    assert not (tmp_path / "out").exists()
    shown = thermap(*wanted[:3], "--axis", "x", "-c", "fanuc")
    assert "written nowhere: state --output FOLDER" in shown.stdout
