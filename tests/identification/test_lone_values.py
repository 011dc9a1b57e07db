"""Single values that are far from the others of their visit."""

import numpy as np
import pytest

from app.identification.watch.lone_values import lone_values


def found(left, stated=None):
    return lone_values(range(len(left)), np.asarray(left), stated)


def test_one_that_was_mistyped_among_forty():
    left = np.random.default_rng(1).normal(0.0, 0.5, 40)
    left[7] += 90.0
    (one,) = found(left - left.mean())
    assert one.row == 7
    assert one.off == pytest.approx(90.0, abs=2.0)
    assert one.scatter == pytest.approx(0.5, rel=0.4)


def test_honest_scatter_has_none():
    """A thousand visits, of a normal distribution, in steps of two sigma, and of a wave."""
    rng = np.random.default_rng(2)
    for _ in range(1000):
        left = rng.normal(0.0, 0.5, 40)
        assert found(left) == []
        assert found(np.round(left), 0.5) == []
    assert found(20.0 * np.sin(np.arange(40.0))) == []


@pytest.mark.parametrize(
    "left",
    [
        [0.0, 0.1, -0.1, 90.0],  # too few to say which is the lone one
        [0.0] * 20 + [50.0] * 20,  # as many the other way
        [*np.random.default_rng(3).normal(0.0, 0.5, 36), 30.0, 30.0, 30.0, 30.0, 30.0],
        [0.0] * 39 + [1.0],  # an instrument of coarse steps, of which nothing is stated
    ],
)
def test_where_nobody_knows(left):
    assert found(left) == []
