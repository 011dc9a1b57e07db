"""What a map may say, and the sentence that answers what it may not."""

import numpy as np
import pytest

from app.errors import InvalidContent
from app.geometry.components import COMPONENTS
from app.thermal.error_map import VALUE_LIMIT, ComponentTable
from tests.thermal.example_maps import table


def test_a_table_copies_what_it_is_given_and_nobody_changes_it():
    errors = np.array([0.0, 1.2])
    made = table("EXX", errors, [0, 50])
    errors[1] = 99.0
    assert made.errors.tolist() == [0.0, 1.2]
    assert made.positions_mm.dtype == np.float64
    for array in (made.errors, made.positions_mm):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


def test_one_position_means_that_the_error_does_not_depend_on_it():
    assert not table("EXX", [3.0], [250.0]).depends_on_position
    assert table("EXX", [3.0, 4.0], [0.0, 250.0]).depends_on_position


def test_a_component_without_argument_is_one_value():
    assert table("SXY", [-12.1]).errors.tolist() == [-12.1]
    assert ComponentTable.make(COMPONENTS["SXY"], -12.1).errors.tolist() == [-12.1]


@pytest.mark.parametrize(
    ("arguments", "field", "sentence"),
    [
        (
            ("EXX", [1.0, 2.0], [0.0, 0.0]),
            "positions_mm",
            "expected strictly increasing positions of EXX in mm, got 0 then 0 (twice, at index 1",
        ),
        (
            ("EXX", [1.0, 2.0, 3.0], [0.0, 50.0, 40.0]),
            "positions_mm",
            "positions of EXX in mm, got 50 then 40 (out of order, at index 2)",
        ),
        (
            ("EXX", [], []),
            "positions_mm",
            "expected at least one position of EXX in mm, got none",
        ),
        (
            ("EXX", [1.0, 2.0], [0.0, np.inf]),
            "positions_mm",
            "expected finite positions of EXX in mm, got inf (at index 1)",
        ),
        (
            ("EXX", [1.0], [0.0, 50.0]),
            "errors_um",
            "expected 2 values of EXX in µm, one for each position, got 1",
        ),
        (
            ("EBX", [1.0, np.nan], [0.0, 50.0]),
            "errors_urad",
            "expected finite values of EBX in µrad, got nan (at index 1)",
        ),
        (
            ("EYY^x", [1.0, 2e6], [0.0, 50.0]),
            "slopes_um_per_m",
            "expected errors within ±1e+06 µm/m, got 2e+06",
        ),
        (
            ("SXY", [1.0], [0.0]),
            "positions_mm",
            "SXY has no positions: it is one value",
        ),
        (
            ("SXY", [1.0, 2.0]),
            "value_um_per_m",
            "expected one value of SXY in µm/m, got 2",
        ),
        (
            ("EXX", [1.0, 2.0], [0.0, 50.0], [1.0]),
            "backward_errors_um",
            "expected 2 values of EXX in µm, one for each position, got 1",
        ),
        (
            ("EXX", [1.0, 2.0], [0.0, 50.0], [1.0, -np.inf]),
            "backward_errors_um",
            "expected finite values of EXX in µm, got -inf (at index 1)",
        ),
        (
            ("SXY", [1.0], (), [1.0]),
            "backward_value_um_per_m",
            "SXY is one value and has no direction of approach",
        ),
        (
            ("EXX", [[1.0, 2.0]], [0.0, 50.0]),
            "errors_um",
            "expected 2 values of EXX in µm",
        ),
    ],
)
def test_what_cannot_be_right_is_refused_with_field_and_unit(arguments, field, sentence):
    with pytest.raises(InvalidContent) as refusal:
        table(*arguments)
    assert sentence in refusal.value.detail
    assert [e.field for e in refusal.value.errors] == [field]


@pytest.mark.parametrize("value", [VALUE_LIMIT, -VALUE_LIMIT])
def test_a_metre_is_the_largest_error(value):
    assert table("SXY", [value]).errors[0] == value
    with pytest.raises(InvalidContent, match="expected errors within"):
        table("SXY", [np.nextafter(value, 2 * value)])
