"""The compensation table over HTTP: what `app.api.table_json` writes."""

from __future__ import annotations

from pydantic import Field

from app.answer import IN_ITS_UNIT
from app.effects.valid import LearntIn
from app.stated import MachineState, Number, Schema, Temperatures, UtcTime


class CompensationRequest(Schema):
    """The live temperatures for which the table is asked."""

    temperatures_c: Temperatures = Field(description="Live temperatures by sensor [°C]")
    state: MachineState


class FollowsAnswer(Schema):
    """A sensor by whose temperature a component's maps are read."""

    sensor: str = Field(description="Sensor", examples=["spindle"])
    temperature_c: Number = Field(
        description="Its temperature [°C], at the edge of where the effect was learnt if beyond"
    )
    share: Number = Field(
        description="Share of that in the numbers; all sum to 1. Beyond where the effect was "
        "learnt, what it makes of the maps is held at the edge and the assigned sensor goes on: of "
        "a share of 0.9975 there are then 0.9975 of the other sensor at the edge, 1 of the "
        "assigned one now, and -0.9975 of the assigned one at the edge",
        examples=[0.97],
    )


class ComponentCompensationAnswer(Schema):
    """One component's error and compensation at the live temperatures.

    Tables have `positions_mm` and lists; squareness and rotary-axis locations have
    single numbers. The compensation is minus the error: what is to be added to the
    command.
    """

    component: str = Field(description="ISO 230-1 code", examples=["EXX"])
    chapter: str = Field(description="The chapter's notation", examples=["D_x(x)"])
    axis: str | None = Field(description="Axis of the positions, null for a single value")
    positions_mm: list[Number] | None = Field(None, description="Positions on the axis [mm]")
    errors_um: list[Number] | None = Field(None, description="Errors [µm]")
    errors_urad: list[Number] | None = Field(None, description="Angular errors [µrad]")
    slopes_um_per_m: list[Number] | None = Field(None, description="Nonrigid slopes [µm/m]")
    slopes_urad_per_m: list[Number] | None = Field(None, description="Nonrigid slopes [µrad/m]")
    error_um_per_m: Number | None = Field(None, description="Squareness [µm/m]")
    error_um: Number | None = Field(None, description="Rotary-axis position error [µm]")
    error_urad: Number | None = Field(None, description="Rotary-axis direction error [µrad]")
    standard_errors_um: list[Number] | None = Field(
        None,
        description="Standard error of each error and its compensation [µm], as far as the "
        "measurement of the maps goes: temperatures count as exact at the maps and between them, "
        "beyond the maps what their resolution adds over the edge is in it; absent where a map "
        "that enters states none",
    )
    standard_errors_urad: list[Number] | None = Field(None, description="The same [µrad]")
    standard_errors_um_per_m: list[Number] | None = Field(None, description="The same [µm/m]")
    standard_errors_urad_per_m: list[Number] | None = Field(None, description="The same [µrad/m]")
    standard_error_um_per_m: Number | None = Field(
        None, description="Standard error of a squareness [µm/m]"
    )
    standard_error_um: Number | None = Field(
        None, description="Standard error of a rotary axis' position [µm]"
    )
    standard_error_urad: Number | None = Field(
        None, description="Standard error of a rotary axis' direction [µrad]"
    )
    compensation_um: list[Number] | Number | None = Field(None, description="Minus the error [µm]")
    compensation_urad: list[Number] | Number | None = Field(
        None, description="Minus the error [µrad]"
    )
    compensation_um_per_m: list[Number] | Number | None = Field(
        None, description="Minus the slope or squareness [µm/m]"
    )
    compensation_urad_per_m: list[Number] | None = Field(
        None, description="Minus the slope [µrad/m]"
    )
    backward_errors_um: list[Number] | None = Field(
        None, description="Errors when approached in the negative direction [µm]"
    )
    backward_errors_urad: list[Number] | None = Field(None, description="The same [µrad]")
    backward_slopes_um_per_m: list[Number] | None = Field(None, description="The same [µm/m]")
    backward_slopes_urad_per_m: list[Number] | None = Field(None, description="The same [µrad/m]")
    backward_standard_errors_um: list[Number] | None = Field(
        None, description="Standard errors of the backward errors [µm]"
    )
    backward_standard_errors_urad: list[Number] | None = Field(None, description="The same [µrad]")
    backward_standard_errors_um_per_m: list[Number] | None = Field(
        None, description="The same [µm/m]"
    )
    backward_standard_errors_urad_per_m: list[Number] | None = Field(
        None, description="The same [µrad/m]"
    )
    backward_compensation_um: list[Number] | None = Field(
        None, description="Minus the backward error [µm]"
    )
    backward_compensation_urad: list[Number] | None = Field(None, description="The same [µrad]")
    backward_compensation_um_per_m: list[Number] | None = Field(None, description="The same [µm/m]")
    backward_compensation_urad_per_m: list[Number] | None = Field(
        None, description="The same [µrad/m]"
    )
    iso: str | None = Field(None, description="ISO 230-1 name of a squareness", examples=["C0Y"])
    iso_error_urad: Number | None = Field(None, description="Its error in ISO's sign [µrad]")
    sensor: str | None = Field(
        description="Sensor that was used, by an adopted effect too; null, as are the next four, "
        "where no two maps have the component and adopted effects alone give it an error",
        examples=["x-middle"],
    )
    stand_in_for: str | None = Field(
        None, description="Assigned sensor, where another one stands in for it"
    )
    follows: list[FollowsAnswer] | None = Field(
        None,
        description="Where an adopted effect says that the component follows another sensor than "
        "the assigned one: every sensor by whose temperature its maps are read, the largest share "
        "first; `sensor` is the first of them",
    )
    temperature_c: Number | None = Field(description="That sensor's temperature T_u [°C]")
    lower_map: str | None = Field(
        description="Label of the lower map (T_n); null, as are the next two, where several "
        "sensors are followed and the numbers are not on one line between two maps",
        examples=["Run #1"],
    )
    upper_map: str | None = Field(description="Label of the upper map (T_m)", examples=["Run #3"])
    weight: Number | None = Field(
        description="The upper map's share, (T_u − T_n)/(T_m − T_n)", examples=[0.42]
    )
    status: str = Field(
        description="`interpolated`, `at-map`, `clamped`, `extrapolated`, `stand-in`, "
        "`effects-only`, or `held`: an adopted effect lies outside where it was learnt, and is "
        "held at the edge of that. `clamped` and `extrapolated` go before `held`; the warnings "
        "say both",
        examples=["interpolated"],
    )
    effects: list[str] = Field(
        description="Kinds of the adopted effects that are in these numbers; a component with "
        "effects has no standard errors, because the maps do not say how sure an effect is",
        examples=[["thermal-lag"]],
    )


class SurenessAnswer(Schema):
    """How sure a learnt effect is of one component at this moment, in the component's unit."""

    component: str = Field(description="Component code", examples=["EZZ"])
    expected: float = Field(description=f"What was learnt beside the maps {IN_ITS_UNIT}")
    learnt_error: float = Field(description=f"Standard deviation of what was learnt {IN_ITS_UNIT}")
    wander_error: float = Field(
        description=f"Standard deviation of what no driver explains {IN_ITS_UNIT}"
    )
    corrected: float = Field(description=f"What of it is in the table {IN_ITS_UNIT}")


class EffectInTableAnswer(Schema):
    """An adopted effect of the model, and whether it is in the table."""

    kind: str = Field(description="Kind of the effect", examples=["thermal-lag"])
    components: list[str] = Field(description="Components that it acts on", examples=[["EZZ"]])
    sensors: list[str] = Field(description="Sensors that drive it", examples=[["z-column"]])
    explanation: str = Field(
        description="What it is, in a sentence", examples=["EZZ follows z-column 41 ± 2 min late"]
    )
    in_table: bool = Field(description="Whether it could be evaluated and is in the numbers")
    missing: str = Field(description="What it lacks, empty where nothing")
    held: list[str] = Field(
        [],
        description="Why it is held at the edge of where it was learnt: which quantity, its value, "
        "and the range; empty where it is not",
    )
    valid: LearntIn | None = Field(
        None,
        description="Where it was learnt; null where an older version of this software adopted it",
    )
    measure_again: str = Field(
        "", description="Until when one that grows with time may be used, and what to measure then"
    )
    sureness: list[SurenessAnswer] = Field(
        [],
        description="Of one that is corrected only as far as it is sure: how sure it is now, for "
        "each component; empty for others",
    )


class CompensationAnswer(Schema):
    """The compensation table at stated temperatures.

    Adopted effects act as far as the request carries what they need: temperatures, the
    machine's `state`, and the present time. Those that need the past, such as a thermal lag,
    are in the table at the latest reading only.
    """

    machine: str = Field(description="The machine's id", examples=["mcfv5050"])
    model_version: int = Field(description="Version of the model", examples=[3])
    computed_at: UtcTime = Field(description="When it was computed, UTC")
    complete: bool = Field(
        description=(
            "Whether every component of the maps and every adopted effect is in the table, none "
            "on an old temperature or ending where other maps of it go on, no effect outside "
            "where it was learnt, and no value in use from a reading that arrived before its time"
        )
    )
    warnings: list[str] = Field(description="All that is not as it should be, in sentences")
    effects: list[EffectInTableAnswer] = Field(
        [], description="The model's adopted effects, in the table or not"
    )
    components: list[ComponentCompensationAnswer] = Field(description="One for each component")


class SensorStateAnswer(Schema):
    """One sensor now."""

    sensor: str = Field(description="Sensor", examples=["x-middle"])
    health: str = Field(
        description="`ok`, `missing`, `stale`, `out-of-range`, `stuck`, `jump`, or `faulty`: an "
        "adopted effect says that it reads wrong, and another sensor stands in",
        examples=["ok"],
    )
    temperature_c: Number | None = Field(description="Its last value [°C]")
    age_s: Number | None = Field(description="Age of that value [s]")
    detail: str = Field(description="What is the matter, empty when all is well")


class CurrentCompensationAnswer(CompensationAnswer):
    """The compensation table at the latest reading."""

    reading_time: UtcTime = Field(description="Time of the latest reading, UTC")
    reading_age_s: Number = Field(description="Its age [s]")
    stale: bool = Field(description="Whether any sensor's value is older than it may be")
    sensors: list[SensorStateAnswer] = Field(description="Every sensor's state")
