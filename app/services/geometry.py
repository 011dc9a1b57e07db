"""The volumetric error: what it consists of, at points, over the work volume, and pictured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Final, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    BeforeValidator,
    Discriminator,
    Field,
    Tag,
    TypeAdapter,
    WithJsonSchema,
)

from app.answer import Answer
from app.arrays import FloatArray, IntArray, largest_length, rms_length
from app.errors import InvalidContent, counted, list_names
from app.field_errors import way_of
from app.geometry.compensation_levels import CompensationLevel, compensation_levels
from app.geometry.components import COMPONENTS, LINEAR_LETTERS, ORDER
from app.geometry.needed_components import needed_components
from app.geometry.nonrigid_presets import NonrigidPreset, find_preset
from app.geometry.rotary_axes import location_codes, rotary_location_error
from app.geometry.volumetric_accuracy import AngularSpread, Spread, volumetric_accuracy
from app.in_pieces import InPieces
from app.pictures.layout import Remarks
from app.pictures.work_volume_picture import work_volume_picture
from app.rounding import Digits, Micro, listed, rounded, to_tenth_nm
from app.services.ask_field import (
    AnswerHead,
    FieldAnswer,
    FieldQuestion,
    Triple,
    VolumeQuestion,
    ask_field,
    volume_of,
    work_volume,
)
from app.services.context import Context
from app.services.load_machine import load_machine
from app.stated import Coordinates, Integer, Number, Point, Temperatures
from app.thermal.machine import Machine, Travel

MOST_POINTS: Final = 1_000_000
MOST_NUMBERS = 1_000_000
"""Points times thermal states in one call."""


@dataclass(frozen=True, slots=True)
class NeededComponent(Answer):
    """One error that the volumetric error of the machine consists of."""

    component: Annotated[str, Field(examples=["EXY^x"])]
    """ISO 230-1 code"""
    chapter: Annotated[str, Field(examples=["D_x^x(y)"])]
    """The chapter's notation"""
    kind: Annotated[str, Field(examples=["nonrigid slope"])]
    """Its group"""
    unit: Annotated[str, Field(examples=["µm/m"])]
    """Unit of its values"""
    in_model: bool
    """Whether the active model's maps have it"""


@dataclass(frozen=True, slots=True)
class NeededComponents(Answer, published_as="NeededAnswer"):
    """Which errors have to be measured, and which of them the active model lacks."""

    machine: Annotated[str, Field(examples=["mcfv5050"])]
    """Machine"""
    configuration: Annotated[str, Field(examples=["XYFZ"])]
    """Its kinematic chain"""
    preset: NonrigidPreset | None
    """The kind of machine that was asked for; null for a rigid one"""
    components: Sequence[NeededComponent]
    """What has to be measured, in order"""
    missing: Annotated[Sequence[str], Field(examples=[["EXY^x"]])]
    """Of these, what no map of the active model has"""
    warnings: Sequence[str]
    """What to know beside it"""


def check_components(
    context: Context, machine_id: str, tool_offset_mm: Triple, preset: str | None = None
) -> NeededComponents:
    """List what has to be measured of a machine, rigid or of one of the chapter's presets.

    Parameters
    ----------
    tool_offset_mm
        Tool offset T [mm]: a lever arm of every rotation.
    preset
        Name of a kind of machine that is not rigid; None for a rigid one.
    """
    kind = find_preset(preset) if preset is not None else None
    live = context.live.get(machine_id) or load_machine(context, machine_id)
    model = live.current.model
    chain = model.machine.chain
    codes = set(needed_components(chain, tool_offset_mm, model.measuring_lines))
    warnings = []
    if kind is not None:
        codes |= {code for code in kind.slopes if COMPONENTS[code].axis in chain.axes}
        if kind.configuration != chain.text:
            warnings.append(
                f"the preset {kind.name} is given for {kind.configuration} ({kind.equations}); "
                f"this machine is {chain.text}: judge whether its axes bend in the same way"
            )
    have = {code for group in model.groups for code in group.codes}
    needed = [COMPONENTS[code] for code in sorted(codes, key=ORDER.__getitem__)]
    return NeededComponents(
        machine=model.machine.id,
        configuration=chain.text,
        preset=kind,
        components=[
            NeededComponent(c.code, c.chapter, c.kind.value, c.unit.symbol, c.code in have)
            for c in needed
        ],
        missing=[c.code for c in needed if c.code not in have],
        warnings=warnings,
    )


Points = Annotated[list[Coordinates], InPieces(MOST_POINTS, at_once=5000, as_array=True)]
"""Up to a million points x, y, z [mm], as an array of shape (n, 3)."""


def _one_or_more(value: object) -> str:
    return way_of("more") if isinstance(value, list) else way_of("one")


OneOrMoreStates = Annotated[
    Annotated[Temperatures, Tag(way_of("one"))]
    | Annotated[
        Annotated[list[Temperatures], Field(min_length=1, max_length=10_000)],
        Tag(way_of("more")),
    ],
    Discriminator(_one_or_more),
]
"""The temperatures of one thermal state, or of several."""


class VolumetricErrorRequest(
    FieldQuestion,
    example={
        "temperatures_c": {"x-middle": 24.1, "z-column": 27.3},
        "points_mm": [[0, 0, 0], [250, 100, 300]],
        "tool_offset_mm": [0, 0, 160],
        "missing_components": "zero",
    },
):
    """Points at which the volumetric error is asked."""

    temperatures_c: OneOrMoreStates | None = Field(  # type: ignore[assignment]
        None,
        description="Temperatures by sensor [°C], or a list of them for several thermal states; "
        "those of the latest reading if left out",
    )
    points_mm: Points = Field(
        description="Nominal points x, y, z [mm]", examples=[[[0, 0, 0], [250, 100, 300]]]
    )
    outside_travel: Literal["refuse", "allow"] = Field(
        "refuse",
        description="What happens to points outside the axes' travel: `refuse` names the first, "
        "`allow` answers and flags them",
    )

    @property
    def thermal_states(self) -> Sequence[Mapping[str, float]] | None:
        """The temperatures of each thermal state; None for the latest reading."""
        stated: Any = self.temperatures_c
        return [stated] if isinstance(stated, dict) else stated


_Vectors = list[list[float]] | list[list[list[float]]]


@dataclass(frozen=True, eq=False, kw_only=True)
class VolumetricError(AnswerHead, published_as="VolumetricErrorAnswer"):
    """The errors at the points, in their order."""

    errors_um: Annotated[FloatArray, listed(0, _Vectors), Field(examples=[[[1.2, -0.4, 3.3]]])]
    """Actual minus nominal position x, y, z of the tool at each point [µm]; one such list for each
    thermal state where a list of temperatures was sent"""
    orientation_urad: Annotated[
        FloatArray, listed(0, _Vectors), Field(examples=[[[20.1, -3.0, 0.0]]])
    ]
    """Error of the tool's direction, (ΣEB, −ΣEA, 0), at each point [µrad]"""
    outside_travel: Annotated[IntArray, listed(1, int)]
    """Indices of the points outside the axes' travel, from 0"""


def compute_volumetric_error(
    context: Context, machine_id: str, request: VolumetricErrorRequest
) -> VolumetricError:
    """Sum all components at points.

    Raises
    ------
    UnknownThing, NoReading, InvalidContent
        As `ask_field`; InvalidContent also for points outside the travel, or too many.
    """
    points_mm = np.asarray(request.points_mm)
    states = len(request.thermal_states or [0])
    if states * len(points_mm) > MOST_NUMBERS:
        raise InvalidContent.of_field(
            "points_mm",
            f"expected at most {MOST_NUMBERS} points times thermal states in one call, got "
            f"{len(points_mm)} times {states}",
        )
    answer = ask_field(context, machine_id, request)
    outside = _outside_travel(answer.machine, points_mm)
    if outside.size and request.outside_travel == "refuse":
        raise _refused(answer.machine, points_mm, outside)
    errors_um, orientation_urad = answer.field.at(points_mm, request.tool_offset_mm)
    if isinstance(request.temperatures_c, list) and errors_um.ndim == 2:
        errors_um, orientation_urad = errors_um[None], orientation_urad[None]
    remarks = _beyond_tables(answer, points_mm)
    if outside.size:
        remarks.append(f"{counted(outside.size, 'point')} outside the axes' travel")
    return VolumetricError(
        **answer.head(remarks),
        errors_um=errors_um,
        orientation_urad=orientation_urad,
        outside_travel=outside,
    )


def _outside_travel(machine: Machine, points_mm: FloatArray) -> NDArray[np.intp]:
    """Find points that the axes cannot reach; an axis that is not there stands at 0."""
    outside = np.zeros(len(points_mm), dtype=bool)
    for i, axis in enumerate(LINEAR_LETTERS):
        travel = machine.axes.get(axis)
        if travel is not None:
            outside |= travel.beyond(points_mm[:, i])
        elif axis not in machine.chain.axes:
            outside |= points_mm[:, i] != 0.0
    return np.flatnonzero(outside)


def _refused(machine: Machine, points_mm: FloatArray, outside: NDArray[np.intp]) -> InvalidContent:
    first = int(outside[0])
    reach = [f"{axis} {t.min_mm:g} to {t.max_mm:g} mm" for axis, t in sorted(machine.axes.items())]
    reach += [f"no {axis}" for axis in LINEAR_LETTERS if axis not in machine.chain.axes]
    others = f" and {outside.size - 1} more" if outside.size > 1 else ""
    return InvalidContent.of_field(
        f"points_mm.{first}",
        f"expected points within the axes' travel ({', '.join(reach)}), got "
        f'{points_mm[first].tolist()} mm{others}; state "outside_travel": "allow" to have them '
        "answered",
    )


def _beyond_tables(answer: FieldAnswer, points_mm: FloatArray) -> list[str]:
    """Say of each axis how many points lie beyond its tables, where their end values hold."""
    sentences = []
    for i, axis in enumerate(LINEAR_LETTERS):
        nodes = answer.field.nodes_mm(axis)
        if nodes.size:
            along = points_mm[:, i]
            beyond = int(np.count_nonzero((along < nodes[0]) | (along > nodes[-1])))
            if beyond:
                sentences.append(
                    f"{counted(beyond, 'point')} beyond the tables of {axis}, {nodes[0]:g} to "
                    f"{nodes[-1]:g} mm: their end values hold there"
                )
    return sentences


def _as_list(value: object) -> object:
    return value if isinstance(value, list) else [value]


RotaryLetter = Literal["A", "B", "C"]
_Angle = Annotated[Number, Field(ge=-36_000, le=36_000)]
_SeveralAngles = Annotated[list[_Angle], Field(min_length=1, max_length=1_000_000)]
Angles = Annotated[
    _SeveralAngles,
    BeforeValidator(_as_list),
    WithJsonSchema(TypeAdapter(_Angle | _SeveralAngles).json_schema()),
]
"""One angle, or one for each point [°]."""


class RotaryErrorRequest(
    FieldQuestion,
    example={
        "temperatures_c": {"x-middle": 24.1, "z-column": 27.3},
        "order": "C",
        "angles_deg": {"C": [0, 90, 180]},
        "points_mm": [[100, 0, 50], [100, 0, 50], [100, 0, 50]],
        "missing_components": "zero",
    },
):
    """Points that rotary axes carry, and the axes' angles."""

    order: str = Field(
        "AC",
        description="Rotary axes from the base outward: in AC the A axis carries the C axis",
        examples=["AC", "BC", "C"],
    )
    angles_deg: dict[RotaryLetter, Angles] = Field(
        description="Rotary axis to its angle, or to a list of one for each point [°]; axes left "
        "out stand at 0",
        examples=[{"A": -30, "C": [0, 90, 180]}],
    )
    points_mm: Points = Field(
        description="The carried points with all rotary axes at 0, in the machine's directions "
        "where the rotary axes' base stands still [mm]; one point serves for many angles"
    )
    pivots_mm: dict[RotaryLetter, Point] = Field(
        default_factory=dict,
        description="Rotary axis to a point of its nominal line [mm]; the origin if left out",
        examples=[{"C": [250, 250, 0]}],
    )
    compensated: dict[str, Number] = Field(
        default_factory=dict,
        description="Location errors that the control already knows and follows [µm; µrad]: the "
        "answer says what is left of the path errors",
        examples=[{"XOC": -0.5, "YOC": 21.5}],
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class RotaryError(AnswerHead, published_as="RotaryErrorAnswer"):
    """The errors of the carried points, in their order."""

    errors_um: Annotated[FloatArray, listed(2)]
    """Actual minus nominal position x, y, z of each carried point [µm]; where the axes carry the
    workpiece, the tool's error relative to it is minus this"""
    rms_um: float
    """Root mean square of their lengths [µm]"""
    max_um: float
    """The largest of their lengths [µm]"""
    left_um: Annotated[FloatArray, listed(2)]
    """What `compensated` leaves of each, x, y, z [µm]: the errors themselves where nothing is
    compensated"""
    left_rms_um: float
    """Root mean square of the lengths that are left [µm]"""
    left_max_um: float
    """The largest of the lengths that are left [µm]"""
    locations: Annotated[
        Mapping[str, float], Field(examples=[{"XOC": -0.5, "YOC": 21.5, "AOC": 3.0, "BOC": -7.0}])
    ]
    """The location errors at these temperatures: positions (XOC, YOC, YOA, ZOA, XOB, ZOB) in µm,
    directions (AOC, BOC, BOA, COA, AOB, COB) in µrad [µm]"""


def compute_rotary_error(
    context: Context, machine_id: str, request: RotaryErrorRequest
) -> RotaryError:
    """Say how far carried points are from where they should be at given angles.

    Raises
    ------
    UnknownThing, NoReading, InvalidContent
        As `ask_field` and `rotary_location_error`.
    """
    order, points_mm = request.order, np.asarray(request.points_mm, dtype=np.float64)
    codes = location_codes(order)
    others = [code for code in request.compensated if code not in codes]
    if others:
        raise InvalidContent.of_field(
            "compensated",
            f"expected location errors of {order} ({list_names(codes)}), got {list_names(others)}",
        )
    pivots_mm = {str(letter): point for letter, point in request.pivots_mm.items()}
    angles_deg: dict[str, FloatArray] = {
        letter: np.array(angles[0] if len(angles) == 1 else angles)
        for letter, angles in request.angles_deg.items()
    }
    answer = ask_field(context, machine_id, request, needed=codes)
    locations = {
        code: float(values[0, 0])
        for code, (_, values) in answer.field.tables.items()
        if code in codes
    }

    def errors_of(known: Mapping[str, float]) -> FloatArray:
        return rotary_location_error(known, points_mm, angles_deg, order, pivots_mm)

    errors_um = errors_of(locations)
    left_um = errors_um - errors_of(request.compensated)
    return RotaryError(
        **answer.head(),
        errors_um=rounded(errors_um),
        rms_um=to_tenth_nm(rms_length(errors_um)),
        max_um=to_tenth_nm(largest_length(errors_um)),
        left_um=rounded(left_um),
        left_rms_um=to_tenth_nm(rms_length(left_um)),
        left_max_um=to_tenth_nm(largest_length(left_um)),
        locations={code: to_tenth_nm(value) for code, value in locations.items()},
    )


class AccuracyRequest(
    VolumeQuestion,
    example={
        "temperatures_c": {"x-middle": 24.1, "z-column": 27.3},
        "missing_components": "zero",
    },
):
    """At which temperatures, with which tool, in which volume."""


class LevelsRequest(AccuracyRequest):
    """The same, with the size of the lattice of points that is looked at."""

    points_per_axis: Annotated[Integer, Field(ge=2, le=60)] = Field(
        11, description="Number of points along each axis of an even lattice over the volume"
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class Accuracy(AnswerHead, published_as="AccuracyAnswer"):
    """Every definition of volumetric accuracy (C. Wang, 8.112–8.133, Table 8.2)."""

    volume: Mapping[str, Travel]
    """The work volume [mm]"""
    linear: Spread
    """Of the sums 8.112–8.114: translations with squareness, no lever arms [µm]"""
    angular: AngularSpread
    """Of the sums 8.115–8.117 [µrad]"""
    with_arms: Spread
    """Of the volumetric error at the tool, lever arms included [µm]"""
    diagonals_um: Annotated[
        Mapping[str, Micro], Field(examples=[{"ppp": 12.1, "npp": 9.8, "pnp": 11.0, "ppn": 8.7}])
    ]
    """True range of the displacement along each body diagonal [µm]"""
    ed_um: Annotated[Micro, Field(alias="Ed_um")]
    """ISO 230-6 Ed: largest of the diagonals' ranges [µm]"""
    esd_um: Annotated[Micro, Field(alias="ESd_um")]
    """ESd: range over all diagonals together [µm]"""
    elv_um: Annotated[Micro, Field(alias="ELv_um")]
    """ELv from the volume's edges (Table 8.2) [µm]"""
    elsv_um: Annotated[Micro, Field(alias="ELSv_um")]
    """ELSv, with straightness and squareness (Table 8.2) [µm]"""
    ratios: Annotated[
        Mapping[str, Digits | None], Field(examples=[{"M1": 1.68, "M2": 1.41, "M3": 1.12}])
    ]
    """Multiple factors M1 = ELSv/ELv, M2 = ELSv/Ed, M3 = ELSv/ESd; null where a measure is 0"""


@dataclass(frozen=True, eq=False, kw_only=True)
class Levels(AnswerHead, published_as="LevelsAnswer"):
    """What each kind of controller would leave over the volume."""

    volume: Mapping[str, Travel]
    """The work volume [mm]"""
    levels: Sequence[CompensationLevel]
    """From nothing to everything"""


def assess_accuracy(context: Context, machine_id: str, request: AccuracyRequest) -> Accuracy:
    """Measure a machine's volumetric accuracy by every definition of the chapter.

    Raises
    ------
    UnknownThing, NoReading, InvalidContent
        As `ask_field` and `work_volume`.
    """
    answer = ask_field(context, machine_id, request, orientation=True)
    box, remarks = work_volume(answer, request.volume)
    accuracy = volumetric_accuracy(answer.field, box, request.tool_offset_mm)
    return Accuracy(
        **answer.head(remarks),
        volume=volume_of(box),
        linear=accuracy.linear,
        angular=accuracy.angular,
        with_arms=accuracy.with_arms,
        diagonals_um=accuracy.diagonals.ranges_um,
        ed_um=accuracy.diagonals.ed_um,
        esd_um=accuracy.diagonals.esd_um,
        elv_um=accuracy.lines.elv_um,
        elsv_um=accuracy.lines.elsv_um,
        ratios=accuracy.ratios,
    )


def compare_levels(context: Context, machine_id: str, request: LevelsRequest) -> Levels:
    """Compare what controllers of different ability would leave of the volumetric error.

    Raises
    ------
    UnknownThing, NoReading, InvalidContent
        As `assess_accuracy`.
    """
    answer = ask_field(context, machine_id, request, orientation=False)
    box, remarks = work_volume(answer, request.volume)
    levels = compensation_levels(answer.field, box, request.tool_offset_mm, request.points_per_axis)
    return Levels(**answer.head(remarks), volume=volume_of(box), levels=levels)


class PictureRequest(
    VolumeQuestion,
    example={
        "temperatures_c": {"x-middle": 24.1, "z-column": 27.3},
        "tool_offset_mm": [0, 0, 160],
        "missing_components": "zero",
    },
):
    """At which temperatures the work volume is drawn, and how."""

    exaggeration: Annotated[Number, Field(gt=0, le=1e9)] | None = Field(
        None,
        description="How many times larger than they are errors are drawn; chosen if left out "
        "(without a unit)",
        examples=[2000],
    )
    arrows_per_axis: Annotated[Integer, Field(ge=2, le=12)] = Field(
        5, description="Number of error vectors along each axis"
    )


def picture_work_volume(context: Context, machine_id: str, request: PictureRequest) -> Any:
    """Draw the work volume with exaggerated errors, as a plotly figure.

    Raises
    ------
    UnknownThing, NoReading, InvalidContent
        As `ask_field` and `work_volume`.
    """
    answer = ask_field(context, machine_id, request, orientation=False)
    box, remarks = work_volume(answer, request.volume)
    return work_volume_picture(
        answer.field,
        box,
        request.tool_offset_mm,
        title=f"{answer.machine.name} · volumetric error",
        subtitle=_subtitle(answer, request),
        exaggeration=request.exaggeration,
        arrows_per_axis=request.arrows_per_axis,
        remarks=Remarks(answer.complete, [*answer.warnings, *remarks], answer.counted_as_zero),
    )


def _subtitle(answer: FieldAnswer, question: FieldQuestion) -> str:
    """Say of what the picture is one, and what counts as zero in it."""
    temperatures = ", ".join(f"{s} {t:.1f} °C" for s, t in answer.temperatures_c[0].items())
    x, y, z = question.tool_offset_mm
    sentences = [
        f"{answer.machine.chain.text}, tool offset ({x:g}, {y:g}, {z:g}) mm, {temperatures}",
        f"model version {answer.model_version}, {answer.computed_at:%Y-%m-%d %H:%M:%S} UTC",
    ]
    if answer.counted_as_zero:
        sentences.append(f"counted as zero: {list_names(answer.counted_as_zero)}")
    return "; ".join(sentences)
