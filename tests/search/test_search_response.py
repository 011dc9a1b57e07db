"""A response of many drivers, against dense Gaussian processes and limiting cases."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from app.arrays import rms
from app.search.response import (
    Course,
    Fitted,
    Group,
    Response,
    learn_response,
    least_harm,
)
from app.search.wander import Wander

NOISE = Wander(0.7, 2.0, 120.0, 3.0, 60.0)
EXPECTED = np.array([0.0, 0.0, 0.0, 0.0, -0.5])


def groups():
    """Two columns of one scale, the difference of two, and one whose scale is given."""
    one, other = np.eye(5)[:, :2], np.array([[0.0, 0.0, 1.0, -1.0, 0.0]]).T
    maps = np.eye(5)[:, 4:]
    return [Group("a", one, one), Group("b", other, one), Group("c", maps, maps, 0.5)]


def some_courses(seed=3, count=5, slopes=(2.0, -1.0, 0.3, -0.3, 0.1), noise=1.0):
    random = np.random.default_rng(seed)
    courses = []
    for i in range(count):
        times = np.sort(random.uniform(5.0, 300.0, random.integers(6, 12)))
        columns = random.normal(size=(times.size, 5))
        values = columns @ np.array(slopes) + noise * random.normal(size=times.size)
        courses.append(Course(times, columns, values, bool(i % 2), 3.0 * i))
    return courses


def response(**changes):
    return replace(Response(some_courses(), groups(), EXPECTED), **changes)


LOGARITHMS = np.log([1.5, 0.4, 0.3, 0.4, 5.0, 0.3, *NOISE])


def dense(one, logarithms):
    """All rows as one matrix, by the equations of the module: row by row, and no algebra."""
    s = one.scales(logarithms)
    rows = [
        (i, course, j) for i, course in enumerate(one.courses) for j in range(len(course.values))
    ]
    weights = np.ones(len(one.courses)) if one.weights is None else one.weights
    prior = sum(
        scale**2 * group.directions @ group.directions.T
        for scale, group in zip(s.groups, one.groups, strict=True)
    )

    def wander(course, a, b):
        t, zero = course.times_min, float(course.is_zeroed)
        found = s.noise.over(np.array(t[a] - t[b])) + zero * (
            s.noise.over(np.array(0.0)) - s.noise.over(t[a : a + 1]) - s.noise.over(t[b : b + 1])
        )
        return np.ravel(found)[0] + s.noise.white**2 * (zero + (a == b))

    explained = np.mean([c.columns[a] @ prior @ c.columns[a] for _, c, a in rows])
    values = np.array([c.values[a] - c.columns[a] @ one.expected for _, c, a in rows])
    share = np.mean(values**2) / (np.mean(values**2) + explained)
    covariance = np.empty((len(rows), len(rows)))
    for x, (i, c, a) in enumerate(rows):
        for y, (j, d, b) in enumerate(rows):
            apart = abs(c.began - d.began)
            alike = s.drift**2 * np.exp(-apart / s.drift_span)
            alike = 1.0 + share * (alike + s.own**2 / weights[i] * (i == j))
            covariance[x, y] = alike * (c.columns[a] @ prior @ d.columns[b])
            covariance[x, y] += wander(c, a, b) / weights[i] if i == j else 0.0
    return covariance, prior, values, share


@pytest.mark.parametrize("weights", [None, np.array([1.0, 0.3, 1.2, 0.8, 1.0])])
def test_the_misfit_is_that_of_one_normal_distribution(weights):
    """Rasmussen and Williams 2006, equation 2.30, without n/2 log 2π; and the priors."""
    one = response(weights=weights)
    covariance, _, values, _ = dense(one, LOGARITHMS)
    expected = 0.5 * values @ np.linalg.solve(covariance, values)
    expected += 0.5 * np.linalg.slogdet(covariance)[1]
    units, n = one._units, len(one.groups)
    expected += float((np.exp(LOGARITHMS[:n]) / units - LOGARITHMS[:n]).sum())
    expected += 0.5 * float((((LOGARITHMS - one.start)[n:] / one._spread) ** 2).sum())
    np.testing.assert_allclose(one.covariance(one.scales(LOGARITHMS)), covariance, rtol=1e-9)
    assert one.misfit_and_slope(LOGARITHMS)[0] == pytest.approx(expected, rel=1e-9)
    assert units[2] == 0.5
    assert units[0] == units[1]


@pytest.mark.parametrize("weights", [None, np.array([1.0, 0.3, 1.2, 0.8, 1.0])])
def test_the_slope_of_the_misfit_is_its_slope(weights):
    one = response(weights=weights)
    _, slope = one.misfit_and_slope(LOGARITHMS)
    for i in range(LOGARITHMS.size):
        step = np.where(np.arange(LOGARITHMS.size) == i, 1e-5, 0.0)
        up, down = (one.misfit_and_slope(LOGARITHMS + s * step)[0] for s in (1, -1))
        assert slope[i] == pytest.approx((up - down) / 2e-5, rel=1e-5, abs=1e-6)


@pytest.mark.parametrize("without", [None, 2])
def test_a_prediction_is_that_of_conditioning_the_normal_distribution(without):
    """Equations 2.25 and 2.26, with all rows and without those of one set-up."""
    one = response()
    s = one.scales(LOGARITHMS)
    covariance, prior, values, share = dense(one, LOGARITHMS)
    kept = one.of != (-1 if without is None else without)
    asked = np.random.default_rng(8).normal(size=(4, 5))
    apart = np.abs(np.array([c.began for c in one.courses])[one.of] - 7.0)
    near = 1 + share * s.drift**2 * np.exp(-apart / s.drift_span)
    cross = asked @ prior @ one.columns.T * near
    cross, inner = cross[:, kept], covariance[np.ix_(kept, kept)]
    mean = asked @ EXPECTED + cross @ np.linalg.solve(inner, values[kept])
    fitted = Fitted(one, LOGARITHMS)
    variance = np.diag(asked @ prior @ asked.T) * (1 + share * (s.drift**2 + s.own**2))
    variance -= np.diag(cross @ np.linalg.solve(inner, cross.T))
    found = fitted.predict(asked, 7.0, without)
    np.testing.assert_allclose(found.mean, mean, rtol=1e-9)
    np.testing.assert_allclose(found.learnt, np.sqrt(variance), rtol=1e-9)
    if without is None:
        np.testing.assert_allclose(asked @ fitted.coefficients(7.0), mean, rtol=1e-9)
        by = np.diag(asked @ fitted.covariance(7.0) @ asked.T)
        np.testing.assert_allclose(by, variance, rtol=1e-9)
        parts = fitted.parts().sum(axis=0)
        everything = np.concatenate([c.columns @ fitted.coefficients(c.began) for c in one.courses])
        np.testing.assert_allclose(parts + one.columns @ EXPECTED, everything, rtol=1e-9)


def test_where_set_ups_are_alike_it_is_a_bayesian_ridge():
    """ρ and ν at nothing, white noise alone, the same scale for all: (X'X + λ)⁻¹ X'y."""
    courses = [replace(c, is_zeroed=False) for c in some_courses()]
    each = [Group("all", np.eye(5), np.eye(5))]
    one = Response(courses, each, np.zeros(5))
    logarithms = np.log([1.5, 1e-9, 5.0, 1e-9, 0.7, 1e-9, 300.0, 1e-9, 100.0])
    fitted = Fitted(one, logarithms)
    values = np.concatenate([c.values for c in courses])
    inner = one.columns.T @ one.columns + (0.7 / 1.5) ** 2 * np.eye(5)
    ridge = np.linalg.solve(inner, one.columns.T @ values)
    np.testing.assert_allclose(fitted.common(), ridge, rtol=1e-9)
    np.testing.assert_allclose(fitted.coefficients(99.0), ridge, rtol=1e-9)
    np.testing.assert_allclose(fitted.covariance(0.0), 0.7**2 * np.linalg.inv(inner), rtol=1e-7)


def test_a_driver_beyond_what_was_seen_is_less_sure():
    one = response()
    fitted = Fitted(one, LOGARITHMS)
    asked = np.random.default_rng(8).normal(size=(1, 5))
    once, far = (fitted.predict(by * asked, 7.0).learnt[0] for by in (1.0, 10.0))
    assert far == pytest.approx(10.0 * once)
    _, prior, _, share = dense(one, LOGARITHMS)
    least = share * fitted.scales.own**2 * asked @ prior @ asked.T  # its own part is never known
    assert once**2 > least


def test_how_far_set_ups_differ_is_a_share_of_what_they_do():
    """Two drivers that hardly differ cancel: their coefficients are large, the response is not."""
    random = np.random.default_rng(4)
    level, apart = random.normal(size=200), 0.01 * random.normal(size=200)
    columns = np.column_stack([level, level + apart])
    course = Course(np.arange(200.0), columns, columns @ [-100.0, 100.0], is_zeroed=False)
    one = Response([course], [Group("both", np.eye(2), np.eye(2))], np.zeros(2))
    groups = np.array([100.0])
    differ = one.share(groups) * np.mean(np.diag(100.0**2 * columns @ columns.T))
    assert differ == pytest.approx(rms(course.values) ** 2, rel=1e-3)


def test_parts_of_one_record_share_its_wander_and_what_it_adds_of_its_own():
    alone = [replace(c, is_zeroed=False) for c in some_courses()[:2]]
    courses = [replace(c, record=7) for c in alone]
    apart, parts = (response(courses=each) for each in (alone, courses))
    scales = apart.scales(LOGARITHMS)
    rows, other = np.flatnonzero(apart.of == 0), np.flatnonzero(apart.of == 1)
    more = (parts.covariance(scales) - apart.covariance(scales))[np.ix_(rows, other)]
    _, prior, _, share = dense(apart, LOGARITHMS)
    expected = share * scales.own**2 * courses[0].columns @ prior @ courses[1].columns.T
    apart_min = courses[0].times_min[:, None] - courses[1].times_min
    expected = expected + NOISE.over(apart_min)
    np.testing.assert_allclose(more, expected, rtol=1e-9)


def test_a_set_up_unlike_all_others_counts_less_and_moves_the_others_less():
    courses = some_courses(count=8)
    odd = replace(courses[3], values=courses[3].values + 40.0 * np.sin(courses[3].times_min))
    strange = [*courses[:3], odd, *courses[4:]]
    fitted = learn_response(response(courses=strange))
    weights = fitted.response.weights
    assert weights[3] < 0.75 < weights[[0, 1, 2, 4, 5, 6, 7]].min()
    right = learn_response(response(courses=courses)).common()
    plain = response(courses=strange).learn().common()
    assert np.abs(fitted.common() - right).sum() < np.abs(plain - right).sum()


def lagged(kind, seed, gain=0.0, count=16, rows=30):
    """Set-ups of five hours in which six sensors warm unlike each other; one of them drives."""
    random = np.random.default_rng(seed)
    courses, true = [], []
    for i in range(count):
        t = np.linspace(10.0, 300.0, rows)
        rise = [random.normal(5, 3) * (1 - np.exp(-t / tau)) for tau in (15, 30, 60, 90, 150, 250)]
        columns = np.column_stack(rise)
        wanders = {"rough": (3.0, 300.0, 1e-9, 1.0), "smooth": (1e-9, 1.0, 3.0, 100.0)}
        noise = Wander(0.3, *wanders[kind])
        root = np.linalg.cholesky(noise.covariance(t, is_zeroed=True) + 1e-9 * np.eye(rows))
        wander = root @ random.normal(size=rows)
        courses.append(Course(t, columns, gain * columns[:, 2] + wander, True, float(i)))
        true.append(gain * columns[:, 2])
    return courses, true


def held_out(courses):
    one = Group("sensors", np.eye(6), np.eye(6))
    fitted = learn_response(Response(courses, [one], np.zeros(6)))
    found = []
    for i, course in enumerate(courses):
        said = fitted.predict(course.columns, course.began, without=i)
        wander = fitted.scales.noise.variance(course.times_min, is_zeroed=True)
        sd = np.sqrt(said.learnt**2 + wander)
        found.append((said.mean, sd, least_harm(said.mean, sd, np.zeros(sd.size))))
    return found, fitted


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["rough", "smooth"])
def test_where_nothing_drives_next_to_nothing_is_corrected(kind):
    """The correction's variance is a small share of the wander's, in set-ups held out."""
    shares = []
    for seed in range(4):
        courses, _ = lagged(kind, seed)
        corrected = np.concatenate([one[2] for one in held_out(courses)[0]])
        values = np.concatenate([course.values for course in courses])
        shares.append(np.sum(corrected**2) / np.sum(values**2))
    assert np.mean(shares) < 0.05


@pytest.mark.parametrize("kind", ["rough", "smooth"])
def test_one_sensor_that_drives_is_removed_nearly_as_by_who_knows_it(kind):
    """At least 0.95 of what an oracle removes; and 95 % intervals hold about so many values."""
    courses, true = lagged(kind, 5, gain=3.0)
    found, fitted = held_out(courses)
    values = [c.values for c in courses]
    before, oracle, after = (
        np.sum(np.concatenate([y - of for y, of in zip(values, part, strict=True)]) ** 2)
        for part in ([0.0] * len(values), true, [one[2] for one in found])
    )
    assert (before - after) / (before - oracle) > 0.95
    white = np.sqrt(2.0) * fitted.scales.noise.white
    inside = [
        np.abs(y - mean) < 1.96 * np.sqrt(sd**2 + white**2)
        for y, (mean, sd, _) in zip(values, found, strict=True)
    ]
    assert 0.9 < np.mean(np.concatenate(inside)) <= 1.0


@pytest.mark.parametrize("instead", [(0.0,), (0.0, 4.0), (4.0, -2.0)])
@pytest.mark.parametrize("mean", [-3.0, 0.5, 2.0, 6.0])
@pytest.mark.parametrize("sd", [0.1, 2.0, 20.0])
def test_a_correction_loses_least(mean, sd, instead):
    """The expected loss by quadrature over y, at all corrections of a fine grid."""
    y = norm.ppf((np.arange(4000) + 0.5) / 4000, mean, sd)
    c = np.linspace(min(mean, *instead) - 0.5, max(mean, *instead) + 0.5, 801)
    squares = (y - c[:, None]) ** 2
    loss = squares.mean(1)
    for r in instead:
        loss = loss + np.maximum(squares - (y - r) ** 2, 0.0).mean(1) / len(instead)
    found = least_harm(np.array([mean]), np.array([sd]), *(np.array([r]) for r in instead))
    at = float(np.interp(found[0], c, loss))
    assert at <= loss.min() + 1e-3 * sd**2


def test_the_wander_of_differences_from_a_zero_is_that_of_the_differences():
    t = np.array([0.0, 20.0, 100.0])
    plain = NOISE.covariance(t, is_zeroed=False)
    differences = np.array([[-1.0, 1.0, 0.0], [-1.0, 0.0, 1.0]])
    expected = differences @ plain @ differences.T
    np.testing.assert_allclose(NOISE.covariance(t[1:], is_zeroed=True), expected, rtol=1e-12)
    white = np.diag(expected) - 2.0 * NOISE.white**2
    np.testing.assert_allclose(NOISE.variance(t[1:], is_zeroed=True), white, rtol=1e-12)
