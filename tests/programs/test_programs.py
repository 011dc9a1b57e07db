"""What a measuring program does, read by an interpreter of its own, and what is refused."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.errors import InvalidContent, UnknownThing
from app.geometry.body_diagonal import DIAGONALS
from app.geometry.chain import Chain
from app.programs.body_diagonal import body_diagonal_program
from app.programs.dialects import DIALECTS, ascii_text, dialect_named
from app.programs.moving_axis import MotionStep, moving_axis_program
from app.programs.path import Manner
from app.programs.positioning import choose_targets, positioning_program
from app.programs.step_diagonal import step_diagonal_program
from app.programs.visit import visit_program
from app.programs.warm_up import SpindleStep, warm_up_program
from app.search.rows import Datum
from app.thermal.machine import Machine, Travel
from tests.programs.example_programs import MACHINE, PLANNED, every_program, observed
from tests.programs.interpreter import run

PROGRAMS = every_program()
NO_MOVES = ("stop", "spindle", "dwell")


def actions(program, dialect="linuxcnc"):
    return run(DIALECTS[dialect].write(program), dialect)


def condensed(found):
    """Put dwells together that follow each other, and what is said twice."""
    kept = []
    for one in found:
        if kept and one[0] == kept[-1][0] == "dwell":
            kept[-1] = ("dwell", kept[-1][1] + one[1])
        elif not kept or one != kept[-1]:
            kept.append(one)
    return kept


def halts(found, seconds=4.0):
    """Where the machine stands at each reading, and from where each axis last came there."""
    at, came, places = {}, {}, []
    for kind, *rest in found:
        if kind == "dwell" and rest[0] == seconds:
            places.append((dict(at), dict(came)))
        elif kind not in NO_MOVES:
            came |= {a: math.copysign(1, mm - at[a]) for a, mm in rest[0].items() if a in at}
            at |= rest[0]
    return places


@pytest.mark.parametrize("name", PROGRAMS)
def test_all_controllers_do_the_same(name):
    wanted = condensed(actions(PROGRAMS[name]))
    assert condensed(actions(PROGRAMS[name], "siemens")) == wanted
    assert condensed(actions(PROGRAMS[name], "heidenhain")) == wanted
    # Fanuc's moves are of G54, so somebody looks at it before the first.
    checked = actions(PROGRAMS[name], "fanuc")
    assert checked[:2] == [("spindle", 0.0), ("stop",)]
    assert condensed([checked[0], *checked[2:]]) == wanted


@pytest.mark.parametrize("name", PROGRAMS)
def test_nothing_leaves_the_travel_and_what_crosses_is_retracted(name):
    at = {}
    for kind, *rest in actions(PROGRAMS[name]):
        if kind in NO_MOVES:
            continue
        for axis, mm in rest[0].items():
            assert MACHINE.axes[axis].min_mm <= mm <= MACHINE.axes[axis].max_mm
        if not at:
            assert rest[0] == {"z": 0.0}, "the first move retracts"
        if kind == "rapid" and set(rest[0]) != {"z"}:
            assert "z" not in rest[0]
            assert at["z"] == 0.0
        at |= rest[0]
    assert at["z"] == 0.0, "it ends retracted"


@pytest.mark.parametrize("name", PROGRAMS)
@pytest.mark.parametrize("dialect", DIALECTS)
def test_programs_are_plain_text_in_short_lines(name, dialect):
    text = DIALECTS[dialect].write(PROGRAMS[name])
    assert text.isascii()
    assert max(map(len, text.splitlines())) <= 80
    assert "dwell 4 s" in text.lower().replace("\n", " ")
    assert "feed 1000 mm/min" in text.lower().replace("\n", " ")


@pytest.mark.parametrize("axis", "xyz")
def test_positioning_runs_both_ways_past_its_ends(axis):
    found = halts(actions(PROGRAMS[f"POS{axis.upper()}"]))
    targets = choose_targets(MACHINE.axes[axis].min_mm + 5, MACHINE.axes[axis].max_mm - 5)
    run_up_and_down = [(t, 1) for t in targets] + [(t, -1) for t in reversed(targets)]
    assert [(at[axis], came[axis]) for at, came in found] == 2 * run_up_and_down
    others = {tuple(mm for a, mm in at.items() if a != axis) for at, _ in found}
    assert len(others) == 1


@settings(max_examples=30)
@given(
    begin=st.floats(-2000, 2000), length=st.floats(0.5, 5000), count=st.integers(2, 60),
    seed=st.integers(0, 1000),
)  # fmt: skip
def test_targets_are_uneven_and_inside(begin, length, count, seed):
    targets = np.array(choose_targets(begin, begin + length, count, seed=seed))
    assert targets.size == count
    assert targets.min() >= begin - 1e-9
    assert targets.max() <= begin + length + 1e-9
    interval = length / (count - 1)
    nominal = begin + np.arange(count) * interval
    # ISO 230-2: offsets within ±30 % of the interval, so that none meets its neighbour.
    assert np.abs(targets - nominal).max() <= 0.3 * interval + 1e-3
    assert (targets == np.round(targets, 3)).all()
    if count > 4 and interval > 1:
        assert np.ptp(np.diff(targets)) > 0.02 * interval
    assert choose_targets(begin, begin + length, count, seed=seed) == targets.tolist()


def test_a_long_axis_has_five_targets_per_metre():
    assert len(choose_targets(0, 500)) == 11
    assert len(choose_targets(0, 4000)) == 20
    assert choose_targets(0, 500, seed=1) != choose_targets(0, 500, seed=2)


def test_step_diagonals_stand_in_the_order_of_the_method():
    """x, then y, then z; p runs up and n down; the steps are those of the file."""
    program = step_diagonal_program(
        MACHINE, Manner(), steps=3, origin_mm=[50, -100, -250], step_mm=[100, 60, 70]
    )
    low, step = np.array([50, -100, -250]), np.array([100, 60, 70])
    found = iter(halts(actions(program)))
    for diagonal in DIAGONALS:
        ways = np.array([1 if letter == "p" else -1 for letter in diagonal])
        at = np.where(ways > 0, low, low + 3 * step)
        for _ in range(3):
            for axis in range(3):
                at[axis] += ways[axis] * step[axis]
                place, came = next(found)
                assert [place[a] for a in "xyz"] == at.tolist()
                assert [came[a] for a in "xyz"] == ways.tolist()
    assert next(found, None) is None


def test_body_diagonals_lie_on_a_line_and_are_run_both_ways():
    program = body_diagonal_program(MACHINE, Manner(), steps=7, runs=1)
    places = np.array([[at[a] for a in "xyz"] for at, _ in halts(actions(program))])
    for one in places.reshape(4, 2, 8, 3):
        assert (one[0] == one[1][::-1]).all()
        steps = np.diff(one[0], axis=0)
        assert np.abs(steps - steps[0]).max() < 1e-9


def test_the_spindle_stands_wherever_the_warm_up_goes_down():
    speed, turned_s, at, when_read = None, 0.0, {}, []
    for kind, *rest in actions(PROGRAMS["WARMUP"]):
        if kind == "spindle":
            speed = rest[0]
        elif kind == "dwell":
            turned_s += rest[0] if speed else 0.0
            when_read += [dict(at)] if rest[0] == 4.0 else []
        elif kind != "stop":
            assert speed == 0.0
            at |= rest[0]
    assert turned_s == 12 * 60.0
    # Cold, after 5, 10 and 12 min of turning, 18 times while it cools: at two places each.
    assert len(when_read) == (1 + 3 + 18) * 2
    assert [when_read[i] for i in (0, 1)] == [
        {"x": 250.0, "y": 0.0, "z": -200.0},
        {"x": 100.0, "y": 50.0, "z": -150.0},
    ]


def test_a_warm_up_in_place_never_moves_while_it_turns():
    steps = [SpindleStep(3000.0, 20.0), SpindleStep(0.0, 10.0)]
    program = warm_up_program(MACHINE, Manner(), steps, [(250, 0, -200)], in_place=True)
    found = actions(program)
    first, last = (found.index(one) for one in (("spindle", 3000.0), ("stop",)))
    assert last < first
    moves = [i for i, (kind, *_) in enumerate(found) if kind not in NO_MOVES]
    assert not [i for i in moves if first < i < len(found) - 2]
    assert ",3000\n" in program.readings.content


def test_a_long_dwell_is_parted_for_the_cycle_that_takes_an_hour():
    steps = [SpindleStep(0.0, 150.0)]
    program = warm_up_program(MACHINE, Manner(), steps, [(250, 0, -200)], every_min=150.0)
    found = [s for kind, *rest in actions(program, "heidenhain") if kind == "dwell" for s in rest]
    assert found == [4.0, 3600.0, 3600.0, 1800.0, 4.0]


def test_a_visit_reads_each_place_in_its_direction_once():
    found = halts(actions(PROGRAMS["VISIT"]))
    read = [(at["x"], at["y"], at["z"]) for at, _ in found]
    assert read == [
        (100.0, 0.0, -150.0),  # EXX and EBX at once
        (250.0, 0.0, -150.0),
        (250.0, 0.0, -150.0),
        (250.0, 50.0, -150.0),
        (250.0, 0.0, -100.0),
        (10.0, 20.0, -30.0),
        (90.0, -20.0, -60.0),
    ]
    ways = [came for _, came in found]
    assert [one["x"] for one in ways[:3]] == [1, 1, -1]
    assert ways[4]["z"] == -1
    assert (ways[5]["x"], ways[5]["y"]) == (1, -1)
    assert "SXY: no position" in PROGRAMS["VISIT"].notes[0]


def test_a_visit_keeps_to_the_plan_and_waits_for_the_operator():
    """Between set-ups it waits for a person, within one by dwells: never ahead of its times."""
    found = actions(PROGRAMS["VISIT"])
    assert found.count(("stop",)) == 4  # along x, y and z, and at points
    late = actions(visit_program(MACHINE, Manner(dwell_s=100.0), PLANNED))
    assert sum(rest[0] == 100.0 for kind, *rest in late if kind == "dwell") == 7
    behind = visit_program(MACHINE, Manner(dwell_s=100.0), PLANNED).notes
    assert any("1 min behind the planned times" in note for note in behind)
    gap = [observed(0, "EXX", 100.0), observed(300, "EXX", 100.0)]
    apart = visit_program(MACHINE, Manner(), type(PLANNED)("two", gap, Datum.FREE))
    assert actions(apart).count(("stop",)) == 2
    between = [rest[0] for kind, *rest in found if kind == "dwell" and rest[0] != 4.0]
    assert 40 < between[0] < 60


def test_times_of_the_warm_up_are_planned_from_its_start():
    lines = PROGRAMS["WARMUP"].readings.content.splitlines()[6:]
    assert lines[0].startswith("2026-03-01T06:00:")
    minutes = [float(line.split(",")[1]) for line in lines]
    assert minutes == sorted(minutes)
    assert minutes[-1] == pytest.approx((PROGRAMS["WARMUP"].seconds) / 60, abs=0.01)


def test_an_axis_goes_back_and_forth_between_its_readings():
    """400 mm less the overrun at 15 m/min for 5 min: 96 strokes there and back, twice."""
    found = actions(PROGRAMS["MOVEY"])
    moves = [rest[0]["y"] for feed, *rest in found if feed == 15_000.0]
    assert set(moves) == {-195.0, 195.0}
    assert moves[:4] == [195.0, -195.0, 195.0, -195.0]
    # 12 min, read every 5 min: 5, 5 and 2 min.
    assert len(moves) == 2 * (96 + 96 + 38)
    assert [rest[0] for kind, *rest in found if kind == "dwell" and rest[0] > 4.0] == [300.0] * 2
    places = [at["y"] for at, _ in halts(found)]
    ways = [came["y"] for _, came in halts(found)]
    assert places == [-195.0, 0.0, 195.0, 195.0, 0.0, -195.0] * 6
    assert ways == [1, 1, 1, -1, -1, -1] * 6


def test_a_motion_stays_where_it_was_asked_for():
    program = moving_axis_program(
        MACHINE, Manner(), "z", [MotionStep(6000.0, 1.0)],
        between_mm=(-250.0, -50.0), targets_mm=[-200.0, -100.0], every_min=0.5,
    )  # fmt: skip
    moves = [rest[0]["z"] for feed, *rest in actions(program) if feed == 6000.0]
    assert set(moves) == {-250.0, -50.0}
    assert len(moves) == 2 * 2 * 8
    assert {at["z"] for at, _ in halts(actions(program))} == {-200.0, -100.0}
    assert "travel used: X 250.000; Y 0.000; Z -250.000 to 0.000" in program.head


LATHE = Machine(
    "lathe", "lathe", Chain.parse("XFZ"), {"x": Travel(-10.0, 200.0), "z": Travel(0.0, 600.0)}
)
BARE = Machine("bare", "bare", MACHINE.chain, {"x": Travel(0.0, 500.0)})


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda m: positioning_program(m, Manner(), "x", targets_mm=[0, 100, 200]),
         r"travel of 0 to 500 mm, got X -5 mm, 5.000 mm beyond 0 mm"),
        (lambda m: positioning_program(m, Manner(), "x", targets_mm=[10, 498]), r"X 503 mm"),
        (lambda m: positioning_program(m, Manner(), "x", targets_mm=[10, 10.5]), "trigger window"),
        (lambda m: positioning_program(m, Manner(), "x", targets_mm=[100, 10]), "increasing"),
        (lambda m: positioning_program(m, Manner(), "x", targets_mm=[10, 100.00051]), "0.001 mm"),
        (lambda m: positioning_program(m, Manner(), "x", line_mm={"x": 4}), "which moves"),
        (lambda m: positioning_program(m, Manner(), "x", line_mm={"y": 400}),
         r"-200 to 200 mm, got Y 400 mm, 200.000 mm beyond 200 mm"),
        (lambda m: positioning_program(m, Manner(), "w"), r"an axis of XYFZ \(x, y, z\), got 'w'"),
        (lambda m: positioning_program(m, Manner(), "x", runs=0), "1 to 100 runs, got 0"),
        (lambda m: positioning_program(m, Manner(overrun_mm=260), "x"), "range that increases"),
        (lambda m: positioning_program(m, Manner(retract_mm={"z": 1.0}), "x"), "got Z 1 mm"),
        (lambda m: Manner(dwell_s=2.0, reading_s=3.0), "longer than the 3 s"),
        (lambda m: Manner(overrun_mm=1.0, window_mm=0.6), "twice the trigger window"),
        (lambda m: Manner(feed_mm_per_min=math.nan), "feed: expected above 0"),
        (lambda m: step_diagonal_program(m, Manner(), steps=10, step_mm=[50, 40, 30]),
         "beyond 500 mm"),
        (lambda m: step_diagonal_program(m, Manner(), steps=1000), "trigger window"),
        (lambda m: step_diagonal_program(m, Manner(), steps=0), "1 to 1000 steps"),
        (lambda m: body_diagonal_program(m, Manner(), origin_mm=[600, 0, -10]), "step above 0"),
        (lambda m: step_diagonal_program(BARE, Manner()), "travel of y in mm"),
        (lambda m: step_diagonal_program(LATHE, Manner()), "axes x, y and z, got XFZ"),
        (lambda m: warm_up_program(m, Manner(), [SpindleStep(9.5, 9)], [(1, 1, -1)]), "whole sp"),
        (lambda m: warm_up_program(m, Manner(), [SpindleStep(-1, 5)], [(1, 1, -1)]), "got -1"),
        (lambda m: warm_up_program(m, Manner(), [], [(1, 1, -1)]), "at least one spindle step"),
        (lambda m: warm_up_program(m, Manner(), [SpindleStep(9, 9)], [(1, -1)]), "x, y and z"),
        (lambda m: warm_up_program(m, Manner(), [SpindleStep(1, 9999)], [(1, 1, -1)], every_min=1),
         "at most 2000 returns"),
        (lambda m: warm_up_program(m, Manner(), [SpindleStep(9, 9)], [(1, 1, 1)]), "got Z 1 mm"),
        (lambda m: warm_up_program(
            m, Manner(), [SpindleStep(9, 9)], [(1, 1, -1), (2, 1, -1)], in_place=True),
         "one place"),
        (lambda m: warm_up_program(
            m, Manner(), [SpindleStep(9, 9)], [(1, 1, -1)], sensor_distance_mm=0.0),
         "at most 10000 mm, at one measuring position, got 0 mm"),
        (lambda m: moving_axis_program(m, Manner(), "x", [MotionStep(0, 9)]), "step of motion"),
        (lambda m: moving_axis_program(m, Manner(), "x", [MotionStep(-1, 9)]), "one step of mot"),
        (lambda m: moving_axis_program(m, Manner(), "x", [MotionStep(9, 0)]), "for 0 min"),
        (lambda m: moving_axis_program(m, Manner(), "x", [MotionStep(9e3, 9)], every_min=0.0),
         "every: expected a pause above 0"),
        (lambda m: moving_axis_program(
            m, Manner(), "x", [MotionStep(9e3, 9)], between_mm=(300, 200)),
         "lower to a higher position, got 300 to 200"),
        (lambda m: moving_axis_program(m, Manner(), "x", [MotionStep(9e3, 9)], between_mm=(0, 90)),
         "got X -5 mm, 5.000 mm beyond 0 mm"),
        (lambda m: moving_axis_program(
            m, Manner(), "x", [MotionStep(9e3, 9)], between_mm=(20, 90), targets_mm=[10, 50]),
         "where the axis moves, 20 to 90 mm, got 10 to 50 mm"),
        (lambda m: moving_axis_program(
            m, Manner(), "x", [MotionStep(6e4, 6000)], between_mm=(20, 30), every_min=60),
         "at most 50,000 strokes of 10 mm, each of which is a block"),
        (lambda m: moving_axis_program(LATHE, Manner(), "y", [MotionStep(9e3, 9)]), "of XFZ"),
        (lambda m: visit_program(m, Manner(), type(PLANNED)("v", [observed(0, "SXY")])),
         "with a position, got none"),
        (lambda m: visit_program(
            m, Manner(), type(PLANNED)("v", [observed(0, "EXX", 499.0, (-1, 0, 0))])),
         "got X 504 mm"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused(make, said):
    with pytest.raises(InvalidContent, match=said):
        make(MACHINE)


def test_an_axis_of_unknown_travel_stays_where_it_is():
    program = positioning_program(BARE, Manner(), "x", runs=1)
    assert all(set(rest[0]) == {"x"} for kind, *rest in actions(program) if kind not in NO_MOVES)
    assert any("no axis is retracted" in sentence for sentence in program.head)


def test_a_lathe_moves_the_axes_that_it_has():
    """Out of the way first along x, then along z, as is asked."""
    manner = Manner(feed_mm_per_min=333.3, retract_mm={"x": 200.0, "z": 600.0})
    point = observed(0, point_mm=(20.0, 0.0, 100.0), ways=(1, 1, -1))
    program = visit_program(LATHE, manner, type(PLANNED)("v", [point]))
    for dialect in DIALECTS:
        moves = [one for one in actions(program, dialect) if one[0] not in NO_MOVES]
        assert moves == [
            ("rapid", {"x": 200.0}), ("rapid", {"z": 600.0}), (333.3, {"z": 105.0}),
            (333.3, {"x": 15.0}), (333.3, {"x": 20.0, "z": 100.0}),
            (333.3, {"x": 15.0, "z": 105.0}), (333.3, {"x": 20.0, "z": 100.0}),
            ("rapid", {"x": 200.0}), ("rapid", {"z": 600.0}),
        ]  # fmt: skip
    warm = warm_up_program(LATHE, manner, [SpindleStep(900.0, 5.0)], [(20.0, 0.0, 100.0)])
    assert "# point_mm: 20.0, 0.0, 100.0" in warm.readings.content


@given(
    low=st.integers(-2000, 1000), length=st.integers(40, 3000), count=st.integers(2, 20),
    overrun=st.floats(1.5, 15), seed=st.integers(0, 99),
)  # fmt: skip
def test_whatever_is_asked_stays_in_the_travel_or_is_refused(low, length, count, overrun, seed):
    machine = Machine("m", "m", MACHINE.chain, {"x": Travel(low, low + length / 7)})
    try:
        manner = Manner(overrun_mm=overrun)
        program = positioning_program(machine, manner, "x", count=count, runs=1, seed=seed)
    except InvalidContent:
        return
    for kind, *rest in actions(program):
        if kind not in NO_MOVES:
            assert low <= rest[0]["x"] <= low + length / 7


def test_names_of_controllers_and_foreign_letters():
    with pytest.raises(UnknownThing, match="siemens, heidenhain, fanuc, linuxcnc"):
        dialect_named("okuma")
    assert ascii_text("Fräse № 5") == "Frase No 5"
    assert ascii_text("機") == "?"
