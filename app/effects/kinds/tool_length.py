"""A tool's length was stated wrongly: the angles act at another place than the model asks for."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np

from app.arrays import BoolArray, FloatArray
from app.effects.campaign_view import CampaignView
from app.effects.effect import Effect
from app.effects.hypothesis import Amplitude, Hypothesis
from app.effects.kind import EffectKind, Need, Proposed, Shakes
from app.effects.projection import Projection
from app.effects.supposition import left_by_places
from app.effects.words import components, parameter
from app.geometry.components import COMPONENTS, Kind

MOST_TOOLS: Final = 6
"""Of more tools only those that most observations were made with are tried by themselves."""

LONGER_BY: Final = "longer_by_mm"

ALONG_Z: Final = (0.0, 0.0, 1.0)
"""The spindle's axis (ISO 841)."""


class ToolLength(EffectKind):
    """Measured minus predicted is what the angles do over the length that was not stated.

    One tool, or all of them by as much: the gauge line was taken at another place. Linear in the
    length, so its size is an amplitude.
    """

    kind = "tool-length"
    text = "a tool's length was stated wrongly: it acts through the angular errors"
    drawn_over = "position"
    needs = Need.POINTS
    only_once = True
    shown_by = (
        "measure the tool's length from the gauge line, and the same points with a second tool "
        "of quite a different length"
    )
    not_adopted = (
        "the tool offset stated with the observations is wrong, not the model: store the "
        "verifications again with the right one"
    )
    shakes = Shakes.VALUES

    def propose(self, view: CampaignView) -> Proposed:
        """Every tool by itself, and all together."""
        codes = tuple(c for c in view.tables if COMPONENTS[c].kind is Kind.ANGULAR)
        if not codes:
            yield self.refuse("tools", "no map has an angular error")
        for name, rows in _tools(view) if codes else ():
            yield Hypothesis(
                kind=self.kind,
                variant=name,
                components=codes,
                amplitudes=(Amplitude(LONGER_BY),),
                supposed=partial(_supposed, rows),
                within_visit=True,
            )

    def explain(self, effect: Effect) -> str:
        """Say which tool is how much longer or shorter."""
        longer = effect.parameters[LONGER_BY] > 0.0
        which = f"the tool of {effect.variant}" if effect.variant else "every tool"
        size = parameter(effect, LONGER_BY, "mm").removeprefix("-").removeprefix("−")
        return (
            f"{which} is {size} {'longer' if longer else 'shorter'} than stated (acting through "
            f"{components(effect)})"
        )

    def what_to_do(self, effect: Effect) -> str:
        """Say what to measure."""
        which = f"the tool of {effect.variant}" if effect.variant else "the tools"
        return (
            f"Measure {which} from the gauge line; store the verifications again with the right "
            "tool offset, then analyse again."
        )


def _tools(view: CampaignView) -> Iterator[tuple[str, BoolArray]]:
    """List tools by their length, with their rows; nameless: all of them."""
    lengths_mm = np.where(
        view.rows.at_points, np.linalg.norm(view.rows.tool_offsets_mm, axis=1), 0.0
    ).round(3)
    distinct_mm, counts = np.unique(lengths_mm[view.rows.at_points], return_counts=True)
    yield "", view.rows.at_points
    each = distinct_mm[np.argsort(-counts, kind="stable")][:MOST_TOOLS]
    for length_mm in each if distinct_mm.size > 1 else ():
        yield f"{length_mm:g} mm", lengths_mm == length_mm


def _supposed(longer: BoolArray, projection: Projection, theta: float | None) -> FloatArray:
    """Make each of some tools 1 mm longer along itself; one that was not stated, along Z."""
    tools_mm = projection.rows.tool_offsets_mm.copy()
    offsets_mm = tools_mm[longer]
    size = np.linalg.norm(offsets_mm, axis=1, keepdims=True)
    tools_mm[longer] = offsets_mm + np.where(
        size > 0.0, offsets_mm / np.maximum(size, 1e-9), ALONG_Z
    )
    really = replace(projection.rows, tool_offsets_mm=tools_mm)
    return left_by_places(projection, really, longer)
