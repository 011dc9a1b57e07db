"""The loop in Debian's Chromium: from checks to an adopted effect and back."""

import re
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager

import httpx
import pytest

from app.access.keys import Role
from app.services.access_keys import create_key
from app.storage.database import Database
from tests.api.test_dashboard_browser import (
    SIZES,
    Shop,
    barriers,
    chromium,
    expect,
    opened,
    pytestmark,
)
from tests.campaign_examples import ROOM, analysed_database, campaign_database, store_sister

__all__ = ["chromium", "pytestmark"]

LOOP = "/machines/campaign/loop"

WIDTH_OF_PAPER = 680
"""A4 between margins of 15 mm, at 96 px to the inch."""


@contextmanager
def shop_of(databases, prepare):
    with ThreadPoolExecutor(1) as aside:
        database_url = aside.submit(databases.prepared, "sqlite", prepare).result()
    yield Shop(database_url)
    databases.give_back(database_url)


@pytest.fixture
def shop(databases):
    with shop_of(databases, campaign_database) as made:
        yield made


@pytest.fixture
def analysed(databases):
    """The same when reversals have been looked for."""
    with shop_of(databases, analysed_database) as made:
        yield made


def run_quick_analysis(page):
    page.locator("details.options summary").click()
    page.locator("input[name=kind][value=backlash]").check()
    page.locator("#start").click()
    expect(page.locator("#answer h1")).to_contain_text("EZX")


ENGLISH = re.compile(r"\b(?:and|from|not|of|that|the|which|with)\b")
UNMARKED = """() => {
  const texts = [], walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walk.nextNode()) {
    const { parentElement, textContent } = walk.currentNode;
    if (!parentElement.closest("[lang=en], script, style, code")) texts.push(textContent.trim());
  }
  return texts.filter(Boolean);
}"""


def test_the_loop_and_its_report_are_german_but_for_what_is_marked(chromium, analysed):
    shop = analysed
    with shop.open(), opened(chromium, shop) as (page, _wrong):
        page.context.add_cookies([{"name": "thermap-language", "value": "de", "url": shop.url}])
        page.goto(shop.url + LOOP)
        expect(page.locator("#answer h1")).to_contain_text("hat eine Umkehrspanne von")
        page.locator("details").evaluate_all("all => all.forEach(one => { one.open = true })")
        report = page.locator("a[data-key=r]").first.get_attribute("href")
        for address in (None, report):
            if address:
                page.goto(shop.url + address)
            assert page.locator("html").get_attribute("lang") == "de"
            texts = page.evaluate(UNMARKED)
            assert len(texts) > 100
            assert [text for text in texts if ENGLISH.search(text)] == []
            assert page.locator("main [lang=en]").count() < 5
            assert barriers(page) == []


def test_an_effect_is_found_adopted_and_taken_back(chromium, shop):
    with shop.open(), opened(chromium, shop) as (page, wrong):
        page.goto(shop.url + LOOP)
        expect(page.locator("#answer h1")).to_have_text("8 checks, not analysed yet.")
        expect(page.locator("[data-residuals]").first).to_have_text(re.compile(r"^\d+\.\d\d$"))
        run_quick_analysis(page)
        page.keyboard.press("a")
        expect(page.locator(".asked")).to_contain_text("v3 stays as it is")
        page.locator(".asked button", has_text="Adopt as v4").click()
        expect(page.locator(".adopted")).to_have_text(
            "Adopted as v4. No later visits yet: store a check to see what it is worth."
        )
        page.goto(shop.url + "/machines/campaign/maps")
        expect(page.locator("#compared")).to_contain_text("v4 leaves less of")
        expect(page.locator("#compared")).to_contain_text("† An adopted effect was learned from it")
        assert barriers(page) == []
        page.goto(shop.url + LOOP)
        page.locator("#back").click()
        page.locator(".asked button", has_text="Go back to v3").click()
        expect(page.locator("#forward")).to_have_text("Activate v4")
        expect(page.locator(".adopted")).to_contain_text("taken back: v3 is active")
        shop.send("GET", f"{ROOM}/models/3")
        assert wrong == []


def test_a_few_values_are_typed_in(chromium, shop):
    with shop.open(), opened(chromium, shop) as (page, wrong):
        page.goto(shop.url + LOOP)
        page.locator("#typed summary").click()
        page.locator("#typed-label").fill("gauge block")
        page.locator("#typed-repeatability").fill("0,5")
        page.locator("#typed [name=component]").fill("EXX")
        page.locator("#typed [name=position]").fill("100")
        page.locator("#typed [name=direction]").select_option("-")
        page.locator("#typed [name=error]").fill("1,500")
        page.locator("#typed button[type=submit]").click()
        expect(page.locator("#checks-said")).to_contain_text("Error: expected a number such as 5.2")
        expect(page.locator("#typed [name=error]")).to_be_focused()
        page.locator("#typed [name=error]").fill("1,5")
        expect(page.locator("#typed [name=time]")).not_to_have_value("")
        page.locator("#typed [name=time]").fill("2026-03-02T06:00:05")
        page.locator("#typed-more").click()
        page.locator("#typed [name=component]").last.fill("S_xy")
        page.locator("#typed [name=error]").last.fill("-8.2")
        page.locator("#typed [name=time]").last.fill("2026-03-02T06:01:00")
        # A row without an error is none.
        page.locator("#typed-more").click()
        assert barriers(page) == []
        page.locator("#typed-send").click()
        read = page.locator("#found")
        for said in ("‘gauge block’", "absolute: the model's own", "0.5 µm", "EXX", "1.50 µm", "−"):
            expect(read).to_contain_text(said)
        # SXY has one value and no position: there is nothing to draw.
        expect(read.locator("svg polyline")).to_have_count(1)
        assert barriers(page) == []
        page.get_by_role("button", name="Store this check").click()
        expect(page.locator("#answer h1")).to_have_text("9 checks, not analysed yet.")
        rooms = f"{shop.url}{ROOM}/verifications"
        checks = httpx.get(rooms, timeout=60, trust_env=False).json()
        (stored,) = (one for one in checks if one["label"] == "gauge block")
        assert (stored["datum"], stored["repeatability_um"]) == ("absolute", 0.5)
        whole = httpx.get(f"{rooms}/{stored['id']}", timeout=60, trust_env=False).json()
        found = whole["observations"]
        place = {"position_mm": 100.0, "direction": "-", "measured_um": 1.5, "state": {}}
        assert found == [
            {"time": "2026-03-02T06:00:05Z", "component": "EXX", **place},
            {
                "time": "2026-03-02T06:01:00Z",
                "component": "SXY",
                "measured_um_per_m": -8.2,
                "state": {},
            },
        ]
        assert wrong == []


COLD = b"""# label: cold
# measured_at: 2026-03-01T06:00:00Z
component,position_mm,error_um
EXX,0,0
EXX,500,8.2
"""
NIGHT = b"time,component,position_mm,measured_um\n2026-03-01T06:00:00Z,EXX,0,1.5\n"

DROPPED = """([place, name, text]) => {
  const transfer = new DataTransfer();
  transfer.items.add(new File([text], name));
  for (const kind of ["dragenter", "dragover", "drop"])
    document.querySelector(place).dispatchEvent(
      new DragEvent(kind, { dataTransfer: transfer, bubbles: true, cancelable: true }));
}"""


def test_each_kind_is_shown_and_stored_on_whichever_page_it_is_dropped(chromium, shop):
    """Anywhere on the page; what a map does not say is asked on the page of checks, too."""
    with shop.open(), opened(chromium, shop) as (page, wrong):
        page.goto(f"{shop.url}/machines/campaign/maps")
        page.evaluate(DROPPED, ["h1", "Night1.csv", NIGHT.decode()])
        found = page.locator("#found")
        expect(found).to_contain_text("Night1.csv is a check.")
        expect(found.locator("svg polyline")).to_have_count(1)
        expect(page.locator("#override")).to_be_hidden()
        assert barriers(page) == []
        page.get_by_role("button", name="Store this check").click()
        expect(page.locator("#preview")).to_contain_text("Check ‘Night1’ is stored.")
        page.locator("#preview a").click()
        expect(page.locator(".checks-room tbody")).to_contain_text("Night1")
        assert wrong == []
        rooms = httpx.get(shop.url + ROOM, timeout=60, trust_env=False).json()
        sensors = [one["name"] for one in rooms["sensors"]]
        page.evaluate(DROPPED, ["h1", "Cold.csv", COLD.decode()])
        expect(page.locator("#wrong-temperatures_c")).to_contain_text("got none")
        expect(page.locator("#preview")).to_contain_text("What the file does not say is asked")
        for sensor in sensors:
            page.locator(f'[data-sensor="{sensor}"]').fill("45,5")
        page.get_by_role("button", name="Show what it would change").click()
        expect(found).to_contain_text("Cold.csv is an error map.")
        expect(found).to_contain_text("45.50 °C")
        expect(found.locator("table.read svg polyline")).to_have_count(1)
        assert barriers(page) == []
        page.locator("#preview button[data-do^=store]").first.click()
        expect(page.locator("#preview")).to_contain_text("Map ‘cold’ is stored")
        assert all("422" in words for words in wrong)


def test_what_is_refused_is_said_where_it_was_asked(chromium, shop):
    with shop.open(), opened(chromium, shop) as (page, _):
        page.goto(shop.url + LOOP)
        page.locator("#every").uncheck()
        for box in page.locator("input[name=check]").all():
            box.uncheck()
        page.locator("#start").click()
        expect(page.locator("#checks-said [role=alert]")).to_contain_text("Not started.")
        wrong_file = {"name": "run-9.json", "mimeType": "application/json", "buffer": b"{}"}
        expect(page.locator("#choose")).to_be_enabled()
        page.locator("#file").set_input_files(wrong_file)
        expect(page.locator("#preview")).to_contain_text("run-9.json was not stored.")
        expect(page.locator("#preview")).to_contain_text("observations")


@pytest.mark.slow
def test_a_check_is_stored_from_csv(chromium, shop):
    heading = b"time,component,position_mm,measured_um\n"
    good = heading + b"2026-03-01T06:00:00Z,EXX,0,1.5\n"

    def csv(name, content):
        return {"name": name, "mimeType": "text/csv", "buffer": content}

    with shop.open(), opened(chromium, shop) as (page, wrong):
        page.goto(shop.url + LOOP)
        expect(page.locator("#choose")).to_be_enabled()
        page.locator("#file").set_input_files(csv("night shift.csv", b"# datum;first\n" + good))
        read = page.locator("#found")
        expect(read).to_contain_text("night shift.csv: nothing is stored yet")
        expect(read).to_contain_text("first: each component's first value")
        expect(read).to_contain_text("not stated")
        expect(read.locator("tbody tr")).to_contain_text(["EXX"])
        expect(read.locator("svg polyline")).to_have_count(1)
        assert barriers(page) == []
        expect(page.locator(".checks-room tbody")).not_to_contain_text("night shift")
        page.get_by_role("button", name="Store this check").click()
        expect(page.locator(".checks-room tbody")).to_contain_text("night shift")
        # No sensor was read at that time, so there is nothing to hold the check against.
        left = page.locator("tr", has_text="night shift").locator("[data-residuals]")
        expect(left).to_have_text("not comparable")
        expect(left).to_have_attribute("title", re.compile("no reading near enough"))
        assert wrong == []
        expect(page.locator("#choose")).to_be_enabled()
        page.locator("#file").set_input_files(csv("run-9.csv", good.replace(b"1.5", b"n/a")))
        refused = page.locator("#preview")
        expect(refused).to_contain_text("run-9.csv was not stored.")
        expect(refused).to_contain_text("line 2, column 4 (measured_um): expected a number in µm")
        expect(page.locator(".checks-room tbody")).not_to_contain_text("run-9")


def test_a_key_that_only_reads_plans_a_visit(chromium, shop):
    with closing(Database(shop.database_url)) as database:
        secret = create_key(database, "viewer", Role.VIEWER).secret
    stated = {"Authorization": f"Bearer {secret}"}
    guarded = Shop(shop.database_url, require_keys=True)
    with guarded.open(), opened(chromium, guarded, extra_http_headers=stated) as (page, wrong):
        page.goto(guarded.url + LOOP)
        page.locator("#plan").click()
        expect(page.locator("#checks-said")).to_contain_text("8 visits with 520 values would show")
        expect(page.locator("#plan")).to_be_enabled()
        assert page.locator("#start, #file, [data-delete]").count() == 0
        assert wrong == []


@pytest.mark.parametrize(
    ("size", "scheme"), [("panel", "light"), ("phone", "dark"), ("wide", "dark")]
)
def test_every_size_and_theme_fits_its_screen(chromium, analysed, size, scheme):
    shop = analysed
    with shop.open(), opened(chromium, shop, size, color_scheme=scheme) as (page, wrong):
        page.goto(shop.url + LOOP)
        expect(page.locator("#price")).to_contain_text("live table")
        assert page.locator("html").evaluate("e => e.scrollWidth") <= SIZES[size][0]
        for table in page.locator(".scroll:has(> .checks)").all():
            # Nobody would look for a button behind an edge.
            assert table.evaluate("e => e.scrollWidth <= e.clientWidth + 1")
        assert barriers(page) == []
        assert wrong == []


def test_a_controllers_files_are_shown_and_downloaded(chromium, shop):
    with shop.open(), opened(chromium, shop) as (page, wrong):
        page.goto(shop.url + "/machines/campaign/export?controller=csv")
        page.keyboard.press("s")
        expect(page.locator("#shown")).to_contain_text("Check after loading")
        assert barriers(page) == []
        with page.expect_download() as found:
            page.locator("#download").click()
        assert found.value.suggested_filename == "campaign-csv.zip"
        assert wrong == []


def test_a_fleet_is_analysed_and_says_what_sisters_share(chromium, shop):
    """Two machines with the same undeclared reversal value, and one that nobody measured."""
    with shop.open(), opened(chromium, shop) as (page, wrong):
        for name, checks in (("sister", None), ("unmeasured", 0)):
            with httpx.Client(base_url=shop.url, trust_env=False, timeout=60) as client:
                store_sister(client, name, checks)
        page.goto(shop.url)
        page.get_by_role("link", name="Fleet").click()
        page.goto(shop.url + "/fleet?effects=backlash")
        page.get_by_role("button", name="Analyse 2 machines").click()
        expect(page.locator("#effects")).to_contain_text("EZX has a reversal value")
        expect(page.locator("#effects")).to_contain_text("found on 2 of 3")
        expect(page.locator("#every")).to_contain_text("no check of it is stored")
        assert barriers(page) == []
        page.set_viewport_size({"width": 390, "height": 844})
        assert page.locator("html").evaluate("e => e.scrollWidth") <= 390
        assert wrong == []


def test_a_fleets_analyses_are_cancelled_and_asked_again(chromium, shop):
    """Of all kinds they take long enough to be cancelled; what was cancelled can be asked again."""
    with shop.open(), opened(chromium, shop) as (page, wrong):
        page.goto(shop.url + "/fleet")
        page.get_by_role("button", name="Analyse 1 machine").click()
        expect(page.locator("#cancel")).to_have_text("Cancel 1 analysis")
        assert barriers(page) == []
        page.locator("#cancel").click()
        expect(page.locator("#every")).to_contain_text("cancelled")
        expect(page.get_by_role("button", name="Analyse 1 machine")).to_be_enabled()
        assert wrong == []


def test_two_browsers_adopt_at_once_and_the_later_one_is_told(chromium, analysed):
    shop = analysed
    with shop.open(), opened(chromium, shop) as (page, wrong):
        page.goto(shop.url + LOOP)
        with opened(chromium, shop) as (other, _):
            other.goto(shop.url + LOOP)
            for one in (page, other):
                one.locator("#adopt").click()
                expect(one.locator(".asked")).to_contain_text("v3 stays as it is")
            page.locator(".asked button", has_text="Adopt as v4").click()
            expect(page.locator(".adopted")).to_contain_text("Adopted as v4.")
            other.locator(".asked button", has_text="Adopt as v4").click()
            refused = other.locator("#decision-said [role=alert]")
            expect(refused).to_contain_text("Not done: Adopt as v4. Analysis 1 was already adopted")
            refused.get_by_role("link", name="Show how it is now").click()
            expect(other.locator(".adopted")).to_contain_text("Adopted as v4.")
        assert wrong == []


def test_a_long_label_leaves_room_for_the_rest(chromium, analysed):
    """Labels without a space, of text that a browser must not take for markup."""
    label = "<b>night</b> " + "n" * 150
    content = b"time,component,position_mm,measured_um\n2026-03-01T06:00:00Z,EXX,0,1.5\n"
    named = f"# label: {label}\n".encode() + content
    shop = analysed
    with shop.open(), opened(chromium, shop) as (page, wrong):
        page.goto(shop.url + LOOP)
        night = {"name": "night.csv", "mimeType": "text/csv", "buffer": named}
        expect(page.locator("#choose")).to_be_enabled()
        page.locator("#file").set_input_files(night)
        page.get_by_role("button", name="Store this check").click()
        expect(page.locator(".checks-room tbody")).to_contain_text(label)
        for part in (".checks-room", "#answer"):
            box = page.locator(part)
            assert box.evaluate("e => e.scrollWidth <= e.clientWidth + 1"), part
        left = page.locator("tr", has_text=label).locator("[data-residuals]")
        left.scroll_into_view_if_needed()
        expect(left).to_have_text("not comparable")
        assert wrong == []


def test_paper_has_what_was_found_and_no_buttons(chromium, analysed):
    """Positions are round numbers; what is shaded stays so where paper has no ground."""
    shop = analysed
    with shop.open(), opened(chromium, shop) as (page, wrong):
        shop.send("PATCH", ROOM, {"serial_number": "5050-1274"})
        page.goto(shop.url + LOOP)
        words = page.locator(".places").first.locator("span").all_inner_texts()
        assert 2 <= len(words) <= 6
        assert all(len(one) <= 6 for one in words), words
        page.emulate_media(media="print")
        assert page.locator("button:visible, input:visible").count() == 0
        expect(page.locator("#answer h1")).to_be_visible()
        expect(page.locator("#checks th[scope=row]").first).to_be_visible()
        shaded = page.locator(".evidence .weight").first
        assert shaded.evaluate("e => getComputedStyle(e).printColorAdjust") == "exact"
        analysis = page.locator("#loop").get_attribute("data-analysis")
        for of, pages in (
            (f"analyses/{analysis}/report", (2, 8)),
            (f"analyses/{analysis}/visits", (1, 1)),
            ("verifications/1/residuals", (2, 12)),
        ):
            expect_certificate(page, f"{shop.url}{ROOM}/{of}", pages)
        assert wrong == []


def expect_certificate(page, address, pages):
    """It leads back on a screen, and fills whole sheets of A4 as wide as they are."""
    page.emulate_media(media="screen")
    page.goto(address)
    assert page.get_by_role("link", name="Loop").get_attribute("href").startswith(LOOP)
    expect(page.get_by_role("button", name="Print, or save as PDF")).to_be_visible()
    fewest, most = pages
    sheets = page.pdf(prefer_css_page_size=True)
    assert fewest <= len(re.findall(rb"/Type\s*/Page\b", sheets)) <= most
    sizes = re.findall(rb"/MediaBox \[0 0 ([\d.]+) ([\d.]+)", sheets)
    assert sizes
    for width, height in sizes:
        assert (float(width), float(height)) == pytest.approx((595.28, 841.89), abs=1.0)  # points
    page.set_viewport_size({"width": WIDTH_OF_PAPER, "height": 960})
    page.emulate_media(media="print")
    expect(page.get_by_text("5050-1274").first).to_be_visible()
    assert page.locator(".tools").is_hidden()
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    wide = "document.documentElement.scrollWidth"
    assert page.evaluate(wide) <= WIDTH_OF_PAPER
    style = page.locator("style").first.text_content()
    assert '"Page " counter(page) " of " counter(pages)' in style
