"""What one model covers that another does not, at every temperature and position."""

import math
from itertools import pairwise

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from app.effects.adopted.model_difference import (
    ModelWithEffects,
    model_difference,
    spans_beyond,
)
from app.effects.effect import Effect
from app.thermal.compile_model import compile_model
from app.thermal.coverage import Coverage, CoveredInterval
from tests.effect_examples import BACKLASH, ROLL, SPEED
from tests.thermal.example_maps import machine


def covering(*intervals, sensor="x-middle"):
    return Coverage(sensor, tuple(CoveredInterval(*i, "a", "b") for i in intervals))


@st.composite
def coverages(draw):
    """Intervals that follow one another without a gap, each with its own range."""
    ends = sorted(draw(st.sets(st.integers(10, 40), min_size=2, max_size=5)))
    found = []
    for low, high in pairwise(ends):
        start = draw(st.integers(0, 400))
        found.append((low, high, start, start + draw(st.integers(1, 300))))
    return covering(*found)


def is_covered(coverage, t_c, x_mm):
    return any(
        i.from_c <= t_c <= i.to_c and i.from_mm <= x_mm <= i.to_mm for i in coverage.intervals
    )


@given(coverages(), coverages())
def test_a_place_is_lost_if_and_only_if_one_has_it_and_the_other_has_not(one, other):
    """Held against every place of a grid that meets no end: half-way between whole numbers."""
    spans = spans_beyond(one, other)
    for t_c in np.arange(9.5, 41.0):
        for x_mm in np.arange(0.5, 700.0, 13.0):
            lost = any(s.from_c < t_c < s.to_c and s.from_mm < x_mm < s.to_mm for s in spans)
            assert lost == (is_covered(one, t_c, x_mm) and not is_covered(other, t_c, x_mm))


@given(coverages())
def test_a_model_loses_nothing_against_itself(one):
    assert spans_beyond(one, one) == []


def test_intervals_that_lose_the_same_are_told_as_one():
    long = covering((-math.inf, 20, 0, 500), (20, 24, 0, 500), (24, math.inf, 0, 500))
    short = covering((-math.inf, 24, 0, 100), (24, math.inf, 0, 500))
    assert spans_beyond(long, short) == [(-math.inf, 24, 100, 500)]


def test_under_another_sensor_what_holds_at_every_temperature_counts():
    long = covering((20, 24, 0, 500), (24, 30, 0, 400))
    short = covering((0, 5, 0, 300), (5, 9, 100, 500), sensor="spindle")
    everywhere = (-math.inf, math.inf)
    assert spans_beyond(long, short) == [(*everywhere, 0, 100), (*everywhere, 300, 400)]


def test_effects_give_and_take_components():
    model = compile_model(machine(), [], {})
    plain, rolled = ModelWithEffects(model), ModelWithEffects(model, [ROLL, BACKLASH])
    found = model_difference(rolled, plain)
    assert [(p.component, p.what) for p in found.loses] == [
        ("EXX", "component"),
        ("EAX", "component"),
    ]
    assert model_difference(plain, rolled).loses == ()


def test_a_state_that_no_reading_states_makes_tables_incomplete():
    model = compile_model(machine(), [], {})
    before, after = ModelWithEffects(model, [ROLL]), ModelWithEffects(model, [ROLL, SPEED])
    (lost,) = model_difference(before, after, known_states=()).loses
    assert (lost.what, "spindle_rpm" in lost.text) == ("completeness", True)
    assert model_difference(before, after, known_states={"spindle_rpm"}).loses == ()
    assert model_difference(before, after, known_states=None).loses == ()


def test_what_is_incomplete_already_does_not_hide_what_else_would_be():
    model = compile_model(machine(), [], {})
    needs_feed = Effect("state-variable", ("EXX",), states=("feed",), terms=SPEED.terms)
    before = ModelWithEffects(model, [ROLL, needs_feed])
    after = ModelWithEffects(model, [ROLL, needs_feed, SPEED])
    (lost,) = model_difference(before, after, known_states=()).loses
    assert "spindle_rpm" in lost.text
    assert model_difference(before, before, known_states=()).loses == ()
