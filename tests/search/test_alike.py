"""What set-ups have in common because they resemble each other is not taken for a map's."""

import numpy as np
import pytest

from app.search.alike import evidence_beside_alike, set_ups_seen

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
