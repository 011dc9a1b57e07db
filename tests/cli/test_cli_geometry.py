"""thermap picture and thermap accuracy."""

import json
from datetime import UTC, datetime, timedelta

import pytest
from plotly.io import from_json

from tests.service_examples import reading

# x-middle at 25.5 °C: the errors are those of tests/api/test_api_volumetric_error.py.
HOT = ("-t", "x-middle=25.5", "-t", "z-column=27.5", "--missing-as-zero")


def test_a_page_that_needs_nothing_else(thermap, tmp_path):
    file = tmp_path / "mill.html"
    found = thermap("picture", "mcfv5050", *HOT, "--tool", "0,0,160", "-o", file)
    assert (found.exit_code, found.stderr) == (0, "")
    assert str(file) in found.stdout.replace("\n", "")
    page = file.read_text(encoding="utf-8")
    assert "x-middle 25.5 °C" in page
    assert "tool offset (0, 0, 160) mm" in page
    assert "<script src" not in page


def test_a_figure_for_programs(thermap, tmp_path):
    file = tmp_path / "mill.json"
    found = thermap("picture", "mcfv5050", *HOT, "--exaggeration", 500, "-o", file)
    assert found.exit_code == 0
    assert from_json(file.read_text(encoding="utf-8")).layout.meta["exaggeration"] == 500


def test_what_is_to_be_said_against_a_picture_is_printed(thermap, client, tmp_path):
    client.store_readings("mcfv5050", reading(datetime.now(UTC) - timedelta(days=3), 22.0))
    found = thermap("picture", "mcfv5050", "--missing-as-zero", "-o", tmp_path / "now.html")
    told = " ".join(found.stdout.split())
    for said in ("! not complete", "! counted as zero: EYX", "! x-middle is stale"):
        assert said in told


@pytest.mark.parametrize("command", ["picture", "accuracy"])
def test_what_is_refused_is_told_by_the_option_that_would_allow_it(thermap, tmp_path, command):
    file = ("-o", tmp_path / "mill.html") if command == "picture" else ()
    found = thermap(command, "mcfv5050", *HOT[:-1], *file)
    assert found.exit_code == 1
    told = " ".join(found.stderr.split())
    assert "state --missing-as-zero where these may count as zero" in told
    assert "missing_components" not in told


def test_at_the_latest_reading(thermap, client, tmp_path):
    file = tmp_path / "now.json"
    found = thermap("picture", "mcfv5050", "--missing-as-zero", "-o", file)
    assert found.exit_code == 1
    assert "no reading yet" in found.stderr
    assert not file.exists()
    client.store_readings("mcfv5050", reading(datetime.now(UTC), 22.0))
    assert thermap("picture", "mcfv5050", "--missing-as-zero", "-o", file).exit_code == 0
    assert "x-middle 22.0 °C" in file.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("-o", "mill.png"), ".html or .json"),
        ((), "--output"),
        (("-o", "no/such/folder/mill.html"), "cannot write"),
        (("-o", "mill.html", "--tool", "1,2"), "X,Y,Z in mm"),
        (("-o", "mill.html", "--tool", "a,b,c"), "X,Y,Z in mm"),
    ],
)
def test_wrong_usage_is_told(thermap, tmp_path, monkeypatch, arguments, said):
    monkeypatch.chdir(tmp_path)
    found = thermap("picture", "mcfv5050", *HOT, *arguments)
    assert found.exit_code == 2
    assert said in " ".join(found.stderr.replace("│", " ").split())
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("columns", [80, 140])
def test_accuracy_by_every_definition(thermap, columns):
    found = thermap("accuracy", "mcfv5050", *HOT, columns=columns)
    assert (found.exit_code, found.stderr) == (0, "")
    lines = [" ".join(line.split()) for line in found.stdout.splitlines()]
    assert max(map(len, found.stdout.splitlines())) <= columns
    # hypot(41.25, 55) and hypot(54, 55): see tests/api/test_api_geometry.py.
    assert any(line.startswith("ELv 68.75 µm") for line in lines)
    assert any(line.startswith("ELSv 77.08 µm") for line in lines)
    assert any(line.startswith("M1 1.12") for line in lines)
    assert any(line.startswith("nonrigid slopes too 0.00 0.00 0.00") for line in lines)
    assert any("counted as zero: EYX" in line for line in lines)


def test_accuracy_as_json(thermap):
    found = thermap("accuracy", "mcfv5050", *HOT, "--json")
    both = json.loads(found.stdout)
    assert both["accuracy"]["ELv_um"] == pytest.approx(68.75)
    assert both["levels"]["levels"][0]["level"] == "nothing"
