"""The loop on the slit: a period that a table at every millimetre cannot show."""

import pytest

from examples.measured.data_folder import data_folder
from examples.measured.loop import (
    Figures,
    close_the_loop,
    effects_of,
    measured_and_left,
    without_means,
    without_ranges,
)
from examples.measured.slit import FOLDER, campaign, read_sweep

pytestmark = pytest.mark.skipif(
    not (data_folder() / FOLDER).is_dir(), reason=f"no measured slit at {data_folder()}"
)


@pytest.fixture(scope="module")
def loop():
    known, asked = campaign(read_sweep(data_folder()))
    return known, asked, effects_of(known, close_the_loop(known))


@pytest.mark.slow
def test_the_period_is_a_quarter_of_a_millimetre(loop):
    _, _, effects = loop
    first = max(effects, key=lambda e: e.parameters["amplitude_um"])
    assert first.kind == "periodic"
    error = first.standard_errors["pitch_mm"]
    assert first.parameters["pitch_mm"] == pytest.approx(0.250, abs=4.0 * error)
    assert error < 0.0005
    # A least-squares sine of 0.250 mm has 20.3 µm.
    assert first.parameters["amplitude_um"] == pytest.approx(20.3, abs=1.0)


@pytest.mark.slow
def test_the_rest_of_the_sweep_is_predicted(loop):
    known, asked, effects = loop
    rows, _, before = measured_and_left(known, asked)
    # The rest of the sweep lies beyond the positions that taught: adopted, the effect is held
    # there and says so. What it would be if it were let go on is what a period is for.
    _, _, after = measured_and_left(known, asked, without_ranges(effects))
    assert Figures.of(without_means(rows, before)).rms == pytest.approx(14.7, abs=0.3)
    assert Figures.of(without_means(rows, after)).rms < 2.0
