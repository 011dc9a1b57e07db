"""The oracle finds what was planted, and no more of it than there is."""

import numpy as np
import pytest

from app.simulation.undeclared.mapped_model import entry_weights, predict

NAMES = ["thermal-lag:sensor", "backlash", "state-variable:payload", "drift", "setup-warp"]


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_the_oracle_finds_all_of_an_effect(campaign_of, rms, name):
    campaign = campaign_of(2, name, 2.0)
    fit = campaign.oracle(campaign.every_fourth_visit())
    assert fit.amplitudes == pytest.approx([1.0], abs=4.0 * fit.standard_errors[0])
    assert fit.holdout_rms_um < fit.holdout_rms_without_um
    assert fit.holdout_rms_um == pytest.approx(fit.floor_um, rel=0.12)


def test_on_exact_data_the_oracle_is_exact(exact_of):
    campaign = exact_of(2, ["periodic", "step"], 2.0)
    fit = campaign.oracle([3, 7, 11], refit_maps=False)
    assert fit.amplitudes == pytest.approx([1.0, 1.0], abs=1e-4)
    assert fit.holdout_rms_um == pytest.approx(0.0, abs=1e-4)
    assert fit.floor_um == 0.0


def test_plain_least_squares_is_what_it_says(campaign_of):
    campaign = campaign_of(2, "backlash", 2.0)
    truth = campaign.truth
    fit = campaign.oracle([1, 5, 9], refit_maps=False)
    train = ~np.isin(truth.visit, [1, 5, 9])
    column, residual = truth.contribution_um[train], truth.residual_um[train]
    assert fit.amplitudes == pytest.approx([column @ residual / (column @ column)])


@pytest.mark.slow
@pytest.mark.parametrize("one_verification", [False, True])
@pytest.mark.parametrize("datum", ["first", "free"])
def test_the_oracle_bears_with_an_unknown_zero(campaign_of, datum, one_verification):
    campaign = campaign_of(2, "backlash", 2.0, datum=datum, one_verification=one_verification)
    fit = campaign.oracle(campaign.every_fourth_visit())
    assert fit.amplitudes == pytest.approx([1.0], abs=4.0 * fit.standard_errors[0])
    assert fit.holdout_rms_um == pytest.approx(fit.floor_um, rel=0.12)


@pytest.mark.slow
def test_the_oracle_leaves_outliers_out(campaign_of):
    campaign = campaign_of(2, "backlash", 2.0, outliers=0.03, frozen=1)
    fit = campaign.oracle(campaign.every_fourth_visit())
    assert fit.amplitudes == pytest.approx([1.0], abs=0.15)
    assert fit.holdout_rms_um < 1.3


def test_weights_of_the_maps_entries_make_up_the_prediction(campaign_of):
    campaign = campaign_of()
    asked = campaign.truth.observations
    weights = entry_weights(campaign.maps, campaign.record, asked)
    entries = np.concatenate([t.errors.ravel() for t in campaign.maps.tables.values()])
    predicted = predict(campaign.maps, campaign.record, asked, campaign.history)
    np.testing.assert_allclose(weights @ entries, predicted, atol=1e-9)


def test_a_second_time_constant_is_nearly_a_lag(campaign_of):
    """What is in no family may resemble one: that is what makes it a proxy."""
    (effect,) = campaign_of(2, "second-time-constant:component").truth.effects
    assert effect["parameters"]["time_constants_min"] == [60.0, 25.0]
    assert not effect["in_library"]
