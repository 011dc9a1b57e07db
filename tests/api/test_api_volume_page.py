"""The page of the work volume as a browser without JavaScript gets it."""

import pytest

from tests.api.test_api_dashboard import feed, shown
from tests.service_examples import MACHINE, ROOM, START, error_map, problem, reading

pytestmark = pytest.mark.anyio

VOLUME = "/machines/mcfv5050/volume"


@pytest.mark.slow
async def test_the_largest_error_is_the_services_and_stands_first(client):
    await feed(client, reading(START, 27.0))
    asked = {"points_mm": [[500, 500, 500]], "missing_components": "zero"}
    accuracy = await client.post(f"{ROOM}/volumetric-accuracy", json={"missing_components": "zero"})
    found = accuracy.json()
    corner = (await client.post(f"{ROOM}/volumetric-error", json=asked)).json()["errors_um"][0]
    page = await shown(client, VOLUME)
    largest = found["with_arms"]["definition_1_um"]
    x, y, z = found["with_arms"]["worst_point_mm"]
    assert f"Largest error {largest:.1f} µm at X {x:g}, Y {y:g}, Z {z:g} mm" in page.text
    row = " ".join(f"{v:+.1f}".replace("-", "−") if round(v, 1) else "0.0" for v in corner)
    assert f"500 500 500 {row}" in page.text
    assert f"ESd {found['ESd_um']:.1f}" in page.text
    # What no map has is not an error of zero: it is named.
    assert "without two maps count as zero" in page.text


async def test_slices_are_drawn_on_the_service_with_the_chosen_exaggeration(client):
    await feed(client, reading(START, 27.0))
    page = await shown(client, f"{VOLUME}?times=200&through=middle&tool_z=160")
    assert "Errors drawn 200 times larger" in page.text
    assert "Front view, XZ at Y 250 mm" in page.text
    assert "tool offset (0, 0, 160) mm" in page.text
    assert "ring: largest error" not in page.text
    assert "ring: largest error" in (await shown(client, VOLUME)).text
    problem(await client.get(f"{VOLUME}?times=1e9"), 422)
    problem(await client.get(f"{VOLUME}?times=nan"), 422)


async def test_a_lathe_is_drawn_in_the_one_plane_that_it_has(client):
    """A slice through an axis that there is none of would be a line."""
    lathe = MACHINE | {"id": "lathe", "configuration": "FZX"}
    lathe["axes"] = {a: MACHINE["axes"][a] for a in "xz"}
    assert (await client.post("/v1/machines", json=lathe)).status_code == 201
    for t in (20.0, 30.0):
        await client.post("/v1/machines/lathe/error-maps", json=error_map(f"At {t}", t))
    asked = reading(START, 25.0)
    assert (await client.post("/v1/machines/lathe/readings", json=asked)).status_code == 201
    text = (await client.get("/machines/lathe/volume")).text
    assert text.count("<figcaption>") == 1
    assert "Front view, XZ at Y 0 mm" in text
    await feed(client, reading(START, 27.0))
    assert (await client.get(VOLUME)).text.count("<figcaption>") == 3


async def test_a_machine_without_a_table_says_why_and_draws_nothing(client, empty):
    page = await shown(client, VOLUME)
    assert "The error cannot be computed. machine 'mcfv5050' has no reading yet" in page.text
    assert "figure" not in page.tags
    await empty.post("/v1/machines", json=MACHINE)
    assert "The error cannot be computed." in (await shown(empty, VOLUME)).text
    problem(await empty.get("/machines/another/volume"), 404)
