"""What the location errors of rotary axes do to a point that the axes carry."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from app.arrays import FloatArray
from app.errors import InvalidContent, list_names
from app.geometry.rotary_axes import location_codes, rotary_location_error
from app.services.ask_field import FieldAnswer, FieldQuestion, Triple, ask_field
from app.services.context import Context


@dataclass(frozen=True, slots=True, eq=False)
class RotaryError:
    """Errors of carried points, shape (n, 3) [µm], and the location errors behind them.

    `left_um` is what remains of them where a control follows those that it knows.
    `locations` has each code's value [µm or µrad] at the temperatures that were asked.
    """

    asked: FieldAnswer
    errors_um: FloatArray
    left_um: FloatArray
    locations: Mapping[str, float]


def compute_rotary_error(
    context: Context,
    machine_id: str,
    question: FieldQuestion,
    points_mm: FloatArray,
    angles_deg: Mapping[str, FloatArray | float],
    order: str,
    pivots_mm: Mapping[str, Triple],
    compensated: Mapping[str, float],
) -> RotaryError:
    """Say how far carried points are from where they should be at given angles.

    Parameters
    ----------
    context, machine_id, question
        As `ask_field`; one thermal state.
    points_mm, angles_deg, order, pivots_mm
        As `rotary_location_error`.
    compensated
        Location errors that a control knows and follows [µm or µrad].

    Raises
    ------
    UnknownThing, NoReading, InvalidContent
        As `ask_field` and `rotary_location_error`.
    """
    codes = location_codes(order)
    others = [code for code in compensated if code not in codes]
    if others:
        raise InvalidContent.of_field(
            "compensated",
            f"expected location errors of {order} ({list_names(codes)}), came {list_names(others)}",
        )
    asked = ask_field(context, machine_id, question, needed=codes)
    locations = {
        code: float(values[0, 0])
        for code, (_, values) in asked.field.tables.items()
        if code in codes
    }
    errors_um = rotary_location_error(locations, points_mm, angles_deg, order, pivots_mm)
    followed_um = rotary_location_error(compensated, points_mm, angles_deg, order, pivots_mm)
    return RotaryError(asked, errors_um, errors_um - followed_um, locations)
