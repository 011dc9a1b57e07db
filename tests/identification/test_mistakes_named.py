"""People's mistakes, planted by the simulator: each is found and named alone, with what to do."""

import copy
import json
from datetime import datetime, timedelta

import pytest

from app.effects.registry import KINDS, kind_of
from app.identification.analysis.analyse import analyse
from app.simulation.undeclared import make_campaign
from app.storage.analysis_results import RESULTS
from scripts.campaign_of_bodies import campaign_of_bodies

AMONG = (
    *(name for name, kind in KINDS.items() if kind.not_adopted),
    *("map-temperature", "wrong-map", "thermal-lag", "other-sensor", "outdated-map"),
    *("sensor-fault", "ageing-sensor", "detached-sensor"),
)
"""All mistakes, and what they were called before they had names of their own."""

PLANTED = {
    "exchanged-sensors:both-followed": (3, ["Swap the plugs of x-middle and z-column"]),
    "map-factor:sign-in-one-map": (2, ["store them again multiplied by -1"]),
    "map-temperature:inner": (1, ["Look up what x-middle read when map 'State 2' was measured"]),
    "wrong-map:slope": (1, ["again; until then the correction may be adopted"]),
    "clock-offset:an-hour-early": (1, ["min later (by whole hours"]),
    "mirrored-axis:axis": (1, ["in which direction X was counted"]),
    "detached-sensor": (1, ["Fasten z-column to its body"]),
}
"""Seed, and words of the advice."""


@pytest.mark.slow
@pytest.mark.parametrize("name", PLANTED)
def test_a_mistake_is_named_alone_with_what_to_do(name):
    seed, words = PLANTED[name]
    made = make_campaign(seed, name, 2.0, visits=20, days=4, observations_per_visit=20)
    campaign = campaign_of_bodies(made.machine, made.error_maps, made.readings, made.verifications)
    found = json.loads(RESULTS.text(analyse(campaign, kinds=AMONG)))
    (effect,), (true,) = found["effects"], made.truth.effects
    assert effect["kind"] == true["kind"]
    assert set(effect["components"]) == set(true["components"])
    assert set(true["sensors"]) <= set(effect["sensors"])
    # A shift with a small slope is a form of the slope.
    assert {a["kind"] for a in effect["alternatives"] if a["tied"]} <= {"wrong-map"}
    assert true["kind"] == "wrong-map" or not [a for a in effect["alternatives"] if a["tied"]]
    if "map" in true["parameters"]:
        assert effect["variant"].partition(": ")[0] == true["parameters"]["map"]
    assert found["after"]["rms_um"] < 0.8 * found["before"]["rms_um"]
    # Where its name is only suspected the same follows on "If it is confirmed".
    steps = [step.lower() for step in found["what_next"]]
    assert any(word.lower() in step for word in words for step in steps)
    adopted = not kind_of(effect["kind"]).not_adopted
    # Twenty visits do not always prove that one which may be adopted helps.
    assert adopted or not effect["helps"]
    assert bool(effect["effect"]["terms"]) is adopted


def from_the_middle_on(made, mistake):
    """Begin a mistake with the middle visit: in the readings, or in how observations are stamped.

    Returns when the visits before and after it begin, and the campaign.
    """
    begins = [datetime.fromisoformat(v["observations"][0]["time"]) for v in made.verifications]
    middle = len(begins) // 2
    readings, verifications = copy.deepcopy((made.readings, made.verifications))
    if mistake == "exchanged-sensors":
        for one in readings:
            if datetime.fromisoformat(one["time"]) >= begins[middle]:
                t = one["temperatures_c"]
                t["x-middle"], t["z-column"] = t["z-column"], t["x-middle"]
    else:
        for observation in (o for v in verifications[middle:] for o in v["observations"]):
            stamped = datetime.fromisoformat(observation["time"]) + timedelta(hours=1)
            observation["time"] = stamped.isoformat()
    known = campaign_of_bodies(made.machine, made.error_maps, readings, verifications)
    return begins[middle - 1 : middle + 2], known


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mistake", "words"),
    [
        ("exchanged-sensors", "x-middle and z-column are swapped since about "),
        ("clock-offset", "differ by 60 min since about "),
    ],
)
def test_a_mistake_of_the_second_half_is_named_with_its_beginning(mistake, words):
    """Plugs after a service, a clock that does not follow summer time."""
    made = make_campaign(4, [], 2.0, visits=24, days=6, observations_per_visit=20)
    (before, _, after), campaign = from_the_middle_on(made, mistake)
    (effect,) = analyse(campaign, kinds=(*AMONG, "step", "drift")).effects
    assert effect.kind == mistake
    assert effect.status == "confirmed"
    assert words in effect.explanation
    assert not effect.helps
    changed_at = effect.effect.parameters["changed_at_unix_s"]
    assert before.timestamp() < changed_at <= after.timestamp() + 3600.0
