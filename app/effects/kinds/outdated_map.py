"""The tables no longer hold: a shift, a slope, both, or a profile, constant in time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np

from app.effects.campaign_view import CampaignView
from app.effects.driver import Always
from app.effects.effect import Effect
from app.effects.hypothesis import Amplitude
from app.effects.kind import EffectKind, Proposed, additive
from app.effects.shape import Everywhere, Profile, Rising, Shape
from app.effects.words import parameter, size_along, symbol_of
from app.geometry.components import COMPONENTS

SHIFT, SLOPE, LINE, BOW, PROFILE = "shift", "slope", "straight line", "bow", "profile"
MOST_CORNERS: Final = 9


class OutdatedMap(EffectKind):
    """The same deviation from all maps, whatever the temperatures and the time."""

    kind = "outdated-map"
    text = "the tables no longer hold: a shift, a slope, both, or a profile"
    constant = True
    measured_along = True
    drawn_over = "position"
    remedy = "Measure a new map of {components}; until then the correction may be adopted."
    shown_by = "measure a new map of {component}"
    against = {
        "wrong-map": "measure {component} at the temperature of another map: one that is wrong "
        "alone does not show there",
        "temperature-curvature": "measure {component} at the temperature of one of the maps: an "
        "outdated map is wrong there too",
        "step": "find out whether {component} was still right early in the campaign",
    }

    def propose(self, view: CampaignView) -> Proposed:
        """Every component in all forms but the bow: all visits tell of its profile."""
        for code in view.components:
            for form in forms_of(view, code, view.shapes(code)):
                if form.name != BOW:
                    yield additive(
                        *(self.kind, code, Always(), form.shapes, form.amplitudes),
                        variant=form.name,
                        standing=True,
                        within_visit=form.name not in (SHIFT, LINE),
                    )

    def explain(self, effect: Effect) -> str:
        """Say how far the tables are off."""
        (code,) = effect.components
        return f"the maps of {code} no longer hold: they are {how_far_off(effect, effect.variant)}"


class Form(NamedTuple):
    """How a table may be off: along which shapes, and what their amplitudes are called."""

    name: str
    shapes: Sequence[Shape]
    amplitudes: tuple[Amplitude, ...]


def forms_of(view: CampaignView, code: str, shapes: Sequence[Shape]) -> Iterator[Form]:
    """List the forms in which a component's table may be off; a single value can only shift.

    What drives a component along a straight line, and hardly changes in the campaign, is this
    as well: without a form for both, it would be called after what drives it.

    Parameters
    ----------
    shapes
        The smooth ones that can be seen, of `CampaignView.shapes`.
    """
    rising = [shape for shape in shapes if isinstance(shape, Rising)]
    if len(shapes) > len(rising):
        yield _form(code, SHIFT, [Everywhere()], ["shift"])
    if rising:
        yield _form(code, SLOPE, rising, ["slope_at_end"])
    has_zero = not view.rows.has_own_zero[view.projection.view(code).rows].all()
    if rising and has_zero:
        yield _form(code, LINE, [Everywhere(), *rising], ["shift", "shift_rise"])
    corners = _corners(view, code)
    if rising and has_zero and len(corners) > 2:
        bowed = [Everywhere(), *rising, _bow(corners)]
        yield _form(code, BOW, bowed, ["shift", "shift_rise", "bow"])
    seen = _seen(view, code, corners)
    if rising and len(seen) > 2:
        names = [f"profile_at_{x:g}_mm" for x in seen]
        yield _form(code, PROFILE, _hats(seen), names)


def how_far_off(effect: Effect, form: str) -> str:
    """Say how far a table is off in a form."""
    unit = symbol_of(effect.components[0])
    if form == PROFILE:
        off = max(effect.parameters.values(), key=abs)
        return f"off by up to {off:.2g} {unit}"
    if form in (LINE, BOW):
        line = f"shifted by {size_along(effect, 'shift', unit)}"
        if form == LINE:
            return line
        (bow,) = (name for name in effect.parameters if name.startswith("bow_"))
        return f"{line}, and bowed by {parameter(effect, bow, unit)} from the middle to either end"
    (name,) = effect.parameters
    how = parameter(effect, name, unit)
    if form == SHIFT:
        return f"shifted by {how}"
    return f"off by {how} at the upper end of travel, and by the opposite at the lower end"


def _form(code: str, name: str, shapes: Sequence[Shape], stems: Sequence[str]) -> Form:
    unit = COMPONENTS[code].unit
    return Form(name, shapes, tuple(Amplitude(f"{stem}_{unit}") for stem in stems))


def _corners(view: CampaignView, code: str) -> tuple[float, ...]:
    """Choose at most nine of the table's positions."""
    positions = view.positions_mm(code)
    if positions.size > MOST_CORNERS:
        chosen = np.linspace(0, positions.size - 1, MOST_CORNERS).round().astype(int)
        positions = positions[chosen]
    return tuple(positions.tolist())


def _seen(view: CampaignView, code: str, corners: tuple[float, ...]) -> tuple[float, ...]:
    """Choose the corners next to which something was measured.

    What hardly shows at a place beside a corner that shows well would have that corner's size
    divided by how little it shows: many times what was measured anywhere.
    """
    if not corners:
        return corners
    at_mm = np.array(corners)
    middles_mm = (at_mm[1:] + at_mm[:-1]) / 2.0
    nearest = np.searchsorted(middles_mm, view.projection.view(code).places.positions_mm)
    return tuple(at_mm[np.unique(nearest)].tolist())


def _bow(corners: tuple[float, ...]) -> Shape:
    """Make a parabola through a table's positions: 0 in its middle, 1 at either end."""
    half = (corners[-1] - corners[0]) / 2.0
    middle = corners[0] + half
    return Profile(corners, tuple(((x - middle) / half) ** 2 for x in corners))


def _hats(corners: tuple[float, ...]) -> list[Shape]:
    heights = np.eye(len(corners))
    return [Profile(corners, tuple(row.tolist())) for row in heights]
