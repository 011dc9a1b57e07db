"""Machines over HTTP."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from typing import Self

from pydantic import ConfigDict, Field

from app.answer import fields_of
from app.errors import InvalidContent
from app.stated import Name, Schema
from app.storage.records import StoredMachine
from app.thermal.machine import (
    EXAMPLE,
    MACHINE,
    ErrorRatio,
    Machine,
    Margin,
    OutOfRange,
    SameTemperature,
    StatedSensors,
    Travel,
)


@dataclass(frozen=True, kw_only=True)
class MachineAnswer(Machine, whole=False, example=EXAMPLE):
    """A machine as it is stored."""

    active_model: int | None
    """Active model version, null before the first map"""
    waiting_model: int | None = None
    """Version that has all that was stored and waits for its activation, because tables would lose
    something; null where none waits"""
    created_at: datetime
    """When it was created, UTC"""
    watch: str | None = None
    """What the last verifications say of the active model: `within` or `beyond` its limits
    (…/watch says more); null where none was judged"""

    @classmethod
    def of(cls, stored: StoredMachine) -> Self:
        """Show a stored machine."""
        return cls(
            **fields_of(stored.machine),
            active_model=stored.active_version,
            waiting_model=stored.waiting_version,
            created_at=stored.created_at,
            watch=stored.watch,
        )


class MachinePatch(Schema):
    """The settings to change; lists are replaced whole, axes one by one (RFC 7396)."""

    model_config = ConfigDict(json_schema_extra={"example": {"out_of_range": "extrapolate"}})

    name: Name | None = Field(None, description="Name for people")
    serial_number: Name | None = Field(None, description="Serial number; null removes it")
    configuration: str | None = Field(None, description="Kinematic chain", examples=["XYFZ"])
    axes: dict[str, Travel | None] | None = Field(
        None, description="Travels to change [mm]; null removes one"
    )
    sensors: StatedSensors | None = Field(None, description="All sensors, replacing the old")
    out_of_range: OutOfRange | None = Field(None, description="Policy outside the maps")
    extrapolation_margin_c: Margin | None = Field(
        None, description="How far `extrapolate` may go [°C]"
    )
    extrapolation_error_ratio: ErrorRatio | None = Field(
        None, description="How uncertain `extrapolate` may become, in times of the maps' own"
    )
    same_temperature: SameTemperature | None = Field(
        None, description="Policy for maps at one temperature"
    )

    def apply(self, machine: Machine) -> Machine:
        """Merge into a machine's present settings; InvalidContent where null makes no sense."""
        present = MACHINE.dump_python(machine)
        for field in self.model_fields_set:
            value = getattr(self, field)
            if value is None and field != "serial_number":
                raise InvalidContent.of_field(field, "expected a value, got null")
            if field == "axes":
                merged = {**present["axes"], **{a.lower(): t for a, t in value.items()}}
                value = {axis: travel for axis, travel in merged.items() if travel is not None}
            present[field] = value
        return MACHINE.validate_python(present)
