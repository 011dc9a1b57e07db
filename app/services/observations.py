"""Observations as they are stated: asked of a model, planned, or measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from typing import TYPE_CHECKING, Annotated, Any, Final, TypeAlias

from pydantic import Discriminator, Field, Tag

from app.effects.observations import MOST_OBSERVATIONS, Observation, Verification
from app.errors import InvalidContent, UnknownComponent, list_names
from app.field_errors import way_of
from app.geometry.components import COMPONENTS, LINEAR_LETTERS, Component, parse_component
from app.in_pieces import InPieces
from app.search.rows import Datum
from app.stated import (
    Direction,
    Integer,
    MachineState,
    Millimetres,
    MissingComponents,
    Name,
    Number,
    Point,
    Schema,
    UtcTime,
    also,
    made,
    signs_of,
)
from app.thermal.error_map import impossible_error, positions_for_errors
from app.units import Unit


@dataclass(frozen=True, slots=True)
class ErrorQuestion:
    """Where and when an error is asked for: one component, or a point of the work volume.

    `directions` are +1 or −1 for each axis' direction of approach, 0 where it is not stated;
    `sign` is −1 where the error is asked for under ISO's name and sign (C0Y = −SXY); `state`
    takes precedence over what the readings say of the machine's state.
    """

    time: datetime
    component: str | None = None
    position_mm: float | None = None
    point_mm: tuple[float, float, float] | None = None
    tool_offset_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    directions: tuple[int, int, int] = (0, 0, 0)
    sign: int = 1
    state: Mapping[str, float] = field(default_factory=dict)


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


_VALUES: Final = ("measured_um", "measured_urad", "measured_um_per_m", "measured_urad_per_m")


def _one_or_three(value: Any) -> str:
    return way_of("point") if isinstance(value, list) else way_of("one")


Triple = Annotated[list[Number], Field(min_length=3, max_length=3)]

OneOrThree = Annotated[
    Annotated[Number, Tag(way_of("one"))] | Annotated[Triple, Tag(way_of("point"))],
    Discriminator(_one_or_three),
]
"""The error of a component, or x, y and z of the error at a point."""


class WithSetup(ObservationSchema):
    """An observation that may state its set-up."""

    setup: Name | None = Field(
        None,
        description="Set-up within the verification, any text: observations with one share its "
        "zero and its tilt; without any the verification is one set-up",
        examples=["Tuesday, second clamping"],
    )


def _observed(
    question: ErrorQuestion, values: Sequence[float], circumstances: WithSetup
) -> Observation:
    """Set a measured value, in the sign in which it was stated, beside where and when."""
    has_place = question.component is not None and COMPONENTS[question.component].is_table
    return Observation(
        time_s=question.time.timestamp(),
        measured=tuple(question.sign * value for value in values),
        component=question.component,
        position_mm=question.position_mm if has_place else None,
        point_mm=question.point_mm,
        tool_offset_mm=question.tool_offset_mm,
        directions=question.directions,
        state=circumstances.state,
        setup=circumstances.setup,
    )


class MeasuredObservation(WithSetup):
    """What an instrument read once: of one component, or at a point of the work volume.

    `measured_um`, which may also be called `measured` as residuals have it, takes the value in
    the component's own unit, as predictions give it; the fields that name another unit say the
    same more exactly.
    """

    measured_um: OneOrThree | None = Field(
        None,
        validation_alias=also("measured_um", "measured"),
        description="Measured error, actual minus nominal [µm; angular errors µrad, squareness "
        "µm/m]; three numbers x, y, z at a point",
        examples=[4.31, [1.2, -0.4, 3.3]],
    )
    measured_urad: Number | None = Field(None, description="Measured angular error [µrad]")
    measured_um_per_m: Number | None = Field(
        None, description="Measured squareness or slope [µm/m]", examples=[-8.2]
    )
    measured_urad_per_m: Number | None = Field(
        None, description="Measured slope of an angular error [µrad/m]"
    )

    def to_measured(self) -> Observation:
        """Make the observation, in our components and signs; InvalidContent if it cannot be."""
        question = self.to_observation()
        component = None if question.component is None else COMPONENTS[question.component]
        return _observed(question, self._values(component), self)

    def _values(self, component: Component | None) -> Sequence[float]:
        present = [name for name in _VALUES if getattr(self, name) is not None]
        unit = "um" if component is None else component.unit.value
        fitting = {"measured_um", f"measured_{unit}"}
        if len(present) != 1 or present[0] not in fitting:
            what = "a point" if component is None else component.code
            got = " and ".join(present) or "none"
            raise InvalidContent.of_field(
                "measured_um" if not present else present[-1],
                f"expected one measured value of {what}, as {' or '.join(sorted(fitting))}, "
                f"got {got}",
            )
        value = getattr(self, present[0])
        values = value if isinstance(value, list) else [value]
        if len(values) != (3 if component is None else 1):
            expected = "x, y and z" if component is None else "one number"
            raise InvalidContent.of_field(
                present[0],
                f"expected {expected}, got {'a list' if isinstance(value, list) else 'one'}",
            )
        impossible = impossible_error(component, values)
        if impossible:
            raise InvalidContent.of_field(present[0], impossible)
        return values

    @classmethod
    def of(cls, observation: Observation, time: Any) -> dict[str, Any]:
        """Show an observation as it may be posted again, without what it does not state."""
        o = observation
        fields: dict[str, Any] = {"time": time}
        fields |= {} if o.setup is None else {"setup": o.setup}
        signs = {a: "+" if d > 0 else "-" for a, d in zip("xyz", o.directions, strict=True) if d}
        if o.point_mm is not None:
            fields |= {"point_mm": o.point_mm, "tool_offset_mm": o.tool_offset_mm}
            fields |= {"direction": signs} if signs else {}
            return fields | {"measured_um": o.measured, "state": o.state}
        component = COMPONENTS[str(o.component)]
        fields["component"] = component.code
        if o.position_mm is not None:
            fields["position_mm"] = o.position_mm
        if component.axis in signs:
            fields["direction"] = signs[str(component.axis)]
        return fields | {f"measured_{component.unit}": o.measured[0], "state": o.state}


class PlannedObservation(WithSetup):
    """What is to be measured: of one component, or at a point of the work volume."""

    def to_planned(self) -> Observation:
        """Make an observation whose measured value nobody looks at."""
        question = self.to_observation()
        return _observed(question, [0.0] if question.point_mm is None else [0.0] * 3, self)


def _deviations(observations: Sequence[Observation]) -> Sequence[Observation]:
    """Refuse measured positions: they follow the nominal ones with a slope of 1."""
    lines: dict[str, list[tuple[int, float, float]]] = {}
    for i, observation in enumerate(observations):
        if observation.point_mm is not None:
            for axis, at, value in zip(
                LINEAR_LETTERS, observation.point_mm, observation.measured, strict=True
            ):
                lines.setdefault(f"points {axis}", []).append((i, at, value))
        elif (
            observation.position_mm is not None
            and COMPONENTS[str(observation.component)].unit is Unit.UM
        ):
            lines.setdefault(str(observation.component), []).append(
                (i, observation.position_mm, observation.measured[0])
            )
    for line in lines.values():
        if refusal := positions_for_errors([at for _, at, _ in line], [v for *_, v in line]):
            raise InvalidContent.of_field(f"{line[0][0]}.measured_um", refusal)
    return observations


if TYPE_CHECKING:
    Questions: TypeAlias = list[ErrorQuestion]
    Measured: TypeAlias = list[Observation]
else:
    Questions = Annotated[
        list[Annotated[ObservationSchema, made(ObservationSchema.to_observation)]],
        InPieces(100_000),
    ]
    Measured = Annotated[
        list[Annotated[MeasuredObservation, made(MeasuredObservation.to_measured)]],
        InPieces(MOST_OBSERVATIONS),
        made(_deviations),
    ]


class VerificationRequest(
    Schema,
    example={
        "label": "night shift",
        "datum": "absolute",
        "observations": [
            {
                "time": "2026-03-01T06:00:00Z",
                "component": "EXX",
                "position_mm": 250.0,
                "direction": "+",
                "measured_um": 4.31,
                "state": {"spindle_rpm": 0},
            },
            {"time": "2026-03-01T06:01:00Z", "component": "SXY", "measured_um": -8.2},
            {
                "time": "2026-03-01T06:02:00Z",
                "point_mm": [250, 100, 300],
                "tool_offset_mm": [0, 0, 160],
                "measured_um": [1.2, -0.4, 3.3],
            },
        ],
    },
):
    """Up to 100,000 observations of one machine, with one set-up or several."""

    label: Name = Field(
        description="The verification's name on its machine", examples=["night shift"]
    )
    datum: Datum = Field(
        Datum.ABSOLUTE,
        description="`absolute`; `first`: the instrument was zeroed at the first observation of "
        "each component; `free`: an unknown constant per component",
    )
    repeatability_um: Annotated[Number, Field(gt=0)] | None = Field(
        None,
        description="Standard deviation of one length [µm], where it is known; of angles and "
        "squareness it says nothing",
        examples=[0.5],
    )
    instrument: Name | None = Field(
        None, description="What measured, for the certificate", examples=["XL-80, no. 4711"]
    )
    operator: Name | None = Field(
        None, description="Who measured, for the certificate", examples=["M. Weber"]
    )
    observations: Measured = Field(description="What was measured")

    def to_verification(self) -> Verification:
        """Make the verification."""
        return Verification(
            self.label,
            tuple(self.observations),
            self.datum,
            self.repeatability_um,
            instrument=self.instrument,
            operator=self.operator,
        )


class PlannedVerification(Schema):
    """Observations that are to be taken with one set-up."""

    label: Name = Field("planned", description="Its name in the answer", examples=["Monday"])
    datum: Datum = Field(Datum.ABSOLUTE, description="`absolute`, `first` or `free`")
    repeatability_um: Annotated[Number, Field(gt=0)] | None = Field(
        None,
        description="Standard deviation of one length [µm], where it is known; it does not "
        "apply to angles and squareness",
    )
    observations: Annotated[list[PlannedObservation], InPieces(20_000)] = Field(
        description="What is to be measured"
    )

    def to_verification(self) -> Verification:
        """Make the verification; InvalidContent names the observation that is wrong."""
        observations = []
        for i, observation in enumerate(self.observations):
            try:
                observations.append(observation.to_planned())
            except InvalidContent as error:
                raise error.inside(f"observations.{i}") from None
        return Verification(
            self.label, observations, self.datum, self.repeatability_um, is_planned=True
        )


class VisitPreview(Schema):
    """A visit that is yet to be made, read from a file."""

    planned: PlannedVerification = Field(description="As it may be planned with")
    warnings: list[str] = Field(description="What of the file was not read, or may be a mistake")


if TYPE_CHECKING:
    Planned: TypeAlias = list[Verification]
else:
    Planned = list[Annotated[PlannedVerification, made(PlannedVerification.to_verification)]]


class PredictionRequest(
    Schema,
    example={
        "observations": [{"time": "2026-03-01T06:00:00Z", "component": "EXX", "position_mm": 250}]
    },
):
    """What is to be predicted, and with which version."""

    observations: Questions = Field(description="Where and when")
    model_version: Integer | None = Field(None, description="Version; the active one if not stated")
    missing_components: MissingComponents
