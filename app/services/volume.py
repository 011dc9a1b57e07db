"""What the page of the work volume shows: the largest error, slices, corners, what is left."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from app.errors import StorageUnavailable, ThermapError, UnknownThing
from app.geometry.compensation_levels import CompensationLevel, compensation_levels
from app.geometry.error_field import ErrorField
from app.geometry.volumetric_accuracy import VolumetricAccuracy, volumetric_accuracy
from app.geometry.work_volume import WorkVolume
from app.pictures.exaggeration import automatic_exaggeration, checked_exaggeration
from app.pictures.slices import Slice, slice_volume
from app.services.ask_field import FieldAnswer, TableQuestion, Triple, ask_field, work_volume
from app.services.context import Context
from app.services.status import machine_in_memory, status_of, stored_of_machines
from app.status.machine_status import MachineStatus

Through = Literal["worst", "middle"]

CORNERS = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1))
"""Round the bottom and then round the top: 1 is the highest end of an axis."""


@dataclass(frozen=True, slots=True)
class PointError:
    """The error at one point [mm, µm]."""

    point_mm: Triple
    error_um: Triple

    @property
    def length_um(self) -> float:
        """How long it is [µm]."""
        return float(np.linalg.norm(self.error_um))


@dataclass(frozen=True, slots=True, eq=False)
class VolumeNow:
    """The work volume at the latest reading.

    `exaggeration` is that of the slices, `automatic` the one that suits them.
    """

    answer: FieldAnswer
    volume: WorkVolume
    tool_offset_mm: Triple
    worst: PointError
    corners: Sequence[PointError]
    accuracy: VolumetricAccuracy
    levels: Sequence[CompensationLevel]
    through: Through
    slices: Sequence[Slice]
    exaggeration: float
    automatic: float
    warnings: Sequence[str]


@dataclass(frozen=True, slots=True, eq=False)
class VolumeView:
    """A machine's verdict and its work volume now; `why_not` says why there is none."""

    status: MachineStatus
    found: VolumeNow | None
    why_not: str = ""


def show_volume(
    context: Context,
    machine_id: str,
    tool_offset_mm: Triple = (0.0, 0.0, 0.0),
    exaggeration: float | None = None,
    through: Through = "worst",
) -> VolumeView:
    """Gather what the page of the work volume shows.

    Components that no two maps have count as zero; the answer names them.

    Parameters
    ----------
    exaggeration
        How many times larger than they are errors are drawn; chosen where not stated.
    through
        Whether the slices go through the largest error or through the middle.

    Raises
    ------
    InvalidContent
        If the exaggeration draws no picture.
    """
    live = machine_in_memory(context, machine_id)
    status = status_of(context, live, stored_of_machines(context))
    question = TableQuestion(tool_offset_mm=tool_offset_mm)
    try:
        answer = ask_field(context, machine_id, question)
        volume, remarks = work_volume(answer, None)
        accuracy = volumetric_accuracy(answer.field, volume, tool_offset_mm)
    except (UnknownThing, StorageUnavailable):
        raise
    except ThermapError as error:
        return VolumeView(status, None, error.detail)
    worst = _at(answer.field, [accuracy.with_arms.worst_point_mm], tool_offset_mm)[0]
    automatic = automatic_exaggeration(worst.length_um, volume)
    drawn = automatic
    if exaggeration is not None:
        drawn = checked_exaggeration(exaggeration, worst.length_um, volume)
    middle = tuple((low + high) / 2.0 for low, high in volume.ranges_mm)
    cut = worst.point_mm if through == "worst" else middle
    now = VolumeNow(
        answer=answer,
        volume=volume,
        tool_offset_mm=tool_offset_mm,
        worst=worst,
        corners=_at(answer.field, _corners(volume), tool_offset_mm),
        accuracy=accuracy,
        levels=compensation_levels(answer.field, volume, tool_offset_mm),
        through=through,
        slices=slice_volume(
            answer.field, volume, cut, drawn, tool_offset_mm, worst_mm=worst.point_mm
        ),
        exaggeration=drawn,
        automatic=automatic,
        warnings=[*answer.warnings, *remarks],
    )
    return VolumeView(status, now)


def _corners(volume: WorkVolume) -> list[Triple]:
    (x, y, z) = volume.ranges_mm
    corners = [(x[a], y[b], z[c]) for a, b, c in CORNERS]
    return list(dict.fromkeys(corners))  # an axis that is not there has one end


def _at(field: ErrorField, points_mm: Sequence[Triple], tool_offset_mm: Triple) -> list[PointError]:
    errors_um, _ = field.at(np.array(points_mm), tool_offset_mm)
    return [
        PointError(point, (float(x), float(y), float(z)))
        for point, (x, y, z) in zip(points_mm, errors_um, strict=True)
    ]
