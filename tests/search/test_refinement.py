"""How well a nonlinear parameter is said to be known."""

from dataclasses import replace

import numpy as np
import pytest

from app.search.candidate import Candidate, Part
from app.search.joint_fit import fit_terms
from app.search.refinement import INTERVAL, INTERVAL_DROP, _Search, refine
from tests.search.search_campaigns import make_campaign, single
from tests.search.test_same_course import campaign_of, late, problem_of

GRID = tuple(300.0 * 2.0**k for k in range(7))


class Known(_Search):
    """The likelihood along a time constant is as stated."""

    def __init__(self, drop, grid=GRID, *, log_scale=True):
        self.candidate = Candidate(
            "late", "lag", lambda _: [], grid, (grid[0], grid[-1]), log_scale=log_scale
        )
        self.drop = drop

    def loss(self, place):
        return 7.0 + self.drop(place)


def well(at, width):
    """A parabola in the logarithm, of which the standard error is known."""
    return lambda place: 0.5 * ((place - np.log(at)) / width) ** 2


def test_of_one_maximum_the_error_is_its_width():
    found = Known(well(2400.0, 0.05)).error(np.log(2400.0), 0.7)
    assert found == pytest.approx(0.05 * 2400.0, rel=0.02)


def test_of_two_maxima_hardly_apart_the_interval_holds_both():
    """A lag of 20 min was called 160 ± 27 min: the second maximum was 1.1 lower."""
    first, second = well(9600.0, 0.15), well(1200.0, 0.3)
    two = Known(lambda place: min(first(place), 1.1 + second(place)))
    error = two.error(np.log(9600.0), 0.7)
    assert 9600.0 - INTERVAL * error < 1200.0
    # It ends where the likelihood ends: at a drop of half the square of 1.96.
    end = 1200.0 * np.exp(-0.3 * np.sqrt(2.0 * (INTERVAL_DROP - 1.1)))
    assert 9600.0 - INTERVAL * error == pytest.approx(end, rel=0.1)
    # One that is clearly worse says nothing.
    far = Known(lambda place: min(first(place), 2.5 + second(place)))
    assert far.error(np.log(9600.0), 0.7) == pytest.approx(0.15 * 9600.0, rel=0.25)


def test_an_interval_that_is_longer_on_one_side_is_told_by_that_side():
    """± says one number: it is the one that holds the truth on either side."""
    broad = Known(well(2400.0, 0.5)).error(np.log(2400.0), 0.7)
    assert 2400.0 + INTERVAL * broad == pytest.approx(2400.0 * np.exp(0.5 * INTERVAL), rel=0.1)


def test_without_a_logarithm_it_is_the_same():
    shape = lambda place: min(  # noqa: E731
        0.5 * ((place - 8.0) / 0.5) ** 2, 1.0 + 0.5 * ((place - 2.0) / 0.5) ** 2
    )
    grid = tuple(float(k) for k in range(11))
    found = Known(shape, grid, log_scale=False).error(8.0, 2.0)
    assert 8.0 - INTERVAL * found == pytest.approx(2.0 - 0.5 * np.sqrt(2.0 * 0.92), abs=0.3)


@pytest.mark.parametrize("start", [3.9, 4.0, 4.1, 8.1])
def test_a_value_of_the_grid_is_crossed_on_the_way_to_the_best(start):
    """Refined beside one term, a lag stays where it came to be until another term moves it."""
    campaign, candidates = campaign_of(lambda c: 20.0 * late(c, 2.5), visits=40)
    problem = problem_of(campaign)
    term = problem.term(candidates[1], start)
    found = refine(problem, problem.states(np.ones(1, dtype=bool)), term)
    # From 8.1 on, 16 is nearer than 4: its neighbour 4 is as far as one step goes.
    assert found.theta == pytest.approx(2.5 if start < 8.0 else 4.0, rel=0.1)


def test_what_is_not_proportional_to_its_size_is_laid_out_about_that():
    """A sensor's bias moves the temperature past a map, on whose other side the slope differs."""
    campaign = make_campaign(4, visits=40)

    def errors(bias):
        warm = np.maximum(campaign.temperature + bias, 0.0) - np.maximum(campaign.temperature, 0.0)
        return 20.0 * warm

    here = np.flatnonzero(campaign.on(0))
    slope = single(campaign, "bias", "fault", 0, lambda _: 20.0 * (campaign.temperature > 0.0))
    bent = replace(slope, about=lambda _, bias: [Part(0, here, errors(bias)[here, None] / bias)])
    campaign = campaign.plus(errors(-1.2) * campaign.on(0))
    problem = problem_of(campaign)
    states = problem.states(np.ones(1, dtype=bool))

    def size(term):
        return fit_terms(states, [term]).amplitudes[0] / term.norms[0]

    linear = problem.term(slope, None)
    assert refine(problem, states, linear).columns is linear.columns
    assert abs(size(linear) + 1.2) > 0.2
    found = refine(problem, states, problem.term(bent, None))
    assert size(found) == pytest.approx(-1.2, abs=0.1)
    assert found.about == pytest.approx(-1.2, abs=0.1)
