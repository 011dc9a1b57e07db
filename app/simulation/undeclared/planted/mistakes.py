"""People's mistakes in the stored maps, and in what is written beside what was measured.

The machine is what it is. Where the size of an effect follows from its errors or its angles, no
amplitude is chosen.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from app.simulation.undeclared.base_machine import TRAVELS_MM, normalised
from app.simulation.undeclared.components import (
    ASSIGNED_SENSORS,
    AXES,
    CODES,
    COMPONENTS,
    ROTATIONS,
    TRANSLATIONS,
    FloatArray,
    following,
)
from app.simulation.undeclared.effect import Effect
from app.simulation.undeclared.error_tables import ErrorTable
from app.simulation.undeclared.maps import MeasuredMaps
from app.simulation.undeclared.observations import Circumstances, Observations, true_errors
from app.simulation.undeclared.planted.motion import choose_shaped, legendre_of
from app.simulation.undeclared.setting import Setting, table_difference

FACTORS: Final = {"sign": -1.0, "inches": 1.0 / 25.4, "tenfold": 10.0, "unit": 10.0}
"""By which tables were stored in another unit, or with the wrong sign."""

OFF_C: Final = (1.0, 3.0)
LEAST_APART: Final = 0.25
"""Maps come no closer than this share of the gap to their neighbour."""

HOUR_MIN: Final = 60.0
SOME_MIN: Final = (20.0, 45.0)
OFF_MM: Final = (100.0, 200.0)


def _stored(
    codes: Sequence[str], change: Callable[[ErrorTable], ErrorTable], maps: MeasuredMaps
) -> MeasuredMaps:
    """Store some components' measured tables changed."""
    changed = {code: change(maps.tables[code]) for code in codes}
    return replace(maps, tables={**maps.tables, **changed})


def map_factor(setting: Setting) -> Effect:
    """Store one component's table times a factor, in all maps or in one, or all of one map."""
    machine, variant, maps = setting.machine, setting.variant, setting.conditions.maps
    factor = FACTORS[variant.partition("-")[0]]
    row = int(setting.rng.integers(maps))
    is_in_all = not variant.endswith("one-map")
    by_row = np.where(is_in_all | (np.arange(maps) == row), factor, 1.0)[:, None]
    codes = tuple(sorted(machine.measured_codes))
    if not variant.startswith("unit"):
        codes = (setting.choose_component(TRANSLATIONS + ROTATIONS[:6]),)

    def scaled(table: ErrorTable) -> ErrorTable:
        return table.with_errors(table.errors * by_row)

    tables = {code: machine.table(code) for code in codes}
    return setting.effect(
        {code: table_difference(code, table, scaled(table)) for code, table in tables.items()},
        parameters={"map": "" if is_in_all else f"State {row + 1}", "stored_times": factor},
        maps=lambda maps: _stored(codes, scaled, maps),
    )


def map_temperature(setting: Setting) -> Effect:
    """Note one map's temperature wrongly, of one of the sensors that components follow.

    The model has that map at the wrong place of its scale. What a believable slip of the pen cannot
    do, a thermally more sensitive machine does.
    """
    sensor = str(setting.rng.choice(ASSIGNED_SENSORS))
    nodes = setting.machine.map_temperatures_c[sensor]
    inner, outer = list(range(1, nodes.size - 1)), [0, nodes.size - 1]
    row = int(setting.rng.choice(inner if setting.variant == "inner" and inner else outer))
    off_c = float(setting.rng.choice([-1.0, 1.0]) * setting.rng.uniform(*OFF_C))
    noted = nodes.copy()
    beside = row + int(np.sign(off_c))
    if beside in range(nodes.size):
        room_c = (1.0 - LEAST_APART) * abs(nodes[beside] - nodes[row])
        off_c = float(np.sign(off_c) * min(abs(off_c), room_c))
    noted[row] = np.round(nodes[row] + off_c, 1)
    codes = tuple(code for code in following(sensor) if code not in setting.machine.unmeasured)

    def as_noted(table: ErrorTable) -> ErrorTable:
        return table.with_temperatures(noted)

    def stored(maps: MeasuredMaps) -> MeasuredMaps:
        temperatures_c = {**maps.temperatures_c, sensor: noted}
        return replace(_stored(codes, as_noted, maps), temperatures_c=temperatures_c)

    tables = {code: setting.machine.table(code) for code in codes}
    effect = setting.effect(
        {
            code: table_difference(code, table, as_noted(table), clamp=True)
            for code, table in tables.items()
        },
        sensors=(sensor,),
        parameters={
            "map": f"State {row + 1}",
            "noted_c": float(noted[row]),
            "really_c": float(nodes[row]),
        },
        sensitive=codes,
        maps=stored,
    )
    return setting.fitted(effect)


def wrong_map(setting: Setting) -> Effect:
    """Leave a shift, a slope or a profile out of one map of one component.

    Something was amiss while it was measured.
    """
    code = choose_shaped(setting)
    row = int(setting.rng.integers(setting.conditions.maps))
    legendre = legendre_of(setting.rng, setting.variant)
    component, table = COMPONENTS[code], setting.machine.table(code)
    errors = np.zeros_like(table.errors)
    u = normalised(code, table.positions_mm)
    errors[row] = np.polynomial.legendre.legval(u, legendre)
    lacking = table.with_errors(errors)

    def residual(circumstances: Circumstances) -> FloatArray:
        """The true error minus what the maps say."""
        position = circumstances.point_mm[:, component.axis or 0]
        return lacking.at(position, circumstances.temperature(component.sensor), clamp=True)

    effect = setting.planted(
        {code: residual},
        sensors=(component.sensor,),
        parameters={"map": f"State {row + 1}"},
        strengths={f"legendre_{component.unit}": legendre},
    )

    def as_stored(measured: ErrorTable) -> ErrorTable:
        return measured.with_errors(measured.errors - effect.strength * errors)

    return replace(effect, maps=lambda maps: _stored((code,), as_stored, maps))


def clock_offset(setting: Setting) -> Effect:
    """Note all observations at other times than they were made, all as much too early or late."""
    offset_min = {"an-hour-early": -HOUR_MIN, "an-hour-late": HOUR_MIN}.get(setting.variant)
    if offset_min is None:
        offset_min = float(setting.rng.choice([-1.0, 1.0]) * setting.rng.uniform(*SOME_MIN))
    codes = tuple(sorted(setting.machine.measured_codes))

    def reported(observations: Observations) -> Observations:
        return replace(observations, time_min=observations.time_min + offset_min)

    effect = setting.effect(
        true_errors(setting.machine),
        codes,
        parameters={"noted_later_by_min": offset_min},
        sensitive=codes,
        reported=reported,
    )
    return setting.fitted(effect)


def mirrored_axis(setting: Setting) -> Effect:
    """Note positions from the other end of an axis: of all that is measured along it, or a line."""
    axis = int(setting.rng.integers(3))
    codes = tuple(c for c in CODES if COMPONENTS[c].axis == axis)
    if setting.variant == "one-line":
        codes = (setting.choose_component([c for c in TRANSLATIONS if c in codes]),)
    codes = tuple(c for c in codes if c in setting.machine.measured_codes)
    numbers = [CODES.index(code) for code in codes]

    def reported(observations: Observations) -> Observations:
        mirrored = np.isin(observations.component, numbers)
        mirrored |= observations.is_point & (setting.variant == "axis")
        point_mm, direction = observations.point_mm.copy(), observations.direction.copy()
        point_mm[mirrored, axis] = TRAVELS_MM[axis] - point_mm[mirrored, axis]
        direction[mirrored, axis] *= -1
        return replace(observations, point_mm=point_mm, direction=direction)

    return setting.effect(
        true_errors(setting.machine), codes, parameters={"axis": AXES[axis]}, reported=reported
    )


def tool_length(setting: Setting) -> Effect:
    """State one tool, or all of them, too long beside the points: their angles act elsewhere."""
    lengths = np.linalg.norm(setting.observations.tool_mm, axis=1).round(3)
    length_mm = float(setting.rng.choice(np.unique(lengths[lengths > 0.0])))
    off_mm = float(np.round(setting.rng.uniform(*OFF_MM)))
    is_of_all = setting.variant == "every-tool"

    def reported(observations: Observations) -> Observations:
        size = np.linalg.norm(observations.tool_mm, axis=1)
        concerned = size > 0.0 if is_of_all else size.round(3) == length_mm
        tool_mm = observations.tool_mm.copy()
        tool_mm[concerned] *= (1.0 + off_mm / size[concerned])[:, None]
        return replace(observations, tool_mm=tool_mm)

    return setting.effect(
        true_errors(setting.machine),
        tuple(code for code in ROTATIONS if code in setting.machine.measured_codes),
        parameters={"longer_by_mm": -off_mm, "tool_mm": 0.0 if is_of_all else length_mm},
        reported=reported,
    )
