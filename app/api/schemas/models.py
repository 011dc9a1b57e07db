"""Sensor assignment and model versions over HTTP."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final, Self

from pydantic import Field, RootModel, field_validator

from app.api.schemas.model_change import ModelChange, change_fields
from app.effects.valid import LearntIn
from app.errors import FieldError, InvalidContent, UnknownComponent
from app.geometry.components import ORDER, parse_component
from app.rounding import Parameters
from app.stated import Number, Schema, UtcTime
from app.thermal.sensor_assignment import Proposal

if TYPE_CHECKING:
    from app.effects.adopted.model_difference import ModelWithEffects
    from app.effects.effect import Effect
    from app.services.change_model import MadeVersion
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


class CorrelationAnswer(Schema):
    """The proposal; nothing has changed."""

    proposal: dict[str, str] = Field(
        description="The assignment that the maps speak for, ready to be PUT"
    )
    components: list[Proposal] = Field(description="One for each component of the maps")

    @classmethod
    def of(cls, proposals: Sequence[Proposal]) -> Self:
        """Show proposals."""
        proposed = {p.code: p.proposed_sensor for p in proposals if p.proposed_sensor is not None}
        return cls(proposal=proposed, components=list(proposals))


class ModelMap(Schema):
    """One of the maps that a version is made of."""

    id: int = Field(description="The map's number")
    label: str = Field(description="The map's name", examples=["Run #1"])
    temperatures_c: dict[str, Number] = Field(description="Its sensors' temperatures [°C]")


class AdoptedEffectAnswer(Schema):
    """An effect that the version has adopted."""

    kind: str = Field(description="Kind of the effect", examples=["thermal-lag"])
    variant: str = Field(description="Which form of the kind, empty where it has one only")
    components: list[str] = Field(description="Components that it acts on", examples=[["EZZ"]])
    sensors: list[str] = Field(description="Sensors that drive it", examples=[["z-column"]])
    states: list[str] = Field(description="States of the machine that drive it")
    parameters: Parameters = Field(
        description="Parameters; their names say the unit",
        examples=[{"time_constant_min": 41.2}],
    )
    standard_errors: Parameters = Field(
        description="One standard deviation of those that were estimated",
        examples=[{"time_constant_min": 1.9}],
    )
    explanation: str = Field(
        description="What it is, in a sentence", examples=["EZZ follows z-column 41 ± 2 min late"]
    )
    valid: LearntIn | None = Field(
        description="Where it was learnt; null where an older version of this software adopted it"
    )
    found_by: int | None = Field(
        description="Number of the analysis that found it; null where an older version of this "
        "software adopted it"
    )
    refitted_by: list[int] = Field(
        description="Numbers of the analyses that have fitted it anew since, in their order"
    )
    measure_again: str = Field(
        description="Until when one that grows with time may be used, and what to measure then"
    )

    @classmethod
    def of(cls, effect: Effect) -> Self:
        """Show an effect."""
        from app.effects.adopted.held import use_until
        from app.effects.registry import explain

        return cls(
            kind=effect.kind,
            variant=effect.variant,
            components=list(effect.components),
            sensors=list(effect.sensors),
            states=list(effect.states),
            parameters=dict(effect.parameters),
            standard_errors=dict(effect.standard_errors),
            explanation=explain(effect),
            valid=effect.learnt_in,
            found_by=effect.provenance.found_by if effect.provenance else None,
            refitted_by=list(effect.provenance.refitted_by) if effect.provenance else [],
            measure_again=use_until(effect),
        )


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
    effects: list[AdoptedEffectAnswer] = Field(description="Adopted effects")

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
            effects=[AdoptedEffectAnswer.of(effect) for effect in adopted_effects(version)],
            **more,
        )


class ModelCoverageAnswer(Schema):
    """Which components the tables of a version have."""

    model_version: int = Field(description="Number of the version", examples=[3])
    components: list[str] = Field(description="Components of its tables", examples=[["EXX", "EZZ"]])
    omitted: dict[str, str] = Field(
        description="Component of its maps that no table has, to the reason",
        examples=[{"EYY": "no sensor is assigned to it"}],
    )

    @classmethod
    def of(cls, version: int, model: ModelWithEffects) -> Self:
        """Show what a version covers."""
        return cls(
            model_version=version,
            components=sorted(model.codes, key=ORDER.__getitem__),
            omitted=dict(model.model.omitted),
        )


class ChangedModelAnswer(ModelAnswer, ModelChange):
    """A version that was made or activated, and what its tables lose and gain by it."""

    @classmethod
    def of_made(cls, machine: str, new_version: MadeVersion) -> Self:
        """Show it."""
        waiting = None if new_version.is_active else new_version.version.version
        return cls.of(
            new_version.version,
            new_version.active_version,
            waiting,
            **change_fields(machine, new_version),
        )


class WaitingAssignmentAnswer(ModelChange):
    """An assignment whose version waits, because its tables would lose something."""

    assignment: dict[str, str] = Field(description="Component to sensor, in the waiting version")
