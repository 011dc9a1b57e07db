"""Residuals of each component over all that they may depend on: arrays for a page."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from app.arrays import to_significant
from app.identification.analysis.before_after import lengths
from app.identification.analysis.residual_report import ResidualReport, Size
from app.identification.residuals.summary import Bin, Curve, curves_along

MOST_SINGLE: Final = 2000
"""Of more values only means and scatter are shown."""

FEWEST_IN_RANGE: Final = 4
"""The mean of fewer says little more than a single value."""

LISTED_DIGITS: Final = 4
TIME: Final = "time [s]"


@dataclass(frozen=True, slots=True)
class ResidualCurve:
    """Residuals over one quantity.

    Parameters
    ----------
    at, residual
        The single values, where and what; empty where there are too many.
    """

    over: str
    bins: tuple[Bin, ...]
    at: tuple[float, ...]
    residual: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class ComponentCurves:
    """All curves of one component, or of all lengths (`all`)."""

    component: str
    curves: tuple[ResidualCurve, ...]


def residual_curves(report: ResidualReport) -> list[ComponentCurves]:
    """Give the curves of all lengths together, and of each component.

    Returns
    -------
    list of ComponentCurves
        All lengths come first, as `all`, where there are several components of them.
    """
    rows = report.residuals.rows
    channels = np.array(rows.channels)[rows.channel]
    sizes: list[tuple[Size, Any]] = [(s, channels == s.component) for s in report.components]
    together = report.overall
    if together is not None and sum(s.unit == together.unit for s in report.components) > 1:
        sizes.insert(0, (together, lengths(report.residuals)))
    return [
        ComponentCurves(
            size.component,
            tuple(
                _plotted(curve)
                for curve in curves_along(
                    report.residuals,
                    report.values,
                    chosen,
                    None if size.repeatability is None else size.repeatability * report.scatter,
                    FEWEST_IN_RANGE,
                )
            ),
        )
        for size, chosen in sizes
    ]


def _plotted(curve: Curve) -> ResidualCurve:
    is_shown = curve.values.size <= MOST_SINGLE
    over = curve.summary.over
    if not is_shown:
        return ResidualCurve(over, curve.summary.bins, (), ())
    at = (
        tuple(curve.at.round().tolist())
        if over == TIME
        else to_significant(curve.at, LISTED_DIGITS)
    )
    return ResidualCurve(over, curve.summary.bins, at, to_significant(curve.values, LISTED_DIGITS))
