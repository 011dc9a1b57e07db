"""The thermal model made ready to be asked: packed maps, one matrix per scale of temperature.

Components that follow the same sensor over the same maps move together, so their
tables stand side by side in the rows of one matrix, a row for each map in the
order of that sensor's temperature. The table at a temperature is then one line
between two rows, however many components and positions there are.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from app.arrays import FloatArray
from app.errors import (
    FieldError,
    NotEnoughMaps,
    OutsideMaps,
    SensorUnavailable,
    list_names,
)
from app.geometry.components import Component
from app.geometry.measuring_line import MeasuringLines
from app.thermal.bracket import Bracket, Status, find_bracket
from app.thermal.machine import Machine


@dataclass(frozen=True, slots=True)
class Scale:
    """One sensor's temperatures of the maps, increasing, and the matrix row of each."""

    sensor: str
    temperatures_c: tuple[float, ...]
    rows: tuple[int, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Member:
    """One component's place in its group's matrix.

    `forward` and `backward` are the columns of its tables; `backward` is None
    where no map of it is bidirectional.
    """

    component: Component
    positions_mm: FloatArray
    forward: slice
    backward: slice | None


@dataclass(frozen=True, slots=True, eq=False)
class Group:
    """The components that lie between the same two maps at any time.

    `scales` begins with the assigned sensor's; its stand-ins' follow. `nodes` has
    a row for each of `labels` [the members' units]. `variances` are those of `nodes`,
    of the same shape [units squared]: NaN where the maps do not state them, None
    where they are nowhere stated.
    """

    scales: tuple[Scale, ...]
    labels: tuple[str, ...]
    members: tuple[Member, ...]
    nodes: FloatArray
    variances: FloatArray | None = None

    @property
    def sensor(self) -> str:
        """The assigned sensor."""
        return self.scales[0].sensor

    @property
    def codes(self) -> list[str]:
        """The members' component codes."""
        return [member.component.code for member in self.members]

    def usable_scale(self, temperatures_c: Mapping[str, float]) -> Scale | None:
        """Choose the assigned sensor's scale, or else the first stand-in's that is usable."""
        return next((scale for scale in self.scales if scale.sensor in temperatures_c), None)


@dataclass(frozen=True, slots=True, eq=False)
class GroupState:
    """A group's errors at one temperature, and how they came about.

    `values` has one number for each column of the group's matrix, and so has `variances`,
    the part of their uncertainty that the measurement of the maps left: NaN where one of
    the maps that enter states none, None where the group has none at all.
    """

    group: Group
    sensor: str
    temperature_c: float
    lower_map: str
    upper_map: str
    weight: float
    status: Status
    values: FloatArray
    variances: FloatArray | None

    @property
    def is_stand_in(self) -> bool:
        """Whether another sensor than the assigned one was used."""
        return self.sensor != self.group.sensor

    def standard_errors(self, columns: slice) -> FloatArray | None:
        """Give the standard errors of one member's values, None where they are not known.

        Parameters
        ----------
        columns
            The member's `forward` or `backward`.

        Returns
        -------
        ndarray, shape (n,) [the member's unit], or None
        """
        # A map states all of a component's standard errors or none.
        if self.variances is None or np.isnan(self.variances[columns.start]):
            return None
        found: FloatArray = np.sqrt(self.variances[columns])
        return found


@dataclass(frozen=True, slots=True, eq=False)
class CompiledModel:
    """A machine's maps and assignment, ready for live temperatures.

    Parameters
    ----------
    machine
        Whose model it is; its policies apply.
    groups
        The components that can be interpolated.
    omitted
        Code to the reason why a component that some map has cannot be.
    notes
        What a user should know about how the maps were brought together.
    measuring_lines
        Axis to the line along which its translations count as measured.
    """

    machine: Machine
    groups: tuple[Group, ...]
    omitted: Mapping[str, str]
    notes: tuple[str, ...]
    measuring_lines: MeasuringLines

    def errors_at(
        self, temperatures_c: Mapping[str, float], stale_c: Mapping[str, float] | None = None
    ) -> list[GroupState]:
        """Interpolate every component to the given temperatures (8.105–8.107).

        Parameters
        ----------
        temperatures_c
            Usable temperatures by sensor [°C]; a sensor that failed is left out,
            and its stand-in serves.
        stale_c
            Old temperatures by sensor [°C], taken only where neither the sensor nor a
            stand-in has a usable one.

        Raises
        ------
        NotEnoughMaps
            If no component has two maps.
        SensorUnavailable
            If a sensor and its stand-ins are all missing.
        OutsideMaps
            If the machine's policy does not allow a temperature.
        """
        if not self.groups:
            raise NotEnoughMaps(self.why_nothing())
        stale_c = stale_c or {}
        found = []
        missing = []
        for group in self.groups:
            scale = group.usable_scale(temperatures_c)
            source = temperatures_c if scale is not None else stale_c
            scale = scale or group.usable_scale(stale_c)
            if scale is None:
                missing.append(group)
            else:
                found.append(self.group_at(group, scale, source[scale.sensor]))
        if missing:
            errors = [
                FieldError(f"temperatures_c.{group.sensor}", self._expected_sensor(group))
                for group in missing
            ]
            raise SensorUnavailable("; ".join(e.message for e in errors), errors)
        return found

    def group_at(self, group: Group, scale: Scale, temperature_c: float) -> GroupState:
        """Interpolate one group on one of its sensors' scales; OutsideMaps as `bracket`."""
        bracket = self.bracket(group, scale, temperature_c)
        lower = scale.rows[bracket.lower]
        upper = scale.rows[bracket.lower + 1]
        w = bracket.weight
        return GroupState(
            group=group,
            sensor=scale.sensor,
            temperature_c=temperature_c,
            lower_map=group.labels[lower],
            upper_map=group.labels[upper],
            weight=w,
            status=bracket.status,
            # (1 − w) E_n + w E_m rather than E_n + w (E_m − E_n): exact at both maps.
            values=(1.0 - w) * group.nodes[lower] + w * group.nodes[upper],
            variances=None
            if group.variances is None
            else _between(group.variances, lower, upper, w),
        )

    def bracket(self, group: Group, scale: Scale, temperature_c: float) -> Bracket:
        """Find a group's two maps at a temperature [°C] of one of its sensors.

        Raises
        ------
        OutsideMaps
            If the machine's policy does not allow the temperature.
        """
        machine = self.machine
        try:
            found = find_bracket(
                scale.temperatures_c,
                temperature_c,
                machine.out_of_range,
                machine.extrapolation_margin_c,
            )
        except OutsideMaps as error:
            message = f"{scale.sensor} ({list_names(group.codes)}): {error.detail}"
            field = FieldError(f"temperatures_c.{scale.sensor}", message)
            raise OutsideMaps(message, [field]) from None
        # A stand-in is said unless something graver is to be said.
        if scale is not group.scales[0] and found.status in (Status.INTERPOLATED, Status.AT_MAP):
            return found._replace(status=Status.STAND_IN)
        return found

    def find(self, code: str) -> tuple[Group, Member] | None:
        """Find a component's group and its place there, or None."""
        for group in self.groups:
            for member in group.members:
                if member.component.code == code:
                    return group, member
        return None

    def why_nothing(self) -> str:
        """Say why no component can be interpolated."""
        reasons = list_names([f"{code}: {why}" for code, why in self.omitted.items()], 3)
        return (
            f"machine {self.machine.id!r} needs at least two error maps at different "
            f"temperatures before anything can be interpolated ({reasons})"
        )

    def _expected_sensor(self, group: Group) -> str:
        stand_ins = [s.name for s in self.machine.with_stand_ins(group.sensor)[1:]]
        usable = {scale.sensor for scale in group.scales}
        spare = "".join(
            f" nor of its stand-in {name}"
            if name in usable
            else f" ({name} cannot stand in: maps lack it, or it cannot tell them apart)"
            for name in stand_ins
        )
        return (
            f"expected a temperature of {group.sensor} in °C, needed by "
            f"{list_names(group.codes)}, came none that is usable{spare}"
        )


def _between(variances: FloatArray, lower: int, upper: int, w: float) -> FloatArray:
    """Variances of (1 − w) E_n + w E_m, the maps being measured independently (GUM, 5.1.2).

    At a map the other one does not enter, known or not.
    """
    if w in (0.0, 1.0):
        own: FloatArray = variances[upper if w else lower]
        return own
    found: FloatArray = (1.0 - w) ** 2 * variances[lower] + w**2 * variances[upper]
    return found
