"""Flexible versions of hypotheses: what they would add if they were only about right."""

import numpy as np
import pytest

from app.effects.campaign_view import CampaignView
from app.effects.low_pass import low_pass
from app.effects.registry import repertoire
from app.identification.campaign import residuals_of
from app.search.candidate import OFFSET
from tests.identification.test_refits import campaign_with

ALONG = "it varies differently along the axis"
DRIVER = "it depends differently on its driver"
VISITS = "its size changes from visit to visit"
LATER = "part of it responds faster or slower"


@pytest.fixture(scope="module")
def candidates():
    _, campaign = campaign_with("backlash", 2.0, 1, visits=8, days=2)
    projection = residuals_of(campaign).projection
    view = CampaignView(campaign.model, campaign.maps, projection.rows, projection.conditions)
    kinds = ["backlash", "thermal-lag", "state-variable", "outdated-map"]
    found = repertoire(view, kinds).candidates
    return {kind: next(c for c in found if c.family == kind) for kind in kinds}


def versions(candidate, theta=None):
    return {one.words: one.parts for one in candidate.flexible(theta)}


def test_what_drives_nothing_has_no_other_dependence(candidates):
    assert DRIVER not in versions(candidates["backlash"])
    assert OFFSET not in versions(candidates["outdated-map"])
    assert DRIVER in versions(candidates["state-variable"], candidates["state-variable"].thetas[0])


def test_a_late_one_may_answer_faster_or_slower(candidates):
    lag = candidates["thermal-lag"]
    assert LATER in versions(lag, lag.thetas[len(lag.thetas) // 2])
    assert LATER not in versions(candidates["backlash"])


def test_stretches_add_up_to_the_whole(candidates):
    """A size of its own in each stretch of time holds one size in all of them."""
    reversal = candidates["backlash"]
    for own, parts in zip(reversal.columns(None), versions(reversal)[VISITS], strict=True):
        np.testing.assert_allclose(parts.columns.sum(axis=1), own.columns[:, 0])
        assert parts.columns.shape[1] == 8


def test_along_the_axis_are_powers_of_the_position(candidates):
    parts = versions(candidates["backlash"])[ALONG]
    for own, flexible in zip(candidates["backlash"].columns(None), parts, strict=True):
        shown = own.columns[:, 0] != 0
        power = flexible.columns[shown] / own.columns[shown, :1]
        np.testing.assert_allclose(power[:, 1], power[:, 0] ** 2, atol=1e-12)
        assert np.abs(power).max() <= 1.0 + 1e-12


def test_two_bodies_in_turn_are_a_low_pass_of_a_low_pass(candidates):
    """By partial fractions from two low-passes of the sensor, exactly; against the filter twice."""
    lag = candidates["thermal-lag"]
    (form,) = lag.forms
    assert form.words == "it responds as two lags in series"
    assert candidates["backlash"].forms == ()
    times_s = np.arange(0.0, 86400.0, 60.0)
    room = 20.0 + 3.0 * np.sin(times_s / 9000.0)
    once = low_pass(times_s, room, 2400.0).outputs
    twice = low_pass(times_s, once, 1200.0).outputs
    fast = low_pass(times_s, room, 1200.0).outputs
    np.testing.assert_allclose(twice, 2.0 * once - fast, atol=1e-3)
    pairs = zip(
        form.candidate.columns(2400.0), lag.columns(2400.0), lag.columns(1200.0), strict=True
    )
    for own, slow, quick in pairs:
        np.testing.assert_allclose(own.columns, 2.0 * slow.columns - quick.columns, atol=1e-9)
