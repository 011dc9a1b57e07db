"""Machines and maps to test with, as short to write as what a test is about."""

from datetime import UTC, datetime

import numpy as np

from app.geometry.chain import Chain
from app.geometry.components import COMPONENTS
from app.thermal.error_map import ComponentTable, ErrorMap
from app.thermal.machine import DEFAULT_STAND_INS, Machine, Sensor, sensors_by_name

CHAPTER_SENSORS = ("x-middle", "y-front", "z-column", "spindle")
"""The four of the chapter's machine (8.2.7)."""


def machine(*sensors, **policies):
    """The chapter's machine, with its four sensors unless others are given."""
    chapter = [Sensor(name, stand_in=DEFAULT_STAND_INS.get(name)) for name in CHAPTER_SENSORS]
    return Machine(
        id="mcfv5050",
        name="MCFV5050LN",
        chain=Chain.parse("XYFZ"),
        sensors=sensors_by_name(list(sensors) or chapter),
        **policies,
    )


def table(code, errors, positions_mm=(), backward=None):
    return ComponentTable.make(COMPONENTS[code], errors, positions_mm, backward)


def error_map(label, temperatures_c, *tables, lines=None):
    """A map; one temperature is that of x-middle and z-column alike."""
    if isinstance(temperatures_c, int | float):
        temperatures_c = {"x-middle": temperatures_c, "z-column": temperatures_c}
    return ErrorMap(
        label=label,
        measured_at=datetime(2008, 1, 1, tzinfo=UTC),
        temperatures_c=dict(temperatures_c),
        tables={t.component.code: t for t in tables},
        measuring_lines=lines or {},
    )


def maps_of(code, temperatures_c, errors, positions_mm=()):
    """One map for each temperature, with a row of `errors` each."""
    return [
        error_map(f"Run #{i + 1}", temperature, table(code, row, positions_mm))
        for i, (temperature, row) in enumerate(zip(temperatures_c, errors, strict=True))
    ]


def state_of(model, code, temperatures_c):
    """The group's state and the component's place there, at these temperatures."""
    if isinstance(temperatures_c, int | float):
        temperatures_c = {"x-middle": temperatures_c, "z-column": temperatures_c}
    for state in model.errors_at(temperatures_c):
        for member in state.members:
            if member.component.code == code:
                return state, member
    raise AssertionError(f"{code} is not in the model")


def errors_of(model, code, temperatures_c, *, backward=False):
    """One component's errors at these temperatures: shape of its positions."""
    state, member = state_of(model, code, temperatures_c)
    columns = member.backward if backward else member.forward
    return np.array(state.values[columns])
