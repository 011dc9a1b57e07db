"""What a campaign is made of: bodies, scatter, datum, determinism."""

import itertools
import json
import subprocess
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from app.simulation import undeclared
from app.simulation.undeclared import make_campaign
from app.simulation.undeclared.components import CODES
from app.simulation.undeclared.files import campaign_files
from app.simulation.undeclared.scatter import block_of_values


def everything(campaign):
    return json.dumps(
        [
            campaign.machine,
            campaign.error_maps,
            campaign.readings,
            campaign.verifications,
            campaign.truth.effects,
            campaign.truth.true_um.tolist(),
            campaign.truth.contributions_um.tolist(),
        ],
        allow_nan=False,
    )


@pytest.mark.slow
def test_nothing_of_the_service_is_imported():
    script = (
        "import sys, app.simulation.undeclared.files\n"
        "print({m.rpartition('.undeclared')[0] or m for m in sys.modules if m.startswith('app.')})"
    )
    root = Path(undeclared.__file__).parents[2]
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=root, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "{'app.simulation'}"


def test_the_same_seed_makes_the_same_campaign():
    planted = ["thermal-lag", "sensor-fault:spikes"]
    one, again, other = (
        everything(make_campaign(seed, planted, visits=8, days=2, outliers=0.02, frozen=1))
        for seed in (7, 7, 8)
    )
    assert one == again
    assert one != other


def test_without_measurement_errors_maps_and_readings_reproduce_the_truth(exact_of):
    truth = exact_of().truth
    np.testing.assert_allclose(truth.predicted_um, truth.true_um, atol=1e-9)
    np.testing.assert_allclose(truth.measured_um, truth.true_um, atol=1e-4)


def test_components_take_turns(campaign_of):
    truth = campaign_of(visits=63, days=12).truth
    lines = truth.observations[~truth.observations.is_point]
    pairs = {(int(v), int(c)) for v, c in zip(lines.visit, lines.component, strict=True)}
    visits_of = Counter(CODES[c] for _, c in pairs)
    # 63 visits × 4 lines over 21 components.
    assert set(visits_of.values()) == {12}
    assert set(visits_of) == set(CODES)


def test_visits_do_not_overlap_and_have_their_history(campaign_of):
    campaign = campaign_of()
    asked = campaign.truth.observations
    assert (np.diff(asked.time_min) > 0.0).all()
    # Five time constants of up to 180 min.
    assert asked.time_min[0] >= 15 * 60
    assert campaign.readings[0]["time"] == "2026-02-02T00:00:00Z"
    assert campaign.readings[1]["time"] == "2026-02-02T00:01:00Z"
    assert campaign.record.minutes[-1] >= asked.time_min[-1]


def test_each_line_has_both_directions_offsets_and_a_replicate(campaign_of):
    truth = campaign_of().truth
    asked = truth.observations
    for code in ("EXX", "ECY", "EZZ"):
        axis = "XYZ".index(code[2])
        for visit in np.unique(asked.visit[asked.of(code)]):
            here = asked[asked.of(code) & (asked.visit == visit)]
            for sign in (1, -1):
                along = here.point_mm[here.direction[:, axis] == sign, axis]
                assert len(along) == 4
                assert len(np.unique(along)) == 3
            others = np.delete(here.point_mm, axis, axis=1)
            assert not others.any()


@pytest.mark.parametrize(("visits", "observations"), [(4, 216), (12, 40), (5, 12)])
def test_sizes(visits, observations):
    campaign = make_campaign(2, visits=visits, observations_per_visit=observations)
    sizes = [len(v["observations"]) for v in campaign.verifications]
    assert sizes == [observations] * visits


def test_a_campaign_that_does_not_fit_its_days_is_refused():
    with pytest.raises(ValueError, match="expected days for 100 visits of 72 min"):
        make_campaign(1, visits=100, observations_per_visit=216, days=5)


def test_unknown_names_are_refused():
    with pytest.raises(ValueError, match=r"expected an effect of thermal-lag, .* got 'magnetism'"):
        make_campaign(1, "magnetism")
    with pytest.raises(ValueError, match=r"expected drift:component, got 'sideways'"):
        make_campaign(1, "drift:sideways")
    with pytest.raises(ValueError, match="expected a datum"):
        make_campaign(1, datum="relative")


def test_verifications_say_what_the_truth_says(campaign_of):
    campaign = campaign_of()
    observations = [o for v in campaign.verifications for o in v["observations"]]
    measured = [o["measured_um"] for o in observations]
    assert measured == campaign.truth.by_observation(campaign.truth.measured_um)
    for said, code, point in zip(
        observations,
        campaign.truth.observations.component,
        campaign.truth.observations.point_mm.tolist(),
        strict=True,
    ):
        assert set(said["state"]) == {"spindle_rpm", "feed_mm_per_min", "payload_kg", "coolant"}
        if code < 0:
            assert said["point_mm"] == point
            assert set(said) == {
                *("time", "point_mm", "tool_offset_mm", "direction", "measured_um", "state")
            }
        elif CODES[code].startswith("S"):
            assert set(said) == {"time", "component", "measured_um", "state"}
        else:
            assert said["position_mm"] == point["XYZ".index(CODES[code][2])]
            assert said["direction"] in {"+", "-"}


def test_the_state_of_an_observation_is_that_of_the_reading_before_it(campaign_of):
    campaign = campaign_of()
    states = {r["time"]: r["state"] for r in campaign.readings}
    for verification in campaign.verifications:
        for said in verification["observations"]:
            assert said["state"] == states[said["time"][:17] + "00Z"]


def test_repeatability_and_setup_are_as_stated(campaign_of, rms):
    truth = campaign_of(visits=60, days=12).truth
    assert rms(truth.scatter.noise) == pytest.approx(1.0, rel=0.05)
    block = block_of_values(truth.observations)
    within = np.concatenate(
        [
            truth.scatter.noise[block == b] - truth.scatter.noise[block == b].mean()
            for b in set(block)
        ]
    )
    assert rms(within) < rms(truth.scatter.noise)
    lines = truth.observations.coordinate < 0
    # Shift 0.3, and a tilt of 0.15 at the ends: over the travel 0.15/√3.
    assert rms(truth.scatter.setup[lines]) == pytest.approx(np.hypot(0.3, 0.087), rel=0.1)
    assert rms(truth.scatter.setup[~lines]) == pytest.approx(np.hypot(0.3, 0.15 * 0.9), rel=0.15)


def test_measured_is_true_plus_scatter(campaign_of):
    truth = campaign_of(outliers=0.05, ar1_um=0.5, datum="free").truth
    total = truth.true_um + truth.scatter.total()
    np.testing.assert_allclose(truth.measured_um, total, atol=6e-5)
    share = truth.scatter.is_blunder.mean()
    assert 0.03 < share < 0.07
    assert (np.abs(truth.scatter.blunder[truth.scatter.is_blunder]) >= 6.0).all()
    assert not truth.scatter.blunder[~truth.scatter.is_blunder].any()


def test_autoregressive_scatter_lingers(campaign_of):
    plain, lingering = campaign_of(), campaign_of(ar1_um=1.0, ar1_correlation=0.6)
    added = lingering.truth.scatter.noise - plain.truth.scatter.noise
    block = block_of_values(plain.truth.observations)
    pairs = [pair for k in set(block) for pair in itertools.pairwise(added[block == k])]
    assert np.std(added) == pytest.approx(1.0, rel=0.1)
    assert np.corrcoef(np.array(pairs).T)[0, 1] == pytest.approx(0.6, abs=0.08)


@pytest.mark.parametrize("one_verification", [False, True])
def test_the_first_observation_of_each_component_is_zero(campaign_of, one_verification):
    campaign = campaign_of(datum="first", one_verification=one_verification)
    assert len(campaign.verifications) == (1 if one_verification else 20)
    for verification in campaign.verifications:
        assert verification["datum"] == "first"
        seen = set()
        for said in verification["observations"]:
            what = said.get("component", "point")
            if what not in seen:
                seen.add(what)
                assert not np.any(said["measured_um"])
        assert len(seen) >= 4


def test_a_free_datum_is_one_constant_for_each_component_and_verification(campaign_of):
    truth = campaign_of(datum="free").truth
    block = block_of_values(truth.observations)
    for number in np.unique(block):
        assert np.ptp(truth.scatter.datum[block == number]) == 0.0
    assert np.std(truth.scatter.datum) > 3.0
    absolute = campaign_of().truth
    np.testing.assert_allclose(
        truth.measured_um - truth.scatter.datum, absolute.measured_um, atol=2e-4
    )


def test_maps_state_their_standard_errors_if_asked(campaign_of):
    (first, *_) = campaign_of(state_standard_errors=True).error_maps
    by_code = {c["component"]: c for c in first["components"]}
    assert by_code["EXX"]["standard_errors_um"] == [0.45] * 11
    assert by_code["EBX"]["standard_errors_urad"] == [0.45] * 11
    assert by_code["SXY"]["standard_error_um_per_m"] == 0.45


def test_readings_come_in_bodies_that_the_service_takes():
    campaign = make_campaign(11, "thermal-lag")
    assert len(campaign.readings) > 10_080
    assert all(len(body) <= 10_000 for body in campaign.reading_bodies)
    assert sum(len(body) for body in campaign.reading_bodies) == len(campaign.readings)


def test_files_are_the_bodies():
    campaign = make_campaign(3, "thermal-lag", 2.0, 8, days=2)
    files = campaign_files(campaign)
    assert list(files)[:2] == ["machine.json", "error-map-001.json"]
    assert list(files)[-2:] == ["verification-008.json", "truth.json"]
    assert files["machine.json"] == campaign.machine
    assert [files[f"error-map-00{i}.json"] for i in (1, 2, 3)] == campaign.error_maps
    assert files["readings-001.json"] == campaign.readings
    assert files["verification-008.json"] == campaign.verifications[7]
    truth = json.loads(json.dumps(files["truth.json"], allow_nan=False))
    assert truth["effects"] == list(campaign.truth.effects)
    assert len(truth["true_um"]) == len(campaign.truth.observations)
    assert truth["oracle"]["amplitudes"] == pytest.approx([1.0], abs=0.5)
