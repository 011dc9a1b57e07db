"""Positions of a verification were noted from the other end of the axis."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from app.arrays import BoolArray, FloatArray
from app.effects.campaign_view import CampaignView, travel_of
from app.effects.effect import Effect
from app.effects.hypothesis import WHOLE, Hypothesis
from app.effects.kind import EffectKind, Proposed, Shakes
from app.effects.projection import Projection
from app.effects.supposition import left_by_places
from app.effects.words import components
from app.geometry.components import COMPONENTS, LINEAR_LETTERS, Kind

ALL, POINTS, REVERSED = "all of the axis", "points", "sign reversed too"


class _Mirror(NamedTuple):
    """What may be mirrored: an axis, about the middle of its travel, in some rows."""

    axis: str
    ends_mm: float
    rows: BoolArray
    sign: float = 1.0


class MirroredAxis(EffectKind):
    """What was noted at x was measured at (lower + upper end of travel) − x, coming the other way.

    All of an axis, its points alone, or one component's line; a displacement along the axis may
    have the wrong sign as well, where the instrument stood at the other end.
    """

    kind = "mirrored-axis"
    text = "positions were recorded from the other end of the axis"
    drawn_over = "position"
    share_of = "of what mirroring would cause: 1 if they are mirrored"
    only_once = True
    shown_by = "measure {component} at the two ends of travel only, and note which end was which"
    not_adopted = (
        "the positions of the observations are wrong, not the model: store the verifications "
        "again with the right ones"
    )
    shakes = Shakes.VALUES

    def propose(self, view: CampaignView) -> Proposed:
        """Every axis whose positions vary."""
        for variant, codes, mirror in _mirrors(view):
            yield Hypothesis(
                kind=self.kind,
                variant=variant,
                components=codes,
                supposed=partial(_supposed, mirror),
                expected=WHOLE,
                within_visit=True,
            )

    def explain(self, effect: Effect) -> str:
        """Say what was mirrored."""
        axis = str(COMPONENTS[effect.components[0]].axis).upper()
        what = f"positions along {axis} of {components(effect)}"
        if effect.variant == POINTS:
            what = f"positions along {axis} at points (seen in {components(effect)})"
        too = ", and the sign is wrong too" if effect.variant == REVERSED else ""
        return f"{what} were recorded from the other end of the axis{too}"

    def what_to_do(self, effect: Effect) -> str:
        """Say what to store anew."""
        axis = str(COMPONENTS[effect.components[0]].axis).upper()
        of = "the points" if effect.variant == POINTS else components(effect)
        too = ", and the sign of its values" if effect.variant == REVERSED else ""
        return (
            f"Look up in which direction {axis} was counted when {of} was verified{too}; store "
            "the verifications again with the right positions, then analyse again."
        )


def _mirrors(view: CampaignView) -> Iterator[tuple[str, tuple[str, ...], _Mirror]]:
    """List what may be mirrored: form, components, and how."""
    rows, names = view.rows, np.array(view.rows.channels)[view.rows.channel]
    for letter in LINEAR_LETTERS:
        codes = tuple(code for code in view.tables if COMPONENTS[code].axis == letter)
        lines = [code for code in codes if code in rows.components]
        if not codes or (travel := travel_of(view.model, COMPONENTS[codes[0]])) is None:
            continue
        mirror = partial(_Mirror, letter, travel.min_mm + travel.max_mm)
        for code in lines:
            yield "", (code,), mirror(names == code)
            if COMPONENTS[code].kind is Kind.LINEAR:
                yield REVERSED, (code,), mirror(names == code, -1.0)
        if rows.has_points:
            yield POINTS, codes, mirror(rows.at_points)
        if len(lines) + rows.has_points > 1:
            yield ALL, codes, mirror(rows.at_points | np.isin(names, lines))


def _supposed(mirror: _Mirror, projection: Projection, theta: float | None) -> FloatArray:
    rows, column = projection.rows, LINEAR_LETTERS.index(mirror.axis)
    points, directions = rows.points_mm.copy(), rows.directions.copy()
    points[mirror.rows, column] = mirror.ends_mm - points[mirror.rows, column]
    directions[mirror.rows, column] *= -1
    really = replace(rows, points_mm=points, directions=directions)
    return left_by_places(projection, really, mirror.rows, mirror.sign)
