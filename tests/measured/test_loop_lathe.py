"""The loop on the lathe's runs: a failed sensor, a stopped log, and runs left out.

The figures are those of docs/measured-data.md, rounded to the safe side: what is asserted is
that the findings stand, not their last digit.
"""

from datetime import UTC, datetime

import pytest

from app.identification.campaign import residuals_of
from app.identification.residuals.frozen_observations import FROZEN
from app.thermal.doubtful_sensors import doubtful_sensors
from examples.measured.data_folder import data_folder
from examples.measured.lathe import make_lathe
from examples.measured.lathe_public import FIRST_UNSEEN, unseen_dates
from examples.measured.lathe_runs import FAILED, FOLDER, read_runs
from examples.measured.loop import (
    MAY_BE_ADOPTED,
    Figures,
    close_the_loop,
    effects_of,
    measured_and_left,
    without_means,
)

pytestmark = pytest.mark.skipif(
    not (data_folder() / FOLDER).is_dir(),
    reason=f"no measured runs of the lathe at {data_folder()}",
)

PARTS = 7


@pytest.fixture(scope="module")
def lathe():
    return make_lathe(read_runs(data_folder()), every_s=900.0)


@pytest.mark.slow
def test_every_run_but_that_of_the_maps_is_unseen_in_one_split(lathe):
    unseen = [date for since in FIRST_UNSEEN for date in unseen_dates(lathe, since)]
    assert sorted(unseen) == lathe.dates
    assert len(unseen) == 28


@pytest.mark.slow
def test_the_failed_sensor_is_named_with_its_day(lathe):
    (one,) = doubtful_sensors(lathe.readings)
    assert one.sensor == FAILED
    assert f"{datetime.fromtimestamp(one.since_s, UTC):%Y%m%d}" == "20200821"
    assert one.off_by_k == pytest.approx(31.0, abs=1.0)


@pytest.mark.slow
def test_rows_of_the_stopped_log_are_left_out_and_counted():
    """By hand: 19 runs with a stretch of 12 to 61 min in which X and Z repeat one value."""
    every_row = make_lathe(read_runs(data_folder()), every_s=0.0)
    campaign = every_row.campaign([run.date for run in every_row.runs])
    residuals = residuals_of(campaign)
    assert [one.reason for one in residuals.left_out] == [FROZEN]
    labels = [v.label for v in campaign.verifications for _ in v.observations]
    gone = {label for label, kept in zip(labels, residuals.kept, strict=True) if not kept}
    assert len(gone) == 19
    assert 2600 <= residuals.left_out[0].count <= 2900


@pytest.mark.slow
@pytest.mark.parametrize("part", [2, 6])
def test_runs_that_took_no_part_are_predicted_better(lathe, part):
    """Four whole runs; the failed sensor drives nothing, and is named."""
    left_out = lathe.dates[part::PARTS]
    learn = lathe.campaign([d for d in lathe.dates if d not in left_out])
    # A response, which learns everything again without each run, has a benchmark of its own.
    kinds = [name for name in MAY_BE_ADOPTED if name != "response"]
    rounds = close_the_loop(learn, kinds, most_rounds=2)
    named = [one for one in rounds[0].analysis.not_testable if one.on == FAILED]
    assert "departed from its neighbours by +31.0 K on 2020-08-21" in named[0].reason
    effects = effects_of(learn, rounds)
    assert effects
    assert all(FAILED not in effect.sensors for effect in effects)
    asked = lathe.verifications(left_out)
    rows, _, before = measured_and_left(learn, asked)
    _, _, after = measured_and_left(learn, asked, effects)
    for code in ("EXX", "EZZ"):
        own = rows.of_channel(code)
        course = [Figures.of(without_means(rows, left)[own]).rms for left in (before, after)]
        assert course[1] < 0.8 * course[0]
