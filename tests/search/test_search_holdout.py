"""Held-out visits: every channel has some in every fold, and each term has its own evidence."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from app.search.candidate import Candidate
from app.search.findings import Slope, Status, Verdict
from app.search.foresight import Learned, learn
from app.search.problem import Term, make_problem
from app.search.rows import DeclaredNoise, Rows
from app.search.search import search
from app.search.splits import split
from app.search.validation import Validation, _as_all_say, _open
from tests.search.search_campaigns import (
    make_campaign,
    make_library,
    single,
    smooth,
)


def in_turn(campaign):
    """Only one channel in each visit: the first in even ones, the second in odd ones."""
    kept = campaign.rows.channel == campaign.rows.visit % 2
    own = campaign.rows
    rows = replace(
        own,
        values=own.values[kept],
        visit=own.visit[kept],
        channel=own.channel[kept],
        tilt=own.tilt[kept],
        replicate=own.replicate[kept],
        minutes=own.minutes[kept],
    )
    names = ("position", "direction", "temperature", "twin", "speed", "time")
    columns = {name: getattr(campaign, name)[kept] for name in names}
    return replace(campaign, rows=rows, nuisance=[], **columns)


@pytest.mark.parametrize("folds", [2, 3, 5])
def test_channels_that_are_measured_in_turn_are_in_every_fold(folds):
    visit = np.arange(30)
    for together in (1, 2, 3):
        places = np.zeros((30, 0)), np.full(30, -1)
        rows = Rows(np.zeros(30), visit, visit % together, *places, minutes=1e3 * visit)
        splits = split(rows, np.ones(30, dtype=bool), 1.0 / folds)
        for channel in range(together):
            own = visit[visit % together == channel]
            cells = [splits.cell_of[v] for v in own.tolist()]
            counts = [splits.fold(fold)[cells].sum() for fold in range(folds)]
            assert np.ptp(counts) <= 1
        assert splits.cells == len(set(splits.cell_of.values())), "no cell is empty"


def test_an_effect_is_confirmed_where_components_are_measured_in_turn():
    campaign = in_turn(make_campaign(61, visits=36))
    campaign = campaign.plus(2.0 * campaign.direction * campaign.on(0))
    for share in (0.3, 0.5):
        found = search(
            campaign.rows,
            [],
            [single(campaign, "reversal", "backlash", 0, lambda _: campaign.direction)],
            holdout_fraction=share,
        )
        (term,) = found.terms
        assert (term.status, term.inclusion) == (Status.CONFIRMED, 1.0)
        assert term.slope.value == pytest.approx(1.0, abs=0.2)
        assert set(found.held_out) == {0, 1}


def test_the_floor_says_how_set_ups_scatter_whatever_explains_the_rest():
    """What an effect had hidden in the repeatability is no scatter of set-ups."""
    campaign = make_campaign(61, visits=16)
    own = [single(campaign, "reversal", "backlash", 0, lambda _: campaign.direction)]
    plain, found = (
        search(replace(one.rows, noise={}), [], own, holdout_fraction=0.3)
        for one in (campaign, campaign.plus(4.0 * campaign.direction * campaign.on(0)))
    )
    assert [term.key for term in found.terms] == ["reversal"]
    assert found.noise[0].repeatability > 3.0 * found.noise[0].fitted
    for number, held in found.held_out.items():
        floor = plain.held_out[number].floor
        assert held.floor.setups == pytest.approx(floor.setups, rel=0.2)
        assert held.floor.noise == pytest.approx(floor.noise, rel=0.2)


@pytest.mark.slow
def test_a_second_wave_is_not_confirmed_by_the_first():
    """The first is everywhere; the second in the visits of one fold of three only."""
    campaign = make_campaign(3, visits=16)
    first = 2.5 * np.sin(2.0 * np.pi * campaign.position / 0.6)
    second = 3.0 * np.sin(2.0 * np.pi * campaign.position / 0.31) * (campaign.rows.visit % 3 == 0)
    campaign = campaign.plus((first + second) * campaign.on(0))
    found = search(campaign.rows, campaign.nuisance, make_library(campaign), holdout_fraction=0.3)
    waves = {round(t.theta, 1): t for t in found.terms if t.key == "periodic-0"}
    assert set(waves) == {0.6, 0.3}
    assert waves[0.6].status is Status.CONFIRMED
    assert waves[0.3].status is not Status.CONFIRMED
    assert waves[0.3].slope is None or waves[0.3].slope.value != waves[0.6].slope.value


# What has just changed, and what came once.


@pytest.mark.slow
def test_the_last_visit_is_never_left_out_as_a_slip():
    campaign = make_campaign(62, visits=16)
    changed = campaign.rows.visit == 15
    campaign = campaign.plus(30.0 * changed * campaign.on(0))
    found = search(campaign.rows, campaign.nuisance, make_library(campaign), holdout_fraction=0.3)
    assert not [one for one in found.excluded if one.visit is not None]


@pytest.mark.parametrize(("off", "verdict"), [(0.5, Verdict.NOTHING), (15.0, Verdict.UNEXPLAINED)])
def test_a_few_visits_far_from_the_model_are_not_called_nothing(off, verdict):
    campaign = make_campaign(63, visits=2)
    declared = {c: DeclaredNoise(1.0) for c in range(2)}
    rows = replace(campaign.rows, noise=declared)
    campaign = replace(campaign, rows=rows).plus(off * campaign.on(0))
    reversal = single(
        campaign, "reversal", "backlash", 0, lambda _: campaign.direction, within_visit=True
    )
    leads = single(campaign, "time", "generic", 0, lambda _: smooth(campaign.time), generic=True)
    found = search(campaign.rows, [], [reversal, leads], holdout_fraction=0.3)
    assert found.verdict is verdict
    far = [one.channel for one in found.unexplained if one.test == "far-off"]
    assert far == ([0] if verdict is Verdict.UNEXPLAINED else [])


@pytest.mark.slow
def test_an_effect_hides_no_outliers():
    """A reversal of ±6 repeatabilities makes all values scatter; five are 14 off beside it."""
    campaign = make_campaign(64, visits=16)
    wrong = np.flatnonzero(campaign.on(0))[[3, 40, 77, 110, 150]]
    slips = np.zeros(len(campaign.rows.values))
    slips[wrong] = 14.0 * campaign.direction[wrong]
    campaign = campaign.plus(6.0 * campaign.direction * campaign.on(0) + slips)
    found = search(campaign.rows, campaign.nuisance, make_library(campaign), holdout_fraction=0.3)
    gone = {row for one in found.excluded if one.visit is None for row in one.rows}
    assert gone >= set(wrong.tolist())
    assert len(gone) <= 8
    assert [term.key for term in found.terms] == ["reversal-0"]
    assert found.terms[0].amplitudes == pytest.approx([6.0], abs=0.4)
    assert found.verdict is Verdict.FOUND


def validation(slopes, found_in):
    """Six rows of two channels in three folds."""
    return Validation(
        after=np.arange(6.0),
        adopted=np.zeros(6),
        known=np.zeros(6),
        apart=np.zeros((len(slopes), 6)),
        variance=np.zeros(6),
        fold=np.array([0, 1, 2, 0, 1, 2]),
        slopes=slopes,
        found_in=found_in,
        folds=3,
    )


def test_a_fold_that_missed_a_sure_effect_says_nothing_of_what_it_leaves():
    """The whole effect is left there: too few visits taught it."""
    channel = np.array([0, 0, 0, 1, 1, 1])
    sure, acting = [Slope(1.0, 0.2, 25.0)] * 2, SimpleNamespace(channels=(0,))
    checked = validation([sure], [{0, 2}])
    assert checked.settled([acting], [()]) == {0}
    left = checked.where_found([acting], {0}, channel).after
    assert np.isnan(left).tolist() == [False, True, False, False, False, False]
    # What is not sure may stand for another: what it leaves counts everywhere it acts.
    assert checked.settled([acting], [("it depends differently on its driver",)]) == set()
    assert np.isfinite(checked.where_found([acting], (), channel).after).all()
    both = validation([sure, [Slope(0.1, 0.2, 25.0)]], [{0, 2}, {0}])
    others = SimpleNamespace(channels=(0, 1))
    assert both.settled([acting, others], [(), ()]) == set()
    assert both.settled([SimpleNamespace(channels=(0, 2)), others], [(), ()]) == {2}


@pytest.mark.parametrize(
    ("slopes", "sure"),
    [
        ([Slope(1.0, 0.2, 25.0)] * 2, True),
        ([Slope(1.0, 0.2, 25.0)], False),  # in one fold of three
        ([Slope(0.1, 0.2, 25.0)] * 3, False),
        ([Slope(3.0, 0.2, 25.0)] * 3, False),
        ([], False),
    ],
)
def test_what_held_out_visits_confirm(slopes, sure):
    assert validation([slopes], [set(range(len(slopes)))]).confirms(0) is sure


def test_what_teaching_leaves_open_is_that_of_the_amplitude_and_of_the_maps():
    campaign = make_campaign(7, visits=12)
    cells, everything = {v: v for v in range(12)}, np.ones(len(campaign.rows.values), dtype=bool)
    candidate = single(campaign, "speed", "speed", 0, lambda _: campaign.speed)

    def left_open(nuisance, visits):
        problem = make_problem(campaign.rows, nuisance, everything, cells, 12)
        term = problem.term(candidate, None)
        learned = learn(problem.states(np.arange(12) < visits), [term])
        by_amplitude = term.columns[0][:, 0] ** 2 * learned.fit.covariance[0, 0]
        return _open(learned), by_amplitude

    found, by_amplitude = left_open([], 6)
    assert found[0] == pytest.approx(by_amplitude, rel=1e-6)
    assert not found[1].any()  # no term acts there, and no map may be wrong
    assert left_open([], 12)[0][0].mean() < found[0].mean()
    with_maps, _ = left_open(campaign.nuisance, 6)
    assert with_maps[0].mean() > found[0].mean()
    assert 0.0 < with_maps[1].mean() < 2 * 0.4**2  # never more than the maps' own prior


def test_a_part_of_the_visits_that_lacks_a_channel_keeps_its_own_nonlinear_parameter():
    """An hour between two clocks that one component did not show in that part ended an analysis."""
    candidate = Candidate("one", "clock-offset", lambda theta: [])
    norms, column = np.ones(1), np.ones((3, 1))
    whole = Term(candidate, 60.0, {0: column, 2: column}, norms)
    part = Term(candidate, 40.0, {0: column}, norms)
    learned = Learned([part], None, {})
    assert _as_all_say(None, learned, [0], [whole], np.ones(1, dtype=bool)).terms == [part]
