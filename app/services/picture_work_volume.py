"""The picture of a machine's work volume, distorted as it is at the present temperatures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from app.errors import list_names
from app.pictures.layout import Remarks
from app.pictures.work_volume_picture import work_volume_picture
from app.services.ask_field import FieldAnswer, FieldQuestion, ask_field, work_volume
from app.services.context import Context
from app.thermal.machine import Travel


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """A plotly figure, and the answer that it shows."""

    asked: FieldAnswer
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
    arrows_per_axis
        Number of error vectors along each axis.

    Raises
    ------
    UnknownThing, NoReading, InvalidContent
        As `ask_field` and `work_volume`.
    """
    asked = ask_field(context, machine_id, question, orientation=False)
    box, remarks = work_volume(asked, volume)
    figure = work_volume_picture(
        asked.field,
        box,
        question.tool_offset_mm,
        title=f"{asked.machine.name} · volumetric error",
        subtitle=_subtitle(asked, question),
        exaggeration=exaggeration,
        arrows_per_axis=arrows_per_axis,
        remarks=Remarks(asked.complete, [*asked.warnings, *remarks], asked.counted_as_zero),
    )
    return Picture(asked, figure)


def _subtitle(asked: FieldAnswer, question: FieldQuestion) -> str:
    """Say of what the picture is one, and what counts as zero in it."""
    temperatures = ", ".join(f"{s} {t:.1f} °C" for s, t in asked.temperatures_c[0].items())
    x, y, z = question.tool_offset_mm
    said = [
        f"{asked.machine.chain.text}, tool offset ({x:g}, {y:g}, {z:g}) mm, {temperatures}",
        f"model version {asked.model_version}, {asked.computed_at:%Y-%m-%d %H:%M:%S} UTC",
    ]
    if asked.counted_as_zero:
        said.append(f"counted as zero: {list_names(asked.counted_as_zero)}")
    return "; ".join(said)
