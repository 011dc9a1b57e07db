"""What observations share beside the model: set-ups, and a wander in time within and across them.

Rows are gathered in *blocks*: rows of one set-up at about one time. In one channel a block's
rows share a shift and tilts u, so that with Z = (1, tilt columns) the covariance of all rows is

    V = I + Z K Z',   K(i, j) = own · [same set-up] + wander · exp(−|t_i − t_j| / τ),

in multiples of the repeatability's variance, for the shift and for each tilt by itself. *own* is
the set-up: mounted once, it stays. *wander* is an Ornstein-Uhlenbeck process of the room, the
instrument, the machine: it does not begin anew with a set-up. Blocks far apart in time come out
as independent by themselves, so that many short visits and one long record have one covariance.

Where each set-up is one block, and they are far apart, nothing tells its own scatter from a
wander: there is none, and K is diagonal.

References
----------
G. Uhlenbeck, L. Ornstein, Phys. Rev. 36 (1930) 823: the process.
C. Rasmussen, C. Williams, Gaussian Processes for Machine Learning (2006), ch. 2, 4.2: its use as
a prior for a function of time.
M. Woodbury, Inverting modified matrices (1950): V⁻¹ without forming V.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np
from scipy.linalg import solve_triangular

from app.arrays import BoolArray, FloatArray, IntArray
from app.search.priors import APART, CORRELATION_TIMES_MIN, TIED, TIED_OF_RECORDS, WANDERS

FEWEST_BLOCKS: Final = 8
"""Fewer blocks say nothing about what differs between them."""

REACH: Final = 3.0
"""Set-ups so many time constants apart count as independent: 5 % of a variance is left out, and
days of visits need not be one matrix."""

UNLIMITED: Final = 1e6
"""Variance of a constant that nobody knows, over the variance of one observation."""

LONG_MIN: Final = 90.0
"""A shorter set-up is one block, where others measure the same: temperatures hardly move in it."""

SHORTEST_BLOCK_MIN: Final = 2.0
"""Rows of a long set-up that are nearer than this in time share a block."""

BLOCKS_OF_A_SETUP: Final = 100
"""At most about so many: what whitens them grows as their square."""

BLOCKS_IN_ALL: Final = 400
"""And so many in all long set-ups together."""

NEAR_MIN: Final = 45.0
"""Set-ups that follow each other so soon, in the median, share what wanders."""

FEWEST_NEAR: Final = 24
"""Fewer near set-ups do not tell a wander from a trend that they share."""

LARGE: Final = 24
"""Size of a system from which one call each costs less than general elimination."""

KEPT_BYTES: Final = 100_000_000
"""Factors of a channel are kept up to this size: the same ones serve scan after scan."""

FEWEST_SETUPS: Final = 4
"""Fewer set-ups do not tell how set-ups scatter."""

KEEPS_POSITIVE: Final = 1e-9
"""Added to K's diagonal: blocks at one time, or none that scatter, leave it singular."""

ROUNDING: Final = 1e-5
"""And so much of a diagonal entry, where an unknown zero makes it large."""


class Scatter(NamedTuple):
    """One set of variances that is tried: multiples of a set-up's own, and a wander."""

    shift: float
    tilt: float
    wander: float = 0.0
    minutes: float = CORRELATION_TIMES_MIN[0]

    def is_above(self, other: Scatter, times: float = 1.0) -> bool:
        """Whether K less so many times another's has no negative eigenvalue, wherever blocks lie.

        A wander's spectrum 2 w τ / (1 + ω² τ²) is above another's everywhere if both w τ, at slow
        frequencies, and w / τ, at fast ones, are.

        >>> Scatter(4.0, 4.0).is_above(Scatter(1.0, 1.0)), Scatter(4.0, 0.3).is_above(Scatter(1, 1))
        (True, False)
        """
        sizes, others = (
            (s.shift, s.tilt, s.wander * s.minutes, s.wander / s.minutes) for s in (self, other)
        )
        return all(size >= times * least for size, least in zip(sizes, others, strict=True))


class Factors(NamedTuple):
    """Factors of clusters of k blocks that scatter together, at sets of variances that reach alike.

    Parameters
    ----------
    sets : ndarray, shape (l,)
        Which of the sets of variances these are.
    blocks : ndarray, shape (c, k)
        Each cluster's, by number.
    factor : ndarray, shape (l, c, k s, k s)
        For s shapes.
    """

    sets: IntArray
    blocks: IntArray
    factor: FloatArray


@dataclass(frozen=True, eq=False)
class Whitening:
    """The factors F of V⁻¹ = I − (F Z')'(F Z') at L sets of variances.

    Parameters
    ----------
    log_determinant : ndarray, shape (L,)
        Of V.
    """

    parts: tuple[Factors, ...]
    log_determinant: FloatArray

    @property
    def bytes(self) -> int:
        """Size of the factors."""
        return sum(part.factor.nbytes for part in self.parts)

    def take(self, wanted: IntArray) -> Whitening:
        """Keep some of the sets of variances, by their numbers, increasing."""
        parts = []
        for sets, index, factor in self.parts:
            places = np.flatnonzero(np.isin(sets, wanted))
            if places.size:
                numbers = np.searchsorted(wanted, sets[places])
                parts.append(Factors(numbers, index, factor[places]))
        return Whitening(tuple(parts), self.log_determinant[wanted])

    def turn(self, reduced: FloatArray, out: FloatArray | None = None) -> FloatArray:
        """Apply F to sums over blocks: shape (b, s, m) to (L, b s, m), into an array if given."""
        blocks, shapes, columns = reduced.shape
        if out is None:
            out = np.empty((len(self.log_determinant), blocks * shapes, columns))
        split = out.reshape(len(out), blocks, shapes, columns)
        return _applied(self.parts, reduced[None], split).reshape(out.shape)

    def turn_back(self, turned: FloatArray, shapes: int) -> FloatArray:
        """Apply F', shape (L, b s, m) to (L, b s, m)."""
        back = [part._replace(factor=part.factor.transpose(0, 1, 3, 2)) for part in self.parts]
        levels, rows, columns = turned.shape
        split = turned.reshape(levels, rows // shapes, shapes, columns)
        return _applied(back, split, np.empty(split.shape)).reshape(turned.shape)


@dataclass(frozen=True, eq=False)
class Blocks:
    """How the blocks of one channel lie in time and in set-ups.

    Parameters
    ----------
    setups : ndarray, shape (b,)
        Number of each block's set-up.
    minutes : ndarray, shape (b,)
        Its time.
    free : ndarray, shape (b,)
        Whether the zero of its set-up is unknown.
    own : ndarray, shape (s,)
        A set-up's variance of shift and tilts, as assumed.
    wander : ndarray, shape (s,)
        The wander's variances of shift and tilts, over its shift's.
    is_own_unknown
        Whether too few set-ups tell how they scatter: `own` is then wide, and says nothing.
    """

    setups: IntArray
    minutes: FloatArray
    free: BoolArray
    own: FloatArray
    wander: FloatArray
    is_own_unknown: bool = False
    _known: dict[tuple[tuple[Scatter, ...], bytes], Whitening] = field(
        default_factory=dict, init=False
    )

    @property
    def are_records(self) -> bool:
        """Whether any set-up has several blocks."""
        return len(np.unique(self.setups)) < len(self.setups)

    @property
    def may_wander(self) -> bool:
        """Whether a wander lasts from block to block: within set-ups, or from one to the next."""
        apart = np.diff(np.sort(self.minutes))
        if len(apart) + 1 < FEWEST_NEAR:
            return self.are_records
        # Without times nothing is known of what is near.
        return self.are_records or 0.0 < float(np.median(apart)) <= NEAR_MIN

    def own_variances(self, scatter: Scatter) -> FloatArray:
        """Give each block's variances beside what is unknown of zeros and set-ups, shape (b, s)."""
        own = np.zeros(len(self.own)) if self.is_own_unknown else self.of_setup(scatter)
        known = own + scatter.wander * self.wander
        found = np.broadcast_to(known, (len(self.free), len(known))).copy()
        found[self.free, 0] = scatter.wander * self.wander[0]
        return found

    def covariance(self, scatter: Scatter, which: IntArray, zeros: float = UNLIMITED) -> FloatArray:
        """Form K of clusters of blocks, ordered block by block.

        Parameters
        ----------
        which : ndarray, shape (c, k)
            The blocks of c clusters.
        zeros
            Variance of an unknown zero; 0 leaves it out.

        Returns
        -------
        ndarray, shape (c, k s, k s)
        """
        (c, k), s = which.shape, len(self.own)
        setups, minutes = self.setups[which], self.minutes[which]
        same = setups[:, :, None] == setups[:, None, :]
        fading = np.exp(-np.abs(minutes[:, :, None] - minutes[:, None, :]) / scatter.minutes)
        found: FloatArray = np.zeros((c, k, s, k, s))
        for i, (own, wander) in enumerate(zip(self.of_setup(scatter), self.wander, strict=True)):
            constant = np.where(self.free[which] & (i == 0), zeros, own)[:, :, None]
            found[:, :, i, :, i] = same * constant + scatter.wander * wander * fading
        return found.reshape(c, k * s, k * s)

    def draw(self, scatter: Scatter, unit: FloatArray) -> FloatArray:
        """Give unit draws K's covariance, unknown zeros left out; shape (b, s, m)."""
        alone = np.zeros(1, dtype=np.intp)
        roots = [
            Factors(alone, index, _root(self.covariance(scatter, index, zeros=0.0))[None])
            for index in self._clusters(scatter, np.ones(len(self.free), dtype=np.bool_))
        ]
        found: FloatArray = _applied(roots, unit[None], np.empty((1, *unit.shape)))[0]
        return found

    def whitening(self, tried: tuple[Scatter, ...], gram: FloatArray, use: BoolArray) -> Whitening:
        """Factorise V on some blocks, at each of some sets of variances.

        With K = C C' and L L' = I + C' Z'Z C, F = L⁻¹ C' and log det V = 2 Σ log diag L:
        nothing of the size of the rows squared is ever formed.

        Parameters
        ----------
        gram : ndarray, shape (b, s, s)
            Z'Z of each block.
        use : ndarray, shape (b,)
            Which blocks take part; the factors number them from 0.

        Examples
        --------
        >>> alone = np.zeros(1)
        >>> one = Blocks(np.zeros(1, int), alone, alone > 0, np.array([2.0]), np.array([1.0]))
        >>> w = one.whitening((Scatter(1.0, 1.0),), np.array([[[3.0]]]), alone == 0)
        >>> round(float(np.exp(w.log_determinant[0])), 6)     # det(I + 2·11') of three rows
        7.0
        """
        key = (tried, use.tobytes())
        found = self._known.pop(key, None) or self._whitening(tried, gram, use)
        self._known[key] = found  # the last used at the end
        while sum(w.bytes for w in self._known.values()) > KEPT_BYTES and len(self._known) > 1:
            del self._known[next(iter(self._known))]
        return found

    def _whitening(self, tried: tuple[Scatter, ...], gram: FloatArray, use: BoolArray) -> Whitening:
        place = np.cumsum(use) - 1
        parts, log_determinant = [], np.zeros(len(tried))
        reaches = np.array([_reach(scatter) for scatter in tried])
        for reach in np.unique(reaches):
            sets = np.flatnonzero(reaches == reach)
            for in_time in self._clusters(tried[sets[0]], use):
                # In the blocks' own order: where a part has all of them they are taken as they lie.
                index = np.sort(in_time, axis=1)
                index = index[np.argsort(index[:, 0])]
                factor, of_clusters = self._factors([tried[i] for i in sets], index, gram)
                parts.append(Factors(sets, place[index].astype(np.intp), factor))
                log_determinant[sets] += of_clusters
        return Whitening(tuple(parts), log_determinant)

    def _factors(
        self, tried: Sequence[Scatter], index: IntArray, gram: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Give F of clusters of blocks, shape (l, c, k s, k s), and log det V of them all, (l,)."""
        (c, k), s = index.shape, len(self.own)
        squares = np.zeros((c, k, s, k, s))
        squares[:, np.arange(k), :, np.arange(k), :] = gram[index].transpose(1, 0, 2, 3)
        factor, log_determinant = np.empty((len(tried), c, k * s, k * s)), np.zeros(len(tried))
        # One after the other: of long records each takes much memory on the way.
        for i, scatter in enumerate(tried):
            # By C with K = C C' and not by K⁻¹, which there is none of where nothing scatters.
            # I + C'Z'Z C has no eigenvalue below 1: its factor never fails.
            root = _root(self.covariance(scatter, index))
            back = root.transpose(0, 2, 1)
            inner = back @ squares.reshape(c, k * s, k * s) @ root
            lower = np.asarray(np.linalg.cholesky(inner + np.eye(k * s)), dtype=np.float64)
            diagonals = np.diagonal(lower, axis1=1, axis2=2)
            log_determinant[i] = 2.0 * float(np.log(diagonals).sum())
            factor[i] = _solved(lower, back)
        return factor, log_determinant

    def of_setup(self, scatter: Scatter) -> FloatArray:
        """Give a set-up's variances of shift and tilts, shape (s,)."""
        multiples: FloatArray = np.full(len(self.own), scatter.tilt)
        multiples[0] = scatter.shift
        return self.own * multiples

    def _clusters(self, scatter: Scatter, use: BoolArray) -> list[IntArray]:
        """Gather the blocks that scatter together, those of equal size side by side."""
        order = np.flatnonzero(use)
        order = order[np.argsort(self.minutes[order], kind="stable")]
        number = _joined(self.setups[order], self.minutes[order], _reach(scatter))
        by_number = order[np.argsort(number, kind="stable")]
        members = np.split(by_number, np.cumsum(np.bincount(number))[:-1]) if len(order) else []
        sizes = sorted({len(m) for m in members})
        return [np.stack([m for m in members if len(m) == size]) for size in sizes]


def _joined(setups: IntArray, minutes: FloatArray, reach: float) -> IntArray:
    """Number what hangs together, by set-up or by time (in order); shape (k,)."""
    number = np.arange(len(setups))
    number[1:] = np.cumsum(np.diff(minutes) > reach) if len(setups) else 0
    number[:1] = 0
    # Set-ups that reach over a pause tie together what lies on either side of it.
    known, counts = np.unique(setups, return_counts=True)
    for setup in known[counts > 1]:
        own = np.unique(number[setups == setup])
        if len(own) > 1:
            number[np.isin(number, own)] = own[0]
    return np.unique(number, return_inverse=True)[1].astype(np.intp)


def _reach(scatter: Scatter) -> float:
    """Give how far apart in time [min] blocks of different set-ups still scatter together."""
    return REACH * scatter.minutes if scatter.wander else -1.0


def _applied(parts: Sequence[Factors], split: FloatArray, out: FloatArray) -> FloatArray:
    """Multiply what stands at each cluster's blocks with its factors.

    Parameters
    ----------
    split : ndarray, shape (L, b, s, m) or (1, b, s, m)
    out : ndarray, shape (L, b, s, m)
        Where it is written.
    """
    of_each, blocks, shapes, columns = split.shape
    for sets, index, factor in parts:
        levels, (clusters, k) = len(factor), index.shape
        size = (clusters, k * shapes, columns)
        is_every = levels == len(out)
        inputs = split if is_every or of_each == 1 else split[sets]
        if index.size == blocks and (index.ravel() == np.arange(blocks)).all():
            here = out if is_every else np.empty((levels, *out.shape[1:]))
            whole = inputs.reshape(len(inputs), *size)
            np.matmul(factor, whole, out=here.reshape(levels, *size))
            if not is_every:
                out[sets] = here
        else:
            product = factor @ inputs[:, index].reshape(len(inputs), *size)
            part = product.reshape(levels, clusters, k, shapes, columns)
            out[sets[:, None, None], index] = part
    return out


def _solved(lower: FloatArray, right: FloatArray) -> FloatArray:
    """Solve triangular systems; small ones all at once, large ones by what is triangular."""
    if lower.shape[-1] < LARGE:
        return np.asarray(np.linalg.solve(lower, right), dtype=np.float64)
    pairs = zip(lower, right, strict=True)
    return np.stack([solve_triangular(a, b, lower=True, check_finite=False) for a, b in pairs])


def _root(covariance: FloatArray) -> FloatArray:
    """Give the lower Cholesky factors of covariances, shape (c, n, n)."""
    size = np.diagonal(covariance, axis1=1, axis2=2)
    more = KEEPS_POSITIVE * (1.0 + ROUNDING * size)
    found = np.linalg.cholesky(covariance + more[:, :, None] * np.eye(covariance.shape[1]))
    return np.asarray(found, dtype=np.float64)


def scatters(blocks: Blocks) -> tuple[Scatter, ...]:
    """List the sets of variances over which the likelihood is profiled."""
    shifted, tilted = not bool(blocks.free.all()), len(blocks.own) > 1
    # Beside a wander the set-ups' own scatter is as assumed: a slow wander says the rest of it.
    wandering = [Scatter(1.0, 1.0, w, t) for w in WANDERS for t in CORRELATION_TIMES_MIN]
    if not blocks.are_records:
        tied = [Scatter(m, m) for m in TIED]
        apart = [Scatter(*pair) for pair in APART] if tilted and shifted else []
        return (*tied, *apart, *(wandering if blocks.may_wander else ()))
    few = len(np.unique(blocks.setups)) < FEWEST_SETUPS
    own = (1.0,) if few else TIED_OF_RECORDS if shifted or tilted else (1.0,)
    return (*(Scatter(m, m) for m in own), *wandering)


def blocks_in_time(
    setup: IntArray, minutes: FloatArray, cut: Collection[int] = frozenset()
) -> IntArray:
    """Number the blocks of rows: rows of one set-up at about one time.

    Parameters
    ----------
    setup : ndarray, shape (n,)
        Numbers of the set-ups, growing with time.
    minutes : ndarray, shape (n,)
        Time of each row.
    cut
        Set-ups that are cut though they are short.

    Returns
    -------
    ndarray, shape (n,)
        Growing from set-up to set-up, and with time within each.

    Examples
    --------
    >>> setup, minutes = np.array([0, 0, 1, 1, 1]), np.array([0.0, 20.0, 100.0, 101.0, 260.0])
    >>> blocks_in_time(setup, minutes), blocks_in_time(setup, minutes, {0})
    (array([0, 0, 1, 1, 2]), array([0, 1, 2, 2, 3]))
    """
    members = {s: np.flatnonzero(setup == s) for s in np.unique(setup).tolist()}
    spans = {s: float(np.ptp(minutes[own])) for s, own in members.items()}
    spans = {s: span for s, span in spans.items() if span >= LONG_MIN or s in cut}
    total = sum(spans.values())
    blocks, number = np.zeros(len(setup), dtype=np.intp), 0
    for s, own in members.items():
        blocks[own] = number
        if s in spans:
            longest = max(SHORTEST_BLOCK_MIN, spans[s] / BLOCKS_OF_A_SETUP, total / BLOCKS_IN_ALL)
            blocks[own] += _stretches(minutes[own], longest)
        number = int(blocks[own].max()) + 1
    return blocks


def setups_alone(setup: IntArray, channel: IntArray) -> set[int]:
    """List the set-ups of whose channels none is measured in `FEWEST_SETUPS` set-ups.

    As a test of each axis in a file of its own: as one block, nothing of it could be held out.

    Examples
    --------
    >>> setups_alone(np.array([0, 1, 2, 3, 4, 5, 5]), np.array([7, 8, 8, 8, 8, 7, 8]))
    {0}
    """
    pairs = np.unique([setup, channel], axis=1)
    _, which, setups = np.unique(pairs[1], return_inverse=True, return_counts=True)
    return {*pairs[0].tolist()} - {*pairs[0, setups[which] >= FEWEST_SETUPS].tolist()}


def _stretches(minutes: FloatArray, longest: float) -> IntArray:
    """Number stretches of time that are shorter than a limit, each begun by its first row."""
    found = np.zeros(len(minutes), dtype=np.intp)
    began, number = -np.inf, -1
    for row in np.argsort(minutes, kind="stable").tolist():
        if minutes[row] - began >= longest:
            began, number = minutes[row], number + 1
        found[row] = number
    return found
