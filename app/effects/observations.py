"""Verifications of a machine, laid out as rows: one number that an instrument read in each.

A row belongs to a channel (a component's code, or one direction of the volumetric error at
points) and to a visit (a verification, or a part of it between long pauses): the visit is
what has one set-up and hardly changes its temperatures, and so it is the unit of evidence.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final, TypeAlias

import numpy as np

from app.arrays import BoolArray, FloatArray, IntArray
from app.errors import InvalidContent
from app.geometry.components import COMPONENTS, LINEAR_LETTERS, ORDER
from app.search.rows import Datum

Triple: TypeAlias = tuple[float, float, float]

POINT_CHANNELS: Final = ("points x", "points y", "points z")
"""The volumetric error's three directions [µm]."""

VISIT_GAP_S: Final = 7200.0
"""A pause longer than this begins another visit [s]."""

PAUSE: Final = 20.0
"""So does one of so many usual intervals between observations: the set-up may be another."""

SHORTEST_PAUSE_S: Final = 300.0
"""But no pause shorter than this [s]."""

REPLICATES_WITHIN_S: Final = 1800.0
"""Repeats further apart than this have lived through something else [s]."""

SAME_PLACE_DECIMALS: Final = 6
"""Places that agree to a nanometre are one."""


@dataclass(frozen=True, slots=True)
class Observation:
    """What an instrument read, once: of a component, or at a point of the work volume.

    Parameters
    ----------
    time_s
        When, in seconds since 1970-01-01 UTC.
    measured
        One value [the component's unit], or x, y and z of the error at a point [µm].
    component
        The component's code; None at a point.
    position_mm
        Position on the component's axis; squareness has none.
    point_mm, tool_offset_mm
        The point and the tool offset [mm].
    directions
        Approach of x, y, z: +1, −1, 0 where it is not known.
    state
        The machine's state, where the shop stated it beside the observation.
    """

    time_s: float
    measured: tuple[float, ...]
    component: str | None = None
    position_mm: float | None = None
    point_mm: Triple | None = None
    tool_offset_mm: Triple = (0.0, 0.0, 0.0)
    directions: tuple[int, int, int] = (0, 0, 0)
    state: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        known = self.component is not None and self.component in COMPONENTS
        if (self.point_mm is None) is not known or len(self.measured) != (1 if known else 3):
            raise InvalidContent.of_field(
                "observations",
                "expected a component of the table and one measured value, or a point and "
                f"three, came component {self.component!r}, point {self.point_mm} and "
                f"{len(self.measured)} values",
            )
        if known and self.position_mm is None and COMPONENTS[str(self.component)].is_table:
            raise InvalidContent.of_field(
                "observations", f"expected position_mm of {self.component} in mm, came none"
            )


@dataclass(frozen=True, slots=True)
class Verification:
    """Observations that were taken with one set-up, and what their zero means.

    Parameters
    ----------
    label
        What the shop calls it.
    observations
        In any order.
    datum
        What zero means.
    repeatability_um
        Standard deviation of one observation [µm], where the shop knows it.
    is_planned
        Whether it is yet to be measured: its values stand for nothing.
    """

    label: str
    observations: Sequence[Observation]
    datum: Datum = Datum.ABSOLUTE
    repeatability_um: float | None = None
    is_planned: bool = False


@dataclass(frozen=True, eq=False)
class ObservationRows:
    """All observations as rows, one number each.

    Parameters
    ----------
    channels
        Names of the channels: component codes, then those of `POINT_CHANNELS`.
    channel, visit, replicate : ndarray, shape (n,)
        Numbers of the channel, of the visit (growing with time), and of the group of
        repeats within it (−1: none).
    verification, observation : ndarray, shape (n,)
        Where a row comes from.
    times_s : ndarray, shape (n,) [s]
        When.
    measured : ndarray, shape (n,)
        [the channel's unit]
    points_mm : ndarray, shape (n, 3) [mm]
        Where; only the own axis' coordinate is known for a component.
    tool_offsets_mm : ndarray, shape (n, 3) [mm]
        With which tool offset.
    directions : ndarray, shape (n, 3)
        Approach of x, y, z: +1, −1 or 0.
    states : mapping of name to ndarray, shape (n,)
        States that were stated beside the observations, else NaN.
    verifications
        What the rows came from.
    """

    channels: tuple[str, ...]
    channel: IntArray
    visit: IntArray
    replicate: IntArray
    verification: IntArray
    observation: IntArray
    times_s: FloatArray
    measured: FloatArray
    points_mm: FloatArray
    tool_offsets_mm: FloatArray
    directions: FloatArray
    states: Mapping[str, FloatArray]
    verifications: tuple[Verification, ...]

    def __len__(self) -> int:
        return len(self.measured)

    @property
    def has_points(self) -> bool:
        """Whether any row is of the volumetric error at a point."""
        return bool(self.at_points.any())

    @property
    def at_points(self) -> BoolArray:
        """Which rows are of the volumetric error at a point, shape (n,)."""
        numbers = [i for i, name in enumerate(self.channels) if name in POINT_CHANNELS]
        return np.isin(self.channel, numbers)

    @property
    def components(self) -> tuple[str, ...]:
        """The components that were observed by themselves."""
        return tuple(name for name in self.channels if name not in POINT_CHANNELS)

    @property
    def visits(self) -> int:
        """How many visits there are."""
        return len(np.unique(self.visit))

    def of_channel(self, name: str) -> IntArray:
        """List the rows of a channel."""
        if name not in self.channels:
            return np.empty(0, dtype=np.intp)
        return np.flatnonzero(self.channel == self.channels.index(name))

    def datum(self) -> dict[tuple[int, int], Datum]:
        """Say for each visit and channel with a zero of its own what that means.

        Absolute zeros are left out, and so are those that several visits share
        (`shared_zeros`).
        """
        # As one number each: numpy sorts rows many times slower, and lets nobody else run.
        shape = (self.visit.max(initial=0) + 1, len(self.channels), len(self.verifications))
        rows = np.ravel_multi_index((self.visit, self.channel, self.verification), shape)
        keys = np.column_stack(np.unravel_index(np.unique(rows), shape)).tolist()
        visits = Counter((c, which) for _, c, which in keys)
        found = {
            (v, c): self.verifications[which].datum for v, c, which in keys if visits[c, which] == 1
        }
        return {key: datum for key, datum in found.items() if datum is not Datum.ABSOLUTE}

    def shared_zeros(self) -> list[IntArray]:
        """List the rows of each unknown zero that several visits of a verification share."""
        found = []
        for which in np.flatnonzero([v.datum is not Datum.ABSOLUTE for v in self.verifications]):
            for channel in np.unique(self.channel[self.verification == which]):
                own = np.flatnonzero((self.verification == which) & (self.channel == channel))
                if len(np.unique(self.visit[own])) > 1:
                    found.append(own)
        return found

    @property
    def is_planned(self) -> BoolArray:
        """Which rows are yet to be measured, shape (n,)."""
        planned = np.array([v.is_planned for v in self.verifications], dtype=np.bool_)
        return planned[self.verification]

    @property
    def has_own_zero(self) -> BoolArray:
        """Which rows have a zero that no other visit shares, shape (n,)."""
        own = self.datum()
        keys = zip(self.visit.tolist(), self.channel.tolist(), strict=True)
        return np.array([key in own for key in keys], dtype=np.bool_)

    def take(self, kept: BoolArray) -> ObservationRows:
        """Keep some rows; channels and visits keep their numbers.

        Parameters
        ----------
        kept : ndarray, shape (n,)
            Which.
        """
        arrays = (
            *("channel", "visit", "replicate", "verification", "observation", "times_s"),
            *("measured", "points_mm", "tool_offsets_mm", "directions"),
        )
        return replace(
            self,
            **{name: getattr(self, name)[kept] for name in arrays},
            states={name: values[kept] for name, values in self.states.items()},
        )


def observation_rows(verifications: Sequence[Verification]) -> ObservationRows:
    """Lay verifications out as rows.

    A pause within a verification begins another visit if it is longer than `VISIT_GAP_S`, or
    long beside the verification's usual intervals.

    Parameters
    ----------
    verifications
        At least one observation in all.

    Returns
    -------
    ObservationRows
        In the order in which the observations came.

    Raises
    ------
    InvalidContent
        If there is no observation.

    Examples
    --------
    >>> morning = [Observation(t, (1.0,), "EXX", 50.0) for t in (0.0, 60.0, 90000.0)]
    >>> rows = observation_rows([Verification("week 9", morning)])
    >>> rows.visit.tolist(), rows.replicate.tolist()
    ([0, 0, 1], [0, 0, -1])
    """
    flat = [
        (i, j, o, k)
        for i, verification in enumerate(verifications)
        for j, o in enumerate(verification.observations)
        for k in range(len(o.measured))
    ]
    if not flat:
        raise InvalidContent.of_field("observations", "expected at least one, came none")
    names = [o.component or POINT_CHANNELS[k] for _, _, o, k in flat]
    order = {**ORDER, **{name: len(ORDER) + i for i, name in enumerate(POINT_CHANNELS)}}
    channels = tuple(sorted(set(names), key=order.__getitem__))
    number = {name: i for i, name in enumerate(channels)}
    verification = np.array([i for i, *_ in flat], dtype=np.intp)
    times = np.array([o.time_s for *_, o, _ in flat])
    rows = ObservationRows(
        channels=channels,
        channel=np.array([number[name] for name in names], dtype=np.intp),
        visit=_visits(times, verification),
        replicate=np.full(len(flat), -1, dtype=np.intp),
        verification=verification,
        observation=np.array([j for _, j, *_ in flat], dtype=np.intp),
        times_s=times,
        measured=np.array([o.measured[k] for *_, o, k in flat]),
        points_mm=np.array([_point(o) for *_, o, _ in flat]),
        tool_offsets_mm=np.array([o.tool_offset_mm for *_, o, _ in flat], dtype=float),
        directions=np.array([o.directions for *_, o, _ in flat], dtype=float),
        states=_states([o for *_, o, _ in flat]),
        verifications=tuple(verifications),
    )
    return replace(rows, replicate=_replicates(rows))


def repeated_rows(rows: ObservationRows) -> BoolArray:
    """Find rows that say again, to the last digit and second, what another row says.

    Parameters
    ----------
    rows
        All rows.

    Returns
    -------
    ndarray, shape (n,)
        True for all but the first of each; never where nothing was measured yet.
    """
    keys = np.column_stack(
        [
            *(rows.channel, rows.times_s, rows.measured),
            *(_place(rows), rows.tool_offsets_mm, rows.directions),
        ]
    )
    order = np.lexsort(keys.T)  # equal rows stay in their order
    ordered = keys[order]
    repeated = np.zeros(len(rows), dtype=np.bool_)
    repeated[order[1:]] = (ordered[1:] == ordered[:-1]).all(axis=1)
    return repeated & ~rows.is_planned


def _point(o: Observation) -> Triple:
    """Write a component's position as a point of which only one coordinate is known."""
    if o.point_mm is not None:
        return o.point_mm
    axis = COMPONENTS[str(o.component)].axis
    at = np.nan if o.position_mm is None else o.position_mm
    x, y, z = (at if letter == axis else np.nan for letter in LINEAR_LETTERS)
    return (x, y, z)


def _states(observations: Sequence[Observation]) -> dict[str, FloatArray]:
    names = sorted({name for o in observations for name in o.state})
    return {
        name: np.array([o.state.get(name, np.nan) for o in observations], dtype=float)
        for name in names
    }


def _visits(times_s: FloatArray, verification: IntArray) -> IntArray:
    """Number the visits in the order in which they began."""
    begun: list[tuple[float, IntArray]] = []
    for which in np.unique(verification):
        own = np.flatnonzero(verification == which)
        own = own[np.argsort(times_s[own], kind="stable")]
        pauses = np.diff(times_s[own])
        usual_s = float(np.median(pauses[pauses > 0])) if (pauses > 0).any() else VISIT_GAP_S
        limit_s = min(max(PAUSE * usual_s, SHORTEST_PAUSE_S), VISIT_GAP_S)
        breaks = np.flatnonzero(pauses > limit_s) + 1
        begun += [(float(times_s[part[0]]), part) for part in np.split(own, breaks)]
    visits = np.empty(len(times_s), dtype=np.intp)
    for number, (_, part) in enumerate(sorted(begun, key=lambda visit: visit[0])):
        visits[part] = number
    return visits


def _replicates(rows: ObservationRows) -> IntArray:
    """Group what was read again at the same place, from the same side, in the same state, soon."""
    states = [np.nan_to_num(values, nan=np.inf) for _, values in sorted(rows.states.items())]
    keys = np.column_stack(
        [rows.visit, rows.channel, rows.directions, rows.tool_offsets_mm, _place(rows), *states]
    )
    groups: dict[tuple[float, ...], list[int]] = defaultdict(list)
    for row, key in enumerate(map(tuple, keys.tolist())):
        groups[key].append(row)
    found = np.full(len(rows), -1, dtype=np.intp)
    number = 0
    for members in groups.values():
        for together in _soon(members, rows.times_s):
            if len(together) > 1:
                found[together] = number
                number += 1
    return found


def _soon(members: Iterable[int], times_s: FloatArray) -> list[list[int]]:
    """Split repeats where they are too long after the first of them."""
    parts: list[list[int]] = []
    for row in sorted(members, key=lambda row: float(times_s[row])):
        if parts and times_s[row] - times_s[parts[-1][0]] <= REPLICATES_WITHIN_S:
            parts[-1].append(row)
        else:
            parts.append([row])
    return parts


def _place(rows: ObservationRows) -> FloatArray:
    """Places that can be compared: rounded, with one number for what is not known."""
    return np.nan_to_num(np.round(rows.points_mm, SAME_PLACE_DECIMALS), nan=np.inf)
