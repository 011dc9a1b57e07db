"""The demo's week: the same always, whole, and with an effect that an analysis can find."""

import numpy as np
import pytest

from app.effects.observations import observation_rows
from app.identification.analysis.analyse import analyse
from app.simulation.week import make_week
from scripts.campaign_of_bodies import campaign_of_bodies


@pytest.fixture(scope="module")
def week():
    return make_week()


def campaign(week, days):
    readings = [*week.week.readings, *week.after.readings]
    return campaign_of_bodies(week.machine, week.error_maps, readings, days)


def test_seven_days_of_readings_and_then_two(week):
    assert len(week.week.readings) == 7 * 1440
    assert week.week.readings[0]["time"] == "2026-02-02T00:00:00Z"
    assert week.after.readings[0]["time"] == "2026-02-09T00:00:00Z"
    times = [o["time"] for v in week.week.verifications for o in v["observations"]]
    assert max(times) < "2026-02-09"
    assert min(o["time"] for v in week.after.verifications for o in v["observations"]) > max(times)
    assert make_week() == week


def test_visits_of_one_verification_are_told_apart(week):
    (whole,) = week.week.verifications
    rows = observation_rows(campaign(week, [whole]).verifications)
    assert len(np.unique(rows.visit)) == 20
    assert len(week.after.verifications) == 8


@pytest.mark.slow
def test_the_effect_of_the_week_is_found_and_confirmed(week):
    found = analyse(campaign(week, week.week.verifications))
    (true,) = week.effects
    (effect,) = found.effects
    assert (effect.effect.kind, list(effect.components)) == (true["kind"], true["components"])
    assert effect.status == "confirmed"
    assert found.after.holdout_rms < 0.7 * found.before.holdout_rms
