"""Components of a map that would fit the other maps with the opposite sign."""

from datetime import UTC, datetime

import numpy as np
import pytest

from app.geometry.components import parse_component
from app.thermal.error_map import ComponentTable, ErrorMap
from app.thermal.reversed_signs import reversed_components

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
    return reversed_components(grown(t_c, **sign), [grown(t) for t in others_c], ASSIGNMENT)


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
    assert reversed_components(grown(23.0, EXX=-1.0), [grown(17.0), grown(26.0)], {}) == []
