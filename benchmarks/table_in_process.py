"""The table computed in process, against scipy's and xarray's interpolators.

12 components × 21 positions in three maps. `thermap` brackets each sensor's
temperature and takes one line between two rows of a packed matrix; scipy's
RegularGridInterpolator and xarray's interp get one object for each component, made
before the clock starts, and are asked for the same numbers.

    python -m benchmarks.table_in_process
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

import numpy as np
import xarray as xr
from scipy.interpolate import RegularGridInterpolator

from app.simulation.example.machine import example_machine
from app.thermal.compile_model import compile_model
from benchmarks.example import STORED_RUNS, TEMPERATURES_C, measured_map

ROUNDS = 7
AT_LEAST_S = 0.2


def seconds_per_call(call: Callable[[], object]) -> float:
    """Time a call: enough repetitions, the fastest of three batches."""
    repetitions = 1
    while True:
        started = time.perf_counter()
        for _ in range(repetitions):
            call()
        elapsed = time.perf_counter() - started
        if elapsed >= AT_LEAST_S:
            return elapsed / repetitions
        repetitions *= 4


def main() -> None:
    machine = example_machine()
    maps = [measured_map(number) for number in STORED_RUNS]
    model = compile_model(machine, maps, {})
    tables = {
        member.component.code: (group.scales[0], member, group.nodes[:, member.forward])
        for group in model.groups
        for member in group.members
    }
    scipy_tables = {}
    xarray_tables = {}
    for code, (scale, member, nodes) in tables.items():
        positions = member.positions_mm if member.component.is_table else np.array([0.0])
        if positions.size == 1:
            nodes, positions = np.hstack([nodes, nodes]), np.array([0.0, 1.0])
        temperatures = np.array(scale.temperatures_c)
        grid = RegularGridInterpolator((temperatures, positions), nodes)
        scipy_tables[code] = (grid, scale.sensor, positions)
        array = xr.DataArray(nodes, coords={"t": temperatures, "p": positions}, dims=("t", "p"))
        xarray_tables[code] = (array, scale.sensor)

    def ours() -> object:
        return model.errors_at(TEMPERATURES_C)

    def by_scipy() -> object:
        return [
            grid(np.column_stack([np.full(p.size, TEMPERATURES_C[sensor]), p]))
            for grid, sensor, p in scipy_tables.values()
        ]

    def by_xarray() -> object:
        return [array.interp(t=TEMPERATURES_C[sensor]) for array, sensor in xarray_tables.values()]

    check(model.errors_at(TEMPERATURES_C), scipy_tables, by_scipy())
    calls = {"thermap": ours, "scipy": by_scipy, "xarray": by_xarray}
    figures = {name: [] for name in calls}
    for _ in range(ROUNDS):
        for name, call in calls.items():
            figures[name].append(seconds_per_call(call))
    for name, rows in figures.items():
        ratios = [a / b for a, b in zip(rows, figures["thermap"], strict=True)]
        print(
            f"{name:8s} {statistics.median(rows) * 1e6:10.1f} µs a table   "
            f"{statistics.median(ratios):8.1f} times thermap"
        )


def check(states, scipy_tables, values) -> None:
    """Make sure that the same numbers are compared."""
    expected = dict(zip(scipy_tables, values, strict=True))
    for state in states:
        for member in state.members:
            got = state.values[member.forward]
            want = expected[member.component.code][: got.size]
            np.testing.assert_allclose(got, want, rtol=0, atol=1e-9)


if __name__ == "__main__":
    main()
