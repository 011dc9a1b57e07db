"""The exported files on the running LinuxCNC: its motors stand where the table says.

It is Debian's `linuxcnc-uspace`; CI installs it.
"""

import os

import numpy as np
import pytest

from app.controllers.export import export
from app.controllers.registry import format_named
from examples.linuxcnc.controller import LINUXCNC, run_moves
from tests.controllers.example_tables import curve, error_table, options_for

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        LINUXCNC is None and "THERMAP_REQUIRE_SERVICES" not in os.environ,
        reason="LinuxCNC is not installed (Debian: linuxcnc-uspace)",
    ),
]

TOLERANCE_UM = 0.1

NODES = np.linspace(-300.0, 300.0, 700)

TABLE = error_table(
    curve("EXX", [-200.0, 0.0, 80.0, 250.0], [-12.0, 0.0, 7.5, 30.0], [-9.0, 0.0, 11.0, 36.0]),
    curve("EYY", NODES, 20.0 * np.sin(NODES / 90.0)),  # more points than the controller takes
    curve("EZZ", [-150.0, 0.0], [45.0, 0.0]),
)

MOVES = [
    *[["x", p] for p in (40.0, 165.0, 260.0, 200.0, 33.0, -150.0, -250.0, -60.0)],
    *[["y", p] for p in (71.0, 141.3, -20.0, -200.0, 0.7)],
    *[["z", p] for p in (-75.0, -140.0, -10.0)],
]


@pytest.mark.parametrize("kind", [1, 0])
def test_the_motors_stand_where_the_table_says(kind):
    found = export(format_named("linuxcnc"), TABLE, options_for("linuxcnc", type=kind))
    held = {one.component.axis: one for one in found.loaded}
    answers = run_moves({file.name: file.content for file in found.files}, MOVES)
    assert [[axis, commanded] for axis, commanded, _ in answers] == [
        [axis, pytest.approx(position)] for axis, position in MOVES
    ]
    before = dict.fromkeys("xyz", 0.0)
    off = []
    for axis, commanded, motor in answers:
        direction = "+" if commanded > before[axis] else "-"
        before[axis] = commanded
        wanted = -held[axis].at(np.array([commanded]), direction)[0]
        off.append((motor - commanded) * 1000.0 - wanted)
    assert np.abs(off).max() <= TOLERANCE_UM, dict(zip(map(tuple, MOVES), off, strict=True))
    # And what the controller holds is the table, as far as the export says.
    stated = {one.component: one.largest_deviation for one in found.resampling}
    assert max(stated.values()) < 0.25
