"""A machine as its thermal model sees it: axes, sensors, and what to do outside the maps."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated, Any, Final, TypeAlias

import numpy as np
from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    PlainSerializer,
    StringConstraints,
    TypeAdapter,
)

from app.answer import Answer
from app.arrays import BoolArray, FloatArray
from app.errors import InvalidContent, UnknownThing, list_names
from app.geometry.chain import Chain
from app.geometry.components import COMPONENTS
from app.stated import Millimetres, Name, Number, made
from app.units import KELVIN_AT_0_C, MM_PER_M

DEFAULT_STAND_INS = {"x-middle": "y-front"}
"""The chapter's machine: y-front reads the same as x-middle (8.2.9)."""

ROUNDING_C = 1e-9
"""Tolerance on a difference of temperatures that equals the resolution [°C]."""

ROUNDING_MM = 1e-3
"""Positions so far apart may be the same one [mm]: in inches with few digits."""

FAR_BEYOND = 100.0
"""So many times further than an axis goes, a position is one in another unit."""

ENOUGH_PLACES = 3
"""So many positions of an axis show how much of it was measured; fewer may be one place's."""

_SENSOR_NAME = re.compile(r"[^\W_][\w. -]{0,63}")
"""Letters of any alphabet: a column is a `Säule` where it stands."""


class OutOfRange(StrEnum):
    """What happens at a temperature outside the maps."""

    CLAMP = "clamp"
    EXTRAPOLATE = "extrapolate"
    REJECT = "reject"


class SameTemperature(StrEnum):
    """What happens to two maps at one temperature of an assigned sensor."""

    REFUSE = "refuse"
    MEAN = "mean"


@dataclass(frozen=True, slots=True)
class Travel(Answer, published_as="TravelSchema", stated=True):
    """The travel of an axis."""

    min_mm: Annotated[Millimetres, Field(examples=[0])]
    """Lower end of the travel [mm]"""
    max_mm: Annotated[Millimetres, Field(examples=[500])]
    """Upper end of the travel [mm]"""

    def holds(self, *positions_mm: float) -> bool:
        """Say whether positions are on the axis, but for the rounding with which they are written.

        >>> Travel(0.0, 600.0).holds(0.0, 23.62205 * 25.4), Travel(0.0, 600.0).holds(600.1)
        (True, False)
        """
        return not self.beyond(np.array(positions_mm)).any()

    def beyond(self, positions_mm: FloatArray) -> BoolArray:
        """Say of each position whether it is off the axis, by more than the rounding."""
        least_mm, most_mm = self.min_mm - ROUNDING_MM, self.max_mm + ROUNDING_MM
        return (positions_mm < least_mm) | (positions_mm > most_mm)

    def unit_meant(self, positions_mm: Collection[float]) -> str | None:
        """Say in which unit positions of this axis must have been meant; None: in mm.

        Positions that are all within a thousandth of the axis were in m, one that lies a hundred
        times beyond its end was in µm.

        >>> Travel(0.0, 500.0).unit_meant([0.0, 0.25, 0.5])
        'm'
        >>> Travel(0.0, 500.0).unit_meant([0.0, 250e3, 500e3])
        'µm'
        """
        end, farthest = (max(map(abs, p)) for p in ((self.min_mm, self.max_mm), positions_mm))
        if farthest >= FAR_BEYOND * end:
            return "µm"
        is_tiny = len(set(positions_mm)) >= ENOUGH_PLACES and farthest * MM_PER_M <= end
        return "m" if is_tiny else None


_A_YEAR_S = 366 * 86_400


@dataclass(frozen=True, slots=True)
class Sensor(Answer, published_as="SensorSchema", stated=True):
    """A temperature sensor and what is physically believable of it."""

    name: Annotated[str, Field(examples=["x-middle"])]
    """Name of the sensor"""
    stand_in: Annotated[str | None, Field(examples=["y-front"])] = None
    """Sensor whose own temperatures serve when this one fails; x-middle has y-front where nothing
    is stated"""
    min_c: Annotated[Number, Field(ge=-273.15)] = -50.0
    """Lowest believable temperature [°C]"""
    max_c: Annotated[Number, Field(le=10_000)] = 150.0
    """Highest believable temperature [°C]"""
    max_age_s: Annotated[Number, Field(gt=0, le=_A_YEAR_S)] = 600.0
    """Age above which a value is stale; longest gap bridged in time [s]"""
    resolution_c: Annotated[Number, Field(gt=0, le=1000)] = 0.1
    """Temperatures closer than this are the same; ten times this is a movement that sensors must
    show [°C]"""
    stuck_after_s: Annotated[Number, Field(gt=0, le=86400)] | None = 3600.0
    """Without any change for this long after its neighbours moved clearly, it is stuck [s]; null
    for a sensor that may stand still"""
    max_rate_c_per_min: Annotated[Number, Field(gt=0, le=1e6)] = 5.0
    """A change faster than this is no temperature [°C/min]"""

    def accepts(self, temperature_c: float) -> bool:
        """Whether a temperature [°C] lies in the sensor's range."""
        return self.min_c <= temperature_c <= self.max_c

    def resolves(self, difference_c: float) -> bool:
        """Whether two temperatures this far apart [°C] are different ones to the sensor.

        >>> Sensor("x-middle").resolves(20.4 - 20.3), Sensor("x-middle").resolves(0.05)
        (True, False)
        """
        return difference_c > 0.0 and difference_c >= self.resolution_c - ROUNDING_C

    def looks_like_kelvin(self, value: float) -> bool:
        """Whether a value is outside the range in °C and inside it in K.

        Such a value is a mistaken unit, where any other is a broken sensor.
        """
        return not self.accepts(value) and self.accepts(value - KELVIN_AT_0_C)

    def expectation(self, value: float) -> str:
        """Say what was expected of a temperature that is out of range, and what came."""
        meant = (
            f", which would be {value - KELVIN_AT_0_C:.2f} °C if it was meant in kelvin, and "
            f"{value / 10.0:.2f} °C in tenths of a degree"
            if self.looks_like_kelvin(value)
            else ""
        )
        return (
            f"expected a temperature of {self.name} from {self.min_c:g} to {self.max_c:g} °C, "
            f"got {value:g}{meant}"
        )


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
    Field(examples=["mcfv5050"]),
]

Margin = Annotated[Number, Field(ge=0, le=1000)]
"""How far extrapolation may go [°C]."""

ErrorRatio = Annotated[Number, Field(ge=1, le=1000)]
"""How many times as uncertain as its maps an extrapolated value may be."""


def sensors_by_name(sensors: list[Sensor]) -> dict[str, Sensor]:
    """Index sensors by name; two of one name are refused with InvalidContent."""
    twice = [name for name, n in Counter(s.name for s in sensors).items() if n > 1]
    if twice:
        raise InvalidContent.of_field(
            "sensors", f"expected each name once, got {list_names(twice)} more than once"
        )
    return {sensor.name: sensor for sensor in sensors}


def _with_usual_stand_ins(sensors: Any) -> Any:
    """State the stand-in of a sensor that usually has one, where nothing is stated of it."""
    stated = [s for s in sensors if isinstance(s, dict)] if isinstance(sensors, list) else []
    names = [name for sensor in stated if isinstance(name := sensor.get("name"), str)]
    usual = {
        name: stand_in
        for name, stand_in in DEFAULT_STAND_INS.items()
        if {name, stand_in} <= {*names}
    }
    return (
        [
            {"stand_in": usual[sensor["name"]], **sensor}
            if isinstance(sensor, dict) and str(sensor.get("name")) in usual
            else sensor
            for sensor in sensors
        ]
        if usual
        else sensors
    )


def _lower_case(axes: dict[str, Travel]) -> dict[str, Travel]:
    return {axis.lower(): travel for axis, travel in axes.items()}


StatedSensors = Annotated[list[Sensor], BeforeValidator(_with_usual_stand_ins)]

if TYPE_CHECKING:
    Configuration: TypeAlias = Chain
    SensorsByName: TypeAlias = Mapping[str, Sensor]
else:
    Configuration = Annotated[
        str, made(Chain.parse, "configuration"), PlainSerializer(lambda chain: chain.text, str)
    ]
    SensorsByName = Annotated[
        StatedSensors,
        made(sensors_by_name, "sensors"),
        PlainSerializer(lambda sensors: list(sensors.values()), list[Sensor]),
    ]
    """Stated and answered as a list."""

EXAMPLE = {
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


@dataclass(frozen=True, slots=True)
class Machine(Answer, published_as="MachineSettings", stated=True, example=EXAMPLE):
    """A machine's description as a user states it."""

    id: MachineId
    """Short name used in URLs"""
    name: Annotated[Name, Field(examples=["MCFV5050LN"])]
    """Name for people"""
    chain: Annotated[Configuration, Field(alias="configuration", examples=["XYFZ"])]
    """Kinematic chain: axes before F move the workpiece, those after it the tool"""
    axes: Annotated[
        Mapping[str, Travel],
        AfterValidator(_lower_case),
        Field(examples=[{"x": {"min_mm": 0, "max_mm": 500}}]),
    ] = field(default_factory=dict)
    """Travel of each axis [mm]"""
    sensors: Annotated[SensorsByName, Field(max_length=1000)] = field(default_factory=dict)
    """The machine's temperature sensors"""
    out_of_range: OutOfRange = OutOfRange.CLAMP
    """What happens at temperatures outside the maps"""
    extrapolation_margin_c: Margin = 5.0
    """How far `extrapolate` may go beyond the maps [°C]"""
    extrapolation_error_ratio: ErrorRatio = 3.0
    """How many times as large as at the edge of the maps the standard error of an extrapolated
    value may be; further out the value there is held"""
    same_temperature: SameTemperature = SameTemperature.REFUSE
    """What happens to maps closer in temperature than a sensor resolves"""
    serial_number: Annotated[Name | None, Field(examples=["5050-1274"])] = None
    """The manufacturer's, as on the type plate"""

    def __post_init__(self) -> None:
        """Refuse, with InvalidContent, what contradicts itself, such as a range that is empty."""
        for axis, travel in self.axes.items():
            if axis not in self.chain.axes:
                raise InvalidContent.of_field(
                    "axes",
                    f"expected the axes of {self.chain.text} "
                    f"({list_names(sorted(self.chain.axes))}), got {axis!r}",
                )
            if not travel.min_mm < travel.max_mm:
                raise InvalidContent.of_field(
                    f"axes.{axis}",
                    f"expected min_mm below max_mm, got {travel.min_mm:g} and {travel.max_mm:g} mm",
                )
        wrong = [name for name in self.sensors if not _SENSOR_NAME.fullmatch(name)]
        if wrong:
            raise InvalidContent.of_field(
                "sensors",
                "expected names of 1 to 64 letters, digits, spaces, dots, hyphens or "
                "underscores, beginning with a letter or digit, got "
                f"{list_names([repr(name) for name in wrong])}",
            )
        for sensor in self.sensors.values():
            self._check_sensor(sensor)

    def _check_sensor(self, sensor: Sensor) -> None:
        where = f"sensors.{sensor.name}"
        if not sensor.min_c < sensor.max_c:
            raise InvalidContent.of_field(
                where,
                f"expected min_c below max_c, got {sensor.min_c:g} and {sensor.max_c:g} °C",
            )
        if sensor.stand_in is not None and (
            sensor.stand_in not in self.sensors or sensor.stand_in == sensor.name
        ):
            others = [name for name in self.sensors if name != sensor.name]
            raise InvalidContent.of_field(
                f"{where}.stand_in",
                f"expected another sensor of this machine ({list_names(others)}), "
                f"got {sensor.stand_in!r}",
            )

    def sensor(self, name: str) -> Sensor:
        """Return a sensor by name, or raise UnknownThing that lists what exists."""
        try:
            return self.sensors[name]
        except KeyError:
            raise UnknownThing(
                f"machine {self.id!r} has no sensor {name!r}; it has {list_names(self.sensors)}"
            ) from None

    def with_stand_ins(self, name: str) -> list[Sensor]:
        """List a sensor and then its stand-ins, nearest first."""
        stand_ins: list[Sensor] = []
        following: str | None = name
        while following is not None and all(following != s.name for s in stand_ins):
            stand_ins.append(self.sensor(following))
            following = stand_ins[-1].stand_in
        return stand_ins

    def default_sensor(self, code: str) -> str | None:
        """Name the sensor that a component follows when nobody has said otherwise.

        The chapter's default (8.2.9) where the machine has that sensor, the only
        sensor where there is one, else None.
        """
        chapter = COMPONENTS[code].default_sensor
        if chapter in self.sensors:
            return chapter
        return next(iter(self.sensors)) if len(self.sensors) == 1 else None


MACHINE: Final = TypeAdapter(Machine)
"""Reads a machine as it is stated, and writes it so."""
