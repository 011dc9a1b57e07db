"""What an ordinary look at the lathe gives: least squares on all sensors and the speed.

No maps, no choice, no test: each run's displacement is regressed on what every sensor has
risen by since the run's start, on the spindle's speed and on the speed 60 min late. The
failed sensor is left out, as a person who has seen it would do.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from app.arrays import FloatArray
from app.effects.low_pass import Hold, low_pass
from app.effects.observations import ObservationRows
from examples.measured.lathe_runs import FAILED, SENSORS, Run

LATE_S = 3600.0


def ordinary_look(
    runs: Sequence[Run],
    learn: ObservationRows,
    wanted: ObservationRows,
    measured: tuple[FloatArray, FloatArray],
) -> FloatArray:
    """Learn on some runs' rows, give what is left of others.

    Parameters
    ----------
    runs
        All runs.
    learn, wanted
        Rows to learn from, and rows to predict.
    measured : ndarrays, one for the rows of each [µm]
        Their displacement since the start of each run.

    Returns
    -------
    ndarray, shape (n,) [µm]
        Measured minus predicted of the wanted rows.
    """
    columns = {run.date: _columns(run) for run in runs}
    times = {run.date: run.times_s for run in runs}
    known, asked = (_rows_of(rows, columns, times) for rows in (learn, wanted))
    left = measured[1].copy()
    for name in wanted.channels:
        from_rows, to_rows = learn.of_channel(name), wanted.of_channel(name)
        weights = np.linalg.lstsq(known[from_rows], measured[0][from_rows], rcond=None)[0]
        left[to_rows] -= asked[to_rows] @ weights
    return left


def _columns(run: Run) -> FloatArray:
    """What may move a run: shape (n, 25), each zero at its start or at rest."""
    sound: Collection[str] = [name for name in SENSORS if name != FAILED]
    rises = [run.temperatures_c[name] - run.temperatures_c[name][0] for name in sound]
    rest_s = run.times_s[0] - 10 * LATE_S
    late = low_pass(
        np.append(rest_s, run.times_s), np.append(0.0, run.spindle_rpm), LATE_S, Hold.PREVIOUS
    ).outputs[1:]
    return np.column_stack([*rises, run.spindle_rpm / 1000.0, late / 1000.0])


def _rows_of(
    rows: ObservationRows, columns: dict[str, FloatArray], times: dict[str, FloatArray]
) -> FloatArray:
    labels = [rows.verifications[i].label for i in rows.verification]
    return np.array(
        [
            columns[date][np.searchsorted(times[date], t)]
            for date, t in zip(labels, rows.times_s, strict=True)
        ]
    )
