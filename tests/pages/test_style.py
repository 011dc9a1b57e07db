"""The style that all pages share: every colour has a value, light and dark, that can be read."""

import json
import re
from importlib.resources import files

import pytest
from jinja2 import UndefinedError

from app.pages.environment import render
from app.pages.picture_page import picture_page
from tests.pages.example_analyses import UNEXPLAINED
from tests.pages.test_analysis_report import written
from tests.pictures.example_pictures import picture

TEMPLATES = files("app.pages") / "templates"
STYLE = (TEMPLATES / "style.css").read_text("utf-8")
_DEFINED = re.compile(r"--([\w-]+): (#\w+|rgba\([^)]*\)|[^;]+);")
LIGHT, DARK = (
    dict(_DEFINED.findall(part)) for part in STYLE.split("html {")[0].split("@media screen", 1)
)


def test_every_colour_that_is_used_is_defined():
    pages = written(UNEXPLAINED), picture_page(picture(), plotly_js="/p.js")
    used = {name for page in pages for name in re.findall(r"var\(--([\w-]+)\)", page)}
    assert len(used) > 20
    assert used <= set(LIGHT)


def test_every_colour_has_a_dark_value():
    assert set(LIGHT) - set(DARK) == {"font"}
    assert set(DARK) <= set(LIGHT)
    assert not {name for name in DARK if DARK[name] == LIGHT[name] and name != "length-4"}


def luminance(colour):
    """Relative luminance as WCAG 2.2 defines it."""
    short = colour.removeprefix("#")
    pairs = [c * 2 for c in short] if len(short) == 3 else re.findall("..", short)
    parts = [int(pair, 16) / 255 for pair in pairs]
    linear = [p / 12.92 if p <= 0.04045 else ((p + 0.055) / 1.055) ** 2.4 for p in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one, other):
    dark, light = sorted(map(luminance, (one, other)))
    return (light + 0.05) / (dark + 0.05)


@pytest.mark.parametrize("colours", [LIGHT, DARK], ids=["light", "dark"])
@pytest.mark.parametrize(
    ("text", "behind"),
    [
        *((name, "paper") for name in ("ink", "quiet", "strong-quiet")),
        *(("ink", "soft"), ("calm", "soft"), ("care", "care-paper")),
    ],
)
def test_text_can_be_read(colours, text, behind):
    # WCAG 2.2, 1.4.3: 4.5 for text.
    assert contrast(colours[text], colours[behind]) >= 4.5


@pytest.mark.parametrize("colours", [LIGHT, DARK], ids=["light", "dark"])
def test_colour_is_for_what_asks_somebody_to_act(colours):
    """What is found, before and after are told apart by shape: grey, hardly more blue than red."""
    for name in ("before", "after", "calm", "ink"):
        red, green, blue = (int(part, 16) for part in re.findall("..", colours[name][1:]))
        assert red <= green <= blue <= red + 60
        assert name == "calm" or blue <= red + 30


@pytest.mark.parametrize("colours", [LIGHT, DARK], ids=["light", "dark"])
def test_marks_can_be_seen(colours):
    # WCAG 2.2, 1.4.11: 3 for what is drawn.
    for mark in ("before", "after", "axis"):
        assert contrast(colours[mark], colours["paper"]) >= 3.0


def test_a_name_that_nobody_gave_is_an_error():
    with pytest.raises(UndefinedError, match="drawings"):
        render("picture.html", plotly_js="/p.js", title="", subtitle="", warnings=[], address="")


def test_figures_name_colours_of_the_style_alone():
    page = picture_page(picture(), plotly_js="/p.js")
    figures = page.split('id="figures">')[1].split("</script>")[0]
    (drawn,) = json.loads(figures).values()
    assert not re.findall(r"#[0-9a-f]{6}", json.dumps(drawn))


DASHBOARD = TEMPLATES / "dashboard"
_NEITHER_DARK_NOR_LIGHT = re.compile(r"\b(black|white)\b(?!-space)", re.IGNORECASE)


@pytest.mark.parametrize("page", sorted(p.name for p in DASHBOARD.iterdir()))
def test_no_page_names_a_colour_that_is_another_in_the_dark(page):
    """What is black on paper is white in the dark, and in colours that a person has set."""
    words = re.sub(r"{[%{].*?[%}]}|<[^>]*>", " ", (DASHBOARD / page).read_text("utf-8"))
    assert not _NEITHER_DARK_NOR_LIGHT.findall(words)
