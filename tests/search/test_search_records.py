"""Long set-ups: blocks in time, a covariance with a wander, stretches that are held out."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.search.candidate import Candidate, Part
from app.search.findings import Verdict
from app.search.rows import Datum, DeclaredNoise, Rows
from app.search.scatter import (
    LONG_MIN,
    SHORTEST_BLOCK_MIN,
    Blocks,
    Scatter,
    blocks_in_time,
    scatters,
)
from app.search.search import search
from app.search.splits import split
from app.search.validation import holds


def make_blocks(setups, minutes, free=False, own=(2.0, 0.5), wander=(1.0, 0.3)):
    return Blocks(
        np.array(setups), np.array(minutes, dtype=float), np.full(len(setups), free),
        np.array(own), np.array(wander),
    )  # fmt: skip


def wandering(random, minutes, correlation_min):
    """An Ornstein-Uhlenbeck process of unit variance, step by step as its definition has it."""
    found = np.empty(len(minutes))
    found[0] = random.normal()
    for i, step in enumerate(np.diff(minutes)):
        kept = np.exp(-step / correlation_min)
        found[i + 1] = kept * found[i] + np.sqrt(1.0 - kept**2) * random.normal()
    return found


class Record:
    """One set-up of many hours: a sensor that moves, four channels, three positions each time."""

    CHANNELS = 4

    def __init__(self, seed, hours=25, every=20.0, wander=1.0, correlation_min=30.0):
        random = np.random.default_rng(seed)
        times = np.arange(0.0, 60.0 * hours, every)
        each = 3 * self.CHANNELS
        self.when = np.repeat(times, each)
        self.channel = np.tile(np.repeat(np.arange(self.CHANNELS), 3), len(times))
        self.position = np.tile([-1.0, 0.0, 1.0], self.CHANNELS * len(times))
        self.direction = random.choice([-1.0, 1.0], len(self.when))
        load = np.repeat(random.uniform(0, 1, 1 + len(times) // 5), 5)[: len(times)]
        self.load = np.repeat(load, each)
        self.values = random.normal(size=len(self.when))
        for c in range(self.CHANNELS):
            own = self.channel == c
            shift, tilt = (wandering(random, times, correlation_min) for _ in range(2))
            at = np.searchsorted(times, self.when[own])
            self.values[own] += wander * (shift[at] + 0.5 * tilt[at] * self.position[own])

    def rows(self, effect=0.0, setup=None, noise=None):
        setup = np.zeros(len(self.when), int) if setup is None else setup
        return Rows(
            self.values + effect, setup, self.channel, self.position[:, None],
            np.full(len(self.when), -1), self.when, noise or {},
        )  # fmt: skip

    def library(self):
        shapes = {
            "reversal": self.direction,
            "load": self.load - self.load.mean(),
            "load-along": self.load * self.position,
            "drift": self.when / self.when.max() - 0.5,
        }
        return [
            self._candidate(f"{name}-{c}", name, c, shape)
            for name, shape in shapes.items()
            for c in range(self.CHANNELS)
        ]

    def _candidate(self, key, family, channel, shape):
        here = np.flatnonzero(self.channel == channel)
        return Candidate(
            key, family, lambda _: [Part(channel, here, shape[here, None])],
            trending=family == "drift",
        )  # fmt: skip


@given(
    st.lists(st.floats(0, 400), min_size=1, max_size=60),
    st.lists(st.integers(0, 3), min_size=60, max_size=60),
)
def test_blocks_stay_within_a_setup_and_are_short(minutes, setups):
    when, setup = np.array(minutes), np.sort(np.array(setups[: len(minutes)]))
    block = blocks_in_time(setup, when, {1, 2})
    for number in np.unique(block):
        own = block == number
        assert len(np.unique(setup[own])) == 1
        span = np.ptp(when[setup == setup[own][0]])
        if span >= LONG_MIN or setup[own][0] in {1, 2}:
            assert np.ptp(when[own]) <= max(SHORTEST_BLOCK_MIN, 4 * 400 / 150)
        else:
            assert own.sum() == (setup == setup[own][0]).sum()


def test_a_short_setup_is_cut_where_others_do_not_measure_the_same():
    """A test of each axis in a file of its own, ten minutes each, and five set-ups of a fourth."""
    setup, minutes = np.repeat(np.arange(8), 6), np.tile(np.arange(0.0, 12.0, 2.0), 8)
    channel = np.repeat([0, 1, 2, 3, 3, 3, 3, 3], 6)
    n, one = len(setup), np.zeros(len(setup), int)
    rows = Rows(np.zeros(n), setup, one, np.zeros((n, 0)), one, minutes)
    assert len(np.unique(rows.block)) == 8  # of one channel: whole set-ups can be held out
    rows = replace(rows, channel=channel)
    first = np.unique(rows.block, return_index=True)[1]
    assert np.bincount(setup[first]).tolist() == [6, 6, 6, 1, 1, 1, 1, 1]


@pytest.mark.parametrize("free", [False, True])
@pytest.mark.parametrize("scatter", [Scatter(1, 1), Scatter(4, 0.3, 3.0, 80.0), Scatter(0, 0)])
def test_whitening_is_the_inverse_of_the_dense_covariance(scatter, free):
    random = np.random.default_rng(1)
    blocks = make_blocks([0, 0, 0, 1, 1, 2], [0, 5, 9, 200, 210, 9000], free)
    shapes = [np.c_[np.ones(c), random.uniform(-1, 1, c)] for c in (3, 1, 4, 2, 3, 2)]
    for use in (np.ones(6, bool), np.array([1, 0, 1, 1, 0, 1], bool)):
        own = [shapes[i] for i in np.flatnonzero(use)]
        rows = np.cumsum([0, *map(len, own)])
        laid = np.zeros((rows[-1], 2 * len(own)))
        for i, z in enumerate(own):
            laid[rows[i] : rows[i + 1], 2 * i : 2 * i + 2] = z
        inside = blocks.covariance(scatter, np.flatnonzero(use)[None])[0]
        dense = np.eye(rows[-1]) + laid @ inside @ laid.T
        columns = random.normal(size=(rows[-1], 3))
        gram = np.stack([z.T @ z for z in shapes])
        ours = blocks.whitening((scatter,), gram, use)
        (turned,) = ours.turn((laid.T @ columns).reshape(len(own), 2, 3))
        product = columns.T @ columns - turned.T @ turned
        np.testing.assert_allclose(
            product, columns.T @ np.linalg.solve(dense, columns), rtol=1e-6, atol=1e-6
        )
        assert ours.log_determinant == pytest.approx(np.linalg.slogdet(dense)[1], abs=1e-6)


@pytest.mark.parametrize("use", [np.ones(6, bool), np.array([1, 0, 1, 1, 0, 1], bool)])
def test_sets_of_variances_are_whitened_together_as_one_by_one(use):
    random = np.random.default_rng(4)
    blocks = make_blocks([0, 0, 0, 1, 1, 2], [0, 5, 9, 200, 210, 9000])
    tried = scatters(blocks)
    gram = np.einsum("bni,bnj->bij", *[random.normal(size=(6, 5, 2))] * 2)
    reduced = random.normal(size=(int(use.sum()), 2, 3))
    together = blocks.whitening(tried, gram, use)
    turned = together.turn(reduced)
    assert len(together.parts) > 1  # some reach further than others
    for i, scatter in enumerate(tried):
        alone = blocks.whitening((scatter,), gram, use)
        np.testing.assert_allclose(turned[i], alone.turn(reduced)[0], atol=1e-12)
        np.testing.assert_allclose(
            together.turn_back(turned, 2)[i],
            together.take(np.array([i])).turn_back(turned[[i]], 2)[0],
            atol=1e-12,
        )
        assert together.log_determinant[i] == pytest.approx(alone.log_determinant[0])


def test_setups_far_apart_are_independent_and_near_ones_resemble_each_other():
    far, near = make_blocks([0, 1], [0, 1e5]), make_blocks([0, 1], [0, 10])
    scatter = Scatter(1.0, 1.0, 4.0, 30.0)
    gram = np.ones((2, 2, 2))
    use = np.ones(2, bool)
    assert [index.shape for _, index, _ in far.whitening((scatter,), gram, use).parts] == [(2, 1)]
    assert [index.shape for _, index, _ in near.whitening((scatter,), gram, use).parts] == [(1, 2)]
    covariance = near.covariance(scatter, np.array([[0, 1]]))[0]
    assert covariance[0, 2] == pytest.approx(4.0 * np.exp(-10 / 30))


def test_draws_have_the_covariance_that_they_are_drawn_from():
    blocks, scatter = make_blocks([0, 0, 1], [0, 20, 40]), Scatter(1.0, 1.0, 3.0, 30.0)
    unit = np.random.default_rng(2).standard_normal((3, 2, 40_000))
    drawn = blocks.draw(scatter, unit).reshape(6, -1)
    expected = blocks.covariance(scatter, np.arange(3)[None], zeros=0.0)[0]
    np.testing.assert_allclose(np.cov(drawn), expected, atol=0.15)


def test_visits_of_one_block_have_no_wander_to_tell_from_their_setups():
    assert not any(s.wander for s in scatters(make_blocks([0, 1, 2], [0, 500, 900])))
    assert any(s.wander for s in scatters(make_blocks([0, 0, 1], [0, 500, 900])))


def test_stretches_that_teach_keep_away_from_what_is_held_out():
    record = Record(0)
    rows = record.rows()
    splits = split(rows, np.ones(len(rows.values), bool), 0.2)
    assert splits.folds == 5
    cell = np.array([splits.cell_of[b] for b in rows.block.tolist()])
    for fold in range(5):
        held, teaching = splits.fold(fold)[cell], splits.teaching(fold)[cell]
        assert held.any()
        assert not (held & teaching).any()
        gap = np.min(np.abs(record.when[held][:, None] - record.when[teaching][None, :]))
        assert gap >= 60.0
    everywhere = np.array([splits.fold(f)[cell] for f in range(5)]).sum(axis=0)
    assert (everywhere == 1).all()


@pytest.mark.parametrize("times", [2, 3, 5])
def test_a_visit_of_few_moments_is_searched_with_nothing_held_out(times):
    record = Record(4, hours=times * 2 / 3, every=40.0)
    rows = record.rows()
    assert len(np.unique(rows.block)) in (1, times)
    found = search(rows, [], record.library(), holdout_fraction=0.3)
    assert found.held_out == {}
    assert all(str(t.status) == "not-confirmable" for t in found.terms)


@pytest.mark.slow
def test_an_unknown_zero_belongs_to_its_whole_setup():
    """What is constant over a record counts for nothing where its zero is unknown."""
    record = Record(3, hours=6)
    datum = {(0, c): Datum.FIRST for c in range(Record.CHANNELS)}
    as_it_is, moved = (
        search(replace(rows, datum=datum), [], record.library(), holdout_fraction=0.2)
        for rows in (record.rows(), record.rows(100.0 * (record.channel == 0)))
    )
    assert moved.global_p == pytest.approx(as_it_is.global_p, rel=1e-3)
    absolute = search(
        record.rows(100.0 * (record.channel == 0)), [], record.library(), holdout_fraction=0.2
    )
    assert absolute.global_p != pytest.approx(as_it_is.global_p, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("correlation_min", [8.0, 30.0, 90.0])
def test_a_wander_in_time_is_nothing(correlation_min):
    for seed in range(2):
        record = Record(seed, correlation_min=correlation_min)
        found = search(record.rows(), [], record.library(), holdout_fraction=0.2)
        assert found.verdict is Verdict.NOTHING, (seed, [t.key for t in found.terms])


@pytest.mark.slow
def test_one_record_and_its_visits_say_the_same():
    record = Record(5)
    effect = 4.0 * (record.load - 0.5) * (record.channel == 1)
    visits = np.unique(record.when, return_inverse=True)[1]
    for setup in (None, visits):
        found = search(record.rows(effect, setup), [], record.library(), holdout_fraction=0.2)
        (term,) = found.terms
        assert term.key == "load-1"
        assert str(term.status) == "confirmed"
        assert term.amplitudes[0] == pytest.approx(4.0, abs=4 * term.covariance[0, 0] ** 0.5)


@pytest.mark.slow
def test_what_does_not_wander_is_found_however_much_does():
    record = Record(6, wander=3.0)
    effect = 0.8 * record.direction * (record.channel == 2)
    noise = {c: DeclaredNoise(repeatability=1.0) for c in range(4)}
    found = search(record.rows(effect, noise=noise), [], record.library(), holdout_fraction=0.2)
    assert [t.key for t in found.terms] == ["reversal-2"]


@pytest.mark.slow
def test_the_floor_of_a_single_setup_is_what_moves_within_it():
    """How one set-up was mounted is not known: no constant of it is noise, nor left unexplained."""
    record = Record(7, hours=12)
    mounted = (5.0 + 2.0 * record.position) * (record.channel == 0)
    found = search(record.rows(mounted), [], record.library(), holdout_fraction=0.2)
    assert not found.terms
    for number, held in found.held_out.items():
        assert 1.0 < held.floor.total < 2.5, number
        assert held.after.rms < 1.3 * held.floor.total, number
    assert found.verdict is Verdict.NOTHING


@pytest.mark.slow
def test_a_change_in_what_was_held_out_is_as_large_as_what_was_foretold():
    """Who has not seen the middle of the record cannot say when in it something changed."""
    record, at_min = Record(9, hours=12, wander=0.0), 330.0
    gains = np.array([2.0, -1.5, 1.0, 2.5])[record.channel]
    effect = 3.0 * gains * (record.when > at_min)

    def columns(theta):
        after = (record.when > theta) * gains
        here = [np.flatnonzero(record.channel == c) for c in range(Record.CHANNELS)]
        return [Part(c, own, after[own, None]) for c, own in enumerate(here)]

    moments = tuple((np.unique(record.when)[2:-2] - 10.0).tolist())
    bounds = (moments[0], moments[-1])
    change = Candidate("change", "change", columns, moments, bounds, log_scale=False, trending=True)
    found = search(record.rows(effect), [], [*record.library(), change], holdout_fraction=0.3)
    (term,) = found.terms
    assert term.key == "change"
    assert abs(term.theta - at_min) <= 10.0
    assert term.slope.value == pytest.approx(1.0, abs=3.0 * term.slope.error)
    assert term.slope.error < 0.1


class Fault:
    """A change of all channels of a record in fixed proportions, from 690 of 1500 min on."""

    GAINS = np.array([2.0, -1.5, 1.0, 2.5])
    MOMENTS = tuple(range(190, 1400, 100))

    def __init__(self, until_min=np.inf):
        self.record = Record(9)
        there = (self.record.when > 690.0) & (self.record.when < until_min)
        self.effect = 3.0 * self.GAINS[self.record.channel] * there

    def found(self, keeps_zero):
        when, channel = self.record.when, self.record.channel

        def columns(theta):
            after = (when > theta) * self.GAINS[channel]
            here = [np.flatnonzero(channel == c) for c in range(Record.CHANNELS)]
            return [Part(c, own, after[own, None]) for c, own in enumerate(here)]

        fault = Candidate(
            "fault", "fault", columns, self.MOMENTS, log_scale=False, trending=True,
            keeps_zero=keeps_zero,
        )  # fmt: skip
        rows = self.record.rows(self.effect)
        (term,) = search(rows, [], [fault], holdout_fraction=0.3, most_terms=1).terms
        return term


@pytest.mark.slow
def test_what_came_and_stays_shows_on_the_last_visits_by_the_zero_they_share():
    """Of a change that is the same ever after, the last third alone shows nothing: no zero."""
    anew, same = (Fault().found(keeps_zero) for keeps_zero in (False, True))
    assert anew.forward_slope is None or anew.forward_slope.error > 0.5
    assert same.forward_slope.value == pytest.approx(1.0, abs=2.0 * same.forward_slope.error)
    assert same.forward_slope.error < 0.15


@pytest.mark.slow
def test_what_came_and_went_does_not_hold_on_the_last_visits():
    found = Fault(until_min=1080.0).found(keeps_zero=True)
    assert abs(found.forward_slope.value) < 3.0 * found.forward_slope.error
    assert found.forward_slope.error < 0.15
    assert not holds(found.forward_slope, found.likelihood_ratio)
