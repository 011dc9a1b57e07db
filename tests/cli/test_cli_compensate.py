"""thermap compensate: a table that a person reads, and the service's JSON."""

import json
from datetime import UTC, datetime

import httpx
import pytest

from tests.service_examples import MACHINE, error_map, reading
from thermap import calls

# Between Run #1 (20 °C) and Run #3 (24 °C) of the example machine EXX grows by
# (t − 20)·x/100 µm: at 21 °C and 500 mm it is 5 µm.
TEMPERATURES = ("-t", "x-middle=21", "-t", "z-column=23")


def lines_with(text, *words):
    return [line for line in text.splitlines() if all(word in line for word in words)]


@pytest.mark.slow
@pytest.mark.parametrize("columns", [60, 80, 120, 200])
def test_a_table_that_fits_the_terminal(thermap, columns):
    found = thermap("compensate", "mcfv5050", *TEMPERATURES, columns=columns)
    assert (found.exit_code, found.stderr) == (0, "")
    assert max(map(len, found.stdout.splitlines())) <= columns
    errors = lines_with(found.stdout, "EXX", "error", "µm")[0].split()
    assert errors[-1 if columns < 120 else 6] == "+5.00"
    assert lines_with(found.stdout, "D_x(x)", "-5.00")
    assert lines_with(found.stdout, "x-middle 21.00 °C", "Run #1 to Run #3", "weight 0.25")


def test_squareness_has_its_iso_name(thermap):
    found = thermap("compensate", "mcfv5050", *TEMPERATURES)
    # SXY is −t µm/m here, and C0Y = −SXY.
    assert lines_with(found.stdout, "SXY", "error", "µm/m", "-21.00", "ISO C0Y +21.00 µrad")
    assert lines_with(found.stdout, "S_xy", "compensation", "+21.00")


def test_warnings_are_seen(thermap):
    found = thermap("compensate", "mcfv5050", "-t", "x-middle=50", "-t", "z-column=23")
    assert found.exit_code == 0
    assert lines_with(found.stdout, "! x-middle at 50 °C is outside the maps")
    assert lines_with(found.stdout, "x-middle 50.00 °C", "clamped")


def test_a_stand_in_is_named(thermap):
    found = thermap("compensate", "mcfv5050", "-t", "y-front=20", "-t", "z-column=23")
    assert lines_with(found.stdout, "y-front 20.00 °C for x-middle,", "stand-in")


def test_the_table_at_the_latest_reading(thermap, client):
    found = thermap("compensate", "mcfv5050")
    assert found.exit_code == 1
    assert "no reading yet" in found.stderr
    client.store_readings("mcfv5050", reading(datetime.now(UTC), 22.0))
    found = thermap("compensate", "mcfv5050")
    assert found.exit_code == 0
    assert lines_with(found.stdout, "x-middle 22.00 °C", "y-front 21.00 °C")
    assert " s old" in found.stdout


def test_backward_errors_have_rows_of_their_own(thermap, client):
    client.create_machine(MACHINE | {"id": "two-ways"})
    for label, t_c in (("a", 20.0), ("b", 30.0)):
        content = error_map(label, t_c)
        content["components"][0]["backward_errors_um"] = [1.0, 2.0, 3.0]
        client.store_error_map("two-ways", content)
    found = thermap("compensate", "two-ways", *TEMPERATURES)
    assert lines_with(found.stdout, "EXX +", "error")
    assert lines_with(found.stdout, "EXX -", "+1.00", "+2.00", "+3.00")


def test_json_is_the_services_own(thermap, client, service_url):
    found = thermap("compensate", "mcfv5050", *TEMPERATURES, "--state", "spindle_rpm=800", "--json")
    assert found.exit_code == 0
    call = calls.compensation("mcfv5050", {"x-middle": 21.0, "z-column": 23.0}, None)
    expected = json.loads(client.content(call))
    shown = json.loads(found.stdout)
    assert shown | {"computed_at": ""} == expected | {"computed_at": ""}
    client.store_readings("mcfv5050", reading(datetime.now(UTC), 22.0))
    shown = json.loads(thermap("compensate", "mcfv5050", "--json").stdout)
    answer = httpx.get(f"{service_url}/v1/machines/mcfv5050/compensation", trust_env=False).json()
    assert shown["components"] == answer["components"]


def test_a_sensor_that_is_missing_is_told_by_the_option_that_states_it(thermap):
    found = thermap("compensate", "mcfv5050", "-t", "x-middle=21")
    assert found.exit_code == 1
    assert "(at --temperature z-column)" in " ".join(found.stderr.split())
    assert "temperatures_c" not in found.stderr


@pytest.mark.slow
@pytest.mark.parametrize(
    ("machine", "temperature", "words"),
    [
        ("nope", "x-middle=20", "there is no machine 'nope'; there are: mcfv5050"),
        ("mcfv5050", "bed=20", "has no sensor 'bed'; it has x-middle"),
        ("mcfv5050", "x-middle=294", "if it was meant in kelvin"),
    ],
)
def test_what_the_service_refuses_is_said_in_its_words(thermap, machine, temperature, words):
    found = thermap("compensate", machine, "-t", temperature)
    assert (found.exit_code, found.stdout) == (1, "")
    assert words in found.stderr
