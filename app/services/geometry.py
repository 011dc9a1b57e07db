"""The volumetric error: what it consists of, at points, over the work volume, and pictured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from app.answer import Answer
from app.arrays import FloatArray
from app.errors import InvalidContent, counted, list_names
from app.geometry.compensation_levels import CompensationLevel, compensation_levels
from app.geometry.components import COMPONENTS, LINEAR_LETTERS, ORDER
from app.geometry.needed_components import needed_components
from app.geometry.nonrigid_presets import NonrigidPreset, find_preset
from app.geometry.rotary_axes import location_codes, rotary_location_error
from app.geometry.volumetric_accuracy import VolumetricAccuracy, volumetric_accuracy
from app.geometry.work_volume import WorkVolume
from app.pictures.layout import Remarks
from app.pictures.work_volume_picture import work_volume_picture
from app.services.ask_field import FieldAnswer, FieldQuestion, Triple, ask_field, work_volume
from app.services.context import Context
from app.services.load_machine import load_machine
from app.thermal.machine import Machine, Travel

MOST_NUMBERS = 1_000_000
"""Points times thermal states in one call."""


@dataclass(frozen=True, slots=True)
class NeededComponent(Answer):
    """One error that the volumetric error of the machine consists of."""

    component: Annotated[str, Field(examples=["EXY^x"])]
    """ISO 230-1 code"""
    chapter: Annotated[str, Field(examples=["D_x^x(y)"])]
    """The chapter's notation"""
    kind: Annotated[str, Field(examples=["nonrigid slope"])]
    """Its group"""
    unit: Annotated[str, Field(examples=["µm/m"])]
    """Unit of its values"""
    in_model: bool
    """Whether the active model's maps have it"""


@dataclass(frozen=True, slots=True)
class NeededComponents(Answer, published_as="NeededAnswer"):
    """Which errors have to be measured, and which of them the active model lacks."""

    machine: Annotated[str, Field(examples=["mcfv5050"])]
    """Machine"""
    configuration: Annotated[str, Field(examples=["XYFZ"])]
    """Its kinematic chain"""
    preset: NonrigidPreset | None
    """The kind of machine that was asked for; null for a rigid one"""
    components: Sequence[NeededComponent]
    """What has to be measured, in order"""
    missing: Annotated[Sequence[str], Field(examples=[["EXY^x"]])]
    """Of these, what no map of the active model has"""
    warnings: Sequence[str]
    """What to know beside it"""


def check_components(
    context: Context, machine_id: str, tool_offset_mm: Triple, preset: str | None = None
) -> NeededComponents:
    """List what has to be measured of a machine, rigid or of one of the chapter's presets.

    Parameters
    ----------
    tool_offset_mm
        Tool offset T [mm]: a lever arm of every rotation.
    preset
        Name of a kind of machine that is not rigid; None for a rigid one.
    """
    kind = find_preset(preset) if preset is not None else None
    live = context.live.get(machine_id) or load_machine(context, machine_id)
    model = live.current.model
    chain = model.machine.chain
    codes = set(needed_components(chain, tool_offset_mm, model.measuring_lines))
    warnings = []
    if kind is not None:
        codes |= {code for code in kind.slopes if COMPONENTS[code].axis in chain.axes}
        if kind.configuration != chain.text:
            warnings.append(
                f"the preset {kind.name} is given for {kind.configuration} ({kind.equations}); "
                f"this machine is {chain.text}: judge whether its axes bend in the same way"
            )
    have = {code for group in model.groups for code in group.codes}
    needed = [COMPONENTS[code] for code in sorted(codes, key=ORDER.__getitem__)]
    return NeededComponents(
        machine=model.machine.id,
        configuration=chain.text,
        preset=kind,
        components=[
            NeededComponent(c.code, c.chapter, c.kind.value, c.unit.symbol, c.code in have)
            for c in needed
        ],
        missing=[c.code for c in needed if c.code not in have],
        warnings=warnings,
    )


@dataclass(frozen=True, slots=True, eq=False)
class VolumetricError:
    """Errors at points [µm, µrad], shape (n, 3), or (s, n, 3) for several thermal states.

    `outside_travel` are the indices of points that the axes cannot reach.
    """

    answer: FieldAnswer
    errors_um: FloatArray
    orientation_urad: FloatArray
    outside_travel: NDArray[np.intp]
    warnings: list[str]


def compute_volumetric_error(
    context: Context,
    machine_id: str,
    question: FieldQuestion,
    points_mm: FloatArray,
    *,
    outside_travel_allowed: bool = False,
) -> VolumetricError:
    """Sum all components at points.

    Parameters
    ----------
    points_mm : ndarray, shape (n, 3) [mm]
        Nominal points.
    outside_travel_allowed
        Whether points outside the axes' travel are answered, and flagged.

    Raises
    ------
    UnknownThing, NoReading, InvalidContent
        As `ask_field`; InvalidContent also for points outside the travel, or too many.
    """
    states = len(question.temperatures_c or [0])
    if states * len(points_mm) > MOST_NUMBERS:
        raise InvalidContent.of_field(
            "points_mm",
            f"expected at most {MOST_NUMBERS} points times thermal states in one call, got "
            f"{len(points_mm)} times {states}",
        )
    answer = ask_field(context, machine_id, question)
    outside = _outside_travel(answer.machine, points_mm)
    if outside.size and not outside_travel_allowed:
        raise _refused(answer.machine, points_mm, outside)
    errors_um, orientation_urad = answer.field.at(points_mm, question.tool_offset_mm)
    warnings = [*answer.warnings, *_beyond_tables(answer, points_mm)]
    if outside.size:
        warnings.append(f"{counted(outside.size, 'point')} outside the axes' travel")
    return VolumetricError(answer, errors_um, orientation_urad, outside, warnings)


def _outside_travel(machine: Machine, points_mm: FloatArray) -> NDArray[np.intp]:
    """Find points that the axes cannot reach; an axis that is not there stands at 0."""
    outside = np.zeros(len(points_mm), dtype=bool)
    for i, axis in enumerate(LINEAR_LETTERS):
        travel = machine.axes.get(axis)
        if travel is not None:
            along = points_mm[:, i]
            outside |= (along < travel.min_mm) | (along > travel.max_mm)
        elif axis not in machine.chain.axes:
            outside |= points_mm[:, i] != 0.0
    return np.flatnonzero(outside)


def _refused(machine: Machine, points_mm: FloatArray, outside: NDArray[np.intp]) -> InvalidContent:
    first = int(outside[0])
    reach = [f"{axis} {t.min_mm:g} to {t.max_mm:g} mm" for axis, t in sorted(machine.axes.items())]
    reach += [f"no {axis}" for axis in LINEAR_LETTERS if axis not in machine.chain.axes]
    others = f" and {outside.size - 1} more" if outside.size > 1 else ""
    return InvalidContent.of_field(
        f"points_mm.{first}",
        f"expected points within the axes' travel ({', '.join(reach)}), got "
        f'{points_mm[first].tolist()} mm{others}; state "outside_travel": "allow" to have them '
        "answered",
    )


def _beyond_tables(answer: FieldAnswer, points_mm: FloatArray) -> list[str]:
    """Say of each axis how many points lie beyond its tables, where their end values hold."""
    sentences = []
    for i, axis in enumerate(LINEAR_LETTERS):
        nodes = answer.field.nodes_mm(axis)
        if nodes.size:
            along = points_mm[:, i]
            beyond = int(np.count_nonzero((along < nodes[0]) | (along > nodes[-1])))
            if beyond:
                sentences.append(
                    f"{counted(beyond, 'point')} beyond the tables of {axis}, {nodes[0]:g} to "
                    f"{nodes[-1]:g} mm: their end values hold there"
                )
    return sentences


@dataclass(frozen=True, slots=True, eq=False)
class RotaryError:
    """Errors of carried points, shape (n, 3) [µm], and the location errors behind them.

    `left_um` is what remains of them where a control follows those that it knows.
    `locations` has each code's value [µm or µrad] at the temperatures that were asked.
    """

    answer: FieldAnswer
    errors_um: FloatArray
    left_um: FloatArray
    locations: Mapping[str, float]


def compute_rotary_error(
    context: Context,
    machine_id: str,
    question: FieldQuestion,
    points_mm: FloatArray,
    angles_deg: Mapping[str, FloatArray | float],
    order: str,
    pivots_mm: Mapping[str, Triple],
    compensated: Mapping[str, float],
) -> RotaryError:
    """Say how far carried points are from where they should be at given angles.

    Parameters
    ----------
    context, machine_id, question
        As `ask_field`; one thermal state.
    points_mm, angles_deg, order, pivots_mm
        As `rotary_location_error`.
    compensated
        Location errors that a control knows and follows [µm or µrad].

    Raises
    ------
    UnknownThing, NoReading, InvalidContent
        As `ask_field` and `rotary_location_error`.
    """
    codes = location_codes(order)
    others = [code for code in compensated if code not in codes]
    if others:
        raise InvalidContent.of_field(
            "compensated",
            f"expected location errors of {order} ({list_names(codes)}), got {list_names(others)}",
        )
    answer = ask_field(context, machine_id, question, needed=codes)
    locations = {
        code: float(values[0, 0])
        for code, (_, values) in answer.field.tables.items()
        if code in codes
    }
    errors_um = rotary_location_error(locations, points_mm, angles_deg, order, pivots_mm)
    followed_um = rotary_location_error(compensated, points_mm, angles_deg, order, pivots_mm)
    return RotaryError(answer, errors_um, errors_um - followed_um, locations)


@dataclass(frozen=True, slots=True, eq=False)
class Accuracy:
    """Every definition of volumetric accuracy over a work volume."""

    answer: FieldAnswer
    volume: WorkVolume
    accuracy: VolumetricAccuracy
    warnings: list[str]


@dataclass(frozen=True, slots=True, eq=False)
class Levels:
    """What controllers of different ability leave over a work volume."""

    answer: FieldAnswer
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
    volume
        Range of each axis; its travel where nothing is stated.

    Raises
    ------
    UnknownThing, NoReading, InvalidContent
        As `ask_field` and `work_volume`.
    """
    answer = ask_field(context, machine_id, question, orientation=True)
    box, remarks = work_volume(answer, volume)
    accuracy = volumetric_accuracy(answer.field, box, question.tool_offset_mm)
    return Accuracy(answer, box, accuracy, [*answer.warnings, *remarks])


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
    points_per_axis
        Size of the even lattice of points that is looked at.

    Raises
    ------
    UnknownThing, NoReading, InvalidContent
        As `assess_accuracy`.
    """
    answer = ask_field(context, machine_id, question, orientation=False)
    box, remarks = work_volume(answer, volume)
    levels = compensation_levels(answer.field, box, question.tool_offset_mm, points_per_axis)
    return Levels(answer, box, levels, [*answer.warnings, *remarks])


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """A plotly figure, and the answer that it shows."""

    answer: FieldAnswer
    figure: Any


def picture_work_volume(
    context: Context,
    machine_id: str,
    question: FieldQuestion,
    volume: Mapping[str, Travel] | None = None,
    exaggeration: float | None = None,
    arrows_per_axis: int = 5,
) -> Picture:
    """Draw the work volume with exaggerated errors.

    Parameters
    ----------
    context, machine_id, question
        As `ask_field`; one thermal state.
    volume
        Range of each axis; its travel where nothing is stated.
    exaggeration
        How many times larger than they are errors are drawn; chosen where not stated.

    Raises
    ------
    UnknownThing, NoReading, InvalidContent
        As `ask_field` and `work_volume`.
    """
    answer = ask_field(context, machine_id, question, orientation=False)
    box, remarks = work_volume(answer, volume)
    figure = work_volume_picture(
        answer.field,
        box,
        question.tool_offset_mm,
        title=f"{answer.machine.name} · volumetric error",
        subtitle=_subtitle(answer, question),
        exaggeration=exaggeration,
        arrows_per_axis=arrows_per_axis,
        remarks=Remarks(answer.complete, [*answer.warnings, *remarks], answer.counted_as_zero),
    )
    return Picture(answer, figure)


def _subtitle(answer: FieldAnswer, question: FieldQuestion) -> str:
    """Say of what the picture is one, and what counts as zero in it."""
    temperatures = ", ".join(f"{s} {t:.1f} °C" for s, t in answer.temperatures_c[0].items())
    x, y, z = question.tool_offset_mm
    sentences = [
        f"{answer.machine.chain.text}, tool offset ({x:g}, {y:g}, {z:g}) mm, {temperatures}",
        f"model version {answer.model_version}, {answer.computed_at:%Y-%m-%d %H:%M:%S} UTC",
    ]
    if answer.counted_as_zero:
        sentences.append(f"counted as zero: {list_names(answer.counted_as_zero)}")
    return "; ".join(sentences)
