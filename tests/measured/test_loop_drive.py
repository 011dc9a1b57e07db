"""The loop on the drive's ISO 230-2 tests, against the evaluation that their author printed."""

import re

import pytest

from examples.measured.data_folder import data_folder
from examples.measured.drive import (
    FOLDER,
    TESTS,
    campaign,
    close_both_ways,
    read_points,
    verifications,
)
from examples.measured.loop import Figures, effects_of, measured_and_left

pytestmark = pytest.mark.skipif(
    not (data_folder() / FOLDER).is_dir(), reason=f"no measured drive at {data_folder()}"
)


def reversal_of_the_report_um(axis):
    """B_avg; forward is the other way round in the report (see test_drive_positioning)."""
    path = data_folder() / FOLDER / "iso230_reports" / f"{TESTS[axis]}.md"
    return -1000.0 * float(re.search(r"^B_avg = ([-\d.]+)", path.read_text("utf-8"), re.M)[1])


@pytest.fixture(scope="module", params=TESTS)
def axis(request):
    return request.param


@pytest.fixture(scope="module")
def found(axis):
    points = read_points(data_folder(), axis)
    rounds = close_both_ways(axis, points, points)
    return {e.kind: e for e in effects_of(campaign(axis, points, points, by_run=True), rounds)}


@pytest.mark.slow
def test_the_reversal_is_that_of_the_report(axis, found):
    effect = found["backlash"]
    error = effect.standard_errors["reversal_um"]
    expected = reversal_of_the_report_um(axis)
    assert effect.parameters["reversal_um"] == pytest.approx(expected, abs=max(3.0 * error, 1.0))
    assert error < 2.0


@pytest.mark.slow
def test_the_warm_up_is_found_with_its_sign(found):
    """Both axes move to the negative side as the motor warms up."""
    assert found["drift"].parameters["drift_um_per_day"] < 0


@pytest.mark.slow
def test_a_cycle_left_out_is_predicted_better(axis):
    points = read_points(data_folder(), axis)
    learn = [p for p in points if p.cycle != 3]
    asked = verifications(axis, [p for p in points if p.cycle == 3], by_run=False)
    known = campaign(axis, points, learn, by_run=False)
    effects = effects_of(known, close_both_ways(axis, points, learn))
    before = Figures.of(measured_and_left(known, asked)[2]).rms
    after = Figures.of(measured_and_left(known, asked, effects)[2]).rms
    assert after < 0.5 * before
