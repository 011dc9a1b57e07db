"""The one nonlinear parameter, by variable projection: amplitudes and visit variances profiled.

G. Golub, V. Pereyra, SIAM J. Numer. Anal. 10 (1973) 413: variable projection.
S. Wilks, Ann. Math. Statist. 9 (1938) 60: what a drop of the log likelihood means.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from scipy.optimize import minimize_scalar

from app.search.candidate import Candidate
from app.search.joint_fit import fit_terms, unexpected
from app.search.problem import Problem, Term
from app.search.state import State

TOLERANCE: Final = 2e-3
"""Of the stretch between the grid's neighbours."""

CURVATURE_STEP: Final = 0.5
"""Drop of the log likelihood that the standard error is read from: one standard error's."""


def refine(
    problem: Problem,
    states: Mapping[int, State],
    term: Term,
    others: Sequence[Term] = (),
    errors: bool = False,
) -> Term:
    """Move a term's nonlinear parameter to where the likelihood is largest.

    Parameters
    ----------
    states
        Channel to state, without given terms.
    term
        The term; without bounds it comes back as it is.
    errors
        Whether the standard error is wanted too.
    """
    if term.theta is None or term.candidate.bounds is None:
        return term
    near = {c: s for c, s in states.items() if any(c in t.columns for t in (term, *others))}
    search = _Search(problem, near, term.candidate, others)
    theta = term.theta
    if term.candidate.expected is not None:
        theta = min(search.starts(term), key=lambda t: search.loss(search.inside(t)))
    low, high = (search.inside(v) for v in term.candidate.around(theta))
    best = minimize_scalar(
        search.loss,
        bounds=(low, high),
        method="bounded",
        options={"xatol": TOLERANCE * (high - low), "maxiter": 25},
    )
    # A bounded search never looks at its start: where the likelihood has steps it may end lower.
    start = search.inside(theta)
    place = float(best.x) if float(best.fun) <= search.loss(start) else start
    found = replace(search.term(place), origin=term.origin)
    return replace(found, theta_error=search.error(place, high - low)) if errors else found


class _Search:
    """The likelihood along one candidate's nonlinear parameter."""

    def __init__(
        self,
        problem: Problem,
        states: Mapping[int, State],
        candidate: Candidate,
        others: Sequence[Term],
    ) -> None:
        self.problem, self.states = problem, states
        self.candidate, self.others = candidate, others

    def inside(self, theta: float) -> float:
        """Go to the scale that is stepped in."""
        return float(np.log(theta)) if self.candidate.log_scale else theta

    def term(self, place: float) -> Term:
        """Evaluate the candidate."""
        theta = float(np.exp(place)) if self.candidate.log_scale else float(place)
        return self.problem.term(self.candidate, theta)

    def starts(self, term: Term) -> list[float]:
        """List values of the grid to start from where an amplitude is expected.

        A scan leaves the amplitude free. Where twice the parameter does twice as much, it then
        hardly tells one value from another, and amplitude times parameter is what is known.
        """
        fit = fit_terms(self.states, [*self.others, term])
        norm = max(float(term.norms[0]), np.finfo(float).tiny)
        theta = float(term.theta or 0.0)
        grid = np.array(self.candidate.grid)
        near = int(np.abs(grid - theta * float(fit.amplitudes[-1]) / norm).argmin())
        return list(dict.fromkeys([theta, *grid[max(near - 1, 0) : near + 2].tolist()]))

    def loss(self, place: float) -> float:
        """Minus the log likelihood, everything else profiled, and what is expected counted."""
        term = self.term(place)
        fit = fit_terms(self.states, [*self.others, term])
        return 0.5 * unexpected(term, fit, len(fit.amplitudes) - term.size) - fit.log_likelihood

    def error(self, place: float, stretch: float) -> float:
        """Read the standard error from where the likelihood has dropped by one half.

        A second difference over a fixed step fails where visit variances switch level;
        the width at one standard error is what the error means.
        """
        bottom = self.loss(place)
        low, high = (self.inside(v) for v in self.candidate.bounds or (place, place))
        widths = [
            _width(lambda x: self.loss(x) - bottom, place, side, stretch, (low, high))
            for side in (-1.0, 1.0)
        ]
        known = [w for w in widths if np.isfinite(w)]
        width = float(np.mean(known)) if known else float("inf")
        return width * float(np.exp(place)) if self.candidate.log_scale else width


def _width(
    loss: object, place: float, side: float, stretch: float, bounds: tuple[float, float]
) -> float:
    """Step outward from a quarter of the stretch, inward first, to a drop near one half."""
    step = stretch / 8.0
    for _ in range(8):
        at = place + side * step
        if not bounds[0] <= at <= bounds[1]:
            return float("inf")
        drop = max(float(loss(at)), 1e-12)  # type: ignore[operator]
        guess = step * float(np.sqrt(CURVATURE_STEP / drop))
        if 0.1 < drop < 1.5:
            return guess
        step = float(np.clip(guess, step / 30.0, step * 8.0))
    return step
