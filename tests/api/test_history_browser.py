"""A machine over time in Debian's Chromium, and a test message sent with a button."""

from datetime import UTC, datetime, timedelta

import pytest

from tests.api.test_dashboard_browser import (
    PATIENCE_MS,
    ROOM,
    SIZES,
    Shop,
    barriers,
    chromium,
    expect,
    opened,
    shop,
)
from tests.connections.receiver_examples import Webhook
from tests.service_examples import reading

__all__ = ["chromium", "shop"]  # fixtures

pytestmark = pytest.mark.slow

PAGE = "/machines/mcfv5050/history"


def feed_a_day(shop):
    """A reading every ten minutes of a day, but for two hours; the last one now."""
    now = datetime.now(UTC)
    times = [now - timedelta(minutes=10 * i) for i in range(144, -1, -1) if not 30 < i < 43]
    body = [reading(time, 22.0 + i % 5) for i, time in enumerate(times)]
    shop.send("POST", f"{ROOM}/readings", body)


def span_s(page):
    return float(page.evaluate("new URLSearchParams(location.hash.slice(1)).get('span')"))


def test_it_is_zoomed_by_pointer_and_keyboard_and_goes_back(chromium, shop):
    with shop.open(), opened(chromium, shop) as (page, wrong):
        feed_a_day(shop)
        page.goto(f"{shop.url}{PAGE}#sensor=x-middle&component=EXX")
        expect(page.locator("#drawing svg text.h")).to_have_count(2)
        assert span_s(page) == 86_400
        box = page.locator("#drawing").bounding_box()
        page.mouse.move(box["x"] + 400, box["y"] + 80)
        page.mouse.down()
        page.mouse.move(box["x"] + 600, box["y"] + 80)
        page.mouse.up()
        page.wait_for_function("new URLSearchParams(location.hash.slice(1)).has('to')")
        assert 10_000 < span_s(page) < 20_000
        assert page.locator("#live").get_attribute("aria-pressed") == "false"
        page.locator("#drawing").focus()
        page.keyboard.press("ArrowRight")
        expect(page.locator("#readout")).to_contain_text("x-middle")
        page.keyboard.press("+")
        page.wait_for_function("new URLSearchParams(location.hash.slice(1)).get('span') < 10000")
        page.keyboard.press("l")
        expect(page.locator("#live")).to_have_attribute("aria-pressed", "true")
        page.reload()
        assert span_s(page) < 10_000
        assert wrong == []


def test_gaps_values_and_places_are_shown(chromium, shop):
    with shop.open(), opened(chromium, shop) as (page, _):
        feed_a_day(shop)
        page.goto(f"{shop.url}/machines/mcfv5050")
        page.get_by_role("link", name="x-middle").click()
        expect(page.locator("#drawing svg text.h")).to_have_text(["x-middle, °C"])
        assert page.locator("#drawing .x").count() > 0  # a reading in ten minutes is a gap
        page.locator("[name=component]").select_option("EXX")
        expect(page.locator("#drawing svg text.h").nth(1)).to_have_text(
            "Compensation EXX at 500 mm, µm"
        )
        page.locator("[name=position]").fill("250")
        page.locator("[name=position]").press("Tab")
        expect(page.locator("#drawing svg text.h").nth(1)).to_contain_text("at 250 mm")
        page.locator("[name=position]").fill("900")
        page.locator("[name=position]").press("Tab")
        expect(page.locator("#said")).to_contain_text("within the travel of x from 0 to 500 mm")


def test_it_is_live_at_its_right_edge(chromium, shop):
    with shop.open(), opened(chromium, shop) as (page, wrong):
        page.goto(f"{shop.url}{PAGE}#span=3600&sensor=x-middle")
        expect(page.locator("#drawing svg text.h")).to_contain_text("no readings in this time")
        shop.feed(25.0)
        expect(page.locator("#drawing svg text.h")).to_have_text(["x-middle, °C"])
        assert wrong == []


def test_numbers_and_a_picture_are_saved(chromium, shop, tmp_path):
    with shop.open(), opened(chromium, shop) as (page, wrong):
        feed_a_day(shop)
        page.goto(f"{shop.url}{PAGE}#sensor=x-middle")
        expect(page.locator("#drawing svg text.h")).to_have_count(1)
        with page.expect_download(timeout=PATIENCE_MS) as saving:
            page.locator("#picture").click()
        picture = tmp_path / saving.value.suggested_filename
        saving.value.save_as(picture)
        assert picture.name == "mcfv5050-history.png"
        assert picture.read_bytes().startswith(b"\x89PNG")
        with page.expect_download(timeout=PATIENCE_MS) as saving:
            page.locator("#csv").click()
        saving.value.save_as(tmp_path / "history.csv")
        lines = (tmp_path / "history.csv").read_text(encoding="utf-8").splitlines()
        assert lines[0] == "time,of,unit,mean,low,high,readings,longest_gap_s"
        assert len(lines) > 100
        assert [one for one in wrong if not one.startswith("blob:")] == []  # its own picture


@pytest.mark.parametrize(
    ("size", "scheme"),
    [("panel", "light"), ("phone", "dark"), ("wide", "dark"), ("upright", "light")],
)
def test_a_full_page_fits_every_screen_and_has_no_barriers(chromium, shop, size, scheme):
    with shop.open(), opened(chromium, shop, size, color_scheme=scheme) as (page, wrong):
        feed_a_day(shop)
        page.goto(f"{shop.url}{PAGE}#sensor=x-middle&sensor=spindle&component=EXX")
        expect(page.locator("#drawing svg text.h")).to_have_count(3)
        assert page.locator("html").evaluate("e => e.scrollWidth") <= SIZES[size][0]
        assert barriers(page) == []
        loaded = page.evaluate(
            "[...performance.getEntriesByType('resource'), performance.getEntriesByType("
            "'navigation')[0]].reduce((sum, one) => sum + one.decodedBodySize, 0)"
        )
        assert loaded < 300_000
        assert wrong == []


def test_a_test_message_is_sent_with_a_button(chromium, shop, tmp_path):
    pytest.importorskip("apprise")
    with Webhook().open() as hook:
        config = tmp_path / "thermap.toml"
        config.write_text(f'[[notify]]\nname = "shift leader"\nurl = "{hook.url}"\n')
        told = Shop(shop.database_url, config=config)
        with told.open(), opened(chromium, told) as (page, wrong):
            told.feed(25.0)
            page.goto(f"{told.url}/machines/mcfv5050/events")
            button = page.get_by_role("button", name="Send a test to shift leader")
            while not button.count():  # the first look after it is a second after the start
                page.reload()
            button.focus()
            page.keyboard.press("Enter")
            expect(page.locator("#receivers tbody td").last).to_contain_text("sent")
            assert [title for title, _ in hook.came] == ["thermap: test"]
            assert barriers(page) == []
            assert wrong == []
