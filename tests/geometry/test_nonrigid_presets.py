"""The two machines that are not rigid, against 8.19-8.54 as printed."""

import numpy as np
import pytest

from app.errors import UnknownThing
from app.geometry.chain import Chain
from app.geometry.components import COMPONENTS, Kind, parse_component
from app.geometry.nonrigid_presets import NONRIGID_PRESETS, find_preset
from app.geometry.volumetric_error import volumetric_error

# Equation by equation as it is printed: D and A are the parents, a superscript a slope.
PRINTED = {
    "horizontal-counterweight": """
        D_x(x) + D_x^y(x)y   D_y(x) + D_y^y(x)y   D_z(x) + D_z^y(x)y
        D_x(y)               D_y(y)               D_z(y)
        D_x(z)               D_y(z)               D_z(z)
        A_x(x) + A_x^y(x)y   A_y(x) + A_y^y(x)y   A_z(x)
        A_x(y)               A_y(y)               A_z(y)
        A_x(z)               A_y(z)               A_z(z)
    """,
    "large-gantry": """
        D_x(x)               D_y(x)               D_z(x)
        D_x(y) + D_x^x(y)x   D_y(y) + D_y^x(y)x   D_z(y) + D_z^x(y)x
        D_x(z) + D_x^x(z)x   D_y(z) + D_y^x(z)x   D_z(z) + D_z^x(z)x
        A_x(x)               A_y(x)               A_z(x)
        A_x(y) + A_x^x(y)x   A_y(y) + A_y^x(y)x   A_z(y)
        A_x(z) + A_x^x(z)x   A_y(z) + A_y^x(z)x   A_z(z)
    """,
}


def printed_equations(name):
    """Parent to its slope and the coordinate that it multiplies, or to None."""
    text = PRINTED[name].replace(" + ", "+").split()
    return {parent: slope or None for parent, _, slope in (term.partition("+") for term in text)}


@pytest.mark.parametrize("name", PRINTED)
def test_all_eighteen_equations_are_there(name):
    parents = {parse_component(parent)[0].code for parent in printed_equations(name)}
    assert parents == {c for c, x in COMPONENTS.items() if x.axis and x.kind is not Kind.SLOPE}


@pytest.mark.parametrize(
    ("name", "configuration", "additional"),
    [("horizontal-counterweight", "XFYZ", 5), ("large-gantry", "XYFZ", 10)],
)
def test_a_preset_has_the_slopes_that_are_printed(name, configuration, additional):
    """ "There are five additional nonrigid-body errors", "there are 10"."""
    preset = find_preset(name)
    slopes = [slope[:-1] for slope in printed_equations(name).values() if slope]
    assert set(preset.slopes) == {parse_component(slope)[0].code for slope in slopes}
    assert len(preset.slopes) == len(slopes) == additional
    assert preset.configuration == configuration
    assert all(COMPONENTS[code].kind is Kind.SLOPE for code in preset.slopes)


@pytest.mark.parametrize("name", PRINTED)
def test_the_printed_equations_put_into_the_rigid_body_are_the_rule_with_slopes(name):
    """D_x(x)(y, z) = D_x(x) + D_x^y(x) y, and so on, takes the parent's place."""
    rng = np.random.default_rng(819)
    chain = Chain.parse(find_preset(name).configuration)
    for point in rng.uniform(-2000.0, 2000.0, (20, 3)):
        values, substituted = {}, {}
        for parent, slope in printed_equations(name).items():
            code = parse_component(parent)[0].code
            values[code] = substituted[code] = rng.normal(scale=10.0)
            if slope:
                slope_code = parse_component(slope[:-1])[0].code
                values[slope_code] = rng.normal(scale=10.0)
                substituted[code] += values[slope_code] * point["xyz".index(slope[-1])] / 1000.0
        tool = rng.uniform(-200.0, 200.0, 3)
        by_slopes = volumetric_error(chain, values, point, tool)
        by_parents = volumetric_error(chain, substituted, point, tool)
        for found, expected in zip(by_slopes, by_parents, strict=True):
            np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize(
    ("name", "along", "axes", "negligible"),
    [
        (
            "horizontal-counterweight", "y", "xz",
            "D_x^y(z) D_y^y(z) D_z^y(z) A_z^y(x) A_x^y(z) A_y^y(z) A_z^y(z)",
        ),
        ("large-gantry", "x", "yz", "A_z^x(y) A_z^x(z)"),
    ],
)  # fmt: skip
def test_a_preset_and_what_the_text_neglects_are_all_slopes_of_their_direction(
    name, along, axes, negligible
):
    """Each of twelve once: below 8.36 the second A_y^y(z)y must be A_z^y(z)y."""
    found = [*find_preset(name).slopes, *(parse_component(n)[0].code for n in negligible.split())]
    slopes = [c for c in COMPONENTS.values() if c.kind is Kind.SLOPE and c.times == along]
    assert sorted(found) == sorted(c.code for c in slopes if c.axis in tuple(axes))
    assert len(found) == 12


def test_presets_are_found_by_name_and_an_unknown_one_is_refused_with_the_list():
    assert [find_preset(name).name for name in NONRIGID_PRESETS] == list(PRINTED)
    with pytest.raises(UnknownThing, match=r"\(horizontal-counterweight, large-gantry\), got 'x'"):
        find_preset("x")
