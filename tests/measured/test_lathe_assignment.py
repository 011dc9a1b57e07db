"""Which sensor the lathe's components should follow, as its known runs say.

The figures are those of docs/measured-data.md, rounded to the safe side.
"""

from dataclasses import replace

import pytest

from app.identification.analysis.assignments import judge_assignments
from app.identification.campaign import residuals_of
from app.thermal.compile_model import compile_model
from examples.measured.data_folder import data_folder
from examples.measured.lathe import make_lathe
from examples.measured.lathe_public import unseen_dates
from examples.measured.lathe_runs import FAILED, FOLDER, read_runs

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        not (data_folder() / FOLDER).is_dir(),
        reason=f"no measured runs of the lathe at {data_folder()}",
    ),
]


@pytest.fixture(scope="module")
def lathe():
    return make_lathe(read_runs(data_folder()))


def assigned(lathe, **sensors):
    """The lathe with some components mapped over other sensors."""
    present = {code: group.sensor for group in lathe.model.groups for code in group.codes}
    wanted = {**present, **sensors}
    return replace(lathe, model=compile_model(lathe.model.machine, lathe.maps, wanted))


def judged(lathe):
    """What the runs say that are not left unseen."""
    unseen = unseen_dates(lathe, "20200616")
    campaign = lathe.campaign([date for date in lathe.dates if date not in unseen])
    found = judge_assignments(campaign, residuals_of(campaign))
    return {one.component: one for one in found}


def test_the_sensors_that_maps_correlate_with_stay(lathe):
    """No other of 23 leaves less of X or of Z by more than a tenth."""
    for one in judged(lathe).values():
        assert one.proposed_sensor is None
        assert "not markedly less" in one.why_not
        assert one.setups == 18
        # It has left its neighbours: nothing may follow it.
        assert FAILED not in (one.other_sensor, *one.as_good)


@pytest.mark.parametrize("sensor", ["Spindle Motor", "TC07"])
def test_where_a_lag_explains_as_much_no_sensor_is_proposed(lathe, sensor):
    """Both answer the room before X does: PT11 leaves less, and so do they themselves, late."""
    one = judged(assigned(lathe, EXX=sensor))["EXX"]
    assert (one.other_sensor, one.proposed_sensor) == ("PT11", None)
    assert one.before_rms - one.after_rms > 2.0
    assert f"thermal-lag of EXX driven by {sensor} explains as much" in one.why_not
