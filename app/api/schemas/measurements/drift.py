"""Thermal drift read by a nest of displacement sensors (ISO 230-3), over HTTP."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Final, Self

from pydantic import ConfigDict, Field

from app.api.schemas.base import MachineState, Millimetres, Number, Point, Schema, UtcTime
from app.api.schemas.error_maps import ComponentAnswer
from app.api.schemas.in_pieces import InPieces
from app.api.schemas.measurements.base import Axis, MeasurementAnswer, MeasurementRequest
from app.errors import InvalidContent
from app.measurement.thermal_drift_readings import SENSORS, DriftTest
from app.rounding import Digits
from app.services.thermal_drift import DriftReading, KeptVerification
from app.units import SECONDS_PER_MIN

if TYPE_CHECKING:
    from app.services.thermal_drift import KeptState

MOST_READINGS: Final = 10_000
"""A week of a reading a minute."""


class NestReading(Schema):
    """What the nest, the temperature sensors and the control said at one time."""

    time: UtcTime = Field(description="When, with a zone", examples=["2026-03-01T06:00:00Z"])
    position_mm: Millimetres | None = Field(
        None, description="Where the moving axis stood [mm]; of the test linear-axis alone"
    )
    x_um: Number | None = Field(
        None,
        description="Displacement of the tool against the workpiece along X, from any zero [µm]",
    )
    y_um: Number | None = Field(None, description="The same along Y [µm]")
    z_um: Number | None = Field(None, description="The same along Z [µm]")
    x2_um: Number | None = Field(
        None, description="Along X, read sensor_distance_mm further along Z than x_um [µm]"
    )
    y2_um: Number | None = Field(None, description="Along Y, as far from y_um [µm]")
    temperatures_c: dict[str, Number] = Field(
        default_factory=dict,
        max_length=1000,
        description="Temperatures by sensor at that time [°C]; leave a failed sensor out",
        examples=[{"x-middle": 24.1, "z-column": 27.3}],
    )
    state: MachineState


class ThermalDriftRequest(MeasurementRequest):
    """A nest of displacement sensors over hours, with the machine's temperatures.

    `measured_at` and `temperatures_c` of the whole are not used: each reading states its own.
    """

    model_config = ConfigDict(
        json_schema_extra={
            "example": {
                "test": "spindle",
                "point_mm": [250, 200, 200],
                "tool_offset_mm": [0, 0, 160],
                "readings": [
                    {
                        "time": "2026-03-01T06:00:00Z",
                        "x_um": 0.2,
                        "y_um": -0.1,
                        "z_um": 0.0,
                        "temperatures_c": {"x-middle": 20.1, "y-front": 20.0, "z-column": 20.3},
                    },
                    {
                        "time": "2026-03-01T06:30:00Z",
                        "x_um": 1.1,
                        "y_um": 2.4,
                        "z_um": 9.3,
                        "temperatures_c": {"x-middle": 20.4, "y-front": 20.2, "z-column": 23.9},
                    },
                    {
                        "time": "2026-03-01T07:00:00Z",
                        "x_um": 1.6,
                        "y_um": 3.9,
                        "z_um": 14.2,
                        "temperatures_c": {"x-middle": 20.9, "y-front": 20.5, "z-column": 26.1},
                    },
                ],
            }
        }
    )

    test: DriftTest = Field(
        description="`environment` (nothing moves: ETVE), `spindle` (it turns), `linear-axis` "
        "(an axis runs between targets)"
    )
    readings: Annotated[list[NestReading], InPieces(MOST_READINGS)] = Field(
        description="Two or more, in order of time; all with the same displacements"
    )
    axis: Axis | None = Field(None, description="The moving axis, of the test linear-axis")
    sensor_distance_mm: Number | None = Field(
        None,
        description="How far along Z x2_um and y2_um are read from x_um and y_um, with its sign "
        "[mm]; with them come the tilts A and B",
        examples=[100.0],
    )
    running_from: UtcTime | None = Field(
        None,
        description="Since when the spindle turned or the axis moved; from the state spindle_rpm "
        "where left out, else from the first reading",
    )
    running_to: UtcTime | None = Field(None, description="Until when; as running_from")
    point_mm: Point | None = Field(
        None,
        description="Where the machine stood while the nest was read [mm]; tables and "
        "verifications of displacements need it",
    )
    tool_offset_mm: Point = Field(
        [0.0, 0.0, 0.0], description="Offset, as a tool, of the place that x, y and z read [mm]"
    )
    components: dict[str, str] = Field(
        default_factory=dict,
        description="Displacement (x, y, z) or tilt (a, b) to the component as which it counts in "
        "maps and in the verification; those of the moving axis, or of the axis that carries the "
        "spindle, where left out",
        examples=[{"x": "EXX", "z": "EZZ"}],
    )
    states_min: list[Number] | None = Field(
        None,
        min_length=1,
        max_length=100,
        description="Thermal states of which maps are made, after the first reading [min]; the "
        "first reading and the end of running where left out",
        examples=[[0, 60, 240]],
    )

    def displacements_um(self) -> dict[str, list[float]]:
        """Give each sensor's readings; InvalidContent where one of them lacks some."""
        by_sensor: dict[str, list[float]] = {}
        for sensor in SENSORS:
            values = [getattr(reading, f"{sensor}_um") for reading in self.readings]
            lacking = [i for i, value in enumerate(values) if value is None]
            if lacking and len(lacking) < len(values):
                raise InvalidContent.of_field(
                    f"readings.{lacking[0]}.{sensor}_um",
                    f"expected {sensor}_um in µm of every reading or of none, got none here",
                )
            if not lacking:
                by_sensor[sensor] = values
        return by_sensor

    def positions_mm(self) -> list[float] | None:
        """Give where the moving axis stood; None where no reading says it."""
        places = [r.position_mm for r in self.readings]
        lacking = [i for i, place in enumerate(places) if place is None]
        if len(lacking) == len(places):
            return None
        if lacking:
            raise InvalidContent.of_field(
                f"readings.{lacking[0]}.position_mm",
                "expected position_mm of every reading or of none, got none here",
            )
        return [place for place in places if place is not None]

    def recorded(self) -> list[DriftReading]:
        """Give time, temperatures and state of each reading."""
        return [DriftReading(r.time, r.temperatures_c, r.state) for r in self.readings]

    def states_s(self) -> list[float] | None:
        """Give the thermal states' times, in seconds since 1970-01-01 UTC."""
        first_s = self.readings[0].time.timestamp()
        if self.states_min is None:
            return None
        return [first_s + minutes * SECONDS_PER_MIN for minutes in self.states_min]


class DriftStateAnswer(Schema):
    """One thermal state of the test: changes since its first reading, at their temperatures."""

    label: str | None = Field(description="The map's name", examples=["Warm-up, 60 min"])
    after_min: Digits = Field(description="Time after the first reading [min]")
    time: UtcTime = Field(description="When it was, UTC")
    temperatures_c: dict[str, Digits] = Field(
        description="The sensors at that time, interpolated between readings [°C]"
    )
    components: list[ComponentAnswer] = Field(
        description="Changes of the components since the first reading"
    )
    map_id: int | None = Field(description="The number of the map that was made of it")

    @classmethod
    def of(cls, state: KeptState) -> Self:
        """Show a state."""
        return cls(
            label=state.label,
            after_min=state.after_s / SECONDS_PER_MIN,
            time=state.time,
            temperatures_c=dict(state.temperatures_c),
            components=[ComponentAnswer.computed(table) for table in state.tables],
            map_id=state.map_id,
        )


class ThermalDriftAnswer(MeasurementAnswer):
    """The figures of ISO 230-3's tests in `figures`; `components` are those of the last state."""

    states: list[DriftStateAnswer] = Field(description="Thermal states, in order of time")
    verification: KeptVerification | None = Field(
        None, description="The stored verification, where one was asked for"
    )
