"""Numbers and lists as people read them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from app.errors import list_names
from app.geometry.components import COMPONENTS
from app.identification.effects.effect import Effect
from app.units import plus_minus, unit_of_field

TWO_ERRORS: Final = 2.0
"""Values so many standard errors apart are different ones."""


def parameter(effect: Effect, name: str, unit: str | None = None) -> str:
    """Write one of an effect's parameters with its standard error and unit.

    Parameters
    ----------
    effect
        The effect.
    name
        The parameter's name, which ends in its unit.
    unit
        The unit's symbol, where the name does not say it.
    """
    symbol = unit or unit_of_field(name) or ""
    return plus_minus(effect.parameters[name], effect.standard_errors.get(name), symbol).strip()


def strongest(effect: Effect, stem: str) -> str:
    """Name the parameter of a stem (`slope`) that stands clearest above its standard error."""
    names = [n for n in effect.parameters if n.partition("_")[0] == stem]
    return max(names, key=lambda n: _clearness(effect, n))


def is_whole(effect: Effect) -> bool:
    """Whether an effect's share is 1 as far as its standard error can tell."""
    share, error = effect.parameters.get("share", 1.0), effect.standard_errors.get("share", 0.0)
    return abs(share - 1.0) <= TWO_ERRORS * error


def where(name: str) -> str:
    """Say where a parameter applies: at the ends of the travel for a rise."""
    return " from the middle to the end of travel" if "_rise_" in name else ""


def components(effect: Effect) -> str:
    """List the components of an effect, with how many more."""
    return list_names(effect.components, 3)


def symbol_of(code: str, per: str = "") -> str:
    """Give the symbol of a component's unit, per something else.

    >>> symbol_of("EXX", "K"), symbol_of("SXY", "day")
    ('µm/K', 'µm/m/day')
    """
    symbol = COMPONENTS[code].unit.symbol
    return f"{symbol}/{per}" if per else symbol


def verb(codes: Sequence[str], singular: str, plural: str) -> str:
    """Choose the verb's form for a list of components."""
    return singular if len(codes) == 1 else plural


def _clearness(effect: Effect, name: str) -> float:
    error = effect.standard_errors.get(name, 0.0)
    value = abs(effect.parameters[name])
    return value / error if error > 0 else math.inf if value else 0.0
