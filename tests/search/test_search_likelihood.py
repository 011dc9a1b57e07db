"""The profile likelihood against a dense computation and against statsmodels' mixed model."""

import itertools
from dataclasses import replace
from functools import partial

import hypothesis
import numpy as np
import pytest
from hypothesis import strategies as st
from scipy.sparse import csr_array
from scipy.stats import multivariate_normal

from app.search import scan as scans
from app.search.base_grams import BaseGrams
from app.search.candidate import Candidate, Layout, Part
from app.search.channel import prepare
from app.search.draws import Draws
from app.search.joint_fit import fit_terms, left_out
from app.search.library import read_library
from app.search.moments import fixed_of, moments_of
from app.search.priors import CORRELATION_TIMES_MIN, WANDERS
from app.search.problem import make_problem, with_likely_scatters
from app.search.rows import Datum, Nuisance
from app.search.scan import scan
from app.search.scatter import UNLIMITED, Blocks, Scatter
from app.search.small_inverse import inverse_roots, solutions
from app.search.state import BELIEVABLE, Given, State
from tests.search.search_campaigns import make_campaign, make_library


def make_small(seed=3, datum=Datum.ABSOLUTE, cells=2, **how):
    campaign = make_campaign(seed, visits=9, targets=3, datum=datum)
    use = np.ones(len(campaign.rows.values), dtype=bool)
    cell_of = {v: v % cells for v in range(9)}
    return campaign, make_problem(campaign.rows, campaign.nuisance, use, cell_of, cells)


SMALL = make_small()


def covariance(channel, level):
    """Noise, set-ups, wander, and the maps' freedom, as one dense matrix, row by row."""
    blocks, tried = channel.blocks, channel.tried[level]
    setup, minutes = blocks.setups[channel.block], blocks.minutes[channel.block]
    same = setup[:, None] == setup[None, :]
    near = np.exp(-np.abs(minutes[:, None] - minutes[None, :]) / tried.minutes)
    found = np.eye(len(channel.rows)) + channel.nuisance @ channel.nuisance.T
    for number, shape in enumerate(channel.shapes.T):
        own = blocks.own[number] * (tried.tilt if number else tried.shift)
        if blocks.free.all() and number == 0:
            own = UNLIMITED
        shared = own * same + tried.wander * blocks.wander[number] * near
        found += np.outer(shape, shape) * shared
    return found


def dense_profile(channel, columns):
    """Profile repeatability and visit variances by brute force."""
    found = []
    for level, prior in enumerate(channel.prior):
        dense = covariance(channel, level)
        inverse = np.linalg.inv(dense)
        left = channel.values
        if columns.shape[1]:
            normal = columns.T @ inverse @ columns
            left = left - columns @ np.linalg.solve(normal, columns.T @ inverse @ left)
        freedom = len(left) + channel.weight
        scatter = (left @ inverse @ left + channel.weight) / freedom
        log_det = np.linalg.slogdet(dense)[1]
        found.append(prior - 0.5 * freedom * np.log(scatter) - 0.5 * log_det)
    return max(found)


@pytest.mark.slow
@pytest.mark.parametrize("datum", [Datum.ABSOLUTE, Datum.FREE])
def test_ratio_of_every_candidate_against_dense_covariances(datum):
    campaign, problem = make_small(datum=datum)
    library = read_library(problem, make_library(campaign, pitches=4), None)
    states = problem.states(np.ones(2, dtype=bool))
    found = scan(library, states, BaseGrams(library, states))
    null = {
        c: dense_profile(f.channel, np.zeros((len(f.channel.rows), 0)))
        for c, f in problem.fixed.items()
    }
    compared = 0
    for i in range(len(library.entries)):
        term = library.term(i)
        if len(term.columns) == 1 and found.rank[i] == term.size:
            ((c, columns),) = term.columns.items()
            dense = 2 * (dense_profile(problem.fixed[c].channel, columns) - null[c])
            assert found.ratio[i] == pytest.approx(dense, abs=1e-5)
            compared += 1
    assert compared > 20


def test_marginal_density_is_the_multivariate_normals():
    """At repeatability 1 the constant and the squares give the dense log density."""
    _, problem = make_small()
    for fixed in problem.fixed.values():
        state, channel = State(fixed, np.ones(2, dtype=bool)), fixed.channel
        for level in (0, 2, 6):
            dense = multivariate_normal(cov=covariance(channel, level)).logpdf(channel.values)
            ours = state.level(level).constant[0] - channel.prior[level] - 0.5 * state.rss[level]
            assert ours - 0.5 * state.count * np.log(2 * np.pi) == pytest.approx(dense)


@hypothesis.given(
    st.integers(1, 11),
    st.integers(0, 2**32 - 1),
    st.floats(-300.0, 300.0),
)
def test_the_profile_is_the_largest_log_likelihood(count, seed, spread):
    _, problem = SMALL
    state = State(problem.fixed[0], np.ones(2, dtype=bool))
    random = np.random.default_rng(seed)
    constant = random.uniform(-1.0, 1.0, len(state.rss)) * spread
    state.levels = replace(state.levels, constant=constant)
    levels = np.sort(random.permutation(len(state.rss))[:count])
    squares = random.uniform(0.0, 1e4, (len(state.rss), 3, 2))
    plain = state.log_likelihoods(squares)[levels]
    found, best = state.profile(squares[levels], levels)
    np.testing.assert_allclose(found, plain.max(axis=0), rtol=1e-12, atol=1e-9)
    at_best = np.take_along_axis(plain, best[None], 0)[0]
    np.testing.assert_allclose(at_best, found, rtol=1e-12, atol=1e-9)
    assert (state.largest(squares[levels], levels) == found).all()


@pytest.mark.parametrize("datum", [Datum.ABSOLUTE, Datum.FREE])
def test_what_is_taken_of_entries_is_their_shadows_with_themselves(datum):
    _, problem = make_small(datum=datum)
    fixed, cells = problem.fixed[0], np.array([True, False])
    columns = np.random.default_rng(4).normal(size=(len(fixed.channel.rows), 6))
    state = State(fixed, cells, Given(columns[:, :1], np.zeros(1), np.zeros(len(columns))))
    some = state.levels
    rest, own = columns[:, 2:], moments_of(fixed.channel, columns, fixed.cells)
    with_given = (fixed.channel.by_cell(columns[:, :1], rest, fixed.cells))[cells].sum(axis=0)
    with_nuisance = np.vstack([own.nuisance[cells].sum(axis=0).T[:, 2:], with_given])
    reduced = own.reduced[state.blocks][:, :, 2:]
    shadow, first = some.shadow(with_nuisance, reduced), some.turned.shape[1]
    for part, found in zip(
        (shadow[:, :first], shadow[:, first:]), some.taken(with_nuisance, reduced, 2), strict=True
    ):
        assert found.shape == (len(some.root), 2, 2, 2)
        for entry in range(2):
            mine = part[:, :, 2 * entry : 2 * entry + 2]
            whole = mine.transpose(0, 2, 1) @ mine
            np.testing.assert_allclose(found[:, entry], whole, rtol=1e-9, atol=1e-9)


@hypothesis.given(st.integers(0, 2**32 - 1), st.integers(1, 3))
def test_solutions_leave_out_what_roots_leave_out(seed, size):
    random = np.random.default_rng(seed)
    factors = random.normal(size=(40, size, size))
    factors[::4, 0] = 0.0  # nothing is seen of one direction
    factors[1::4] = 0.0  # nor of any
    turn = np.linalg.qr(random.normal(size=(40, size, size)))[0]
    gram = turn.transpose(0, 2, 1) @ factors.transpose(0, 2, 1) @ factors @ turn
    gram = 0.5 * (gram + gram.transpose(0, 2, 1))
    floor, right = np.full(40, 1e-6), random.normal(size=(40, size))
    root, rank = inverse_roots(gram, floor)
    found, same = solutions(gram, floor, right)
    assert same.tolist() == rank.tolist()
    wanted = np.einsum("nij,nkj,nk->ni", root, root, right)
    np.testing.assert_allclose(found, wanted, rtol=1e-6, atol=1e-9)


def test_candidates_of_one_layout_are_what_each_is_by_itself():
    """Also where one acts on fewer channels than another, or at one theta only."""
    campaign, problem = make_small()
    here = [np.flatnonzero(campaign.on(c)) for c in range(2)]

    def amplitudes(key, theta):
        late = np.maximum(campaign.time - (theta or 0.0), 0.0)
        return {
            "both": [campaign.speed, late],
            "first": [campaign.temperature * campaign.on(0)],
            "second": [campaign.twin * campaign.on(1) * (theta == 0.5), late * campaign.on(0)],
        }[key]

    def parts(columns):
        laid_out = [Part(c, rows, np.column_stack(columns)[rows]) for c, rows in enumerate(here)]
        return [part for part in laid_out if part.columns.any()]

    candidates = [
        Candidate(
            key,
            "family",
            lambda theta, key=key: parts(amplitudes(key, theta)),
            (0.25, 0.5),
            layout=Layout("here", partial(amplitudes, key), parts),
        )
        for key in ("both", "first", "second")
    ]
    wanted = [(candidate, theta) for candidate in candidates for theta in candidate.grid]
    together = problem.side_by_side(wanted)
    numbers = np.array(list(together.columns))
    shown = [tuple(numbers[here].tolist()) for here in together.shows.T]
    assert set(shown) == {(0, 1), (0,)}
    for i, one in enumerate(wanted):
        alone = problem.term(*one)
        own = slice(together.starts[i], together.ends[i])
        assert (shown[i], own.stop - own.start) == (alone.channels, alone.size)
        np.testing.assert_allclose(together.norms[own], alone.norms, rtol=1e-12)
        for c, columns in alone.columns.items():
            laid_out = together.columns[c][:, own]
            np.testing.assert_allclose(laid_out, columns, rtol=1e-12, atol=1e-14)
    library = read_library(problem, candidates, None)
    assert [(e.candidate, e.theta) for e in library.entries] == [
        (number, theta) for number in range(3) for theta in (0.25, 0.5)
    ]


@pytest.mark.parametrize("portion", [1, 700])
def test_a_scan_does_not_depend_on_the_portions_that_it_works_in(monkeypatch, portion):
    campaign, problem = SMALL
    draws = Draws(1, 20)
    library = read_library(problem, make_library(campaign, pitches=4), draws)
    states = problem.states(np.ones(2, dtype=bool))
    whole = scan(library, states, BaseGrams(library, states), draws)
    monkeypatch.setattr(scans, "PORTION", portion)
    parted = scan(library, states, BaseGrams(library, states), draws)
    np.testing.assert_allclose(parted.ratio, whole.ratio, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(parted.noise, whole.noise, rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(parted.rank, whole.rank)


def test_fingerprint_in_the_scan_agrees_with_the_joint_fit():
    campaign, problem = make_small()
    library = read_library(problem, make_library(campaign, pitches=4), None)
    states = problem.states(np.ones(2, dtype=bool))
    entry = len(library.entries) - 1
    term = library.term(entry)
    assert len(term.columns) == 2
    exact = 2 * (fit_terms(states, [term]).log_likelihood - fit_terms(states, []).log_likelihood)
    assert scan(library, states, BaseGrams(library, states)).ratio[entry] == pytest.approx(
        exact, abs=1e-3
    )


def test_part_of_the_visits_is_as_if_the_others_had_never_been():
    campaign, problem = make_small(cells=3)
    some = np.array([True, False, True])
    keep = np.isin(campaign.rows.visit % 3, [0, 2])
    alone = make_problem(campaign.rows, campaign.nuisance, keep, dict.fromkeys(range(9), 0), 1)
    whole = alone.states(np.ones(1, dtype=bool))
    for c, state in problem.states(some).items():
        np.testing.assert_allclose(state.null, whole[c].null, rtol=1e-10)


def test_draws_of_the_null_have_the_ratio_of_noise():
    """Draw rows by hand with the dense covariance: the mean ratio is the same."""
    campaign, problem = make_small()
    candidates = [c for c in make_library(campaign, pitches=2) if c.key in ("speed-0", "twin-0")]
    states = problem.states(np.ones(2, dtype=bool))
    library = read_library(problem, candidates, Draws(1, 400))
    found = scan(library, states, BaseGrams(library, states), Draws(1, 400))
    mean = found.noise.mean(axis=1) / found.rank
    assert (mean > 0.6).all()
    assert (mean < 1.6).all()


@pytest.mark.slow
def test_against_statsmodels_mixed_model():
    """Random shift and tilt of each visit, uncorrelated, no maps, by maximum likelihood."""
    mixed = pytest.importorskip("statsmodels.regression.mixed_linear_model")
    campaign = make_campaign(8, visits=30, targets=5).declaring()
    mine = campaign.on(0)
    position = campaign.position[mine]
    design = np.column_stack([np.ones(mine.sum()), position, campaign.speed[mine]])
    shapes = np.column_stack([np.ones(mine.sum()), position])
    model = mixed.MixedLM(
        campaign.rows.values[mine], design, campaign.rows.visit[mine], exog_re=shapes
    )
    uncorrelated = mixed.MixedLMParams.from_components(np.ones(3), np.eye(2))
    theirs = model.fit(reml=False, free=uncorrelated)

    everything = np.ones(len(mine), dtype=bool)
    channel = prepare(
        campaign.rows,
        [],
        0,
        float(np.sqrt(theirs.scale)),
        0.0,
        everything,
        dict.fromkeys(range(30), 0),
    )
    level = channel.assumed
    grid = State(fixed_of(channel, 1), np.ones(1, dtype=bool))
    own = np.diag(theirs.cov_re) / theirs.scale
    channel = replace(channel, blocks=replace(channel.blocks, own=own))
    columns = design[np.searchsorted(np.flatnonzero(mine), channel.rows)]
    given = Given(columns, np.zeros(3), np.zeros(len(columns)))
    state = State(fixed_of(channel, 1), np.ones(1, dtype=bool), given)
    per_row = 1 + np.log(2 * np.pi * theirs.scale)
    ours = state.null - 0.5 * state.count * per_row
    assert ours[level] == pytest.approx(theirs.llf, abs=1e-3)
    assert ours.max() < theirs.llf + 1e-3
    assert grid.count == mine.sum()
    shadow = state.shadow[level, -3:]
    amplitudes = np.linalg.solve(state.level(level).root[0].T, shadow)[:, 0]
    np.testing.assert_allclose(amplitudes * channel.scale, theirs.fe_params, atol=1e-3)


def test_errors_that_nothing_counts_move_amplitudes_as_generalised_least_squares_says():
    """One error that two channels share, one of each alone, against dense matrices."""
    campaign, problem = make_small()
    rows, everything = campaign.rows, np.ones(2, dtype=bool)
    term = problem.term(make_library(campaign, pitches=4)[-1], 1.0)
    assert len(term.columns) == 2
    states = problem.states(everything)
    fit = fit_terms(states, [term])
    random, errors, amounts = np.random.default_rng(8), [], []
    for c in (0, 1):
        own = np.flatnonzero(rows.channel == c)
        columns = random.normal(0.0, 0.3, (own.size, 2))
        shared = np.zeros((3, 2))
        shared[0, 0] = shared[1 + c, 1] = 1.0
        errors.append(Nuisance(c, own, columns, csr_array(shared)))
        # V⁻¹ of the channel as the fit has it; an amplitude moves by G X'V⁻¹ Z.
        channel = states[c].fixed.channel
        inverse = np.linalg.inv(covariance(channel, fit.level[c]) * fit.scatter[c])
        laid = np.zeros((len(rows.values), 2))
        laid[own] = columns / channel.scale
        amounts.append(term.columns[c].T @ inverse @ laid[channel.rows] @ shared.T)
    moved = fit.covariance @ sum(amounts)
    np.testing.assert_allclose(
        left_out(states, [term], fit, errors), moved @ moved.T, rtol=1e-8, atol=1e-12
    )


def test_scatters_that_are_above_all_that_shows_are_not_tried():
    _, problem = SMALL
    likely = with_likely_scatters(problem)
    for c, fixed in problem.fixed.items():
        tried, kept = fixed.channel.tried, likely.fixed[c].channel.tried
        null = State(fixed, np.ones(problem.cells, dtype=bool)).null
        best = tried[int(null.argmax())]
        gone = [i for i, scatter in enumerate(tried) if scatter not in kept]
        assert 0 < len(gone) < len(tried)
        assert best in kept
        assert null[gone].max() < null.max() - BELIEVABLE
        # What is above has more variance in every direction that blocks may take together.
        which = np.arange(len(fixed.channel.starts))[None]
        smallest = fixed.channel.blocks.covariance(best, which)[0]
        for i in gone:
            larger = fixed.channel.blocks.covariance(tried[i], which)[0]
            assert np.linalg.eigvalsh(larger - smallest).min() > -1e-9


def test_scatters_that_other_channels_show_are_tried_above_those_that_go():
    """Draws of noise wander as they do: without them the channel's threshold would be too low."""
    _, problem = SMALL
    for c, fixed in problem.fixed.items():
        channel = fixed.channel
        shown = max(channel.tried)
        alone = with_likely_scatters(problem).fixed[c].channel.tried
        assert shown not in alone
        expected = np.array([1.0 if scatter == shown else 1e-9 for scatter in channel.tried])
        informed = replace(fixed, channel=replace(channel, expected=expected))
        likely = with_likely_scatters(replace(problem, fixed={c: informed})).fixed[c].channel
        assert {*likely.tried} == {*alone, shown}
        assert likely.expected.argmax() == likely.tried.index(shown)


def test_a_wander_is_above_another_where_its_spectrum_is():
    times = np.sort(np.random.default_rng(1).uniform(0.0, 300.0, 40))
    alone = np.zeros(len(times))
    blocks = Blocks(np.arange(40), times, alone > 0, np.ones(1), np.ones(1))
    which = np.arange(40)[None]
    wanders = [Scatter(1.0, 1.0, w, t) for w in WANDERS for t in CORRELATION_TIMES_MIN]
    for one, other in itertools.product(wanders, wanders):
        if one.is_above(other):
            apart = blocks.covariance(one, which)[0] - blocks.covariance(other, which)[0]
            assert np.linalg.eigvalsh(apart).min() > -1e-9
    assert not Scatter(1.0, 1.0, 3.0, 200.0).is_above(Scatter(1.0, 1.0, 3.0, 4.0))
