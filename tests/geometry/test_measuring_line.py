"""Measuring lines as users state them."""

import numpy as np
import pytest

from app.errors import InvalidContent
from app.geometry.measuring_line import MeasuringLine


def test_a_line_without_a_tool_offset_was_measured_at_the_tools_reference_point():
    assert MeasuringLine.make("z", [75, -45, 0]).tool_offset_mm == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("axis", "point", "tool", "message"),
    [
        ("x", (0.0, 1.0), (0.0, 0.0, 0.0), "expected x, y and z of a point in mm"),
        ("a", (0.0, 1.0, 2.0), (0.0, 0.0, 0.0), "expected axis x, y or z, got 'a'"),
        ("x", (0.0, np.nan, 2.0), (0.0, 0.0, 0.0), r"expected finite .* at index \[1\]"),
        ("x", (0.0, 1.0, 2.0), (0.0, 0.0, np.inf), r"expected finite .* at index \[2\]"),
        ("x", (0.0, 1.0, 2.0), 160.0, "expected x, y and z of a point in mm, got 160"),
    ],
)
def test_what_is_no_measuring_line_is_refused(axis, point, tool, message):
    with pytest.raises(InvalidContent, match=message):
        MeasuringLine.make(axis, point, tool)
