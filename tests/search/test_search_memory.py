"""A large campaign takes no more memory than is stated, and its answer does not depend on it."""

import numpy as np
import pytest

from app.errors import InvalidContent
from app.search import library as libraries
from app.search.base_grams import BaseGrams
from app.search.draws import Draws
from app.search.library import read_library
from app.search.problem import Problem, make_problem
from app.search.scan import scan
from tests.search.search_campaigns import make_campaign, make_library


def read(draws=None, by_cell=True):
    campaign = make_campaign(3, visits=12)
    visits = np.unique(campaign.rows.visit).tolist()
    problem = make_problem(
        campaign.rows,
        campaign.nuisance,
        np.ones(len(campaign.rows.values), dtype=bool),
        {visit: i % 2 for i, visit in enumerate(visits)},
        2,
    )
    return read_library(problem, make_library(campaign), draws, by_cell=by_cell)


def ratios(library):
    return ratios_on(library, library.problem.states(np.ones(2, dtype=bool)))


def ratios_on(library, states):
    return scan(library, states, BaseGrams(library, states)).ratio


def test_what_is_laid_out_at_once_is_limited(monkeypatch):
    whole = read()
    laid_out = []
    side_by_side = Problem.side_by_side

    def watched(problem, wanted):
        laid_out.append(len(wanted))
        return side_by_side(problem, wanted)

    monkeypatch.setattr(Problem, "side_by_side", watched)
    monkeypatch.setattr(libraries, "TOGETHER", 3 * whole.problem.count)
    parted = read()
    assert (max(laid_out), sum(laid_out)) == (3, len(whole.entries))
    assert len(parted.batches) > 2 * len(whole.batches)
    assert sorted(i for b in parted.batches for i in b.entries) == sorted(
        i for b in whole.batches for i in b.entries
    )
    np.testing.assert_allclose(ratios(parted), ratios(whole), rtol=1e-9, atol=1e-9)


def test_what_would_take_too_much_is_refused_with_what_to_do(monkeypatch):
    whole = read(Draws(1, 10))
    size = sum(s.bytes_of_products for b in whole.batches for s in b.sheets.values())
    monkeypatch.setattr(libraries, "MOST_BYTES", size)
    read(Draws(1, 10))
    monkeypatch.setattr(libraries, "MOST_BYTES", size - 1)
    with pytest.raises(InvalidContent, match=r"12 visits and .* analyse fewer verifications"):
        read(Draws(1, 10))


@pytest.mark.parametrize("kept_bytes", [libraries.KEPT_BYTES, 0])
def test_products_of_a_part_of_the_visits_are_made_of_the_entries_that_are_asked_for(
    monkeypatch, kept_bytes
):
    whole = read()
    monkeypatch.setattr(libraries, "KEPT_BYTES", kept_bytes)
    together = read(by_cell=False)
    np.testing.assert_allclose(ratios(together), ratios(whole), rtol=1e-9, atol=1e-9)
    part = np.array([True, False])
    states = whole.problem.states(part)
    with pytest.raises(ValueError, match="not kept apart"):
        ratios_on(together, states)
    wanted = np.arange(len(whole.entries)) % 3 == 0
    expected = np.where(wanted, ratios_on(whole, states), 0.0)
    found = ratios_on(together.take(wanted), states)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)
