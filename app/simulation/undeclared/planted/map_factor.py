"""Tables of the maps were stored with the wrong sign, or in another unit.

The machine is what it is, so the effect has the size that the tables have: no amplitude is chosen.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np

from app.simulation.undeclared.components import (
    COMPONENTS,
    ROTATIONS,
    TRANSLATIONS,
    BoolArray,
    FloatArray,
)
from app.simulation.undeclared.effect import Effect
from app.simulation.undeclared.error_tables import ErrorTable
from app.simulation.undeclared.maps import MeasuredMaps
from app.simulation.undeclared.observations import Circumstances, ErrorFunction
from app.simulation.undeclared.setting import Setting

VARIANTS: Final = ("sign", "sign-in-one-map", "inches", "tenfold-in-one-map", "unit-of-one-map")

FACTORS: Final = {"sign": -1.0, "inches": 1.0 / 25.4, "tenfold": 10.0, "unit": 10.0}


def plant(setting: Setting, variant: str) -> Effect:
    """Store one component's table wrongly, in all maps or in one, or all of one map."""
    machine, conditions = setting.machine, setting.conditions
    factor = FACTORS[variant.partition("-")[0]]
    row = int(setting.rng.integers(conditions.maps))
    wrong = np.ones(conditions.maps, dtype=bool)
    if variant.endswith("one-map"):
        wrong[:] = np.arange(conditions.maps) == row
    codes = tuple(sorted(machine.measured_codes))
    if not variant.startswith("unit"):
        codes = (setting.choose_component(TRANSLATIONS + ROTATIONS[:6]),)
    label = "" if wrong.all() else f"State {row + 1}"
    return Effect(
        "map-factor",
        variant,
        codes,
        {code: _residual_error(machine.table(code), code, wrong, factor) for code in codes},
        parameters={"map": label, "stored_times": factor},
        maps=partial(_stored, codes, wrong, factor),
    )


def _scaled(table: ErrorTable, wrong: BoolArray, factor: float) -> ErrorTable:
    return table.with_errors(table.errors * np.where(wrong, factor, 1.0)[:, None])


def _stored(
    codes: tuple[str, ...], wrong: BoolArray, factor: float, maps: MeasuredMaps
) -> MeasuredMaps:
    anew = {code: _scaled(maps.tables[code], wrong, factor) for code in codes}
    return replace(maps, tables={**maps.tables, **anew})


def _residual_error(table: ErrorTable, code: str, wrong: BoolArray, factor: float) -> ErrorFunction:
    """Make the true error minus what exact maps say that are stored so."""
    component, stored = COMPONENTS[code], _scaled(table, wrong, factor)

    def residual(circumstances: Circumstances) -> FloatArray:
        at = (
            circumstances.point_mm[:, component.axis or 0],
            circumstances.temperature(component.sensor),
        )
        return table.at(*at) - stored.at(*at)

    return residual
