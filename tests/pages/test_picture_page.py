"""The page and the JSON of a picture: complete, strict, and with no text that acts."""

import html
import json
import os
import re
import shutil
import subprocess
import sys
from html.parser import HTMLParser

import numpy as np
import plotly.io
import pytest

from app.errors import InvalidContent
from app.pages.picture_page import picture_page as page
from app.pictures.figure_json import figure_json
from app.pictures.layout import Remarks
from tests.geometry.example_fields import NONRIGID, TOOL, random_field
from tests.pictures.example_pictures import CUBE, VOLUMES, picture, random_picture

ADDRESS = "/docs-assets/plotly.min.js"
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
EVIL = "</title></script><script>alert('1')</script><img src=x onerror=alert(2)> & \"Mill\""


class Reader(HTMLParser):
    """Reads a page as a browser does: its elements, and the texts in them."""

    def __init__(self, written):
        super().__init__(convert_charrefs=True)
        self.elements, self.texts, self._open = [], {}, []
        self.feed(written)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        self._open.append(tag)

    def handle_endtag(self, tag):
        while self._open and self._open.pop() != tag:
            pass

    def handle_data(self, data):
        if self._open:
            self.texts[self._open[-1]] = self.texts.get(self._open[-1], "") + data

    def attributes(self, name):
        return [attrs[name] for _, attrs in self.elements if name in attrs]


def test_a_page_with_its_own_plotly_asks_nobody():
    read = Reader(page(picture(), plotly_js="inline"))
    assert read.attributes("src") == []
    assert read.attributes("href") == []
    assert "Plotly.newPlot" in read.texts["script"]
    assert "plotly.js v" in read.texts["script"]
    assert "@import" not in read.texts["style"]
    assert "url(" not in read.texts["style"]


def test_a_page_with_an_address_is_small_and_loads_plotly_from_there():
    written = page(picture(), plotly_js=ADDRESS)
    assert Reader(written).attributes("src") == [ADDRESS]
    assert len(written) < 300_000


@pytest.mark.slow
@pytest.mark.parametrize(
    "address",
    [
        "https://plotly.example:8443/a/plotly.min.js?v=4",
        "http://x/p.js",
        "./p.js",
        "../p.js",
        "p.js",
    ],
)
def test_addresses_over_http_or_beside_the_page_will_do(address):
    assert Reader(page(picture(), plotly_js=address)).attributes("src") == [address]


@pytest.mark.slow
@pytest.mark.parametrize(
    "address",
    ["", "javascript:alert(1)", "data:text/javascript,1", "//x/p.js", "file:///p.js", "a b"],
)
def test_other_addresses_are_refused(address):
    with pytest.raises(InvalidContent, match="plotly_js: expected `inline` or the address"):
        page(picture(), plotly_js=address)


def test_an_address_cannot_leave_its_attribute():
    address = 'https://x/p.js"></script><script>alert(1)</script>'
    read = Reader(page(picture(), plotly_js=address))
    assert read.attributes("src") == [address]
    assert "alert" not in read.texts["script"]


@pytest.mark.slow
def test_texts_of_users_are_shown_and_do_not_act():
    plain = Reader(page(picture(), plotly_js=ADDRESS))
    read = Reader(page(picture(title=EVIL, subtitle=EVIL), plotly_js=ADDRESS))
    names = [tag for tag, _ in read.elements]
    assert names.count("script") == [tag for tag, _ in plain.elements].count("script")
    assert "img" not in names
    assert read.texts["h1"] == EVIL
    assert read.texts["title"] == EVIL
    assert EVIL in read.texts["p"]
    assert "<" not in read.texts["script"].split("const config")[0]


@pytest.mark.slow
def test_the_page_says_what_is_drawn():
    figure = picture(
        title="Mill 7", subtitle="XYFZ, tool offset (0, 0, 160) mm", exaggeration=500.0
    )
    read = Reader(page(figure, plotly_js=ADDRESS))
    assert read.texts["h1"] == "Mill 7"
    assert read.texts["p"].startswith("XYFZ, tool offset (0, 0, 160) mm")
    assert read.texts["footer"] == figure.layout.meta["drawn"]
    assert "drawn 500 times larger" in read.texts["footer"]


REMARKS = Remarks(False, ["spindle is stale", f"{EVIL} held"], ["ECZ"])


def test_what_is_said_against_the_errors_stands_on_the_page_and_in_the_figure():
    figure = picture(remarks=REMARKS)
    written = page(figure, plotly_js=ADDRESS)
    items = re.findall("<li>(.*?)</li>", written)
    assert [html.unescape(item) for item in items] == ["not complete", *REMARKS.warnings]
    assert "<img" not in written
    assert written.index('aria-label="warnings"') < written.index("<main>")
    meta = json.loads(figure_json(figure))["layout"]["meta"]
    assert (meta["complete"], meta["warnings"]) == (False, REMARKS.warnings)
    assert meta["counted_as_zero"] == ["ECZ"]
    shown = figure.layout.title.subtitle.text
    assert "! spindle is stale" in shown
    assert "<img" not in shown


def test_many_warnings_leave_room_for_the_drawing():
    many = [f"sensor {i} is stale" for i in range(40)]
    figure = picture(remarks=Remarks(True, many))
    assert "sensor 0 is stale" in figure.layout.title.subtitle.text
    assert "40 remarks in all" in figure.layout.title.subtitle.text
    assert figure.layout.margin.t < 300
    assert page(figure, plotly_js=ADDRESS).count("<li>") == 40


def test_a_page_about_which_nothing_is_to_be_said_says_nothing():
    figure = picture()
    assert 'aria-label="warnings"' not in page(figure, plotly_js=ADDRESS)
    assert (figure.layout.meta["complete"], len(figure.layout.meta["warnings"])) == (True, 0)


@pytest.mark.parametrize("plotly_js", [ADDRESS, "inline"])
def test_where_no_script_runs_a_sentence_says_why_nothing_is_drawn(plotly_js):
    read = Reader(page(picture(), plotly_js=plotly_js))
    assert "The picture is not drawn yet" in read.texts["p"]
    assert (ADDRESS in read.texts["p"]) == (plotly_js == ADDRESS)


@pytest.mark.slow
@pytest.mark.skipif(
    CHROMIUM is None and "THERMAP_REQUIRE_SERVICES" not in os.environ,
    reason="there is no Chromium",
)
@pytest.mark.parametrize(("plotly_js", "is_drawn"), [("inline", True), (ADDRESS, False)])
def test_a_browser_draws_the_file_or_shows_the_sentence(tmp_path, plotly_js, is_drawn):
    file = tmp_path / "picture.html"
    file.write_text(page(picture(), plotly_js=plotly_js), encoding="utf-8")
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--enable-unsafe-swiftshader"]
    options += [f"--user-data-dir={tmp_path}/profile", "--virtual-time-budget=20000", "--dump-dom"]
    found = subprocess.run(
        [str(CHROMIUM), *options, file.as_uri()], capture_output=True, text=True, check=True
    )
    shown = Reader(found.stdout)
    assert ("not-drawn" in shown.attributes("id")) != is_drawn
    assert any("js-plotly-plot" in kind for kind in shown.attributes("class")) == is_drawn


@pytest.mark.slow
def test_the_page_changes_no_figure_and_is_the_same_each_time():
    figure = picture()
    before = figure.to_json()
    assert page(figure, plotly_js=ADDRESS) == page(figure, plotly_js=ADDRESS)
    assert figure.to_json() == before


@pytest.mark.slow
@pytest.mark.parametrize("name", VOLUMES)
def test_json_is_strict_and_reads_back_as_the_same_figure(name):
    figure = random_picture(VOLUMES[name])
    written = figure_json(figure)

    def refuse(constant):
        pytest.fail(f"{constant} is no JSON")

    assert set(json.loads(written, parse_constant=refuse)) == {"data", "layout"}
    assert plotly.io.from_json(written).to_dict() == figure.to_dict()


def test_json_of_the_default_picture_is_small():
    # Eight nodes of its own for every one of the 18 tables: more than a map has.
    field = random_field(kinds=NONRIGID, seed=0)
    assert len(figure_json(picture(field, CUBE, TOOL)).encode()) < 300_000


def test_numbers_are_short():
    figure = random_picture(CUBE)
    numbers = [v for t in figure.data for a in "xyz" for v in t[a] if v is not None]
    assert max(len(repr(float(number))) for number in numbers) <= len("-1234.56")
    assert np.abs(numbers).max() < 1000.0


@pytest.mark.slow
def test_plotly_is_imported_only_for_a_picture():
    program = (
        "import sys; import app.pages.picture_page; import app.pictures.work_volume_picture; "
        "sys.exit('plotly' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0
