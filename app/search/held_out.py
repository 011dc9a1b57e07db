"""What is left on visits that the prediction has not seen, beside the noise floor."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Collection, Mapping
from typing import Final, NamedTuple

import numpy as np
from scipy.special import gammaincc

from app.arrays import BoolArray, FloatArray, rms
from app.search.channel import Channel
from app.search.figures import figure
from app.search.findings import Floor, HeldOut
from app.search.joint_fit import Fit
from app.search.problem import Problem
from app.search.scatter import Scatter, scatters
from app.search.state import State
from app.search.validation import Validation

LARGEST_VOTE: Final = 6.0
"""Log likelihood by which one channel may speak against a common set-up scatter."""


def held_out_figures(
    problem: Problem,
    fit: Fit,
    typical: Mapping[int, Scatter],
    checked: Validation,
    seed: int,
    *,
    settled: Collection[int] = (),
) -> dict[int, HeldOut]:
    """Sum up what is left of every channel, in its unit.

    Where a visit's zero is unknown, its mean is taken off; where too few set-ups tell how they
    scatter, shift and tilt of each.

    Parameters
    ----------
    fit
        The final model: its scatter is the floor where none was declared.
    typical
        Channel to the set-up scatter that is usual in this campaign (`typical_scatter`).
    settled
        Channels of which the floor contains what the few visits that taught leave open.

    Returns
    -------
    dict
        Channel to figures; empty where nothing was held out.
    """
    figures: dict[int, HeldOut] = {}
    for c, fixed in problem.fixed.items():
        channel = fixed.channel
        seen = np.isfinite(checked.after[channel.rows])
        if not seen.any():
            continue
        residuals = channel.scale * _residuals(channel, checked.after[channel.rows])[seen]
        visit = channel.blocks.setups[channel.block][seen]
        expected = _expected(problem, channel, fit, typical[c])
        open_still = checked.variance[channel.rows] if c in settled else np.zeros(len(seen))
        spread, chance = _apart_from_one(
            channel, expected, residuals / channel.scale, seen, open_still
        )
        figures[c] = HeldOut(
            rows=len(visit),
            visits=len(np.unique(visit)),
            after=figure(residuals, visit, seed),
            floor=Floor(
                noise=channel.scale * float(np.sqrt(expected.scatter)),
                setups=channel.scale * rms(np.sqrt(expected.of_setups(channel)[seen])),
                learning=channel.scale * rms(np.sqrt(open_still[seen])),
            ),
            spread=spread,
            chance=chance,
        )
    return figures


def _residuals(channel: Channel, predicted: FloatArray) -> FloatArray:
    residuals = channel.values - predicted
    of_setup = np.unique(channel.blocks.setups, return_inverse=True)[1][channel.block]
    if channel.blocks.is_own_unknown:
        for setup in np.unique(of_setup):
            of_number = of_setup == setup
            shapes = channel.shapes[of_number]
            residuals[of_number] -= (
                shapes @ np.linalg.lstsq(shapes, residuals[of_number], rcond=None)[0]
            )
        return np.asarray(residuals)
    means = np.bincount(of_setup, weights=residuals) / np.bincount(of_setup)
    return np.asarray(
        residuals - np.where(channel.blocks.free[channel.block], means[of_setup], 0.0)
    )


def typical_scatter(states: Mapping[int, State]) -> dict[int, Scatter]:
    """Find the set-up scatter that most channels agree on, each in its repeatabilities.

    One channel whose visits scatter much more than those of all others does so for a cause;
    its own fit would take that for its set-up.
    """
    possible = {c: scatters(state.fixed.channel.blocks) for c, state in states.items()}
    votes: dict[tuple[Scatter, ...], Counter[Scatter]] = defaultdict(Counter)
    for c, state in states.items():
        # No channel may outvote the others by more than so much.
        likelihood = np.maximum(state.null - state.null.max() + LARGEST_VOTE, 0.0)
        for scatter, vote in zip(state.fixed.channel.tried, likelihood.tolist(), strict=True):
            votes[possible[c]][scatter] += vote
    return {
        c: max(of_channel, key=votes[of_channel].__getitem__) for c, of_channel in possible.items()
    }


class _NoiseFloor(NamedTuple):
    """What repeatability and set-up alone leave, in scales squared.

    Parameters
    ----------
    scatter
        Variance of one observation.
    of_setup : ndarray, shape (blocks, shapes)
        Variances of each block's shift and tilts, in that of an observation.
    """

    scatter: float
    of_setup: FloatArray

    def of_setups(self, channel: Channel) -> FloatArray:
        """Give the variance that its set-up leaves in each row."""
        shifts_and_tilts = channel.shapes**2 * self.of_setup[channel.block]
        return np.asarray(self.scatter * np.sum(shifts_and_tilts, axis=1))


def _expected(problem: Problem, channel: Channel, fit: Fit, typical: Scatter) -> _NoiseFloor:
    declared = problem.rows.noise.get(channel.number)
    variances = channel.blocks.own_variances(typical)
    # Beside a stated repeatability the fitted one may hide what is unexplained.
    is_declared = declared is not None and declared.repeatability is not None
    scatter = 1.0 if is_declared else fit.scatter[channel.number]
    least = declared.rounding / channel.scale if declared is not None else 0.0
    scatter = max(scatter, least**2)
    return _NoiseFloor(scatter, variances)


def _apart_from_one(
    channel: Channel,
    expected: _NoiseFloor,
    residuals: FloatArray,
    seen: BoolArray,
    open_still: FloatArray,
) -> tuple[float, float]:
    """Hold what is left against the floor, without the visit that is furthest from it.

    A sum of squares of correlated normal values is about a gamma distribution with the same mean
    and variance (Welch, Biometrika 34 (1947) 28; Satterthwaite, Biometrics 2 (1946) 110).

    Parameters
    ----------
    residuals : ndarray, shape (seen,)
        In scales.
    open_still : ndarray, shape (n,)
        Variance that teaching visits leave open, the same for all rows of a visit.

    Returns
    -------
    float
        Root mean square over that of the floor.
    float
        Probability that repeatability and set-ups leave as much or more.
    """
    shapes, block = channel.shapes[seen], channel.block[seen]
    setup, opened = channel.blocks.setups[block], np.sqrt(open_still[seen])
    squares, means, variances = [], [], []
    for number in np.unique(setup):
        of_number = np.flatnonzero(setup == number)
        of_setup = shapes[of_number] * np.sqrt(expected.of_setup[block[of_number]])
        together = expected.scatter * (np.eye(len(of_number)) + of_setup @ of_setup.T)
        together += np.outer(opened[of_number], opened[of_number])
        squares.append(float(residuals[of_number] @ residuals[of_number]))
        means.append(float(np.trace(together)))
        # x'x of x ~ N(0, Σ) has the mean tr Σ and the variance 2 tr Σ².
        variances.append(2.0 * float(np.sum(together**2)))
    furthest = int(np.argmax(np.array(squares) / means))
    square, mean, variance = (
        sum(of_visit) - of_visit[furthest] for of_visit in (squares, means, variances)
    )
    if len(squares) < 2 or mean <= 0.0:
        return 0.0, 1.0
    shape = mean**2 / variance
    return float(np.sqrt(square / mean)), float(gammaincc(shape, shape * square / mean))
