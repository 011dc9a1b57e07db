"""A fleet with faults in small; and that a wrong answer, or a leak, would be found.

`python -m benchmarks.soak` does it for an hour.
"""

import copy
import itertools
import random
from dataclasses import replace

import pytest

from tests.databases import reachable
from tests.faults.soak.evaluation import (
    NoTable,
    Sensors,
    differences,
    sensors_at,
    stated,
    table,
)
from tests.faults.soak.machines import SENSORS, MadeMachine
from tests.faults.soak.process import Sample, growth_of
from tests.faults.soak.run import Soaked, errors_in, soak
from tests.faults.soak.tally import Tally


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["sqlite", "postgresql"])
def test_a_fleet_with_faults_is_answered_rightly(databases, kind, tmp_path):
    url = reachable(databases.migrated, kind)
    soaked = soak(url, tmp_path, seconds=30.0, machines=4)
    assert soaked.is_well, soaked.page()
    checked = soaked.tally.checked
    assert checked["latest reading: a table"] > 50
    assert checked["stated temperatures: a table"] > 10
    assert checked["stream"] > 5
    assert soaked.tally.faults["service ended by SIGKILL"] >= 1
    databases.give_back(url)


def traceback(where, error):
    return f'Traceback (most recent call last):\n  File "{where}\n    work()\n{error}\n'


def test_what_was_raised_is_found_in_the_log_but_for_orphans_of_a_killed_service(tmp_path):
    log = tmp_path / "log"
    assert errors_in(log) == []
    begun = 'spawn.py", line 122, in spawn_main'
    orphan = traceback(begun, "EOFError: Ran out of input")
    log.write_text(f"started\n{orphan}ended\n" * 2)
    assert errors_in(log) == []
    own = traceback('app/live.py", line 3, in table', "EOFError: Ran out of input")
    other = traceback(begun, "ValueError: expected 3")
    log.write_text(f"{orphan}{own}{orphan}{other}CRITICAL lost\n")
    first = "Traceback (most recent call last):"
    ended = "EOFError: Ran out of input"
    assert errors_in(log) == [first, ended, first, "ValueError: expected 3", "CRITICAL lost"]


def sensor(name, stand_in=None):
    return {"name": name, "stand_in": stand_in, "min_c": 0.0, "max_c": 60.0, "max_age_s": 10.0}


MACHINE = {
    "sensors": [sensor("x-middle", "y-front"), sensor("y-front"), sensor("z-column")],
    "out_of_range": "clamp",
    "extrapolation_margin_c": 5.0,
    "extrapolation_error_ratio": 3.0,
}


def error_map(label, t_c, front_c, errors_um, positions_mm=(0.0, 100.0)):
    part = {"component": "EXX", "positions_mm": list(positions_mm), "errors_um": errors_um}
    return {
        "label": label,
        "temperatures_c": {"x-middle": t_c, "y-front": front_c, "z-column": t_c},
        "components": [part],
    }


MAPS = [error_map("cold", 20.0, 30.0, [0.0, 4.0]), error_map("warm", 24.0, 22.0, [8.0, 0.0])]


def exx(temperatures_c, machine=MACHINE, maps=MAPS, assignment=None):
    return table(machine, maps, assignment or {}, stated(MACHINE, temperatures_c))["EXX"]


def test_the_line_between_two_maps():
    line = exx({"x-middle": 21.0})
    assert (line.lower_map, line.upper_map, line.weight) == ("cold", "warm", 0.25)
    assert line.errors == [2.0, 3.0]
    assert line.status == "interpolated"


def test_another_sensor_has_the_maps_in_its_own_order():
    line = exx({"y-front": 24.0})
    assert (line.sensor, line.status) == ("y-front", "stand-in")
    assert (line.lower_map, line.upper_map, line.weight) == ("warm", "cold", 0.25)
    assert line.errors == [6.0, 1.0]


@pytest.mark.parametrize(
    ("policy", "t_c", "errors", "status"),
    [
        ("clamp", 28.0, [8.0, 0.0], "clamped"),
        ("extrapolate", 28.0, [16.0, -4.0], "extrapolated"),
        ("extrapolate", 16.0, [-8.0, 8.0], "extrapolated"),
        ("clamp", 24.0, [8.0, 0.0], "at-map"),
    ],
)
def test_beyond_the_maps(policy, t_c, errors, status):
    line = exx({"x-middle": t_c}, MACHINE | {"out_of_range": policy})
    assert (line.errors, line.status) == (errors, status)


@pytest.mark.parametrize(
    ("policy", "t_c"), [("reject", 24.5), ("extrapolate", 29.5), ("clamp", 99.0)]
)
def test_no_table(policy, t_c):
    with pytest.raises(NoTable):
        exx({"x-middle": t_c}, MACHINE | {"out_of_range": policy})


def test_positions_inside_what_the_maps_in_use_share():
    maps = [MAPS[0], error_map("warm", 24.0, 22.0, [8.0, 0.0], (20.0, 60.0))]
    between, at_warm = exx({"x-middle": 22.0}, maps=maps), exx({"x-middle": 24.0}, maps=maps)
    assert between.positions_mm == [20.0, 60.0]
    assert between.errors == pytest.approx([0.5 * 0.8 + 4.0, 0.5 * 2.4])
    assert not between.is_whole
    assert at_warm.errors == [8.0, 0.0]
    assert exx({"x-middle": 20.0}, maps=maps).is_whole


def test_old_and_future_readings():
    readings = [
        (100.0, {"x-middle": 20.0, "y-front": 21.0}),
        (105.0, {"y-front": 99.0}),
        (108.0, {"z-column": 22.0}),
        (116.0, {"x-middle": 30.0}),
    ]
    found = sensors_at(MACHINE, readings, 112.0)
    assert found == Sensors({"z-column": 22.0}, {"x-middle": 20.0}, 108.0)
    assert sensors_at(MACHINE, readings, 114.0).usable["x-middle"] == 30.0


def answer_of(lines):
    """Write lines as the service would."""
    return {
        "model_version": 3,
        "components": [
            {
                "component": line.code,
                "positions_mm": line.positions_mm,
                "errors_um": [round(e, 4) for e in line.errors],
                "compensation_um": [round(-e, 4) for e in line.errors],
                "sensor": line.sensor,
                "temperature_c": line.temperature_c,
                "lower_map": line.lower_map,
                "upper_map": line.upper_map,
                "weight": line.weight,
                "status": line.status,
            }
            for line in lines.values()
        ],
    }


WRONG = {
    "errors_um": [2.0002, 3.0],
    "compensation_um": [2.0, 3.0],
    "positions_mm": [0.0, 101.0],
    "sensor": "y-front",
    "temperature_c": 21.1,
    "lower_map": "warm",
    "weight": 0.26,
    "status": "clamped",
    "backward_errors_um": [2.0, 3.0],
}


@pytest.mark.parametrize("field", WRONG)
def test_a_wrong_answer_is_found(field):
    lines = table(MACHINE, MAPS, {}, stated(MACHINE, {"x-middle": 21.0}))
    answer = answer_of(lines)
    assert differences(answer, lines, 3) == []
    assert differences(answer, lines, 4) == ["model version 3, expected 4"]
    wrong = copy.deepcopy(answer)
    wrong["components"][0][field] = WRONG[field]
    assert len(differences(wrong, lines, 3)) == 1
    assert differences(answer | {"components": []}, lines, 3) == ["components [], expected ['EXX']"]


def samples(mib_per_h, scatter=0.0):
    chance = random.Random(5)
    return [
        Sample(10.0 * i, 1, 200.0 + mib_per_h * i / 360.0 + chance.gauss(0, scatter), 30, 9, 1.0)
        for i in range(360)
    ]


def test_growth_of_memory_with_its_uncertainty():
    exact = growth_of(samples(60.0))
    assert exact.rate == pytest.approx(60.0)
    assert exact.standard_error == pytest.approx(0.0, abs=1e-6)
    rough = growth_of(samples(60.0, scatter=3.0))
    assert 0.1 < rough.standard_error < 2.0
    assert abs(rough.rate - 60.0) < 4.0 * rough.standard_error
    assert growth_of(samples(60.0)[:20]) is None


def test_leaks_are_found():
    sample = Sample(0.0, 1, 200.0, 30, 9, 1.0)
    filling, growth = growth_of(samples(900.0, 3.0)), growth_of(samples(5.0, 3.0))
    well = Soaked(60.0, 1, Tally(), 0, sample, sample, filling, growth, [], [])
    assert well.is_well
    for wrong in (
        replace(well, last=replace(sample, handles=60)),
        replace(well, last=replace(sample, threads=40)),
        replace(well, growth=growth_of(samples(120.0, 3.0))),
    ):
        assert len(wrong.leaks) == 1
        assert "LEAK" in wrong.page()
    assert not replace(well, log_errors=["Traceback"]).is_well
    tally = Tally()
    tally.check("stream", "m1", ["EXX: weight"])
    assert not replace(well, tally=tally).is_well


def test_made_maps_can_be_told_apart_by_every_sensor():
    machine = MadeMachine("soak-1", random.Random(1))
    maps = [machine.error_map(place, str(place)) for place in range(8)]
    for name in SENSORS:
        temperatures_c = sorted(one["temperatures_c"][name] for one in maps)
        assert all(b - a > 0.5 for a, b in itertools.pairwise(temperatures_c))
