"""The volumetric error at points over HTTP."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Final, Literal

from pydantic import ConfigDict, Discriminator, Field, Tag

from app.api.schemas.base import Number, Point, Temperatures, signs_of
from app.api.schemas.error_field import AnswerHead, FieldRequest, triple
from app.api.schemas.in_pieces import InPieces
from app.field_errors import way_of

if TYPE_CHECKING:
    from app.services.ask_field import FieldQuestion

MOST_POINTS: Final = 1_000_000

Points = Annotated[list[Point], InPieces(MOST_POINTS, at_once=5000, as_array=True)]
"""Up to a million points x, y, z [mm], as an array of shape (n, 3)."""


def _one_or_more(value: object) -> str:
    return way_of("more") if isinstance(value, list) else way_of("one")


OneOrMoreStates = Annotated[
    Annotated[Temperatures, Tag(way_of("one"))]
    | Annotated[
        Annotated[list[Temperatures], Field(min_length=1, max_length=10_000)],
        Tag(way_of("more")),
    ],
    Discriminator(_one_or_more),
]
"""The temperatures of one thermal state, or of several."""


class VolumetricErrorRequest(FieldRequest):
    """Points at which the volumetric error is asked."""

    model_config = ConfigDict(
        json_schema_extra={
            "example": {
                "temperatures_c": {"x-middle": 24.1, "z-column": 27.3},
                "points_mm": [[0, 0, 0], [250, 100, 300]],
                "tool_offset_mm": [0, 0, 160],
                "missing_components": "zero",
            }
        }
    )

    temperatures_c: OneOrMoreStates | None = Field(  # type: ignore[assignment]
        None,
        description="Temperatures by sensor [°C], or a list of them for several thermal states; "
        "those of the latest reading if left out",
    )
    points_mm: Points = Field(
        description="Nominal points x, y, z [mm]", examples=[[[0, 0, 0], [250, 100, 300]]]
    )
    outside_travel: Literal["refuse", "allow"] = Field(
        "refuse",
        description="What happens to points outside the axes' travel: `refuse` names the first, "
        "`allow` answers and flags them",
    )

    def question(self) -> FieldQuestion:
        """Make the question."""
        from app.services.ask_field import FieldQuestion

        given_c = self.temperatures_c
        states = [given_c] if isinstance(given_c, dict) else given_c
        return FieldQuestion(
            temperatures_c=states,
            tool_offset_mm=triple(self.tool_offset_mm),
            directions=signs_of(self.direction),
            missing_as_zero=self.missing_components == "zero",
            state=self.state,
        )

    @property
    def several_states(self) -> bool:
        """Whether the answer has an axis of thermal states."""
        return isinstance(self.temperatures_c, list)


Vectors = list[list[Number]] | list[list[list[Number]]]


class VolumetricErrorAnswer(AnswerHead):
    """The errors at the points, in their order."""

    errors_um: Vectors = Field(
        description="Actual minus nominal position x, y, z of the tool at each point [µm]; one "
        "such list for each thermal state where a list of temperatures was sent",
        examples=[[[1.2, -0.4, 3.3]]],
    )
    orientation_urad: Vectors = Field(
        description="Error of the tool's direction, (ΣEB, −ΣEA, 0), at each point [µrad]",
        examples=[[[20.1, -3.0, 0.0]]],
    )
    outside_travel: list[int] = Field(
        description="Indices of the points outside the axes' travel, from 0"
    )
