"""The jump of set-ups as they begin, against dense distributions and known sizes."""

import numpy as np
import pytest
from scipy.stats import multivariate_t

from app.search.jump import held_out_jump
from app.search.response import Course, Prior
from app.search.response_average import Average, Priors, Stretch
from app.search.wander import JUMP_MIN, Wander, jumped

NOISE = Wander(0.5, 1.0, 120.0, 1.0, 60.0)
TIMES_MIN = np.arange(10.0, 301.0, 10.0)


def average(noise=NOISE):
    """A response of one driver that was learnt: 2 ± 0.1."""
    learnt = Stretch(np.inf, np.array([2.0]), np.array([[0.01]]))
    prior = Prior(noise, np.ones(1))
    return Average(Priors(prior, {}), noise, [learnt], {None: 1.0}, np.ones(1), 0.0)


def held_out(jump, count=20, seed=1, is_zeroed=True):
    random = np.random.default_rng(seed)
    times_min = TIMES_MIN
    root = np.linalg.cholesky(NOISE.covariance(times_min[None], np.array([is_zeroed]))[0])
    courses = []
    for _ in range(count):
        columns = random.normal(size=(times_min.size, 1))
        values = columns[:, 0] * random.normal(2.0, 0.1) + root @ random.normal(size=30)
        values = values + jump * random.normal() * jumped(times_min)
        courses.append(Course(times_min, columns, values, is_zeroed))
    return courses


@pytest.mark.parametrize("jump", [2.0, 4.0, 8.0])
def test_a_jump_is_found_at_its_size(jump):
    """Forty set-ups know a standard deviation to a ninth, and these wander beside it."""
    found = held_out_jump([(one, average()) for one in held_out(jump, count=40)])
    assert found == pytest.approx(jump, rel=0.35)


def test_without_a_jump_little_is_found():
    for seed in range(5):
        courses = held_out(0.0, seed=seed)
        assert held_out_jump([(one, average()) for one in courses]) < 0.5


def test_a_set_up_that_drifts_by_60_does_not_make_all_others_jump():
    courses = held_out(0.0)
    odd = courses[3]
    courses[3] = Course(TIMES_MIN, odd.columns, odd.values + 0.2 * TIMES_MIN, True)
    assert held_out_jump([(one, average()) for one in courses]) < 1.0


def test_it_is_what_dense_distributions_of_students_t_make_most_likely():
    """multivariate_t's shape is the covariance of what is foretold, jump included."""
    courses = held_out(2.0, count=6)

    def likely(jump):
        total = 0.0
        for one in courses:
            noise = NOISE._replace(jump=jump)
            foretold = noise.covariance(one.times_min[None], np.array([True]))[0]
            foretold += 0.01 * one.columns @ one.columns.T
            total += multivariate_t.logpdf(one.values, 2.0 * one.columns[:, 0], foretold, df=4)
        return total

    found = held_out_jump([(one, average()) for one in courses])
    sizes = np.linspace(0.0, 6.0, 601)
    assert found == pytest.approx(sizes[np.argmax([likely(size) for size in sizes])], abs=0.01)


def test_what_has_no_zero_of_its_own_does_not_jump():
    courses = held_out(0.0, is_zeroed=False)
    assert held_out_jump([(one, average()) for one in courses]) == 0.0


def test_a_jump_is_complete_within_minutes_and_what_follows_is_off_together():
    noise = Wander(0.0, 0.0, 1.0, 0.0, 1.0, jump=2.0)
    times_min = np.array([[JUMP_MIN, 1e3, 2e3]])
    found = noise.covariance(times_min, np.array([True]))[0]
    share = np.array([1.0 - np.exp(-1.0), 1.0, 1.0])
    np.testing.assert_allclose(found, 4.0 * np.outer(share, share))
    np.testing.assert_allclose(noise.variance(times_min[0], is_zeroed=True), np.diag(found))
    assert not noise.covariance(times_min, np.array([False])).any()
    assert noise.larger(4.0).jump == 4.0
