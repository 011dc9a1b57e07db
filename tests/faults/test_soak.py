"""A fleet with faults in small; and that a wrong answer, or a leak, would be found.

`python -m benchmarks.soak` does it for an hour.
"""

import copy
import itertools
import random
from collections import Counter
from dataclasses import replace
from datetime import UTC, datetime

import pytest

from app.geometry.chain import Chain
from app.live.reading_window import ReadingWindow
from app.thermal.machine import Machine, Sensor
from app.thermal.reading import Reading
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
    least = {"latest reading: a table": 31, "stated temperatures: a table": 7, "stream": 4}
    soaked = soak(url, tmp_path, seconds=12.0, machines=4, least=least)
    assert soaked.is_well, soaked.page()
    assert Counter(least) <= soaked.tally.checked
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
    return {
        "name": name,
        "stand_in": stand_in,
        "min_c": 0.0,
        "max_c": 60.0,
        "max_age_s": 10.0,
        "resolution_c": 0.1,
        "stuck_after_s": None,
        "max_rate_c_per_min": 1e6,
    }


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
    health = {"x-middle": "stale", "y-front": "out-of-range", "z-column": "ok"}
    assert found == Sensors({"z-column": 22.0}, {"x-middle": 20.0}, 108.0, health)
    assert sensors_at(MACHINE, readings, 114.0).usable["x-middle"] == 30.0


JUDGED = MACHINE | {
    "sensors": [
        sensor("x-middle") | {"stuck_after_s": 20.0},
        sensor("y-front") | {"max_rate_c_per_min": 60.0},
        sensor("z-column"),
    ]
}
"""y-front changes by 1 °C in a second at most, and by 1 °C at once."""


def health_at(rows, machine=JUDGED):
    """What is the matter with each sensor after some values, each row at a time in s."""
    return sensors_at(machine, rows.items(), max(rows)).health


@pytest.mark.parametrize(
    ("fronts_c", "health"),
    [
        ({0: 20.0, 1: 21.9}, "ok"),
        ({0: 20.0, 1: 22.1}, "jump"),
        ({0: 20.0, 1: 26.0, 2: 26.0}, "jump"),
        ({0: 20.0, 1: 26.0, 2: 20.5}, "ok"),
        ({0: 20.0, 1: 26.0, 5: 26.0}, "ok"),
        ({0: 20.0, 1: 99.0, 2: 22.0}, "ok"),
        ({0: 20.0, 1: 26.0, 2: 99.0}, "out-of-range"),
    ],
)
def test_a_sensor_that_jumps(fronts_c, health):
    assert health_at({t: {"y-front": c} for t, c in fronts_c.items()})["y-front"] == health


def warming(z_rises_c=2.0, y_rises_c=2.0, changes_at_s=0, last_s=30):
    """Neighbours that warm in the first five seconds; x-middle changes once, if at all."""
    return {
        t: {
            "x-middle": 20.0 if t >= changes_at_s else 20.1,
            "y-front": 20.0 + y_rises_c * min(t, 5) / 5,
            "z-column": 20.0 + z_rises_c * min(t, 5) / 5,
        }
        for t in range(last_s + 1)
    }


@pytest.mark.parametrize(
    ("rows", "health"),
    [
        (warming(), "stuck"),
        (warming(last_s=22), "ok"),
        (warming(last_s=23), "stuck"),
        (warming(z_rises_c=0.5), "ok"),
        (warming(y_rises_c=0.5), "ok"),
        (warming(changes_at_s=2), "stuck"),
        (warming(changes_at_s=4), "ok"),
        ({t: row for t, row in warming().items() if not 10 < t < 25}, "ok"),
    ],
)
def test_a_sensor_that_stands_still(rows, health):
    assert health_at(rows)["x-middle"] == health
    free = JUDGED | {"sensors": [{**s, "stuck_after_s": None} for s in JUDGED["sensors"]]}
    assert health_at(rows, free)["x-middle"] == "ok"


def random_rows(made, chance):
    """Readings in which sensors stand still, go away, or leave their range; some close together."""
    stands = {name: chance.uniform(0.0, 30.0) for name in SENSORS}
    lost = {name: chance.uniform(5.0, 90.0) for name in SENSORS}
    times = [round(chance.uniform(0.0, 30.0), 3) for _ in range(chance.randint(1, 80))]
    times += [round(t + 0.005, 3) for t in times if chance.random() < 0.3]
    rows = {}
    for t in times:
        row = made.temperatures() | {name: 25.0 for name, since in stands.items() if t > since}
        if chance.random() < 0.1:
            row[chance.choice(SENSORS)] = 99.0
        rows[t] = {name: c for name, c in row.items() if t < lost[name]}
    return rows


def test_the_service_judges_random_records_alike():
    """Neither knows the other: the check is plain code of its own."""
    chance = random.Random(7)
    found = Counter()
    for number in range(100):
        made = MadeMachine(f"soak-{number}", chance)
        rows = random_rows(made, chance)
        sensors = {one["name"]: Sensor(**one) for one in made.body["sensors"]}
        machine = Machine("m", "M", Chain.parse("XYFZ"), sensors=sensors)
        readings = [Reading(datetime.fromtimestamp(t, UTC), c, {}) for t, c in rows.items()]
        chance.shuffle(readings)
        window = ReadingWindow()
        for begin in range(0, len(readings), 10):
            now = datetime.fromtimestamp(max(rows), UTC)
            window.add(machine, readings[begin : begin + 10], now)
        states = {s.sensor: str(s.health) for s in window.judge(machine)}
        assert sensors_at(made.body, rows.items(), max(rows)).health == states
        found.update(states.values())
    assert min(found[h] for h in ("ok", "jump", "stuck", "stale", "out-of-range")) > 5


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
