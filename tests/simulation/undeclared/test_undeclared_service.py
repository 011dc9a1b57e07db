"""The real service takes the bodies, and its own rule agrees with the simulated truth."""

from datetime import datetime

import numpy as np
import pytest

from app.simulation.undeclared.conditions import NO_SCATTER
from app.simulation.undeclared.mapped_model import entry_weights
from tests.service_examples import Clock, client_of, running

pytestmark = pytest.mark.anyio

LATER = datetime.fromisoformat("2027-01-01T00:00:00+00:00")


async def send(client, campaign):
    """Store machine, maps and readings; return the machine's path."""
    answer = await client.post("/v1/machines", json=campaign.machine)
    assert answer.status_code == 201, answer.text
    room = f"/v1/machines/{campaign.machine['id']}"
    for body in campaign.error_maps:
        answer = await client.post(f"{room}/error-maps", json=body)
        assert answer.status_code == 201, answer.text
    for body in campaign.reading_bodies:
        answer = await client.post(f"{room}/readings", json=body)
        assert answer.status_code == 201, answer.text
        assert answer.json() == {"stored": len(body), "duplicates": 0}
    return room


async def predicted_by_service(url, campaign):
    """Predictions at all observations, as one array of values, and their status."""
    observations = [o for v in campaign.verifications for o in v["observations"]]
    asked = [{k: v for k, v in o.items() if k != "measured_um"} for o in observations]
    with running(url, Clock(LATER)) as service:
        async with client_of(service) as client:
            room = await send(client, campaign)
            body = {"observations": asked, "missing_components": "zero"}
            answer = await client.post(f"{room}/predictions", json=body)
    assert answer.status_code == 200, answer.text
    document = answer.json()
    values = np.concatenate([np.atleast_1d(v) for v in document["predicted_um"]])
    return values, document["status"]


@pytest.fixture
def url(databases):
    made = databases.migrated("sqlite")
    yield made
    databases.give_back(made)


@pytest.mark.slow
async def test_without_scatter_the_service_reproduces_the_truth(url, campaign_of):
    campaign = campaign_of(9, **NO_SCATTER, days=2, visits=8)
    predicted, status = await predicted_by_service(url, campaign)
    assert set(status) == {"interpolated"}
    # The maps are handed out to six decimals, the answer rounded to 0.1 nm.
    np.testing.assert_allclose(predicted, campaign.truth.true_um, atol=1e-4)


@pytest.mark.slow
async def test_the_residual_without_effect_is_what_scatter_and_maps_predict(url, campaign_of, rms):
    campaign = campaign_of(9)
    truth = campaign.truth
    predicted, status = await predicted_by_service(url, campaign)
    assert set(status) <= {"interpolated", "at-map"}
    np.testing.assert_allclose(predicted, truth.predicted_um, atol=1e-4)
    weights = entry_weights(campaign.maps, campaign.record, truth.observations)
    map_variance = 0.45**2 * (weights**2).sum(axis=1)
    lines = truth.observations.coordinate < 0
    tilt = np.where(lines, 0.15**2 / 3.0, 0.15**2 * 0.81)
    expected = np.sqrt(np.mean(1.0 + 0.3**2 + tilt + map_variance))
    assert 1.05 < expected < 1.25
    assert rms(truth.measured_um - predicted) == pytest.approx(expected, rel=0.05)


@pytest.mark.slow
async def test_an_effect_is_in_the_services_residual(url, campaign_of):
    campaign = campaign_of(9, ["angular", "state-variable:speed"], 3.0, **NO_SCATTER)
    predicted, _ = await predicted_by_service(url, campaign)
    residual = campaign.truth.measured_um - predicted
    np.testing.assert_allclose(residual, campaign.truth.contribution_um, atol=2e-4)


@pytest.mark.slow
async def test_a_biased_sensor_is_believed(url, campaign_of):
    campaign = campaign_of(9, "sensor-fault:bias", 1.0, state_standard_errors=True)
    predicted, status = await predicted_by_service(url, campaign)
    assert set(status) <= {"interpolated", "at-map", "clamped"}
    np.testing.assert_allclose(predicted, campaign.truth.predicted_um, atol=1e-4)
