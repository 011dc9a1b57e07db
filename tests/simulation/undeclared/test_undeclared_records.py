"""Continuous records, and noise whose statistics are what is stated."""

import json

import numpy as np
import pytest
from scipy import stats

from app.simulation.undeclared import make_campaign, make_record
from app.simulation.undeclared.conditions import NO_SCATTER
from app.simulation.undeclared.duty_cycle import DAY_MIN
from app.simulation.undeclared.files import campaign_files
from app.simulation.undeclared.scatter import GROUPS, group_of_values, setup_shape, wander_paths

QUIET = {**NO_SCATTER, "map_error_um": 0.45}
"""Nothing but what a test asks for."""


def test_a_record_measures_the_same_places_in_every_block_with_one_set_up():
    record = make_record(3, hours=5, every_min=20, observations=24)
    asked = record.truth.observations
    assert len(np.unique(asked.visit)) == 15
    first = asked[asked.visit == 0]
    for number in range(15):
        block = asked[asked.visit == number]
        np.testing.assert_array_equal(block.point_mm, first.point_mm)
        np.testing.assert_array_equal(block.component, first.component)
        np.testing.assert_allclose(block.time_min - first.time_min, 20.0 * number)
    # One set-up: the same place has the same shift and tilt in all blocks.
    setup = record.truth.scatter.setup.reshape(15, -1)
    np.testing.assert_array_equal(setup, np.broadcast_to(setup[0], setup.shape))
    assert setup.std() > 0.1


def test_a_record_may_measure_other_places_in_every_block():
    record = make_record(3, hours=5, new_places=True)
    asked = record.truth.observations
    codes = set(asked.component[~asked.is_point].tolist())
    of_one = asked[asked.visit == 0]
    assert len(codes) > 3 * len(np.unique(of_one.component[~of_one.is_point]))
    places = asked.point_mm[asked.is_point]
    assert len(np.unique(places, axis=0)) > 5 * len(np.unique(of_one.point_mm, axis=0)) / 2
    assert len(record.verifications) == 1


def test_a_record_runs_spindle_steps_on_a_machine_that_was_off():
    record = make_record(3, hours=30, every_min=5, observations=2)
    begins, ends = record.truth.observations.time_min[[0, -1]]
    assert begins == DAY_MIN + 7 * 60
    assert ends - begins == pytest.approx(30 * 60, abs=6)
    minutes = record.history.minutes
    speed = record.history.state["spindle_rpm"]
    before = (minutes >= DAY_MIN) & (minutes < begins)
    during = (minutes >= begins) & (minutes < begins + 30 * 60)
    assert not speed[before].any()
    assert set(speed[during]) <= {0.0, 3000.0, 6000.0, 9000.0, 12000.0}
    # Ten steps, each other than the one before.
    assert np.count_nonzero(np.diff(speed[during])) == 9
    assert len(record.readings) >= 30 * 60
    assert np.ptp(record.record.temperatures_c["spindle"]) > 8.0


def test_one_verification_and_many_hold_the_same_values():
    record = make_record(3, "backlash", hours=4, datum="first")
    one, many = record.as_one_verification(), record.as_many_verifications()
    assert record.verifications == [one]
    assert len(many) == 12
    assert [o for v in many for o in v["observations"]] == one["observations"]
    # Zeroed once: of a part alone nobody knows the zero.
    assert one["datum"] == "first"
    assert {v["datum"] for v in many} == {"free"}
    hourly = record.as_many_verifications(every_min=60.0)
    assert len(hourly) == 4
    assert [o for v in hourly for o in v["observations"]] == one["observations"]
    assert len({v["label"] for v in hourly}) == 4


def test_visits_with_zeros_of_their_own_are_not_one_verification():
    campaign = make_campaign(1, visits=8, days=2, datum="first")
    assert campaign.as_many_verifications() == campaign.verifications
    with pytest.raises(ValueError, match="expected values with one zero"):
        campaign.as_one_verification()
    absolute = make_campaign(1, visits=8, days=2)
    whole = absolute.as_one_verification()["observations"]
    assert whole == [o for v in absolute.verifications for o in v["observations"]]


@pytest.mark.slow
def test_wander_has_the_stated_deviation_and_correlation_time():
    """At irregular times; 96 paths of 200 correlation times."""
    times = np.cumsum(np.random.default_rng(1).choice([2.0, 10.0, 33.0], 800))
    paths = wander_paths(np.random.default_rng(2), times, 60.0).reshape(times.size, -1)
    assert paths.std() == pytest.approx(1.0, rel=0.03)
    for lag in (1, 3, 6):
        apart = times[lag:] - times[:-lag]
        expected = np.exp(-apart / 60.0)
        found = (paths[lag:] * paths[:-lag]).mean(axis=1)
        assert found.mean() == pytest.approx(expected.mean(), abs=0.03)
        # As the time between: it is the correlation that changes, not only its mean.
        assert np.corrcoef(found, expected)[0, 1] > 0.5
    between = np.corrcoef(paths.T)[~np.eye(paths.shape[1], dtype=bool)]
    assert between.std() == pytest.approx(np.sqrt(60.0 / np.ptp(times)), rel=0.3)


def test_all_places_of_a_record_wander_together():
    record = make_record(2, hours=50, every_min=10, observations=5, wander_um=2.0, **QUIET)
    wander = record.truth.scatter.instrument.reshape(300, 5, 3)
    assert wander.std() == pytest.approx(2.0, rel=0.3)
    # Within a block some twenty seconds apart: far below the hour in which it changes.
    assert (wander - wander[:, :1]).std() < 0.35
    assert abs(np.corrcoef(wander[:, 0, 0], wander[:, 0, 1])[0, 1]) < 0.6


@pytest.mark.slow
def test_tilt_wander_is_nothing_in_the_middle_and_as_stated_at_the_ends():
    record = make_record(2, hours=200, every_min=10, wander_tilt_um=1.5, wander_min=20.0, **QUIET)
    shape = setup_shape(record.truth.observations)
    lines = record.truth.observations.coordinate < 0
    along = shape[lines].sum(axis=1)
    added = record.truth.scatter.instrument[lines]
    away = np.abs(along) > 0.1
    assert (added[away] / along[away]).std() == pytest.approx(1.5, rel=0.1)


@pytest.mark.slow
def test_heavy_tails_have_the_stated_deviation_and_the_shape_of_t3():
    campaign = make_campaign(1, visits=200, heavy_tails=True, repeatability_um=0.7)
    noise = campaign.truth.scatter.noise
    scaled = noise / (0.7 / np.sqrt(3.0))
    assert stats.kstest(scaled, stats.t(3).cdf).pvalue > 0.01
    assert stats.kstest(noise / 0.7, stats.norm.cdf).pvalue < 1e-6
    plain = make_campaign(1, visits=200, repeatability_um=0.7)
    assert stats.kstest(plain.truth.scatter.noise / 0.7, stats.norm.cdf).pvalue > 0.01
    np.testing.assert_array_equal(campaign.truth.scatter.setup, plain.truth.scatter.setup)


def test_a_coarse_instrument_reads_multiples_of_its_step():
    record = make_record(4, hours=5, measured_quantum_um=0.5)
    measured = record.truth.measured_um
    np.testing.assert_allclose(measured / 0.5, np.round(measured / 0.5), atol=1e-9)
    off = measured - record.truth.true_um - record.truth.scatter.total()
    assert np.abs(off).max() <= 0.25 + 1e-9
    assert off.std() == pytest.approx(0.5 / np.sqrt(12.0), rel=0.1)


@pytest.mark.slow
def test_a_drifting_instrument_goes_on_at_one_rate_from_the_beginning_of_the_set_up():
    rates = []
    for seed in range(8):
        record = make_record(seed, hours=5, instrument_drift_um_per_h=0.8, **QUIET)
        truth = record.truth
        hours = (truth.observations.time_min - truth.observations.time_min[0]) / 60.0
        hours = hours[truth.observations.of_value]
        group = group_of_values(truth.observations)
        for number in np.unique(group):
            here = (group == number) & (hours > 0)
            rate = truth.scatter.instrument[here] / hours[here]
            np.testing.assert_allclose(rate, rate[0], rtol=1e-9)
            rates.append(rate[0])
    assert len(rates) > 30
    # The standard deviation of so few is known to some 20 %.
    assert np.sqrt(np.mean(np.square(rates))) == pytest.approx(0.8, rel=0.4)


def test_an_instrument_warms_up_alike_in_every_visit():
    campaign = make_campaign(3, visits=30, warm_up_um=2.0, warm_up_min=5.0, **QUIET)
    truth = campaign.truth
    time = truth.observations.time_min
    begun = np.array([time[truth.observations.visit == v].min() for v in range(30)])
    since = (time - begun[truth.observations.visit])[truth.observations.of_value]
    ends = truth.scatter.instrument[since > 0] / (1 - np.exp(-since[since > 0] / 5.0))
    group = group_of_values(truth.observations)[since > 0]
    found = [ends[group == number] for number in range(len(GROUPS))]
    for same in found:
        np.testing.assert_allclose(same, same[0], rtol=1e-6)
    assert np.std([same[0] for same in found]) == pytest.approx(2.0, rel=0.45)
    assert not truth.scatter.instrument[since == 0].any()


def test_lengths_that_nothing_corrects_grow_from_zero_on_all_axes_and_nothing_else_does():
    campaign = make_campaign(
        3, visits=12, length_um_per_m_per_k=-0.93, length_assumed_c=21.0, **QUIET
    )
    truth = campaign.truth
    own = truth.observations.of_value
    above_k = campaign.history.temperature("ambient", truth.observations.time_min)[own] - 21.0
    for group in np.unique(truth.group):
        here = truth.group == group
        is_length = str(group).lower() in ("x", "y", "z", "exx", "eyy", "ezz")
        along = truth.observations.point_mm[own, "xyz".index(str(group)[-1].lower())] / 1000.0
        expected = -0.93 * (above_k * along)[here] * is_length
        np.testing.assert_allclose(truth.scatter.instrument[here], expected, atol=1e-12)


@pytest.mark.slow
def test_set_ups_are_correlated_from_visit_to_visit():
    campaign = make_campaign(
        3, visits=400, observations_per_visit=12, setup_shift_um=1.0, setup_correlation=0.7,
        **{name: 0.0 for name in NO_SCATTER if name != "setup_shift_um"},
    )  # fmt: skip
    truth = campaign.truth
    shifts = np.full((400, len(GROUPS)), np.nan)
    shifts[truth.visit, group_of_values(truth.observations)] = truth.scatter.setup
    points = shifts[:, -3:]
    assert np.isfinite(points).all()
    assert points.std() == pytest.approx(1.0, rel=0.12)
    after = np.mean(points[1:] * points[:-1]) / np.mean(points**2)
    assert after == pytest.approx(0.7, abs=0.08)


def test_without_the_new_kinds_of_noise_a_campaign_is_what_it_was():
    plain = make_campaign(5, "backlash", visits=8, days=2)
    noisy = make_campaign(5, "backlash", visits=8, days=2, wander_um=1.0, warm_up_um=1.0)
    assert not plain.truth.scatter.instrument.any()
    np.testing.assert_array_equal(plain.truth.scatter.noise, noisy.truth.scatter.noise)
    np.testing.assert_array_equal(plain.truth.scatter.setup, noisy.truth.scatter.setup)
    np.testing.assert_array_equal(plain.truth.true_um, noisy.truth.true_um)


@pytest.mark.parametrize("planted", ["thermal-lag", "backlash", "step", "setup-warp"])
def test_later_errors_are_free_of_measurement(planted):
    record = make_record(5, planted, hours=5, later_visits=6, wander_um=3.0)
    later = record.later
    assert later.observations.time_min[0] > record.truth.observations.time_min[-1]
    assert len(later.asked) == len(later.observations)
    assert all("measured_um" not in asked for asked in later.asked)
    assert record.record.minutes[-1] >= later.observations.time_min[-1]
    quiet = make_record(5, planted, hours=5, later_visits=6, **NO_SCATTER).later
    # Exact maps and readings say all but the effect.
    np.testing.assert_allclose(quiet.true_um - quiet.contribution_um, quiet.predicted_um, atol=1e-9)
    assert quiet.error_um(quiet.contribution_um) < 1e-9
    assert quiet.error_um() == pytest.approx(quiet.left_um())
    # The right correction leaves the errors of the maps; a wrong one harms.
    assert later.left_um(later.contribution_um) == 0.0
    assert later.error_um(later.contribution_um) < 0.7
    assert later.left_um(-later.contribution_um) == pytest.approx(2.0 * later.left_um())


def test_visits_too_have_a_later_truth_that_is_not_handed_out():
    campaign = make_campaign(5, "backlash", visits=8, days=4, later_visits=4)
    assert len(campaign.verifications) == 8
    assert set(campaign.later.observations.visit) == {8, 9, 10, 11}
    assert campaign.later.left_um() > 0.3
    assert make_campaign(5, "backlash", visits=8, days=4).later.left_um() == 0.0


@pytest.mark.parametrize("conditions", [{}, {"wander_um": 1.0, "wander_min": 30.0}])
def test_the_oracle_knows_that_a_record_is_one_set_up(conditions):
    """Blocks that were set-ups of their own would tell a constant fifteen times as well."""
    record = make_record(5, "backlash:constant", hours=5, setup_shift_um=3.0, **conditions)
    fit = record.oracle([])
    assert fit.amplitudes == pytest.approx([1.0], abs=4.0 * fit.standard_errors[0])
    far = make_record(5, "outdated-map:slope", hours=5, setup_tilt_um=5.0, **conditions)
    near = make_record(5, "outdated-map:slope", hours=5, setup_tilt_um=0.0, **conditions)
    assert far.oracle([]).standard_errors[0] > 3.0 * near.oracle([]).standard_errors[0]


def test_a_record_is_no_row_of_visits_for_an_oracle():
    record = make_record(5, "backlash", hours=5, later_visits=4)
    with pytest.raises(ValueError, match="of a continuous record, which is one set-up"):
        record.oracle([1])
    files = campaign_files(record)
    truth = json.loads(json.dumps(files["truth.json"], allow_nan=False))
    assert truth["oracle"] is None
    assert truth["later"]["error_um"] == record.later.error_um()
    assert list(files)[-2:] == ["verification-001.json", "truth.json"]


@pytest.mark.parametrize(
    ("asked", "sentence"),
    [
        ({"every_min": 5, "observations": 24}, "expected at least 4 blocks that end before"),
        ({"hours": 1}, "expected at least 4 blocks"),
        ({"wander_min": 0.0}, "above 0 min"),
        ({"setup_correlation": 1.0}, "expected a correlation"),
    ],
)
def test_what_cannot_be_is_refused(asked, sentence):
    with pytest.raises(ValueError, match=sentence):
        make_record(1, **asked)
