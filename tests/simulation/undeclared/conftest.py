"""Campaigns that several tests look at, each made once."""

import numpy as np
import pytest

from app.simulation.undeclared import make_campaign
from app.simulation.undeclared.conditions import NO_SCATTER

SMALL = {"visits": 20, "days": 4}


@pytest.fixture(scope="session")
def campaign_of():
    """Make small campaigns: seed, effects, amplitude and conditions to campaign."""
    made = {}

    def make(seed=1, planted=None, amplitude=2.0, **conditions):
        key = (seed, str(planted), amplitude, tuple(sorted(conditions.items())))
        if key not in made:
            under = {**SMALL, **conditions}
            made[key] = make_campaign(seed, planted, amplitude, **under)
        return made[key]

    return make


@pytest.fixture(scope="session")
def exact_of(campaign_of):
    """Make small campaigns in which everything is known exactly."""

    def make(seed=1, planted=None, amplitude=2.0, **conditions):
        return campaign_of(seed, planted, amplitude, **{**NO_SCATTER, **conditions})

    return make


@pytest.fixture(scope="session")
def rms():
    return lambda values: float(np.sqrt(np.mean(np.square(values))))
