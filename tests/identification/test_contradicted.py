"""A repeatability that was copied wrongly: what the answer says, and what is still adopted."""

import json
from dataclasses import replace

import numpy as np
import pytest

from app.identification.analysis.analyse import analyse
from app.identification.analysis.residual_report import residual_report
from app.identification.campaign import residuals_of
from app.identification.observed_scatter import observed_scatter
from app.identification.plan.planning import plan
from app.simulation.undeclared import make_campaign
from scripts.campaign_of_bodies import campaign_of_bodies

SAID = "is contradicted: nearly all lengths scatter by"


def campaign_stating(stated, planted=(), seed=9001):
    """A campaign that scatters by 1 µm and repeats no place."""
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
    return replace(campaign, verifications=verifications)


def report_of(campaign):
    residuals = residuals_of(campaign)
    return residual_report(residuals, observed_scatter(campaign, residuals))


@pytest.mark.slow
@pytest.mark.parametrize("stated", [1 / 3, 1.0, 3.0])
def test_a_wrong_number_neither_keeps_an_effect_from_being_adopted_nor_hides_it(stated):
    """Stated three times too small, everything was unexplained, and nothing was adopted."""
    campaign = campaign_stating(stated, ["step:component"])
    found = analyse(campaign, kinds=["step"])
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
    # The residuals of the same verifications say so in the same words.
    report = report_of(campaign)
    assert (report.contradiction in found.summary) if is_wrong else report.contradiction is None
    origins_there = {one.component: one.repeatability_origin for one in report.components}
    assert origins_there == {one.component: one.noise_origin for one in found.components}
    assert report.overall.repeatability == pytest.approx(found.noise, rel=0.06)


@pytest.mark.slow
@pytest.mark.parametrize("stated", [1 / 3, 1.0, 3.0])
def test_residuals_are_held_against_what_lengths_show(stated):
    """Nearly all of them exceeded a number three times too small, and none one too large."""
    report = report_of(campaign_stating(stated))
    assert report.overall.repeatability == pytest.approx(1.0, abs=0.06)
    assert report.overall.repeatability_origin == ("declared" if stated == 1.0 else "common")
    assert (report.contradiction is None) == (stated == 1.0)
    if report.contradiction:
        assert f"The stated repeatability of {stated:.2g} µm {SAID}" in report.contradiction


@pytest.mark.slow
@pytest.mark.parametrize("stated", [1 / 3, 3.0])
def test_what_nobody_knows_is_not_explained_away_as_noise(stated):
    campaign = campaign_stating(stated, ["chirped-pitch"], 3203)
    found = analyse(campaign, kinds=["periodic"])
    assert found.verdict == "unexplained"


def smallest_reversals(found):
    return {e.components: e.smallest_rms for e in found.effects if e.kind == "backlash"}


@pytest.mark.slow
def test_a_plan_beside_stored_verifications_rests_on_what_they_show():
    """From three times the scatter it followed that only effects three times as large are seen."""
    right, wrong = (
        plan(replace(one, verifications=one.verifications[:7]), 1)
        for one in map(campaign_stating, (1.0, 3.0))
    )
    assert [note for note in wrong.notes if SAID in note]
    assert not [note for note in right.notes if SAID in note]
    seen, also = smallest_reversals(right), smallest_reversals(wrong)
    assert seen.keys() == also.keys()
    assert np.median([also[one] / seen[one] for one in seen]) == pytest.approx(1.0, abs=0.1)


@pytest.mark.slow
def test_a_plan_with_nothing_measured_says_that_it_takes_the_stated_number():
    campaign = campaign_stating(3.0)
    first = replace(campaign.verifications[0], is_planned=True)
    found = plan(replace(campaign, verifications=[first]), 1)
    assert any(note.startswith("the stated repeatability was taken as it") for note in found.notes)
