"""A group's errors at one temperature, and how they came about."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from app.arrays import FloatArray
from app.thermal.bracket import Bracket, Status
from app.thermal.group import Group, MapsInUse, Member, Scale


class GroupState(NamedTuple):
    """A group's errors at one temperature, and how they came about.

    `bracket` says between which two maps of `scale` the temperature lies. `values` has one
    number for each column of `maps`, the maps in use, and so has `variances`, the part of
    their uncertainty that the measurement of the maps left (`variances_at`): NaN where one of
    the maps that enter states none, None where the group has none at all.
    """

    group: Group
    maps: MapsInUse
    scale: Scale
    bracket: Bracket
    temperature_c: float
    values: FloatArray
    variances: FloatArray | None

    @property
    def sensor(self) -> str:
        """Whose temperature it is."""
        return self.scale.sensor

    @property
    def lower_map(self) -> str:
        """Label of the lower of the two maps."""
        return self.group.labels[self.scale.rows[self.bracket.lower]]

    @property
    def upper_map(self) -> str:
        """Label of the upper of the two maps."""
        return self.group.labels[self.scale.rows[self.bracket.lower + 1]]

    @property
    def weight(self) -> float:
        """The upper map's."""
        return self.bracket.weight

    @property
    def status(self) -> Status:
        """How it came about."""
        return self.bracket.status

    @property
    def is_stand_in(self) -> bool:
        """Whether another sensor than the assigned one was used."""
        return self.scale.sensor != self.group.sensor

    @property
    def span_c(self) -> float:
        """How far apart the two maps are on the scale of `sensor` [K]."""
        return self.scale.span_c(self.bracket.lower)

    @property
    def limited_beyond_c(self) -> float | None:
        """How far beyond the maps an extrapolation was stopped [K]; None where none was."""
        if not self.bracket.is_limited:
            return None
        return max(self.weight - 1.0, -self.weight) * self.span_c

    @property
    def members(self) -> tuple[Member, ...]:
        """The components, at the positions that hold at this temperature."""
        return self.maps.members

    @property
    def stand_in_for(self) -> str | None:
        """The assigned sensor where another one was used, else None."""
        return self.group.sensor if self.is_stand_in else None

    def standard_errors(self, columns: slice) -> FloatArray | None:
        """Give the standard errors of one member's values, None where they are not known.

        Returns
        -------
        ndarray, shape (n,) [the member's unit], or None
        """
        # A map states all of a component's standard errors or none.
        if self.variances is None or np.isnan(self.variances[columns.start]):
            return None
        errors: FloatArray = np.sqrt(self.variances[columns])
        return errors
