"""Which of an analysis' figures are shown: those of held-out visits, where there are any."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from app.units import Unit


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


def floor_of(component: Mapping[str, Any]) -> float:
    """Give what noise alone would leave of a component: its floor, else its repeatability.

    Parameters
    ----------
    component
        As the analysis lists it.

    Returns
    -------
    float
        [the component's unit].

    Examples
    --------
    >>> floor_of({"floor": 0.63, "noise": 0.61}), floor_of({"floor": None, "noise": 0.61})
    (0.63, 0.61)
    """
    floor: float | None = component["floor"]
    noise: float = component["noise"]
    return noise if floor is None else floor


def overall_floor(result: Mapping[str, Any]) -> float | None:
    """Give the same over all components.

    Parameters
    ----------
    result
        The analysis' answer.

    Returns
    -------
    float or None
        [the unit of `overall_unit`].

    Examples
    --------
    >>> overall_floor({"floor_um": None, "noise_um": 0.61})
    0.61
    """
    floor: float | None = result["floor_um"]
    noise: float | None = result["noise_um"]
    return noise if floor is None else floor


def overall_count(components: Sequence[Mapping[str, Any]]) -> int:
    """Count the values that an RMS over all components is of: lengths, or all without any.

    Parameters
    ----------
    components
        As the analysis lists them, each with unit and count.

    Returns
    -------
    int

    Examples
    --------
    >>> overall_count([{"unit": "µm", "count": 3}, {"unit": "µrad", "count": 1}])
    3
    >>> overall_count([{"unit": "µrad", "count": 1}])
    1
    """
    lengths = [one["count"] for one in components if one["unit"] == Unit.UM.symbol]
    return sum(lengths or [one["count"] for one in components])
