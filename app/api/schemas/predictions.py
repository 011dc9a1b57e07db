"""Predictions over HTTP."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from pydantic import ConfigDict, Field

from app.errors import InvalidContent, UnknownComponent, list_names
from app.geometry.components import LINEAR_LETTERS, Component, parse_component
from app.in_pieces import InPieces
from app.stated import (
    Direction,
    Integer,
    MachineState,
    Millimetres,
    MissingComponents,
    Point,
    Schema,
    UtcTime,
    signs_of,
)

if TYPE_CHECKING:
    from app.services.predictions import ErrorQuestion


class ObservationSchema(Schema):
    """Where and when: one component at a position, or a point of the work volume."""

    time: UtcTime = Field(description="When, with a zone", examples=["2026-03-01T06:00:00Z"])
    component: str | None = Field(None, description="Component", examples=["EZZ"])
    position_mm: Millimetres | None = Field(None, description="Position on its axis [mm]")
    direction: Direction = Field(
        None,
        description="Direction of approach, or of each axis at a point; the mean of both where "
        "it is not stated",
        examples=["+", {"x": "+", "z": "-"}],
    )
    point_mm: Point | None = Field(None, description="Nominal point x, y, z [mm]")
    tool_offset_mm: Point = Field((0.0, 0.0, 0.0), description="Tool offset X, Y, Z [mm]")
    state: MachineState

    def to_observation(self) -> ErrorQuestion:
        """Make the observation; InvalidContent unless it is one component or one point."""
        from app.services.predictions import ErrorQuestion

        if (self.component is None) == (self.point_mm is None):
            raise InvalidContent.of_field(
                "component", "expected a component or a point_mm, and not both"
            )
        directions = signs_of(self.direction)
        if self.point_mm is not None:
            return ErrorQuestion(
                self.time,
                point_mm=self.point_mm,
                tool_offset_mm=self.tool_offset_mm,
                directions=directions,
                state=self.state,
            )
        try:
            component, sign = parse_component(str(self.component))
        except UnknownComponent as error:
            raise InvalidContent.of_field("component", error.detail) from None
        if component.is_table and self.position_mm is None:
            raise InvalidContent.of_field(
                "position_mm", f"expected a position of {component.code} in mm, got none"
            )
        self._refuse_what_it_cannot_have(component)
        return ErrorQuestion(
            self.time,
            component.code,
            self.position_mm,
            directions=directions,
            sign=sign,
            state=self.state,
        )

    def _refuse_what_it_cannot_have(self, component: Component) -> None:
        """Refuse a place or an approach that would be left unread."""
        if not component.is_table:
            for field in ("position_mm", "direction"):
                if getattr(self, field) is not None:
                    raise InvalidContent.of_field(
                        field, f"expected none of {component.code}, which has no position, got one"
                    )
        signs = self.direction or {}
        of_all = len(signs) == len(LINEAR_LETTERS) and len(set(signs.values())) == 1
        others = [axis for axis in signs if axis != component.axis]
        if others and not of_all:
            raise InvalidContent.of_field(
                "direction",
                f"expected the approach of {component.axis} alone for {component.code}, got "
                f"{list_names(sorted(signs))}",
            )


class PredictionRequest(Schema):
    """What is to be predicted, and with which version."""

    model_config = ConfigDict(
        json_schema_extra={
            "example": {
                "observations": [
                    {"time": "2026-03-01T06:00:00Z", "component": "EXX", "position_mm": 250}
                ]
            }
        }
    )

    observations: Annotated[list[ObservationSchema], InPieces(100_000)] = Field(
        description="Where and when"
    )
    model_version: Integer | None = Field(None, description="Version; the active one if not stated")
    missing_components: MissingComponents

    def to_observations(self) -> list[ErrorQuestion]:
        """Make the observations; InvalidContent names the one that is wrong."""
        questions = []
        for i, observation in enumerate(self.observations):
            try:
                questions.append(observation.to_observation())
            except InvalidContent as error:
                raise error.inside(f"observations.{i}") from None
        return questions
