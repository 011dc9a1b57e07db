"""The thermal model made ready to be asked: packed maps, one matrix per scale of temperature.

The table at a temperature is one line between two rows of a group's matrix, however many
components and positions there are.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, partial

from app.arrays import FloatArray
from app.errors import (
    FieldError,
    NotEnoughMaps,
    OutsideMaps,
    SensorUnavailable,
    list_names,
)
from app.geometry.measuring_line import MeasuringLines
from app.thermal.bracket import (
    NUMBERS,
    Bracket,
    Brackets,
    Status,
    find_bracket,
    find_brackets,
    limited,
)
from app.thermal.extrapolation import variances_at, weight_limits
from app.thermal.group import Group, MapsInUse, Member, Scale
from app.thermal.group_state import GroupState
from app.thermal.machine import Machine


@dataclass(frozen=True, eq=False)
class CompiledModel:
    """A machine's maps and assignment, ready for live temperatures.

    Parameters
    ----------
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

    @cached_property
    def numbers(self) -> int:
        """How many errors the table of all components has."""
        return sum(group.nodes.shape[1] for group in self.groups)

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
        states = []
        missing = []
        for group in self.groups:
            scale = group.usable_scale(temperatures_c)
            source = temperatures_c if scale is not None else stale_c
            scale = scale or group.usable_scale(stale_c)
            if scale is None:
                missing.append(group)
            else:
                states.append(self.group_at(group, scale, source[scale.sensor]))
        if missing:
            errors = [
                FieldError(f"temperatures_c.{group.sensor}", self._expected_sensor(group))
                for group in missing
            ]
            raise SensorUnavailable("; ".join(e.message for e in errors), errors)
        return states

    def group_at(self, group: Group, scale: Scale, temperature_c: float) -> GroupState:
        """Interpolate one group on one of its sensors' scales; OutsideMaps as `bracket`."""
        bracket = self.bracket(group, scale, temperature_c)
        lower, upper = scale.rows[bracket.lower], scale.rows[bracket.lower + 1]
        w = bracket.weight
        # A map that has no weight does not shorten the table either.
        if w == 0.0:
            maps = group.maps_in_use(lower)
        elif w == 1.0:
            maps = group.maps_in_use(upper)
        else:
            maps = group.maps_in_use(lower, upper)
        nodes = maps.nodes
        return GroupState(
            group,
            maps,
            scale,
            bracket,
            temperature_c,
            # (1 − w) E_n + w E_m rather than E_n + w (E_m − E_n): exact at both maps.
            (1.0 - w) * nodes[0] + w * nodes[-1],
            self._variances(maps, scale, bracket) if maps.variances is not None else None,
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
            bracket = find_bracket(
                scale.temperatures_c,
                temperature_c,
                machine.out_of_range,
                machine.extrapolation_margin_c,
            )
        except OutsideMaps as error:
            message = f"{scale.sensor}, for {list_names(group.codes)}: {error.detail}"
            blamed = FieldError(f"temperatures_c.{scale.sensor}", message)
            raise OutsideMaps(message, [blamed]) from None
        if bracket.status is Status.EXTRAPOLATED:
            return limited(bracket, weight_limits(machine, group, scale, bracket.lower))
        # A stand-in is said unless something graver is to be said.
        if scale is not group.scales[0] and bracket.status in (Status.INTERPOLATED, Status.AT_MAP):
            return bracket._replace(status=Status.STAND_IN)
        return bracket

    def brackets(self, group: Group, scale: Scale, temperatures_c: FloatArray) -> Brackets:
        """Find a group's two maps at n temperatures of a sensor: as `bracket`, all at once.

        Parameters
        ----------
        temperatures_c : ndarray, shape (n,) [°C]
            NaN where not known.

        Returns
        -------
        Brackets
            What `bracket` would refuse is marked.
        """
        machine = self.machine
        brackets = find_brackets(
            scale.temperatures_c,
            temperatures_c,
            machine.out_of_range,
            machine.extrapolation_margin_c,
            partial(weight_limits, machine, group, scale),
        )
        if scale is not group.scales[0]:
            for plain in (Status.INTERPOLATED, Status.AT_MAP):
                brackets.number[brackets.number == NUMBERS[plain]] = NUMBERS[Status.STAND_IN]
        return brackets

    def _variances(self, maps: MapsInUse, scale: Scale, bracket: Bracket) -> FloatArray | None:
        w = bracket.weight
        inside = 0.0 <= w <= 1.0
        resolution_c = 0.0 if inside else self.machine.sensor(scale.sensor).resolution_c
        return variances_at(maps, w, scale.span_c(bracket.lower), resolution_c)

    def find(self, code: str) -> tuple[Group, Member] | None:
        """Find a component's group and its place there, or None."""
        for group in self.groups:
            for member in group.members:
                if member.component.code == code:
                    return group, member
        return None

    def why_nothing(self) -> str:
        """Say why no component can be interpolated."""
        if not self.omitted:
            return (
                f"machine {self.machine.id!r} needs at least two error maps at different "
                "temperatures before anything can be interpolated"
            )
        reasons = list_names([f"{code} ({why})" for code, why in self.omitted.items()], 3)
        return f"machine {self.machine.id!r} has no component that can be interpolated: {reasons}"

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
            f"{list_names(group.codes)}, got none that is usable{spare}"
        )
