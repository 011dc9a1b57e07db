"""From an empty service to a trusted table in Debian's Chromium, and never a command."""

import os
import re
from datetime import UTC, datetime

import pytest

from tests.api.test_dashboard_browser import (
    CHROMIUM,
    SIZES,
    Shop,
    barriers,
    chromium,
    expect,
    opened,
)

__all__ = ["chromium"]

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        CHROMIUM is None and "THERMAP_REQUIRE_SERVICES" not in os.environ,
        reason="Chromium is not installed (Debian: chromium)",
    ),
]

SENSORS = ("Bed front", "Column 1", "Hall")
STATES = {"cold": (18.0, 20.5, 17.0), "mid": (24.0, 25.0, 19.5), "hot": (31.0, 30.0, 21.0)}


@pytest.fixture
def shop(databases):
    url = databases.migrated("sqlite")
    yield Shop(url)
    databases.give_back(url)


def written(folder, label, temperatures):
    """A map whose EXX and EYX grow with the first sensor."""
    lines = [f"# label: {label}", "# measured_at: 2026-03-01T06:00:00Z"]
    lines += [f"# temperature {s}: {t}" for s, t in zip(SENSORS, temperatures, strict=True)]
    lines += ["component,position_mm,error_um"]
    for code, size in (("EXX", 1.0), ("EYX", 0.3)):
        lines += [f"{code},{x},{size * (temperatures[0] - 20.0) * x / 100}" for x in (0, 250, 500)]
    file = folder / f"{label}.csv"
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return str(file)


def test_a_stranger_with_three_files_has_a_live_table(chromium, shop, tmp_path):
    files = [written(tmp_path, label, at) for label, at in STATES.items()]
    broken = tmp_path / "broken.csv"
    text = (tmp_path / "cold.csv").read_text(encoding="utf-8")
    broken.write_text(text.replace("EXX,250", "EXX,many"), encoding="utf-8")
    with shop.open(), opened(chromium, shop) as (page, wrong):
        page.goto(shop.url)
        page.get_by_role("link", name="New machine").click()
        page.wait_for_url("**/new-machine")
        page.get_by_label("Name", exact=True).fill("Halle 2, HMC 630")
        page.get_by_label("Configuration").fill("ZFXY")
        expect(page.locator("#chain li")).to_have_text(["workpiece", "Z", "bed", "X", "Y", "tool"])
        ends = page.locator(".travel[data-axis=x] input")
        ends.nth(0).fill("0")
        ends.nth(1).fill("far")
        page.locator("#store-machine").click()
        expect(page.locator("#wrong-axes")).to_contain_text("got “far”")
        ends.nth(1).fill("500,5")
        for number, name in enumerate(SENSORS, start=1):
            page.get_by_label(f"Name of sensor {number}").fill(name)
        assert barriers(page) == []
        page.locator("#store-machine").click()
        page.wait_for_url("**/machines/halle-2-hmc-630/setup")
        expect(page.locator("#answer h1")).to_have_text("Next: Maps")
        assert "500.5" in page.locator(".travel[data-axis=x] input").nth(1).input_value()

        expect(page.locator("#choose")).to_be_enabled()
        page.set_input_files("#file", [files[0], str(broken), *files[1:]])
        expect(page.locator("#preview")).to_contain_text("cold.csv")
        expect(page.locator("#waiting-files li")).to_have_count(3)
        page.locator("#preview [data-do^=store]").click()
        expect(page.locator("#preview")).to_contain_text("broken.csv was not stored")
        page.get_by_role("button", name="Leave it, next file").click()
        for name in ("mid", "hot"):
            expect(page.locator("#preview")).to_contain_text(f"{name}.csv")
            page.locator("#preview [data-do^=store]").click()
        expect(page.locator("#answer h1")).to_have_text("Next: Sensors")

        page.locator("#propose").click()
        expect(page.locator("[data-changed]")).to_have_count(2)
        page.locator("#assign").click()
        page.locator("#assign-said").get_by_role("button", name="Assign").click()
        expect(page.locator("#answer h1")).to_have_text("Next: Readings")

        temperatures = dict(zip(SENSORS, (26.0, 27.0, 20.0), strict=True))
        now = datetime.now(UTC).isoformat()
        path = "/v1/machines/halle-2-hmc-630/readings"
        shop.send("POST", path, {"time": now, "temperatures_c": temperatures})
        expect(page.locator("#answer h1")).to_have_text("Trusted: 2 components in the live table")
        assert barriers(page) == []
        # The file that was refused is the one complaint of the console.
        assert [one for one in wrong if "422" not in one] == []


def test_a_page_that_is_out_of_date_takes_nothing_back(chromium, shop):
    machine = {"id": "mill", "name": "Mill", "configuration": "XYFZ", "sensors": [{"name": "bed"}]}
    with shop.open(), opened(chromium, shop) as (page, wrong):
        shop.send("POST", "/v1/machines", machine)
        with page.expect_response("**/v1/machines/mill"):
            page.goto(shop.url + "/machines/mill/setup")
        sensors = [{"name": "bed"}, {"name": "column"}]
        shop.send("PATCH", "/v1/machines/mill", {"sensors": sensors})
        page.get_by_label("Name", exact=True).fill("Mill 2")
        page.locator("#store-machine").click()
        said = page.locator("#machine-said")
        expect(said).to_contain_text("The machine was changed elsewhere")
        said.get_by_role("link", name="Show how it is now").click()
        expect(page.get_by_label("Name of sensor 2")).to_have_value("column")
        page.get_by_label("Name", exact=True).fill("Mill 2")
        page.locator("#store-machine").click()
        expect(page.get_by_label("Name of sensor 2")).to_have_value("column")
        expect(page).to_have_title(re.compile("Mill 2"))
        stored = shop.send("GET", "/v1/machines/mill").json()
        assert (stored["name"], len(stored["sensors"])) == ("Mill 2", 2)
        assert wrong == []


@pytest.mark.parametrize("size", SIZES)
def test_the_pages_fit(chromium, shop, tmp_path, size):
    machine = {"id": "mill", "name": "Mill", "configuration": "XYFZ"}
    sensors = [{"name": f"sensor with a long name {i}"} for i in range(12)]
    with shop.open(), opened(chromium, shop, size) as (page, wrong):
        shop.send("POST", "/v1/machines", machine | {"sensors": sensors})
        for path in ("/new-machine", "/machines/mill/setup"):
            page.goto(shop.url + path)
            wider = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
            assert page.evaluate(wider) == 0
            assert barriers(page) == []
        assert wrong == []
