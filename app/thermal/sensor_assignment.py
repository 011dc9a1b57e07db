"""Which sensor each component follows: the proposal by correlation (C. Wang, 8.2.9).

Over the maps, each component's change is correlated with each sensor's temperature.
With few maps most sensors cannot be told apart; then the sensor that the component
follows already stands. This is a proposal: nothing changes by itself.
The comparison of two sensors is Williams' (1959) test, as recommended by J. H. Steiger,
Psychol. Bull. 87, 245-251 (1980).
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from typing import Annotated, Final

import numpy as np
from pydantic import Field

from app.answer import Answer, Code, shown
from app.arrays import FloatArray
from app.errors import Conflict, InvalidContent, list_names
from app.geometry.components import COMPONENTS, ORDER
from app.rounding import Digits
from app.thermal.correlation import ENOUGH, fisher_interval, pearson_r, tell_apart
from app.thermal.error_map import ErrorMap
from app.thermal.machine import Machine, SameTemperature, Sensor
from app.thermal.resampling import common_positions, sample_table

NO_CHANGE: Final = 1e-9
"""A change smaller than this share of the component's largest error is rounding."""


@dataclass(frozen=True, slots=True)
class SensorCorrelation(Answer, published_as="SensorCorrelationAnswer"):
    """How one component's change goes with one sensor's temperature over the maps."""

    sensor: Annotated[str, Field(examples=["x-middle"])]
    """Sensor"""
    r: Digits | None
    """Pearson's correlation, positive where the error at the position that changes most grows with
    the temperature; null where there is none"""
    r_low: Annotated[float | None, Field(exclude=True)]
    r_high: Annotated[float | None, Field(exclude=True)]
    maps: int
    """Number of maps that it rests on"""
    ties_with_best: bool
    """Whether these maps cannot tell it from the best sensor"""
    reason: str = ""
    """Why there is no r, or why it cannot be proposed; else empty"""

    @shown
    def confidence_95(
        self,
    ) -> Annotated[list[Digits], Field(min_length=2, max_length=2)] | None:
        """Its 95 % confidence interval; null for fewer than four maps."""
        if self.r_low is None or self.r_high is None:
            return None
        return [self.r_low, self.r_high]


@dataclass(frozen=True, slots=True)
class Proposal(Answer, published_as="ProposalAnswer"):
    """What the maps say about the sensor of one component."""

    code: Annotated[Code, Field(alias="component")]
    """Component code"""
    current_sensor: Annotated[str | None, Field(alias="current")]
    """Sensor assigned now"""
    proposed_sensor: Annotated[str | None, Field(alias="proposed")]
    """Sensor that the maps speak for"""
    maps: int
    """Number of maps that have the component"""
    correlations: tuple[SensorCorrelation, ...]
    """One for each sensor"""
    reason: str
    """Why"""

    @shown
    def chapter(self) -> Annotated[str, Field(examples=["D_x(x)"])]:
        """The chapter's notation."""
        return COMPONENTS[self.code].chapter


def with_patterns(assignment: Mapping[str, str], present: Collection[str]) -> dict[str, str]:
    """Let a `*` in names of components stand for those of the maps that fit; names go first.

    Parameters
    ----------
    assignment
        Component code, or a pattern such as `E*X`, to sensor.
    present
        Codes of the components that maps have.

    Raises
    ------
    InvalidContent
        If a pattern fits none of them, or two patterns give one of them two sensors.

    Examples
    --------
    >>> with_patterns({"E*X": "bed", "EXX": "x-middle"}, ["EXX", "EYX", "EYY"])
    {'EXX': 'x-middle', 'EYX': 'bed'}
    """
    named = {code: sensor for code, sensor in assignment.items() if "*" not in code}
    by_pattern: dict[str, str] = {}
    for pattern in [code for code in assignment if code not in named]:
        fitting = [code for code in present if fnmatchcase(code, pattern)]
        if not fitting:
            maps_have = list_names(sorted(present, key=ORDER.__getitem__)) if present else "none"
            raise InvalidContent.of_field(
                pattern,
                f"expected a pattern that fits components of the machine's maps ({maps_have}), "
                f"got {pattern!r}",
            )
        for code in fitting:
            sensor = assignment[pattern]
            if by_pattern.setdefault(code, sensor) != sensor and code not in named:
                raise InvalidContent.of_field(
                    pattern,
                    f"{code} fits two patterns with two sensors, {by_pattern[code]!r} and "
                    f"{sensor!r}: name it",
                )
    both = by_pattern | named
    return {code: both[code] for code in sorted(both, key=ORDER.__getitem__)}


def propose_assignment(
    machine: Machine, maps: Iterable[ErrorMap], assignment: Mapping[str, str]
) -> list[Proposal]:
    """Propose the sensor that each component of the maps should follow.

    Parameters
    ----------
    maps
        The error maps of a model, in any order: the result does not depend on it.
    assignment
        Component code to sensor, where the user has said so.

    Returns
    -------
    list of Proposal
        One for each component that any map has, in the order of the table of components.

    Raises
    ------
    UnknownThing
        If a component is assigned to a sensor that the machine does not have.

    Notes
    -----
    A component's change is one number a map: the score on the first principal
    component of its errors over the common positions, which for a single value is the
    value itself. Two sensors tie when Williams' test finds no difference of their |r|
    at 5 %; with fewer than four maps every sensor ties. The best of k sensors is
    compared pairwise, without correction for k. Where the maps could not be
    interpolated over the proposed sensor, because two of them lie closer than it
    resolves, the reason says so.
    """
    by_code: dict[str, list[ErrorMap]] = defaultdict(list)
    for error_map in sorted(maps, key=lambda m: m.label):
        for code in error_map.tables:
            by_code[code].append(error_map)
    return [
        _propose(machine, code, by_code[code], assignment.get(code) or machine.default_sensor(code))
        for code in sorted(by_code, key=ORDER.__getitem__)
    ]


def _propose(
    machine: Machine, code: str, maps: Sequence[ErrorMap], current: str | None
) -> Proposal:
    if current is not None:
        machine.sensor(current)
    change, why_not = _change(code, maps)
    correlations = tuple(
        _correlate(sensor, maps, change, why_not) for sensor in machine.sensors.values()
    )
    if change is None:
        return Proposal(code, current, current, len(maps), correlations, why_not)
    candidates = [c for c in correlations if c.r is not None]
    if not candidates:
        why = "; ".join(c.reason for c in correlations) or "the machine has none"
        why = f"no sensor can be proposed: {why}"
        return Proposal(code, current, current, len(maps), correlations, why)
    best = max(candidates, key=_strength)
    tied = {c.sensor for c in candidates if _ties(maps, c, best)}
    correlations = tuple(replace(c, ties_with_best=c.sensor in tied) for c in correlations)
    proposed = current if current in tied else best.sensor
    reason = _reason(current, best, correlations)
    if proposed != current:
        reason += _caution(machine, machine.sensor(best.sensor), maps)
    return Proposal(code, current, proposed, len(maps), correlations, reason)


def _change(code: str, maps: Sequence[ErrorMap]) -> tuple[FloatArray | None, str]:
    """Reduce a component's tables to one number a map: shape (M,), or the reason why not."""
    if len(maps) < 2:
        return None, f"only {maps[0].label} has {code}, at least two maps are needed"
    tables = [error_map.tables[code] for error_map in maps]
    try:
        positions = common_positions(tables)
    except Conflict as conflict:
        return None, conflict.detail
    both = (False, True) if all(t.backward_errors is not None for t in tables) else (False,)
    errors = np.array(
        [np.hstack([sample_table(t, positions, backward=b) for b in both]) for t in tables]
    )
    if np.ptp(errors, axis=0).max() <= NO_CHANGE * np.abs(errors).max():
        return None, f"it does not change over its {len(maps)} maps"
    return _first_scores(errors), ""


def _first_scores(errors: FloatArray) -> FloatArray:
    """Project (M, n) errors on the first principal component of their change: shape (M,).

    A principal component has no sign of its own. It gets the one by which the position
    that changes most, the last of such, changes upwards.
    """
    change = errors - errors.mean(axis=0)
    loading = np.linalg.svd(change, full_matrices=False)[2][0]
    most = np.flatnonzero(np.abs(loading) >= (1 - NO_CHANGE) * np.abs(loading).max())[-1]
    scores: FloatArray = change @ loading * np.sign(loading[most])
    return scores


def _correlate(
    sensor: Sensor,
    maps: Sequence[ErrorMap],
    change: FloatArray | None,
    why_not: str,
) -> SensorCorrelation:
    measured = [m for m in maps if sensor.name in m.temperatures_c]
    why_not = why_not or _without_use(sensor, maps, measured)
    if change is None or why_not:
        return SensorCorrelation(sensor.name, None, None, None, len(measured), False, why_not)
    r = pearson_r(change, _temperatures(sensor.name, maps))
    low, high = fisher_interval(r, len(maps)) or (None, None)
    return SensorCorrelation(sensor.name, r, low, high, len(maps), False)


def _without_use(sensor: Sensor, maps: Sequence[ErrorMap], measured: Sequence[ErrorMap]) -> str:
    """Say why nothing can be correlated with a sensor, or nothing where it can."""
    if len(measured) < len(maps):
        missing = [m.label for m in maps if sensor.name not in m.temperatures_c]
        return f"{sensor.name} has no temperature in {list_names(missing, 3)}"
    span_c = float(np.ptp(_temperatures(sensor.name, maps)))
    if not sensor.resolves(span_c):
        return (
            f"{sensor.name} is constant over the maps: it changes by {span_c:.3g} °C, "
            f"its resolution is {sensor.resolution_c:g} °C"
        )
    return ""


def _caution(machine: Machine, sensor: Sensor, maps: Sequence[ErrorMap]) -> str:
    """Say what stands against interpolating the maps over a sensor, or nothing."""
    ordered = sorted(maps, key=lambda m: (m.temperatures_c[sensor.name], m.label))
    gaps_c = np.diff(_temperatures(sensor.name, ordered))
    closest = int(gaps_c.argmin())
    if machine.same_temperature is SameTemperature.MEAN or sensor.resolves(gaps_c[closest]):
        return ""
    return (
        f"; but it reads {gaps_c[closest]:.3g} °C between {ordered[closest].label} and "
        f"{ordered[closest + 1].label}, less than its resolution of {sensor.resolution_c:g} °C: "
        "only with the machine's same_temperature set to 'mean'"
    )


def _ties(maps: Sequence[ErrorMap], candidate: SensorCorrelation, best: SensorCorrelation) -> bool:
    """Whether one sensor's |r| is not significantly below the best one's."""
    if candidate.sensor == best.sensor or candidate.r is None or best.r is None:
        return True
    between = pearson_r(_temperatures(candidate.sensor, maps), _temperatures(best.sensor, maps))
    between *= math.copysign(1.0, candidate.r) * math.copysign(1.0, best.r)
    return not tell_apart(abs(best.r), abs(candidate.r), between, len(maps))


def _reason(
    current: str | None, best: SensorCorrelation, correlations: Sequence[SensorCorrelation]
) -> str:
    """Say why the current sensor stands or which one is better."""
    present = next((c for c in correlations if c.sensor == current), None)
    if present is not None and not present.ties_with_best:
        why = present.reason or f"{_figure(present)} is significantly worse"
        return f"{_figure(best)} correlates best; {why}"
    few = f"; {best.maps} maps cannot tell sensors apart, at least {ENOUGH} are needed"
    caution = few if best.maps < ENOUGH else ""
    if present is None:
        others = [c.sensor for c in correlations if c.ties_with_best and c.sensor != best.sensor]
        return f"{_figure(best)} correlates best; tied with it: {list_names(others)}{caution}"
    if caution:
        return f"{_figure(present)} stands{caution}"
    if present.sensor == best.sensor:
        tied = [c.sensor for c in correlations if c.ties_with_best and c.sensor != best.sensor]
        beside = f"; not significantly better than {list_names(tied)}" if tied else ""
        return f"{_figure(present)} stands: it correlates best{beside}"
    return f"{_figure(present)} stands: {_figure(best)} is not significantly better"


def _figure(correlation: SensorCorrelation) -> str:
    return f"{correlation.sensor} (r = {correlation.r:.3f}, {correlation.maps} maps)"


def _strength(correlation: SensorCorrelation) -> float:
    """|r|, so rounded that of equal ones the machine's first sensor is the best."""
    return round(abs(correlation.r or 0.0), 9)


def _temperatures(sensor: str, maps: Sequence[ErrorMap]) -> FloatArray:
    return np.array([error_map.temperatures_c[sensor] for error_map in maps])
