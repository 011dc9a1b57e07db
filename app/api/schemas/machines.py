"""Machines over HTTP."""

from __future__ import annotations

import re
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated, Any, Self

from pydantic import BeforeValidator, ConfigDict, Field, StringConstraints

from app.errors import InvalidContent
from app.geometry.chain import Chain
from app.stated import Name, Number, Schema, UtcTime
from app.thermal.machine import (
    DEFAULT_STAND_INS,
    Machine,
    OutOfRange,
    SameTemperature,
    Sensor,
    Travel,
    sensors_by_name,
)

if TYPE_CHECKING:
    from app.storage.records import StoredMachine

_MACHINE_ID = r"^[A-Za-z0-9][A-Za-z0-9._-]{0,63}$"


def _fit_for_a_url(text: Any) -> Any:
    """Say in words what the pattern says; what is no text is refused for that."""
    if isinstance(text, str) and not re.fullmatch(_MACHINE_ID, text):
        raise ValueError(
            "1 to 64 letters from a to z or A to Z, digits, dots, hyphens or underscores, the "
            "first of them a letter or digit"
        )
    return text


MachineId = Annotated[
    str,
    BeforeValidator(_fit_for_a_url),
    StringConstraints(pattern=_MACHINE_ID),
    Field(description="Short name used in URLs", examples=["mcfv5050"]),
]

_USUAL = Sensor("")
_A_YEAR_S = 366 * 86_400

Margin = Annotated[Number, Field(ge=0, le=1000)]
"""How far extrapolation may go [°C]."""

ErrorRatio = Annotated[Number, Field(ge=1, le=1000)]
"""How many times as uncertain as its maps an extrapolated value may be."""


class SensorSchema(Schema):
    """A temperature sensor and what is physically believable of it."""

    name: str = Field(description="Name of the sensor", examples=["x-middle"])
    stand_in: str | None = Field(
        None,
        description=(
            "Sensor whose own temperatures serve when this one fails; "
            "x-middle has y-front where nothing is stated"
        ),
        examples=["y-front"],
    )
    min_c: Annotated[Number, Field(ge=-273.15)] = Field(
        _USUAL.min_c, description="Lowest believable temperature [°C]"
    )
    max_c: Annotated[Number, Field(le=10_000)] = Field(
        _USUAL.max_c, description="Highest believable temperature [°C]"
    )
    max_age_s: Annotated[Number, Field(gt=0, le=_A_YEAR_S)] = Field(
        _USUAL.max_age_s,
        description="Age above which a value is stale; longest gap bridged in time [s]",
    )
    resolution_c: Annotated[Number, Field(gt=0, le=1000)] = Field(
        _USUAL.resolution_c,
        description=(
            "Temperatures closer than this are the same; ten times this is a movement that "
            "sensors must show [°C]"
        ),
    )
    stuck_after_s: Annotated[Number, Field(gt=0, le=86400)] | None = Field(
        _USUAL.stuck_after_s,
        description=(
            "Without any change for this long after its neighbours moved clearly, it is stuck "
            "[s]; null for a sensor that may stand still"
        ),
    )
    max_rate_c_per_min: Annotated[Number, Field(gt=0, le=1e6)] = Field(
        _USUAL.max_rate_c_per_min,
        description="A change faster than this is no temperature [°C/min]",
    )


class MachineSettings(Schema):
    """A machine's description as a user states it."""

    model_config = ConfigDict(
        json_schema_extra={
            "example": {
                "id": "mcfv5050",
                "name": "MCFV5050LN",
                "configuration": "XYFZ",
                "axes": {"x": {"min_mm": 0, "max_mm": 500}},
                "sensors": [
                    {"name": "x-middle", "stand_in": "y-front"},
                    {"name": "y-front"},
                    {"name": "z-column"},
                ],
            }
        }
    )

    id: MachineId
    name: Name = Field(description="Name for people", examples=["MCFV5050LN"])
    serial_number: Name | None = Field(
        None, description="The manufacturer's, as on the type plate", examples=["5050-1274"]
    )
    configuration: str = Field(
        description="Kinematic chain: axes before F move the workpiece, those after it the tool",
        examples=["XYFZ"],
    )
    axes: dict[str, Travel] = Field(
        default_factory=dict,
        description="Travel of each axis [mm]",
        examples=[{"x": {"min_mm": 0, "max_mm": 500}}],
    )
    sensors: list[SensorSchema] = Field(
        default_factory=list, max_length=1000, description="The machine's temperature sensors"
    )
    out_of_range: OutOfRange = Field(
        OutOfRange.CLAMP, description="What happens at temperatures outside the maps"
    )
    extrapolation_margin_c: Margin = Field(
        5.0, description="How far `extrapolate` may go beyond the maps [°C]"
    )
    extrapolation_error_ratio: ErrorRatio = Field(
        3.0,
        description="How many times as large as at the edge of the maps the standard error of an "
        "extrapolated value may be; further out the value there is held",
    )
    same_temperature: SameTemperature = Field(
        SameTemperature.REFUSE,
        description="What happens to maps closer in temperature than a sensor resolves",
    )

    def to_machine(self) -> Machine:
        """Make the machine, with its default stand-ins; InvalidContent as `Machine`."""
        names = {sensor.name for sensor in self.sensors}
        return Machine(
            id=self.id,
            name=self.name,
            chain=Chain.parse(self.configuration),
            axes={axis.lower(): travel for axis, travel in self.axes.items()},
            sensors=sensors_by_name([_to_sensor(sensor, names) for sensor in self.sensors]),
            out_of_range=self.out_of_range,
            extrapolation_margin_c=self.extrapolation_margin_c,
            extrapolation_error_ratio=self.extrapolation_error_ratio,
            same_temperature=self.same_temperature,
            serial_number=self.serial_number,
        )


class MachineAnswer(MachineSettings):
    """A machine as it is stored."""

    active_model: int | None = Field(description="Active model version, null before the first map")
    waiting_model: int | None = Field(
        None,
        description="Version that has all that was stored and waits for its activation, because "
        "tables would lose something; null where none waits",
    )
    created_at: UtcTime = Field(description="When it was created, UTC")
    watch: str | None = Field(
        None,
        description="What the last verifications say of the active model: `within` or `beyond` "
        "its limits (…/watch says more); null where none was judged",
    )

    @classmethod
    def of(cls, stored: StoredMachine) -> Self:
        """Show a stored machine."""
        return cls(
            **settings_of(stored.machine),
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
    sensors: list[SensorSchema] | None = Field(None, description="All sensors, replacing the old")
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
        present = settings_of(machine)
        for field in self.model_fields_set:
            value = getattr(self, field)
            if value is None and field != "serial_number":
                raise InvalidContent.of_field(field, "expected a value, got null")
            if field == "axes":
                merged = {**present["axes"], **{a.lower(): t for a, t in value.items()}}
                value = {axis: travel for axis, travel in merged.items() if travel is not None}
            present[field] = value
        return MachineSettings.model_validate(present).to_machine()


def settings_of(machine: Machine) -> dict[str, Any]:
    """Write a machine's settings as `MachineSettings` takes them."""
    return {
        "id": machine.id,
        "name": machine.name,
        "serial_number": machine.serial_number,
        "configuration": machine.chain.text,
        "axes": dict(machine.axes),
        "sensors": [SensorSchema(**asdict(sensor)) for sensor in machine.sensors.values()],
        "out_of_range": machine.out_of_range,
        "extrapolation_margin_c": machine.extrapolation_margin_c,
        "extrapolation_error_ratio": machine.extrapolation_error_ratio,
        "same_temperature": machine.same_temperature,
    }


def _to_sensor(sensor: SensorSchema, names: set[str]) -> Sensor:
    fields = sensor.model_dump()
    usual = DEFAULT_STAND_INS.get(sensor.name)
    if "stand_in" not in sensor.model_fields_set and usual in names:
        fields["stand_in"] = usual
    return Sensor(**fields)
