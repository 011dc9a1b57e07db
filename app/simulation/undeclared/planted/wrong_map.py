"""One map of one component is wrong: something was amiss while it was measured.

The machine is what it is; a shift, a slope or a profile is lacking in the stored table of one
thermal state.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np

from app.simulation.undeclared.base_machine import normalised
from app.simulation.undeclared.components import COMPONENTS, ROTATIONS, TRANSLATIONS, FloatArray
from app.simulation.undeclared.effect import Effect
from app.simulation.undeclared.error_tables import ErrorTable
from app.simulation.undeclared.maps import MeasuredMaps
from app.simulation.undeclared.observations import Circumstances, ErrorFunction
from app.simulation.undeclared.planted.outdated_map import coefficients
from app.simulation.undeclared.setting import Setting

VARIANTS: Final = ("shift", "slope", "profile")


def plant(setting: Setting, variant: str) -> Effect:
    """Leave something out of one map of one component."""
    code = setting.choose_component(None if variant == "shift" else TRANSLATIONS + ROTATIONS[:6])
    row = int(setting.rng.integers(setting.conditions.maps))
    legendre = coefficients(setting.rng, variant)
    table = _lacking(setting.machine.table(code), code, row, legendre)
    effect = setting.scaled(
        Effect(
            "wrong-map",
            variant,
            (code,),
            {code: _residual_error(table, code)},
            sensors=(COMPONENTS[code].sensor,),
            parameters={"map": f"State {row + 1}"},
            strengths={f"legendre_{COMPONENTS[code].unit}": legendre},
        )
    )
    return replace(effect, maps=partial(_stored, code, effect.strength * table.errors))


def _lacking(table: ErrorTable, code: str, row: int, legendre: list[float]) -> ErrorTable:
    """Make the table of what one map lacks: nothing in all others."""
    errors = np.zeros_like(table.errors)
    u = normalised(code, table.positions_mm)
    errors[row] = np.polynomial.legendre.legval(u, legendre)
    return table.with_errors(errors)


def _stored(code: str, lacking: FloatArray, maps: MeasuredMaps) -> MeasuredMaps:
    table = maps.tables[code]
    return replace(maps, tables={**maps.tables, code: table.with_errors(table.errors - lacking)})


def _residual_error(lacking: ErrorTable, code: str) -> ErrorFunction:
    """Make the true error minus what the maps say."""
    component = COMPONENTS[code]

    def residual(circumstances: Circumstances) -> FloatArray:
        position = circumstances.point_mm[:, component.axis or 0]
        return lacking.at(position, circumstances.temperature(component.sensor), clamp=True)

    return residual
