"""The dashboard in Debian's Chromium: it follows, it says when it cannot, and keys are enough."""

import os
import shutil
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from datetime import UTC, datetime

import httpx
import pytest

from app.cli.listening import listening, serving, url_of
from app.main import create_app
from app.settings import Settings
from tests.files.test_renishaw_rtl import BOTH_WAYS
from tests.service_examples import MACHINE, ROOM, UNHURRIED, furnish_database, reading

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
PATIENCE_MS = 300_000

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        CHROMIUM is None and "THERMAP_REQUIRE_SERVICES" not in os.environ,
        reason="Chromium is not installed (Debian: chromium)",
    ),
]

PAGES = ("loop", "maps", "maps/1", "volume", "history", "events", "setup")
SHOWN = ("mcfv5050", "second", *(f"mcfv5050/{page}" for page in PAGES))

CHECK = {
    "label": "Morning",
    "observations": [
        {
            "time": "2026-03-01T06:00:00Z",
            "component": "EXX",
            "position_mm": 250.0,
            "measured_um": 4.0,
        }
    ],
}

SIZES = {"panel": (1366, 768), "phone": (390, 844), "wide": (1920, 1080), "upright": (900, 1200)}


@pytest.fixture(scope="module")
def chromium():
    playwright = pytest.importorskip("playwright.sync_api")
    playwright.expect.set_options(timeout=PATIENCE_MS)
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield browser
        browser.close()


class Shop:
    """A service that can be ended and begun again at its address."""

    def __init__(self, database_url, **stated):
        self.database_url = database_url
        self._settings = Settings(database_url=database_url, **UNHURRIED, **stated)
        self._port = 0
        self.url = ""

    @contextmanager
    def open(self):
        with (
            listening("127.0.0.1", self._port, "serve") as socket,
            serving(create_app(self._settings), socket, "warning"),
        ):
            self.url = url_of(socket)
            self._port = int(self.url.rpartition(":")[2])
            yield

    def send(self, method, path, content=None):
        answer = httpx.request(method, self.url + path, json=content, timeout=60, trust_env=False)
        assert answer.status_code < 300, answer.text
        return answer

    def feed(self, t_c):
        self.send("POST", f"{ROOM}/readings", [reading(datetime.now(UTC), t_c)])


@pytest.fixture
def shop(databases):
    # Playwright's loop runs in this thread, and a database is furnished by a loop of its own.
    with ThreadPoolExecutor(1) as aside:
        database_url = aside.submit(databases.prepared, "sqlite", furnish_database).result()
    yield Shop(database_url)
    databases.give_back(database_url)


@contextmanager
def opened(chromium, shop, size="panel", **options):
    """A page of which nothing may go wrong, and that asks no other host."""
    width, height = SIZES[size]
    page = chromium.new_page(viewport={"width": width, "height": height}, **options)
    page.set_default_timeout(PATIENCE_MS)
    wrong = []
    page.on("console", lambda m: wrong.append(m.text) if m.type == "error" else None)
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.on("request", lambda r: None if r.url.startswith(shop.url) else wrong.append(r.url))
    yield page, wrong
    page.close()


def barriers(page):
    """What axe-core finds: names, landmarks, tables, contrast of text, sizes of targets."""
    from axe_playwright_python.sync_playwright import Axe

    found = Axe().run(page).response["violations"]
    return [
        (one["id"], node["html"][:200], node.get("failureSummary"))
        for one in found
        for node in one["nodes"]
    ]


def expect(locator):
    from playwright.sync_api import expect

    return expect(locator)


def test_a_table_changes_live_and_a_component_is_chosen(chromium, shop):
    with shop.open(), opened(chromium, shop) as (page, wrong):
        shop.feed(25.0)
        page.goto(shop.url + "/machines/mcfv5050")
        expect(page.locator("#connection")).to_have_text("Live")
        expect(page.locator("#row-EXX")).to_contain_text("−25.0")
        shop.feed(25.4)
        expect(page.locator("#row-EXX")).to_contain_text("−27.0")
        page.locator("#row-EBX").click()
        expect(page.locator("#axis-x h2")).to_contain_text("EBX in µrad")
        shop.send("PATCH", ROOM, {"out_of_range": "reject"})
        shop.feed(30.6)
        expect(page.locator("#answer h1")).to_have_text("Not trusted")
        assert wrong == []


@pytest.mark.parametrize("page_name", ["", "/volume"])
def test_a_table_that_is_gone_is_not_drawn_any_more(chromium, shop, page_name):
    with shop.open(), opened(chromium, shop) as (page, wrong):
        shop.feed(25.0)
        page.goto(f"{shop.url}/machines/mcfv5050{page_name}")
        expect(page.locator("#connection")).to_have_text("Live")
        assert page.locator("figure").count() > 0
        shop.send("PATCH", ROOM, {"out_of_range": "reject"})
        shop.feed(45.0)
        expect(page.locator("#answer.not-trusted")).to_be_visible()
        expect(page.locator("figure")).to_have_count(0)
        expect(page.locator("#row-EXX, #tables, #corners, #slices")).to_have_count(0)
        shop.feed(25.0)
        expect(page.locator("figure").first).to_be_visible()
        expect(page.locator("#row-EXX, #corners").first).to_be_visible()
        assert wrong == []


def test_choosing_a_component_keeps_the_page_its_place_and_the_focus(chromium, shop):
    with shop.open(), opened(chromium, shop, "phone") as (page, wrong):
        shop.feed(25.0)
        page.goto(shop.url + "/machines/mcfv5050")
        expect(page.locator("#connection")).to_have_text("Live")
        page.evaluate("window.isThisPage = true")
        page.locator("#row-EBX").focus()
        before = page.evaluate("scrollY")
        page.keyboard.press("Enter")
        expect(page.locator("#axis-x h2")).to_contain_text("EBX in µrad")
        assert page.evaluate("[window.isThisPage, document.activeElement.id]") == [True, "row-EBX"]
        assert abs(page.evaluate("scrollY") - before) < 100
        assert "EBX" in page.url
        assert wrong == []


def test_the_keyboard_alone_goes_to_a_machine_and_back(chromium, shop):
    with shop.open(), opened(chromium, shop) as (page, wrong):
        shop.send("POST", "/v1/machines", MACHINE | {"id": "second", "name": "VMC-2"})
        shop.feed(25.0)
        page.goto(shop.url)
        page.keyboard.press("ArrowDown")
        page.keyboard.press("ArrowDown")
        page.keyboard.press("Enter")
        page.wait_for_url("**/machines/mcfv5050")
        page.keyboard.press("t")
        expect(page.locator("#whole")).to_have_attribute("open", "")
        page.keyboard.press("Escape")
        page.wait_for_url(shop.url + "/")
        page.keyboard.press("f")
        expect(page.locator("html")).to_have_attribute("data-view", "far")
        assert wrong == []


def test_a_service_that_is_gone_is_said_and_its_return_too(chromium, shop):
    with opened(chromium, shop) as (page, _):
        with shop.open():
            shop.feed(25.0)
            page.goto(shop.url + "/machines/mcfv5050")
            expect(page.locator("#connection")).to_have_text("Live")
        expect(page.locator("#connection")).to_have_text("No connection")
        expect(page.locator(".lost")).to_be_visible()
        assert page.title().startswith("Unknown · ")
        with shop.open():
            expect(page.locator(".lost")).to_be_hidden()
            assert page.title().startswith("Trusted: ")
            shop.feed(26.0)
            expect(page.locator("#row-EXX")).to_contain_text("−30.0")


@pytest.mark.parametrize(
    ("size", "scheme"),
    [("panel", "light"), ("phone", "dark"), ("wide", "dark"), ("upright", "light")],
)
def test_every_size_and_theme_fits_its_screen(chromium, shop, size, scheme):
    with shop.open(), opened(chromium, shop, size, color_scheme=scheme) as (page, wrong):
        shop.send("POST", "/v1/machines", MACHINE | {"id": "second", "name": "A long name " * 5})
        shop.feed(31.4)
        for path in ("/", "/new-machine", *(f"/machines/{one}" for one in SHOWN)):
            page.goto(shop.url + path)
            expect(page.locator("#connection")).to_have_text("Live")
            root = page.locator("html")
            assert root.evaluate("e => e.scrollWidth") <= SIZES[size][0]
            assert root.evaluate("e => getComputedStyle(e).colorScheme") == scheme
            assert barriers(page) == []
        assert wrong == []


def test_paper_has_the_facts_in_their_frame_and_no_buttons(chromium, shop):
    """A4 at 96 dpi, without its margins; the active version is as black as on the screen."""
    with shop.open(), opened(chromium, shop) as (page, wrong):
        shop.feed(25.0)
        page.emulate_media(media="print")
        page.set_viewport_size({"width": 718, "height": 1040})
        for path in ("", "/maps"):
            page.goto(f"{shop.url}/machines/mcfv5050{path}")
            assert page.locator("main button:visible, input:visible, summary:visible").count() == 0
            assert page.locator("html").evaluate("e => e.scrollWidth") <= 718
        knot = page.locator(".timeline .active .knot")
        assert knot.evaluate("e => getComputedStyle(e).printColorAdjust") == "exact"
        page.goto(f"{shop.url}/machines/mcfv5050")
        frame, facts = (page.locator(one).bounding_box() for one in (".verdict", ".verdict dl"))
        assert facts["x"] + facts["width"] <= frame["x"] + frame["width"]
        assert wrong == []


@pytest.mark.parametrize("size", ["upright", "panel"])
def test_every_column_of_the_machines_is_on_the_screen(chromium, shop, size):
    """Nobody looks for a compensation behind the edge of a table that scrolls."""
    with shop.open(), opened(chromium, shop, size) as (page, wrong):
        shop.send("POST", "/v1/machines", MACHINE | {"id": "second", "name": "A long name " * 5})
        shop.feed(31.4)
        page.goto(shop.url)
        expect(page.locator("#connection")).to_have_text("Live")
        table = page.locator("table.machines")
        room = table.locator("..").evaluate("e => e.clientWidth")
        assert table.evaluate("e => e.scrollWidth") <= room + 1
        expect(page.get_by_role("columnheader", name="Compensation")).to_be_visible()
        assert wrong == []


def test_the_active_version_is_on_a_small_screen(chromium, shop):
    """It is the last of three, and three have no room side by side."""
    with shop.open(), opened(chromium, shop, "phone") as (page, wrong):
        page.goto(f"{shop.url}/machines/mcfv5050/maps")
        box = page.locator("#timeline .active").bounding_box()
        assert box["x"] + box["width"] <= SIZES["phone"][0]
        assert wrong == []


def test_a_phone_shows_the_answers_and_which_page_it_is(chromium, shop):
    """The length of an error, what happened, and the page among all pages are behind no edge."""
    with shop.open(), opened(chromium, shop, "phone") as (page, wrong):
        shop.feed(31.4)
        for path, place in (("volume", "#corners .scroll"), ("events", "#events")):
            page.goto(f"{shop.url}/machines/mcfv5050/{path}")
            assert page.locator(place).evaluate("e => e.scrollWidth <= e.clientWidth + 1")
            box = page.locator(".bar nav [aria-current]").bounding_box()
            assert box["x"] + box["width"] <= SIZES["phone"][0]
        what = page.locator(".events tbody td:nth-child(3)").first.bounding_box()
        assert what["width"] > 250
        assert wrong == []


def test_the_theme_that_was_chosen_is_given_up_again(chromium, shop):
    with shop.open(), opened(chromium, shop, color_scheme="dark") as (page, wrong):
        page.goto(shop.url)
        schemes = []
        for _ in range(2):
            page.locator("#theme").click()
            schemes.append(page.locator("html").evaluate("e => getComputedStyle(e).colorScheme"))
            page.reload()
        assert schemes == ["light", "dark"]
        assert page.evaluate("localStorage.getItem('thermap-theme')") == ""
        assert wrong == []


def test_what_is_for_readers_alone_is_seen_on_no_screen(chromium, shop):
    """Also within a head that sticks, on a screen wider than it was once moved aside."""
    with shop.open(), opened(chromium, shop, "wide") as (page, wrong):
        shop.feed(25.0)
        shop.send("POST", f"{ROOM}/verifications", CHECK)
        for shown in ("", *(f"/{page}" for page in PAGES)):
            page.goto(f"{shop.url}/machines/mcfv5050{shown}")
            seen = page.locator(".skip").evaluate_all(
                "all => all.filter(one => one.getBoundingClientRect().width > 1).length"
            )
            assert seen == 0, shown
        page.keyboard.press("Tab")
        assert page.locator(".skip:focus").bounding_box()["width"] > 50
        assert wrong == []


def test_what_is_chosen_shows_in_colours_that_a_person_has_set(chromium, shop):
    """There a page has no backgrounds and no shadows of its own."""

    def look(page, place, of):
        return page.locator(place).first.evaluate(f"one => getComputedStyle(one).{of}")

    with shop.open(), opened(chromium, shop, forced_colors="active") as (page, wrong):
        shop.feed(25.0)
        page.goto(shop.url + "/machines/mcfv5050")
        chosen = look(page, ".component[aria-current]", "borderLeftColor")
        assert chosen != look(page, ".component:not([aria-current])", "borderLeftColor")
        assert look(page, ".bar nav a[aria-current]", "textDecorationLine") == "underline"
        page.goto(shop.url + "/machines/mcfv5050/maps")
        active = look(page, ".timeline .active .knot", "backgroundColor")
        assert active != look(page, ".timeline li:not(.active) .knot", "backgroundColor")
        page.goto(shop.url)
        shop.send("POST", "/v1/machines", MACHINE | {"id": "second", "name": "VMC-2"})
        page.reload()
        edges = (".not-trusted td:first-child", ".fresh td:first-child")
        failed, fresh = (look(page, f".machines tr{edge}", "borderLeftColor") for edge in edges)
        assert failed != fresh
        assert wrong == []


def test_escape_leaves_a_question_and_enter_twice_destroys_nothing(chromium, shop):
    def focused(page):
        return page.evaluate("document.activeElement.textContent")

    with shop.open(), opened(chromium, shop) as (page, wrong):
        shop.feed(25.0)
        shop.send("POST", f"{ROOM}/verifications", CHECK)
        page.goto(shop.url + "/machines/mcfv5050/loop")
        # The list may be drawn anew between a focus and a key.
        page.locator("[data-delete]").press("Enter")
        expect(page.locator(".asked")).to_contain_text("cannot be brought back")
        page.keyboard.press("Enter")
        expect(page.locator(".asked")).to_have_count(0)
        assert focused(page) == "Delete"
        page.keyboard.press("Enter")
        page.keyboard.press("Escape")
        expect(page.locator(".asked")).to_have_count(0)
        assert focused(page) == "Delete"
        assert page.url.endswith("/loop")
        page.goto(shop.url + "/machines/mcfv5050/maps")
        page.get_by_role("button", name="Withdraw").first.click()
        expect(page.locator("#found")).to_contain_text("Keep the map")
        page.keyboard.press("Escape")
        expect(page.locator("#found")).to_have_count(0)
        assert focused(page).startswith("Withdraw")
        assert page.url.endswith("/maps")
        page.keyboard.press("Escape")
        page.wait_for_url("**/machines/mcfv5050")
        assert wrong == []


def test_without_javascript_the_answer_is_there(chromium, shop):
    with shop.open(), opened(chromium, shop, java_script_enabled=False) as (page, wrong):
        shop.feed(25.0)
        page.goto(shop.url + "/machines/mcfv5050")
        expect(page.locator("#answer h1")).to_have_text("Trusted")
        expect(page.locator("#row-EZZ")).to_contain_text("−50.0")
        assert wrong == []


MAP_CSV = """# label: Run #9
# measured_at: 2026-02-28T06:00:00Z
# temperature x-middle: 34
# temperature y-front: 33
# temperature z-column: 36
# temperature spindle: 39
component,position_mm,error_um
EXX,0,0
EXX,100,14
EXX,500,80
"""


def test_a_map_is_shown_before_it_is_stored_and_versions_go_back(chromium, shop):
    """What loses something is stored only by a second button; going back is asked about too."""
    with shop.open(), opened(chromium, shop) as (page, wrong):
        shop.feed(25.0)
        page.goto(shop.url + "/machines/mcfv5050/maps")
        file = {"name": "run9.csv", "mimeType": "text/csv", "buffer": MAP_CSV.encode()}
        expect(page.locator("#choose")).to_be_enabled()
        page.set_input_files("#file", file)
        expect(page.locator("#preview")).to_contain_text("EXX")
        expect(page.locator("#preview")).to_contain_text("run9.csv · map ‘Run #9’: nothing is")
        page.get_by_role("button", name="Discard").click()
        expect(page.locator("#preview")).to_be_empty()
        expect(page.locator(".timeline li")).to_have_count(3)
        expect(page.locator("#choose")).to_be_enabled()
        page.set_input_files("#file", file)
        page.locator("#preview button[data-do^=store]").last.click()
        expect(page.locator("#preview")).to_contain_text("Map ‘Run #9’ is stored")
        expect(page.locator(".timeline li")).to_have_count(4)
        page.locator("#activate-2").click()
        expect(page.locator("#preview")).to_contain_text("v2")
        page.locator("#preview button[data-do=activate]").click()
        expect(page.locator("#preview")).to_contain_text("v2 is active.")
        expect(page.locator("li.active .knot")).to_have_text("v2")
        broken = {"name": "bad.csv", "mimeType": "text/csv", "buffer": b"component,oops\nEXX,1\n"}
        expect(page.locator("#choose")).to_be_enabled()
        page.set_input_files("#file", broken)
        expect(page.locator("#preview")).to_contain_text("bad.csv was not stored.")
        expect(page.locator("#preview")).to_contain_text("Nothing has changed.")
        # A refusal is also a line of the browser's console, and nothing else is.
        assert all("422" in words for words in wrong)


def test_an_instruments_file_asks_for_what_it_does_not_say(chromium, shop):
    """What is refused stands at its field; what is changed is shown anew before it is stored."""
    with shop.open(), opened(chromium, shop) as (page, wrong):
        shop.feed(25.0)
        page.goto(shop.url + "/machines/mcfv5050/maps")
        text = BOTH_WAYS.replace("Axis: X", "Axis: U").encode()
        file = {"name": "x.rtl", "mimeType": "application/octet-stream", "buffer": text}
        expect(page.locator("#choose")).to_be_enabled()
        page.set_input_files("#file", file)
        expect(page.locator("#wrong-axis")).to_contain_text("got 'U'")
        page.locator("#beside select[name=axis]").select_option("X")
        page.get_by_role("button", name="Show what it would change").click()
        expect(page.locator("#wrong-measured_at")).to_contain_text("expected a time")
        expect(page.locator("#wrong-temperatures_c")).to_contain_text("got none")
        assert barriers(page) == []
        now = datetime.now(UTC)
        page.get_by_label("Measured at, UTC").fill(f"{now:%Y-%m-%dT%H:%M:%S}")
        shop.feed(25.2)
        page.get_by_role("button", name="Take the reading").click()
        expect(page.locator("#then-said")).to_contain_text("s before")
        page.get_by_label("x-middle").fill("warm")
        page.get_by_role("button", name="Show what it would change").click()
        expect(page.get_by_label("x-middle")).to_have_attribute("aria-invalid", "true")
        page.get_by_label("x-middle").fill("35")
        page.get_by_role("button", name="Show what it would change").click()
        expect(page.locator("#preview")).to_contain_text("map by positioning ‘cold’")
        assert barriers(page) == []
        page.get_by_label("The map’s name").fill("warm")
        expect(page.locator("#preview")).to_be_empty()
        page.get_by_role("button", name="Show what it would change").click()
        page.locator("#preview button[data-do^=store]").last.click()
        expect(page.locator("#preview")).to_contain_text("Map ‘warm’ is stored")
        expect(page.locator(".timeline li")).to_have_count(4)
        assert all("422" in words for words in wrong)


DROPPED = """([name, text]) => {
  const transfer = new DataTransfer();
  transfer.items.add(new File([text], name));
  for (const kind of ["dragenter", "dragover", "drop"])
    document.getElementById("drop").dispatchEvent(
      new DragEvent(kind, { dataTransfer: transfer, bubbles: true, cancelable: true }));
}"""


def test_what_another_person_changes_meanwhile_is_said_before_a_dropped_map_is_stored(
    chromium, shop
):
    """One looks at what a file would change while another takes a map out of use."""
    with (
        shop.open(),
        opened(chromium, shop) as (one, wrong),
        opened(chromium, shop) as (other, wrong_too),
    ):
        shop.feed(25.0)
        for page in (one, other):
            page.goto(shop.url + "/machines/mcfv5050/maps")
            expect(page.locator("#connection")).to_have_text("Live")
        one.evaluate(DROPPED, ["run9.csv", MAP_CSV])
        expect(one.locator("#preview")).to_contain_text("map ‘Run #9’")
        other.locator("#withdraw-2").click()
        expect(other.locator("#preview h3")).to_contain_text("Withdrawing ‘Run #3’")
        other.keyboard.press("Tab")
        other.keyboard.press("Enter")
        expect(other.locator("#preview")).to_be_empty()
        expect(other.locator("#withdraw-2")).to_be_focused()
        other.keyboard.press("Enter")
        assert barriers(other) == []
        other.get_by_role("button", name="Withdraw ‘Run #3’").click()
        expect(other.locator("#preview")).to_contain_text("The map is out of use.")
        expect(other.locator("#in-use tbody tr")).to_have_count(2)
        expect(other.locator(".meanwhile")).to_have_count(0)
        expect(one.locator(".meanwhile")).to_contain_text("Meanwhile v4 became active")
        for button in one.locator("#preview [data-do^=store]").all():
            expect(button).to_be_disabled()
        one.get_by_role("button", name="Show again what it would change").click()
        expect(one.locator(".meanwhile")).to_have_count(0)
        one.locator("#preview [data-do^=store]").last.click()
        expect(one.locator("#preview")).to_contain_text("Map ‘Run #9’ is stored")
        # The same map cannot be withdrawn by a second person: that is said in words.
        # At once, because what the first one stored has the list drawn anew meanwhile.
        other.evaluate(
            "const button = document.getElementById('withdraw-1');"
            "button.dataset.withdraw = '2'; button.click()"
        )
        expect(other.locator("#preview")).to_contain_text("The map was not withdrawn.")
        expect(other.locator("#preview")).to_contain_text("Nothing has changed.")
        assert wrong == []
        assert all("404" in words for words in wrong_too)


def test_thirty_sensors_fit_and_the_sick_ones_stand_first(chromium, shop):
    names = [f"zone {i:02d}" for i in range(1, 27)]
    sensors = [*MACHINE["sensors"], *({"name": n, "max_c": 60} for n in names)]
    with shop.open(), opened(chromium, shop) as (page, wrong):
        shop.send("PATCH", ROOM, {"sensors": sensors})
        now = datetime.now(UTC)
        warm = reading(now, 25.0)
        warm["temperatures_c"] |= dict.fromkeys(names, 24.0) | {"zone 17": 75.0}
        shop.send("POST", f"{ROOM}/readings", [warm])
        page.goto(shop.url + "/machines/mcfv5050")
        expect(page.locator("#connection")).to_have_text("Live")
        expect(page.locator(".sensor b").first).to_have_text("zone 17")
        idle = page.locator("#idle")
        expect(idle.locator("summary")).to_contain_text("sensors that are not used, all well")
        high = page.locator("#temperatures").bounding_box()["height"]
        assert high < 768
        idle.locator("summary").click()
        # What was opened stays open when values change.
        warm["time"] = datetime.now(UTC).isoformat()
        warm["temperatures_c"]["zone 02"] = 24.1
        shop.send("POST", f"{ROOM}/readings", [warm])
        expect(idle).to_contain_text("24.10")
        expect(idle).to_have_attribute("open", "")
        assert barriers(page) == []
        assert wrong == []


def test_times_are_those_of_the_clock_beside_the_machine(chromium, shop):
    """In Kolkata, 5 h 30 min ahead: what is shown, and what is typed."""
    with shop.open(), opened(chromium, shop, timezone_id="Asia/Kolkata") as (page, wrong):
        shop.feed(25.0)
        page.goto(shop.url + "/machines/mcfv5050/maps")
        expect(page.locator("#clock")).to_contain_text("IST")
        expect(page.locator("#in-use thead")).to_contain_text("measured, IST")
        csv = "component,position_mm,error_um\nEXX,0,0\nEXX,500,2\n"
        expect(page.locator("#choose")).to_be_enabled()
        page.set_input_files(
            "#file", {"name": "a.csv", "mimeType": "text/csv", "buffer": csv.encode()}
        )
        expect(page.locator("#override")).to_have_attribute("open", "")
        page.get_by_label("Measured at, IST").fill("2026-03-01T11:30:00")
        for sensor in ("x-middle", "y-front", "z-column", "spindle"):
            page.get_by_label(sensor, exact=True).fill("25,5")
        page.get_by_label("The map’s name").fill("a")
        page.get_by_role("button", name="Show what it would change").click()
        expect(page.locator("#preview")).to_contain_text("2026-03-01 11:30:00 IST")
        page.locator("#preview [data-do^=store]").first.click()
        expect(page.locator("#preview")).to_contain_text("is stored")
        assert [one for one in wrong if "422" not in one] == []
    with shop.open():
        maps = httpx.get(f"{shop.url}{ROOM}/error-maps", timeout=60, trust_env=False).json()
    (stored,) = [one for one in maps if one["label"] == "a"]
    assert stored["measured_at"] == "2026-03-01T06:00:00Z"
