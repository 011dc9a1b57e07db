"""The volumetric error at a million points, against memory, transformations and scipy.

18 motion errors of 41 positions each and 3 squareness errors at random points of a
machine XYFZ, in one run and as ratios:

- against the time numpy needs to read and write the same bytes: a copy of the array of
  points and of the two arrays of the answer (and, stricter, only reading the points and
  only writing the answer);
- against a product of homogeneous transformation matrices point by point in numpy, from
  the same tables with np.interp, and from errors that are already known at each point;
- the look-ups in the tables alone, against scipy's interpolators, one for each component
  (RegularGridInterpolator, make_interp_spline with k=1) and np.interp;
- the largest memory beside the points, against the answer's.

Every competitor's numbers are checked against ours before the clock starts.

    python -m benchmarks.volumetric_error
"""

from __future__ import annotations

import statistics
import time
import tracemalloc
from collections.abc import Callable, Mapping

import numpy as np
from scipy.interpolate import RegularGridInterpolator, make_interp_spline

from app.geometry.chain import Chain
from app.geometry.components import COMPONENTS, Kind
from app.geometry.error_field import POINTS_AT_ONCE, ErrorField
from app.geometry.error_table import Table

POINTS = 1_000_000
POINTS_ONE_BY_ONE = 2000
POSITIONS = 41
TRAVEL_MM = 500.0
TOOL_MM = (0.0, 0.0, 160.0)
ROUNDS = 9
CHAIN = "XYFZ"


def main() -> None:
    rng = np.random.default_rng(868)
    points = rng.uniform(0.0, TRAVEL_MM, (POINTS, 3))
    for name, positions in (
        ("evenly spaced", np.linspace(0.0, TRAVEL_MM, POSITIONS)),
        ("unevenly spaced (ISO 230-2)", uneven_positions(rng)),
    ):
        field = make_field(rng, positions)
        print(f"{len(field.tables)} errors, {POSITIONS} positions, {name}, {POINTS:,} points")
        check_transformations(field, points[:50])
        compare_with_memory(field, points)
        compare_with_transformations(field, points)
        compare_look_ups(field, points)
        print_memory(field, points)
        print()


def make_field(rng: np.random.Generator, positions: np.ndarray) -> ErrorField:
    """Make tables of the size of thermal errors."""
    tables = {}
    for code, component in COMPONENTS.items():
        if component.kind is Kind.SQUARENESS:
            tables[code] = Table((), rng.normal(scale=20.0))
        elif component.kind not in (Kind.SLOPE, Kind.ROTARY_LOCATION):
            tables[code] = Table(positions, rng.normal(scale=10.0, size=POSITIONS))
    return ErrorField.make(Chain.parse(CHAIN), tables)


def uneven_positions(rng: np.random.Generator) -> np.ndarray:
    """Targets with a random part, as ISO 230-2 wants them."""
    step = TRAVEL_MM / (POSITIONS - 1)
    inner = np.arange(1, POSITIONS - 1) * step + rng.uniform(-0.3, 0.3, POSITIONS - 2) * step
    return np.concatenate([[0.0], inner, [TRAVEL_MM]])


def compare_with_memory(field: ErrorField, points: np.ndarray) -> None:
    errors, orientation = field.at(points, TOOL_MM)

    def copy_all() -> None:
        points.copy(), errors.copy(), orientation.copy()

    def read_and_write() -> None:
        np.copyto(errors, points)
        np.copyto(orientation, points)

    rounds = timed_together(
        {"field": lambda: field.at(points, TOOL_MM), "copy": copy_all, "strict": read_and_write}
    )
    show("the field", rounds["field"])
    show("numpy copies points and answer", rounds["copy"])
    show("numpy reads points, writes answer", rounds["strict"])
    print(f"  {ratio(rounds, 'field', 'copy'):8.1f} times a copy of the same bytes")
    print(f"  {ratio(rounds, 'field', 'strict'):8.1f} times reading the points, writing the answer")


def compare_with_transformations(field: ErrorField, points: np.ndarray) -> None:
    few = points[:POINTS_ONE_BY_ONE]
    known = [values_at(field, point) for point in few]

    def from_tables() -> None:
        for point in few:
            by_transformations(values_at(field, point), point)

    def from_known_errors() -> None:
        for values, point in zip(known, few, strict=True):
            by_transformations(values, point)

    ours = seconds(lambda: field.at(points, TOOL_MM), 5) / POINTS
    for name, call in (("from tables", from_tables), ("from known errors", from_known_errors)):
        theirs = seconds(call, 3) / POINTS_ONE_BY_ONE
        print(
            f"  {theirs * 1e6:8.2f} µs a point by 4×4 matrices {name}, "
            f"{theirs / ours:.0f} times the field's {ours * 1e6:.3f} µs"
        )


def by_transformations(values: Mapping[str, float], point: np.ndarray) -> np.ndarray:
    """W_y W_x H_z T for XYFZ, each a product of exact turns and a shift [mm]."""
    product = np.eye(4)
    for u in ("y", "x"):
        product = product @ turn(values, u) @ shift(values, point, u)
    for u in ("z",):
        product = product @ shift(values, point, u) @ turn(values, u)
    return product @ np.array([*TOOL_MM, 1.0])


def turn(values: Mapping[str, float], u: str) -> np.ndarray:
    a, b, c = (values[f"E{about}{u.upper()}"] * 1e-6 for about in "ABC")
    ca, sa, cb, sb, cc, sc = np.cos(a), np.sin(a), np.cos(b), np.sin(b), np.cos(c), np.sin(c)
    return np.array(
        [
            [cc * cb, cc * sb * sa - sc * ca, cc * sb * ca + sc * sa, 0.0],
            [sc * cb, sc * sb * sa + cc * ca, sc * sb * ca - cc * sa, 0.0],
            [-sb, cb * sa, cb * ca, 0.0],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


def shift(values: Mapping[str, float], point: np.ndarray, u: str) -> np.ndarray:
    found = np.eye(4)
    for i, way in enumerate("XYZ"):
        found[i, 3] = values[f"E{way}{u.upper()}"] * 1e-3
    found["xyz".index(u), 3] += point["xyz".index(u)]
    return found


def values_at(field: ErrorField, point: np.ndarray) -> dict[str, float]:
    """Look every component up at one point, squareness folded into straightness."""
    found = {
        code: float(np.interp(point["xyz".index(COMPONENTS[code].axis)], positions, values[0]))
        for code, (positions, values) in field.tables.items()
        if COMPONENTS[code].axis
    }
    for code, into in (("SXY", "EXY"), ("SZX", "EXZ"), ("SYZ", "EYZ")):
        along = point["xyz".index(into[2].lower())]
        found[into] += float(field.tables[code][1][0, 0]) * along * 1e-3
    return found


def check_transformations(field: ErrorField, points: np.ndarray) -> None:
    """Make sure that both say the same, but for terms of second order."""
    errors, _ = field.at(points, TOOL_MM)
    for point, found in zip(points, errors, strict=True):
        exact = by_transformations(values_at(field, point), point)[:3]
        np.testing.assert_allclose(found, (exact - point - TOOL_MM) * 1e3, atol=0.01)


def compare_look_ups(field: ErrorField, points: np.ndarray) -> None:
    tables = {c: (p, v[0]) for c, (p, v) in field.tables.items() if COMPONENTS[c].axis}
    along = {u: np.ascontiguousarray(points[:, i]) for i, u in enumerate("xyz")}
    grids = {c: RegularGridInterpolator((p,), v) for c, (p, v) in tables.items()}
    splines = {c: make_interp_spline(p, v, k=1) for c, (p, v) in tables.items()}

    def ours() -> dict[str, np.ndarray]:
        found = {code: np.empty(POINTS) for code in tables}
        for start in range(0, POINTS, POINTS_AT_ONCE):
            piece = slice(start, start + POINTS_AT_ONCE)
            for u, packed in field._axes.items():
                rows = packed.read(0, packed.locate(along[u][piece]))[None]
                for i, way in enumerate("XYZABC"):
                    found[f"E{way}{u.upper()}"][piece] = rows[i]
        return found

    def by_scipy(interpolators: Mapping[str, Callable]) -> dict[str, np.ndarray]:
        return {c: interpolators[c](along[COMPONENTS[c].axis]) for c in tables}

    def by_grid() -> dict[str, np.ndarray]:
        return {c: grids[c](along[COMPONENTS[c].axis][:, None]) for c in tables}

    def by_interp() -> dict[str, np.ndarray]:
        return {c: np.interp(along[COMPONENTS[c].axis], *table) for c, table in tables.items()}

    others = {
        "RegularGridInterpolator": by_grid,
        "make_interp_spline(k=1)": lambda: by_scipy(splines),
        "np.interp": by_interp,
    }
    reference = ours()
    for call in others.values():
        for code, values in call().items():
            np.testing.assert_allclose(reference[code], values, atol=1e-9)
    packed_s = seconds(ours, 3)
    print(f"  {packed_s * 1e3:8.1f} ms for the 18 look-ups alone, packed by axis")
    for name, call in others.items():
        theirs = seconds(call, 2)
        print(f"  {theirs * 1e3:8.1f} ms by {name}, {theirs / packed_s:.1f} times as long")


def print_memory(field: ErrorField, points: np.ndarray) -> None:
    tracemalloc.start()
    errors, orientation = field.at(points, TOOL_MM)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    print(f"  {peak / (errors.nbytes + orientation.nbytes):8.2f} times the answer's memory at most")


def seconds(call: Callable[[], object], rounds: int) -> float:
    """Time a call: the fastest of some."""
    best = np.inf
    for _ in range(rounds):
        started = time.perf_counter()
        call()
        best = min(best, time.perf_counter() - started)
    return best


def timed_together(calls: Mapping[str, Callable[[], object]]) -> dict[str, list[float]]:
    """Time calls in turn, so that what slows one slows the other too."""
    figures: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(ROUNDS):
        for name, call in calls.items():
            figures[name].append(seconds(call, 2))
    return figures


def ratio(rounds: Mapping[str, list[float]], name: str, other: str) -> float:
    """The median of the rounds' ratios."""
    return statistics.median(a / b for a, b in zip(rounds[name], rounds[other], strict=True))


def show(name: str, times: list[float]) -> None:
    print(f"  {statistics.median(times) * 1e3:8.1f} ms {name} (fastest {min(times) * 1e3:.1f})")


if __name__ == "__main__":
    main()
