"""The dashboard while PostgreSQL is away: pages say so, and recover by themselves."""

from datetime import UTC, datetime

from tests.api.test_dashboard_browser import PATIENCE_MS, chromium, expect, pytestmark
from tests.faults.test_postgresql import new_cluster, new_service
from tests.faults.writers import ROOM, client_of, temperatures

__all__ = ["chromium", "new_cluster", "new_service", "pytestmark"]

MACHINE = ROOM.removeprefix("/v1")
SAID = {
    "/": ".trouble",
    MACHINE: "#answer",
    f"{MACHINE}/export?controller=siemens-enc-comp": "#answer",
}
"""What goes on from memory, and where it says that it does."""

STANDS = (f"{MACHINE}/maps", f"{MACHINE}/events", f"{MACHINE}/loop", "/fleet")
"""What cannot be read without the database."""


def opened(chromium, address):
    page = chromium.new_page(viewport={"width": 1366, "height": 768})
    page.set_default_timeout(PATIENCE_MS)
    page.goto(address)
    expect(page.locator("#connection")).to_have_text("Live")
    return page


def test_open_pages_say_that_the_database_is_away_and_recover(chromium, new_cluster, new_service):
    cluster = new_cluster()
    service = new_service(cluster.url)
    with client_of(service.url) as client:
        warm = {"time": datetime.now(UTC).isoformat(), "temperatures_c": temperatures(21.0)}
        client.post(f"{ROOM}/readings", json=[warm | {"state": {}}]).raise_for_status()
    pages = {path: opened(chromium, service.url + path) for path in (*SAID, *STANDS)}
    cluster.stop()
    for path, where in SAID.items():
        expect(pages[path].locator(where)).to_contain_text("The database has been away")
        expect(pages[path].locator(".lost")).to_be_hidden()
    for path in STANDS:
        expect(pages[path].locator(".lost")).to_contain_text("the database is away")
    cluster.start()
    for path in SAID:
        expect(pages[path].locator("#answer")).not_to_contain_text("The database")
    for path in STANDS:
        expect(pages[path].locator(".lost")).to_be_hidden()
        expect(pages[path].locator("#connection")).to_have_text("Live")
    for page in pages.values():
        page.close()
