"""Signs and lever arms of the simulated machine against domain.md, computed by hand."""

import numpy as np
import pytest

from app.simulation.undeclared.kinematics import volumetric_error

POINT = np.array([[100.0, 200.0, 300.0]])
TOOL = np.array([[0.0, 0.0, 150.0]])


def at_point(chain, **errors):
    values = {code: np.array([value]) for code, value in errors.items()}
    return volumetric_error(chain, values, POINT, TOOL)[0]


@pytest.mark.parametrize(
    ("errors", "expected_um"),
    [
        ({"EXX": 3.0, "EYX": -1.0, "EZX": 0.5}, [3.0, -1.0, 0.5]),
        ({"EYZ": 2.0}, [0.0, 2.0, 0.0]),
        # X carries z and the tool, 0.45 m high, and its own 0.1 m: 10 µrad × 0.45 m = 4.5 µm.
        ({"EBX": 10.0}, [4.5, 0.0, -1.0]),
        ({"EAX": 10.0}, [0.0, -4.5, 0.0]),
        ({"ECX": 10.0}, [0.0, 1.0, 0.0]),
        # Y carries x, y, z and the tool.
        ({"EAY": 5.0}, [0.0, -2.25, 1.0]),
        ({"ECY": 10.0}, [-2.0, 1.0, 0.0]),
        # Z carries the tool alone, and a tool along Z has no lever about Z.
        ({"EAZ": 4.0}, [0.0, -0.6, 0.0]),
        ({"EBZ": 4.0}, [0.6, 0.0, 0.0]),
        ({"ECZ": 4.0}, [0.0, 0.0, 0.0]),
        ({"SXY": -12.0}, [-2.4, 0.0, 0.0]),
        ({"SYZ": 10.0}, [0.0, 3.0, 0.0]),
        ({"SZX": 10.0}, [3.0, 0.0, 0.0]),
    ],
)
def test_each_error_of_an_xyfz_machine(errors, expected_um):
    assert at_point("XYFZ", **errors) == pytest.approx(expected_um)


@pytest.mark.parametrize(
    ("chain", "axis", "acts_on"),
    [
        ("FXYZ", "X", "yz"),
        ("FXYZ", "Y", "z"),
        ("FXYZ", "Z", ""),
        ("XFYZ", "X", "xyz"),
        ("XFYZ", "Y", "z"),
        ("XFYZ", "Z", ""),
        ("XYFZ", "X", "xz"),
        ("XYFZ", "Y", "xyz"),
        ("XYFZ", "Z", ""),
        ("XYZF", "X", "x"),
        ("XYZF", "Y", "xy"),
        ("XYZF", "Z", "xyz"),
        ("FYXZ", "X", "z"),
        ("FYXZ", "Y", "xz"),
    ],
)
def test_lever_arms_are_those_of_the_table_in_section_3(chain, axis, acts_on):
    arm_m = [0.1 * ("x" in acts_on), 0.2 * ("y" in acts_on), 0.3 * ("z" in acts_on) + 0.15]
    for letter, omega in zip("ABC", np.eye(3) * 10.0, strict=True):
        found = at_point(chain, **{f"E{letter}{axis}": 10.0})
        assert found == pytest.approx(np.cross(omega, arm_m))


def test_errors_add():
    one, other = {"EBX": 3.0, "SXY": 4.0}, {"EAY": -2.0, "EZZ": 1.0}
    together = at_point("XYFZ", **one, **other)
    assert together == pytest.approx(at_point("XYFZ", **one) + at_point("XYFZ", **other))
