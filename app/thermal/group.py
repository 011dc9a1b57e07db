"""Components that follow one sensor over the same maps, side by side, and the maps in use.

Components that follow the same sensor over the same maps move together, so their
tables stand side by side in the rows of one matrix, a row for each map in the
order of that sensor's temperature. Of these only the maps that are in use count, however
short others are.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final
from weakref import WeakValueDictionary

import numpy as np

from app.arrays import BoolArray, FloatArray, frozen
from app.errors import list_names
from app.geometry.components import Component


@dataclass(frozen=True, slots=True)
class Scale:
    """One sensor's temperatures of the maps, increasing, and the matrix row of each."""

    sensor: str
    temperatures_c: tuple[float, ...]
    rows: tuple[int, ...]

    def span_c(self, lower: int) -> float:
        """Give how far apart two neighbouring maps are [K], the lower at a place."""
        return self.temperatures_c[lower + 1] - self.temperatures_c[lower]


@dataclass(frozen=True, slots=True, weakref_slot=True, eq=False)
class Member:
    """One component's place in a row of numbers; made by `member_of`, once for all that are alike.

    `forward` and `backward` are the columns of its tables at `positions_mm`; `backward` is
    None where no map of it is bidirectional. `ranges_mm` has for each of the group's maps
    the first and the last position that it covers, shape (M, 2): −∞ and ∞ where the map's
    errors do not depend on position.
    """

    component: Component
    positions_mm: FloatArray
    forward: slice
    backward: slice | None
    ranges_mm: FloatArray

    @property
    def reach_mm(self) -> tuple[float, float] | None:
        """The range that any of the maps covers [mm]; None without dependence on position."""
        if not np.isfinite(self.ranges_mm).any():
            return None
        return float(self.positions_mm[0]), float(self.positions_mm[-1])

    def common_range(self, rows: Sequence[int]) -> tuple[float, float]:
        """Find the range of positions that maps have in common: `common_range_of_rows` [mm]."""
        return common_range_of_rows(self.ranges_mm, rows)


_MEMBERS: Final[WeakValueDictionary[tuple[object, ...], Member]] = WeakValueDictionary()


def member_of(
    component: Component,
    positions_mm: FloatArray,
    forward: slice,
    backward: slice | None,
    ranges_mm: FloatArray,
) -> Member:
    """Give a component's place in a row: the same object to all that are alike.

    Sister machines are measured at the same positions. What is remembered of members, such as
    how a table is laid out, is then made and kept once for ten thousand of them.
    """
    columns = tuple((c.start, c.stop) for c in (forward, backward) if c is not None)
    key = (component.code, positions_mm.tobytes(), columns, ranges_mm.shape, ranges_mm.tobytes())
    cached = _MEMBERS.get(key)
    if cached is not None:
        return cached
    # Two threads that make one at once may each go on with its own: kept twice, and no less right.
    return _MEMBERS.setdefault(key, Member(component, positions_mm, forward, backward, ranges_mm))


@dataclass(frozen=True, slots=True, eq=False)
class MapsInUse:
    """What a group has between two of its maps, at one of them, or made of several.

    Parameters
    ----------
    rows
        Whose maps they are: rows of the group's matrix.
    members
        The components, at the maps' own positions inside their common range. None is left of a
        component whose maps have no range in common.
    nodes : tuple of ndarray, shape (w,) [the members' units]
        For each of the rows its errors there.
    variances : tuple of ndarray, shape (w,), or None
        As `Group.variances`.
    covariances : ndarray, shape (w,), or None
        Of two maps' errors; None where they are independent of each other.
    shortened
        Code to the words why a component ends earlier than other maps of the model.
    """

    rows: tuple[int, ...]
    members: tuple[Member, ...]
    nodes: tuple[FloatArray, ...]
    variances: tuple[FloatArray, ...] | None
    covariances: FloatArray | None
    shortened: Mapping[str, str]

    def member(self, code: str) -> Member:
        """Find a component."""
        return next(m for m in self.members if m.component.code == code)


@dataclass(frozen=True, slots=True, eq=False)
class Group:
    """The components that lie between the same two maps at any time.

    `scales` begins with the assigned sensor's; its stand-ins' follow. `nodes` has
    a row for each of `labels` [the members' units], at the union of all maps' positions:
    beyond a map's own range its end values, which nothing reads. `measured`, of the same shape,
    says which positions a map brings itself. `variances` are those of `nodes`,
    of the same shape [units squared]: NaN where the maps do not state them, None
    where they are nowhere stated. `covariances` are those between two maps' rows, the smaller
    number first, where one map's reversal is another's. `limits` remembers of a scale's
    neighbouring maps how far the line through them may be extrapolated.
    """

    scales: tuple[Scale, ...]
    labels: tuple[str, ...]
    members: tuple[Member, ...]
    nodes: FloatArray
    measured: BoolArray
    variances: FloatArray | None = None
    covariances: Mapping[tuple[int, int], FloatArray] = field(default_factory=dict)
    # Made anew for every group, also by `replace`: what they remember is of these members.
    limits: dict[tuple[Scale, int], tuple[float, float]] = field(
        default_factory=dict, init=False, repr=False
    )
    _in_use: dict[tuple[int, ...], MapsInUse] = field(default_factory=dict, init=False, repr=False)
    _alone: dict[tuple[Scale, str], Group] = field(default_factory=dict, init=False, repr=False)

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
        for scale in self.scales:
            if scale.sensor in temperatures_c:
                return scale
        return None

    def on_scale(self, scale: Scale, member: Member) -> Group:
        """Put one component by itself on the scale of a sensor that it then follows."""
        key = (scale, member.component.code)
        cached = self._alone.get(key)
        if cached is None:
            alone = replace(self, scales=(scale,), members=(member,))
            cached = self._alone.setdefault(key, alone)
        return cached

    def maps_in_use(self, *rows: int) -> MapsInUse:
        """Give what maps have in common, or of one row what one map has.

        It is made when it is first asked for, and remembered.
        """
        cached = self._in_use.get(rows)
        if cached is None:
            cached = self._in_use.setdefault(rows, self._bring_together(rows))
        return cached

    def _bring_together(self, rows: tuple[int, ...]) -> MapsInUse:
        common = np.logical_or.reduce(self.measured[list(rows)])
        for member in self.members:
            low, high = member.common_range(rows)
            if np.isfinite(low):
                inside = (member.positions_mm >= low) & (member.positions_mm <= high)
                for columns in filter(None, (member.forward, member.backward)):
                    common[columns] &= inside
        # Where the maps have the same positions, which is the rule, nothing is copied.
        all_kept = bool(common.all())
        variances = self.variances

        def narrowed(row: FloatArray) -> FloatArray:
            return row if all_kept else frozen(row[common])

        covariances = None
        if len(rows) == 2:
            covariances = self.covariances.get((min(rows), max(rows)))
        return MapsInUse(
            rows,
            self.members if all_kept else _narrowed(self.members, common),
            tuple(narrowed(self.nodes[row]) for row in rows),
            None if variances is None else tuple(narrowed(variances[row]) for row in rows),
            None if covariances is None else narrowed(covariances),
            dict(self._shortened(rows)),
        )

    def _shortened(self, rows: Sequence[int]) -> Iterator[tuple[str, str]]:
        """Say which components end earlier than other maps of theirs, and because of which."""
        for member in self.members:
            reach = member.reach_mm
            if reach is None:
                continue
            low, high = member.common_range(rows)
            if low <= reach[0] and high >= reach[1]:
                continue
            short = [
                f"map {self.labels[row]!r} covers {from_to_mm(*member.ranges_mm[row])}"
                for row in rows
                if member.ranges_mm[row, 0] > reach[0] or member.ranges_mm[row, 1] < reach[1]
            ]
            yield (
                member.component.code,
                f"given from {low:g} to {high:g} mm only at this temperature, because "
                f"{' and '.join(short)}; the maps together reach from {from_to_mm(*reach)}",
            )


def sentences(shortened: Iterable[tuple[str, str]]) -> list[str]:
    """Say once what is the same of several components.

    Examples
    --------
    >>> sentences([("EXX", "given to 100 mm only"), ("EYX", "given to 100 mm only")])
    ['EXX, EYX: given to 100 mm only']
    """
    codes: dict[str, list[str]] = defaultdict(list)
    for code, words in shortened:
        codes[words].append(code)
    return [f"{list_names(of)}: {words}" for words, of in codes.items()]


def common_range_of_rows(ranges_mm: FloatArray, rows: Sequence[int]) -> tuple[float, float]:
    """Find the range of positions that maps have in common.

    Parameters
    ----------
    ranges_mm : ndarray, shape (M, 2) [mm]
        As `Member.ranges_mm`.

    Returns
    -------
    low, high : float [mm]
        −∞ and ∞ where none depends on position; low ≥ high where they have none.

    Examples
    --------
    >>> common_range_of_rows(np.array([[0.0, 100.0], [0.0, 500.0], [300.0, 500.0]]), [0, 1])
    (0.0, 100.0)
    """
    lows, highs = ranges_mm[list(rows)].T
    return float(lows.max()), float(highs.min())


def _narrowed(members: Sequence[Member], common: BoolArray) -> tuple[Member, ...]:
    """Lay the members out anew on the columns that are kept."""
    narrowed = []
    # Each column's new place: how many are kept before it.
    place = np.concatenate([[0], np.cumsum(common)])
    for member in members:
        forward, backward = (
            None if columns is None else slice(int(place[columns.start]), int(place[columns.stop]))
            for columns in (member.forward, member.backward)
        )
        assert forward is not None
        positions = member.positions_mm
        if positions.size:
            positions = positions[common[member.forward]]
        narrowed.append(member_of(member.component, positions, forward, backward, member.ranges_mm))
    return tuple(narrowed)


def from_to_mm(low: float, high: float) -> str:
    """Write a range of positions for a sentence.

    >>> from_to_mm(0.0, 512.5)
    '0 to 512.5 mm'
    """
    return f"{low:g} to {high:g} mm"
