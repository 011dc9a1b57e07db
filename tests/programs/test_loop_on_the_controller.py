"""The loop closed on the running LinuxCNC, on a plant with errors that nobody has declared.

The steps are the example's (`examples.linuxcnc`): `thermap program` moves the machine; behind its
motors stands a plant. A laser reads it wherever they rest, the files that the programs came with
are filled in, and the controller takes what thermap made of them.
"""

import os

import pytest

from examples.linuxcnc.__main__ import close_the_loop
from examples.linuxcnc.controller import LINUXCNC
from examples.linuxcnc.plant import LASER_UM, LATE_S

pytestmark = [
    pytest.mark.slow,
    pytest.mark.begin,  # LinuxCNC moves in real time: 7 min
    pytest.mark.skipif(
        LINUXCNC is None and "THERMAP_REQUIRE_SERVICES" not in os.environ,
        reason="LinuxCNC is not installed (Debian: linuxcnc-uspace)",
    ),
]


def test_the_loop_is_closed(tmp_path):
    """One test, since the walk takes minutes: on another worker it would be walked again."""
    exported, before, found, after = close_the_loop(tmp_path)
    expect_what_was_measured_to_be_taken_away(exported)
    expect_what_nobody_declared_to_be_named(found)
    expect_the_motors_to_follow_what_was_adopted(before, after)


def expect_what_was_measured_to_be_taken_away(exported):
    assert [one.name for one in exported] == ["x", "z"]
    for one in exported:
        assert one.before_um > 15.0
        assert one.after_um < 0.1


def expect_what_nobody_declared_to_be_named(found):
    assert "EZZ follows z-column" in found.summary
    assert found.status == "confirmed"
    assert found.late_min == pytest.approx(LATE_S / 60.0, rel=0.1)


def expect_the_motors_to_follow_what_was_adopted(before, after):
    """Through a warm-up. The maps alone are wrong by what the column is behind its sensor."""
    assert [one.minutes for one in after[:-1]] == [one.minutes for one in before[:-1]]
    assert after[-1].minutes >= before[-1].minutes
    late = max(before, key=lambda one: abs(one.late_c))
    wanted = 0.011 * abs(late.late_c) * (280.0 - 25.0)
    assert late.largest_um == pytest.approx(wanted, rel=0.1)
    assert wanted > 10.0
    # What is left is the scatter of the sensors' single readings and of what was learnt.
    assert max(one.largest_um for one in after) < 5 * LASER_UM
    assert after[-1].largest_um < 0.2 * before[-1].largest_um
