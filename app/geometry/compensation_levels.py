"""What controllers of different ability leave of the volumetric error (C. Wang, 8.2.1–8.2.4).

A controller takes away what its tables know: displacements alone (8.89–8.91), with
straightness into which squareness is folded (8.92–8.94), with angular errors and their
lever arms (8.95–8.97), or with nonrigid slopes too (8.98–8.100; all three printed with
signs that contradict 8.68–8.82, so that the rule of `volumetric_error` is used).

What angular errors do at the present tool offset is left over by displacement and
straightness tables. Where the map states measuring lines (Hsu 17–25), its translations
contain the angular errors' effect on those lines, and only the difference to them is
left; without them the chapter's convention holds: translations are free of it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated, Any, Final, TypeAlias

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, InstanceOf, PlainSerializer

from app.answer import Answer
from app.arrays import FloatArray
from app.geometry.box_extremes import error_extremes, lattice_size
from app.geometry.components import COMPONENTS, LINEAR_LETTERS, Component, Kind
from app.geometry.error_field import ErrorField
from app.geometry.error_table import PackedTable, Table
from app.geometry.volumetric_error import NO_TOOL, squareness_of
from app.geometry.work_volume import WorkVolume
from app.rounding import Digits, Micro
from app.units import um_from_urad_mm

MOST_POINTS_EACH: Final = 4_000_000
"""Nodes, ends and middles of one level: a second or two."""


class Level(StrEnum):
    """What a controller can compensate, from nothing to everything."""

    NOTHING = "nothing"
    DISPLACEMENT = "displacement"
    STRAIGHTNESS = "straightness"
    ANGULAR = "angular"
    NONRIGID = "nonrigid"


_MEASURED_ALONG_LINES: Final = frozenset({Kind.LINEAR, Kind.STRAIGHTNESS, Kind.SQUARENESS})

_KNOWS: Final[Mapping[Level, frozenset[Kind]]] = {
    Level.NOTHING: frozenset(),
    Level.DISPLACEMENT: frozenset({Kind.LINEAR}),
    Level.STRAIGHTNESS: _MEASURED_ALONG_LINES,
    Level.ANGULAR: _MEASURED_ALONG_LINES | {Kind.ANGULAR},
    Level.NONRIGID: _MEASURED_ALONG_LINES | {Kind.ANGULAR, Kind.SLOPE},
}
"""The kinds of components that each level takes away."""


_Numbers: TypeAlias = Sequence[Micro] | None


@dataclass(frozen=True, slots=True, kw_only=True)
class LevelTable(Answer, whole=False):
    """One table of a controller."""

    component: Annotated[str, Field(examples=["EXY"])]
    """ISO 230-1 code"""
    chapter: Annotated[str, Field(examples=["D_x(y)"])]
    """The chapter's notation"""
    axis: Annotated[str, Field(examples=["y"])]
    """Axis of the positions"""
    positions_mm: Sequence[float]
    """Positions on the axis [mm]"""
    errors_um: _Numbers = None
    """Errors, squareness folded in where the level says so [µm]"""
    errors_urad: _Numbers = None
    """Angular errors [µrad]"""
    slopes_um_per_m: _Numbers = None
    """Nonrigid slopes [µm/m]"""
    slopes_urad_per_m: _Numbers = None
    """Nonrigid slopes [µrad/m]"""
    compensation_um: _Numbers = None
    """Minus the error [µm]"""
    compensation_urad: _Numbers = None
    """Minus the error [µrad]"""
    compensation_um_per_m: _Numbers = None
    """Minus the slope [µm/m]"""
    compensation_urad_per_m: _Numbers = None
    """Minus the slope [µrad/m]"""


def _in_their_units(tables: Mapping[str, Table]) -> list[LevelTable]:
    written = []
    for code, table in tables.items():
        component = COMPONENTS[code]
        errors = np.asarray(table.values)
        numbers: dict[str, Any] = {
            component.error_field: errors.tolist(),
            component.compensation_field: (0.0 - errors).tolist(),
        }
        written.append(
            LevelTable(
                component=code,
                chapter=component.chapter,
                axis=str(component.axis),
                positions_mm=np.asarray(table.positions_mm).tolist(),
                **numbers,
            )
        )
    return written


@dataclass(frozen=True, slots=True)
class CompensationLevel(Answer, published_as="LevelAnswer"):
    """What a controller of one ability takes away, and what it leaves."""

    level: Annotated[Level, Field(examples=["straightness"])]
    """`nothing`, `displacement` (8.89–8.91), `straightness` with squareness folded in (8.92–8.94),
    `angular` (8.95–8.97) or `nonrigid` (8.98–8.100)"""
    mean_um: Micro
    """Mean length of the volumetric error that is left at the lattice's points [µm]"""
    rms_um: Micro
    """Its root mean square at these points [µm]"""
    max_um: Micro
    """Its largest anywhere in the volume [µm]"""
    within_um: Digits | None
    """What the true largest may be beyond `max_um` [µm]; null where the tables have too many nodes
    for that: `max_um` is then sampled, the largest at the lattice's points"""
    tables: Annotated[
        Mapping[str, InstanceOf[Table]],
        PlainSerializer(_in_their_units, return_type=list[LevelTable]),
    ]
    """The tables that such a controller needs"""


def compensation_levels(
    field: ErrorField,
    volume: WorkVolume,
    tool_offset_mm: ArrayLike = NO_TOOL,
    points_per_axis: int = 11,
) -> list[CompensationLevel]:
    """Compare what each kind of controller would leave of the volumetric error.

    Parameters
    ----------
    volume
        The work volume. Mean and rms are of an even lattice of its points, faces, edges
        and corners included; the largest is the true one of the volume (`box_extremes`).
    tool_offset_mm : array-like, shape (3,) [mm]

    Returns
    -------
    list of CompensationLevel
        From nothing to nonrigid. The last leaves nothing of the model.

    Raises
    ------
    InvalidContent
        If the field has several thermal states or the lattice fewer than 2 points.
    """
    field.expect_one_state()
    points = volume.lattice(points_per_axis)
    levels = []
    for level, kinds in _KNOWS.items():
        # The rule is linear in the errors: what is left is the field of the other components.
        residual = field.only(_of_kinds(frozenset(Kind) - kinds))
        lengths = np.linalg.norm(residual.at(points, tool_offset_mm)[0], axis=1)
        longest, within = float(lengths.max()), None
        if lattice_size(residual, volume) <= MOST_POINTS_EACH:
            extremes = error_extremes(residual, volume, tool_offset_mm)
            longest, within = extremes.longest, extremes.within
        levels.append(
            CompensationLevel(
                level=level,
                tables=level_tables(field, volume, level),
                mean_um=float(lengths.mean()),
                rms_um=float(np.sqrt((lengths**2).mean())),
                max_um=longest,
                within_um=within,
            )
        )
    return levels


def level_tables(field: ErrorField, volume: WorkVolume, level: Level) -> dict[str, Table]:
    """Give the tables that a controller of one level needs.

    Returns
    -------
    dict of component code to Table
        Errors [mm, µm or µrad]. No squareness is among them: EXY has SXY·y, EXZ has
        SZX·z and EYZ has SYZ·z in it at every position (8.58–8.60, 8.92–8.94), whose
        positions are its own, in the volume, and the volume's ends.
    """
    field.expect_one_state()
    compensated = field.only(_of_kinds(_KNOWS[level])).tables
    folded = {
        code: Table(positions, values[0])
        for code, (positions, values) in compensated.items()
        if COMPONENTS[code].axis is not None
    }
    # E_x gains SXY·y: as a table over y it is EXY's, and so SZX is EXZ's and SYZ is EYZ's
    # (8.92–8.94).
    for row, times, value in squareness_of(
        {c: float(v[0, 0]) for c, (_, v) in compensated.items()}
    ):
        code = f"E{LINEAR_LETTERS[row]}{LINEAR_LETTERS[times]}".upper()
        folded[code] = _folded(compensated.get(code), float(value), volume.ranges_mm[times])
    return folded


def _folded(
    straightness: PackedTable | None, squareness: float, ends_mm: tuple[float, float]
) -> Table:
    """Add squareness [µm/m] times position to a straightness table [µm]."""
    positions, values = straightness or (np.empty(0), np.zeros((1, 1)))
    low, high = ends_mm
    inside = positions[(positions >= low) & (positions <= high)]
    # With the volume's ends: there a table holds its end value, while squareness goes on to grow.
    nodes: FloatArray = np.union1d(ends_mm, inside)
    at_nodes = np.interp(nodes, positions, values[0]) if positions.size > 1 else values[0, 0]
    return Table(nodes, at_nodes + um_from_urad_mm(squareness) * nodes)


def _of_kinds(kinds: frozenset[Kind]) -> Callable[[Component], bool]:
    return lambda component: component.kind in kinds
