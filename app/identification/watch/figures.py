"""What is told of a watch without reading all that it knows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from app.arrays import BoolArray, rms
from app.identification.residuals.residuals import Residuals, channel_unit
from app.search.rows import Datum
from app.units import Unit


@dataclass(frozen=True, slots=True)
class LatestResiduals:
    """What the latest verification left: measured minus predicted, of all its observations.

    Parameters
    ----------
    time_s
        Of its last observation [s].
    rms, largest
        By unit, `µm` or `µrad` (squareness, in µm/m, is an angle in µrad): root mean square, and
        the largest with its sign [that unit].
    """

    time_s: float
    rms: Mapping[str, float]
    largest: Mapping[str, float]


@dataclass(frozen=True, slots=True)
class CheckFigures:
    """By how much the latest visit to a component was off, and what was to be expected of it.

    Parameters
    ----------
    component, unit
        Code, or `points x`, and the unit of what follows.
    time_s
        Of the visit's last observation [s].
    off
        Root mean square of measured minus predicted; of one value its size. Where the instrument
        was zeroed anywhere, about their mean.
    scatter
        Standard deviation of one observation, the maps' uncertainty included.
    setup_scatter
        Standard deviation that set-ups add, as earlier visits show it; 0 before there were enough.
    at_most
        What `off` was expected not to exceed: twice the scatter of a value, and more where few
        values of many components are looked at.
    """

    component: str
    unit: str
    time_s: float
    count: int
    off: float
    scatter: float
    setup_scatter: float
    at_most: float

    @property
    def is_as_expected(self) -> bool:
        """Whether it is off by no more than was to be expected."""
        return self.off <= self.at_most


@dataclass(frozen=True, slots=True)
class WatchFigures:
    """Where a watch stands.

    Parameters
    ----------
    most_sigmas
        Largest latest deviation of a followed number, over the standard deviation that was to be
        expected of it; None before anything could be judged.
    check
        Of the component that was furthest from what was to be expected when it was visited last;
        None where nothing is known of the scatter, and in figures of earlier versions.
    """

    evidence: float
    most_sigmas: float | None
    latest: LatestResiduals
    check: CheckFigures | None = None


def latest_residuals(residuals: Residuals) -> LatestResiduals:
    """Sum up the verification whose observations are the latest of some.

    What an instrument that was zeroed anywhere reads is known but for a constant: there the mean
    of the visit is taken off.
    """
    rows = residuals.rows
    of_latest = rows.verification == rows.verification[int(np.argmax(rows.times_s))]
    values = residuals.values.copy()
    for (visit, channel), datum in rows.datum().items():
        here = of_latest & (rows.visit == visit) & (rows.channel == channel)
        if datum is not Datum.ABSOLUTE and np.any(here):
            values[here] -= values[here].mean()
    is_length = np.array([channel_unit(name) is Unit.UM for name in rows.channels])[rows.channel]
    groups: dict[str, BoolArray] = {
        Unit.UM.symbol: of_latest & is_length,
        Unit.URAD.symbol: of_latest & ~is_length,
    }
    by_unit = {unit: values[chosen] for unit, chosen in groups.items() if np.any(chosen)}
    return LatestResiduals(
        float(rows.times_s[of_latest].max()),
        {unit: rms(some) for unit, some in by_unit.items()},
        {unit: float(some[np.argmax(np.abs(some))]) for unit, some in by_unit.items()},
    )
