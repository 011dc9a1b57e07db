"""ELv and ELSv against Table 8.2 of C. Wang's chapter, all ten machines as printed."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.errors import InvalidContent
from app.geometry.line_accuracy import line_accuracy

# Table 8.2 [µm]; a dash where a line was not measured. Machines 1 to 10 from left to right.
TABLE_8_2 = """
    x I     9.5    5.3   16.5   24.0   35.8   23.5   10.7   20.5    7.6   12.3
    x II    7.2    7.3   31.1   22.5   47.7   24.1   12.0   54.3      -      -
    x III     -      -   19.2   19.0   51.6   28.4      -   29.4      -      -
    y I    15.8    7.8   15.3   18.4   20.3   14.3   16.2    5.5   13.6   15.7
    y II   12.0    8.7    4.9   20.4   18.3   19.2   17.1    6.3      -      -
    y III     -      -   13.2   24.9   22.9   21.6   11.2   12.1      -      -
    z I       -   36.3   10.9   10.6   14.0   16.5    6.8    6.6   23.3   14.1
    z II   14.3   17.8   14.9    7.1   15.5   19.2    8.4    8.7      -      -
    z III  25.2   21.1   10.1    7.7   18.0   15.2    7.7   15.7      -      -
    EYX -   2.9    2.9    7.5    2.9    3.9    5.6    6.2    2.8    7.1   15.6
    EZX -   2.4    3.4    9.2    4.1    2.5    3.1    2.4    1.9    8.5    6.6
    EZY -   2.3    2.8    2.3    1.2    2.0    4.0    7.3    3.3    2.3    3.5
    EXY -   2.4    8.8    6.7   11.9    5.2    4.5   10.3    4.0   18.4    7.9
    EYZ -   6.1   13.1    5.3   23.3   25.1   23.9    5.2    9.3   27.5   21.3
    EXZ -  15.9   28.2    7.2    5.2    5.2    2.1    8.5   15.8   25.6    6.4
    ELv -  25.55  27.13  27.62  31.61  51.95  35.59  20.18  39.61  28.03  24.43
    ELSv - 42.81  58.66  49.31  62.89  77.05  62.37  43.56  62.58  78.41  63.72
    M1 -    1.67   2.16   1.79   1.99   1.48   1.75   2.16   1.58   2.80   2.61
"""
ROWS = {(r[0], r[1]): r[2:] for r in (line.split() for line in TABLE_8_2.strip().splitlines())}


def machine(number, without=()):
    column = {row: cells[number - 1] for row, cells in ROWS.items()}
    lines = {
        axis: [
            float(column[axis, n])
            for n in ("I", "II", "III")
            if column[axis, n] != "-" and (axis, n) not in without
        ]
        for axis in "xyz"
    }
    straightness = {
        code: float(v) for (code, _), v in column.items() if code[0] == "E" and len(code) == 3
    }
    straightness.pop("ELv", None)
    return lines, straightness, {name: float(column[name, "-"]) for name in ("ELv", "ELSv", "M1")}


@pytest.mark.parametrize("number", [1, 2, 3, 4, 5, 6, 7, 9, 10])
def test_nine_machines_have_their_printed_values(number):
    lines, straightness, printed = machine(number)
    found = line_accuracy(lines, straightness)
    assert found.elv_um == pytest.approx(printed["ELv"], abs=0.01)
    assert found.elsv_um == pytest.approx(printed["ELSv"], abs=0.01)
    # M1 of machine 1 is printed 1.67, but 42.81/25.55 is 1.6755.
    assert found.ratio == pytest.approx(printed["M1"], abs=0.006)


def test_machine_8_has_them_only_without_line_iii_of_x():
    """29.4 µm. With it, ELv is 37.10 and ELSv 60.15."""
    lines, straightness, printed = machine(8, without=[("x", "III")])
    found = line_accuracy(lines, straightness)
    assert found.elv_um == pytest.approx(printed["ELv"], abs=0.01)
    assert found.elsv_um == pytest.approx(printed["ELSv"], abs=0.01)
    lines, straightness, printed = machine(8)
    with_it = line_accuracy(lines, straightness)
    assert with_it.elv_um == pytest.approx(37.10, abs=0.01)
    assert with_it.elsv_um == pytest.approx(60.15, abs=0.01)


# Table 8.2 [µm/m; the table's heading says µm/mm] and the strokes of Table 8.1 [mm].
SQUARENESS = {
    "EXY": ([-1, 15, -18, -8, 5, 3, 15, -8, 56, 11], "y"),
    "EXZ": ([41, -52, -31, -7, 7, 4, -18, -39, 64, -37], "z"),
    "EYZ": ([-18, -18, -8, -67, -53, -48, -16, -27, 73, -7], "z"),
}
STROKES = {
    "y": [560, 560, 500, 500, 630, 630, 630, 630, 500, 610],
    "z": [560, 560, 500, 500, 630, 630, 630, 630, 500, 720],
}


def test_the_tables_straightness_contains_squareness():
    """D_x(y) follows |B_xy| times the travel of y, and so on: r = 0.83 over 30 pairs.

    Without machine 10, whose B_xz and B_yz (or D_x(z) and D_y(z)) look interchanged, 0.94.
    """
    slopes = [
        abs(b) * stroke / 1000.0
        for squareness, axis in SQUARENESS.values()
        for b, stroke in zip(squareness, STROKES[axis], strict=True)
    ]
    straightness = [machine(n)[1][code] for code in SQUARENESS for n in range(1, 11)]
    assert np.corrcoef(slopes, straightness)[0, 1] == pytest.approx(0.83, abs=0.005)
    nine = np.arange(30) % 10 != 9
    assert np.corrcoef(np.array(slopes)[nine], np.array(straightness)[nine])[0, 1] > 0.9


STRAIGHT = dict.fromkeys(("EYX", "EZX", "EXY", "EZY", "EXZ", "EYZ"), 0.0)


def test_a_straight_machine_has_one_measure():
    found = line_accuracy({"x": [3.0], "y": [4.0], "z": [12.0]}, STRAIGHT)
    assert found.elv_um == found.elsv_um == 13.0
    assert found.ratio == 1.0
    assert line_accuracy({"x": [0.0], "y": [0.0], "z": [0.0]}, STRAIGHT).ratio is None


deviation = st.floats(0.0, 1e3)


@pytest.mark.slow
@given(
    st.fixed_dictionaries({a: st.lists(deviation, min_size=1, max_size=4) for a in "xyz"}),
    st.fixed_dictionaries(dict.fromkeys(STRAIGHT, deviation)),
)
def test_straightness_only_adds_and_the_order_of_lines_does_not_matter(lines, straightness):
    found = line_accuracy(lines, straightness)
    assert found.elsv_um >= found.elv_um - 1e-9
    turned = line_accuracy({axis: values[::-1] for axis, values in lines.items()}, straightness)
    assert turned.elv_um == pytest.approx(found.elv_um, rel=1e-12)


@pytest.mark.parametrize(
    ("lines", "straightness", "message"),
    [
        (
            {"x": [1.0], "y": [1.0]},
            STRAIGHT,
            r"linear_um.z: expected at least one maximal dev.*\[\]",
        ),
        ({"x": [-1.0], "y": [1.0], "z": [1.0]}, STRAIGHT, r"of 0 µm or more, got \[-1.0\]"),
        ({"x": [math.nan], "y": [1.0], "z": [1.0]}, STRAIGHT, r"got \[nan\]"),
        ({"x": [1.0], "y": [1.0], "z": [1.0]}, {}, "expected the maximal .* EYX, EZX.* got none"),
        (
            {"x": [1.0], "y": [1.0], "z": [1.0]},
            STRAIGHT | {"EXX": 1.0},
            "straightness_um: expected .*, got .*EXX",
        ),
        (
            {"x": [1.0], "y": [1.0], "z": [1.0]},
            STRAIGHT | {"EXY": -2.0},
            r"straightness_um.EXY: .* got \[-2.0\]",
        ),
    ],
)
def test_what_is_missing_or_no_deviation_is_refused(lines, straightness, message):
    with pytest.raises(InvalidContent, match=message):
        line_accuracy(lines, straightness)
