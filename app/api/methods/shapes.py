"""What all methods of measuring share over HTTP."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

from pydantic import Discriminator, Field, Tag

from app.api.schemas.error_maps import ComponentAnswer, LineOrPoint, shown_line
from app.field_errors import way_of
from app.rounding import Digits
from app.services.change_model import ModelChange
from app.services.models import Preview
from app.stated import Millimetres, Number

if TYPE_CHECKING:
    from app.services.measurements import Measured

Axis = Literal["x", "y", "z"]
MOST_POSITIONS: Final = 2000
"""Of one measurement: the covariance of its errors has the square of that."""

Readings = Annotated[list[Number], Field(min_length=1, max_length=MOST_POSITIONS)]
MeasuredPositions = Annotated[list[Millimetres], Field(min_length=1, max_length=MOST_POSITIONS)]


def _one_or_more(value: object) -> str:
    several = isinstance(value, list) and value and isinstance(value[0], list)
    return way_of("more") if several else way_of("one")


Runs = Annotated[
    Annotated[Readings, Tag(way_of("one"))]
    | Annotated[
        Annotated[list[Readings], Field(min_length=1, max_length=1000)], Tag(way_of("more"))
    ],
    Discriminator(_one_or_more),
]
"""One run, or a list of runs, over the positions."""


class MeasurementAnswer(ModelChange):
    """What a measurement yields."""

    machine: str = Field(description="The machine's id", examples=["mcfv5050"])
    method: str = Field(description="How it was measured", examples=["step-diagonal"])
    label: str | None = Field(
        None, description="The name of its map, where one was stated", examples=["Run #1"]
    )
    stored: bool = Field(description="Whether an error map was made of it")
    map_id: int | None = Field(description="That map's number", examples=[7])
    is_new: bool = Field(False, description="False where the same map was there already, or none")
    components: list[ComponentAnswer] = Field(
        description="The components with their standard errors"
    )
    figures: dict[str, Digits] = Field(
        description="Figures of quality and of the method's standard, by names that end in the "
        "unit, such as closure_rms_um [µm]",
        examples=[{"closure_rms_um": 0.31}],
    )
    notes: list[str] = Field(
        description="What the method cannot see, what was left out, what looks wrong"
    )
    measuring_lines_mm: dict[str, LineOrPoint] = Field(
        description="Axis to the line along which its translations count as measured [mm]"
    )
    warnings: list[str] = Field(
        default_factory=list, description="What of its file was not read; left out without one"
    )
    preview: Preview | None = Field(
        None, description="What storing it would do to the tables, where a preview was asked for"
    )


def answer_fields(measured: Measured, label: str | None) -> dict[str, Any]:
    """Write the fields of `MeasurementAnswer`."""
    result, stored, preview = measured.result, measured.stored, measured.preview
    fields: dict[str, Any] = {
        "machine": measured.machine.id,
        "method": measured.method,
        "label": label,
        "stored": stored is not None,
        "map_id": None if stored is None else stored.stored.id,
        "is_new": stored is not None and stored.is_new,
        "components": [ComponentAnswer.computed(table) for table in result.tables],
        "figures": dict(result.figures),
        "notes": [*result.notes, *measured.remarks],
        "measuring_lines_mm": {a: shown_line(line) for a, line in result.measuring_lines.items()},
    }
    if stored is not None:
        fields |= dict(stored.made.change) if stored.made else {}
    if preview is not None:
        fields |= {name: getattr(preview, name) for name in ("activated", "loses", "gains")}
        fields["preview"] = preview
    return fields
