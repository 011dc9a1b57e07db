"""The chapter's argument in numbers: three error maps leave less than two.

"The maximum errors between Run #6 and Run #1 were not linear. Hence, at least
three error maps … are needed" (C. Wang, 8.2.9), shown on the simulated machine.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from app.arrays import FloatArray, rms
from app.simulation.example.error_maps import run_map
from app.simulation.example.machine import example_machine
from app.thermal.compile_model import compile_model
from app.thermal.error_map import ErrorMap
from app.units import Unit

COMPARED_RUNS: Final = (2, 4, 5)
"""Runs that no model has seen."""

STORED_RUNS: Final[tuple[tuple[int, ...], ...]] = ((), (1, 6), (1, 3, 6))
"""Uncompensated; the two outermost maps; the chapter's three."""

_UNITS: Final = (Unit.UM, Unit.UM_PER_M, Unit.URAD)
"""The units in the order of a row's figures."""


@dataclass(frozen=True, slots=True)
class RemainingError:
    """What a compensation from some stored maps leaves of one run's measured errors.

    Parameters
    ----------
    stored
        Labels of the maps that the model has; empty: uncompensated.
    rms_um, max_um
        Root mean square and greatest magnitude over all entries of the nine
        linear components [µm].
    rms_um_per_m, max_um_per_m
        The same over the three squareness errors [µm/m].
    rms_urad, max_urad
        The same over all entries of the nine angular components [µrad].
    """

    run: str
    stored: tuple[str, ...]
    rms_um: float
    max_um: float
    rms_um_per_m: float
    max_um_per_m: float
    rms_urad: float
    max_urad: float


def remaining_errors() -> list[RemainingError]:
    """Compare models from no, two and three maps with the runs that they have not seen.

    Returns
    -------
    list of RemainingError
        For each of Runs 2, 4, 5: uncompensated, with Runs 1 and 6, with Runs 1, 3
        and 6. What remains is the measured error plus the compensation, which is
        measured minus predicted: the residual of the model.

    Notes
    -----
    The measured maps have noise of their own, 0.3 µm and 0.5 µrad, which no model can
    remove.

    Examples
    --------
    >>> rows = remaining_errors()
    >>> [(row.run, len(row.stored)) for row in rows[:3]]
    [('Run #2', 0), ('Run #2', 2), ('Run #2', 3)]
    >>> rows[2].rms_um < rows[1].rms_um < rows[0].rms_um
    True
    """
    return [_remaining(run, stored) for run in COMPARED_RUNS for stored in STORED_RUNS]


def _remaining(run: int, stored: Sequence[int]) -> RemainingError:
    measured = run_map(run)
    maps = [run_map(number) for number in stored]
    predicted = _predicted_errors(maps, measured) if maps else {}
    by_unit: dict[Unit, list[FloatArray]] = {unit: [] for unit in _UNITS}
    for code, table in measured.tables.items():
        by_unit[table.component.unit].append(table.errors - predicted.get(code, 0.0))
    return RemainingError(
        measured.label,
        tuple(error_map.label for error_map in maps),
        *(figure for residuals in by_unit.values() for figure in _rms_and_max(residuals)),
    )


def _predicted_errors(maps: Sequence[ErrorMap], measured: ErrorMap) -> dict[str, FloatArray]:
    """Ask a model of the maps for the errors at a run's temperatures (8.105–8.107)."""
    model = compile_model(example_machine(), maps, assignment={})
    return {
        member.component.code: state.values[member.forward]
        for state in model.errors_at(measured.temperatures_c)
        for member in state.members
    }


def _rms_and_max(of_components: Sequence[FloatArray]) -> tuple[float, float]:
    residuals = np.concatenate(of_components)
    return rms(residuals), float(np.abs(residuals).max())
