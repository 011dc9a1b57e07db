"""The page of a controller's files."""

import pytest

from tests.api.test_api_dashboard import shown
from tests.service_examples import problem

pytestmark = pytest.mark.anyio

PAGE = "/machines/mcfv5050/export"


async def test_a_controller_is_chosen_with_its_options_and_how_surely_it_is_known(client):
    page = await shown(client, PAGE)
    assert "For which controller?" in page.text
    listed = (await client.get("/v1/controllers")).json()["controllers"]
    for one in listed:
        assert f"?controller={one['name']}" in page.addresses
        chosen = await shown(client, f"{PAGE}?controller={one['name']}")
        assert " ".join(one["title"].split()) in chosen.text
        assert one["status"] in chosen.text
        for option in one["options"]:
            assert option["name"] in chosen.text
            fields = {f"option-{option['name']}{axis}" for axis in option["axes"] or [""]}
            assert option["takes"] == "components" or fields <= set(chosen.ids)
    problem(await client.get(f"{PAGE}?controller=abacus"), 404)
    problem(await client.get("/machines/another/export"), 404)
    assert PAGE in (await shown(client, "/machines/mcfv5050")).addresses
