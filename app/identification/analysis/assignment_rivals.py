"""What one effect of the library explains on the sensors as assigned, set-ups held out in turn.

Another sensor is no better where one effect on the present one explains as much: the effect is
chosen and its amplitudes are fitted on all other set-ups, by least squares, and judged on the one
that is held out. An effect that acts on many components counts in all of them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np

from app.arrays import FloatArray, IntArray
from app.effects.campaign_view import CampaignView
from app.effects.hypothesis import Hypothesis
from app.effects.kind import AsOtherSensor
from app.effects.registry import KINDS, kind_of
from app.errors import list_names
from app.identification.analysis.set_ups import SetUps
from app.identification.campaign import Campaign
from app.identification.residuals.residuals import Residuals

AS_MUCH: Final = {AsOtherSensor.RIVAL: 1.0, AsOtherSensor.IMITATION: 0.95}
"""Share of what an effect explains from which another sensor explains more: where it is true it
explains so much of what imitations do, which fit chance too."""

RIDGE: Final = 1e-9
"""Share of a column's squares that keeps equal columns apart."""


class _Fitted(NamedTuple):
    """One effect with one value of what is not linear: gains by set-up, shape (V,) each.

    Parameters
    ----------
    on_others
        What it explains of all other set-ups, fitted to them.
    held_out
        What it explains of the set-up itself, fitted to the others.
    """

    hypothesis: Hypothesis
    on_others: FloatArray
    held_out: FloatArray


@dataclass(frozen=True, eq=False)
class Rivals:
    """The library's effects, listed when they are first asked for."""

    campaign: Campaign
    residuals: Residuals
    _shared: dict[tuple[str, float | None], FloatArray] = field(default_factory=dict)

    @cached_property
    def _hypotheses(self) -> list[Hypothesis]:
        campaign, residuals = self.campaign, self.residuals
        conditions = residuals.projection.conditions
        view = CampaignView(campaign.model, campaign.maps, residuals.rows, conditions)
        return [
            hypothesis
            for kind in KINDS.values()
            if kind.as_other_sensor in AS_MUCH
            for hypothesis in kind.candidates(view).hypotheses
        ]

    def explaining_as_much(
        self, set_ups: SetUps, code: str, shows: IntArray, scale: FloatArray, gain: float
    ) -> str:
        """Name the effect that explains as much as another sensor of a component, if one does.

        Parameters
        ----------
        shows : ndarray, shape (m,)
            The rows of the channels in which it shows.
        scale : ndarray, shape (m,)
            What their squares are measured by [the channels' units].
        gain
            What the other sensor explains of them: squares over those of the scale.

        Returns
        -------
        str
            Empty where none does.
        """
        scales = set_ups.sizes
        scales[shows] = scale
        for role, share in AS_MUCH.items():
            hypotheses = [
                hypothesis
                for hypothesis in self._hypotheses
                if code in hypothesis.components
                and kind_of(hypothesis.kind).as_other_sensor is role
            ]
            fitted = list(self._fitted(set_ups, hypotheses, scales))
            if fitted and gain <= share * _explained(fitted):
                return _words(max(fitted, key=lambda item: float(item.on_others.sum())).hypothesis)
        return ""

    def _fitted(
        self, set_ups: SetUps, hypotheses: Sequence[Hypothesis], scales: FloatArray
    ) -> Iterator[_Fitted]:
        values = set_ups.remaining / scales
        for hypothesis in hypotheses:
            nonlinear = hypothesis.nonlinear
            for theta in nonlinear.grid if nonlinear else (None,):
                columns = self._columns(set_ups, hypothesis, theta) / scales[:, None]
                yield _Fitted(hypothesis, *_gains(set_ups, values, columns))

    def _columns(self, set_ups: SetUps, hypothesis: Hypothesis, theta: float | None) -> FloatArray:
        """Lay one effect's unit amplitudes out, from each zero, shape (n, k).

        Those of many components are asked for with each of them, and remembered.
        """
        key = (hypothesis.key, theta)
        if key in self._shared:
            return self._shared[key]
        columns = hypothesis.columns(self.residuals.projection, theta)
        from_zeros = np.column_stack([set_ups.from_zero(column) for column in columns.T])
        if len(hypothesis.components) > 1:
            self._shared[key] = from_zeros
        return from_zeros


def _gains(
    set_ups: SetUps, values: FloatArray, columns: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Fit without each set-up in turn: what that explains of the others, and of it."""
    sums, k = set_ups.sums, columns.shape[1]
    squares = np.array([[sums(a * b) for a in columns.T] for b in columns.T]).transpose(2, 0, 1)
    products = np.array([sums(a * values) for a in columns.T]).T
    others, of_others = squares.sum(axis=0) - squares, products.sum(axis=0) - products
    ridge = (RIDGE * np.trace(squares.sum(axis=0)) + np.finfo(float).tiny) * np.eye(k)
    fitted = np.linalg.solve(others + ridge, of_others[..., None])[..., 0]
    on_others = np.einsum("vk,vk->v", of_others, fitted)
    held_out = 2.0 * np.einsum("vk,vk->v", products, fitted) - np.einsum(
        "vj,vjk,vk->v", fitted, squares, fitted
    )
    return on_others, held_out


def _explained(fitted: list[_Fitted]) -> float:
    """Give what the effect explains of each set-up that the others choose."""
    chosen = np.argmax([trial_fit.on_others for trial_fit in fitted], axis=0)
    held_out = np.array([trial_fit.held_out for trial_fit in fitted])
    return float(held_out[chosen, np.arange(chosen.size)].sum())


def _words(hypothesis: Hypothesis) -> str:
    drivers = [*hypothesis.sensors, *hypothesis.states]
    by = f" driven by {list_names(drivers, 3)}" if drivers else ""
    return f"{hypothesis.kind} of {list_names(hypothesis.components, 4)}{by}"
