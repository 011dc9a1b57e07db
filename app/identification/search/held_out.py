"""Before and after, on visits that the prediction has not seen, beside the noise floor."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from app.arrays import FloatArray
from app.identification.search.channel import Channel
from app.identification.search.figures import figure
from app.identification.search.findings import HeldOut
from app.identification.search.joint_fit import Fit
from app.identification.search.problem import Problem
from app.identification.search.rows import IntArray
from app.identification.search.state import State
from app.identification.search.validation import Validation

MOST_SAY: Final = 6.0
"""Log likelihood by which one channel may speak against a common set-up scatter."""


def held_out_figures(
    problem: Problem, fit: Fit, typical: Mapping[int, int], checked: Validation, seed: int
) -> dict[int | None, HeldOut]:
    """Sum up every channel in its unit, and all of them in repeatabilities.

    Where a visit's zero is unknown, its mean is taken off both before and after.

    Parameters
    ----------
    problem
        The campaign.
    fit
        The final model: its scatter is the floor where none was declared.
    typical
        Channel to the set-up scatter that is usual in this campaign (`typical_level`).
    checked
        Predictions for held-out rows.
    seed
        Of the intervals.

    Returns
    -------
    dict
        Channel to figures; None: all together. Empty where nothing was held out.
    """
    found: dict[int | None, HeldOut] = {}
    everything: list[tuple[IntArray, list[FloatArray], FloatArray]] = []
    for c, fixed in problem.fixed.items():
        channel = fixed.channel
        seen = np.isfinite(checked.after[channel.rows])
        if not seen.any():
            continue
        left = [
            _left(channel, p)[seen]
            for p in (
                np.zeros(len(channel.rows)),
                checked.refit[channel.rows],
                checked.after[channel.rows],
                checked.adopted[channel.rows],
                checked.tie_average[channel.rows],
            )
        ]
        visit = channel.visits[channel.block][seen]
        floor = _floor(problem, channel, fit, typical[c])[seen]
        found[c] = _figures(
            visit, [channel.scale * x for x in left], channel.scale**2 * floor, seed
        )
        everything.append((visit, left, floor))
    if everything:
        joined = [np.concatenate([e[1][i] for e in everything]) for i in range(5)]
        visit = np.concatenate([e[0] for e in everything])
        found[None] = _figures(visit, joined, np.concatenate([e[2] for e in everything]), seed)
    return found


def _left(channel: Channel, predicted: FloatArray) -> FloatArray:
    left = channel.values - predicted
    counts = np.diff(np.append(channel.starts, len(left)))
    means = np.add.reduceat(left, channel.starts) / counts
    return np.asarray(left - np.where(channel.free, means, 0.0)[channel.block])


def typical_level(states: Mapping[int, State]) -> dict[int, int]:
    """Find the set-up scatter that most channels agree on, each in its repeatabilities.

    One channel whose visits scatter much more than those of all others does so for a cause;
    its own fit would take that for its set-up.

    Parameters
    ----------
    states
        Channel to state, with the found terms.

    Returns
    -------
    dict
        Channel to its set of visit variances.
    """
    found: dict[int, int] = {}
    for size in {len(s.levels) for s in states.values()}:
        same = {c: s for c, s in states.items() if len(s.levels) == size}
        # No channel may outvote the others by more than so much.
        votes = sum(np.maximum(s.null - s.null.max(), -MOST_SAY) for s in same.values())
        found |= dict.fromkeys(same, int(np.argmax(votes)))
    return found


def _floor(problem: Problem, channel: Channel, fit: Fit, typical: int) -> FloatArray:
    """Give each row's variance from repeatability and set-up alone, in scales squared."""
    declared = problem.rows.noise.get(channel.number)
    known = declared is not None and declared.setup_shift is not None
    level = channel.declared if known else typical
    variances = np.where(
        channel.free[:, None] & (np.arange(channel.shapes.shape[1]) == 0),
        0.0,
        channel.variances[level],
    )
    # Beside a stated repeatability the fitted one may hide what is unexplained.
    stated = declared is not None and declared.repeatability is not None
    scatter = 1.0 if known or stated else fit.scatter[channel.number]
    return np.asarray(
        scatter * (1.0 + np.sum(channel.shapes**2 * variances[channel.block], axis=1))
    )


def _figures(visit: IntArray, left: list[FloatArray], floor: FloatArray, seed: int) -> HeldOut:
    before, refit, after, adopted, average = (figure(x, visit, seed) for x in left)
    return HeldOut(
        rows=len(visit),
        visits=len(np.unique(visit)),
        before=before,
        refit=refit,
        after=after,
        adopted=adopted,
        tie_average=average,
        floor=float(np.sqrt(np.mean(floor))),
    )
