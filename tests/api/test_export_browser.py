"""A controller's files from the page: what is stated is what the API is asked for."""

import json
import zipfile

import httpx

from tests.api.test_dashboard_browser import (
    PATIENCE_MS,
    barriers,
    chromium,
    expect,
    opened,
    pytestmark,
    shop,
)
from tests.service_examples import ROOM

__all__ = ["chromium", "pytestmark", "shop"]

NEEDED = {"sign": "compensation", "counts_per_mm": 1000}


def asked(shop, controller, options):
    """What the API answers to the same options."""
    path = f"{shop.url}{ROOM}/compensation/export?controller={controller}"
    answer = httpx.post(path, json={"options": options}, timeout=60, trust_env=False)
    assert answer.status_code == 200, answer.text
    return answer.json()


def without_time(content):
    return [line for line in content.splitlines() if "computed" not in line]


def test_every_controllers_files_are_those_of_the_api(chromium, shop):
    """Chosen, shown and downloaded: what has to be stated is asked, and nothing else."""
    with shop.open(), opened(chromium, shop) as (page, wrong):
        shop.feed(25.0)
        listed = httpx.get(f"{shop.url}/v1/controllers", timeout=60, trust_env=False).json()
        for one in listed["controllers"]:
            options = {o["name"]: NEEDED[o["name"]] for o in one["options"] if o["required"]}
            page.goto(f"{shop.url}/machines/mcfv5050/export?controller={one['name']}")
            for name, value in options.items():
                field = page.locator(f"#option-{name}")
                if isinstance(value, str):
                    field.select_option(json.dumps(value))
                else:
                    field.fill(str(value))
            page.get_by_role("button", name="Show files").click()
            expect(page.locator("#shown")).to_contain_text("Check after loading")
            files = asked(shop, one["name"], options)["files"]
            texts = [text.text_content() for text in page.locator("#shown pre").all()]
            assert list(map(without_time, texts)) == [without_time(f["content"]) for f in files]
            with page.expect_download(timeout=PATIENCE_MS) as download:
                page.get_by_role("button", name="Download zip").click()
            with zipfile.ZipFile(download.value.path()) as archive:
                assert {f["name"] for f in files} < set(archive.namelist())
        assert wrong == []


def test_what_is_wrong_with_an_option_stands_at_it(chromium, shop):
    with shop.open(), opened(chromium, shop, "phone") as (page, wrong):
        shop.feed(25.0)
        page.goto(f"{shop.url}/machines/mcfv5050/export?controller=siemens-cec")
        page.keyboard.press("s")
        expect(page.locator("#wrong-sign")).to_contain_text("expected a value, got none")
        expect(page.locator("#option-sign")).to_be_focused()
        page.locator("#option-sign").select_option('"error"')
        page.locator("#others summary").click()
        page.get_by_label("Spacing, mm").fill("5 5")
        page.locator("#option-axesx").fill("A 1")
        page.keyboard.press("Enter")
        expect(page.locator("#wrong-spacing_mm")).to_contain_text("got '5 5'")
        expect(page.locator("#wrong-axes")).to_contain_text("X: expected 1 to 32 letters")
        assert barriers(page) == []
        page.get_by_label("Spacing, mm").fill("125")
        page.locator("#option-axesx").fill("MX1")
        page.get_by_label("EZZ").uncheck()
        expect(page.locator("#others-said")).to_have_text("3 stated otherwise")
        page.keyboard.press("Tab")
        page.get_by_role("button", name="Show files").click()
        expect(page.locator("#shown")).to_contain_text("Values: error, actual minus nominal.")
        assert barriers(page) == []
        stated = {"sign": "error", "spacing_mm": 125, "axes": {"x": "MX1", "y": "AX2", "z": "AX3"}}
        everything = asked(shop, "siemens-cec", stated)["files"][0]["content"]
        shown = page.locator("#shown pre").first.text_content()
        assert "MX1" in shown
        assert "(AX3)" in everything
        assert "(AX3)" not in shown
        assert page.locator("html").evaluate("e => e.scrollWidth") <= 390
        # What was shown was of other options.
        page.get_by_label("Spacing, mm").fill("250")
        expect(page.locator("#shown")).to_be_empty()
        assert all("422" in words for words in wrong)
