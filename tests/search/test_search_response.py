"""A response of many drivers, against formulas of dense Gaussian processes and limiting cases."""

from dataclasses import replace

import numpy as np
import pytest

from app.search.response import Course, Prior, Response
from app.search.response_average import FEWER, Predicted, caution, learn_average
from app.search.wander import Wander

NOISE = Wander(0.7, 2.0, 120.0, 3.0, 60.0)
SCALES = np.array([1.5, 0.4])
GROUPS = np.array([0, 0, 1, 1, 1])


def some_courses(seed=3, count=5, noise=1.0):
    random = np.random.default_rng(seed)
    courses = []
    for i in range(count):
        times = np.sort(random.uniform(5.0, 300.0, random.integers(6, 12)))
        columns = random.normal(size=(times.size, 5))
        values = columns @ np.array([2.0, -1.0, 0.3, 0.0, 0.1])
        values = values + noise * random.normal(size=times.size)
        courses.append(Course(times, columns, values, bool(i % 2), float(i)))
    return courses


def dense(courses, noise):
    """All set-ups as one matrix: observations, those of the zeros included, and differences."""
    total = sum(c.values.size for c in courses)
    covariance, at = np.zeros((total, total)), 0
    for course in courses:
        n = course.values.size
        t = np.append(course.times_min, 0.0)
        own = noise.over(t[:, None] - t[None, :]) + noise.white**2 * np.eye(n + 1)
        differences = np.hstack([np.eye(n), -np.ones((n, 1)) * course.is_zeroed])
        covariance[at : at + n, at : at + n] = differences @ own @ differences.T
        at += n
    columns = np.vstack([c.columns for c in courses])
    return covariance, columns, np.concatenate([c.values for c in courses])


def test_the_misfit_is_that_of_one_normal_distribution():
    """Rasmussen and Williams 2006, equation 2.30, without n/2 log 2π."""
    courses = some_courses()
    covariance, columns, values = dense(courses, NOISE)
    whole = covariance + columns * SCALES[GROUPS] ** 2 @ columns.T
    expected = 0.5 * values @ np.linalg.solve(whole, values) + 0.5 * np.linalg.slogdet(whole)[1]
    found = Response(courses, GROUPS).misfit(Prior(NOISE, SCALES))
    assert found == pytest.approx(expected, rel=1e-10)


def test_coefficients_are_those_of_conditioning_the_normal_distribution():
    """Rasmussen and Williams 2006, equations 2.25 and 2.26, in the coefficients."""
    courses = some_courses()
    covariance, columns, values = dense(courses, NOISE)
    prior = np.diag(SCALES[GROUPS] ** 2)
    gain = prior @ columns.T @ np.linalg.inv(covariance + columns @ prior @ columns.T)
    found = Response(courses, GROUPS).posterior(Prior(NOISE, SCALES), weighs=False)
    np.testing.assert_allclose(found.mean, gain @ values, rtol=1e-8)
    np.testing.assert_allclose(found.covariance, prior - gain @ columns @ prior, atol=1e-10)


def test_without_wander_and_with_a_wide_prior_it_is_least_squares():
    courses = [Course(c.times_min, c.columns, c.values, False) for c in some_courses()]
    still = Wander(1.0, 1e-9, 60.0, 1e-9, 60.0)
    found = Response(courses, GROUPS).posterior(Prior(still, np.full(2, 1e5)), weighs=False)
    columns = np.vstack([c.columns for c in courses])
    expected = np.linalg.lstsq(columns, np.concatenate([c.values for c in courses]), rcond=None)[0]
    np.testing.assert_allclose(found.mean, expected, rtol=1e-6)


@pytest.mark.parametrize("noise", [NOISE[:5], NOISE._replace(jump=1.5)])
def test_the_slope_of_the_misfit_is_its_difference(noise):
    response = Response(some_courses(), GROUPS)
    logs = np.log(np.concatenate([noise, SCALES]))
    _, slope = response.misfit_and_slope(Prior(Wander(*noise), SCALES))

    def at(i, step):
        moved = np.exp(logs + step * np.eye(logs.size)[i])
        return response.misfit(Prior(Wander(*moved[:-2]), moved[-2:]))

    expected = [(at(i, 1e-5) - at(i, -1e-5)) / 2e-5 for i in range(logs.size)]
    np.testing.assert_allclose(slope, expected, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("jump", [0.0, 4.0])
def test_where_set_ups_may_jump_the_jump_is_learnt(jump):
    """Of thirty set-ups that jump by 4 or not at all; otherwise it is 0 whatever they do."""
    random = np.random.default_rng(5)
    courses = [
        Course(c.times_min, c.columns, c.values + jump * random.normal(), True, c.began)
        for c in some_courses(count=30, noise=0.5)
    ]
    found = Response(courses, GROUPS, jumps=True).learn().prior.noise
    assert found.jump == pytest.approx(jump, abs=1.2)
    assert Response(courses, GROUPS).learn().prior.noise.jump == 0.0
    fewer = Response(courses, GROUPS, jumps=True).without_groups([0]).without(3)
    assert fewer.jumps


def test_leaving_a_set_up_out_is_a_subtraction():
    response, prior = Response(some_courses(), GROUPS), Prior(NOISE, SCALES)
    left_out = response.posterior(prior, response.normal(NOISE).without(2))
    anew = response.without(2).posterior(prior)
    np.testing.assert_allclose(left_out.mean, anew.mean, rtol=1e-8)
    np.testing.assert_allclose(left_out.covariance, anew.covariance, atol=1e-12)


def test_a_set_up_that_does_not_fit_counts_less():
    courses = some_courses(count=8, noise=0.3)
    odd = courses[4]
    courses[4] = Course(odd.times_min, odd.columns, odd.values + 40.0, odd.is_zeroed, odd.began)
    weights = Response(courses, GROUPS).posterior(Prior(NOISE, SCALES)).weights
    assert np.argmin(weights) == 4
    assert weights[4] < 0.2 < 0.8 < np.delete(weights, 4).min()


def campaign(seed, size=0.0, changed=0.0, count=14):
    """Set-ups with two sensors, one of which drives; the instrument wanders."""
    random = np.random.default_rng(seed)
    times = np.arange(10.0, 301.0, 15.0)
    courses = []
    for i in range(count):
        rise = random.choice([-10.0, -6.0, 6.0, 10.0], 2) * (1.0 - np.exp(-times / 80.0))[:, None]
        columns = np.column_stack([rise, rise[:, :1] + random.normal(0.0, 0.2, (times.size, 1))])
        own = size * (1.0 + changed * (i >= 7))
        covariance = NOISE.covariance(times[None], np.ones(1, dtype=bool))[0]
        values = own * rise[:, 0] + np.linalg.cholesky(covariance) @ random.normal(size=times.size)
        courses.append(Course(times, columns, values, True, float(i)))
    return Response(courses, np.array([0, 0, 1]))


def test_what_is_learnt_of_noise_and_scales_makes_a_set_up_left_out_foreseen():
    response = campaign(1, size=3.0)
    learnt = learn_average(response.without(0), np.empty(0, dtype=np.intp))
    found = learnt.predict(response.courses[0])
    left = response.courses[0].values - found.mean
    assert np.sqrt(np.mean(left**2)) < 0.5 * np.sqrt(np.mean(response.courses[0].values ** 2))
    assert np.mean(np.abs(left) < 2.0 * np.hypot(found.learnt, found.wander)) > 0.9
    assert learnt.dates == {None: 1.0}


def test_a_change_is_dated_and_each_side_has_its_own_response():
    response = campaign(2, size=2.0, changed=1.0)
    learnt = learn_average(response, np.array([0, 1]))
    assert sum(share for date, share in learnt.dates.items() if date in (6.0, 7.0, 8.0)) > 0.9
    course = response.courses[0]
    drive = course.columns[:, 0]
    for began, size in ((0.0, 2.0), (13.0, 4.0)):
        own = Course(course.times_min, course.columns, course.values, True, began)
        slope = learnt.predict(own).mean @ drive / (drive @ drive)
        assert slope == pytest.approx(size, abs=0.8)


@pytest.mark.slow
def test_where_nothing_drives_little_is_corrected():
    """The caution leaves nearly nothing of what wander alone suggests."""
    sizes = []
    for seed in range(6):
        response = campaign(seed)
        learnt = learn_average(response.without(0), np.array([0, 1]))
        found = learnt.predict(response.courses[0])
        sizes.append(np.abs(found.mean * found.factor).max())
    assert np.median(sizes) < 0.3


def test_larger_multiplies_all_variances():
    times, is_zeroed = np.array([[10.0, 60.0, 300.0]]), np.ones(1, dtype=bool)
    found = NOISE.larger(2.5).covariance(times, is_zeroed)
    np.testing.assert_allclose(found, 2.5 * NOISE.covariance(times, is_zeroed))


def test_without_a_sign_of_a_change_none_counts_at_least_as_much_as_all_dates_together():
    """Half of the prior, and evidence that can only fall with columns that do nothing."""
    learnt = learn_average(campaign(5, size=2.0), np.array([0, 1]))
    assert learnt.dates[None] > 0.4


def test_a_share_of_the_average_does_without_the_columns_that_are_not_sure():
    """By hand from what is learnt with and without the third column: means, and their spread."""
    response, changing = campaign(2, size=2.0, changed=1.0), np.array([0, 1])
    whole = learn_average(response, changing)
    fewer = learn_average(response.without_groups([1]), changing)
    both = learn_average(response, changing, unsure=[1])
    assert len(both.stretches) >= len(whole.stretches) > 1
    for course in response.courses:
        with_all = whole.predict(course)
        without = fewer.predict(replace(course, columns=course.columns[:, :2]))
        found = both.predict(course)
        mean = (1.0 - FEWER) * with_all.mean + FEWER * without.mean
        spread = FEWER * (1.0 - FEWER) * (with_all.mean - without.mean) ** 2
        variance = (1.0 - FEWER) * with_all.learnt**2 + FEWER * without.learnt**2 + spread
        np.testing.assert_allclose(found.mean, mean, rtol=1e-9)
        np.testing.assert_allclose(found.learnt**2, variance, rtol=1e-6)
    assert sum(both.dates.values()) == pytest.approx(1.0)
    again = learn_average(response, changing, unsure=[1], start=both.priors, iterations=1)
    np.testing.assert_allclose(
        again.predict(response.courses[0]).mean, both.predict(response.courses[0]).mean, atol=0.5
    )


def test_caution_grows_with_what_is_not_known():
    mean = np.array([4.0, 4.0, 0.0])
    found = caution(mean, np.array([0.0, 4.0, 1.0]), np.zeros(3))
    np.testing.assert_allclose(found, [1.0, 0.5, 0.0])
    assert Predicted(mean, np.zeros(3), np.full(3, 3.0)).factor[0] == pytest.approx(16 / 25)
