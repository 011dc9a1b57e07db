"""How far set-ups jump as they begin, learnt from the errors of set-ups that were held out.

A machine is zeroed standing still, and is switched on a moment later. What that does differs from
one time to the next, within minutes and for as long as the set-up lasts. In learning, a set-up's
first rows are few, and drivers that begin with it take up what it did that time; only set-ups held
out show how much that was luck. So what is stated of the jump is learnt of their errors, whether or
not the response was learnt as if set-ups jumped.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize_scalar

from app.search.response import FREEDOM, Course
from app.search.response_average import Average
from app.search.wander import jumped


def held_out_jump(held_out: Sequence[tuple[Course, Average]]) -> float:
    """Find the standard deviation of the jump that makes errors held out most likely.

    Errors of a set-up are Student's t with four degrees of freedom, as set-ups weigh in learning,
    so that an odd one says no more than others. With the covariance V = K + j² gg' of jump j, where
    K is what was foretold without it, both the determinant and e'V⁻¹e follow from g'K⁻¹g and
    g'K⁻¹e (Sherman and Morrison, Annals of Mathematical Statistics 21, 1950).

    Parameters
    ----------
    held_out
        Set-ups, each with what all others say; those that are not zeroed have no jump.

    Returns
    -------
    float
        0 where there is none [the values' unit].
    """
    parts = [_whitened(course, average) for course, average in held_out if course.is_zeroed]
    if not parts:
        return 0.0
    by_jump, with_error, by_error, rows = np.array(parts).T

    def misfit(jump: float) -> float:
        larger = 1.0 + jump**2 * by_jump
        square = by_error - (jump * with_error) ** 2 / larger
        odds = (FREEDOM + rows) * np.log1p(square / FREEDOM)
        return 0.5 * float((odds + np.log(larger)).sum())

    most = max(float(np.abs(course.values).max()) for course, _ in held_out)
    if not most:
        return 0.0
    found = float(minimize_scalar(misfit, bounds=(0.0, most), method="bounded").x)
    return found if misfit(found) < misfit(0.0) else 0.0


def _whitened(course: Course, average: Average) -> tuple[float, float, float, float]:
    """Give g'K⁻¹g, g'K⁻¹e, e'K⁻¹e and the number of rows of a set-up held out."""
    own, times_min = average.at(course.began), course.times_min
    error = course.values - course.columns @ own.mean
    noise = average.noise._replace(jump=0.0)
    foretold = noise.covariance(times_min[None], np.array([course.is_zeroed]))[0]
    foretold += course.columns @ own.covariance @ course.columns.T
    both = np.column_stack([jumped(times_min), error])
    found = both.T @ cho_solve(cho_factor(foretold, lower=True), both)
    return float(found[0, 0]), float(found[0, 1]), float(found[1, 1]), float(error.size)
