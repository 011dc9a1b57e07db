"""The table of error components: everything that depends on which component it is.

Codes are ISO 230-1's, `E`, direction, axis of motion; beside each stands the
notation of C. Wang, chapter 8. `EYX` is the error in Y as X moves, D_y(x).
Squareness has the chapter's signs (8.58–8.60): E_x gains SXY·y + SZX·z and E_y
gains SYZ·z, so that C0Y = −SXY, B0Z = +SZX and A0Z = −SYZ in ISO 230-1.
"""

from __future__ import annotations

import difflib
import re
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from app.errors import UnknownComponent, list_names
from app.foreign_text import shown
from app.units import Unit

LONGEST_NAME: Final = 40
"""Of a name that is no component's, where it is repeated [characters]."""

LINEAR_LETTERS: Final = "xyz"
ROTATION_LETTERS: Final = "abc"
ROTARY_LOCATION_CODES: Final = (
    *("XOC", "YOC", "AOC", "BOC"),
    *("YOA", "ZOA", "BOA", "COA"),
    *("XOB", "ZOB", "AOB", "COB"),
)


class Kind(StrEnum):
    """The groups of error components."""

    LINEAR = "linear displacement"
    STRAIGHTNESS = "straightness"
    ANGULAR = "angular"
    SQUARENESS = "squareness"
    SLOPE = "nonrigid slope"
    ROTARY_LOCATION = "rotary-axis location"


@dataclass(frozen=True, slots=True)
class Component:
    """One error component and how it enters the volumetric error.

    Parameters
    ----------
    code
        ISO 230-1 code, `EXX`; squareness `SXY`; nonrigid slope `EYY^x`.
    chapter
        The chapter's notation, `D_x(x)`; empty for rotary-axis locations.
    axis
        Axis of motion that is the table's argument; None for a single value.
    direction
        `x`, `y`, `z`: a displacement that way; `a`, `b`, `c`: a rotation about X, Y, Z.
    times
        Coordinate that the value multiplies (squareness and slopes), else None.
    default_sensor
        Sensor of the chapter's machine that the component follows (8.2.9).
    iso, iso_sign
        ISO 230-1 name of a squareness, and the factor from our value to ISO's.
    """

    code: str
    chapter: str
    kind: Kind
    unit: Unit
    axis: str | None
    direction: str
    times: str | None = None
    default_sensor: str | None = None
    iso: str | None = None
    iso_sign: int = 1

    @property
    def is_table(self) -> bool:
        """Whether the component is a table over positions rather than one value."""
        return self.axis is not None

    @property
    def is_rotation(self) -> bool:
        """Whether the component turns rather than displaces."""
        return self.direction in ROTATION_LETTERS

    @property
    def row(self) -> int:
        """Its place among x, y, z, a, b, c: where the volumetric error sums it."""
        return (LINEAR_LETTERS + ROTATION_LETTERS).index(self.direction)

    @property
    def input_field(self) -> str:
        """Name of the field in which a map states this component's values."""
        return f"{_STEM[self.kind] if self.is_table else 'value'}_{self.unit}"

    @property
    def error_field(self) -> str:
        """Name of the field in which an answer gives this component's error."""
        return f"{_STEM[self.kind] if self.is_table else 'error'}_{self.unit}"

    @property
    def standard_error_field(self) -> str:
        """Name of the field in which maps and answers state the errors' standard errors."""
        return f"standard_{'errors' if self.is_table else 'error'}_{self.unit}"

    @property
    def compensation_field(self) -> str:
        """Name of the field in which an answer gives minus the error."""
        return f"compensation_{self.unit}"


_STEM: Final = {kind: "slopes" if kind is Kind.SLOPE else "errors" for kind in Kind}


def _motion_errors() -> list[Component]:
    """Make the 9 linear and 9 angular errors of three linear axes."""
    components = []
    for axis in LINEAR_LETTERS:
        for direction in LINEAR_LETTERS:
            same = direction == axis
            components.append(
                Component(
                    code=f"E{direction}{axis}".upper(),
                    chapter=f"D_{direction}({axis})",
                    kind=Kind.LINEAR if same else Kind.STRAIGHTNESS,
                    unit=Unit.UM,
                    axis=axis,
                    direction=direction,
                    default_sensor="z-column" if axis == "z" else "x-middle",
                )
            )
        for about, rotation in zip(LINEAR_LETTERS, ROTATION_LETTERS, strict=True):
            components.append(
                Component(
                    code=f"E{rotation}{axis}".upper(),
                    chapter=f"A_{about}({axis})",
                    kind=Kind.ANGULAR,
                    unit=Unit.URAD,
                    axis=axis,
                    direction=rotation,
                    default_sensor="z-column" if axis == "z" else "x-middle",
                )
            )
    return components


def _squareness_errors() -> list[Component]:
    """Make the three squareness errors with the signs of 8.58–8.60."""
    rows = [
        ("SXY", "x", "y", "x-middle", "C0Y", -1),
        ("SYZ", "y", "z", "z-column", "A0Z", -1),
        ("SZX", "x", "z", "z-column", "B0Z", +1),
    ]
    return [
        Component(
            code=code,
            chapter=f"S_{code[1:].lower()}",
            kind=Kind.SQUARENESS,
            unit=Unit.UM_PER_M,
            axis=None,
            direction=direction,
            times=times,
            default_sensor=sensor,
            iso=iso,
            iso_sign=sign,
        )
        for code, direction, times, sensor, iso, sign in rows
    ]


def _nonrigid_slopes(parents: list[Component]) -> list[Component]:
    """Make the 36 slopes of 8.1–8.18: each parent's growth with another coordinate."""
    return [
        Component(
            code=f"{parent.code}^{slope}",
            chapter=parent.chapter.replace("(", f"^{slope}("),
            kind=Kind.SLOPE,
            unit=Unit.URAD_PER_M if parent.is_rotation else Unit.UM_PER_M,
            axis=parent.axis,
            direction=parent.direction,
            times=slope,
            default_sensor=parent.default_sensor,
        )
        for parent in parents
        for slope in LINEAR_LETTERS
        if slope != parent.axis
    ]


def _rotary_locations() -> list[Component]:
    """Make the four position-independent errors of each rotary axis (Hsieh 2024; ISO 230-1).

    Hsieh treats C and A; those of B follow in cyclic order.
    """
    return [
        Component(
            code=code,
            chapter="",
            kind=Kind.ROTARY_LOCATION,
            unit=Unit.URAD if code[0] in "ABC" else Unit.UM,
            axis=None,
            direction=code[0].lower(),
        )
        for code in ROTARY_LOCATION_CODES
    ]


_MOTION: Final = _motion_errors()

COMPONENTS: Final[dict[str, Component]] = {
    component.code: component
    for component in [
        *_MOTION,
        *_squareness_errors(),
        *_nonrigid_slopes(_MOTION),
        *_rotary_locations(),
    ]
}
"""Every component by its code, in the order in which tables list them."""

ORDER: Final[dict[str, int]] = {code: i for i, code in enumerate(COMPONENTS)}

_OF_MOTIONS: Final = [c for c in COMPONENTS.values() if c.axis and len(c.code) == 3]
"""EXX to ECZ."""

_ABOUT: Final = str.maketrans("ABC", "XYZ")
"""The axis that a rotation is about."""

_WITHOUT_BRACKETS: Final = str.maketrans("", "", "_()")

_BY_OTHER_NAME: Final[dict[str, tuple[Component, int]]] = {
    **{c.chapter.replace("_", "").lower(): (c, 1) for c in COMPONENTS.values() if c.chapter},
    **{c.iso.lower(): (c, c.iso_sign) for c in COMPONENTS.values() if c.iso},
    **{f"e{c.iso}".lower(): (c, c.iso_sign) for c in COMPONENTS.values() if c.iso},
    # ISO 230-1 writes a zero where Hsieh writes the letter O: X0C.
    **{
        c.code.replace("O", "0").lower(): (c, 1)
        for c in COMPONENTS.values()
        if c.kind is Kind.ROTARY_LOCATION
    },
    # E_XX and E_X(X) beside EXX; VDI 2617's xTy and xRz; δ_y(x) and ε_z(x) of the literature.
    **{c.code.lower(): (c, 1) for c in _OF_MOTIONS},
    **{
        c.code.lower(): (c, 1)
        for c in COMPONENTS.values()
        if re.fullmatch("E[A-CXYZ][XYZ]", c.code)
    },
    **{
        f"{c.code[2]}{kind}{c.code[1].translate(_ABOUT)}".lower(): (c, 1)
        for kind, letters in (("T", "XYZ"), ("R", "ABC"))
        for c in _OF_MOTIONS
        if c.code[1] in letters
    },
    **{
        f"{letter}{c.code[1].translate(_ABOUT)}{c.code[2]}".lower(): (c, 1)
        for letter, letters in (("δ", "XYZ"), ("ε", "ABC"))
        for c in _OF_MOTIONS
        if c.code[1] in letters
    },
}

_UNSURE: Final = re.compile(
    r"(?<![a-z])(?:[xyz]?(roll|pitch|yaw)(?![a-z]{2})|[xyz]w[xyz](?![a-z]))"
)
"""Names of other instruments that name no component surely."""


def parse_component(name: str) -> tuple[Component, int]:
    """Read a component's name in any notation that people use.

    Parameters
    ----------
    name
        ISO 230-1 code (`EXX`), the chapter's notation (`D_x(x)`, `Dx(x)`,
        `D_y^x(y)`, `S_xy`), ISO's squareness (`C0Y`, `A0Z`, `B0Z`), or a rotary-axis
        location with ISO's zero (`X0C`).

    Returns
    -------
    Component, int
        The component, and the sign that turns a value under this name into ours:
        −1 for `C0Y` and `A0Z`, else +1.

    Raises
    ------
    UnknownComponent
        If nobody calls a component so; the sentence says which are nearest.

    Examples
    --------
    >>> parse_component("D_y(x)")[0].code
    'EYX'
    >>> component, sign = parse_component("C0Y")
    >>> component.code, sign
    ('SXY', -1)
    """
    component = find_component(name)
    if component is None:
        raise UnknownComponent(unknown_component(name))
    return component


def find_component(name: str) -> tuple[Component, int] | None:
    """Read a name as `parse_component` does; None where it is no component's."""
    text = re.sub(r"\s+", "", name)
    head, caret, slope = text.partition("^")
    exact = COMPONENTS.get(f"{head.upper()}{caret}{slope.lower()}")
    if exact is not None:
        return exact, 1
    plain = text.lower()
    return _BY_OTHER_NAME.get(plain.replace("_", "")) or _BY_OTHER_NAME.get(
        plain.translate(_WITHOUT_BRACKETS)
    )


def unsure_component(name: str) -> str:
    """Say why a name that other instruments use names no component surely; else empty.

    >>> unsure_component("Yaw X")
    'expected a rotation by its axis, as EAX, EBX or ECX: which of them it is depends on which \
axis is vertical, and its sign on the instrument'
    """
    match = _UNSURE.search(name.lower())
    if match is None:
        return ""
    if match[1]:
        return (
            "expected a rotation by its axis, as EAX, EBX or ECX: which of them it is depends on "
            "which axis is vertical, and its sign on the instrument"
        )
    return "expected a squareness as SXY or, with ISO 230-1's sign, C0Y: xWy states no sign"


def unknown_component(name: str) -> str:
    """Say what would have been a component's name; slow, so only for what somebody will read."""
    name = shown(name, LONGEST_NAME)
    near = difflib.get_close_matches(name.upper(), COMPONENTS, n=3, cutoff=0.5)
    hint = f"; near it: {list_names(near)}" if near else ""
    if unsure := unsure_component(name):
        return f"{unsure}, got {name!r}"
    return (
        f"expected an error component such as EXX, EYX, EBX, SXY, EYY^x or, in the chapter's "
        f"notation, D_x(x), got {name!r}{hint}"
    )
