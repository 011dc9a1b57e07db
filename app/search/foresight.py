"""What a model learned on some visits predicts of others: residuals, and a slope per term."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from app.arrays import BoolArray, FloatArray
from app.search.findings import Slope
from app.search.joint_fit import Fit, fit_terms
from app.search.model import Model
from app.search.priors import OF_MAPS
from app.search.problem import Problem, Term, places
from app.search.state import Given, State


@dataclass(frozen=True, eq=False)
class Learned:
    """A model fitted on some visits.

    Parameters
    ----------
    states
        Channel to state on the visits that taught it, without terms.
    """

    terms: Sequence[Term]
    fit: Fit
    states: Mapping[int, State]

    def effect(
        self, channel: int, *, known_alone: bool = False, number: int | None = None
    ) -> FloatArray:
        """Predict what the terms alone do to all rows of a channel, in repeatabilities.

        Parameters
        ----------
        known_alone
            Whether only of those that the model has already.
        number
            Of one term alone; None: of all.

        Returns
        -------
        ndarray, shape (n,)
        """
        total = np.zeros(len(self.states[channel].fixed.channel.rows))
        for i, (term, part) in enumerate(zip(self.terms, places(self.terms), strict=True)):
            if number is not None and i != number:
                continue
            if channel in term.columns and not (known_alone and term.origin is None):
                total += term.columns[channel] @ self.fit.amplitudes[part]
        return total

    def prediction(self, channel: int) -> FloatArray:
        """Predict all rows of a channel: refitted maps and terms, in repeatabilities.

        Returns
        -------
        ndarray, shape (n,)
        """
        state, effect = self.states[channel], self.effect(channel)
        fixed_channel = state.fixed.channel
        entries = Model(state, self.fit.level[channel]).entries(fixed_channel.values - effect)
        return np.asarray(effect + fixed_channel.nuisance @ entries)


def learn(states: Mapping[int, State], terms: Sequence[Term]) -> Learned:
    """Fit terms on some visits.

    Parameters
    ----------
    states
        Channel to state on those visits, without terms.
    """
    return Learned(terms, fit_terms(states, terms), states)


def calibration_slope(
    problem: Problem, learned: Learned, number: int, held_out: BoolArray
) -> Slope:
    """Regress what held-out visits show of a term on what was predicted of it.

    The predicted contribution is what the term changes in the whole prediction, with the
    maps refitted on either side: maps that make room for a false effect cancel it, and a
    slope taken beside them would confirm anything. Maps and other terms keep the
    uncertainty that the teaching visits left them.

    Parameters
    ----------
    held_out : ndarray, shape (cells,)
        Which cells were held out.

    Returns
    -------
    Slope
        With information 0 where the held-out visits do not excite the term.
    """
    others = [t for i, t in enumerate(learned.terms) if i != number]
    touched = {c for t in learned.terms for c in t.columns}
    without = learn({c: s for c, s in learned.states.items() if c in touched}, others)
    measured = information = 0.0
    for channel in without.states:
        if held_out[problem.fixed[channel].channel.cells].any():
            change = learned.prediction(channel) - without.prediction(channel)
            seen = _seen(without, channel, change, held_out)
            measured, information = measured + seen[0], information + seen[1]
    # Without information the slope is not 0 but unknown: its error is infinite.
    if information <= 1e-9:
        return Slope(0.0, float("inf"), 0.0)
    return Slope(measured / information, float(information**-0.5), information)


def slope_from_same_zero(
    problem: Problem, learned: Learned, number: int, held_out: BoolArray
) -> Slope:
    """Regress as `calibration_slope` does, where set-ups keep their zero while visits are held out.

    Where few set-ups were seen, the zero of each is unknown: anew on its held-out part, if that is
    looked at alone. What came before and stays then shows only by how it varies there. That is the
    least of it, and rests on the maps' errors. Here teaching and held-out visits are fitted
    together, with the term as large as predicted on the first and free on the others. How set-ups
    scatter is estimated beside the term, and has not swallowed it.
    """
    others = [t for i, t in enumerate(learned.terms) if i != number]
    term, sizes = learned.terms[number], learned.fit.amplitudes[places(learned.terms)[number]]
    touched = {c for t in learned.terms for c in t.columns}
    cells = held_out.copy()
    for state in learned.states.values():
        cells |= state.cells
    states = {c: s for c, s in problem.states(cells).items() if c in touched}
    parts = [_predicted(problem, term, sizes, where) for where in (~held_out, held_out)]
    fit = fit_terms(states, [*others, *parts])
    (taught, shared), (_, variance) = fit.covariance[-2:, -2:]
    if variance <= 0.0:
        return Slope(0.0, float("inf"), 0.0)
    # The second amplitude, given that the first is 1: on visits that taught, the term is what it is
    # said to be, and only the others are asked.
    share = shared / taught if taught > 0.0 else 0.0
    value = float(fit.amplitudes[-1] + share * (1.0 - fit.amplitudes[-2]))
    information = float(1.0 / (variance - share * shared + OF_MAPS**2))
    return Slope(value, float(information**-0.5), information)


def _predicted(problem: Problem, term: Term, sizes: FloatArray, cells: BoolArray) -> Term:
    """Make one column of what is predicted of a term on some cells, 0 on all others."""
    columns = {}
    for c, column in term.columns.items():
        channel = problem.fixed[c].channel
        rows = cells[channel.cells][channel.block]
        columns[c] = ((column @ sizes) * rows)[:, None]
    return Term(term.candidate, term.theta, columns, np.ones(1))


def _seen(
    without: Learned, channel: int, change: FloatArray, held_out: BoolArray
) -> tuple[float, float]:
    """Give f'Ω⁻¹q and f'Ω⁻¹f of one channel: predicted change f, what is left without it q."""
    model = Model(_beside(without, channel), without.fit.level[channel])
    residuals = without.states[channel].fixed.channel.values - without.prediction(channel)
    product = model.product_of_held_out(np.column_stack([change, residuals]), held_out)
    size, agreement = product[0] / without.fit.scatter[channel]
    return float(agreement), float(size)


def _beside(without: Learned, channel: int) -> State:
    """Look at a channel with the other terms free: they too are known but so well."""
    state = without.states[channel]
    mine = [t.columns[channel] for t in without.terms if channel in t.columns]
    if not mine:
        return state
    columns = np.hstack(mine)
    conditioned = Given(columns, np.zeros(columns.shape[1]), np.zeros(len(columns)))
    return State(state.fixed, state.cells, conditioned)
