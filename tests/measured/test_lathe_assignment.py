"""Which sensor the lathe's components should follow, as its known runs say.

The figures are those of docs/measured-data.md, rounded to the safe side.
"""

from dataclasses import replace

import pytest

from app.identification.analysis.analyse import analyse
from app.thermal.compile_model import compile_model
from examples.measured.data_folder import data_folder
from examples.measured.lathe import make_lathe
from examples.measured.lathe_public import unseen_dates
from examples.measured.lathe_runs import FOLDER, read_runs

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


@pytest.mark.parametrize("wrong", [{}, {"EXX": "TC07"}])
def test_no_sensor_is_proposed_where_several_move_a_component(lathe, wrong):
    """Of 23 that are alike many are found to move X and Z, none of them alone and as a whole."""
    unseen = unseen_dates(lathe, "20200616")
    machine = assigned(lathe, **wrong)
    campaign = machine.campaign([date for date in lathe.dates if date not in unseen])
    answer = analyse(campaign, kinds=["other-sensor", "thermal-lag"])
    assert answer.proposals == ()
    assert "other-sensor" in {effect.kind for effect in answer.effects}
