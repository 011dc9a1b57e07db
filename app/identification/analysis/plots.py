"""Arrays of an analysis that its report draws."""

from __future__ import annotations

from dataclasses import dataclass

from app.answer import Answer, UnitSymbol


@dataclass(frozen=True, slots=True)
class EffectCurve(Answer):
    """An effect's residuals over what drives it: arrays of equal length, for some of the values.

    Where it acts on components of several units, only those of one unit are drawn: the one in which
    it explains most.
    """

    over: str
    """What drives it; `time` in seconds since 1970-01-01 UTC"""

    over_unit: str
    """Its unit"""

    unit: UnitSymbol
    """Unit of the residuals"""

    components: tuple[str, ...]
    """The component of each residual"""

    driver: tuple[float, ...]
    """What drives it [mm; K, s …], in `over_unit`"""

    before: tuple[float, ...]
    """Residuals with all other effects, but without this one [µm; …], in `unit`"""

    after: tuple[float, ...]
    """Residuals with all effects [µm; …], in `unit`"""

    explained: tuple[float, ...]
    """What this effect predicts [µm; …], in `unit`"""

    direction: tuple[float, ...]
    """Approach of its own axis: 1, -1, or 0 where it is not known"""


@dataclass(frozen=True, slots=True)
class VisitMeans(Answer):
    """Means by visit of one component: arrays of equal length."""

    component: str
    """Component code, or `points x`"""

    unit: UnitSymbol
    """Unit of the means"""

    at_points: bool
    """Whether the values are of points of the work volume"""

    time_s: tuple[float, ...]
    """Mean time of each [s], since 1970-01-01 UTC"""

    direction: tuple[float, ...]
    """Approach, 1 or -1, where an effect's error reverses with it: each visit then has two means;
    else 0"""

    count: tuple[int, ...]
    """Number of values in each mean"""

    before: tuple[float, ...]
    """Means before [µm; …], in `unit`"""

    after: tuple[float, ...]
    """Means with all effects [µm; …], in `unit`"""

    expected: tuple[float, ...] = ()
    """Expected standard deviation of each mean, from repeatability, set-up scatter and the maps'
    own uncertainty [µm; …], in `unit`; empty in older results"""


@dataclass(frozen=True, slots=True)
class Plots(Answer):
    """Arrays for the report's plots, at most some hundred points each."""

    effects: tuple[EffectCurve, ...]
    """One for each effect that residuals show, in the order of the effects"""

    visits: tuple[VisitMeans, ...]
    """One for each component"""
