"""A repeatability that was copied wrongly: what the answer says, and what is still adopted."""

import json
from dataclasses import replace

import pytest

from app.api.schemas.campaigns import campaign_of_bodies
from app.identification.analysis.analyse import analyse
from app.simulation.undeclared import make_campaign

SAID = "is contradicted: nearly all lengths scatter by"


def answer(stated, planted, seed, kinds):
    """Analyse a campaign that scatters by 1 µm and repeats no place."""
    made = make_campaign(seed, planted, 2.0, visits=20)
    bodies = []
    for body in made.verifications:
        places = {}
        for one in body["observations"]:
            where = {k: v for k, v in one.items() if k not in ("time", "measured_um")}
            places.setdefault(json.dumps(where, sort_keys=True), one)
        bodies.append(body | {"observations": list(places.values())})
    campaign = campaign_of_bodies(made.machine, made.error_maps, made.readings, bodies)
    verifications = [replace(v, repeatability_um=stated) for v in campaign.verifications]
    return analyse(replace(campaign, verifications=verifications), kinds=kinds)


@pytest.mark.slow
@pytest.mark.parametrize("stated", [1 / 3, 1.0, 3.0])
def test_a_wrong_number_neither_keeps_an_effect_from_being_adopted_nor_hides_it(stated):
    """Stated three times too small, everything was unexplained, and nothing was adopted."""
    found = answer(stated, ["step:component"], 9001, ["step"])
    assert found.verdict == "effects-found"
    assert [(one.kind, str(one.status), one.helps) for one in found.effects] == [
        ("step", "confirmed", True)
    ]
    assert found.noise == pytest.approx(1.0, abs=0.05)
    is_wrong = stated != 1.0
    assert (SAID in found.summary) == is_wrong
    assert any("as repeatability_um" in step for step in found.what_next) == is_wrong
    origins = {one.noise_origin for one in found.components if one.unit == "µm"}
    assert origins == ({"common"} if is_wrong else {"declared"})
    if is_wrong:
        assert f"The stated repeatability of {stated:.2g} µm {SAID}" in found.summary


@pytest.mark.slow
@pytest.mark.parametrize("stated", [1 / 3, 1.0, 3.0])
def test_what_nobody_knows_is_not_explained_away_as_noise(stated):
    found = answer(stated, ["chirped-pitch"], 3203, ["periodic"])
    assert found.verdict == "unexplained"
