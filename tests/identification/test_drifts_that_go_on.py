"""A drift goes on after its last observation only where it was foretold, and has not ended."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from app.identification.analysis.finished_search import FinishedSearch
from app.search.findings import FoundTerm, Rival, Slope, Status

HELD = Slope(1.0, 0.05, 400.0)
TERM = FoundTerm(
    *("drift EXX", "drift", (0,), None, None, np.ones(1), np.eye(1), 400.0, 1, 390.0, 0.0, ()),
    slope=HELD,
    forward_slope=HELD,
    inclusion=1.0,
    status=Status.CONFIRMED,
    strongest_visits=(),
    leverage=0.1,
)


def goes_on(term=TERM, *others, visits=8):
    rows = SimpleNamespace(channel=np.zeros(visits, dtype=int), visit=np.arange(visits))
    findings = SimpleNamespace(terms=(term, *others))
    found = FinishedSearch(None, rows, findings, np.ones(visits, dtype=bool), {})
    return found.goes_on(term)


def beside(family, channel=0):
    return replace(TERM, key=f"{family} EXX", family=family, channels=(channel,), place=1)


def tied(family):
    return replace(TERM, rivals=(Rival(f"{family} EXX", family, None, 1.0, 0.99, True),))


def test_what_was_foretold_goes_on():
    assert goes_on()
    assert goes_on(TERM, beside("backlash"))
    assert goes_on(TERM, beside("step", channel=1))
    assert goes_on(tied("ageing-sensor"))


@pytest.mark.parametrize(
    "term",
    [
        replace(TERM, status=Status.SUSPECTED),
        replace(TERM, forward_slope=None),
        replace(TERM, forward_slope=Slope(0.6, 0.05, 400.0)),
        tied("step"),
    ],
)
def test_what_nobody_foretold_or_may_have_ended_is_held(term):
    assert not goes_on(term)


def test_a_step_beside_it_or_too_few_set_ups_hold_it():
    assert not goes_on(TERM, beside("step"))
    assert not goes_on(visits=7)
