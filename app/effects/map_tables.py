"""A component's maps read at another temperature: what fingerprints are made of.

A late, a faulty and an exchanged sensor all act on every component that follows it, each in
proportion to how that component's own maps change with the sensor's temperature. Each of them is
a sum of the maps with weights that add up to nothing (`app.thermal.map_weights`), and follows the
machine's policy beyond the maps as the table does.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from app.arrays import BoolArray, FloatArray
from app.thermal.bracket import Brackets, StatusArray
from app.thermal.compiled_model import CompiledModel
from app.thermal.error_map import ErrorMap
from app.thermal.group import Group, Member, Scale
from app.thermal.map_weights import NO_READING, OUTSIDE_MAPS, added, of_two_maps, weights_of

TOGETHER = " + "
"""Between the labels of maps that a model takes as one thermal state."""


class MapReading(NamedTuple):
    """What is added to what the maps say by the assigned sensor at n moments.

    Parameters
    ----------
    weights : ndarray, shape (n, M)
        By rows of the group's matrix, sum 0; NaN where a temperature is not known.
    scale
        The maps' temperatures by which they are read.
    temperatures_c : ndarray, shape (n,) [°C]
        At which temperature of its sensor.
    brackets
        Where that temperature lies among those of the maps.
    is_known : ndarray, shape (n,)
        Whether it is known.
    is_refused : ndarray, shape (n,)
        Where the machine's policy would not allow a table at that temperature.
    is_read : ndarray, shape (n,)
        Where the maps are read there at all.
    is_followed
        Whether the sensor is followed there: what the policy does not allow is `outside-maps`.
    """

    weights: FloatArray
    scale: Scale
    temperatures_c: FloatArray
    brackets: Brackets
    is_known: BoolArray
    is_refused: BoolArray
    is_read: BoolArray
    is_followed: bool = False

    @property
    def status(self) -> StatusArray:
        """Give the status of that temperature, `no-reading` where it is not known."""
        status = self.brackets.status
        if self.is_followed:
            status = np.where(self.brackets.is_refused, OUTSIDE_MAPS, status)
        return np.where(self.is_known, status, NO_READING)

    def times(self, factor: float | FloatArray) -> MapReading:
        """Scale what is added: by one factor, or by one for each moment."""
        return self._replace(
            weights=self.weights * np.reshape(factor, (-1, 1)),
            is_read=self.is_read & (np.asarray(factor) != 0.0),
        )


def elsewhere(
    model: CompiledModel,
    group: Group,
    on: Group,
    temperatures_c: FloatArray,
    there_c: FloatArray,
    *,
    is_followed: bool = False,
) -> MapReading:
    """Give what the maps say at another temperature, minus what they say at the assigned sensor's.

    Parameters
    ----------
    on
        By what the other temperature is read: the group itself, or one component of it on another
        scale (`Group.on_scale`).
    temperatures_c, there_c : ndarray, shape (n,) [°C]
        The assigned sensor's temperatures and the others.
    is_followed
        Whether a sensor of its own is followed there.

    Returns
    -------
    MapReading
        Both as the machine's policy has it: beyond the maps both are held, or extrapolated as far
        as the table itself. What a table would be refused at is held at the edge of what is
        allowed.
    """
    assigned, scale = group.scales[0], on.scales[0]
    before = model.brackets(group, assigned, temperatures_c)
    after = model.brackets(on, scale, there_c)
    is_known = ~(np.isnan(before.weight) | np.isnan(after.weight))
    return MapReading(
        # A map that both sides weigh alike drops out, and no longer limits the positions (`added`).
        added(weights_of(scale, after), -weights_of(assigned, before)),
        scale,
        there_c,
        after,
        is_known,
        after.is_refused,
        is_known if on is not group else is_known & (there_c != temperatures_c),
        is_followed,
    )


def slope(
    model: CompiledModel, group: Group, temperatures_c: FloatArray, by_k: FloatArray
) -> MapReading:
    """Give the derivative with respect to the assigned sensor's temperature, times a step.

    Parameters
    ----------
    temperatures_c : ndarray, shape (n,) [°C]
        Where: at a map it is the derivative upwards, beyond the maps that of the last two.
    by_k : ndarray, shape (n,) [K]
        The step.
    """
    scale = group.scales[0]
    brackets = model.brackets(group, scale, temperatures_c)
    spans = np.diff(scale.temperatures_c)[brackets.lower]
    is_known = ~np.isnan(brackets.weight)
    # Between two maps the table is (1 − w) a + w b, w = (T − T_a)/span: its slope is (b − a)/span.
    share = np.where(is_known, by_k / spans, np.nan)
    return MapReading(
        of_two_maps(scale, brackets.lower, -share, share),
        scale,
        temperatures_c,
        brackets,
        is_known,
        np.zeros(len(temperatures_c), dtype=np.bool_),
        (by_k != 0.0) & is_known,
    )


def temperatures_of_maps(
    model: CompiledModel, maps: Sequence[ErrorMap], sensor: str
) -> dict[str, float]:
    """Say what a sensor read in each of a model's thermal states.

    Returns
    -------
    dict of label to temperature [°C]
        Labels as the model's groups have them; states that do not state it are left out.
    """
    by_label = {}
    for label in dict.fromkeys(label for group in model.groups for label in group.labels):
        noted_c = [m.temperatures_c.get(sensor) for m in maps_of_label(maps, label)]
        present_c = [t for t in noted_c if t is not None]
        if present_c and len(present_c) == len(noted_c):
            by_label[label] = float(np.mean(present_c))
    return by_label


def maps_of_label(maps: Sequence[ErrorMap], label: str) -> list[ErrorMap]:
    """Find the maps behind a label of the model: one, or those that count as one state."""
    exact = [m for m in maps if m.label == label]
    return exact or [m for m in maps if m.label in label.split(TOGETHER)]


def times_of_maps(model: CompiledModel, maps: Sequence[ErrorMap], code: str) -> list[float]:
    """Say when the maps of a component were measured [s since 1970]."""
    located = model.find(code)
    labels = located[0].labels if located else ()
    return [m.measured_at.timestamp() for label in labels for m in maps_of_label(maps, label)]


def scale_by(group: Group, sensor: str, map_temperatures_c: Mapping[str, float]) -> Scale | None:
    """Put a group's maps on any sensor's scale.

    Returns
    -------
    Scale, or None
        None where a map's temperature is not stated, or two are equal.
    """
    in_maps_c = np.array([map_temperatures_c.get(label, np.nan) for label in group.labels])
    rows = np.argsort(in_maps_c, kind="stable")
    if np.isnan(in_maps_c).any() or (np.diff(in_maps_c[rows]) <= 0).any():
        return None
    return Scale(sensor, tuple(in_maps_c[rows].tolist()), tuple(rows.tolist()))


def positions_of(member: Member | None) -> FloatArray:
    """Give a component's positions [mm]; none without a table."""
    return np.empty(0) if member is None else member.positions_mm
