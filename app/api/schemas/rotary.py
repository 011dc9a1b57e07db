"""What the location errors of rotary axes do to carried points, over HTTP."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import BeforeValidator, ConfigDict, Field

from app.api.schemas.base import Number, Point
from app.api.schemas.error_field import AnswerHead, FieldRequest, triple
from app.api.schemas.volumetric_error import Points
from app.rounding import Micro

if TYPE_CHECKING:
    from app.arrays import FloatArray
    from app.services.ask_field import Triple


def _as_list(value: object) -> object:
    return value if isinstance(value, list) else [value]


RotaryLetter = Literal["A", "B", "C"]
Angles = Annotated[
    list[Annotated[Number, Field(ge=-36_000, le=36_000)]],
    BeforeValidator(_as_list),
    Field(min_length=1, max_length=1_000_000),
]
"""One angle, or one for each point [°]."""


class RotaryErrorRequest(FieldRequest):
    """Points that rotary axes carry, and the axes' angles."""

    model_config = ConfigDict(
        json_schema_extra={
            "example": {
                "temperatures_c": {"x-middle": 24.1, "z-column": 27.3},
                "order": "C",
                "angles_deg": {"C": [0, 90, 180]},
                "points_mm": [[100, 0, 50], [100, 0, 50], [100, 0, 50]],
                "missing_components": "zero",
            }
        }
    )

    order: str = Field(
        "AC",
        description="Rotary axes from the base outward: in AC the A axis carries the C axis",
        examples=["AC", "BC", "C"],
    )
    angles_deg: dict[RotaryLetter, Angles] = Field(
        description="Rotary axis to its angle, or to a list of one for each point [°]; axes left "
        "out stand at 0",
        examples=[{"A": -30, "C": [0, 90, 180]}],
    )
    points_mm: Points = Field(
        description="The carried points with all rotary axes at 0, in the machine's directions "
        "where the rotary axes' base stands still [mm]; one point serves for many angles"
    )
    pivots_mm: dict[RotaryLetter, Point] = Field(
        default_factory=dict,
        description="Rotary axis to a point of its nominal line [mm]; the origin if left out",
        examples=[{"C": [250, 250, 0]}],
    )

    compensated: dict[str, Number] = Field(
        default_factory=dict,
        description="Location errors that the control already knows and follows [µm; µrad]: the "
        "answer says what is left of the path errors",
        examples=[{"XOC": -0.5, "YOC": 21.5}],
    )

    def angles(self) -> dict[str, FloatArray]:
        """Give the angles as arrays [°]: of shape () where there is one."""
        return {
            letter: np.array(angles[0] if len(angles) == 1 else angles)
            for letter, angles in self.angles_deg.items()
        }

    def pivots(self) -> dict[str, Triple]:
        """Give the pivots [mm]."""
        return {letter: triple(point) for letter, point in self.pivots_mm.items()}


class RotaryErrorAnswer(AnswerHead):
    """The errors of the carried points, in their order."""

    errors_um: list[list[Micro]] = Field(
        description="Actual minus nominal position x, y, z of each carried point [µm]; where the "
        "axes carry the workpiece, the tool's error relative to it is minus this"
    )
    rms_um: Micro = Field(description="Root mean square of their lengths [µm]")
    max_um: Micro = Field(description="The largest of their lengths [µm]")
    left_um: list[list[Micro]] = Field(
        description="What `compensated` leaves of each, x, y, z [µm]: the errors themselves "
        "where nothing is compensated"
    )
    left_rms_um: Micro = Field(description="Root mean square of the lengths that are left [µm]")
    left_max_um: Micro = Field(description="The largest of the lengths that are left [µm]")
    locations: dict[str, Number] = Field(
        description="The location errors at these temperatures: positions (XOC, YOC, YOA, ZOA, "
        "XOB, ZOB) in µm, directions (AOC, BOC, BOA, COA, AOB, COB) in µrad [µm]",
        examples=[{"XOC": -0.5, "YOC": 21.5, "AOC": 3.0, "BOC": -7.0}],
    )
