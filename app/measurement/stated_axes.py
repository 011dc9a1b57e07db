"""Take the axis of a measurement, its straightness, and the line on which it was measured."""

from __future__ import annotations

from numpy.typing import ArrayLike

from app.errors import InvalidContent
from app.geometry.components import (
    COMPONENTS,
    LINEAR_LETTERS,
    Component,
    Kind,
    parse_component,
)
from app.geometry.measuring_line import MeasuringLine


def expect_linear_axis(axis: str) -> None:
    """Refuse what is no linear axis.

    Parameters
    ----------
    axis
        `x`, `y` or `z`.

    Raises
    ------
    InvalidContent
        If it is something else.
    """
    if axis not in tuple(LINEAR_LETTERS):
        raise InvalidContent.of_field("axis", f"expected axis x, y or z, came {axis!r}")


def as_straightness(name: str) -> Component:
    """Take a straightness component by its name.

    Parameters
    ----------
    name
        In any notation that `parse_component` reads.

    Returns
    -------
    Component

    Raises
    ------
    InvalidContent
        If it is another kind of component.

    Examples
    --------
    >>> as_straightness("D_x(y)").code
    'EXY'
    """
    component, _ = parse_component(name)
    if component.kind is not Kind.STRAIGHTNESS:
        of_kind = [c.code for c in COMPONENTS.values() if c.kind is Kind.STRAIGHTNESS]
        raise InvalidContent.of_field(
            "component",
            f"expected a straightness component ({', '.join(of_kind)}), came {component.code}, "
            f"{component.kind.value}",
        )
    return component


def stated_line(
    axis: str,
    point_mm: ArrayLike,
    tool_offset_mm: ArrayLike,
    point_field: str = "measuring_line_mm",
) -> MeasuringLine:
    """Take an axis' measuring line.

    Parameters
    ----------
    axis
        `x`, `y` or `z`.
    point_mm, tool_offset_mm : array-like, shape (3,) [mm]
        As for `MeasuringLine`.
    point_field
        Field that states the point.

    Returns
    -------
    MeasuringLine

    Raises
    ------
    InvalidContent
        If the point or the tool offset has not three finite coordinates; the field to
        blame is the one that states it.

    Examples
    --------
    >>> stated_line("x", [0, 250, 100], [0, 0, 160]).tool_offset_mm
    (0.0, 0.0, 160.0)
    """
    for field, stated in ((point_field, point_mm), ("tool_offset_mm", tool_offset_mm)):
        try:
            MeasuringLine.make(axis, stated)
        except InvalidContent as error:
            raise InvalidContent.of_field(field, error.errors[0].message) from None
    return MeasuringLine.make(axis, point_mm, tool_offset_mm)
