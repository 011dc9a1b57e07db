"""The programs in LinuxCNC: its interpreter reads them, and its axes end where they say."""

import os
import shutil
import subprocess

import pytest

from app.programs.dialects import LINUXCNC as WORDS
from app.programs.moving_axis import MotionStep, moving_axis_program
from app.programs.path import Manner
from app.programs.positioning import positioning_program
from app.programs.program import Move, Stop
from app.programs.step_diagonal import step_diagonal_program
from examples.linuxcnc.controller import LINUXCNC, run_program
from tests.programs.example_programs import MACHINE, every_program

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        LINUXCNC is None and "THERMAP_REQUIRE_SERVICES" not in os.environ,
        reason="LinuxCNC is not installed (Debian: linuxcnc-uspace)",
    ),
]

HASTY = Manner(feed_mm_per_min=20_000.0, dwell_s=0.02, reading_s=0.01)
"""A simulated machine needs no time to settle."""

TOLERANCE_MM = 1e-6


def way_of(program):
    """Where the axes end, where they stand at the stops, and how far they go."""
    at, stops, visited = {}, [], []
    for block in program.blocks:
        if isinstance(block, Move):
            at |= block.to_mm
            visited.append(dict(at))
        elif isinstance(block, Stop):
            stops.append([at[axis] for axis in "xyz"])
    return [at[axis] for axis in "xyz"], stops, visited


@pytest.mark.parametrize("name", every_program())
def test_the_interpreter_reads_every_program(name, tmp_path):
    path = tmp_path / "program.ngc"
    path.write_text(WORDS.write(every_program()[name]))
    read = subprocess.run(
        [shutil.which("rs274"), "-g", path, tmp_path / "out"],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=20,
        cwd=tmp_path,
    )
    assert read.returncode == 0, read.stderr
    moves = [line for line in (tmp_path / "out").read_text().splitlines() if "TRAVERSE(" in line]
    rapid = [
        b for b in every_program()[name].blocks if isinstance(b, Move) and not b.feed_mm_per_min
    ]
    assert len(moves) == len(rapid)


@pytest.mark.parametrize(
    "program",
    [
        moving_axis_program(
            MACHINE,
            HASTY,
            "y",
            [MotionStep(18_000.0, 0.05), MotionStep(0.0, 0.01)],
            between_mm=(-60.0, 60.0),
            targets_mm=[-50.0, 50.0],
            every_min=0.03,
        ),
        positioning_program(
            MACHINE, HASTY, "x", targets_mm=[10, 24.5, 40], runs=1, line_mm={"y": 9, "z": -20}
        ),
        step_diagonal_program(
            MACHINE, HASTY, steps=2, origin_mm=[10, -20, -40], step_mm=[6, 8, 7.5]
        ),
    ],
    ids=lambda program: program.name,
)
def test_the_running_controller_ends_where_the_program_says(program):
    """With a work offset active, which the program must not see."""
    ended, stops, visited = way_of(program)
    found = run_program(WORDS.write(program))
    assert found.said == []
    assert found.ended == pytest.approx(ended, abs=TOLERANCE_MM)
    assert len(found.stops) == len(stops)
    for stood, wanted in zip(found.stops, stops, strict=True):
        assert stood == pytest.approx(wanted, abs=TOLERANCE_MM)
    # It starts at home, 0, and never leaves what the program visits.
    for number, axis in enumerate("xyz"):
        reached = [0.0, *(place[axis] for place in visited if axis in place)]
        assert found.low[number] >= min(reached) - TOLERANCE_MM
        assert found.high[number] <= max(reached) + TOLERANCE_MM
        assert found.low[number] == pytest.approx(min(reached), abs=0.5)
        assert found.high[number] == pytest.approx(max(reached), abs=0.5)
