"""The volumetric error as a function of position: tables in, errors at many points out.

Made once for a thermal state (or several that share their positions), then asked for
as many points as wanted: one search per axis, one fetch per component, and the sum
over axes with their lever arms, in pieces that stay in the processor's cache.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from app.arrays import FloatArray
from app.errors import InvalidContent
from app.geometry.axis_table import AxisTable
from app.geometry.chain import Chain
from app.geometry.components import COMPONENTS, LINEAR_LETTERS, Component
from app.geometry.error_table import (
    PackedTable,
    Table,
    bounded,
    checked_table,
    union_of_positions,
)
from app.geometry.measuring_line import MeasuringLines
from app.geometry.volumetric_error import (
    NO_TOOL,
    Squareness,
    as_points,
    as_tool_offset,
    squareness_of,
    sum_over_axes,
    tool_direction,
)

POINTS_AT_ONCE: Final = 16384
"""Fewer cost more calls of numpy, more no longer stay in the processor's cache."""


@dataclass(frozen=True, slots=True, eq=False)
class ErrorField:
    """The volumetric error of a machine at one thermal state or at several.

    Parameters
    ----------
    tables
        Component code to positions [mm] and values of shape (s, k).
    states
        Number s of states; None where there is one and answers have no axis for it.
    """

    chain: Chain
    tables: Mapping[str, PackedTable]
    measuring_lines: MeasuringLines
    states: int | None
    _axes: Mapping[str, AxisTable]
    _squareness: tuple[Squareness, ...]

    @classmethod
    def make(
        cls,
        chain: Chain,
        tables: Mapping[str, Table],
        measuring_lines: MeasuringLines | None = None,
    ) -> ErrorField:
        """Check and pack the tables of all components.

        Parameters
        ----------
        tables
            Component code to table [mm, the component's unit]. Components left out
            count as zero; rotary-axis locations are not the linear axes' and are
            left aside.

        Raises
        ------
        InvalidContent
            If a table is not finite, not increasing or of unequal length, or if two
            tables differ in their number of states.

        Examples
        --------
        >>> field = ErrorField.make(
        ...     Chain.parse("FXYZ"),
        ...     {"EBX": Table([0.0, 100.0], [0.0, 20.0]), "SXY": Table((), 5.0)},
        ... )
        >>> errors_um, orientation_urad = field.at([[50.0, 100.0, 200.0]])
        >>> errors_um.tolist(), orientation_urad.tolist()
        ([[2.5, 0.0, 0.0]], [[10.0, 0.0, 0.0]])
        """
        checked = {code: checked_table(code, table) for code, table in tables.items()}
        counts = {values.shape[0] for _, values in checked.values() if values.ndim == 2}
        if len(counts) > 1:
            raise InvalidContent.of_field(
                "tables", f"expected one number of thermal states, got {sorted(counts)}"
            )
        states = counts.pop() if counts else None
        # Views without a copy: a component that is the same in all states is stored once.
        shared = {
            code: (positions, np.broadcast_to(values, (states or 1, values.shape[-1])))
            for code, (positions, values) in checked.items()
        }
        return cls._packed(chain, shared, measuring_lines or {}, states)

    @classmethod
    def _packed(
        cls,
        chain: Chain,
        tables: Mapping[str, PackedTable],
        measuring_lines: MeasuringLines,
        states: int | None,
    ) -> ErrorField:
        axes = {axis: packed for axis in chain.axes if (packed := _axis_table(axis, tables))}
        squareness = tuple(
            # The first value of every table, also of those over positions: `squareness_of` takes
            # only the codes that have no axis.
            squareness_of({code: float(values[state, 0]) for code, (_, values) in tables.items()})
            for state in range(states or 1)
        )
        return cls(chain, tables, measuring_lines, states, axes, squareness)

    def only(self, wanted: Callable[[Component], bool]) -> ErrorField:
        """Keep some components: what a controller knows, or what a definition counts."""
        selected = {code: t for code, t in self.tables.items() if wanted(COMPONENTS[code])}
        return self._packed(self.chain, selected, self.measuring_lines, self.states)

    def at(
        self, points_mm: ArrayLike, tool_offset_mm: ArrayLike = NO_TOOL
    ) -> tuple[FloatArray, FloatArray]:
        """Sum all component errors at points of the work volume.

        Parameters
        ----------
        points_mm : array-like, shape (n, 3) [mm]
            Nominal positions x, y, z. Outside a table its end values hold.
        tool_offset_mm : array-like, shape (3,) or (n, 3) [mm]

        Returns
        -------
        errors_um : ndarray, shape (n, 3), or (s, n, 3) for several states [µm]
            Actual minus nominal position of the tool in the workpiece's coordinates.
        orientation_urad : ndarray, same shape [µrad]
            Error of the tool's direction, (ΣEB, −ΣEA, 0).

        Raises
        ------
        InvalidContent
            If points or tool offsets are not finite or do not have three coordinates.

        Notes
        -----
        The rule and its sign convention are `volumetric_error`'s. Beside the answer
        no more memory is needed than for a few thousand points.
        """
        return self._sum(points_mm, tool_offset_mm, tool_direction)

    def rotation_at(self, points_mm: ArrayLike) -> FloatArray:
        """Sum the rotations of all axes (8.115–8.117, with nonrigid slopes).

        Parameters
        ----------
        points_mm : array-like, shape (n, 3) [mm]
            Nominal positions x, y, z.

        Returns
        -------
        ndarray, shape (n, 3), or (s, n, 3) for several states [µrad]
            ΣEA, ΣEB, ΣEC, positive by the right-hand rule.
        """
        return self._sum(points_mm, NO_TOOL, lambda rotation: rotation)[1]

    def expect_one_state(self) -> None:
        """Refuse several thermal states where a question is about one."""
        if self.states is not None:
            raise InvalidContent.of_field(
                "tables", f"expected one thermal state, got an axis of {self.states}"
            )

    def nodes_mm(self, axis: str) -> FloatArray:
        """Give the positions of one axis between which its errors are straight lines.

        Returns
        -------
        ndarray, shape (k,) [mm]
            Increasing; empty where no error depends on that axis' position.
        """
        return union_of_positions(
            table for code, table in self.tables.items() if COMPONENTS[code].axis == axis
        )

    def _sum(
        self,
        points_mm: ArrayLike,
        tool_offset_mm: ArrayLike,
        reading: Callable[[FloatArray], FloatArray],
    ) -> tuple[FloatArray, FloatArray]:
        """Sum errors [µm], and what is to be read from the rotations [µrad], in pieces."""
        points = bounded("points_mm", as_points(points_mm))
        tool = bounded("tool_offset_mm", as_tool_offset(tool_offset_mm, len(points)))
        errors = np.empty((self.states or 1, *points.shape))
        turned = np.empty_like(errors)
        # In pieces and by rows of coordinates: each step below then reads memory in one direction,
        # and what it made before is still in the cache.
        for start in range(0, len(points), POINTS_AT_ONCE):
            piece = slice(start, start + POINTS_AT_ONCE)
            here = np.ascontiguousarray(points[piece].T)
            tool_here = tool if tool.ndim == 1 else np.ascontiguousarray(tool[piece].T)
            for state, (total, rotation) in enumerate(self._sum_states(here, tool_here)):
                _write(errors[state, piece], total)
                _write(turned[state, piece], reading(rotation))
        return (errors[0], turned[0]) if self.states is None else (errors, turned)

    def _sum_states(
        self, points_mm: FloatArray, tool_offset_mm: FloatArray
    ) -> list[tuple[FloatArray, FloatArray]]:
        """Ask the rule for every state: the search among positions is the same for all."""
        located = {
            axis: packed.locate(points_mm[LINEAR_LETTERS.index(axis)])
            for axis, packed in self._axes.items()
        }
        return [
            sum_over_axes(
                self.chain,
                {axis: packed.read(state, located[axis]) for axis, packed in self._axes.items()},
                squareness,
                points_mm,
                tool_offset_mm,
                self.measuring_lines,
            )
            for state, squareness in enumerate(self._squareness)
        ]


def _axis_table(axis: str, tables: Mapping[str, PackedTable]) -> AxisTable | None:
    """Bring one axis' tables to the union of their positions; None where there are none."""
    moving = {c: table for c, table in tables.items() if COMPONENTS[c].axis == axis}
    if not moving:
        return None
    nodes = union_of_positions(moving.values())
    # Of single values alone: one node, wherever it is, for they hold at all positions.
    nodes = nodes if nodes.size else np.zeros(1)
    blocks: dict[str | None, FloatArray] = {}
    for code, (positions, values) in moving.items():
        component = COMPONENTS[code]
        block = blocks.setdefault(component.times, np.zeros((len(values), 6, nodes.size)))
        for state, row in enumerate(values):
            # A table that is shorter than the union goes on with its end values.
            at_nodes = np.interp(nodes, positions, row) if positions.size > 1 else row
            block[state, component.row] = at_nodes
    return AxisTable(nodes, blocks)


def _write(answer: FloatArray, rows: FloatArray) -> None:
    """Write rows (3, n) into an answer (n, 3): numpy is slow at this in one statement."""
    for i, row in enumerate(rows):
        answer[:, i] = row
