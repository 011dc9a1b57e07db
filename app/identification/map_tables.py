"""A component's tables over temperature and position: what fingerprints are made of.

A late, a faulty and an exchanged sensor all act on every component that follows it, each in
proportion to how that component's own tables change with the sensor's temperature.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from app.arrays import FloatArray, IntArray
from app.thermal.compiled_model import CompiledModel, Group, Member, common_range_of_rows
from app.thermal.error_map import ErrorMap

TOGETHER = " + "
"""Between the labels of maps that a model takes as one thermal state."""


@dataclass(frozen=True, eq=False)
class TemperatureTable:
    """One component over a sensor's temperatures and over positions.

    Parameters
    ----------
    temperatures_c : ndarray, shape (M,) [°C]
        Strictly increasing.
    positions_mm : ndarray, shape (k,) [mm]
        One or none where the error does not depend on position.
    forward, backward : ndarray, shape (M, k) [the component's unit]
        Equal where the maps do not tell directions apart.
    ranges_mm : ndarray, shape (M, 2) [mm]
        First and last position that each map covers; infinite where that limits nothing.
    start_below_c, start_above_c
        How far beyond the maps the table itself is extrapolated [°C].
    reach_margin_c
        How far beyond the maps a temperature may be moved [°C].
    """

    temperatures_c: FloatArray
    positions_mm: FloatArray
    forward: FloatArray
    backward: FloatArray
    ranges_mm: FloatArray
    start_below_c: float
    start_above_c: float
    reach_margin_c: float

    def at(
        self, temperatures_c: FloatArray, positions_mm: FloatArray, directions: FloatArray
    ) -> FloatArray:
        """Read the errors as the model does.

        Parameters
        ----------
        temperatures_c : ndarray, shape (n,) [°C]
            Beyond the maps as the machine's policy says.
        positions_mm : ndarray, shape (n,) [mm]
            Outside the table its end values hold.
        directions : ndarray, shape (n,)
            +1, −1, or 0: the mean of both.

        Returns
        -------
        ndarray, shape (n,) [the component's unit]
        """
        return self._read(self._start(temperatures_c), positions_mm, directions)

    def moved(
        self,
        temperatures_c: FloatArray,
        by_k: FloatArray,
        positions_mm: FloatArray,
        directions: FloatArray,
    ) -> FloatArray:
        """Give the errors' change when the temperature is moved.

        Parameters
        ----------
        temperatures_c : ndarray, shape (n,) [°C]
            From where; beyond the maps the table stands where the machine's policy says.
        by_k : ndarray, shape (n,) [K]
            By how much from the temperature itself; beyond the maps extrapolated as far as it
            moves away from where the table stands, up to the machine's margin.
        positions_mm, directions : ndarray, shape (n,)
            As for `at`.

        Returns
        -------
        ndarray, shape (n,) [the component's unit]
        """
        start = self._start(temperatures_c)
        low, high = self.temperatures_c[[0, -1]]
        lowest = np.minimum(low - self.start_below_c, start + by_k)
        highest = np.maximum(high + self.start_above_c, start + by_k)
        target = np.clip(
            np.clip(temperatures_c + by_k, lowest, highest),
            low - self.reach_margin_c,
            high + self.reach_margin_c,
        )
        after = self._read(target, positions_mm, directions)
        return after - self._read(start, positions_mm, directions)

    def slope(
        self, temperatures_c: FloatArray, positions_mm: FloatArray, directions: FloatArray
    ) -> FloatArray:
        """Differentiate the model with respect to the sensor's temperature.

        Parameters
        ----------
        temperatures_c, positions_mm, directions : ndarray, shape (n,)
            As for `at`; at a map the derivative upwards.

        Returns
        -------
        ndarray, shape (n,) [the component's unit per K]
        """
        lower, span = self._bracket(temperatures_c)
        positions_mm = self._inside(lower, lower + 1, positions_mm)
        rise = self._in_table(lower + 1, positions_mm, directions)
        rise = rise - self._in_table(lower, positions_mm, directions)
        found: FloatArray = np.where(np.isnan(temperatures_c), np.nan, rise / span)
        return found

    def _start(self, temperatures_c: FloatArray) -> FloatArray:
        low, high = self.temperatures_c[[0, -1]]
        found: FloatArray = np.clip(
            temperatures_c, low - self.start_below_c, high + self.start_above_c
        )
        return found

    def _read(
        self, temperatures_c: FloatArray, positions_mm: FloatArray, directions: FloatArray
    ) -> FloatArray:
        lower, span = self._bracket(temperatures_c)
        weight = (temperatures_c - self.temperatures_c[lower]) / span
        positions_mm = self._inside(
            np.where(weight == 1.0, lower + 1, lower),
            np.where(weight == 0.0, lower, lower + 1),
            positions_mm,
        )
        below = self._in_table(lower, positions_mm, directions)
        above = self._in_table(lower + 1, positions_mm, directions)
        found: FloatArray = (1.0 - weight) * below + weight * above
        return found

    def _inside(self, lower: IntArray, upper: IntArray, positions_mm: FloatArray) -> FloatArray:
        """Hold positions at the ends of what the maps in use cover."""
        return np.clip(positions_mm, *common_range_of_rows(self.ranges_mm, lower, upper))

    def _bracket(self, temperatures_c: FloatArray) -> tuple[IntArray, FloatArray]:
        scale = self.temperatures_c
        lower = np.searchsorted(scale, temperatures_c, side="right") - 1
        lower = np.clip(lower, 0, scale.size - 2)
        return lower, scale[lower + 1] - scale[lower]

    def _in_table(
        self, state: IntArray, positions_mm: FloatArray, directions: FloatArray
    ) -> FloatArray:
        """Interpolate over positions in given rows of the table: shape (n,)."""
        left, right, share = hat_weights(self.positions_mm, positions_mm)
        ahead = np.array([self.forward[state, left], self.forward[state, right]])
        back = np.array([self.backward[state, left], self.backward[state, right]])
        both = np.where(directions > 0, ahead, np.where(directions < 0, back, (ahead + back) / 2))
        found: FloatArray = (1.0 - share) * both[0] + share * both[1]
        return found


def hat_weights(
    nodes_mm: FloatArray, positions_mm: FloatArray
) -> tuple[IntArray, IntArray, FloatArray]:
    """Find the nodes beside positions, and the right one's share.

    Parameters
    ----------
    nodes_mm : ndarray, shape (k,) [mm]
        Increasing; with one or none there is nothing to interpolate.
    positions_mm : ndarray, shape (n,) [mm]
        Outside the nodes the end values hold.

    Returns
    -------
    left, right, share : ndarray, shape (n,)

    Examples
    --------
    >>> [a.tolist() for a in hat_weights(np.array([0.0, 100.0, 200.0]), np.array([150.0]))]
    [[1], [2], [0.5]]
    """
    if nodes_mm.size < 2:
        none = np.zeros(positions_mm.shape, dtype=np.intp)
        return none, none, np.zeros(positions_mm.shape)
    inside = np.clip(positions_mm, nodes_mm[0], nodes_mm[-1])
    left = np.clip(np.searchsorted(nodes_mm, inside, side="right") - 1, 0, nodes_mm.size - 2)
    share = (inside - nodes_mm[left]) / (nodes_mm[left + 1] - nodes_mm[left])
    return left, left + 1, share


def temperature_table(
    model: CompiledModel, code: str, map_temperatures_c: Mapping[str, float] | None = None
) -> TemperatureTable | None:
    """Take a component's tables out of the model.

    Parameters
    ----------
    model
        The compiled model.
    code
        The component.
    map_temperatures_c
        Map label to another sensor's temperature [°C], to read the same maps on that
        sensor's scale; without it the assigned sensor's.

    Returns
    -------
    TemperatureTable, or None
        None where the model lacks the component, a map's temperature is not stated, or two
        are equal.
    """
    found = model.find(code)
    if found is None:
        return None
    group, member = found
    scale = scale_of(group, map_temperatures_c)
    if scale is None:
        return None
    temperatures, rows = scale
    machine = model.machine
    return TemperatureTable(
        temperatures,
        member.positions_mm,
        group.nodes[rows, member.forward],
        group.nodes[rows, member.backward or member.forward],
        member.ranges_mm[rows],
        *model.extrapolation_reach_c(group, temperatures.tolist(), rows.tolist()),
        machine.extrapolation_margin_c,
    )


def temperatures_of_maps(
    model: CompiledModel, maps: Sequence[ErrorMap], sensor: str
) -> dict[str, float]:
    """Say what a sensor read in each of a model's thermal states.

    Parameters
    ----------
    model
        The compiled model.
    maps
        The error maps that it was made of.
    sensor
        Any sensor.

    Returns
    -------
    dict of label to temperature [°C]
        Labels as the model's groups have them; states that do not state it are left out.
    """
    found = {}
    for label in dict.fromkeys(label for group in model.groups for label in group.labels):
        own = [m.temperatures_c.get(sensor) for m in maps_of_label(maps, label)]
        known = [t for t in own if t is not None]
        if known and len(known) == len(own):
            found[label] = float(np.mean(known))
    return found


def maps_of_label(maps: Sequence[ErrorMap], label: str) -> list[ErrorMap]:
    """Find the maps behind a label of the model: one, or those that count as one state."""
    exact = [m for m in maps if m.label == label]
    return exact or [m for m in maps if m.label in label.split(TOGETHER)]


def scale_of(
    group: Group, map_temperatures_c: Mapping[str, float] | None
) -> tuple[FloatArray, IntArray] | None:
    """Find a sensor's temperatures of a group's maps, increasing, and the row of each map.

    Parameters
    ----------
    group
        The group.
    map_temperatures_c
        Map label to another sensor's temperature [°C]; without it the assigned sensor's.

    Returns
    -------
    temperatures, rows : ndarray of shape (M,), or None
        None where a map's temperature is not stated, or two are equal.
    """
    if map_temperatures_c is None:
        own = group.scales[0]
        return np.array(own.temperatures_c), np.array(own.rows, dtype=np.intp)
    stated = np.array([map_temperatures_c.get(label, np.nan) for label in group.labels])
    rows = np.argsort(stated, kind="stable")
    if np.isnan(stated).any() or (np.diff(stated[rows]) <= 0).any():
        return None
    return stated[rows], rows


def positions_of(member: Member | None) -> FloatArray:
    """Give a component's positions [mm]; none without a table."""
    return np.empty(0) if member is None else member.positions_mm
