"""thermap import --method thermal-drift, and thermap simulate thermal-drift before it."""

from datetime import timedelta

import pytest

from app.api.methods.registry import METHODS
from app.files.delimited_text import UnreadableFile
from tests.service_examples import START, reading

HEAD = "# test: spindle\n# point_mm: 250, 200, 300\n# label: Warm-up\n"
ROWS = (
    "time,z_um,temperature x-middle,temperature y-front,temperature z-column,temperature spindle\n"
    "2026-03-01T02:00:00Z,0,21,20,23,26\n"
    "2026-03-01T04:00:00Z,8,25,24,27,30\n"
)


def read(text):
    return METHODS["thermal-drift"].read(text).body


@pytest.fixture
def warmed(client):
    """Five hours of readings every two minutes, x-middle from 20 to 30 °C; the spindle turns."""
    client.store_readings(
        "mcfv5050",
        [
            reading(
                START - timedelta(minutes=300 - 2 * i),
                20.0 + i / 15.0,
                state={"spindle_rpm": 6000.0},
            )
            for i in range(151)
        ],
    )


def test_what_is_simulated_comes_out_again(thermap, client, warmed, tmp_path):
    """EXX + EBX·T, EZZ of the model, and 12 µm in Z that the model lacks."""
    file = tmp_path / "drift.csv"
    found = thermap(
        *("simulate", "thermal-drift", "mcfv5050", "--point", "250,200,100", "--noise", 0),
        *("--tool", "0,0,160", "--sensor-distance", 100, "--growth", "z=12", "--missing-as-zero"),
        *("-o", file),
    )
    assert (found.exit_code, found.stderr) == (0, "")
    assert found.stdout == f"{file}: 151 readings over 5 h, simulated\n"
    body = read(file.read_text())
    # 10 K more: EXX 0.01 µm/mm/K, EBX 10 µrad/K over 500 mm on arms of z and the tool, and SXY
    # −1 µm/m/K over y = 200 mm.
    tilt = 10 * 10 * 250 / 500 / 1000
    last = body["readings"][-1]
    assert last["x_um"] == pytest.approx(10 * 2.5 + tilt * (100 + 160) - 10 * 0.2, abs=1e-3)
    assert last["x2_um"] - last["x_um"] == pytest.approx(tilt * 100, abs=1e-3)
    grown = 12 * (1 - 2.718281828 ** (-300 / 40))
    assert last["z_um"] == pytest.approx(10 * 2 - tilt * 250 + grown, abs=1e-3)
    assert last["temperatures_c"]["x-middle"] == 30.0
    assert last["state"] == {"spindle_rpm": 6000.0}
    kept = thermap("import", "--method", "thermal-drift", file, "--as", "verification")
    assert kept.exit_code == 0, kept.output
    # The readings are those that the machine has: the same content is a duplicate.
    assert "151 observations of points, and 0 new readings of the temperatures" in " ".join(
        kept.stdout.split()
    )
    (stored,) = client.verifications("mcfv5050")
    assert (stored.label, str(stored.datum)) == ("drift", "first")


def test_a_moving_axis_is_read_at_its_targets_in_turn(thermap, warmed, tmp_path):
    file = tmp_path / "axis.csv"
    found = thermap(
        *("simulate", "thermal-drift", "mcfv5050", "--point", "0,0,0", "--noise", 0, "-o", file),
        *("--test", "linear-axis", "--axis", "x", "--target", 100, "--target", 400, "--every", 10),
        "--missing-as-zero",
    )
    assert found.exit_code == 0, found.output
    body = read(file.read_text())
    assert [r["position_mm"] for r in body["readings"][:3]] == [100.0, 400.0, 100.0]
    shown = thermap("import", "--method", "thermal-drift", file, "--evaluate-only")
    assert "X_slope_change_um_per_m" in shown.stdout
    assert "nothing stored" in shown.stdout


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--test", "dance"), "expected one of 'environment', 'spindle', 'linear-axis'"),
        (("--test", "linear-axis", "--axis", "x"), "--target"),
        (("--axis", "x"), "--target"),
        (("--growth", "c=3"), "expected x, y or z, got c"),
    ],
)
def test_what_cannot_be_simulated_is_refused(run, tmp_path, options, said):
    found = run(
        "simulate", "thermal-drift", "m", "--point", "0,0,0", "-o", tmp_path / "x.csv", *options,
        columns=200,
    )  # fmt: skip
    assert found.exit_code == 2
    assert said in " ".join(found.output.split())


def test_maps_of_states_are_stored_and_each_named(thermap, client, tmp_path):
    file = tmp_path / "warm.csv"
    file.write_text(HEAD + "# components: z=EZY\n" + ROWS)
    found = thermap("import", "--method", "thermal-drift", file, "-m", "mcfv5050", "--as", "both")
    assert found.exit_code == 0, found.output
    labels = [m.label for m in client.error_maps("mcfv5050")][-2:]
    assert labels == ["Warm-up, 0 min", "Warm-up, 120 min"]
    for label in labels:
        assert f"error map '{label}' stored as number" in found.stdout
    told = " ".join(found.stdout.split())
    assert "verification 'Warm-up' stored as number" in told
    assert "are the same readings, so that comparing them shows nothing" in told
    again = thermap("import", "--method", "thermal-drift", file, "-m", "mcfv5050", "--as", "both")
    assert again.exit_code == 0, again.output
    told = " ".join(again.stdout.split())
    assert " stored as number" not in told
    assert "verification 'Warm-up' was there already, number" in told
    assert "0 new readings of the temperatures" in told


def test_a_preview_of_a_verification_is_refused(thermap, tmp_path):
    file = tmp_path / "warm.csv"
    file.write_text(HEAD + ROWS)
    asked = ("import", "--method", "thermal-drift", file, "-m", "mcfv5050", "--preview")
    found = thermap(*asked, "--as", "verification", columns=200)
    assert found.exit_code == 2
    assert "a verification changes none" in " ".join(found.stderr.split())


def test_a_file_for_maps_needs_a_label_and_no_temperature_of_its_own():
    with pytest.raises(UnreadableFile) as caught:
        METHODS["thermal-drift"].read(HEAD.replace("# label: Warm-up\n", "") + ROWS, complete=True)
    assert caught.value.detail.splitlines() == [
        "measurement.csv: expected a label, got none: write `# label: Run #1` or give --label"
    ]


@pytest.mark.parametrize(
    ("heading", "name"),
    [
        ("temperature z-column", "z-column"),
        ("Temperature: z-column [°C]", "z-column"),
        ("temperature z-column_c", "z-column"),
        ("temperature tc07 (C)", "tc07"),
        ("temperature nut °C", "nut"),
    ],
)
def test_a_sensors_column_is_named_after_it(heading, name):
    text = f"{HEAD}time,z_um,{heading}\n2026-03-01T02:00:00Z,0,21\n2026-03-01T04:00:00Z,8,25\n"
    assert read(text)["readings"][0]["temperatures_c"] == {name: 21.0}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (ROWS.replace("x-middle", "x-middle [°F]"), "expected temperatures in °C"),
        (ROWS.replace(",8,", ",,"), "expected z in µm, got none"),
        (ROWS.replace("04:00:00Z", "04:00:00"), "expected a time with its zone"),
        (ROWS.replace("y-front", "x-middle"), "expected each temperature in one column"),
        ("# states_min: soon\n" + ROWS, "expected minutes such as 0, 60, 240, got 'soon'"),
        ("# components: EZZ\n" + ROWS, "expected components such as x=EXX, z=EZZ"),
        ("# running_to: noon\n" + ROWS, "expected a time with its zone"),
    ],
)
def test_what_is_wrong_in_a_file_is_named(text, said):
    with pytest.raises(UnreadableFile) as caught:
        read(HEAD + text)
    assert said in caught.value.detail


def test_only_a_drift_test_is_kept_as_a_verification(run, tmp_path):
    found = run("import", "--method", "six-dof", tmp_path / "x.csv", "--as", "both", columns=200)
    assert found.exit_code == 2
    assert "--as" in found.output
