"""A component is needed if, and only if, it changes the answer."""

from itertools import islice, permutations, product

import numpy as np
import pytest

from app.geometry.chain import Chain
from app.geometry.components import COMPONENTS, Kind
from app.geometry.measuring_line import MeasuringLine
from app.geometry.needed_components import needed_components
from app.geometry.volumetric_error import volumetric_error
from tests.geometry.example_fields import LINES

CHAINS = ["".join(p) for p in permutations("XYZF")]
POINT = (307.0, -211.0, 503.0)
TOOLS = [(0.0, 0.0, 0.0), (0.0, 0.0, 160.0), (17.0, 0.0, 0.0), (17.0, -29.0, 163.0)]
RIGID = [code for code, c in COMPONENTS.items() if c.kind not in (Kind.SLOPE, Kind.ROTARY_LOCATION)]


LINES_OF = [None, LINES, {"x": MeasuringLine((0.0, 250.0, 100.0), TOOLS[3])}]


@pytest.mark.parametrize("chain", CHAINS)
def test_each_component_alone_decides(chain):
    """T alone has no arm where the line lay on the same tool, and T_line has one without T.

    Each order of the axes with every fifth choice of the rest, with each choice some of them.
    """
    parsed = Chain.parse(chain)
    choices = product(TOOLS, LINES_OF, (True, False))
    for tool, lines, orientation in islice(choices, CHAINS.index(chain) % 5, None, 5):
        found = set(needed_components(parsed, tool, lines or {}, orientation=orientation))
        for code in RIGID:
            error = {code: np.array([12.0])}
            errors, turned = volumetric_error(parsed, error, [POINT], tool, lines or {})
            seen = errors.any() or (orientation and turned.any())
            assert (code in found) == seen, (code, tool, lines, orientation)


@pytest.mark.parametrize("chain", ["FZX", "XFZ", "ZXF", "FX"])
def test_an_axis_that_the_machine_lacks_is_not_needed(chain):
    lacking = set("XYZ") - set(chain)
    for code in needed_components(Chain.parse(chain), (1.0, 2.0, 3.0)):
        component = COMPONENTS[code]
        if component.axis is None:
            assert not lacking & set(code[1:])
        else:
            assert component.axis.upper() not in lacking


def test_one_of_many_tools_is_enough_for_a_lever_arm():
    chain = Chain.parse("XYFZ")
    tools = np.zeros((5, 3))
    assert "ECZ" not in needed_components(chain, tools)
    tools[3, 0] = 1.0
    assert "ECZ" in needed_components(chain, tools)
