"""Components of a map that would fit the other maps if a mistake were undone."""

from datetime import UTC, datetime

import numpy as np
import pytest

from app.geometry.components import parse_component
from app.thermal.error_map import ComponentTable, ErrorMap
from app.thermal.mistaken_maps import MIRRORED, REVERSED, copied, inexplicable, mistakes

X_MM = np.array([0.0, 250.0, 500.0])
ASSIGNMENT = {"EXX": "bed", "EYX": "bed", "SXY": "column"}


def grown(t_c, **sign):
    """A machine that is right at 20 °C: EXX and SXY grow by what it is warmer, EYX does not."""
    errors = {
        "EXX": 0.011 * (t_c - 20.0) * X_MM,
        "EYX": np.array([0.0, 6.0, 3.0]),
        "SXY": np.array([3.0 * (t_c - 20.0)]),
    }
    tables = {}
    for code, values in errors.items():
        component, _ = parse_component(code)
        positions_mm = X_MM if component.is_table else np.array([])
        tables[code] = ComponentTable(component, positions_mm, sign.get(code, 1.0) * values)
    at = datetime(2026, 3, 1, 6, tzinfo=UTC)
    return ErrorMap(f"{t_c} °C", at, {"bed": t_c, "column": t_c + 1.0}, tables)


def found(t_c, *others_c, **sign):
    """Give what has the opposite sign; nothing else is ever found beside it."""
    mistaken = mistakes(grown(t_c, **sign), [grown(t) for t in others_c], ASSIGNMENT)
    assert mistaken.keys() <= {REVERSED}
    return mistaken.get(REVERSED, [])


@pytest.mark.parametrize("t_c", [15.0, 18.0, 23.0, 25.0, 29.0])
def test_a_sign_that_is_reversed(t_c):
    """Between the others and beside them, by itself and with all others."""
    assert found(t_c, 17.0, 22.0, 26.0, EXX=-1.0) == ["EXX"]
    assert found(t_c, 17.0, 22.0, 26.0, EXX=-1.0, EYX=-1.0, SXY=-1.0) == ["EXX", "EYX", "SXY"]


@pytest.mark.parametrize("t_c", [15.0, 18.0, 20.0, 23.0, 29.0])
def test_an_expansion_that_passes_through_zero_is_no_mistake(t_c):
    assert found(t_c, 17.0, 19.0, 26.0) == []
    assert found(t_c, 17.0, 19.0) == []


@pytest.mark.parametrize("others_c", [[30.0], [29.7, 21.0], [31.0, 31.2]])
def test_one_map_of_nearly_the_same_temperature_shows_a_large_error_that_is_reversed(others_c):
    """EXX is 58 µm at 500 mm: half a kelvin, or one and a half, does not turn it round."""
    assert found(30.5, *others_c, EXX=-1.0, EYX=-1.0)[:1] == ["EXX"]
    assert found(30.5, *others_c) == []


@pytest.mark.parametrize(("t_c", "other_c"), [(15.0, 25.0), (18.0, 22.0), (19.5, 20.5)])
def test_with_one_other_map_a_change_of_sign_that_temperature_explains_is_no_mistake(t_c, other_c):
    assert found(t_c, other_c) == []


def test_what_nobody_can_know():
    """One other map, others that are far away, and a component that is as good as zero."""
    assert found(23.0, 18.0, EXX=-1.0) == []
    assert found(29.0, 17.0, 22.0, EXX=-1.0) == []
    assert found(20.2, 17.0, 26.0, EXX=-1.0, SXY=-1.0) == []
    assert mistakes(grown(23.0, EXX=-1.0), [grown(17.0), grown(26.0)], {}) == {}


OTHERS = [grown(17.0), grown(22.0), grown(26.0)]


@pytest.mark.parametrize(
    ("taken_for_um", "factor"),
    [(1e-3, 1e3), (1 / 25.4, 25.4), (1e3, 1e-3), (1 / 25.4e-3, 25.4e-3)],
)
def test_lengths_in_another_unit(taken_for_um, factor):
    mistaken = mistakes(grown(29.0, EXX=taken_for_um, EYX=taken_for_um), OTHERS, ASSIGNMENT)
    ((mistake, codes),) = mistaken.items()
    assert (mistake.factor, mistake.is_mirrored) == (pytest.approx(factor), False)
    assert codes == ["EXX", "EYX"]


def test_positions_from_the_other_end_of_the_axis():
    """Also of a component that has the opposite sign then, as a roll about the middle."""
    right = grown(25.0)
    about_the_middle = ComponentTable(parse_component("EZX")[0], X_MM, np.array([-9.0, 0.0, 9.0]))
    others = [
        ErrorMap(o.label, o.measured_at, o.temperatures_c, o.tables | {"EZX": about_the_middle})
        for o in OTHERS
    ]
    tables = {
        code: ComponentTable(table.component, X_MM, table.errors[::-1])
        for code, table in (right.tables | {"EZX": about_the_middle}).items()
        if table.component.is_table
    }
    mirrored = ErrorMap("mirrored", right.measured_at, right.temperatures_c, tables)
    found = mistakes(mirrored, others, ASSIGNMENT | {"EZX": "bed"})
    assert {key: set(codes) for key, codes in found.items()} == {MIRRORED: {"EXX", "EYX", "EZX"}}


@pytest.mark.parametrize("factor", [10.0, 100.0, -40.0])
def test_what_no_temperature_explains(factor):
    """EXX is 33 µm at 500 mm and 26 °C, so that at 23 °C 16 µm are right, and 150 µm are not."""
    assert inexplicable(grown(23.0, EXX=factor), OTHERS, ASSIGNMENT) == {"22.0 °C": ["EXX"]}
    assert inexplicable(grown(23.0), OTHERS, ASSIGNMENT) == {}


def test_a_copy_with_another_temperature():
    right = grown(23.0)
    copy = ErrorMap("copy", right.measured_at, {"bed": 29.0, "column": 29.0}, right.tables)
    assert copied(copy, [*OTHERS, right]) == "23.0 °C"
    assert copied(grown(23.5), [*OTHERS, right]) is None
