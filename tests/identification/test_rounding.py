"""An instrument that reads coarse steps scatters by its rounding, beside what it states."""

from dataclasses import replace

import numpy as np
import pytest

from app.identification.analysis.analyse import analyse
from app.identification.campaign import residuals_of
from app.identification.residuals.rounding import rounding
from app.search.noise import repeatability
from app.search.rows import DeclaredNoise, Rows
from app.simulation.undeclared import make_campaign
from scripts.campaign_of_bodies import campaign_of_bodies


def declared(made):
    campaign = campaign_of_bodies(made.machine, made.error_maps, made.readings, made.verifications)
    rows = residuals_of(campaign).as_rows()
    return [noise.repeatability for noise in rows.noise.values() if noise.repeatability]


@pytest.mark.parametrize("step", [0.01, 0.1, 0.633, 2.54])
def test_steps_are_seen_and_what_has_none_is_left_alone(step):
    rng = np.random.default_rng(4)
    values = rng.normal(0.0, 5.0, 200)
    read = np.round(np.round(values / step) * step, 4)
    assert rounding(read) == pytest.approx(step / np.sqrt(12.0), rel=0.02)
    # A zero somewhere else, and one value that the instrument cannot have read.
    assert rounding(read + 0.37) == pytest.approx(rounding(read), rel=0.02)
    assert rounding(np.append(read, read[0] + 0.4 * step)) < 0.5 * rounding(read)
    assert rounding(values) < 1e-4
    assert rounding(read[:3]) == 0.0


def test_rounding_joins_the_stated_repeatability():
    """Of few values of one component too: all lengths are read by the same instrument."""
    fine = declared(make_campaign(5, visits=8))
    coarse = declared(make_campaign(5, visits=8, measured_quantum_um=2.0))
    assert fine == pytest.approx([1.0] * len(fine), abs=1e-6)
    assert coarse == pytest.approx([np.sqrt(1.0 + 4.0 / 12.0)] * len(coarse))


@pytest.mark.slow
def test_steps_of_two_repeatabilities_are_nothing_unexplained():
    """Held-out values lay a third above a floor that knew nothing of their steps."""
    made = make_campaign(708, visits=36, measured_quantum_um=2.0)
    campaign = campaign_of_bodies(made.machine, made.error_maps, made.readings, made.verifications)
    assert analyse(campaign).verdict == "nothing-found"


@pytest.mark.parametrize("replicated", [True, False])
def test_values_that_repeat_exactly_scatter_by_their_rounding(replicated):
    """What moves by less than a step repeats exactly, and is known no better for that."""
    rounded = 1.0 / np.sqrt(12.0)
    replicate = np.repeat(np.arange(12), 2) if replicated else np.full(24, -1)
    rows = Rows(
        *(np.full(24, 0.01), np.arange(24) // 4, np.zeros(24, int), np.zeros((24, 0)), replicate),
        minutes=1e3 * (np.arange(24) // 4),
        noise={0: DeclaredNoise(rounding=rounded)},
    )
    rows.values[:2] += 1.0
    found = repeatability(rows, 0, np.ones(24, dtype=bool))
    assert (found.value, found.origin) == (rounded, "rounding")
    assert repeatability(replace(rows, noise={}), 0, np.ones(24, bool)).value < rounded


@pytest.mark.slow
def test_squareness_read_in_steps_is_nothing_unexplained():
    """Eight values, in pairs that are equal: one step between two of them is no cause."""
    made = make_campaign(31004, visits=20, later_visits=20, measured_quantum_um=1.0)
    campaign = campaign_of_bodies(made.machine, made.error_maps, made.readings, made.verifications)
    assert analyse(campaign, kinds=("backlash", "drift")).verdict == "nothing-found"
