"""The chapter's two machines that are not rigid: which slopes exist on each (8.19–8.54).

A nonrigid error grows with another coordinate, D_x(x) by D_x^y(x)·y (8.1–8.18). Most
of the 36 slopes are negligible on any machine; a preset names those that are not.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Final

from pydantic import Field

from app.answer import Answer
from app.errors import UnknownThing, list_names
from app.geometry.components import parse_component


@dataclass(frozen=True, slots=True)
class NonrigidPreset(Answer, published_as="PresetAnswer"):
    """A kind of machine that is not rigid (C. Wang, 8.19–8.54)."""

    name: Annotated[str, Field(examples=["large-gantry"])]
    """How it is asked for"""
    configuration: Annotated[str, Field(examples=["XYFZ"])]
    """The chain that the source gives it"""
    equations: Annotated[str, Field(examples=["8.37–8.54"])]
    """Where it is printed"""
    reason: str
    """What bends it"""
    slopes: Annotated[tuple[str, ...], Field(examples=[["EXY^x"]])]
    """The nonrigid slopes that are not negligible on it"""


def _codes(printed: str) -> tuple[str, ...]:
    """Read slopes in the chapter's notation."""
    return tuple(parse_component(name)[0].code for name in printed.split())


NONRIGID_PRESETS: Final = {
    preset.name: preset
    for preset in [
        NonrigidPreset(
            name="horizontal-counterweight",
            configuration="XFYZ",
            equations="8.19–8.36",
            reason="a large counterweight along y: slopes of the x axis in y",
            slopes=_codes("D_x^y(x) D_y^y(x) D_z^y(x) A_x^y(x) A_y^y(x)"),
        ),
        NonrigidPreset(
            name="large-gantry",
            configuration="XYFZ",
            equations="8.37–8.54",
            reason="weight that shifts along a long x: slopes of the y and z axes in x",
            slopes=_codes(
                "D_x^x(y) D_y^x(y) D_z^x(y) D_x^x(z) D_y^x(z) D_z^x(z) "
                "A_x^x(y) A_y^x(y) A_x^x(z) A_y^x(z)"
            ),
        ),
    ]
}
"""The presets by name."""


def find_preset(name: str) -> NonrigidPreset:
    """Find one of the chapter's nonrigid machines.

    Raises
    ------
    UnknownThing
        If there is no such preset; the sentence lists those that exist.

    Examples
    --------
    >>> find_preset("horizontal-counterweight").slopes
    ('EXX^y', 'EYX^y', 'EZX^y', 'EAX^y', 'EBX^y')
    """
    if name not in NONRIGID_PRESETS:
        raise UnknownThing(
            f"expected a nonrigid preset ({list_names(NONRIGID_PRESETS)}), got {name!r}"
        )
    return NONRIGID_PRESETS[name]
