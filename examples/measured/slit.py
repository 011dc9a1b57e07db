"""The slit: a table with a position every millimetre, and a sweep that shows what it misses.

A millimetre is four times the period: to such a table the cyclic error is a constant. The
sweep is cut into stretches of a millimetre, each a verification with a zero of its own; the
first six are learnt from, the last four predicted.
"""

from __future__ import annotations

import csv
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

import numpy as np

from app.arrays import FloatArray
from app.effects.observations import Observation, Verification
from app.geometry.components import COMPONENTS
from app.identification.campaign import Campaign
from app.search.rows import Datum
from app.thermal.error_map import ComponentTable
from app.thermal.machine import Travel
from app.units import UM_PER_MM
from examples.measured.constant_model import constant_model

FOLDER = "ess-slit-cyclic"
START_S = datetime(2020, 12, 8, 12, tzinfo=UTC).timestamp()
FIRST_MM, LAST_MM = 1, 11
LEARNT_TO_MM = 7
EVERY = 10
"""Of the sweep's rows, 2.5 µm apart."""

REPEATABILITY_UM = 1.0


class Sweep(NamedTuple):
    """Time [s], step counter [mm], resolver minus step counter [µm], shape (n,) each."""

    times_s: FloatArray
    positions_mm: FloatArray
    errors_um: FloatArray


def read_sweep(data: Path) -> Sweep:
    """Read the forward sweep."""
    path = data / FOLDER / "axis1_resolver_vs_openloop.csv"
    with path.open(encoding="utf-8", newline="") as lines:
        _, *rows = csv.reader(lines)
    times, counted, resolved = np.array(rows, dtype=float).T
    return Sweep(START_S + times, counted, (resolved - counted) * UM_PER_MM)


def campaign(sweep: Sweep) -> tuple[Campaign, list[Verification]]:
    """Make the campaign of the first stretches, and the verifications of the last ones."""
    nodes = [int(np.argmin(np.abs(sweep.positions_mm - at))) for at in range(FIRST_MM, LAST_MM + 1)]
    table = ComponentTable.make(
        COMPONENTS["EXX"], sweep.errors_um[nodes], sweep.positions_mm[nodes]
    )
    travel = Travel(float(FIRST_MM), float(LAST_MM))
    model, maps, readings = constant_model(
        "slit", {"x": travel}, {"EXX": table}, START_S, REPEATABILITY_UM
    )
    stretches = [_stretch(sweep, at) for at in range(FIRST_MM, LAST_MM)]
    learnt = LEARNT_TO_MM - FIRST_MM
    return Campaign(model, maps, stretches[:learnt], readings), stretches[learnt:]


def _stretch(sweep: Sweep, from_mm: int) -> Verification:
    inside = (sweep.positions_mm >= from_mm) & (sweep.positions_mm < from_mm + 1)
    rows = np.flatnonzero(inside)[::EVERY].tolist()
    return Verification(
        f"{from_mm} to {from_mm + 1} mm",
        [
            Observation(
                float(sweep.times_s[i]),
                (float(sweep.errors_um[i]),),
                "EXX",
                float(sweep.positions_mm[i]),
                directions=(1, 0, 0),
            )
            for i in rows
        ],
        Datum.FREE,
    )
