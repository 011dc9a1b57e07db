"""Flexible versions of hypotheses: what they would add if they were only about right."""

import numpy as np
import pytest

from app.effects.campaign_view import CampaignView
from app.effects.conditions import Signal
from app.effects.flexible import HALF_WIDTHS, HYSTERESIS
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
def view():
    _, campaign = campaign_with("backlash", 2.0, 1, visits=8, days=2)
    projection = residuals_of(campaign).projection
    return CampaignView(campaign.model, campaign.maps, projection.rows, projection.conditions)


@pytest.fixture(scope="module")
def candidates(view):
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


def test_what_moves_may_follow_its_temperature_with_play(view, candidates):
    """How far the play is behind, and the temperature, from their means; also along the axis."""
    speed = candidates["state-variable"]
    plays = [one for one in speed.flexible(speed.thetas[0]) if one.words == HYSTERESIS]
    code = speed.key.split()[-2]
    shown = view.projection.view(code)
    sensor, conditions = view.sensor_of(code), shown.conditions
    temperatures_c = conditions.temperature(sensor)
    assert len(plays) == len(HALF_WIDTHS)
    for share, play in zip(HALF_WIDTHS, plays, strict=True):
        half_k = share * np.ptp(temperatures_c)
        behind_k = (
            conditions.lags.played(Signal("temperature", sensor), half_k, conditions.times_s)
            - temperatures_c
        )
        assert np.nanmax(np.abs(behind_k)) <= half_k + 1e-9
        columns = np.zeros((len(view.rows), 4))
        for part in play.parts:
            columns[part.rows] = part.columns
        own = columns[shown.rows] / shown.gains[:, None]
        np.testing.assert_allclose(
            own[:, 0], np.nan_to_num(behind_k - np.nanmean(behind_k)), atol=1e-9
        )
        np.testing.assert_allclose(own[:, 2], temperatures_c - temperatures_c.mean(), atol=1e-9)
        np.testing.assert_allclose(own[:, 1] * own[:, 2], own[:, 0] * own[:, 3], atol=1e-9)


def test_a_reversal_and_what_never_changes_have_no_play(candidates):
    for kind in ("backlash", "outdated-map"):
        assert HYSTERESIS not in versions(candidates[kind])


def test_two_bodies_in_turn_are_a_low_pass_of_a_low_pass(candidates):
    """By partial fractions from two low-passes of the sensor, exactly; against the filter twice."""
    lag = candidates["thermal-lag"]
    (form,) = lag.forms()
    assert form.words == "it responds as two lags in series"
    assert list(candidates["backlash"].forms()) == []
    assert list(form.candidate.forms()) == []
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
