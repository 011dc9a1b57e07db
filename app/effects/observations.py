"""Verifications of a machine, laid out as rows: one number that an instrument read in each.

A row belongs to a channel (a component's code, or one direction of the volumetric error at
points), to a visit (what was measured with one set-up) and to a block: rows of one visit at
about one time, at which temperatures are what they are.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final, TypeAlias

import numpy as np

from app.arrays import BoolArray, FloatArray, IntArray
from app.effects.conditions import StatedStates
from app.errors import InvalidContent, counted, list_names
from app.geometry.components import COMPONENTS, LINEAR_LETTERS, ORDER
from app.measurement.stated_numbers import suspiciously_small
from app.search.rows import Datum
from app.search.scatter import blocks_in_time
from app.units import SECONDS_PER_MIN, Unit, iso_time

Triple: TypeAlias = tuple[float, float, float]

POINT_CHANNELS: Final = ("points x", "points y", "points z")
"""The volumetric error's three directions [µm]."""

REPLICATES_WITHIN_S: Final = 120.0
"""Repeats further apart than this have lived through something else [s]: a spindle's nose moves by
micrometres in minutes."""

LIKELY_REPEATABILITY_UM: Final = (0.005, 50.0)
"""From a good laser's to a dial gauge's with much to spare; beyond, the unit may be another."""

SAME_PLACE_DECIMALS: Final = 6
"""Places that agree to a nanometre are one."""

MOST_OBSERVATIONS: Final = 100_000
"""Of one verification."""

MOST_STATE_VALUES: Final = 4_000_000
"""Names of states times observations: a table of both is stored and searched."""


def refuse_many_states(names: int, observations: int) -> None:
    """Refuse what would fill the memory where each observation may state names of its own."""
    if names * observations > MOST_STATE_VALUES:
        raise InvalidContent.of_field(
            "state",
            f"expected at most {MOST_STATE_VALUES // observations} names of states for "
            f"{observations} observations, got {names}",
        )


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
    directions
        Approach of x, y, z: +1, −1, 0 where it is not known.
    state
        The machine's state, where the shop stated it beside the observation.
    setup
        Of several set-ups in a verification, the one that it belongs to; None: not stated.
    """

    time_s: float
    measured: tuple[float, ...]
    component: str | None = None
    position_mm: float | None = None
    point_mm: Triple | None = None
    tool_offset_mm: Triple = (0.0, 0.0, 0.0)
    directions: tuple[int, int, int] = (0, 0, 0)
    state: Mapping[str, float] = field(default_factory=dict)
    setup: str | None = None

    def __post_init__(self) -> None:
        known = self.component is not None and self.component in COMPONENTS
        if (self.point_mm is None) is not known or len(self.measured) != (1 if known else 3):
            raise InvalidContent.of_field(
                "observations",
                "expected a component of the table and one measured value, or a point and "
                f"three, got component {self.component!r}, point {self.point_mm} and "
                f"{len(self.measured)} values",
            )
        if known and self.position_mm is None and COMPONENTS[str(self.component)].is_table:
            raise InvalidContent.of_field(
                "observations", f"expected position_mm of {self.component} in mm, got none"
            )


@dataclass(frozen=True, slots=True)
class Verification:
    """Observations, and what their zero means.

    They were taken with one set-up, whatever the pauses between them, unless observations state
    several: no pause says by itself that somebody mounted the instrument again.

    Parameters
    ----------
    observations
        In any order.
    repeatability_um
        Standard deviation of one observation [µm], where the shop knows it.
    is_planned
        Whether it is yet to be measured: its values stand for nothing.
    instrument, operator
        What measured, and who: for its certificate alone.
    """

    label: str
    observations: Sequence[Observation]
    datum: Datum = Datum.ABSOLUTE
    repeatability_um: float | None = None
    is_planned: bool = False
    instrument: str | None = None
    operator: str | None = None

    @property
    def remarks(self) -> list[str]:
        """Say what is taken as it came although it may be a mistake."""
        return [
            *self._sizes(),
            *self._unlikely_repeatability(),
            *self._copies(),
            *self._lacking_setups(),
        ]

    def _sizes(self) -> Iterable[str]:
        """Note lengths so small that they may be in mm."""
        lengths = [
            value
            for one in self.observations
            if one.component is None or COMPONENTS[one.component].unit is Unit.UM
            for value in one.measured
        ]
        if lengths and not self.is_planned:
            yield from suspiciously_small("measured_um", np.array(lengths))

    def _unlikely_repeatability(self) -> Iterable[str]:
        """Ask about a repeatability that no instrument has: everything is judged by it."""
        stated = self.repeatability_um
        low, high = LIKELY_REPEATABILITY_UM
        if stated is not None and not low <= stated <= high:
            meant = "mm" if stated < low else "nm"
            yield (
                f"A repeatability of {stated:g} µm is stated (repeatability_um): is it in {meant}? "
                f"From {low:g} to {high:g} µm is usual"
            )

    def _copies(self) -> Iterable[str]:
        """Name lines of one time and place.

        A machine is at one place at a time and has one error there, so that they are copies as a
        rule: as repeats they would make the noise too small.
        """
        times = Counter(
            (o.time_s, o.component, o.position_mm, o.point_mm, o.tool_offset_mm, o.directions)
            for o in self.observations
        )
        copied = [seen for seen, count in times.items() if count > 1]
        if not copied:
            return
        time_s, component, position_mm, point_mm, *_ = copied[0]
        where = (
            f"the point {list_names(map('{:g}'.format, point_mm))} mm" if point_mm else component
        )
        at = "" if position_mm is None else f" at {position_mm:g} mm"
        more = sum(times[seen] - 1 for seen in copied)
        yield (
            f"{counted(more, 'observation has', 'observations have')} the time, place and "
            f"direction of another one; the first is of {where}{at}, {iso_time(time_s)}. They "
            "count as repeats: if they are copies, the noise will seem smaller than it is"
        )

    def _lacking_setups(self) -> Iterable[str]:
        """Name lines without a set-up beside others with one.

        Whoever fills in the first line of each set-up only, as in a spreadsheet, means the lines
        below too; as they stand they are one more set-up, of pieces of all the others.
        """
        lacking = sum(not o.setup for o in self.observations)
        if 0 < lacking < len(self.observations):
            yield (
                f"{counted(lacking, 'observation names', 'observations name')} no set-up beside "
                "others that do: together they count as one more set-up. Where lines below a named "
                "set-up belong to it, its name must stand in each of them"
            )


@dataclass(frozen=True, eq=False)
class ObservationRows:
    """All observations as rows, one number each.

    Parameters
    ----------
    channels
        Names of the channels: component codes, then those of `POINT_CHANNELS`.
    channel, visit, replicate : ndarray, shape (n,)
        Numbers of the channel, of the visit (a verification, or what it states as a set-up;
        growing with time), and of the group of repeats within it (−1: none).
    verification, observation : ndarray, shape (n,)
        Where a row comes from.
    times_s : ndarray, shape (n,) [s]
    measured : ndarray, shape (n,)
        [the channel's unit]
    points_mm : ndarray, shape (n, 3) [mm]
        Where; only the own axis' coordinate is known for a component.
    tool_offsets_mm : ndarray, shape (n, 3) [mm]
        With which tool offset.
    directions : ndarray, shape (n, 3)
        Approach of x, y, z: +1, −1 or 0.
    states
        States that were stated beside the observations, else NaN.
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
    states: StatedStates
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
    def channels_left(self) -> tuple[str, ...]:
        """The channels that have a row: others had none that could be judged."""
        return tuple(self.channels[i] for i in np.unique(self.channel).tolist())

    @property
    def components(self) -> tuple[str, ...]:
        """The components that were observed by themselves."""
        return tuple(name for name in self.channels_left if name not in POINT_CHANNELS)

    @property
    def visits(self) -> int:
        """How many visits there are."""
        return len(np.unique(self.visit))

    def visit_label(self, visit: int) -> str:
        """Name a visit: by its verification, and by the set-up where that states several."""
        first = int(np.argmax(self.visit == visit))
        verification = self.verifications[int(self.verification[first])]
        setup = verification.observations[int(self.observation[first])].setup
        return verification.label if setup is None else f"{verification.label}, {setup}"

    @cached_property
    def block(self) -> IntArray:
        """Number of each row's block: rows of one visit at about one time; shape (n,)."""
        return blocks_in_time(self.visit, self.times_s / SECONDS_PER_MIN)

    def of_channel(self, name: str) -> IntArray:
        """List the rows of a channel."""
        if name not in self.channels:
            return np.empty(0, dtype=np.intp)
        return np.flatnonzero(self.channel == self.channels.index(name))

    def datum(self) -> dict[tuple[int, int], Datum]:
        """Say for each visit and channel whose zero is not absolute what it means."""
        # As one number each: numpy sorts rows many times slower, and lets nobody else run.
        numbers, first = np.unique(
            self.visit * len(self.channels) + self.channel, return_index=True
        )
        which = self.verification[first].tolist()
        datums = [self.verifications[number].datum for number in which]
        return {
            divmod(number, len(self.channels)): datum
            for number, datum in zip(numbers.tolist(), datums, strict=True)
            if datum is not Datum.ABSOLUTE
        }

    @property
    def is_planned(self) -> BoolArray:
        """Which rows are yet to be measured, shape (n,)."""
        planned = np.array([v.is_planned for v in self.verifications], dtype=np.bool_)
        return planned[self.verification]

    @property
    def has_own_zero(self) -> BoolArray:
        """Which rows have a zero of their visit's own, shape (n,)."""
        own = np.array([v.datum is not Datum.ABSOLUTE for v in self.verifications], dtype=np.bool_)
        return own[self.verification]

    def take(self, kept: BoolArray) -> ObservationRows:
        """Keep some rows; channels and visits keep their numbers.

        Parameters
        ----------
        kept : ndarray, shape (n,)
        """
        arrays = (
            *("channel", "visit", "replicate", "verification", "observation"),
            *("times_s", "measured", "points_mm", "tool_offsets_mm", "directions"),
        )
        return replace(
            self,
            **{name: getattr(self, name)[kept] for name in arrays},
            states=StatedStates([self.states.stated[int(i)] for i in np.flatnonzero(kept)]),
        )


def observation_rows(verifications: Sequence[Verification]) -> ObservationRows:
    """Lay verifications out as rows.

    Returns
    -------
    ObservationRows
        In the order in which the observations came.

    Examples
    --------
    >>> morning = [Observation(t, (1.0,), "EXX", 50.0) for t in (0.0, 60.0, 90000.0)]
    >>> again = Observation(180000.0, (1.0,), "EXX", 50.0, setup="again")
    >>> rows = observation_rows([Verification("week 9", [*morning, again])])
    >>> rows.visit.tolist(), rows.replicate.tolist()
    ([0, 0, 0, 1], [0, 0, -1, -1])
    """
    flat = [
        (i, j, o, k)
        for i, verification in enumerate(verifications)
        for j, o in enumerate(verification.observations)
        for k in range(len(o.measured))
    ]
    if not flat:
        raise InvalidContent.of_field("observations", "expected at least one, got none")
    names = [o.component or POINT_CHANNELS[k] for _, _, o, k in flat]
    order = {**ORDER, **{name: len(ORDER) + i for i, name in enumerate(POINT_CHANNELS)}}
    channels = tuple(sorted(set(names), key=order.__getitem__))
    number = {name: i for i, name in enumerate(channels)}
    verification = np.array([i for i, *_ in flat], dtype=np.intp)
    setups = {key: i for i, key in enumerate(dict.fromkeys((i, o.setup) for i, _, o, _ in flat))}
    setup = np.array([setups[i, o.setup] for i, _, o, _ in flat], dtype=np.intp)
    times = np.array([o.time_s for *_, o, _ in flat])
    rows = ObservationRows(
        channels=channels,
        channel=np.array([number[name] for name in names], dtype=np.intp),
        visit=_in_time(times, setup),
        replicate=np.full(len(flat), -1, dtype=np.intp),
        verification=verification,
        observation=np.array([j for _, j, *_ in flat], dtype=np.intp),
        times_s=times,
        measured=np.array([o.measured[k] for *_, o, k in flat]),
        points_mm=np.array([_point(o) for *_, o, _ in flat]),
        tool_offsets_mm=np.array([o.tool_offset_mm for *_, o, _ in flat], dtype=float),
        directions=np.array([o.directions for *_, o, _ in flat], dtype=float),
        states=StatedStates([o.state for *_, o, _ in flat]),
        verifications=tuple(verifications),
    )
    return replace(rows, replicate=_replicates(rows))


def repeated_rows(rows: ObservationRows) -> BoolArray:
    """Find rows that say again, to the last digit and second, what another row says.

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


def _in_time(times_s: FloatArray, setup: IntArray) -> IntArray:
    """Number set-ups anew, in the order in which they began."""
    begun_s = [float(times_s[setup == number].min()) for number in range(setup.max() + 1)]
    place = np.empty(len(begun_s), dtype=np.intp)
    place[np.argsort(begun_s, kind="stable")] = np.arange(len(begun_s))
    return place[setup]


def _replicates(rows: ObservationRows) -> IntArray:
    """Group what was read again at the same place, from the same side, in the same state, soon."""
    numbers: dict[tuple[tuple[str, float], ...], int] = {}
    state = [numbers.setdefault(tuple(sorted(s.items())), len(numbers)) for s in rows.states.stated]
    keys = np.column_stack(
        [rows.visit, rows.channel, rows.directions, rows.tool_offsets_mm, _place(rows), state]
    )
    groups: dict[tuple[float, ...], list[int]] = defaultdict(list)
    for row, key in enumerate(map(tuple, keys.tolist())):
        groups[key].append(row)
    found = np.full(len(rows), -1, dtype=np.intp)
    number = 0
    for members in groups.values():
        for together in _within_replicate_time(members, rows.times_s):
            if len(together) > 1:
                found[together] = number
                number += 1
    return found


def _within_replicate_time(members: Iterable[int], times_s: FloatArray) -> list[list[int]]:
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
