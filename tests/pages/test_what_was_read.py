"""What was read of a file is shown before it is stored: every fact, every component."""

import re

import pytest

from app.pages.what_was_read import FINENESS, SIZE, read_of_map, read_of_verification
from app.services.observations import VerificationRequest
from app.thermal.error_map import ERROR_MAP

AT = "2026-03-01T06:00:00Z"


def the_map(**changes):
    body = {
        "label": "cold",
        "measured_at": AT,
        "temperatures_c": {"bed": 20.5, "column": 21.0},
        "components": [
            {
                "component": "EXX",
                "positions_mm": [-100, 0, 300],
                "errors_um": [0, 2.5, -1.25],
                "backward_errors_um": [1, 3, 0],
            },
            {"component": "SXY", "value_um_per_m": -12.1},
        ],
    } | changes
    return read_of_map(ERROR_MAP.validate_python(body))


def the_check(observations, **head):
    body = {"label": "night", "observations": [{"time": AT, **one} for one in observations], **head}
    return read_of_verification(VerificationRequest.model_validate(body).to_verification())


def test_a_map():
    assert list(the_map().lines()) == [
        "map ‘cold’; measured 2026-03-01 06:00:00 UTC; temperatures bed 20.50 °C, column 21.00 °C; "
        "repeatability not stated; instrument not stated",
        "EXX: −1.25 to 3.00 µm over −100 to 300 mm, 6 values, +, −",
        "SXY: −12.10 µm/m, 1 value",
    ]
    assert dict(the_map(repeatability_um=0.5).facts)["repeatability"] == "0.5 µm"


@pytest.mark.parametrize(
    ("datum", "words"),
    [("absolute", "absolute: the model's own"), ("first", "first: each"), ("free", "free: unkn")],
)
def test_a_check_says_its_zero_repeatability_units_and_directions(datum, words):
    seen = [
        {"component": "EXX", "position_mm": 100, "direction": "+", "measured_um": 1.5},
        {"component": "EXX", "position_mm": 300, "measured_um": -2.5, "setup": "b"},
        {"component": "EBX", "position_mm": 300, "direction": "-", "measured_urad": 4},
        {"point_mm": [1, 2, 3], "measured_um": [7, 8, 9], "direction": {"y": "-"}},
    ]
    read = the_check(seen, datum=datum, repeatability_um=0.5)
    facts = dict(read.facts)
    assert facts["zero"].startswith(words)
    assert (facts["repeatability"], facts["set-ups"]) == ("0.5 µm", "b")
    assert [one.words for one in read.components] == [
        "EBX: 4.00 µrad over 300 to 300 mm, 1 value, −",
        "EXX: −2.50 to 1.50 µm over 100 to 300 mm, 2 values, +, direction not stated",
        "points x: 7.00 µm over 1 to 1 mm, 1 value, direction not stated",
        "points y: 8.00 µm over 2 to 2 mm, 1 value, −",
        "points z: 9.00 µm over 3 to 3 mm, 1 value, direction not stated",
    ]


def test_a_plot_has_each_value_at_its_place_and_is_small_however_many_there_are():
    (exx, _) = the_map().components
    zero = FINENESS * round(SIZE / FINENESS * 3.0 / 4.25)
    assert f'<polyline class="now" points="0,{zero} 250,120 1000,1000"/>' in exx.svg
    many = [
        {"component": "EXX", "position_mm": i % 97, "measured_um": i % 13} for i in range(4_000)
    ]
    (one,) = the_check(many).components
    assert one.count == 4_000
    assert len(re.findall(r"\d+,\d+", one.svg)) <= 97 * 13
