"""How small an effect could be and still be seen and told from its best rival: no values needed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from app.arrays import BoolArray, FloatArray
from app.search.base_grams import NOTHING_SEEN, BaseGrams
from app.search.candidate import Candidate
from app.search.draws import Draws
from app.search.findings import Detectable
from app.search.joint_fit import inverse
from app.search.levels import NEGLIGIBLE
from app.search.library import Batch, Library, read_library
from app.search.moments import blocks, moments_of
from app.search.names import STRONG
from app.search.power import NINE_IN_TEN, DrawnNoise, as_assumed, noncentralities
from app.search.problem import Problem
from app.search.scan import scan
from app.search.selection import penalties
from app.search.small_inverse import inverse_roots
from app.search.state import State
from app.search.threshold import Threshold, threshold

POWER: Final = float(ndtri(NINE_IN_TEN))

# Twice the log likelihood ratio of two explanations whose difference has the squares λ, in those of
# the noise, is normal with the mean λ and the variance 4 λ: λ − 2 POWER √λ = STRONG, solved for λ.
TELLING_APART: Final = (POWER + float(np.sqrt(POWER**2 + STRONG))) ** 2
"""Expected evidence between two explanations that exceeds STRONG nine times in ten."""


class Overlap(NamedTuple):
    """Which entry imitates another best, and how much of it."""

    share: float
    rival: int | None


@dataclass(frozen=True, eq=False)
class Information:
    """What the rows say about one entry, at one set of variances.

    Parameters
    ----------
    gram : ndarray, shape (k, k)
        Information about its amplitudes beside visits and maps.
    metric : ndarray, shape (k, k)
        Products of its columns.
    """

    gram: FloatArray
    metric: FloatArray
    rows: int


@dataclass(frozen=True, eq=False)
class Chances:
    """What it takes to be found nine times in ten, and by which noise that was worked out.

    This is the one definition of being found, before measuring and after: the search's threshold
    is passed and the parameters are paid for, with variances that are estimated from the same
    rows.

    Parameters
    ----------
    needed : ndarray, shape (candidates,)
        Noncentrality with which each candidate is found, at the middle of its grid; NaN where it
        cannot be.
    level, scatter
        Channel to the set of visit variances, and the variance of one observation, at which these
        are noncentralities.
    """

    needed: FloatArray
    level: Mapping[int, int]
    scatter: Mapping[int, float]

    @classmethod
    def of(
        cls,
        base: BaseGrams,
        states: Mapping[int, State],
        allowed: BoolArray,
        draws: Draws,
        limit: Threshold,
    ) -> Chances:
        """Work it out beside the noise of some states.

        Parameters
        ----------
        base
            Information of a library's entries in the states' channels.
        states
            Channel to state, beside the terms that are given.
        allowed : ndarray, shape (entries,)
            Which entries may be chosen.
        limit
            The threshold where nothing is there.
        """
        library, noise = base.library, {c: DrawnNoise.of(s, draws) for c, s in states.items()}
        needed = np.full(len(library.candidates), np.nan)
        wanted = set(_middles(library, allowed))
        cost = penalties(library, sum(state.count for state in states.values()))
        parts: dict[tuple[tuple[int, ...], int], list[tuple[int, list[int]]]] = {}
        for number, batch in enumerate(library.batches):
            at = [i for i, entry in enumerate(batch.entries) if entry in wanted]
            if at and all(c in noise for c in batch.channels):
                parts.setdefault((batch.channels, batch.size), []).append((number, at))
        for together in parts.values():
            entries = [library.batches[number].entries[i] for number, at in together for i in at]
            needed[library.groups[entries]] = noncentralities(base, noise, limit, cost, together)
        level = {c: int(np.argmax(state.null)) for c, state in states.items()}
        scatter = {c: float(s.scatter(s.rss[level[c]])) for c, s in states.items()}
        return cls(needed, level, scatter)

    @classmethod
    def before_measuring(
        cls, problem: Problem, candidates: Sequence[Candidate], draws: Draws, false_alarm: float
    ) -> Chances:
        """Work it out beside the noise that is assumed: values are not looked at."""
        library = read_library(problem, candidates, draws, by_cell=False)
        everything = np.ones(problem.cells, dtype=np.bool_)
        states = as_assumed(problem.states(everything), draws)
        base = BaseGrams(library, states)
        drawn = scan(library, states, base, draws).only(library.testable)
        limit = threshold(drawn, library.groups, library.families, false_alarm)
        return cls.of(base, states, library.testable, draws, limit)


def smallest_effects(
    library: Library, states: Mapping[int, State], chances: Chances, rivals: bool = True
) -> list[Detectable]:
    """Give the smallest effects that would be found nine times in ten.

    Parameters
    ----------
    states
        Channel to state, without terms; of the visits that take part.
    rivals
        Whether each is also held against its rivals, which takes much longer.
    """
    needed, level, scatter = chances.needed, chances.level, chances.scatter
    wanted = [
        i for i in _middles(library, library.testable) if np.isfinite(needed[library.groups[i]])
    ]
    per_entry = informations(library, states, level, scatter, wanted)
    chosen = [i for i in wanted if i in per_entry]
    overlaps: dict[int, Overlap] = {}
    if rivals and chosen:
        overlaps = _overlaps(library, states, level, scatter, per_entry, chosen)
    every = (
        _detectable_entry(
            library, i, per_entry[i], float(needed[library.groups[i]]), overlaps.get(i)
        )
        for i in chosen
    )
    return [detectable for detectable in every if detectable is not None]


def _middles(library: Library, allowed: BoolArray) -> list[int]:
    """Take each candidate that may be chosen at the middle of its grid."""
    members: dict[int, list[int]] = {}
    for i in np.flatnonzero(allowed).tolist():
        members.setdefault(library.entries[i].candidate, []).append(i)
    return [m[len(m) // 2] for m in members.values()]


def _detectable_entry(
    library: Library, number: int, information: Information, needed: float, overlap: Overlap | None
) -> Detectable | None:
    entry = library.entries[number]
    if np.trace(information.gram) < NOTHING_SEEN * entry.size:
        return None
    spread = float(np.trace(inverse(information.gram) @ information.metric)) / entry.size
    if spread <= 0 or not np.isfinite(spread):
        return None
    candidate = library.candidates[entry.candidate]
    smallest = float(np.sqrt(needed * spread / information.rows))
    rival, distinguishable = None, smallest
    if overlap is not None:
        if overlap.rival is not None:
            rival = library.candidates[library.entries[overlap.rival].candidate].key
        apart = 1.0 - overlap.share
        distinguishable = (
            float(np.sqrt(TELLING_APART * spread / information.rows / apart))
            if apart > NEGLIGIBLE
            else np.inf
        )
    return Detectable(
        candidate.key,
        candidate.family,
        entry.theta,
        smallest,
        max(smallest, distinguishable),
        rival,
        None if overlap is None else overlap.share,
    )


def informations(
    library: Library,
    states: Mapping[int, State],
    level: Mapping[int, int],
    scatter: Mapping[int, float],
    entries: Sequence[int],
) -> dict[int, Information]:
    """Say what some visits tell about some entries, at known visit variances.

    Parameters
    ----------
    states
        Channel to state on those visits, without terms.
    level, scatter
        Channel to its visit variances, and to the variance of one observation.

    Returns
    -------
    dict
        Entry to information; entries that nothing excites are left out.
    """
    by_entry, wanted = {}, set(entries)
    for batch in (b for b in library.batches if not b.generic):
        places = [i for i, entry in enumerate(batch.entries) if entry in wanted]
        if not places or not all(c in states for c in batch.channels):
            continue
        g, k = len(places), batch.size
        gram, metric = np.zeros((g, k, k)), np.zeros((g, k, k))
        for c in batch.channels:
            sheet = batch.sheets[c]
            products = sheet.within(sheet.gram, states[c].cells)[places]
            gram += (products - blocks(_shadow(states[c], level[c], batch, places), k)) / scatter[c]
            metric += products
        rows = sum(states[c].count for c in batch.channels)
        for i, place in enumerate(places):
            by_entry[batch.entries[place]] = Information(gram[i], metric[i], rows)
    return by_entry


def _shadow(state: State, level: int, batch: Batch, places: Sequence[int]) -> FloatArray:
    """Give the shadow of some of a batch's entries, by their places in it."""
    sheet = batch.sheets[state.fixed.channel.number]
    columns = (batch.size * np.array(places)[:, None] + np.arange(batch.size)).ravel()
    shadow: FloatArray = state.level(level).shadow(
        sheet.within(sheet.moments.nuisance, state.cells)[columns].T,
        sheet.moments.reduced[state.blocks][..., columns],
    )[0]
    return shadow


def _overlaps(
    library: Library,
    states: Mapping[int, State],
    level: Mapping[int, int],
    scatter: Mapping[int, float],
    per_entry: Mapping[int, Information],
    chosen: Sequence[int],
) -> dict[int, Overlap]:
    """Find for each chosen entry the chosen one of another family that imitates it best.

    The share is that of the entry's whitened columns that lies in the rival's span, on average
    over its amplitudes.
    """
    terms = [library.term(i) for i in chosen]
    sizes = np.array([t.size for t in terms])
    starts = np.cumsum([0, *sizes[:-1]])
    products = np.zeros((int(sizes.sum()), int(sizes.sum())), dtype=np.float32)
    for c, state in states.items():
        here = [i for i, t in enumerate(terms) if c in t.columns]
        if here:
            columns = np.hstack([terms[i].columns[c] for i in here])
            at = np.concatenate([np.arange(starts[i], starts[i] + sizes[i]) for i in here])
            whitened = _whitened(state, level[c], columns) / scatter[c]
            products[np.ix_(at, at)] += whitened
    for i, entry in enumerate(chosen):
        # Each entry's own columns become orthonormal: what is left are cosines.
        part = slice(starts[i], starts[i] + sizes[i])
        root = inverse_roots(per_entry[entry].gram[None], np.full(1, NOTHING_SEEN))[0][0]
        products[part] = root.T @ products[part]
        products[:, part] = products[:, part] @ root
    shares = np.add.reduceat(np.add.reduceat(products**2, starts, axis=0), starts, axis=1)
    families = np.array([t.candidate.family for t in terms])
    shares[families[:, None] == families[None, :]] = 0.0
    shares = (shares / sizes[:, None]).clip(0.0, 1.0)
    best = shares.argmax(axis=1)
    return {
        entry: Overlap(float(shares[i, best[i]]), chosen[best[i]] if shares[i, best[i]] else None)
        for i, entry in enumerate(chosen)
    }


def _whitened(state: State, level: int, columns: FloatArray) -> NDArray[np.float32]:
    """Multiply columns with each other beside visits and maps, in short numbers: (m, m)."""
    moments = moments_of(state.fixed.channel, columns, state.fixed.cells)
    taken = state.level(level).shadow(
        moments.nuisance[state.cells].sum(axis=0).T, moments.reduced[state.blocks]
    )[0]
    here = state.cells[state.fixed.channel.cells][state.fixed.channel.block]
    chosen_columns, shadow = columns[here].astype(np.float32), taken.astype(np.float32)
    gram: NDArray[np.float32] = chosen_columns.T @ chosen_columns - shadow.T @ shadow
    return gram
