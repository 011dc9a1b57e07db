"""Residuals of each component over all that they may depend on: arrays for a page."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any, Final

import numpy as np

from app.arrays import FloatArray
from app.identification.before_after import lengths
from app.identification.residual_report import ResidualReport, Size
from app.identification.residual_summary import Curve, curves_along

MOST_SINGLE: Final = 2000
"""Of more values only means and scatter are shown."""

FEWEST_IN_RANGE: Final = 4
"""The mean of fewer says little more than a single value."""

DIGITS: Final = 4
TIME: Final = "time [s]"


def residual_curves(report: ResidualReport) -> list[dict[str, Any]]:
    """Give the curves of all lengths together, and of each component.

    Parameters
    ----------
    report
        Residuals and their size.

    Returns
    -------
    list of dict
        component, unit and curves of each: over, bins (see `Bin`), and the single values `at`
        and `residual`, empty where there are too many. All lengths come first, as `all`, where
        there are several components of them.
    """
    rows = report.residuals.rows
    channels = np.array(rows.channels)[rows.channel]
    sizes: list[tuple[Size, Any]] = [(s, channels == s.component) for s in report.components]
    together = report.overall
    if together is not None and sum(s.unit == together.unit for s in report.components) > 1:
        sizes.insert(0, (together, lengths(report.residuals)))
    return [
        {
            "component": size.component,
            "unit": size.unit,
            "curves": [
                _plain(curve)
                for curve in curves_along(
                    report.residuals, report.values, chosen, size.noise, FEWEST_IN_RANGE
                )
            ],
        }
        for size, chosen in sizes
    ]


def _plain(curve: Curve) -> dict[str, Any]:
    is_shown = curve.values.size <= MOST_SINGLE
    over = curve.summary.over
    return {
        "over": over,
        "bins": [asdict(one) for one in curve.summary.bins],
        "at": (curve.at.round().tolist() if over == TIME else _short(curve.at)) if is_shown else [],
        "residual": _short(curve.values) if is_shown else [],
    }


def _short(values: FloatArray) -> list[float]:
    return [float(f"{value:.{DIGITS}g}") for value in values.tolist()]
