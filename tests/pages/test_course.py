"""Two hours of a temperature, drawn: what was not believed does not set the scale."""

import re

import numpy as np

from app.pages.dashboard.charts import course_svg
from app.services.dashboard import Course


def heights(svg):
    (points,) = re.findall(r'class="now" points="([^"]+)"', svg)
    return [float(point.split(",")[1]) for point in points.split()]


def test_a_value_that_was_not_believed_is_a_mark_at_the_edge():
    times_s = np.array([-300.0, -200.0, -100.0])
    values = np.array([25.0, 25.5, 26.0])
    plain = course_svg(Course(times_s, values, 600.0), (18.0, 31.0), "a")
    spike = Course(times_s, values, 600.0, np.array([-250.0, -150.0]), np.array([999.0, 27.0]))
    drawn = course_svg(spike, (18.0, 31.0), "a")
    assert heights(drawn) == heights(plain)
    marks = re.findall(r'class="rejected" d="M\d+,(-?\d+)h0"', drawn)
    assert len(marks) == 2
    assert marks[0] == "0"
    assert 0 < int(marks[1]) < min(heights(drawn))
