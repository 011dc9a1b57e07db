"""One machine, and one program of each kind."""

from datetime import UTC, datetime

from app.effects.observations import Observation, Verification
from app.geometry.chain import Chain
from app.programs.body_diagonal import body_diagonal_program
from app.programs.moving_axis import MotionStep, moving_axis_program
from app.programs.path import Manner
from app.programs.positioning import positioning_program
from app.programs.step_diagonal import step_diagonal_program
from app.programs.visit import visit_program
from app.programs.warm_up import SpindleStep, warm_up_program
from app.search.rows import Datum
from app.thermal.machine import Machine, Sensor, Travel

START_S = datetime(2026, 3, 1, 6, tzinfo=UTC).timestamp()

MACHINE = Machine(
    "mcfv5050",
    "MCFV5050LN",
    Chain.parse("XYFZ"),
    {"x": Travel(0.0, 500.0), "y": Travel(-200.0, 200.0), "z": Travel(-300.0, 0.0)},
    {name: Sensor(name) for name in ("x-middle", "z-column")},
)


TOOL_MM = (0.0, 0.0, 80.0)


def observed(minutes, component=None, position_mm=None, ways=(0, 0, 0), **more):
    return Observation(
        START_S + 60.0 * minutes,
        (0.0,) if component else (0.0, 0.0, 0.0),
        component,
        position_mm,
        directions=ways,
        **more,
    )


PLANNED = Verification(
    "Monday",
    [
        observed(0, "EXX", 100.0, (1, 1, 1)),
        observed(0, "EBX", 100.0, (1, 1, 1)),
        observed(1, "EXX", 250.0, (1, 1, 1)),
        observed(2, "EXX", 250.0, (-1, -1, -1)),
        observed(3, "SXY"),
        observed(9, "EYY^x", 50.0, setup='laser, "B"'),
        observed(30, "EZZ", -100.0, (-1, -1, -1), state={"spindle_rpm": 500.0}),
        observed(
            40, point_mm=(10.0, 20.0, -30.0), ways=(1, -1, 0), tool_offset_mm=(0.0, 0.0, 80.0)
        ),
        observed(41, point_mm=(90.0, -20.0, -60.0), tool_offset_mm=(0.0, 0.0, 80.0)),
    ],
    Datum.FIRST,
    0.5,
    is_planned=True,
)


def every_program(manner=None):
    """Name to program."""
    manner = manner or Manner()
    programs = [positioning_program(MACHINE, manner, axis, runs=2) for axis in "xyz"]
    programs += [
        step_diagonal_program(MACHINE, manner, steps=4),
        body_diagonal_program(MACHINE, manner, steps=4, runs=1),
        warm_up_program(
            MACHINE,
            manner,
            [SpindleStep(4000.0, 12.0), SpindleStep(0.0, 90.0)],
            [(250.0, 0.0, -200.0), (100.0, 50.0, -150.0)],
            start_s=START_S,
        ),
        moving_axis_program(
            MACHINE,
            manner,
            "y",
            [MotionStep(15_000.0, 12.0), MotionStep(0.0, 10.0)],
            start_s=START_S,
        ),
        visit_program(MACHINE, manner, PLANNED),
    ]
    return {program.name: program for program in programs}
