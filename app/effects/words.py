"""Numbers and lists as people read them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from app.effects.effect import Effect
from app.effects.shape import Rising
from app.errors import list_names
from app.geometry.components import COMPONENTS
from app.units import plus_minus, unit_of_field

TWO_ERRORS: Final = 2.0
SURELY: Final = 3.0
"""Values so many standard errors apart are different ones, and surely so."""

MOST_NAMED: Final = 3
"""So many names stand in a sentence; of others it says how many they are."""


def parameter(effect: Effect, name: str, unit: str | None = None) -> str:
    """Write one of an effect's parameters with its standard error and unit.

    Parameters
    ----------
    name
        The parameter's name, which ends in its unit.
    unit
        The unit's symbol, where the name does not say it.
    """
    symbol = unit or unit_of_field(name) or ""
    return plus_minus(effect.parameters[name], effect.standard_errors.get(name), symbol).strip()


def size_along(effect: Effect, stem: str, symbol: str) -> str:
    """Write how strong an effect is, and where: one that changes along an axis is so at one place.

    Parameters
    ----------
    stem
        What its parameters' names begin with: `slope`.
    symbol
        The unit's symbol.

    Returns
    -------
    str
        Such as `0.152 ± 0.003 µm/day at X 250 mm and 0.061 ± 0.002 µm/day more for each 100 mm`.
    """
    names = [name for name in effect.parameters if name.partition("_")[0] == stem]
    level = next((name for name in names if "_rise_" not in name), None)
    rise = next((name for name in names if "_rise_" in name), None)
    term = next((t for t in effect.terms if isinstance(t.shape, Rising)), None)
    if rise is None or term is None or not isinstance(term.shape, Rising):
        return parameter(effect, level or names[0], symbol)
    line = term.shape
    each_mm = 10.0 ** math.floor(math.log10(2.0 * line.half_mm))
    value, error = effect.parameters[rise], effect.standard_errors.get(rise)
    # A line that falls from end to end is told as less, so that no minus says more.
    factor = each_mm / line.half_mm
    how = plus_minus(
        value * factor if level is None else abs(value) * factor,
        None if error is None else error * factor,
        symbol,
    )
    middle = f"{(COMPONENTS[term.component].axis or '').upper()} {line.middle_mm:.6g} mm".strip()
    if level is None:
        return f"{how} per {each_mm:g} mm from {middle}"
    more = "rising" if value >= 0.0 else "falling"
    return f"{parameter(effect, level, symbol)} at {middle}, {more} by {how} per {each_mm:g} mm"


def is_whole(effect: Effect) -> bool:
    """Whether an effect's share is 1 as far as its standard error can tell."""
    share, error = effect.parameters.get("share", 1.0), effect.standard_errors.get("share", 0.0)
    return abs(share - 1.0) <= TWO_ERRORS * error


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
