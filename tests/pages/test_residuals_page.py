"""The page of residuals: what it says, what it draws, and no text in it that acts."""

import re
from dataclasses import replace

import pytest
from plotly.graph_objects import Figure

from app.errors import InvalidContent
from app.identification.analysis.residual_curves import ComponentCurves, ResidualCurve
from app.identification.analysis.residual_report import ResidualFigures, Size
from app.identification.residuals.residuals import LeftOut
from app.identification.residuals.summary import Bin
from app.pages.residuals_page import ResidualsHead, residuals_page
from tests.pages.page_reader import Reader

ADDRESS = "/docs-assets/plotly.min.js"
EVIL = "</title></script><script>alert('1')</script><img src=x onerror=alert(2)>"
START_S = 1772323200.0
HEAD = ResidualsHead(
    machine_id="mcfv5050",
    machine_name="MCFV5050LN",
    chain="XYFZ",
    model_version=3,
    verifications=[("night shift", "absolute"), ("week 9", "absolute")],
    first_s=START_S,
    last_s=START_S + 86400.0,
)


def size(component, rms=2.0, unit="µm", **changes):
    plain = Size(component, unit, 40, -0.5, rms, 2 * rms, 1.0, "declared", 0.6, "absolute")
    return replace(plain, **changes)


def one_bin(mean, low=None, high=None, label="", count=20):
    rms = (mean**2 + 0.25) ** 0.5
    words = label or f"{low} to {high}"
    return Bin(words, low, high, count, mean, rms, abs(mean) + 1.0, 0.5)


def over(name, move, low=0.0, high=400.0):
    """A quantity along which the means move from one side to the other."""
    middle = (low + high) / 2
    bins = (one_bin(-move, low, middle), one_bin(move, middle, high))
    return ResidualCurve(name, bins, (low, high), (-move, move))


def direction(axis, move):
    bins = (one_bin(move, label="+"), one_bin(-move, label="−"))
    return ResidualCurve(f"direction {axis}", bins, (1.0, -1.0), (move, -move))


def curves_of(component, move=1.0):
    curves = [
        over("position x [mm]", 0.3 * move),
        over("time [s]", 0.2 * move, START_S, START_S + 86400.0),
        *(over(f"temperature t{i} [°C]", 0.1 * move * i, 20.0, 30.0) for i in range(1, 10)),
        direction("x", 2.0 * move),
    ]
    return ComponentCurves(component, tuple(curves))


NAMES = ["EXX", "EYX", "EZX", "EYY", "EXY", "EZY", "EZZ", "EXZ"]
COMPONENTS = [size(name, 2.0 + i / 10) for i, name in enumerate(NAMES)]
FIGURES = ResidualFigures(
    overall=size("all", 2.36, count=320),
    components=[*COMPONENTS, size("EAX", 9.0, "µrad", repeatability_origin="replicates")],
    summaries=[],
    excluded=[LeftOut("before the first reading", 3)],
)
CURVES = [curves_of(name) for name in ("all", *NAMES)] + [curves_of("EAX")]


def read(figures=FIGURES, curves=CURVES, head=HEAD, **options):
    found = Reader(residuals_page(head, figures, curves, **{"plotly_js": ADDRESS} | options))
    assert found.open == []
    return found


def blocks(found):
    return [
        a for tag, a in found.elements if tag == "section" and "component" in a.get("class", "")
    ]


def test_the_top_says_whose_residuals_and_how_large():
    told = read().told
    for words in (
        "MCFV5050LN",
        "mcfv5050 (XYFZ)",
        "version 3",
        "night shift, week 9",
        "absolute (the instrument's zero is the model's zero)",
        "2026-03-01 00:00 UTC to 2026-03-02 00:00 UTC",
        "values 360 of 9 components",
        "The residuals are 2.36 µm (root mean square), 95 % of them within ±4.72 µm; 60 % exceed "
        "the repeatability of 1.00 µm",
    ):
        assert words in told


def test_the_top_says_what_contradicts_a_stated_number():
    said = "The stated repeatability of 0.3 µm is contradicted."
    assert said in read(replace(FIGURES, contradiction=said)).told
    assert "contradicted" not in read().told


def test_the_table_has_every_component_with_the_largest_first():
    told = read().told.split("By component")[1].split("What they depend on")[0]
    assert re.findall(r"E[A-Z]{2}", told) == [*reversed(NAMES), "EAX"]
    assert "EXZ D_x(z) 40 −0.50 2.70 ±5.40 1.00 (declared) 2.7 60 %" in told
    assert "1.00 (replicates) 9.0" in told


def test_the_six_worst_are_open_and_the_others_can_be_chosen():
    found = read()
    shown = [a for a in blocks(found) if "hidden" not in a]
    assert (len(blocks(found)), len(shown)) == (10, 6)
    assert all("open" in a["class"] for a in shown)
    options = re.findall(r"E[A-Z]{2}: [0-9.]+ ×", found.told)
    assert options[:2] == ["EAX: 9.0 ×", "EXZ: 2.7 ×"]
    assert len(options) == 9
    assert "all lengths together: 2.4 × repeatability" in found.told
    # Each name in the table leads to its plots.
    ids = {a["id"] for a in blocks(found)}
    links = found.attributes("href")
    assert len(links) == 9
    assert {link.removeprefix("#") for link in links} <= ids


@pytest.mark.slow
def test_what_moves_a_component_most_is_drawn_first():
    found = read()
    titles = found.told.split("EXZ D_x(z) 40 values")[1].split("more plot")[0]
    # The direction first, then temperatures; place and time are never among the others.
    assert titles.index("direction x") < titles.index("temperature t9")
    assert "time: 0.18 µm" in titles
    assert "temperature t5" not in titles
    places = [a["id"] for _, a in found.elements if a.get("class") == "plot"]
    assert sorted(places) == sorted(found.figures)
    assert len(found.figures) == 10 * 12
    for figure in found.figures.values():
        Figure(figure)
    first = found.figures["component-0-0"]
    assert first["layout"]["xaxis"]["ticktext"] == ["−", "not stated", "+"]
    assert first["data"][-1]["y"] == [2.0, -2.0]
    assert first["data"][-1]["error_y"]["array"] == [0.5, 0.5]


def test_no_text_acts():
    curves = [replace(c, curves=(over(f"temperature {EVIL} [°C]", 1.0),)) for c in CURVES]
    head = replace(HEAD, machine_name=EVIL, verifications=[("<script>night</script>", "absolute")])
    figures = replace(FIGURES, excluded=[LeftOut(f"{EVIL} could not be believed", 1)])
    found = read(figures, curves, head)
    assert "<script>night</script>" in found.told
    assert not [tag for tag, _ in found.elements if tag == "img"]
    assert sum(tag == "script" for tag, _ in found.elements) == 3
    written = residuals_page(head, figures, curves, plotly_js=ADDRESS)
    assert "<script>alert" not in written
    assert "<script>night" not in written
    assert not re.search(r"(https?:)?//\w", written)


def test_with_its_own_plotly_it_asks_nobody():
    found = read(plotly_js="inline")
    assert found.attributes("src") == []
    assert all(link.startswith("#") for link in found.attributes("href"))
    with pytest.raises(InvalidContent, match="plotly_js"):
        read(plotly_js="javascript:alert(1)")


def test_the_same_answer_gives_the_same_page():
    pages = {residuals_page(HEAD, FIGURES, CURVES, plotly_js=ADDRESS) for _ in range(2)}
    assert len(pages) == 1


def test_no_direction_and_too_many_values_to_be_drawn():
    curve = replace(over("time [s]", 1.0, START_S, START_S + 60.0), at=(), residual=())
    figures = replace(FIGURES, components=[size("EXX")], overall=size("all"))
    found = read(figures, [ComponentCurves("EXX", (curve,))])
    assert "direction" not in found.told
    assert "too many to draw them one by one" in found.told
    (figure,) = found.figures.values()
    assert [trace["name"] for trace in figure["data"]] == ["mean and standard deviation"]
    # Where everything is shown there is nothing to choose.
    assert not [a for tag, a in found.elements if tag == "select"]


def test_one_value_alone():
    single = size("EXX", 3.0, count=1, mean=-3.0, repeatability=3.0, share_above_repeatability=0.0)
    figures = replace(FIGURES, components=[single], overall=replace(single, component="all"))
    head = replace(HEAD, last_s=HEAD.first_s)
    found = read(replace(figures, excluded=[]), [ComponentCurves("EXX", ())], head)
    assert "The one residual that is a length is −3.00 µm." in found.told
    assert "values 1 of 1 component" in found.told
    assert "Not drawn, because there were too few values or nothing changed: EXX." in found.told
    assert "1 value could be compared with the model; none was left out" in found.told
    assert found.figures == {}
    unknown = replace(single, repeatability=None, share_above_repeatability=None)
    assert "– (declared)" in read(replace(figures, components=[unknown]), []).told


def test_angles_alone():
    angle = size("EAX", 9.0, "µrad")
    found = read(replace(FIGURES, components=[angle], overall=None), [curves_of("EAX")])
    assert "40 values, none of them a length" in found.told
    assert "direction x: 2.00 µrad" in found.told


def test_what_was_left_out_is_counted_with_its_reason():
    told = read().told
    assert "360 values could be compared with the model; 3 values could not" in told
    assert "before the first reading 3" in told


def test_a_value_far_out_does_not_press_the_others_flat():
    wild = over("position x [mm]", 1.0)
    wild = replace(wild, at=(*wild.at, 200.0), residual=(*wild.residual, 500.0))
    figures = replace(FIGURES, components=[size("EXX")], overall=size("all"))
    found = read(figures, [ComponentCurves("EXX", (wild,))])
    assert "1 value outside the plots" in found.told
    assert found.figures["component-0-0"]["layout"]["yaxis"]["range"][1] < 20.0
