"""The dashboard's pages as a browser without JavaScript gets them."""

import re
from datetime import timedelta
from html.parser import HTMLParser

import pytest

from tests.effect_examples import SPEED, adopt
from tests.service_examples import (
    MACHINE,
    ROOM,
    START,
    error_map,
    furnish,
    problem,
    reading,
)

pytestmark = pytest.mark.anyio

NOW = "/machines/mcfv5050"
EVIL = '</h1><script>alert(1)</script><img src=x onerror=alert(2)> & "Mill"'


class Texts(HTMLParser):
    """What a reader sees of a page, and the addresses that it names."""

    def __init__(self, page):
        super().__init__(convert_charrefs=True)
        self.said, self.addresses, self.tags, self.ids, self._silent = [], [], [], [], False
        self.lines = []
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.lines += [value for name, value in attrs if tag == "polyline" and name == "class"]
        self.ids += [value for name, value in attrs if name == "id"]
        self._silent = tag in ("script", "style")
        self.addresses += [value for name, value in attrs if name in ("src", "href")]
        self.said += [value for name, value in attrs if name == "aria-label" and value]

    def handle_data(self, data):
        if not self._silent:
            self.said.append(data)

    @property
    def text(self):
        return " ".join(" ".join(self.said).split())


async def shown(client, path):
    answer = await client.get(path)
    assert answer.status_code == 200, answer.text
    assert answer.headers["content-type"].startswith("text/html")
    assert "script-src 'self';" in answer.headers["content-security-policy"]
    assert answer.headers["cache-control"] == "no-store"
    return Texts(answer.text)


async def feed(client, *readings):
    answer = await client.post(f"{ROOM}/readings", json=list(readings))
    assert answer.status_code == 201, answer.text


async def test_all_machines_and_the_sentence_that_comes_first(client):
    await client.post("/v1/machines", json=MACHINE | {"id": "second", "name": "VMC-2"})
    await feed(client, reading(START, 31.4))
    page = await shown(client, "/")
    assert "0 of 2 can be trusted. VMC-2 cannot: no model. 1 is limited." in page.text
    # The worst stands first, whatever its name.
    assert page.text.index("VMC-2 second") < page.text.index("MCFV5050LN mcfv5050")
    assert "x-middle is 1.40 K above the hottest map: 3 components are held at Run #6." in page.text
    assert "z-column" not in page.text.split("Compensation")[0]
    assert "none of this version" in page.text
    limited = await shown(client, "/?only=limited")
    assert "VMC-2 second" not in limited.text
    assert "MCFV5050LN mcfv5050" in limited.text
    assert "No machine is service." in (await shown(client, "/?only=service")).text
    problem(await client.get("/?only=good"), 422)


async def test_an_empty_shop_says_what_to_do(empty):
    page = await shown(empty, "/")
    assert "No machine yet." in page.text
    assert "thermap import machine.json" in page.text


async def test_one_machine_has_the_verdict_the_temperatures_and_the_table(client, clock):
    await feed(client, reading(START - timedelta(minutes=30), 29.0), reading(START, 31.4))
    status = (await client.get(f"{ROOM}/status")).json()
    page = await shown(client, NOW)
    assert "Limited" in page.text
    assert all(sentence in page.text for sentence in status["sentences"])
    assert "1.40 K over" in page.text
    assert "EXX: compensation now, largest −50.0 µm at X 500; maps Run #3 ↔ Run #6" in page.text
    assert "now = Run #6 (held) ; amber: the trend" in page.text
    assert "EXX, µm 0.0 −10.0 −50.0" in page.text
    assert "SXY, µm/m +30.0" in page.text
    assert "Uncertainty: not stated in the maps." in page.text
    clock.advance(3600)
    page = await shown(client, NOW)
    assert "Not trusted" in page.text
    assert "No reading since 06:00 UTC." in page.text


async def test_the_address_chooses_the_component_that_is_drawn(client):
    await feed(client, reading(START, 27.0))
    assert "X axis EXX in µm" in (await shown(client, NOW)).text
    page = await shown(client, f"{NOW}?x=EBX")
    assert "X axis EBX in µrad" in page.text
    assert "?x=EBX&z=EZZ" in page.addresses
    assert "X axis EXX in µm" in (await shown(client, f"{NOW}?x=nothing")).text


async def test_a_machine_without_a_table_says_why(client, empty):
    assert "There is no table, for the reason above." in (await shown(client, NOW)).text
    await empty.post("/v1/machines", json=MACHINE)
    assert "No component has maps of two thermal states" in (await shown(empty, NOW)).text
    problem(await empty.get("/machines/another"), 404)


async def test_an_adopted_effect_is_named_beside_its_curve(client, app):
    adopt(app, SPEED)
    await feed(client, reading(START, 27.0, state={"spindle_rpm": 4000.0}))
    page = await shown(client, NOW)
    assert SPEED.kind in page.text
    assert "Uncertainty: not known with an adopted effect." in page.text


async def test_names_are_shown_letter_by_letter_and_no_other_host_is_asked(empty):
    machine = MACHINE | {"name": EVIL}
    assert (await empty.post("/v1/machines", json=machine)).status_code == 201
    for path in ("/", NOW):
        page = await shown(empty, path)
        assert EVIL in page.text
        assert "img" not in page.tags
        assert page.tags.count("script") == 3
        assert all(re.match(r"[/?#]|data:,$", address) for address in page.addresses)


async def test_pages_are_light(client):
    await feed(client, reading(START, 27.0))
    assets = [
        await client.get(f"/assets/{n}")
        for n in ("dashboard.css", "live.js", "keys.js", "theme.js")
    ]
    assert {answer.status_code for answer in assets} == {200}
    page = await client.get(NOW)
    assert sum(len(answer.content) for answer in (page, *assets)) < 150_000


async def test_the_log_of_a_machine_on_a_page(client):
    evil = await client.patch(ROOM, json={"name": EVIL})
    assert evil.status_code == 200
    page = await shown(client, f"{NOW}/events")
    assert "No active alarms." in page.text
    assert "v3 active: map 'Run #6' stored" in page.text
    assert "settings changed: name" in page.text
    assert "img" not in page.tags
    models = await shown(client, f"{NOW}/events?kind=model")
    assert "settings changed" not in models.text
    alarms = await shown(client, f"{NOW}/events?kind=alarm")
    assert "There is no event of this kind." in alarms.text
    now = await shown(client, NOW)
    assert "settings changed: name" in now.text
    assert f"{NOW}/events" in now.addresses


async def test_the_fleet_says_why_a_machine_is_not_judged(client):
    page = await shown(client, "/fleet")
    assert "No machine can be analysed" in page.text
    assert "no check of it is stored" in page.text
    assert "Fleet" in (await shown(client, "/")).text
    problem(await client.get("/fleet?effects=guess"), 422)


async def test_an_unknown_machine_is_a_page_to_a_browser_and_a_problem_to_a_program(client):
    page = await client.get("/machines/another", headers={"Accept": "text/html,*/*;q=0.8"})
    assert page.status_code == 404
    assert page.headers["content-type"].startswith("text/html")
    assert "There is no machine &#39;another&#39;; there are: mcfv5050." in page.text
    problem(await client.get("/machines/another"), 404)
    problem(await client.get("/v1/machines/another", headers={"Accept": "text/html"}), 404)


async def test_maps_whose_components_follow_no_sensor_are_not_called_too_few(empty):
    """The maps are there; what is missing is who follows which sensor."""
    sensors = [{"name": name, "max_age_s": 120} for name in ("probe", "other")]
    await furnish(empty, MACHINE | {"sensors": sensors}, {})
    for label, t_c in (("cold", 20.0), ("warm", 30.0)):
        content = error_map(label, t_c, temperatures_c={"probe": t_c, "other": t_c})
        assert (await empty.post(f"{ROOM}/error-maps", json=content)).status_code == 201
    page = await shown(empty, NOW)
    words = "There is no compensation table: no sensor is assigned to EXX, EBX, EZZ, SXY."
    assert words in page.text, page.text


async def test_a_single_reading_is_drawn_and_an_old_one_looks_old(client, clock):
    await feed(client, reading(START, 27.0))
    assert 'class="dot"' in (await client.get(NOW)).text
    clock.advance(3600)
    page = (await client.get("/")).text
    assert '<b class="old">' in page
    assert "x-middle, 1 h 0 min old" in page


async def test_files_of_a_table_that_stands_still_say_so_before_they_are_made(client, clock):
    await feed(client, reading(START, 27.0))
    assert "Files hold that table." not in (await shown(client, f"{NOW}/export")).text
    clock.advance(3600)
    page = await shown(client, f"{NOW}/export")
    assert "Not trusted: No reading since 06:00 UTC." in page.text
    assert "latest reading, 1 h 0 min old" in page.text


async def test_what_is_larger_approached_backward_is_the_largest(client, clock):
    """EXX is 3 µm to the other side of its forward errors where it is approached backward."""
    for label, t_c in (("both ways 1", 22.0), ("both ways 2", 28.0)):
        errors = [0.0, t_c - 20.0, 5 * (t_c - 20.0)]
        table = {
            "component": "EXX",
            "positions_mm": [0, 100, 500],
            "errors_um": errors,
            "backward_errors_um": [e + 300.0 for e in errors],
        }
        stored = await client.post(
            f"{ROOM}/error-maps", json=error_map(label, t_c, components=[table])
        )
        assert stored.status_code == 201, stored.text
    await feed(client, reading(clock(), 25.0))
    status = (await client.get(f"{ROOM}/status")).json()
    largest = status["largest"]
    assert (largest["component"], largest["value"], largest["is_backward"]) == ("EXX", -325.0, True)
    page = await shown(client, "/machines/mcfv5050")
    assert "−325.0 µm at X 500 backward" in page.text
    assert "EXX backward, µm" in page.text
    assert "thin: backward" in page.text
    both = [line for line in page.lines if line.split()[0] == "now"]
    assert "now backward" in both
    preview = await shown(client, "/machines/mcfv5050/maps/preview/3")
    assert "Thin: approached backward." in preview.text
    assert {"before", "before backward"} <= set(preview.lines)
