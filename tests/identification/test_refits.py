"""Effects that a model has already, fitted anew beside what an analysis finds."""

from dataclasses import replace

import numpy as np
import pytest

from app.effects.claim import claim_of
from app.effects.effect import Provenance, effect_from_json
from app.identification.analysis.analyse import analyse
from app.identification.analysis.found_effect import RefittedEffect
from app.identification.analysis.refits import adopted_before, effects_after
from app.identification.campaign import residuals_of
from app.simulation.undeclared import make_campaign
from scripts.campaign_of_bodies import campaign_of_bodies
from tests.effect_examples import BACKLASH, LAG, SPEED

EVERY = (1, 2, 3)
FOUND = Provenance(1, (), EVERY)


def campaign_with(planted, amplitude, seed, **conditions):
    made = make_campaign(seed, planted, amplitude, **conditions)
    campaign = campaign_of_bodies(made.machine, made.error_maps, made.readings, made.verifications)
    numbers = tuple(range(1, 1 + len(campaign.verifications)))
    return made, replace(campaign, verification_ids=numbers)


def adopting(campaign, answer, number):
    """What the service stores when that is adopted which helps."""
    origin = Provenance(number, (), tuple(campaign.verification_ids))
    new = [replace(e.effect, provenance=origin) for e in answer.effects if e.helps]
    return replace(campaign, effects=effects_after(campaign.effects, answer.refitted, new))


def off_truth(campaign, made):
    """Error of the prediction against the noise-free truth [root mean square]."""
    residuals = residuals_of(campaign)
    return float(np.sqrt(np.mean((residuals.predicted - made.truth.true_um[residuals.kept]) ** 2)))


def said(effect, outcome, becomes=None):
    return RefittedEffect(effect, becomes, outcome, outcome == "dropped", "")


def test_refitted_effects_keep_their_places_and_dropped_ones_go():
    stronger = replace(BACKLASH, parameters={"reversal_um": 5.0})
    known = [BACKLASH, LAG]
    assert effects_after(known, [said(BACKLASH, "refitted", stronger)], [SPEED]) == [
        *(stronger, LAG, SPEED)
    ]
    assert effects_after(known, [said(LAG, "dropped")], []) == [BACKLASH]
    assert effects_after(known, [said(LAG, "left")], []) == known
    assert effects_after([SPEED], [said(LAG, "dropped")], []) == [SPEED]


def test_provenance_is_stored_and_two_effects_that_differ_in_it_alone_are_equal():
    one = replace(LAG, provenance=FOUND.refitted(4, (1, 2)))
    again = effect_from_json(one.to_json())
    assert again == LAG
    assert again.provenance == Provenance(1, (4,), (1, 2))
    older = {name: value for name, value in one.to_json().items() if name != "provenance"}
    assert effect_from_json(older).provenance is None


@pytest.mark.parametrize(
    ("provenance", "tested", "words"),
    [
        (None, True, "not known in which measurements"),
        (Provenance(1, (), (1, 9)), True, "not among these: verification 9"),
        (FOUND, False, "cannot test it"),
        (FOUND, True, None),
    ],
)
def test_what_cannot_be_weighed_stays_as_it_is(provenance, tested, words):
    _, campaign = campaign_with("backlash", 2.0, 1, visits=8, days=2)
    residuals = residuals_of(campaign)
    hypothesis = _Reversal(residuals)
    effect = replace(hypothesis.effect, provenance=provenance)
    before = adopted_before(
        replace(campaign, effects=[effect], verification_ids=EVERY),
        residuals.projection,
        {claim_of(effect).key: hypothesis.it} if tested else {},
    )
    if words is None:
        assert not before.left
        assert [one.effect for one in before.anew] == [effect]
        assert np.abs(before.explained).max() == pytest.approx(2.0)
    else:
        ((left, why),) = before.left
        assert left == effect
        assert words in why
        assert not before.anew
        assert not before.explained.any()


class _Reversal:
    """A reversal of 4 µm in one component of the rows, and the hypothesis that it is made of."""

    def __init__(self, residuals):
        from app.effects.campaign_view import CampaignView
        from app.effects.hypothesis import Estimate
        from app.effects.kinds.backlash import Backlash

        projection = residuals.projection
        view = CampaignView(projection.model, (), residuals.rows, projection.conditions)
        proposed = Backlash().candidates(view).hypotheses
        self.it = next(h for h in proposed if h.variant == "constant")
        size = len(self.it.amplitudes)
        self.effect = self.it.fitted(
            Estimate(None, None, np.full(size, 2.0), np.full((size, size), 0.01))
        )


@pytest.mark.slow
def test_what_was_learnt_first_is_never_made_worse_by_what_is_found_later():
    """A speed alone takes up part of a lag; where held-out set-ups agree, it gives it back."""
    planted = ["thermal-lag:sensor", "state-variable:speed"]
    made, campaign = campaign_with(planted, [1.5, 4.0], 24, visits=16, days=3)
    first = analyse(campaign, kinds=["state-variable"])
    assert first.effects
    campaign = adopting(campaign, first, 1)
    second = analyse(campaign, kinds=["state-variable", "thermal-lag"])
    assert any(one.kind == "thermal-lag" and one.helps for one in second.effects)
    assert {one.outcome for one in second.refitted} <= {"refitted", "dropped", "left"}
    assert len(second.refitted) == len(campaign.effects)
    kept = replace(
        campaign,
        effects=[*campaign.effects, *(one.effect for one in second.effects if one.helps)],
    )
    adopted = adopting(campaign, second, 2)
    assert off_truth(adopted, made) <= off_truth(kept, made) * 1.001
    # What is said of the adopted set is what the live path says of it.
    left = residuals_of(adopted).values
    assert second.after.rms == pytest.approx(np.sqrt(np.mean(left**2)), rel=0.05)
