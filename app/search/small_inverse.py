"""Inverses of very many very small matrices at once.

G. Golub, C. Van Loan, Matrix Computations (2013): Jacobi's rotation of a 2 × 2 matrix.
"""

from __future__ import annotations

import numpy as np

from app.arrays import FloatArray


def inverse_roots(gram: FloatArray, floor: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Give W with W W' = gram⁻¹ where it informs, and how many directions that are.

    Parameters
    ----------
    gram : ndarray, shape (n, k, k)
        Symmetric.
    floor : ndarray, shape (n,)
        Directions with less information than this are left out.

    Returns
    -------
    root : ndarray, shape (n, k, k)
    rank : ndarray, shape (n,)

    Examples
    --------
    >>> root, rank = inverse_roots(np.array([[[4.0, 0.0], [0.0, 1e-9]]]), np.array([1e-6]))
    >>> (root @ root.transpose(0, 2, 1)).round(6).tolist(), rank.tolist()
    ([[[0.25, 0.0], [0.0, 0.0]]], [1.0])
    """
    if gram.shape[-1] == 1:
        keep = gram > floor[:, None, None]
        root = np.where(keep, 1.0 / np.sqrt(np.where(keep, gram, 1.0)), 0.0)
        return root, keep[:, 0, 0].astype(np.float64)
    values, vectors = _of_two(gram) if gram.shape[-1] == 2 else _of_many(gram)
    keep = values > floor[:, None]
    # `where` computes both sides: the inner one keeps what is dropped from making a NaN.
    scale = np.where(keep, 1.0 / np.sqrt(np.where(keep, values, 1.0)), 0.0)
    return vectors * scale[:, None, :], keep.sum(axis=1).astype(np.float64)


def solutions(
    gram: FloatArray, floor: FloatArray, right: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Solve gram x = right where gram informs: x = W W' right with `inverse_roots`' W.

    Parameters
    ----------
    gram, floor
        As for `inverse_roots`.
    right : ndarray, shape (n, k)

    Returns
    -------
    found : ndarray, shape (n, k)
    rank : ndarray, shape (n,)

    Examples
    --------
    >>> gram, floor = np.array([[[4.0, 2.0], [2.0, 3.0]]]), np.array([1e-6])
    >>> found, rank = solutions(gram, floor, np.array([[8.0, 4.0]]))
    >>> found.round(6).tolist(), rank.tolist()
    ([[2.0, 0.0]], [2.0])
    """
    if gram.shape[-1] != 2:
        return _by_roots(gram, floor, right)
    # By the determinant, and not by roots of which each takes an angle.
    (a, b, c), (first, second) = (gram[:, 0, 0], gram[:, 0, 1], gram[:, 1, 1]), right.T
    determinant = a * c - b**2
    large = (a + c) / 2.0 + np.sqrt(((a - c) / 2.0) ** 2 + b**2)
    informs = determinant > floor * large  # the smaller of two eigenvalues exceeds its floor
    informs &= large > floor
    divisor = np.where(informs, determinant, 1.0)
    solution = np.stack([(c * first - b * second) / divisor, (a * second - b * first) / divisor]).T
    rank = np.full(len(gram), 2.0)
    rest = np.flatnonzero(~informs)
    if rest.size:
        solution[rest], rank[rest] = _by_roots(gram[rest], floor[rest], right[rest])
    return solution, rank


def _by_roots(
    gram: FloatArray, floor: FloatArray, right: FloatArray
) -> tuple[FloatArray, FloatArray]:
    root, rank = inverse_roots(gram, floor)
    # Of matrices this small a product by BLAS is mostly its call.
    turned = np.einsum("nij,ni->nj", root, right)
    return np.einsum("nij,nj->ni", root, turned), rank


def _of_many(gram: FloatArray) -> tuple[FloatArray, FloatArray]:
    values, vectors = np.linalg.eigh(gram)
    return np.asarray(values, dtype=np.float64), np.asarray(vectors, dtype=np.float64)


def _of_two(gram: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Turn by the angle that makes the matrix diagonal: a hundred times faster than eigh."""
    a, b, c = gram[:, 0, 0], gram[:, 0, 1], gram[:, 1, 1]
    angle = 0.5 * np.arctan2(2.0 * b, a - c)
    cos, sin = np.cos(angle), np.sin(angle)
    middle, half = (a + c) / 2.0, np.hypot((a - c) / 2.0, b)
    # The smaller one by the product: a difference would lose its digits.
    large = middle + half
    small = np.where(large > 0, (a * c - b**2) / np.where(large > 0, large, 1.0), middle - half)
    vectors = np.stack([np.stack([cos, -sin], axis=-1), np.stack([sin, cos], axis=-1)], axis=-2)
    return np.stack([large, small], axis=-1), vectors
