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

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from app.arrays import FloatArray, frozen
from app.errors import InvalidContent, list_names
from app.geometry.chain import Chain
from app.geometry.components import COMPONENTS, LINEAR_LETTERS, parse_component
from app.geometry.measuring_line import MeasuringLines
from app.measurement.result import Evaluated, MeasurementResult
from app.measurement.stated_numbers import (
    as_point,
    as_standard_deviation,
    suspiciously_small,
)
from app.measurement.stated_runs import stated_line
from app.measurement.thermal_drift_readings import (
    UNITS,
    Course,
    DriftTest,
    NestReadings,
    courses_of,
    read_nest,
    spread_of,
)
from app.thermal.error_map import ComponentTable
from app.units import SECONDS_PER_MIN, UM_PER_MM

FIRST_MIN: Final = 60.0
"""A spindle test has figures of this long after its start [min], and of the whole running."""


@dataclass(frozen=True, slots=True, eq=False)
class DriftState:
    """What the test says of one thermal state: tables of changes since its first reading."""

    time_s: float
    tables: tuple[ComponentTable, ...]


@dataclass(frozen=True, eq=False, kw_only=True)
class ThermalDrift(Evaluated):
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
    """

    test: DriftTest
    targets_mm: FloatArray
    courses: Mapping[str, tuple[Course, ...]]
    running_s: tuple[float, float] | None
    components: Mapping[str, str]
    stated_components: frozenset[str]
    states: tuple[DriftState, ...]


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
    nest = read_nest(test, times_s, displacements_um, axis, positions_mm, sensor_distance_mm)
    spread = as_standard_deviation("repeatability_um", repeatability_um, "µm", zero=False)
    courses = {
        name: tuple(courses_of(nest, values, spread_of(name, spread, sensor_distance_mm)))
        for name, values in nest.read.items()
    }
    running = _running(test, nest.times_s, running_s)
    point = None if point_mm is None else as_point("point_mm", point_mm)
    counted_as = _components(chain, axis, courses, components or {})
    lines: MeasuringLines = {}
    if point is not None:
        axes = {str(COMPONENTS[code].axis) for code in counted_as.values()}
        lines = {
            letter: stated_line(letter, point, tool_offset_mm, "point_mm")
            for letter in sorted(axes)
        }
    moments = _moments(nest.times_s, running, states_s)
    states = tuple(
        DriftState(time_s, tuple(_tables(time_s, nest.targets_mm, courses, counted_as, point)))
        for time_s in moments
    )
    return ThermalDrift(
        test=test,
        targets_mm=nest.targets_mm,
        courses=courses,
        running_s=running,
        components=counted_as,
        stated_components=frozenset(components or ()),
        states=states,
        result=MeasurementResult(
            tables=states[-1].tables,
            figures=_figures(test, nest.targets_mm, courses, running),
            notes=tuple(_notes(chain, test, nest, courses, running, counted_as, point)),
            measuring_lines=lines,
        ),
    )


def _test_of(name: DriftTest | str) -> DriftTest:
    try:
        return DriftTest(name)
    except ValueError:
        raise InvalidContent.of_field(
            "test", f"expected one of {list_names(DriftTest)}, got {name!r}"
        ) from None


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
    assigned: Mapping[str, str],
) -> dict[str, str]:
    """Say as which component each displacement and tilt counts."""
    of_axis = axis or carrier_of_the_spindle(chain)
    has_tilts = axis is not None or bool(chain.tool)
    codes = {
        name: f"E{name}{of_axis}".upper() for name in courses if has_tilts or name in LINEAR_LETTERS
    }
    for name, written in assigned.items():
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
        codes[name] = code
    return codes


def _moments(
    times_s: FloatArray, running_s: tuple[float, float] | None, stated_s: Sequence[float] | None
) -> list[float]:
    first, last = float(times_s[0]), float(times_s[-1])
    if stated_s is None:
        return [first, running_s[1] if running_s else last]
    outside = [moment for moment in stated_s if not first <= moment <= last]
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
        # A covariance of some positions alone would let the others pass for exact.
        complete = len(variances) == len(values)
        yield ComponentTable(
            component,
            frozen(positions),
            frozen(values),
            covariance=frozen(variances) if complete else None,
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
            since, until = running_s
            first, last = (c.at(until) - c.at(since) for c in (of_targets[0], of_targets[-1]))
            slope = (last - first) / float(np.ptp(targets_mm)) * UM_PER_MM
            figures[f"{name.upper()}_slope_change_{UNITS[name]}_per_m"] = slope
    return figures


def _figures_of(
    name: str, unit: str, course: Course, running_s: tuple[float, float] | None
) -> dict[str, float]:
    """Give a course's figures: its range in the periods that are reported, and where it ends."""
    figures: dict[str, float] = {}
    last = float(course.times_s[-1])
    if running_s is None:
        figures[f"ETVE_{name}_{unit}"] = course.range_within(float(course.times_s[0]), last)
    else:
        since, until = running_s
        zero, hour = course.at(since), since + FIRST_MIN * SECONDS_PER_MIN
        if hour <= until:
            figures[f"d_{name}_60min_{unit}"] = course.range_within(since, hour)
            figures[f"{name}_at_60min_{unit}"] = course.at(hour) - zero
        figures[f"d_{name}_running_{unit}"] = course.range_within(since, until)
        figures[f"{name}_at_stop_{unit}"] = course.at(until) - zero
        if until < last:
            figures[f"{name}_at_end_{unit}"] = course.at(last) - zero
    if course.noise is not None:
        figures[f"noise_{name}_{unit}"] = course.noise
    return figures


def _notes(
    chain: Chain,
    test: DriftTest,
    nest: NestReadings,
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
