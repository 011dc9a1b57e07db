"""What resembles a mistake is not taken for it, nor the mistake for what it resembles.

A sensor that reports late and a structure that follows late, exchanged plugs and a component that
follows the difference of two sensors: each is named as what was planted, or as what cannot be told
from it, and then that is said. The readings end with the last visit, as they do in a shop that
measures and analyses at once.
"""

import pytest

from app.identification.analysis.analyse import analyse
from app.simulation.undeclared import make_campaign
from scripts.campaign_of_bodies import campaign_of_bodies

AMONG = (
    *("late-sensor", "thermal-lag", "clock-offset", "exchanged-sensors", "sensor-gradient"),
    *("other-sensor", "additional-sensor", "detached-sensor"),
)
"""The two pairs, and what resembles either."""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("planted", "seed", "amplitude"),
    [
        ("late-sensor", 3, 1.0),
        ("thermal-lag:sensor", 1, 1.0),
        ("exchanged-sensors:both-followed", 3, 2.0),
        ("sensor-gradient", 1, 2.0),
    ],
)
def test_the_planted_one_is_named_or_said_to_be_tied(planted, seed, amplitude):
    made = make_campaign(seed, planted, amplitude, visits=16, days=4, observations_per_visit=16)
    campaign = campaign_of_bodies(made.machine, made.error_maps, made.readings, made.verifications)
    (true,) = made.truth.effects
    effects = analyse(campaign, kinds=AMONG).effects
    first = effects[0]
    assert true["kind"] in [first.kind, *(rival.kind for rival in first.ties)]
    assert set(first.components) & set(true["components"])
    for one in effects:
        if true["kind"] not in [one.kind, *(rival.kind for rival in one.ties)]:
            assert one.status != "confirmed"
    if first.kind == "late-sensor":
        assert first.effect.parameters["late_min"] == pytest.approx(
            true["parameters"]["late_min"], rel=0.2
        )
        assert first.effect.parameters["share"] == pytest.approx(1.0, abs=0.2)
