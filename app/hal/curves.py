"""The compensation as LinuxCNC's HAL holds it: curves of at most 16 points, moved slowly.

A curve is what is to be added to the commanded position, motor = commanded + curve [µm], as a
function of one axis. On each axis acts one for every axis: EXX(x) + EXY(y) + EXZ(z) on X of a
machine with three axes, EXX(x) + EXZ(z) on X of a lathe.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

MOST_POINTS = 16
"""Points of HAL's `lincurve`."""

AXES = "xyz"
"""The linear axes that a machine may have."""

CURVES = {f"E{moved}{along}".upper(): (moved, along) for along in AXES for moved in AXES}
"""Component to the axis that it moves, and the axis along which it is a table."""

SQUARENESS = {"SXY": "EXY", "SZX": "EXZ", "SYZ": "EYZ"}
"""Squareness to the curve that it is folded into: E_x gains SXY·y + SZX·z, E_y gains SYZ·z."""

MM_PER_M = 1000.0

NOTHING_UM = 0.005
"""Less is written as 0.00 [µm]."""

Nodes = Mapping[str, Sequence[float]]
"""Axis to the positions of its curves' points [mm], increasing."""

Curves = Mapping[str, Sequence[float]]
"""Component to its compensation at the nodes of its axis [µm]."""


class NotFollowed(Exception):
    """A table that must not move the motors; the sentence says why."""


@dataclass(frozen=True)
class Table:
    """A table of the service as far as the curves hold it.

    Parameters
    ----------
    curves
        Compensation at the nodes [µm], one for each pair of axes; 0 where the service has no
        component.
    deviation_um
        By how much the lines between the nodes differ from the table at most, in either
        direction [µm].
    not_held
        Components that curves of one axis cannot hold, and half of each reversal, in words.
    """

    curves: Curves
    deviation_um: float
    not_held: tuple[str, ...]
    stale: bool
    complete: bool


def curves_between(axes: Iterable[str]) -> dict[str, tuple[str, str]]:
    """Choose the curves of a machine's axes: component to the axis moved, and the axis along.

    Examples
    --------
    >>> list(curves_between("xz"))
    ['EXX', 'EZX', 'EXZ', 'EZZ']
    """
    moving = set(axes)
    return {code: pair for code, pair in CURVES.items() if moving.issuperset(pair)}


def zero_curves(nodes: Nodes) -> Curves:
    """Give the curves that move nothing."""
    return {code: (0.0,) * len(nodes[along]) for code, (_, along) in curves_between(nodes).items()}


def nodes_of(travel_mm: Sequence[float], positions_mm: Iterable[float]) -> tuple[float, ...]:
    """Choose the nodes of an axis: its ends and those of its maps where 16 do, else an even grid.

    Squareness goes on to the ends of the travel, further than a map may.

    Parameters
    ----------
    travel_mm
        Its lowest and highest position [mm].
    positions_mm
        Positions of all its maps [mm], in any order.
    """
    positions = sorted({round(float(mm), 6) for mm in (*travel_mm, *positions_mm)})
    if 2 < len(positions) <= MOST_POINTS:
        return tuple(positions)
    low, high = positions[0], positions[-1]
    step = (high - low) / (MOST_POINTS - 1)
    return tuple(low + number * step for number in range(MOST_POINTS))


def interpolated(at: float, positions: Sequence[float], values: Sequence[float]) -> float:
    """Interpolate linearly at one position; the end values hold beyond.

    Examples
    --------
    >>> interpolated(25.0, [0.0, 100.0], [0.0, 8.0]), interpolated(120.0, [0.0, 100.0], [0.0, 8.0])
    (2.0, 8.0)
    """
    after = bisect_right(positions, at)
    if after == 0 or after == len(positions):
        return values[0 if after == 0 else -1]
    low, high = positions[after - 1], positions[after]
    share = (at - low) / (high - low)
    return values[after - 1] + share * (values[after] - values[after - 1])


def table_of(answer: Mapping[str, Any], nodes: Nodes, limit_um: float) -> Table:
    """Read the service's answer as curves.

    Both directions of a component share a curve, their mean. Squareness is folded into
    straightness.

    Parameters
    ----------
    answer
        The compensation table at the latest reading, as the service's JSON has it.
    limit_um
        What no axis may be moved by anywhere [µm].

    Raises
    ------
    NotFollowed
        If an axis would be moved further than the limit.
    """
    curves = {code: list(values) for code, values in zero_curves(nodes).items()}
    deviation, not_held = 0.0, []
    for row in answer["components"]:
        code = row["component"]
        if code in curves:
            nodes_mm = nodes[CURVES[code][1]]
            positions, forward = row["positions_mm"], row["compensation_um"]
            backward = row.get("backward_compensation_um") or forward
            means = [(a + b) / 2.0 for a, b in zip(forward, backward)]
            not_held += halves_told({code: largest_half(forward, backward)})
            curve = [interpolated(at, positions, means) for at in nodes_mm]
            for position, *sides in zip(positions, forward, backward):
                here = interpolated(position, nodes_mm, curve)
                deviation = max(deviation, *(abs(here - value) for value in sides))
            curves[code] = [a + b for a, b in zip(curves[code], curve)]
        elif SQUARENESS.get(code) in curves:
            folded = curves[SQUARENESS[code]]
            slope = row["compensation_um_per_m"] / MM_PER_M
            for number, at in enumerate(nodes[CURVES[SQUARENESS[code]][1]]):
                folded[number] += slope * at
        else:
            not_held.append(code)
    for axis, largest in largest_moves(curves).items():
        if not largest <= limit_um:  # not a number is beyond every limit
            raise NotFollowed(
                f"expected a compensation of {axis.upper()} within ±{limit_um:g} µm, got one of up "
                f"to {largest:.1f} µm: it is not followed"
            )
    return Table(curves, deviation, tuple(not_held), answer["stale"], answer["complete"])


def largest_half(forward: Sequence[float], backward: Sequence[float]) -> float:
    """Give half of the largest difference between both directions [as stated]."""
    return max(abs(b - a) for a, b in zip(forward, backward)) / 2.0


def halves_told(halves_um: Mapping[str, float]) -> list[str]:
    """Say what curves lack that both directions share: component to half of its reversal [µm].

    Examples
    --------
    >>> halves_told({"EXX": 2.0, "EYY": 0.001})
    ['half of the reversal of EXX, up to 2.00 µm']
    """
    return [
        f"half of the reversal of {code}, up to {half_um:.2f} µm"
        for code, half_um in halves_um.items()
        if half_um >= NOTHING_UM
    ]


def largest_moves(curves: Curves) -> dict[str, float]:
    """Bound how far curves move each axis, wherever the machine stands [µm]."""
    moves: dict[str, float] = {}
    for code, values in curves.items():
        moved, _ = CURVES[code]
        moves[moved] = moves.get(moved, 0.0) + max(abs(value) for value in values)
    return moves


def between(curves: Curves, other: Curves) -> Curves:
    """Subtract curves from others, node by node [µm]."""
    return {
        code: tuple(b - a for a, b in zip(values, other[code])) for code, values in curves.items()
    }


def stepped(present: Curves, target: Curves, most_um: float) -> Curves:
    """Go from held curves towards others, all in proportion, by a step that marks no surface.

    Parameters
    ----------
    most_um
        What no axis moves by more than, at whatever position the machine stands [µm].
    """
    change = between(present, target)
    # The curves that move an axis are largest at places of their own: the sum of these is a bound
    # that holds wherever the machine stands. One share for all curves, so that what lies on the way
    # is a mean of two tables, and no component arrives before another.
    largest = max(largest_moves(change).values())
    if largest <= most_um:
        return target
    share = most_um / largest
    return {
        code: tuple(a + share * d for a, d in zip(values, change[code]))
        for code, values in present.items()
    }


@dataclass
class Following:
    """The motors on their way to the last table that the service gave.

    Nothing but `step` moves them, and it never by more than `most_um`: not at the start, not when
    the service comes back after hours, not when the compensation is switched on or off.

    Parameters
    ----------
    nodes
        Where the curves' points are [mm].
    held
        What the curves hold now [µm].
    most_um
        What a step moves an axis by at most [µm].
    patience_s
        How long after an answer the table counts as that of now [s].
    """

    nodes: Nodes
    held: Curves
    most_um: float
    patience_s: float
    table: Table | None = field(default=None, init=False)
    answered_at: float = field(default=float("-inf"), init=False)

    def answered(self, table: Table | None, now_s: float) -> None:
        """Take an answer of the service; None says that the table is the one before."""
        self.table = table or self.table
        self.answered_at = now_s

    def step(self, active: bool) -> Curves:
        """Move one step: to the table, or to nothing where the compensation is not active.

        Until a first table has come, an active one is held as it was found.
        """
        self.held = stepped(self.held, self._target(active), self.most_um)
        return self.held

    def to_go_um(self, active: bool) -> float:
        """Bound how far any axis still is from where it goes [µm]."""
        return max(largest_moves(between(self.held, self._target(active))).values())

    def is_stale(self, now_s: float) -> bool:
        """Say whether what is held may be other than what the machine needs now."""
        late = now_s - self.answered_at > self.patience_s
        return self.table is None or late or self.table.stale

    def _target(self, active: bool) -> Curves:
        if not active:
            return zero_curves(self.nodes)
        return self.table.curves if self.table else self.held
