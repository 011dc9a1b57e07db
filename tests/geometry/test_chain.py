"""The chain of axes against the table of section 3 and the chapter's sentences (8.1.3.3)."""

from itertools import permutations

import pytest

from app.errors import InvalidContent
from app.geometry.chain import Chain

# C. Wang's four and Hsu's fifth configuration; "-" for none.
ACTS_ON = {
    "FXYZ": {"x": "yz", "y": "z", "z": "-"},
    "XFYZ": {"x": "xyz", "y": "z", "z": "-"},
    "XYFZ": {"x": "xz", "y": "xyz", "z": "-"},
    "XYZF": {"x": "x", "y": "xy", "z": "xyz"},
    "FYXZ": {"x": "z", "y": "xz", "z": "-"},
}


@pytest.mark.parametrize(
    ("text", "axis", "coordinates"),
    [(text, axis, c) for text, row in ACTS_ON.items() for axis, c in row.items()],
)
def test_a_rotation_acts_on_the_coordinates_of_the_table(text, axis, coordinates):
    assert Chain.parse(text).acts_on(axis) == frozenset(coordinates.replace("-", ""))


@pytest.mark.parametrize("text", ["".join(p) for p in permutations("XYZF")])
def test_every_order_is_read_and_written_alike(text):
    chain = Chain.parse(text)
    assert chain.text == text
    assert sorted(chain.axes) == ["x", "y", "z"]
    assert Chain.parse(text.lower()) == chain
    # The last axis of the tool carries nothing but the tool.
    if chain.tool:
        assert chain.acts_on(chain.tool[-1]) == frozenset()
    # The last axis of the workpiece turns everything.
    if chain.workpiece:
        assert chain.acts_on(chain.workpiece[-1]) == frozenset("xyz")


def test_the_sides_are_told_apart_from_the_base_outward():
    chain = Chain.parse("YXFZ")
    assert (chain.workpiece, chain.tool) == (("y", "x"), ("z",))


def test_a_lathe_has_two_axes():
    lathe = Chain.parse("FZX")
    assert lathe.axes == ("z", "x")
    assert lathe.acts_on("z") == {"x"}
    assert lathe.acts_on("x") == frozenset()


@pytest.mark.parametrize("text", ["", "F", "XYZ", "XYFZF", "XXFZ", "XYFA", "X Y F Z", "XYFZC"])
def test_what_is_no_chain_is_refused_with_what_would_be_one(text):
    with pytest.raises(InvalidContent, match=r"expected the axes X, Y, Z .* one F") as refusal:
        Chain.parse(text)
    assert f"got {text!r}" in refusal.value.detail
    assert refusal.value.errors[0].field == "configuration"


def test_a_rotary_axis_in_a_chain_is_told_that_it_does_not_belong_there():
    with pytest.raises(InvalidContent, match="got 'XYFZC': rotary axes do not belong in it"):
        Chain.parse("XYFZC")
