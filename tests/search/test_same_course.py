"""Of what follows one course, one term is late at most, and none takes back what another gives."""

from dataclasses import replace

import numpy as np
import pytest

from app.search.library import read_library
from app.search.problem import make_problem
from app.search.same_course import second_late, taken_back
from app.search.search import search
from tests.search.search_campaigns import make_campaign, single

GRID = (1.0, 4.0, 16.0)
FOLLOWS = {"EXX bed": 1}


def late(campaign, visits):
    """The temperature through a low-pass with a time constant of so many visits."""
    steps = campaign.temperature[np.unique(campaign.rows.visit, return_index=True)[1]]
    kept, found = np.exp(-1.0 / visits), [steps[0]]
    for step in steps[1:]:
        found.append(kept * found[-1] + (1.0 - kept) * step)
    return np.array(found)[campaign.rows.visit]


def campaign_of(effect, follows=FOLLOWS, visits=30, seed=4, minus=FOLLOWS):
    """Plant an effect on the first channel, to be found at once, late, or late with a minus."""
    campaign = make_campaign(seed, visits=visits)
    campaign = campaign.plus(effect(campaign) * campaign.on(0))
    frame = 0.5 * campaign.speed
    how = {"grid": GRID, "bounds": (0.5, 32.0)}
    candidates = [
        single(campaign, "at once", "sensor", 0, lambda _: campaign.temperature),
        single(campaign, "late", "sensor", 0, lambda t: late(campaign, t), **how),
        single(campaign, "less, late", "bend", 0, lambda t: frame - late(campaign, t), **how),
    ]
    known = (follows, follows, minus and {"EXX bed": -1, "EXX frame": 1})
    return campaign, [replace(c, follows=f) for c, f in zip(candidates, known, strict=True)]


def terms_of(effect, **how):
    campaign, candidates = campaign_of(effect, **how)
    return search(campaign.rows, campaign.nuisance, candidates, holdout_fraction=0.2, seed=1).terms


def problem_of(campaign):
    cells = dict.fromkeys(np.unique(campaign.rows.visit).tolist(), 0)
    everything = np.ones(len(campaign.rows.values), dtype=bool)
    return make_problem(campaign.rows, campaign.nuisance, everything, cells, 1)


def test_beside_a_late_term_no_other_that_follows_the_same_late_is_chosen():
    campaign, candidates = campaign_of(lambda c: 3.0 * late(c, 4.0))
    other = replace(candidates[1], key="of the frame, late", follows={"EXX frame": 1})
    elsewhere = replace(candidates[1], key="elsewhere, late", follows={"EYX bed": 1})
    problem = problem_of(campaign)
    library = read_library(problem, [*candidates, other, elsewhere], None)
    keys = [library.candidates[e.candidate].key for e in library.entries]

    def refused(*others):
        of = second_late(library, [problem.term(c, c.thetas[0]) for c in others])
        return {key for key, is_second in zip(keys, of, strict=True) if is_second}

    assert refused() == refused(candidates[0]) == set()
    assert refused(candidates[1]) == {"late", "less, late"}
    assert refused(other) == {"of the frame, late", "less, late"}
    assert refused(candidates[2]) == {"late", "less, late", "of the frame, late"}


@pytest.mark.parametrize(
    ("effect", "places", "back"),
    [
        (lambda c: 8.0 * c.temperature + 7.0 * late(c, 4.0), (0, 1), []),
        (lambda c: 8.0 * c.temperature - 7.0 * late(c, 4.0), (0, 1), [1]),
        # What is subtracted gives with a minus.
        (lambda c: 8.0 * c.temperature + 7.0 * late(c, 4.0), (2, 0), []),
        (lambda c: 8.0 * c.temperature - 7.0 * late(c, 4.0), (2, 0), [0]),
    ],
)
def test_signs_say_what_is_taken_back(effect, places, back):
    campaign, candidates = campaign_of(effect)
    problem = problem_of(campaign)
    terms = [problem.term(c, 4.0 if c.grid else None) for c in (candidates[i] for i in places)]
    states = problem.states(np.ones(1, dtype=bool))
    assert taken_back(states, terms) == back
    free = [problem.term(replace(t.candidate, follows={}), t.theta) for t in terms]
    assert taken_back(states, free) == []


@pytest.mark.slow
@pytest.mark.parametrize("tau", [3.0, 9.0])
def test_what_is_late_is_named_alone_with_its_time_constant(tau):
    (term,) = terms_of(lambda c: 3.0 * late(c, tau))
    assert term.key == "late"
    assert abs(term.theta - tau) < 3.0 * term.theta_error
    assert abs(term.amplitudes[0] - 3.0) < 3.0 * np.sqrt(term.covariance[0, 0])


@pytest.mark.slow
def test_what_acts_at_once_is_not_called_late():
    (term,) = terms_of(lambda c: 3.0 * c.temperature)
    assert term.key == "at once"


@pytest.mark.slow
def test_part_at_once_and_part_late_of_one_sign_are_both_named():
    terms = terms_of(lambda c: 6.0 * c.temperature + 12.0 * late(c, 12.0), visits=60)
    found = {term.key: term.amplitudes[0] for term in terms}
    assert found == {"at once": pytest.approx(6.0, abs=1.0), "late": pytest.approx(12.0, abs=1.0)}


def cancelling(campaign):
    """Two lags whose amplitudes nearly cancel: what no single one can do."""
    return 30.0 * (late(campaign, 1.5) - late(campaign, 6.0))


@pytest.mark.slow
def test_lags_that_cancel_each_other_are_not_named_together():
    free = terms_of(cancelling, follows={}, minus={}, visits=60)
    assert sum(term.key != "at once" for term in free) > 1
    found = terms_of(cancelling, visits=60)
    assert sum(term.key != "at once" for term in found) <= 1


def of_bed(terms):
    """What each term gives for a unit of the bed."""
    return [(-1.0 if term.key.startswith("less") else 1.0) * term.amplitudes[0] for term in terms]


@pytest.mark.slow
def test_no_amplitude_takes_back_what_another_gives():
    def overshoot(campaign):
        return 8.0 * campaign.temperature - 7.0 * late(campaign, 3.0)

    free = of_bed(terms_of(overshoot, follows={}, minus={}))
    assert min(free) < 0 < max(free)
    found = of_bed(terms_of(overshoot))
    assert found
    assert min(found) > 0 or max(found) < 0
