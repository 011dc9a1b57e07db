"""Which of an analysis' figures are shown: those of held-out visits, where there are any."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def is_held_out(component: Mapping[str, Any]) -> bool:
    """Say whether a component has figures of visits that took no part in what predicts them.

    Parameters
    ----------
    component
        As the analysis lists it.

    Returns
    -------
    bool
    """
    return component["holdout_before_rms"] is not None


def before_and_after(component: Mapping[str, Any]) -> tuple[float, float]:
    """Give a component's RMS before and after, held out where that is possible.

    Parameters
    ----------
    component
        As the analysis lists it.

    Returns
    -------
    tuple of float
        [the component's unit].

    Examples
    --------
    >>> all_visits = {"before_rms": 2.0, "after_rms": 1.0}
    >>> before_and_after(all_visits | {"holdout_before_rms": None, "holdout_after_rms": None})
    (2.0, 1.0)
    >>> before_and_after(all_visits | {"holdout_before_rms": 2.1, "holdout_after_rms": 1.2})
    (2.1, 1.2)
    """
    prefix = "holdout_" if is_held_out(component) else ""
    return component[f"{prefix}before_rms"], component[f"{prefix}after_rms"]


def overall_size(figures: Mapping[str, Any]) -> float:
    """Give the RMS over all components, held out where that is possible.

    Parameters
    ----------
    figures
        `before` or `after` of an analysis.

    Returns
    -------
    float
        [the unit of `overall_unit`].

    Examples
    --------
    >>> overall_size({"rms_um": 2.0, "holdout_rms_um": None})
    2.0
    """
    held: float | None = figures["holdout_rms_um"]
    whole: float = figures["rms_um"]
    return whole if held is None else held
