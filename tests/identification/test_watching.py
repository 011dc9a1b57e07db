"""A machine that drifts is noticed; one that does not is called changed as rarely as stated."""

import json
from dataclasses import replace

import numpy as np
import pytest

from app.errors import InvalidContent
from app.identification.e_process import EProcess, likelihood_ratio
from app.identification.search.rows import Datum
from app.identification.watching import WatchState, watch, watch_state_from_json
from benchmarks.closing_the_loop_bodies import campaign_of_bodies
from benchmarks.undeclared import make_campaign


def test_the_ratio_is_a_density_ratio():
    """Its expectation under the standard normal distribution is one."""
    z = np.linspace(-34, 34, 68001)
    density = np.exp(-0.5 * z**2) / np.sqrt(2 * np.pi)
    ratios = np.array([likelihood_ratio(v) for v in z])
    assert np.trapezoid(density * ratios, z) == pytest.approx(1.0, abs=1e-4)


def test_unchanged_numbers_alarm_as_rarely_as_stated():
    """400 sequences of 60 visits, ten numbers each, alarm limit 20: at most 5 %, expected less."""
    random = np.random.default_rng(1)
    alarms = 0
    for _ in range(400):
        processes = [EProcess() for _ in range(10)]
        for z in random.standard_normal((60, 10)):
            processes = [p.after(v) for p, v in zip(processes, z, strict=True)]
            if np.mean([p.evidence for p in processes]) >= 20.0:
                alarms += 1
                break
    assert alarms <= 400 * 0.05


@pytest.mark.parametrize("quiet", [0, 50])
def test_a_change_of_four_sigma_is_seen_in_few_visits_however_late_it_comes(quiet):
    random = np.random.default_rng(2)
    delays = []
    for _ in range(50):
        processes = [EProcess() for _ in range(10)]
        for _ in range(quiet):
            z = random.standard_normal(10)
            processes = [p.after(v) for p, v in zip(processes, z, strict=True)]
        delay = 0
        while np.mean([p.evidence for p in processes]) < 100.0:
            z = random.standard_normal(10)
            z[3] += 4.0
            processes = [p.after(v) for p, v in zip(processes, z, strict=True)]
            delay += 1
        delays.append(delay)
    assert np.median(delays) <= 3


def verifications_of(seed, planted=None, amplitude=4.0, **conditions):
    made = make_campaign(seed, planted, amplitude, **{"visits": 16, "days": 4, **conditions})
    return made, campaign_of_bodies(
        made.machine, made.error_maps, made.readings, made.verifications
    )


def watched(campaign):
    """Judge one verification after the other, the state stored in between."""
    state, judgements = WatchState(), []
    for verification in campaign.verifications:
        stored = json.loads(json.dumps(state.to_json(), allow_nan=False))
        alone = replace(campaign, verifications=[verification])
        judgement, state = watch(alone, watch_state_from_json(stored))
        judgements.append(judgement)
    return judgements


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_machine_as_its_model_says_stays_within(seed):
    _, campaign = verifications_of(seed)
    judgements = watched(campaign)
    assert {j.status for j in judgements} == {"within"}
    assert judgements[-1].limit == pytest.approx(100.0)
    assert "as its model says" in judgements[-1].summary


def test_a_step_is_noticed_with_its_component():
    made, campaign = verifications_of(4, "step:component")
    judgements = watched(campaign)
    (true,) = made.truth.effects
    assert judgements[0].status == "within"
    assert judgements[-1].status == "beyond"
    first = next(j for j in judgements if j.status == "beyond")
    named = {b.component for j in judgements for b in j.beyond}
    assert named & {*true["components"], "points x", "points y", "points z"}
    assert abs(first.beyond[0].deviation) > 2 * first.beyond[0].expected_sd
    json.dumps(first.to_json(), allow_nan=False)


def test_all_at_once_and_one_by_one_give_the_same():
    _, campaign = verifications_of(5)
    judgement, _ = watch(campaign, WatchState())
    assert judgement.visits == 16
    assert judgement.evidence == pytest.approx(watched(campaign)[-1].evidence, rel=0.2)


def test_an_unknown_zero_is_no_change():
    _, campaign = verifications_of(6, datum="free")
    assert campaign.verifications[0].datum is Datum.FREE
    assert watched(campaign)[-1].status == "within"


def test_a_damaged_state_is_refused():
    with pytest.raises(InvalidContent, match="stored state"):
        watch_state_from_json({"streams": {"EXX|level": {}}})
