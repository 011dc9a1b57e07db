"""The one nonlinear parameter, by variable projection: amplitudes and visit variances profiled.

G. Golub, V. Pereyra, SIAM J. Numer. Anal. 10 (1973) 413: variable projection.
S. Wilks, Ann. Math. Statist. 9 (1938) 60: what a drop of the log likelihood means.
D. Venzon, S. Moolgavkar, Appl. Statist. 37 (1988) 87: intervals by the profile likelihood.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from app.search.candidate import Candidate
from app.search.joint_fit import fit_terms, unexpected
from app.search.problem import Problem, Term
from app.search.state import State

TOLERANCE: Final = 2e-3
"""Of the stretch between the grid's neighbours."""

CURVATURE_STEP: Final = 0.5
"""Drop of the log likelihood that the standard error is read from: one standard error's."""

INTERVAL: Final = 1.96
"""Standard errors to either side that hold the truth 95 times in a hundred."""

INTERVAL_DROP: Final = 0.5 * INTERVAL**2
"""Drop of the log likelihood where that interval ends."""

ENDS_WITHIN: Final = 0.02
"""Share of a step of the grid to which the interval's end is looked for."""

MOST_STEPS: Final = 8
"""So many times at most a term is laid out about its amplitude,"""

SETTLED: Final = 0.01
"""or until that changes by no more than this share of it."""

MOST_PLACES: Final = 100
"""A longer grid, of pitches, is not walked: there the width around the best is what is known."""


def refine(
    problem: Problem,
    states: Mapping[int, State],
    term: Term,
    others: Sequence[Term] = (),
    errors: bool = False,
) -> Term:
    """Move a term's nonlinear parameter to where the likelihood is largest.

    Where it is not proportional to its amplitude, it is then laid out anew about what that is.

    Parameters
    ----------
    states
        Channel to state, without given terms.
    term
        The term; without bounds its nonlinear parameter stays.
    errors
        Whether the standard error is wanted too.
    """
    near = {c: s for c, s in states.items() if any(c in t.columns for t in (term, *others))}
    if term.theta is not None and term.candidate.bounds is not None:
        term = _moved(problem, near, term, others, errors)
    return term if term.candidate.about is None else _laid_out(problem, near, term, others)


def _laid_out(
    problem: Problem, states: Mapping[int, State], term: Term, others: Sequence[Term]
) -> Term:
    """Lay a term out about its amplitude for as long as that makes it more likely."""
    fit, laid_out = fit_terms(states, [*others, term]), term
    for _ in range(MOST_STEPS):
        size = float(fit.amplitudes[-1]) / max(float(laid_out.norms[0]), np.finfo(float).tiny)
        if abs(size - (laid_out.about or 0.0)) <= SETTLED * abs(size):
            break
        about = problem.term(term.candidate, laid_out.theta, size)
        better = fit_terms(states, [*others, about])
        if better.log_likelihood <= fit.log_likelihood:
            break
        fit, laid_out = better, about
    return replace(laid_out, origin=term.origin, theta_error=term.theta_error)


def _moved(
    problem: Problem,
    near: Mapping[int, State],
    term: Term,
    others: Sequence[Term],
    errors: bool,
) -> Term:
    search = _Search(problem, near, term.candidate, others, term.about)
    theta = float(term.theta or 0.0)
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
    moved = replace(search.term(place), origin=term.origin)
    return replace(moved, theta_error=search.error(place, high - low)) if errors else moved


class _Search:
    """The likelihood along one candidate's nonlinear parameter."""

    def __init__(
        self,
        problem: Problem,
        states: Mapping[int, State],
        candidate: Candidate,
        others: Sequence[Term],
        about: float | None,
    ) -> None:
        self.problem, self.states = problem, states
        self.candidate, self.others, self.about = candidate, others, about

    def inside(self, theta: float) -> float:
        """Go to the scale that is stepped in."""
        return float(np.log(theta)) if self.candidate.log_scale else theta

    def term(self, place: float) -> Term:
        """Evaluate the candidate."""
        return self.problem.term(self.candidate, self._outside(place), self.about)

    def _outside(self, place: float) -> float:
        """Come back from the scale that is stepped in."""
        return float(np.exp(place)) if self.candidate.log_scale else float(place)

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
        the width at one standard error is what the error means. Where the likelihood is as
        large further off, the error is so large that its 95 % interval reaches there.
        """
        bottom = self.loss(place)
        low, high = (self.inside(v) for v in self.candidate.bounds or (place, place))
        widths = [
            _width(lambda x: self.loss(x) - bottom, place, side, stretch, (low, high))
            for side in (-1.0, 1.0)
        ]
        finite = [w for w in widths if np.isfinite(w)]
        width = float(np.mean(finite)) if finite else float("inf")
        near = width * float(np.exp(place)) if self.candidate.log_scale else width
        return max(near, self._reach(place, bottom) / INTERVAL)

    def _reach(self, place: float, bottom: float) -> float:
        """Say how far the parameter may be from the best, by the likelihood over all its grid.

        It may have a second maximum, hardly lower than the first: the width of the first says
        nothing of that. 0 where nothing beyond the grid's neighbours is likely enough.
        """
        grid = [self.inside(v) for v in self.candidate.grid]
        if len(grid) > MOST_PLACES:
            return 0.0
        drops = [self.loss(at) - bottom for at in grid]
        theta, far = self._outside(place), 0.0
        for side in (-1, 1):
            ordered = list(zip(grid, drops, strict=True))[::side]
            beyond = [(at, drop) for at, drop in ordered if side * (at - place) > 0.0]
            inside = [i for i, (_, drop) in enumerate(beyond) if drop < INTERVAL_DROP]
            if not inside:
                continue
            at = beyond[inside[-1]][0]
            if inside[-1] + 1 < len(beyond):
                after = beyond[inside[-1] + 1][0]
                at = float(
                    brentq(
                        lambda x: self.loss(x) - bottom - INTERVAL_DROP,
                        at,
                        after,
                        xtol=ENDS_WITHIN * abs(after - at),
                    )
                )
            far = max(far, abs(self._outside(at) - theta))
        return far


def _width(
    loss: Callable[[float], float],
    place: float,
    side: float,
    stretch: float,
    bounds: tuple[float, float],
) -> float:
    """Find where the loss rises by about one half, from an eighth of the stretch on; else infinity.

    Each step goes where a parabola through the last one would rise so much.
    """
    step = stretch / 8.0
    for _ in range(8):
        # The loss is about parabolic near its minimum: from a drop at one step follows the step for
        # ½.
        at = place + side * step
        if not bounds[0] <= at <= bounds[1]:
            return float("inf")
        # Rounding can leave no drop, or a gain, where the likelihood is flat; the step that follows
        # is clipped below.
        drop = max(loss(at), 1e-12)
        guess = step * float(np.sqrt(CURVATURE_STEP / drop))
        if 0.1 < drop < 1.5:
            return guess
        step = float(np.clip(guess, step / 30.0, step * 8.0))
    return step
