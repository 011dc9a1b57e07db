"""A stated repeatability that nearly all channels and visits contradict, and what does not."""

from dataclasses import replace

import numpy as np
import pytest

from app.search.common_scatter import screen_at_common_scatter
from app.search.noise import COMMON
from app.search.rows import Datum, DeclaredNoise, Rows

CHANNELS, VISITS, EACH = 10, 12, 8


def measured(stated, *, channels=CHANNELS, visits=VISITS, seed=1, shift=0.5):
    """Channels that scatter by 1 within visits, each with a shift of its own in each."""
    random = np.random.default_rng(seed)
    channel, visit, _ = (it.ravel() for it in np.indices((channels, visits, EACH), dtype=np.intp))
    shifts = shift * random.standard_normal((channels, visits))
    return Rows(
        values=random.standard_normal(channel.size) + shifts[channel, visit],
        visit=visit,
        channel=channel,
        tilt=random.uniform(-1.0, 1.0, (channel.size, 1)),
        replicate=np.full(channel.size, -1, dtype=np.intp),
        noise=dict.fromkeys(range(channels), DeclaredNoise(repeatability=stated)),
        minutes=1440.0 * visit + random.uniform(0.0, 12.0, channel.size),
    )


def used(rows):
    """The scatter that a search of these rows starts from; None where it is as stated."""
    found, _ = screen_at_common_scatter(rows, [])
    if found is rows:
        return None
    (noise,) = {(one.repeatability, one.origin) for one in found.noise.values()}
    assert noise[1] == COMMON
    return noise[0]


@pytest.mark.parametrize("stated", [1 / 3, 0.5, 2.0, 3.0])
@pytest.mark.parametrize("datum", [Datum.ABSOLUTE, Datum.FREE])
def test_what_all_channels_show_replaces_a_number_that_is_wrong(stated, datum):
    rows = measured(stated)
    zeros = {(v, c): datum for v in range(VISITS) for c in range(CHANNELS)}
    assert used(replace(rows, datum=zeros)) == pytest.approx(1.0, abs=0.08)


@pytest.mark.parametrize("stated", [0.8, 1.0, 1.25])
def test_a_number_that_is_about_right_stays(stated):
    assert used(measured(stated)) is None


def test_slips_do_not_contradict_it():
    rows = measured(1.0)
    rows.values[::25] += 15.0
    assert used(rows) is None


def test_what_moves_some_channels_is_no_repeatability():
    """Half of the channels scatter by three times what is stated, for whatever reason."""
    rows = measured(1.0)
    rows.values[rows.channel % 2 == 0] *= 3.0
    assert used(rows) is None


def test_what_moves_some_channels_stays_too_large_beside_what_the_others_show():
    rows = measured(1 / 3)
    rows.values[rows.channel < 2] *= 3.0
    assert used(rows) == pytest.approx(1.0, abs=0.08)


def test_what_comes_and_goes_is_no_repeatability():
    """It is there in every other visit: something was on."""
    rows = measured(1.0, shift=0.0)
    rows.values[rows.visit % 2 == 0] *= 4.0
    assert used(rows) is None


@pytest.mark.parametrize("over", ["place", "time"])
def test_what_has_a_course_is_no_repeatability(over):
    """All channels bend alike: over the place, or over the minutes of each visit."""
    rows = measured(1.0)
    within = rows.tilt[:, 0] if over == "place" else rows.minutes % 1440.0 / 6.0 - 1.0
    bent = replace(rows, values=rows.values + 4.0 * np.cos(2.5 * within))
    assert used(bent) is None
    # As much of it without a course is what the number should have been.
    random = np.random.default_rng(3)
    mixed = random.permuted(4.0 * np.cos(2.5 * within))
    assert used(replace(rows, values=rows.values + mixed)) > 1.5


def test_few_channels_may_be_moved_by_one_cause():
    assert used(measured(1 / 3, channels=5)) == pytest.approx(1.0, abs=0.1)
    assert used(measured(1 / 3, channels=4)) is None


@pytest.mark.parametrize("channels", [1, 2, 4])
def test_nothing_that_moves_few_channels_makes_them_scatter_less(channels):
    assert used(measured(4.0, channels=channels)) == pytest.approx(1.0, abs=0.15)
    assert used(measured(1.25, channels=channels)) is None


@pytest.mark.parametrize("seed", range(20))
def test_few_rows_that_scatter_less_by_chance_deny_nothing(seed):
    assert used(measured(1.0, channels=1, visits=2, seed=seed)) is None


def test_what_is_read_in_coarse_steps_scatters_by_these():
    rows = measured(4.0, channels=2)
    noise = dict.fromkeys(range(2), DeclaredNoise(repeatability=4.0, rounding=1.5))
    assert used(replace(rows, noise=noise)) == 1.5


@pytest.mark.parametrize("stated", [1 / 3, 3.0])
def test_places_that_were_repeated_have_priority(stated):
    """They repeat as is stated: what is left beside them is no noise."""
    rows = measured(stated)
    pairs = np.flatnonzero((rows.channel < 4) & (rows.visit == 0))
    rows.replicate[pairs] = np.arange(len(pairs)) // 2
    again = pairs[1::2]
    rows.values[again] = rows.values[pairs[::2]] + stated * np.resize([1.4, -1.4], len(again))
    assert used(rows) is None
