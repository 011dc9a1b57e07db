"""What is asked of controllers' files over HTTP: exports, what files hold, and comparisons."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

from pydantic import Field

from app.api.schemas.base import MachineState, Name, Number, Point, Schema, Temperatures
from app.api.schemas.error_field import triple
from app.controllers.format import ControllerFile
from app.services.ask_field import FieldQuestion
from app.services.controllers import BandsWanted

StatedOptions = Annotated[
    dict[str, Any],
    Field(
        default_factory=dict,
        max_length=100,
        description="Options of the format, as `GET /v1/controllers` lists them",
        examples=[{"sign": "error"}],
    ),
]


class _AtTemperatures(Schema):
    """At which temperatures a controller's files are asked for."""

    temperatures_c: Temperatures | None = Field(
        None, description="Temperatures by sensor [°C]; those of the latest reading if left out"
    )
    state: MachineState
    tool_offset_mm: Point = Field(
        [0.0, 0.0, 0.0],
        description="Tool offset X, Y, Z [mm] at which angular errors are sized",
        examples=[[0, 0, 160]],
    )
    options: StatedOptions

    def question(self) -> FieldQuestion:
        """Make the question."""
        given_c = self.temperatures_c
        return FieldQuestion(
            temperatures_c=None if given_c is None else [given_c],
            tool_offset_mm=triple(self.tool_offset_mm),
            missing_as_zero=True,
            state=self.state,
        )


class BandsRequest(Schema):
    """A range of temperatures over which a set of tables is wanted."""

    from_c: Temperatures = Field(description="Temperatures at one end [°C]")
    to_c: Temperatures = Field(description="Temperatures of the same sensors at the other end [°C]")
    largest_step_um: Annotated[Number, Field(gt=0, le=1e6)] = Field(
        description="So much a component may change from one table to the next [µm; angles µrad]"
    )

    def wanted(self) -> BandsWanted:
        """Make what the service is asked for."""
        return BandsWanted(self.from_c, self.to_c, self.largest_step_um)


class ExportRequest(_AtTemperatures):
    """What is to be exported: at which temperatures, with which options, over which bands."""

    bands: BandsRequest | None = Field(
        None,
        description="A set of tables over a range of temperatures, for a controller that cannot "
        "ask a service; other sensors keep `temperatures_c`",
    )


class ControllerFileSchema(Schema):
    """One file of a controller."""

    name: Name = Field(description="Its name", examples=["x.comp"])
    content: Annotated[str, Field(max_length=4_000_000)] = Field(description="Its text")


Files = Annotated[
    list[ControllerFileSchema],
    Field(min_length=1, max_length=100, description="All files of one controller"),
]


def files_of(files: Sequence[ControllerFileSchema]) -> list[ControllerFile]:
    """Take files as the parsers want them."""
    return [ControllerFile(file.name, file.content) for file in files]


class ParseRequest(Schema):
    """Files that are to be read."""

    files: Files
    options: StatedOptions


class CompareRequest(_AtTemperatures):
    """Files that are compared with what they should hold, at which temperatures."""

    files: Files
