"""The methods of measuring that there are."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from app.api.methods.body_diagonal import BODY_DIAGONAL
from app.api.methods.drilled_plate import DRILLED_PLATE
from app.api.methods.machined_part import MACHINED_PART
from app.api.methods.method import Method
from app.api.methods.positioning import POSITIONING
from app.api.methods.rotary_axis import ROTARY_AXIS
from app.api.methods.six_dof import SIX_DOF
from app.api.methods.step_diagonal import STEP_DIAGONAL
from app.api.methods.thermal_drift import THERMAL_DRIFT
from app.errors import InvalidContent, list_names

METHODS: Final[Mapping[str, Method[Any, Any]]] = {
    method.name: method
    for method in (
        POSITIONING,
        SIX_DOF,
        STEP_DIAGONAL,
        BODY_DIAGONAL,
        MACHINED_PART,
        DRILLED_PLATE,
        ROTARY_AXIS,
        THERMAL_DRIFT,
    )
}

TITLES: Final = {method.name: method.title for method in METHODS.values() if method.makes_one_map}
"""Of those whose tables a page takes."""


def method_named(name: str) -> Method[Any, Any]:
    """Find a method.

    Raises
    ------
    InvalidContent
        That lists the methods.
    """
    if name not in METHODS:
        raise InvalidContent.of_field(
            "method", f"expected one of {list_names(METHODS)}, got {name!r}"
        )
    return METHODS[name]
