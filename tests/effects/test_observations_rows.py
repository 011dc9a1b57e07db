"""Verifications as rows: channels, visits, repeats, and what zero means."""

from dataclasses import replace

import numpy as np
import pytest

from app.effects.observations import (
    Observation,
    Verification,
    observation_rows,
    repeated_rows,
)
from app.errors import InvalidContent
from app.search.rows import Datum


def line(begin_s, code="EXX", positions=(0.0, 100.0), direction=1, step_s=60.0, values=None):
    axis = "xyz".index(code[-1].lower())
    directions = tuple(direction if i == axis else 0 for i in range(3))
    return [
        Observation(
            begin_s + i * step_s,
            (float(i) if values is None else values[i],),
            code,
            at,
            directions=directions,
        )
        for i, at in enumerate(positions)
    ]


def point(time_s, tool=(0.0, 0.0, 100.0), at=(1.0, 2.0, 3.0)):
    return Observation(time_s, (0.1, 0.2, 0.3), point_mm=at, tool_offset_mm=tool)


def test_components_come_in_the_order_of_tables_and_points_last():
    squareness = Observation(0.0, (-8.2,), "SXY")
    rows = observation_rows(
        [Verification("v", [point(5.0), squareness, *line(0.0, "EZZ"), *line(0.0)])]
    )
    assert rows.channels == ("EXX", "EZZ", "SXY", "points x", "points y", "points z")
    assert rows.measured[rows.of_channel("points y")].tolist() == [0.2]
    assert rows.components == ("EXX", "EZZ", "SXY")
    assert np.isnan(rows.points_mm[rows.of_channel("SXY")]).all()
    at_z = rows.points_mm[rows.of_channel("EZZ")]
    assert np.isnan(at_z[:, :2]).all()
    assert at_z[:, 2].tolist() == [0.0, 100.0]
    assert rows.of_channel("EYY").size == 0


def test_visits_are_verifications_numbered_in_time():
    later = Verification("later", [*line(50000.0), *line(60000.0)])
    earlier = Verification("earlier", line(0.0))
    rows = observation_rows([later, earlier])
    # A pause does not say that the instrument was mounted again.
    assert rows.visit.tolist() == [1, 1, 1, 1, 0, 0]
    assert rows.visits == 2


def in_setup(name, observations):
    return [replace(one, setup=name) for one in observations]


def test_a_stated_setup_is_a_visit_with_a_zero_of_its_own():
    second = [*in_setup("b", line(60.0)), *in_setup("a", line(0.0)), *in_setup("b", line(180.0))]
    rows = observation_rows(
        [Verification("v", second, Datum.FREE), Verification("w", in_setup("a", line(10.0)))]
    )
    # The same word in another verification is another set-up.
    assert rows.visit.tolist() == [2, 2, 0, 0, 2, 2, 1, 1]
    assert rows.datum() == {(0, 0): Datum.FREE, (2, 0): Datum.FREE}


def test_what_states_no_setup_is_one_beside_those_that_are_stated():
    rows = observation_rows([Verification("v", [*line(0.0), *in_setup("b", line(30.0))])])
    assert rows.visit.tolist() == [0, 0, 1, 1]


def test_repeats_share_place_direction_visit_and_time():
    there = line(0.0) + line(60.0) + line(90.0, direction=-1)
    rows = observation_rows([Verification("v", [*there, *line(200.0)])])
    # The third run comes from the other side, the fourth more than two minutes later.
    assert rows.replicate.tolist() == [0, 1, 0, 1, -1, -1, -1, -1]


def test_repeats_share_tool_and_state():
    different = [
        Observation(float(t), (0.0,), "EXX", 5.0, state={"rpm": rpm})
        for t, rpm in enumerate((0.0, 0.0, 9.0))
    ]
    assert observation_rows([Verification("v", different)]).replicate.tolist() == [0, 0, -1]
    tools = [point(0.0), point(1.0), point(2.0, tool=(0.0, 0.0, 200.0))]
    rows = observation_rows([Verification("v", tools)])
    assert rows.replicate[rows.of_channel("points x")].tolist()[2] == -1
    assert rows.replicate[rows.of_channel("points x")][:2].tolist() == [0, 0]


def test_datum_is_told_by_visit_and_channel():
    rows = observation_rows(
        [
            Verification("zeroed", line(0.0) + line(0.0, "EYY"), Datum.FIRST),
            Verification("absolute", line(90000.0)),
        ]
    )
    assert rows.datum() == {(0, 0): Datum.FIRST, (0, 1): Datum.FIRST}


def test_word_for_word_repeats_are_found_and_replicates_are_not():
    rows = observation_rows(
        [Verification("twice", line(0.0) + line(0.0)), Verification("again", line(300.0))]
    )
    assert repeated_rows(rows).tolist() == [False, False, True, True, False, False]


def test_rows_can_be_taken():
    rows = observation_rows([Verification("v", [*line(0.0), point(100.0)])])
    some = rows.take(rows.at_points)
    assert len(some) == 3
    assert some.has_points
    assert some.channels == rows.channels


@pytest.mark.parametrize(
    "wrong",
    [
        {"component": "EXX", "measured": (1.0, 2.0, 3.0), "position_mm": 1.0},
        {"component": None, "measured": (1.0,)},
        {"component": "EXX", "measured": (1.0,)},
        {"component": "QQQ", "measured": (1.0,)},
        {"component": "EXX", "measured": (1.0,), "point_mm": (0.0, 0.0, 0.0)},
    ],
)
def test_impossible_observations_are_refused(wrong):
    with pytest.raises(InvalidContent, match="expected"):
        Observation(0.0, **wrong)


def test_no_observation_is_refused():
    with pytest.raises(InvalidContent, match="at least one"):
        observation_rows([Verification("empty", [])])
