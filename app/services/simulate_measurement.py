"""What an instrument would read on the stored machine: for training and for planning a set-up."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from app.arrays import FloatArray
from app.errors import InvalidContent, counted
from app.measurement.step_diagonal_readings import Target, step_diagonal_readings
from app.services.ask_field import FieldAnswer, FieldQuestion, Triple, ask_field, work_volume
from app.services.context import Context


@dataclass(frozen=True, slots=True)
class StepDiagonalPlan:
    """A sequential step diagonal as it is planned.

    `origin_mm` and `step_mm` are None where the axes' travel is to be crossed in `steps`
    even steps; `noise_um` is one reading's standard deviation, drawn with `seed`.
    """

    steps: int
    origin_mm: Triple | None = None
    step_mm: Triple | None = None
    target: Target = "point"
    mirror_tilts_urad: Mapping[str, Sequence[float]] | None = None
    noise_um: float = 0.0
    resolution_um: float | None = None
    seed: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedReadings:
    """What would be read, by diagonal, rows of (n, 3) [µm]."""

    asked: FieldAnswer
    origin_mm: Triple
    step_mm: Triple
    diagonals: Mapping[str, FloatArray]
    warnings: list[str]


def simulate_step_diagonal(
    context: Context, machine_id: str, question: FieldQuestion, plan: StepDiagonalPlan
) -> SimulatedReadings:
    """Walk the stored machine along its diagonals, and say what a laser would read.

    Parameters
    ----------
    context, machine_id, question
        As `ask_field`; one thermal state.
    plan
        Where the diagonals lie, in how many steps, with which noise.

    Raises
    ------
    UnknownThing, NoReading, InvalidContent
        As `ask_field`; InvalidContent also if the steps leave the axes' travel.
    """
    asked = ask_field(context, machine_id, question, orientation=False)
    volume, remarks = work_volume(asked)
    origin, step = _placed(plan, volume.ranges_mm)
    for i, (low, high) in enumerate(volume.ranges_mm):
        end = origin[i] + plan.steps * step[i]
        if step[i] <= 0 or origin[i] < low - 1e-9 or end > high + 1e-9:
            raise InvalidContent.of_field(
                "step_mm",
                f"expected {counted(plan.steps, 'step')} above 0 mm inside {'xyz'[i]} "
                f"{low:g} to {high:g} mm, came steps of {step[i]:g} mm from {origin[i]:g} to "
                f"{end:g} mm",
            )
    diagonals = step_diagonal_readings(
        asked.field,
        origin,
        step,
        plan.steps,
        tool_offset_mm=question.tool_offset_mm,
        target=plan.target,
        mirror_tilts_urad=plan.mirror_tilts_urad,
        noise_um=plan.noise_um,
        rng=np.random.default_rng(plan.seed),
        resolution_um=plan.resolution_um,
    )
    return SimulatedReadings(asked, origin, step, diagonals, [*asked.warnings, *remarks])


def _placed(
    plan: StepDiagonalPlan, ranges_mm: Sequence[tuple[float, float]]
) -> tuple[Triple, Triple]:
    """Place the steps: as planned, or over the whole travel."""
    x, y, z = plan.origin_mm or tuple(low for low, _ in ranges_mm)
    origin = (x, y, z)
    spans = [(high - o) / plan.steps for o, (_, high) in zip(origin, ranges_mm, strict=True)]
    a, b, c = plan.step_mm or tuple(spans)
    return origin, (a, b, c)
