"""Volumetric accuracy by every definition, and what better controllers would buy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from app.geometry.compensation_levels import CompensationLevel, compensation_levels
from app.geometry.volumetric_accuracy import VolumetricAccuracy, volumetric_accuracy
from app.geometry.work_volume import WorkVolume
from app.services.ask_field import FieldAnswer, FieldQuestion, ask_field, work_volume
from app.services.context import Context
from app.thermal.machine import Travel


@dataclass(frozen=True, slots=True, eq=False)
class Accuracy:
    """Every definition of volumetric accuracy over a work volume."""

    asked: FieldAnswer
    volume: WorkVolume
    accuracy: VolumetricAccuracy
    warnings: list[str]


@dataclass(frozen=True, slots=True, eq=False)
class Levels:
    """What controllers of different ability leave over a work volume."""

    asked: FieldAnswer
    volume: WorkVolume
    levels: list[CompensationLevel]
    warnings: list[str]


def assess_accuracy(
    context: Context,
    machine_id: str,
    question: FieldQuestion,
    volume: Mapping[str, Travel] | None = None,
) -> Accuracy:
    """Measure a machine's volumetric accuracy by every definition of the chapter.

    Parameters
    ----------
    context, machine_id, question
        As `ask_field`.
    volume
        Range of each axis; its travel where nothing is stated.

    Raises
    ------
    UnknownThing, NoReading, InvalidContent
        As `ask_field` and `work_volume`.
    """
    asked = ask_field(context, machine_id, question, orientation=True)
    box, remarks = work_volume(asked, volume)
    found = volumetric_accuracy(asked.field, box, question.tool_offset_mm)
    return Accuracy(asked, box, found, [*asked.warnings, *remarks])


def compare_levels(
    context: Context,
    machine_id: str,
    question: FieldQuestion,
    volume: Mapping[str, Travel] | None = None,
    points_per_axis: int = 11,
) -> Levels:
    """Compare what controllers of different ability would leave of the volumetric error.

    Parameters
    ----------
    context, machine_id, question, volume
        As `assess_accuracy`.
    points_per_axis
        Size of the even lattice of points that is looked at.

    Raises
    ------
    UnknownThing, NoReading, InvalidContent
        As `assess_accuracy`.
    """
    asked = ask_field(context, machine_id, question, orientation=False)
    box, remarks = work_volume(asked, volume)
    found = compensation_levels(asked.field, box, question.tool_offset_mm, points_per_axis)
    return Levels(asked, box, found, [*asked.warnings, *remarks])
