"""Pages in the reader's language and units, in Debian's Chromium: typed, shown, stored in SI."""

import pytest

from tests.api.test_dashboard_browser import (  # noqa: F401
    barriers,
    chromium,
    expect,
    opened,
    pytestmark,
    shop,
)
from tests.service_examples import ROOM

GERMAN = {"locale": "de-DE"}


def chosen_by_keys(page, *names):
    """Choose the next language or unit of each with the keyboard alone; the page comes anew."""
    page.locator(".reader summary").focus()
    page.keyboard.press("Enter")
    for name in ("language", "temperature", "length"):
        page.keyboard.press("Tab")
        if name in names:
            page.keyboard.press("ArrowDown")
    page.keyboard.press("Tab")
    with page.expect_navigation():
        page.keyboard.press("Enter")


def test_a_comma_is_typed_and_shown_in_german(chromium, shop):  # noqa: F811
    with shop.open(), opened(chromium, shop, **GERMAN) as (page, wrong):
        page.goto(shop.url + "/new-machine")
        assert page.locator("html").get_attribute("lang") == "de"
        page.get_by_label("Name", exact=True).fill("Halle 2")
        ends = page.locator(".travel[data-axis=x] input")
        ends.nth(0).fill("0")
        ends.nth(1).fill("weit")
        page.get_by_role("button", name="Maschine anlegen").click()
        expect(page.locator("#wrong-axes")).to_contain_text("angegeben: „weit“")
        ends.nth(1).fill("1500,125")
        page.get_by_role("button", name="Maschine anlegen").click()
        page.wait_for_url("**/machines/halle-2/setup")
        assert page.locator(".travel[data-axis=x] input").nth(1).input_value() == "1500,125"
        assert barriers(page) == []
        assert wrong == []
    with shop.open():
        answer = shop.send("GET", "/v1/machines/halle-2").json()
        assert answer["axes"]["x"]["max_mm"] == 1500.125


def test_longer_words_do_not_run_into_the_clock(chromium, shop):  # noqa: F811
    with shop.open(), opened(chromium, shop, **GERMAN) as (page, _):
        for width in (1100, 1101, 1200, 1280):
            page.set_viewport_size({"width": width, "height": 800})
            page.goto(f"{shop.url}{ROOM.removeprefix('/v1')}/setup")
            pages, clock = (page.locator(f".bar {one}").bounding_box() for one in ("nav", ".right"))
            is_beside = pages["x"] + pages["width"] <= clock["x"]
            assert is_beside or clock["y"] >= pages["y"] + pages["height"] - 1
            assert page.locator(".bar nav").evaluate("e => getComputedStyle(e).overflowX") == "auto"


def test_fahrenheit_and_inches_are_typed_and_stored_as_celsius_and_millimetres(
    chromium,  # noqa: F811
    shop,  # noqa: F811
    tmp_path,
):
    file = tmp_path / "warm.csv"
    file.write_text("component,position_mm,error_um\nEXX,0,0\nEXX,500,12.5\n", encoding="utf-8")
    with shop.open(), opened(chromium, shop) as (page, wrong):
        travel = shop.send("GET", ROOM).json()["axes"]
        page.goto(f"{shop.url}{ROOM.removeprefix('/v1')}/setup")
        chosen_by_keys(page, "temperature", "length")
        # What is sent back as it was shown is stored as it was.
        assert page.locator(".travel[data-axis=x] input").nth(1).input_value() == "19.68504"
        page.locator(".travel[data-axis=y] input").nth(1).fill("20")
        with page.expect_navigation():
            page.locator("#store-machine").click()
        found = shop.send("GET", ROOM).json()["axes"]
        assert found["x"] == travel["x"]
        assert found["y"]["max_mm"] == 508.0

        expect(page.locator("#choose")).to_be_enabled()
        page.set_input_files("#file", str(file))
        expect(page.locator("#override")).to_have_attribute("open", "")
        page.get_by_label("The map’s name").fill("Warm")
        page.locator("[name=measured_at]").fill("2026-03-02T12:00:00")
        for field in page.locator("[data-sensor]").all():
            field.fill("75,38")
        page.locator("#beside [type=submit]").click()
        expect(page.locator("#found")).to_contain_text("75.38 °F")
        assert barriers(page) == []
        page.locator("#preview [data-do^=store]").first.click()
        expect(page.locator("#preview")).to_contain_text("Map ‘Warm’ is stored")
        stored = shop.send("GET", f"{ROOM}/error-maps").json()
        (warm,) = [one for one in stored if one["label"] == "Warm"]
        assert set(warm["temperatures_c"].values()) == {24.1}
        # A file that lacks what it should say is refused first.
        assert [one for one in wrong if "422" not in one] == []


@pytest.mark.parametrize(("size", "scheme"), [("panel", "light"), ("phone", "dark")])
def test_the_glossary_is_a_key_away_and_the_choice_fits(chromium, shop, size, scheme):  # noqa: F811
    with (
        shop.open(),
        opened(chromium, shop, size, color_scheme=scheme, **GERMAN) as (page, wrong),
    ):
        shop.feed(25.0)
        page.goto(f"{shop.url}{ROOM.removeprefix('/v1')}")
        expect(page.locator("#connection")).to_have_text("Live")
        assert "Drehung von X um Y (Nicken" in page.locator("#row-EBX abbr").get_attribute("title")
        page.keyboard.press("?")
        expect(page.locator("#keys-list")).to_contain_text("Nicken, wenn Z senkrecht ist")
        assert barriers(page) == []
        page.keyboard.press("Escape")
        page.locator(".reader summary").click()
        assert barriers(page) == []
        wider = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
        assert page.evaluate(wider) == 0
        assert wrong == []
