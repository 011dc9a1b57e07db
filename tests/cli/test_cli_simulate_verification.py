"""thermap simulate verification: the file is the model, noise, and what is planted."""

from datetime import timedelta

import numpy as np
import pytest

from app.files.csv_verification import read_csv_verification
from tests.service_examples import START, error_map, iso, reading, table


@pytest.fixture
def warmed(client):
    """Two days of readings every two minutes, x-middle from 20 to 29.6 °C."""
    client.store_readings(
        "mcfv5050",
        [reading(START + timedelta(minutes=2 * i), 20.0 + i / 150.0) for i in range(1441)],
    )


def observations(file):
    return read_csv_verification(file).body["observations"]


def truth(observation):
    """EXX is (t − 20)·x/100 µm where x-middle reads t; see `tests.service_examples`."""
    begun = np.datetime64(observation["time"].removesuffix("Z")) - np.datetime64(
        iso(START).removesuffix("Z")
    )
    grown = begun / np.timedelta64(1, "s") / 120.0 / 150.0
    return grown * observation["position_mm"] / 100.0


def test_without_noise_it_is_the_model(thermap, warmed, tmp_path):
    file = tmp_path / "v.csv"
    found = thermap(
        *("simulate", "verification", "mcfv5050", "--noise", 0, "--visits", 4, "--component"),
        *("EXX", "--reversal", "D_x(x)=3", "-o", file),
    )
    assert (found.exit_code, found.stderr) == (0, "")
    assert found.stdout == f"{file}: 20 observations in 4 visits, simulated\n"
    made = observations(file)
    assert {o["direction"] for o in made} == {"+", "-"}
    assert [o["setup"] for o in made] == [f"visit {i // 5 + 1}" for i in range(20)]
    for o in made:
        half = 1.5 if o["direction"] == "+" else -1.5
        assert o["measured_um"] == pytest.approx(truth(o) + half, abs=2e-4)


@pytest.mark.slow
def test_noise_is_as_large_as_stated_and_the_same_with_the_same_seed(thermap, warmed, tmp_path):
    files = [tmp_path / name / "night.csv" for name in "abc"]
    for file, seed in zip(files, (5, 5, 6), strict=True):
        file.parent.mkdir()
        found = thermap(
            *("simulate", "verification", "mcfv5050", "--noise", 0.5, "--visits", 20),
            *("--component", "EXX", "--positions", 20, "--seed", seed, "-o", file),
        )
        assert found.exit_code == 0, found.output
    first, again, other = (file.read_text(encoding="utf-8") for file in files)
    assert first == again != other
    assert read_csv_verification(files[0]).body["repeatability_um"] == 0.5
    noise = [o["measured_um"] - truth(o) for o in observations(files[0])]
    assert len(noise) == 400
    # The standard deviation of 400 values scatters by 0.5/√800 = 0.018.
    assert np.std(noise) == pytest.approx(0.5, abs=0.09)


def test_a_stated_plan(thermap, client, warmed, tmp_path):
    plan, file = tmp_path / "plan.csv", tmp_path / "v.csv"
    plan.write_text(
        "# datum: free\ntime,component,position_mm,direction,point_x_mm,point_y_mm,point_z_mm\n"
        "2026-03-01T08:00:00Z,EBX,500,-,,,\n2026-03-01T08:00:30Z,SXY,,,,,\n"
        "2026-03-01T08:01:00Z,,,,500,0,100\n2030-03-01T08:00:00Z,EXX,5,+,,,\n",
        encoding="utf-8",
    )
    found = thermap(
        *("simulate", "verification", "mcfv5050", "--plan", plan, "--noise", "0", "-o", file),
        "--missing-as-zero",
    )
    assert "note: 1 observation left out: there is no reading around its time" in found.stderr
    body = read_csv_verification(file).body
    assert body["datum"] == "free"
    angle, square, point = body["observations"]
    # At 08:00 x-middle reads 20.4 °C: EBX is 10·0.4 µrad at 500 mm, SXY −20.4 µm/m.
    assert angle["measured_urad"] == pytest.approx(4.0, abs=1e-3)
    assert square["measured_um_per_m"] == pytest.approx(-20.4, abs=2e-3)
    (predicted,) = client.predict(
        "mcfv5050",
        [{"time": "2026-03-01T08:01:00Z", "point_mm": [500, 0, 100]}],
        missing_components="zero",
    ).predicted_um
    assert point["measured_um"] == pytest.approx(predicted, abs=1e-4)
    stored = client.store_verification("mcfv5050", body)
    assert stored.count == 3, "the service takes what was written"


def test_two_files_of_one_machine_carry_two_labels(thermap, client, warmed, tmp_path):
    """The second one's label would be taken, and the file refused."""
    for name in ("monday", "tuesday"):
        file = tmp_path / f"{name}.csv"
        words = ("simulate", "verification", "mcfv5050", "--seed", len(name), "--visits", 2)
        written = thermap(*words, "--component", "EXX", "-o", file)
        assert written.exit_code == 0, written.output
        client.store_verification("mcfv5050", read_csv_verification(file).body)
    assert [one.label for one in client.verifications("mcfv5050")] == ["monday", "tuesday"]


def test_a_label_that_is_none(thermap, warmed, tmp_path):
    file = tmp_path / "v.csv"
    found = thermap("simulate", "verification", "mcfv5050", "-o", file, "--label", "two\nlines")
    assert (found.exit_code, found.stdout) == (2, "")
    assert "expected a name in one line" in found.stderr
    assert not file.exists()


def test_a_machine_without_readings(thermap, tmp_path):
    found = thermap("simulate", "verification", "mcfv5050", "-o", tmp_path / "v.csv")
    assert (found.exit_code, found.stdout) == (1, "")
    assert "machine 'mcfv5050' has no two readings at those times" in found.stderr
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_a_service_that_has_just_begun(thermap, client, tmp_path):
    """Five minutes of readings, as `thermap demo` has: one visit that fits into them."""
    client.store_readings("mcfv5050", [reading(START, 24.0)])
    file = tmp_path / "v.csv"
    words = ("simulate", "verification", "mcfv5050", "--reversal", "EXX=4", "-o", file)
    alone = thermap(*words)
    assert (alone.exit_code, alone.stdout) == (1, "")
    assert "has no two readings" in alone.stderr
    last = START + timedelta(minutes=5)
    readings = [reading(START + timedelta(minutes=i), 24.0) for i in range(1, 6)]
    client.store_readings("mcfv5050", readings)
    found = thermap(*words, columns=200)
    assert found.exit_code == 0, found.output
    # 20 observations: five of each of four components.
    assert "note: 1 visit instead of 10" in found.stderr
    assert "note: an observation every 15 s: the stored readings cover no more" in found.stderr
    made = observations(file)
    assert len(made) == 20
    assert {o["component"] for o in made} == {"EXX", "EBX", "EZZ", "SXY"}
    assert iso(START) <= made[0]["time"] < made[-1]["time"] < iso(last)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (("--component", "EXW"), 2, "EXW"),
        (("--component", "EYY"), 1, "lacks EYY; it has EXX, EBX, EZZ, SXY"),
        (("--reversal", "SXY=3"), 2, "SXY has no direction of approach"),
        (("--reversal", "EXX"), 2, "NAME=NUMBER"),
        (("--from", "yesterday"), 2, "with its zone"),
    ],
)
def test_what_cannot_be_simulated(thermap, warmed, tmp_path, words, code, said):
    found = thermap(
        "simulate", "verification", "mcfv5050", *words, "-o", tmp_path / "v.csv", columns=300
    )
    assert (found.exit_code, found.stdout) == (code, "")
    assert said in found.stderr


def test_places_lie_where_the_maps_in_use_reach_at_each_visit(thermap, client, warmed, tmp_path):
    """'Run #2' at 22 °C ends at 200 mm; from 24 °C on nobody needs it, and none is left out."""
    short = error_map("Run #2", 22.0)
    short["components"] = [table("EXX", [0, 100, 200], [0.0, 2.0, 4.0])]
    client.store_error_map("mcfv5050", short, accept_losses=True)
    file = tmp_path / "v.csv"
    words = ("--noise", 0, "--visits", 6, "--component", "EXX", "-o", file)
    found = thermap("simulate", "verification", "mcfv5050", *words)
    assert (found.exit_code, found.stderr) == (0, "")
    made = observations(file)
    assert len(made) == 30
    for o in made:
        assert o["measured_um"] == pytest.approx(truth(o), abs=2e-4)
    farthest = [max(o["position_mm"] for o in made[i : i + 5]) for i in range(0, 30, 5)]
    assert farthest[0] == pytest.approx(180.0)
    assert farthest[-1] == pytest.approx(450.0)
