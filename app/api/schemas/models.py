"""Sensor assignment and model versions over HTTP."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final, Self

from pydantic import Field, RootModel, field_validator

from app.effects.adopted.described import AdoptedEffect, adopted_effect
from app.errors import FieldError, InvalidContent, UnknownComponent
from app.geometry.components import ORDER, parse_component
from app.services.change_model import MadeVersion, ModelChange
from app.stated import Number, Schema, UtcTime

if TYPE_CHECKING:
    from app.storage.records import ModelVersion


_PATTERN: Final = re.compile(r"(?=.*\*)[A-Z*^xyz]{1,6}")
"""A component's code with `*` for any letters."""


class AssignmentSchema(RootModel[dict[str, str]]):
    """Component to the sensor that it follows.

    Components are named by code or in the chapter's notation; `E*X` stands for all components of
    the maps whose code fits, and gives way to a component that is named itself.
    """

    model_config = {"json_schema_extra": {"examples": [{"E*X": "x-middle", "EZZ": "z-column"}]}}

    @field_validator("root", mode="before")
    @classmethod
    def _expect_components(cls, assignment: Any) -> Any:
        """Refuse unknown names before their values: who wraps an assignment is told of the name."""
        errors = []
        for name in assignment if isinstance(assignment, dict) else ():
            if _PATTERN.fullmatch(name):
                continue
            try:
                parse_component(name)
            except UnknownComponent as unknown:
                errors.append(FieldError(name, unknown.detail))
        if errors:
            raise InvalidContent("; ".join(e.message for e in errors), errors)
        return assignment

    def to_codes(self) -> dict[str, str]:
        """Read the components' names, patterns as they are; InvalidContent where one is twice."""
        by_code: dict[str, str] = {}
        for name, sensor in self.root.items():
            code = name if _PATTERN.fullmatch(name) else parse_component(name)[0].code
            if by_code.setdefault(code, sensor) != sensor:
                raise InvalidContent.of_field(name, f"{code} is assigned to two sensors")
        return by_code

    @classmethod
    def of(cls, assignment: dict[str, str]) -> Self:
        """Show an assignment in the order of the components."""
        return cls({code: assignment[code] for code in sorted(assignment, key=ORDER.__getitem__)})


class ModelMap(Schema):
    """One of the maps that a version is made of."""

    id: int = Field(description="The map's number")
    label: str = Field(description="The map's name", examples=["Run #1"])
    temperatures_c: dict[str, Number] = Field(description="Its sensors' temperatures [°C]")


class ModelAnswer(Schema):
    """One immutable version of a machine's model: its maps, its assignment and its effects.

    Tables are computed with it under the machine's settings (`out_of_range`, `same_temperature`,
    the sensors' `resolution_c` …) as they are now: changing these changes tables at once.
    """

    version: int = Field(description="Number of the version", examples=[3])
    active: bool = Field(description="Whether tables are computed with it now")
    waiting: bool = Field(
        False,
        description="Whether it waits for its activation because its tables would lose something",
    )
    created_at: UtcTime = Field(description="When it was made, UTC")
    reason: str = Field(description="What made it", examples=["map 'Run #3' stored"])
    maps: list[ModelMap] = Field(description="The error maps that it is made of")
    assignment: dict[str, str] = Field(description="Component to sensor")
    effects: Sequence[AdoptedEffect] = Field(description="Adopted effects")

    @classmethod
    def of(
        cls,
        version: ModelVersion,
        active: int | None,
        waiting: int | None = None,
        **more: Any,
    ) -> Self:
        """Show a version, given the numbers of the active one and of the one that waits."""
        from app.services.load_machine import adopted_effects

        return cls(
            version=version.version,
            active=version.version == active,
            waiting=version.version == waiting,
            created_at=version.created_at,
            reason=version.reason,
            maps=[
                ModelMap(
                    id=m.id,
                    label=m.error_map.label,
                    temperatures_c=dict(m.error_map.temperatures_c),
                )
                for m in version.maps
            ],
            assignment=AssignmentSchema.of(dict(version.assignment)).root,
            effects=list(map(adopted_effect, adopted_effects(version))),
            **more,
        )


class ChangedModelAnswer(ModelAnswer, ModelChange):
    """A version that was made or activated, and what its tables lose and gain by it."""

    @classmethod
    def of_made(cls, new_version: MadeVersion) -> Self:
        """Show it."""
        number = new_version.version.version
        active, waiting = (number, None) if new_version.is_active else (None, number)
        return cls.of(new_version.version, active, waiting, **dict(new_version.change))


class WaitingAssignmentAnswer(ModelChange):
    """An assignment whose version waits, because its tables would lose something."""

    assignment: dict[str, str] = Field(description="Component to sensor, in the waiting version")
