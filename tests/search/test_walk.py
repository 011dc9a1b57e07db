"""A trend that a walking zero would make is not taken for the machine's, and a true one is."""

import numpy as np
import pytest

from app.search.priors import WALK_SIZES
from app.search.walk import MOST_LEVELS, may_be_walk, walk_seen

NEVER = 10.0


def levels(seed, setups, *, trend=0.0, step=0.0, walk=0.0, scatter=0.3, each=6):
    """Values of so many set-ups, the course that is taken for the cause, and their numbers."""
    rng = np.random.default_rng(seed)
    course = np.linspace(0.0, 1.0, setups)
    if step:
        course = (course >= 0.5) * 1.0
    level = (trend + step) * course + scatter * rng.normal(size=setups)
    level += np.cumsum(walk * rng.normal(size=setups))
    visit = np.repeat(np.arange(setups), each)
    values = level[visit] + rng.normal(size=setups * each)
    fitted = course[visit] * (course[visit] @ values) / (course[visit] @ course[visit])
    return values, fitted, visit


def share(count, **stated):
    return np.mean([may_be_walk(*levels(seed, **stated)) is True for seed in range(count)])


@pytest.mark.parametrize("walk", [0.3, 1.0, 2.0])
@pytest.mark.slow
def test_a_walk_is_hardly_ever_taken_for_a_trend(walk):
    assert share(40, setups=24, walk=walk) >= 0.95


@pytest.mark.parametrize("setups", [24, 60])
def test_a_trend_that_is_well_above_the_scatter_is_none(setups):
    assert share(20, setups=setups, trend=8.0) <= 0.05


def test_a_step_is_no_walk():
    assert share(20, setups=24, step=3.0) <= 0.05


def test_signs_units_of_the_term_and_the_order_of_rows_change_nothing():
    values, fitted, visit = levels(3, 24, trend=8.0)
    order = np.random.default_rng(0).permutation(len(visit))
    assert may_be_walk(values, fitted, visit) is False
    assert may_be_walk(-values, -fitted, visit) is False
    assert may_be_walk(values[order], fitted[order], visit[order]) is False
    assert may_be_walk(values, 0.5 * fitted, visit + 7) is False


def test_a_course_over_the_places_counts_as_far_as_it_reaches():
    values, fitted, visit = levels(3, 24, trend=8.0)
    side = np.where(np.arange(len(visit)) % 2, 1.0, -1.0)
    assert may_be_walk(side * values, side * fitted, visit) is False


def test_a_zero_walks_in_set_ups_too_in_which_the_channel_does_not_show():
    """Shown in every tenth, it has gone √10 steps on each time: two of the sizes that are tried."""
    values, _, visit = levels(5, 12, walk=1.0)
    shape = (len(WALK_SIZES), len(WALK_SIZES))
    each, tenth = (walk_seen(values, n * visit).reshape(shape) for n in (1, 10))
    larger, smaller = each[:, 3:], tenth[:, 1:-2]
    np.testing.assert_allclose(smaller / smaller.sum(), larger / larger.sum(), rtol=1e-6)


def test_too_few_set_ups_and_all_alike_say_nothing():
    assert may_be_walk(*levels(1, 3, trend=NEVER)) is None
    values, fitted, visit = levels(1, 24)
    assert may_be_walk(values, np.ones_like(fitted), visit) is None


def test_very_many_set_ups_are_taken_together():
    assert may_be_walk(*levels(5, 5 * MOST_LEVELS, trend=8.0, each=2)) is False


@pytest.mark.slow
def test_what_other_channels_show_of_the_instrument_counts():
    def seen(walk):
        found = []
        for seed in range(100, 110):
            values, _, visit = levels(seed, 20, walk=walk)
            found.append(walk_seen(values, visit))
        return found

    quiet, walking = seen(0.0), seen(1.0)
    judged = [levels(seed, 20, trend=5.0) for seed in range(20)]
    among_quiet = [may_be_walk(*one, quiet) for one in judged]
    among_walking = [may_be_walk(*one, walking) for one in judged]
    assert sum(among_quiet) <= 2
    assert sum(among_walking) >= 10
