"""The plots of each component, those that move it most first; a choice of which are shown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from app.errors import counted
from app.geometry.components import COMPONENTS
from app.identification.analysis.residual_curves import ComponentCurves, ResidualCurve
from app.identification.analysis.residual_report import ResidualFigures, Size
from app.pages.report_parts.component_names import component_name
from app.pages.report_parts.drawing import Drawing
from app.pages.report_parts.words import decimals_for, figure_text
from app.pages.residuals_page.curve_plots import TIME, curve_drawing, extent_of, movement

MOST_OPEN: Final = 6
"""Components whose plots are drawn without being asked for, and plots of each."""

ALL: Final = "all"


@dataclass(frozen=True, slots=True)
class Block:
    """The plots of one component, or of all lengths."""

    place: str
    size: Size
    drawings: Sequence[Drawing]
    beyond: int
    is_open: bool

    @property
    def name(self) -> str:
        """The component, as plain text."""
        name = self.size.component
        return "all lengths together" if name == ALL else component_name(name)

    @property
    def first(self) -> Sequence[Drawing]:
        """The plots that are shown at once."""
        return self.drawings[:MOST_OPEN]

    @property
    def further(self) -> Sequence[Drawing]:
        """Those that are folded away."""
        return self.drawings[MOST_OPEN:]

    @property
    def summary(self) -> str:
        """How large the residuals are, as plain text."""
        size = self.size
        decimals = decimals_for(size.repeatability)
        sizes = (size.mean, size.rms, size.repeatability)
        mean, rms, noise = (figure_text(one, decimals) for one in sizes)
        text = f"{counted(size.count, 'value')}: RMS {rms} {size.unit}, mean {mean}"
        text += f", repeatability {noise}." if size.repeatability else "."
        if not any(trace["name"] == "single values" for d in self.drawings for trace in d.data):
            return f"{text} There are too many to draw them one by one."
        outside = f"{counted(self.beyond, 'value')} outside the plots." if self.beyond else ""
        return f"{text} {outside}".rstrip()


def component_blocks(figures: ResidualFigures, curves: Sequence[ComponentCurves]) -> list[Block]:
    """Draw the components that have something to be drawn over.

    Parameters
    ----------
    curves
        Of each component, and of all lengths: component and curves.

    Returns
    -------
    list of Block
        The largest for their repeatability first; at the end all lengths together.
    """
    sizes = {size.component: size for size in figures.components}
    if figures.overall is not None:
        sizes[ALL] = figures.overall
    drawn = [(sizes[c.component], c.curves) for c in curves if c.curves]
    drawn.sort(key=lambda one: (one[0].component == ALL, -one[0].ratio))
    return [
        _block(number, size, own, is_open=number < MOST_OPEN and size.component != ALL)
        for number, (size, own) in enumerate(drawn)
    ]


def _block(number: int, size: Size, curves: Sequence[ResidualCurve], *, is_open: bool) -> Block:
    moved = [(movement(curve), curve) for curve in curves]
    moved.sort(key=lambda one: -one[0])
    kept = {TIME, *_own_positions(size.component)}
    first = [one for one in moved if one[1].over in kept]
    first += [one for one in moved if one[1].over not in kept][: MOST_OPEN - len(first)]
    shown = {one[1].over for one in first}
    order = [one for one in moved if one[1].over in shown]
    order += [one for one in moved if one[1].over not in shown]
    extent = extent_of(curves, size)
    place = f"component-{number}"
    drawings = [
        curve_drawing(f"{place}-{i}", curve, size, extent, by)
        for i, (by, curve) in enumerate(order)
    ]
    values = max((curve.residual for curve in curves), key=len)
    top = drawings[0].layout["yaxis"]["range"][1]
    return Block(place, size, drawings, sum(abs(v) > top for v in values), is_open)


def _own_positions(component: str) -> list[str]:
    """Name the positions that a component's plots always begin with."""
    if component not in COMPONENTS:
        return []
    axis = COMPONENTS[component].axis
    return [] if axis is None else [f"position {axis} [mm]"]
