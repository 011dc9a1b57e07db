"""Thermal drift between tool and workpiece, read over hours by a nest of displacement sensors.

The nest stands where the workpiece would, a mandrel or a ball is where the tool would be, and
three or five sensors read how the one moves against the other while the room changes, the
spindle turns or an axis runs: the tests of ISO 230-3. From their course follow the figures that
are reported of such a test, error maps of chosen thermal states, and observations for the loop.

References
----------
ISO 230-3:2020, *Test code for machine tools — Determination of thermal effects*: its scope names
the environmental temperature variation error (ETVE), the distortion by rotating spindles and by
moving linear axes, which are evaluated here, and that by rotary components, which is not. The
figures are those that reports of these tests state; docs/methods/thermal-drift.md defines each,
and says what was known of the standard's own text.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from app.arrays import FloatArray, IntArray, frozen
from app.errors import InvalidContent, counted, list_names
from app.geometry.chain import Chain
from app.geometry.components import COMPONENTS, LINEAR_LETTERS, parse_component
from app.geometry.measuring_line import MeasuringLines
from app.measurement.result import MeasurementResult
from app.measurement.stated_numbers import (
    FARTHEST_MM,
    as_numbers,
    as_point,
    as_standard_deviation,
    suspiciously_small,
)
from app.measurement.stated_runs import expect_linear_axis, stated_line
from app.thermal.error_map import LARGEST_ERROR_UM, ComponentTable
from app.units import SECONDS_PER_MIN, UM_PER_MM, URAD_PER_RAD


class DriftTest(StrEnum):
    """What moves or changes while the nest is read."""

    ENVIRONMENT = "environment"
    SPINDLE = "spindle"
    LINEAR_AXIS = "linear-axis"


SENSORS: Final = ("x", "y", "z", "x2", "y2")
"""Of the nest: x2 and y2 read further along Z, and with x and y the tilts."""

UNITS: Final[Mapping[str, str]] = {"x": "um", "y": "um", "z": "um", "a": "urad", "b": "urad"}
"""What the sensors show: displacements [µm], tilts about X and Y [µrad]."""

FIRST_MIN: Final = 60.0
"""A spindle test has figures of this long after its start [min], and of the whole running."""

MOST_TARGETS: Final = 20
"""Of a moving axis: further ones are a measurement of positioning, which has its own method."""

_FEWEST_FOR_NOISE: Final = 8
_NORMAL_QUARTILE: Final = 0.6745
"""The median of |v| over the standard deviation of a normal v."""

_URAD_PER_UM_PER_MM: Final = URAD_PER_RAD / UM_PER_MM


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """One displacement or tilt at one target, from the first reading there.

    Parameters
    ----------
    times_s : ndarray, shape (n,) [s]
        Strictly increasing.
    values : ndarray, shape (n,) [µm; µrad]
        Readings less the first one.
    noise
        Standard deviation of one reading, where it is known [µm; µrad].
    """

    times_s: FloatArray
    values: FloatArray
    noise: float | None

    def at(self, time_s: float) -> float:
        """Interpolate in time; before the first and after the last reading these count."""
        return float(np.interp(time_s, self.times_s, self.values))

    def variance_at(self, time_s: float) -> float | None:
        """Give the variance of the value at a time, of its own readings and of the zero."""
        if self.noise is None:
            return None
        share = np.zeros(self.times_s.size)
        after = int(np.clip(np.searchsorted(self.times_s, time_s), 1, self.times_s.size - 1))
        start, end = self.times_s[after - 1], self.times_s[after]
        weight = float(np.clip((time_s - start) / (end - start), 0.0, 1.0))
        share[after - 1], share[after] = 1.0 - weight, weight
        share[0] -= 1.0
        return self.noise**2 * float(share @ share)

    def range_within(self, since_s: float, until_s: float) -> float:
        """Give the largest value less the smallest between two times, both included."""
        inside = self.values[(self.times_s > since_s) & (self.times_s < until_s)]
        return float(np.ptp([self.at(since_s), *inside, self.at(until_s)]))


@dataclass(frozen=True, slots=True, eq=False)
class DriftState:
    """What the test says of one thermal state: tables of changes since its first reading."""

    time_s: float
    tables: tuple[ComponentTable, ...]


@dataclass(frozen=True, slots=True, eq=False)
class ThermalDrift:
    """A drift test's evaluation.

    Parameters
    ----------
    targets_mm : ndarray, shape (m,) [mm]
        Positions of the moving axis at which the nest was read; empty where nothing moved.
    courses
        Of each displacement (`x`, `y`, `z`) and tilt (`a`, `b`), one for each target or one.
    running_s
        From when to when the spindle turned or the axis moved [s]; None of the environment.
    components
        Displacement or tilt to the code of the component as which it counts.
    stated_components
        Those of them that were said to count so.
    states
        The thermal states that were asked for, in order of time.
    result
        The tables of the last state, the figures and the notes.
    """

    test: DriftTest
    targets_mm: FloatArray
    courses: Mapping[str, tuple[Course, ...]]
    running_s: tuple[float, float] | None
    components: Mapping[str, str]
    stated_components: frozenset[str]
    states: tuple[DriftState, ...]
    result: MeasurementResult


@dataclass(frozen=True, slots=True, eq=False)
class _Nest:
    """Checked readings: times, displacements and tilts, and the target of each row."""

    times_s: FloatArray
    read: Mapping[str, FloatArray]
    targets_mm: FloatArray
    target_of: IntArray


def evaluate_thermal_drift(
    chain: Chain,
    test: DriftTest | str,
    times_s: ArrayLike,
    displacements_um: Mapping[str, ArrayLike],
    *,
    axis: str | None = None,
    positions_mm: ArrayLike | None = None,
    sensor_distance_mm: float | None = None,
    running_s: tuple[float, float] | None = None,
    point_mm: ArrayLike | None = None,
    tool_offset_mm: ArrayLike = (0.0, 0.0, 0.0),
    components: Mapping[str, str] | None = None,
    states_s: Sequence[float] | None = None,
    repeatability_um: float | None = None,
) -> ThermalDrift:
    """Evaluate what a nest of displacement sensors read over time.

    Parameters
    ----------
    test
        `environment`, `spindle` or `linear-axis`.
    times_s : array-like, shape (n,) [s]
        Strictly increasing, on any clock.
    displacements_um
        By sensor (`x`, `y`, `z`, `x2`, `y2`), shape (n,) each [µm]: positive where the tool has
        moved in the positive direction of the axis against the workpiece. Their zero does not
        matter.
    axis, positions_mm
        The moving axis and where it stood, shape (n,) [mm]; of the test `linear-axis`.
    sensor_distance_mm
        How far along Z the sensors x2 and y2 read from x and y, with its sign [mm].
    running_s
        From when to when the spindle turned, or the axis moved [s]; the whole record where left
        out.
    point_mm, tool_offset_mm : array-like, shape (3,) [mm]
        Where the machine stood while the nest was read, and the offset as a tool of the place
        that x, y and z read.
    components
        Displacement (`x`, `y`, `z`) or tilt (`a`, `b`) to the component as which it counts;
        without it those of the moving axis, or of the axis that carries the spindle.
    states_s
        Times of the thermal states to make tables of [s]; the first reading and the end of
        running where left out.
    repeatability_um
        Standard deviation of one displacement reading; from the readings where left out.

    Returns
    -------
    ThermalDrift
        Without tables where `point_mm` is not stated and nothing moved.

    Raises
    ------
    InvalidContent
        If readings are missing, not finite, too large or not in order of time, if a state lies
        outside the test, or what is stated contradicts itself.

    Notes
    -----
    B = (x2 − x)/h and A = −(y2 − y)/h with h = `sensor_distance_mm`, by the right-hand rule.

    Examples
    --------
    >>> hour = [0.0, 1800.0, 3600.0]
    >>> found = evaluate_thermal_drift(
    ...     Chain.parse("XYFZ"), "spindle", hour, {"z": [5.0, 11.0, 14.0]}, point_mm=[250, 200, 300]
    ... )
    >>> found.result.figures["d_Z_60min_um"], found.states[-1].tables[0].component.code
    (9.0, 'EZZ')
    """
    test = _test_of(test)
    nest = _take(test, times_s, displacements_um, axis, positions_mm, sensor_distance_mm)
    spread = as_standard_deviation("repeatability_um", repeatability_um, "µm", zero=False)
    courses = {
        name: tuple(_courses(nest, values, _spread_of(name, spread, sensor_distance_mm)))
        for name, values in nest.read.items()
    }
    running = _running(test, nest.times_s, running_s)
    point = None if point_mm is None else as_point("point_mm", point_mm)
    counted_as = _components(chain, axis, courses, components or {})
    lines: MeasuringLines = {}
    if point is not None:
        axes = {str(COMPONENTS[code].axis) for code in counted_as.values()}
        lines = {one: stated_line(one, point, tool_offset_mm, "point_mm") for one in sorted(axes)}
    moments = _moments(nest.times_s, running, states_s)
    states = tuple(
        DriftState(time_s, tuple(_tables(time_s, nest.targets_mm, courses, counted_as, point)))
        for time_s in moments
    )
    return ThermalDrift(
        test,
        nest.targets_mm,
        courses,
        running,
        counted_as,
        frozenset(components or ()),
        states,
        MeasurementResult(
            tables=states[-1].tables,
            figures=_figures(test, nest.targets_mm, courses, running),
            notes=tuple(_notes(chain, test, nest, courses, running, counted_as, point)),
            measuring_lines=lines,
        ),
    )


def _test_of(stated: DriftTest | str) -> DriftTest:
    try:
        return DriftTest(stated)
    except ValueError:
        raise InvalidContent.of_field(
            "test", f"expected one of {list_names(DriftTest)}, got {stated!r}"
        ) from None


def _take(
    test: DriftTest,
    times_s: ArrayLike,
    displacements_um: Mapping[str, ArrayLike],
    axis: str | None,
    positions_mm: ArrayLike | None,
    distance_mm: float | None,
) -> _Nest:
    """Check the readings, and turn what two sensors of one direction read to tilts."""
    times = as_numbers("times_s", times_s, "s")
    if times.ndim != 1 or times.size < 2:
        raise InvalidContent.of_field(
            "readings", f"expected at least two readings over time, got {times.size}"
        )
    early = np.flatnonzero(np.diff(times) <= 0)
    if early.size:
        i = int(early[0])
        raise InvalidContent.of_field(
            f"readings.{i + 1}.time",
            "expected each reading later than the one before it, got one "
            f"{times[i] - times[i + 1]:g} s before it",
        )
    unknown = [name for name in displacements_um if name not in SENSORS]
    if unknown or not displacements_um:
        raise InvalidContent.of_field(
            "readings",
            f"expected displacements among {list_names(f'{name}_um' for name in SENSORS)}, got "
            f"{list_names(unknown) if unknown else 'none'}",
        )
    read: dict[str, FloatArray] = {}
    for name in (name for name in SENSORS if name in displacements_um):
        field = f"{name}_um"
        read[name] = as_numbers(
            field, displacements_um[name], "µm", LARGEST_ERROR_UM, "perhaps in nm"
        )
        if read[name].shape != times.shape:
            raise InvalidContent.of_field(
                field,
                f"expected {counted(times.size, 'reading')} in µm, one at each time, got an array "
                f"of shape {read[name].shape}",
            )
    targets, target_of = _targets(test, axis, positions_mm, times.size)
    return _Nest(times, dict(_displacements_and_tilts(read, distance_mm)), targets, target_of)


def _displacements_and_tilts(
    read: Mapping[str, FloatArray], distance_mm: float | None
) -> Iterator[tuple[str, FloatArray]]:
    for name in LINEAR_LETTERS:
        if name in read:
            yield name, read[name]
    for tilt, first, second, sign in (("a", "y", "y2", -1.0), ("b", "x", "x2", 1.0)):
        if second not in read:
            continue
        if first not in read:
            raise InvalidContent.of_field(
                f"{second}_um", f"expected {first}_um beside {second}_um, got none"
            )
        if distance_mm is None or not 1.0 <= abs(distance_mm) <= FARTHEST_MM:
            raise InvalidContent.of_field(
                "sensor_distance_mm",
                f"expected how far along Z {second} reads from {first}, 1 mm or more with its "
                f"sign, got {'none' if distance_mm is None else f'{distance_mm:g} mm'}",
            )
        yield tilt, sign * (read[second] - read[first]) / distance_mm * _URAD_PER_UM_PER_MM


def _targets(
    test: DriftTest, axis: str | None, positions_mm: ArrayLike | None, count: int
) -> tuple[FloatArray, IntArray]:
    """Sort rows by where the moving axis stood."""
    if test is not DriftTest.LINEAR_AXIS:
        if axis is not None or positions_mm is not None:
            field = "axis" if axis is not None else "position_mm"
            raise InvalidContent.of_field(
                field, f"expected {field} of the test linear-axis alone, got it of {test}"
            )
        return np.zeros(0), np.zeros(count, dtype=np.intp)
    expect_linear_axis(axis or "")
    if positions_mm is None:
        raise InvalidContent.of_field(
            "position_mm", f"expected where axis {axis} stood at each reading in mm, got none"
        )
    places = as_numbers("position_mm", positions_mm, "mm", FARTHEST_MM, "perhaps in µm")
    if places.shape != (count,):
        raise InvalidContent.of_field(
            "position_mm", f"expected {counted(count, 'position')} in mm, got {places.size}"
        )
    targets, target_of, visits = np.unique(places, return_inverse=True, return_counts=True)
    if targets.size > MOST_TARGETS or visits.min() < 2:
        once = targets[visits < 2]
        got = f"{once[0]:g} mm once" if once.size else counted(targets.size, "position")
        raise InvalidContent.of_field(
            "position_mm",
            f"expected 1 to {MOST_TARGETS} positions, each visited again and again, got {got}; "
            "the positions are nominal ones",
        )
    return targets, target_of.astype(np.intp)


def _courses(nest: _Nest, values: FloatArray, spread: float | None) -> Iterator[Course]:
    """Part a sensor's readings by target, each from its own first reading."""
    for target in range(max(nest.targets_mm.size, 1)):
        rows = nest.target_of == target
        times, course = nest.times_s[rows], values[rows] - values[rows][0]
        noise = spread if spread is not None else noise_between_neighbours(times, course)
        yield Course(times, course, noise)


def _spread_of(name: str, spread_um: float | None, distance_mm: float | None) -> float | None:
    """Turn the repeatability of a displacement to that of a tilt, two of them over a distance."""
    if spread_um is None or UNITS[name] == "um" or distance_mm is None:
        return spread_um
    return math.sqrt(2.0) * spread_um / abs(distance_mm) * _URAD_PER_UM_PER_MM


def noise_between_neighbours(times_s: FloatArray, values: FloatArray) -> float | None:
    """Estimate a reading's standard deviation from how it departs from the line of its neighbours.

    The median of |departure| over what noise of 1 gives it: a drift that bends between three
    readings adds to it, single outliers do not.

    Parameters
    ----------
    times_s, values : ndarray, shape (n,)
        A course.

    Returns
    -------
    float or None
        None where there are too few readings, or they do not show their noise.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> noise = noise_between_neighbours(np.arange(1e4), rng.normal(0.0, 2.0, 10_000))
    >>> abs(noise - 2.0) < 0.05
    True
    """
    if values.size < _FEWEST_FOR_NOISE:
        return None
    weight = (times_s[1:-1] - times_s[:-2]) / (times_s[2:] - times_s[:-2])
    departure = values[1:-1] - (1.0 - weight) * values[:-2] - weight * values[2:]
    unit = np.sqrt(1.0 + (1.0 - weight) ** 2 + weight**2)
    noise = float(np.median(np.abs(departure / unit))) / _NORMAL_QUARTILE
    return noise or None


def _running(
    test: DriftTest, times_s: FloatArray, stated_s: tuple[float, float] | None
) -> tuple[float, float] | None:
    first, last = float(times_s[0]), float(times_s[-1])
    if test is DriftTest.ENVIRONMENT:
        if stated_s is not None:
            raise InvalidContent.of_field(
                "running_from", "expected no running of the test environment, got a time"
            )
        return None
    since, until = stated_s or (first, last)
    if not first <= since < until <= last:
        raise InvalidContent.of_field(
            "running_from",
            "expected running to begin and end within the readings, got "
            f"{(since - first) / SECONDS_PER_MIN:g} to {(until - first) / SECONDS_PER_MIN:g} min "
            f"after the first of {(last - first) / SECONDS_PER_MIN:g} min",
        )
    return since, until


def carrier_of_the_spindle(chain: Chain) -> str:
    """Name the axis as whose errors the spindle's own displacement and tilt count.

    The last axis on the tool's side: its rotation acts on the tool offset alone, as a tilt of the
    spindle does. Where the tool does not move, the last axis of all, whose displacement is the
    same everywhere too, but not its rotation.

    >>> carrier_of_the_spindle(Chain.parse("XYFZ")), carrier_of_the_spindle(Chain.parse("XYZF"))
    ('z', 'z')
    """
    return (chain.tool or chain.workpiece)[-1]


def _components(
    chain: Chain,
    axis: str | None,
    courses: Mapping[str, object],
    stated: Mapping[str, str],
) -> dict[str, str]:
    """Say as which component each displacement and tilt counts."""
    of_axis = axis or carrier_of_the_spindle(chain)
    has_tilts = axis is not None or bool(chain.tool)
    found = {
        name: f"E{name}{of_axis}".upper() for name in courses if has_tilts or name in LINEAR_LETTERS
    }
    for name, written in stated.items():
        component, sign = parse_component(written)
        code = component.code
        if (
            name not in courses
            or sign < 0
            or not code.startswith(f"E{name}".upper())
            or "^" in code
        ):
            raise InvalidContent.of_field(
                f"components.{name}",
                f"expected an error in the direction of what was read ({list_names(courses)}), "
                f"such as x=EXX, got {name}={written}",
            )
        if axis is not None and component.axis != axis:
            raise InvalidContent.of_field(
                f"components.{name}",
                f"expected an error of the moving axis {axis}, got {written}",
            )
        found[name] = code
    return found


def _moments(
    times_s: FloatArray, running_s: tuple[float, float] | None, stated_s: Sequence[float] | None
) -> list[float]:
    first, last = float(times_s[0]), float(times_s[-1])
    if stated_s is None:
        return [first, running_s[1] if running_s else last]
    outside = [one for one in stated_s if not first <= one <= last]
    if outside or not stated_s or len(set(stated_s)) < len(stated_s):
        got = f"{(outside[0] - first) / SECONDS_PER_MIN:g} min" if outside else "none, or one twice"
        raise InvalidContent.of_field(
            "states_min",
            f"expected states from 0 to {(last - first) / SECONDS_PER_MIN:g} min after the first "
            f"reading, each once, got {got}",
        )
    return sorted(stated_s)


def _tables(
    time_s: float,
    targets_mm: FloatArray,
    courses: Mapping[str, tuple[Course, ...]],
    components: Mapping[str, str],
    point_mm: FloatArray | None,
) -> Iterator[ComponentTable]:
    """Make one state's tables: of one position, or of the moving axis' targets."""
    for name, code in components.items():
        component = COMPONENTS[code]
        if targets_mm.size:
            positions = targets_mm
        elif point_mm is not None:
            positions = point_mm[[LINEAR_LETTERS.index(str(component.axis))]]
        else:
            return
        values = [course.at(time_s) for course in courses[name]]
        variances = [v for c in courses[name] if (v := c.variance_at(time_s)) is not None]
        known = len(variances) == len(values)
        yield ComponentTable(
            component,
            frozen(positions),
            frozen(values),
            covariance=frozen(variances) if known else None,
        )


def _figures(
    test: DriftTest,
    targets_mm: FloatArray,
    courses: Mapping[str, tuple[Course, ...]],
    running_s: tuple[float, float] | None,
) -> dict[str, float]:
    figures: dict[str, float] = {}
    for name, of_targets in courses.items():
        for number, course in enumerate(of_targets, start=1):
            place = f"_P{number}" if targets_mm.size else ""
            figures |= _figures_of(name.upper() + place, UNITS[name], course, running_s)
        if test is DriftTest.LINEAR_AXIS and targets_mm.size > 1 and running_s is not None:
            ends = [course.at(running_s[1]) for course in (of_targets[0], of_targets[-1])]
            slope = (ends[1] - ends[0]) / float(np.ptp(targets_mm)) * UM_PER_MM
            figures[f"{name.upper()}_slope_change_{UNITS[name]}_per_m"] = slope
    return figures


def _figures_of(
    name: str, unit: str, course: Course, running_s: tuple[float, float] | None
) -> dict[str, float]:
    """Give a course's figures: its range in the periods that are reported, and where it ends."""
    found: dict[str, float] = {}
    last = float(course.times_s[-1])
    if running_s is None:
        found[f"ETVE_{name}_{unit}"] = course.range_within(float(course.times_s[0]), last)
    else:
        since, until = running_s
        zero, hour = course.at(since), since + FIRST_MIN * SECONDS_PER_MIN
        if hour <= until:
            found[f"d_{name}_60min_{unit}"] = course.range_within(since, hour)
            found[f"{name}_at_60min_{unit}"] = course.at(hour) - zero
        found[f"d_{name}_running_{unit}"] = course.range_within(since, until)
        found[f"{name}_at_stop_{unit}"] = course.at(until) - zero
        if until < last:
            found[f"{name}_at_end_{unit}"] = course.at(last) - zero
    if course.noise is not None:
        found[f"noise_{name}_{unit}"] = course.noise
    return found


def _notes(
    chain: Chain,
    test: DriftTest,
    nest: _Nest,
    courses: Mapping[str, tuple[Course, ...]],
    running_s: tuple[float, float] | None,
    components: Mapping[str, str],
    point_mm: FloatArray | None,
) -> Iterator[str]:
    """Say what the test cannot see, what was left out and what looks wrong."""
    if nest.targets_mm.size:
        places = ", ".join(f"P{i} = {p:g} mm" for i, p in enumerate(nest.targets_mm, start=1))
        yield f"Positions of the moving axis: {places}; each counts from its own first reading."
    if running_s and running_s[1] - running_s[0] < FIRST_MIN * SECONDS_PER_MIN:
        minutes = (running_s[1] - running_s[0]) / SECONDS_PER_MIN
        yield f"Running lasted {minutes:g} min: there are no figures of the first 60 min."
    yield (
        "All tables and the verification are changes since the first reading: what the machine's "
        "errors were then, the test cannot see."
    )
    if test is not DriftTest.LINEAR_AXIS:
        yield (
            "The nest stood at one place: the tables count what it read as the same in the whole "
            "volume. That holds for growth and tilt of the spindle; what table, bed and column did "
            "is a guess anywhere else."
        )
        if point_mm is None:
            yield "Without point_mm, where the nest stood, there are no tables and no verification."
    left_out = [name.upper() for name in courses if name not in components]
    if left_out:
        yield (
            f"Tilts {list_names(left_out)} are in the figures alone: in {chain.text} no axis "
            "carries the spindle, and no component turns the tool without turning the volume."
        )
    if any(course.noise is None for of in courses.values() for course in of):
        yield (
            "Some readings do not show their noise: standard errors are unknown without "
            "repeatability_um."
        )
    else:
        yield (
            "Ranges contain the noise of single readings; standard errors contain that noise and "
            "not what the nest's own fixture and sensors drifted."
        )
    for name in LINEAR_LETTERS:
        if name in nest.read:
            yield from suspiciously_small(f"{name}_um", nest.read[name])
