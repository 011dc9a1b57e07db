"""What set-ups have in common because they resemble each other is not taken for a map's."""

from functools import partial

import numpy as np
import pytest

from app.search.alike import evidence_beside_alike, how_alike, set_ups_seen
from app.search.candidate import Candidate, Part
from app.search.priors import LASTING_SIZES, MEMORIES
from app.search.rows import DeclaredNoise, Rows
from app.search.search import search

SURE = 10.0
"""About what one of 80 candidates of a family costs in eight set-ups."""

U = np.linspace(-1.0, 1.0, 6)


def setups(rng, count, size, memory):
    """Levels of set-ups, each so much like the one before."""
    levels = [rng.normal(0.0, size)]
    for _ in range(count - 1):
        levels.append(memory * levels[-1] + np.sqrt(1.0 - memory**2) * rng.normal(0.0, size))
    return np.array(levels)


def judged(seed, count=8, *, shift=0.0, slope=0.0, size=1.0, memory=0.0, channels=3, is_free=False):
    """Fit the mean of all set-ups, shift and slope, and judge it beside other channels."""
    rng = np.random.default_rng(seed)
    visit, tilt = np.repeat(np.arange(count), len(U)), np.tile(U, count)[:, None]

    def measured():
        return setups(rng, count, size, memory)[visit] + rng.normal(size=len(visit))

    values = measured() + shift + slope * tilt[:, 0]
    own = np.full(len(visit), values.mean())
    if slope:
        own += tilt[:, 0] * (tilt[:, 0] @ values) / (tilt[:, 0] @ tilt[:, 0])
    others = [
        told for _ in range(channels - 1) if (told := set_ups_seen(measured(), visit)) is not None
    ]
    free = np.full(len(visit), is_free)
    return evidence_beside_alike(values - own, own, tilt, visit, free, others)


def share_open(times=30, **stated):
    return np.mean([judged(seed, **stated) < SURE for seed in range(times)])


def test_set_ups_that_resemble_each_other_are_no_map():
    assert share_open(memory=0.85, size=2.0) >= 0.9


def test_set_ups_made_anew_leave_a_shift_sure():
    assert share_open(shift=2.0, size=0.3) <= 0.1


def test_more_set_ups_tell_a_shift_from_what_fades():
    few, many = (share_open(10, count=n, memory=0.85, shift=3.0) for n in (8, 50))
    assert many < few


def test_other_channels_tell_how_far_off_set_ups_are():
    """A constant that all set-ups share shows only in that channels differ by it."""
    evidence = [
        [judged(seed, memory=0.99, size=2.0, shift=3.0, channels=n) for seed in range(20)]
        for n in (1, 8)
    ]
    assert np.median(evidence[1]) < np.median(evidence[0])


def test_a_sure_slope_carries_a_smaller_shift_and_no_larger_one():
    """Set-ups that shift do not tilt: a slope is sure, a shift of the same size is not."""
    shifting = {"memory": 0.85, "size": 1.5}
    assert share_open(10, slope=5.0, **shifting) < share_open(10, slope=0.1, **shifting)


def test_of_unknown_zeros_no_shift_is_seen_and_a_slope_is():
    assert judged(1, shift=3.0, is_free=True) is None
    assert judged(1, slope=3.0, is_free=True) > SURE


def test_a_channel_that_shows_seldom_tells_of_set_ups_that_are_far_apart():
    """Every third set-up forgets in two of its own what all forget in six."""
    visit = np.repeat(np.arange(9), len(U))
    left = np.random.default_rng(3).normal(size=len(visit)) + 0.3 * visit
    sizes = len(LASTING_SIZES)
    of_memory = [sizes, *(sizes * (sizes - 1) for _ in MEMORIES[1:])]
    ends = np.cumsum(of_memory)
    each, third = (np.split(set_ups_seen(left, n * visit), ends[:-1]) for n in (1, 3))
    for shorter in (2.0, 6.0, 18.0):
        longer = MEMORIES.index(3.0 * shorter)
        np.testing.assert_allclose(third[longer], each[MEMORIES.index(shorter)])


def seen_by(channels, **stated):
    """What channels show of ten set-ups, and how much these are taken to resemble each other."""
    rng = np.random.default_rng(7)
    visit = np.repeat(np.arange(10), len(U))
    return how_alike(
        [
            set_ups_seen(setups(rng, 10, **stated)[visit] + rng.normal(size=len(visit)), visit)
            for _ in range(channels)
        ]
    )


def test_channels_together_tell_whether_set_ups_resemble_each_other():
    assert seen_by(8, size=1.0, memory=0.85).is_likely
    assert not seen_by(8, size=1.0, memory=0.0).is_likely


def test_no_channel_alone_tells_that_set_ups_resemble_each_other():
    """Its own set-ups may drift for a cause of its own."""
    assert not seen_by(1, size=3.0, memory=0.97).is_likely
    assert how_alike([]).is_likely is False


def drawn(alike, variance, numbers=(0, 1, 9, 3), times=4000):
    """Draw two shapes of set-ups with these numbers, and give the covariance of the first."""
    rng = np.random.default_rng(1)
    unit, uniform = rng.normal(size=(len(numbers), 2, times)), rng.random(times)
    found = alike.drawn(unit, np.array(numbers), np.full(times, variance), rng, uniform)
    np.testing.assert_allclose(np.cov(found[:, 0], found[:, 1])[:4, 4:], 0.0, atol=0.1)
    return np.cov(found[:, 0])


def test_draws_resemble_each_other_as_set_ups_do():
    """Neighbours more than those far apart, each with the variance that it had."""
    covariance = drawn(seen_by(8, size=1.0, memory=0.85), 1.0)
    np.testing.assert_allclose(np.diag(covariance), 1.0, atol=0.1)
    assert covariance[0, 1] > covariance[0, 3] > covariance[0, 2] - 0.05
    assert covariance[0, 1] > 0.45


def test_what_one_channel_alone_has_is_not_drawn_as_lasting():
    """Its set-ups scatter by three times as much as those of the others: by a step, perhaps."""
    assert 0.0 < drawn(seen_by(8, size=1.0, memory=0.85), 9.0)[0, 1] < 0.3


def test_set_ups_that_are_made_anew_are_drawn_as_they_are():
    np.testing.assert_allclose(drawn(seen_by(30, size=1.0, memory=0.0), 1.0), np.eye(4), atol=0.1)


def test_too_few_set_ups_say_nothing():
    assert judged(1, count=3) is None


def test_what_no_set_up_does_is_sure():
    visit, tilt = np.repeat(np.arange(8), 6), np.tile(U, 8)[:, None]
    left, known = np.random.default_rng(5).normal(size=48), np.zeros(48, dtype=bool)
    bent = tilt[:, 0] ** 2
    assert evidence_beside_alike(left, 2.0 * (bent - bent.mean()) + 0.1, tilt, visit, known) > SURE


def test_signs_and_the_order_of_rows_change_nothing():
    rng = np.random.default_rng(5)
    visit, tilt = np.repeat(np.arange(8), 6), np.tile(U, 8)[:, None]
    left, own, known = rng.normal(size=48), 1.0 + 2.0 * tilt[:, 0], np.zeros(48, dtype=bool)
    expected = pytest.approx(evidence_beside_alike(left, own, tilt, visit, known))
    order = rng.permutation(48)
    assert evidence_beside_alike(-left, -own, tilt, visit, known) == expected
    assert evidence_beside_alike(left[order], own[order], tilt[order], visit[order] + 3, known) == (
        expected
    )


SINCE_MIN = np.linspace(4.0, 13.0, 14)


def warm_up_in(settles, shift=0.0, channels=6, count=12):
    """Search set-ups that resemble each other; one channel settles, or all of it is shifted."""
    rng = np.random.default_rng(4)
    each = len(SINCE_MIN)
    visit = np.tile(np.repeat(np.arange(count), each), channels)
    channel = np.repeat(np.arange(channels), count * each)
    since_min = np.tile(SINCE_MIN, channels * count)
    levels = np.array([setups(rng, count, 1.0, 0.85) for _ in range(channels)])
    values = levels[channel, visit] + rng.normal(size=len(visit))
    values[channel == 0] += shift - settles * np.expm1(-since_min[channel == 0] / 4.0)
    of_channel = {c: np.flatnonzero(channel == c) for c in range(channels)}

    def settling(c, tau_min):
        own = of_channel[c]
        return [Part(c, own, -np.expm1(-since_min[own] / tau_min)[:, None])]

    rows = Rows(
        values, visit, channel, np.zeros((len(visit), 0)), np.full(len(visit), -1),
        1440.0 * visit + since_min, dict.fromkeys(of_channel, DeclaredNoise(1.0)),
    )  # fmt: skip
    candidates = [
        Candidate(
            f"{c}", "warm-up", partial(settling, c), (2.0, 4.0, 8.0, 16.0), (2.0, 16.0),
            within_visit=True, of_setups=True,
        )
        for c in range(channels)
    ]  # fmt: skip
    return [term.channels for term in search(rows, [], candidates, holdout_fraction=0.3).terms]


def test_a_shift_that_set_ups_share_is_nothing_that_settles_within_minutes():
    assert warm_up_in(0.0, shift=2.0) == []


def test_what_settles_in_set_ups_that_resemble_each_other_is_found_by_its_course():
    assert (0,) in warm_up_in(4.0)
