"""What a file format is: how it is written and read, its sign, limits, and how surely."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Annotated, Any, ClassVar, Final, Literal, TypeVar

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from app.answer import Answer, UnitSymbol
from app.arrays import frozen
from app.controllers.curve import BACKWARD, FORWARD, Curve
from app.controllers.error_table import ErrorTable
from app.errors import InvalidContent, list_names
from app.geometry.components import COMPONENTS, LINEAR_LETTERS
from app.rounding import Micro
from app.units import Unit

Axis = Annotated[str, Field(pattern=r"^[xyz]$")]
Sign = Literal["error", "compensation"]
Length = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-1e6, le=1e6)]
Spacing = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0, le=1e6)]
Count = Annotated[int, Field(strict=True)]
Named = TypeVar("Named")
Label = Annotated[str, Field(pattern=r"^[A-Za-z0-9_]{1,32}$")]
AxisNames = Annotated[dict[Axis, Label], Field(description="The machine's name of each axis")]
EvenSpacing = Annotated[
    Spacing | None,
    Field(description="Distance of the points [mm]; the maps' own where not stated"),
]
Decimals = Annotated[Count, Field(ge=3, le=7, description="Decimals of the values [mm]")]


def _split(value: object) -> object:
    """Take a text such as `EXX, EYY`, which is how a list is written on a command line, apart."""
    return [part.strip() for part in value.split(",")] if isinstance(value, str) else value


Codes = Annotated[list[str], Field(max_length=100), BeforeValidator(_split)]

CHECK_FILE: Final = "thermap-check.txt"
"""File beside every export that says what has to move, and how far."""


class Status(StrEnum):
    """How surely a format is known."""

    CONTROLLER = "verified on the running controller"
    SOURCE = "source-verified"
    MANUAL = "manual-verified"
    SEED = "seed example"
    OURS = "ours"


class Options(BaseModel):
    """What every format can be told."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    numbering: ClassVar[str] = ""
    """The option that gives each axis the controller's number, by default that of three axes."""

    layout: ClassVar[frozenset[str]] = frozenset(("most_points", "spacing_mm"))
    """Options that only shape what is written: files are read without them."""

    components: Codes | None = Field(
        None, description="Codes of the components to write; every one that the format holds"
    )


class SignedOptions(Options):
    """Options of a format whose sign nobody has verified: it has to be said."""

    sign: Sign = Field(
        description="What the values are: `error` (actual minus nominal) or `compensation` (what "
        "is to be added to the command). No source says which: confirm it with the check table"
    )


class ReferenceOptions(Options):
    """Options of a format that is 0 at the axis' reference point."""

    reference_mm: dict[Axis, Length] = Field(
        default_factory=dict,
        description="Each axis' reference point [mm], where the format is 0; 0 where not stated",
    )


class HomeOptions(Options):
    """Options of a format whose tables may have a value where the axes are homed."""

    home_mm: dict[Axis, Length] = Field(
        default_factory=dict,
        description="Where each axis stands after homing [mm]; 0 where not stated. A compensation "
        "that is not 0 there is warned of: the motor steps",
    )


def steps_at_home(curves: Sequence[Curve], options: HomeOptions, when: str) -> list[str]:
    """Warn of each axis that does not stand still when its compensation begins to act."""
    warnings = []
    for axis in LINEAR_LETTERS:
        moving = [curve for curve in curves if curve.component.direction == axis]
        home = {a: options.home_mm.get(a, 0.0) for c in moving if (a := c.component.axis)}
        at_home = [
            sum(float(c.at(np.array([home[str(c.component.axis)]]), d)[0]) for c in moving)
            for d in (FORWARD, BACKWARD)
        ]
        largest = max(at_home, key=abs)
        if abs(largest) >= _SMALLEST_STEP_UM:
            place = ", ".join(f"{a.upper()} {at:g} mm" for a, at in home.items())
            warnings.append(
                f"the motor of {axis} steps by {-largest:.1f} µm {when}: the compensation at home "
                f"({place}) is not 0"
            )
    return warnings


_SMALLEST_STEP_UM: Final = 0.05


@dataclass(frozen=True, slots=True)
class ControllerFile(Answer, published_as="ExportedFileAnswer"):
    """One file of an export."""

    name: Annotated[str, Field(examples=["x.comp"])]
    """Name, with its band's folder"""
    content: str
    """Its text"""
    role: Literal["table", "settings", "check"] = "table"
    """`table`, `settings` that go into the controller's own, or `check`: what to look at after
    loading"""
    axis: str | None = None
    """Axis whose own file it is"""


@dataclass(frozen=True, slots=True)
class NotHeld(Answer, published_as="NotHeldAnswer"):
    """What the controller does not hold."""

    component: Annotated[str, Field(examples=["EYX"])]
    """ISO 230-1 code"""
    largest: Annotated[Micro, Field(examples=[9.1])]
    """Largest displacement that it makes in the work volume at these temperatures, in `unit`; of a
    tilt of a rotary axis the angle"""
    why: str
    """Why not"""
    unit: UnitSymbol = Unit.UM.symbol
    """Its unit"""


@dataclass(frozen=True, slots=True)
class Rendered:
    """Files, and the curves that a controller holds once it has read them."""

    files: Sequence[ControllerFile]
    loaded: Sequence[Curve]
    warnings: Sequence[str] = ()


@dataclass(frozen=True, slots=True)
class Parsed:
    """The curves that files hold, the machine that they name if any, and what is to be said."""

    curves: Mapping[str, Curve]
    warnings: Sequence[str] = ()
    machine: str | None = None


@dataclass(frozen=True, slots=True)
class Joint:
    """What several temperature bands need beside the files of each, and what is to be said."""

    files: Sequence[ControllerFile] = ()
    warnings: Sequence[str] = ()


def _unchanged(options: Options, _band: int, _tables: int) -> Options:
    return options


def _nothing_joint(_bands: Sequence[Sequence[ControllerFile]], _options: Options) -> Joint:
    return Joint()


@dataclass(frozen=True, slots=True)
class Format:
    """One controller's file format.

    Parameters
    ----------
    name, title
        As it is asked for, and as people call it.
    sign
        What its values are; None where that has to be stated.
    status
        How surely all this is known.
    folds
        Whether squareness is folded into straightness because there is no table for it.
    both_directions
        Codes of the components of which it holds both directions of approach; of the others it
        holds their mean.
    for_band
        Options of one of several temperature bands that lie in the controller together: of its
        number from 0, and of how many tables those before it have.
    joint
        What all bands' files need together.
    """

    name: str
    title: str
    sign: Sign | None
    units: str
    spacing: str
    limits: str
    status: Status
    holds: Sequence[str]
    folds: bool
    both_directions: Sequence[str]
    options: type[Options]
    render: Callable[[ErrorTable, Any], Rendered]
    parse: Callable[[Sequence[ControllerFile], Any], Parsed]
    for_band: Callable[[Any, int, int], Options] = field(default=_unchanged)
    joint: Callable[[Sequence[Sequence[ControllerFile]], Any], Joint] = field(
        default=_nothing_joint
    )

    def sign_of(self, options: Options) -> Sign:
        """What the values are: the format's own sign, or the stated one."""
        sign: Sign = getattr(options, "sign", None) or self.sign or "error"
        return sign


SIGN_WORDS: Final[Mapping[str, str]] = {
    "error": "error, actual minus nominal",
    "compensation": "compensation, minus the error",
}


def factor_of(sign: Sign) -> float:
    """The factor from our error to a file's value.

    >>> factor_of("error"), factor_of("compensation")
    (1.0, -1.0)
    """
    return 1.0 if sign == "error" else -1.0


def axes_of(table: ErrorTable) -> list[str]:
    """List the axes along which a table's curves lie, in the order x, y, z."""
    have = {curve.component.axis for curve in table.curves.values()}
    return [axis for axis in LINEAR_LETTERS if axis in have]


def curve_code(output: str, along: str) -> str:
    """Name the error of one axis along another: of y along x it is EYX.

    >>> curve_code("y", "x")
    'EYX'
    """
    return f"E{output}{along}".upper()


def of_axis(named: Mapping[str, Named], axis: str, field: str) -> Named:
    """Give what an option states of an axis, or refuse the option that lacks it.

    >>> of_axis({"x": "AX1"}, "x", "axes")
    'AX1'
    """
    if axis not in named:
        raise InvalidContent.of_field(
            f"options.{field}", f"expected an entry of axis {axis}, got {dict(named)}"
        )
    return named[axis]


@dataclass
class Reading:
    """What has been read of a controller's files so far, and what was left aside.

    Parameters
    ----------
    expected
        What the format has, for who gave files without it.
    """

    expected: str
    curves: dict[str, Curve] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)
    _left_aside: dict[str, list[str]] = field(default_factory=dict)

    def add(self, curve: Curve, file: str) -> None:
        """Add a curve; one component twice is refused, because one of both would be lost."""
        if curve.code in self.curves:
            raise InvalidContent.of_field(
                f"files.{file}", f"expected one table of {curve.code}, got two"
            )
        self.curves[curve.code] = curve

    def leave_aside(self, what: str, why: str) -> None:
        """Note what is not read, because it is none of ours or does nothing in the control."""
        self._left_aside.setdefault(why, []).append(what)

    def parsed(self, files: Sequence[ControllerFile]) -> Parsed:
        """Give what was read, in the order of tables.

        Raises
        ------
        InvalidContent
            If nothing was read.
        """
        others = [
            f"left aside: {list_names(dict.fromkeys(names), limit=8)}: {why}"
            for why, names in self._left_aside.items()
        ]
        if not self.curves:
            names = list_names(file.name for file in files)
            raise InvalidContent.of_field(
                "files", "; ".join([f"expected {self.expected}, got none in {names}", *others])
            )
        ordered = {code: self.curves[code] for code in COMPONENTS if code in self.curves}
        return Parsed(ordered, [*dict.fromkeys(self.warnings), *others])


def curve_read(
    code: str,
    positions_mm: ArrayLike,
    errors_um: ArrayLike,
    backward_um: ArrayLike | None = None,
    *,
    endless: bool = False,
) -> Curve:
    """Make the curve that a file holds; one that is the same in both directions has one side."""
    errors, backward = frozen(errors_um), None
    if backward_um is not None and not np.array_equal(errors_um, backward_um):
        backward = frozen(backward_um)
    return Curve(COMPONENTS[code], frozen(positions_mm), errors, backward, endless)
