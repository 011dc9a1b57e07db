"""Levels of set-ups, y = X b + e, whose scatter has one of many covariances: how likely each is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from app.arrays import FloatArray

NEGLIGIBLE: Final = 1e-6
"""Share of a size below which nothing of it is left."""


class Fits(NamedTuple):
    """Levels fitted with each of g covariances.

    `log` is the log likelihood at the best b, `about_zero` at none, and `restricted` with b
    integrated out, each but for the same constant; `sizes` are b, shape (g, p), and `covariance`
    what they are known by, shape (g, p, p).
    """

    log: FloatArray
    about_zero: FloatArray
    restricted: FloatArray
    sizes: FloatArray
    covariance: FloatArray


def fitted(level: FloatArray, design: FloatArray, covariances: FloatArray) -> Fits:
    """Fit levels by generalised least squares.

    Parameters
    ----------
    level : ndarray, shape (m,)
    design : ndarray, shape (m, p)
    covariances : ndarray, shape (g, m, m)
        Of the levels.
    """
    root = np.linalg.cholesky(covariances)
    both = np.column_stack([design, level])
    whitened = np.linalg.solve(root, np.broadcast_to(both, (len(root), *both.shape)))
    x, y = whitened[..., :-1], whitened[..., -1:]
    information = x.transpose(0, 2, 1) @ x
    sizes = np.linalg.solve(information, x.transpose(0, 2, 1) @ y)
    half = np.log(np.diagonal(root, axis1=1, axis2=2)).sum(axis=1)
    log = -half - 0.5 * np.sum((y - x @ sizes) ** 2, axis=(1, 2))
    return Fits(
        log,
        -half - 0.5 * np.sum(y**2, axis=(1, 2)),
        # Integrated over all b alike: the likelihood at the best times the volume |X'K⁻¹X|^(−1/2).
        log - 0.5 * np.linalg.slogdet(information)[1],
        sizes[..., 0],
        np.linalg.inv(information),
    )


def expected_beside(others: Sequence[FloatArray], alone: FloatArray) -> FloatArray:
    """Say how probable scatters of one channel are by what other channels show of theirs.

    One instrument and one room make them alike, unless this channel is unlike all others: of n
    others that is as probable as one in n + 2 (Laplace's rule of succession).

    Parameters
    ----------
    others
        How probable each of n other channels makes each scatter, shape (g,).
    alone : ndarray, shape (g,)
        How probable they are where nothing is known.
    """
    if not others:
        return alone
    odd = 1.0 / (len(others) + 2)
    return np.asarray((1.0 - odd) * np.mean(others, axis=0) + odd * alone)
