"""All candidates with all values of their grids, their products gathered in one pass."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from app.arrays import BoolArray, FloatArray, IntArray
from app.errors import InvalidContent
from app.search.candidate import Candidate
from app.search.draws import Draws
from app.search.moments import Fixed, Moments, blocks, moments_of
from app.search.problem import Problem, Term
from app.search.scatter import FEWEST_BLOCKS

TOGETHER: Final = 5_000_000
"""Numbers, at one for each row and entry, that are laid out at once at most."""

KEPT_BYTES: Final = 300_000_000
"""Columns are kept up to this size, and evaluated again beyond it."""

MOST_BYTES: Final = 4_000_000_000
"""Size of the products: they grow as candidates times visits, and times entries of the maps."""


@dataclass(frozen=True, eq=False)
class Entry:
    """One candidate at one value of its grid; `norms` are its columns' lengths."""

    candidate: int
    theta: float | None
    norms: FloatArray

    @property
    def size(self) -> int:
        """How many amplitudes it has."""
        return len(self.norms)

    @cached_property
    def excited(self) -> bool:
        """Whether the rows show it at all."""
        return bool(self.norms.any())


@dataclass(eq=False)
class Sheet:
    """A batch's columns in one channel, and their products.

    Parameters
    ----------
    gram : ndarray, shape (cells, g, k, k)
        Products of each entry's own columns within each cell. These and the moments' products
        have a single cell, that of all rows, where no cells are asked for apart.
    noise : ndarray, shape (g k, B)
        Products with the draws of noise.
    columns : ndarray, shape (n, g k) or None
        The columns, where they are kept.
    """

    gram: FloatArray
    moments: Moments
    noise: NDArray[np.float32]
    columns: FloatArray | None

    def within(self, products: FloatArray, cells: BoolArray) -> FloatArray:
        """Add products up over some cells: over all of them, where they are not kept apart.

        Parameters
        ----------
        products : ndarray, shape (cells, ...) or (1, ...)
        """
        if len(products) == len(cells):
            total: FloatArray = products[cells].sum(axis=0)
            return total
        if not cells.all():
            raise ValueError("expected all cells: these products are not kept apart by cell")
        return np.asarray(products[0])

    @property
    def bytes_of_products(self) -> int:
        """Size of all but the columns."""
        moments = self.moments
        parts = (self.gram, self.noise, moments.nuisance, moments.values, moments.reduced)
        return sum(part.nbytes for part in parts)


@dataclass(eq=False)
class Batch:
    """Entries with the same channels and as many columns, all generic or none."""

    channels: tuple[int, ...]
    size: int
    generic: bool
    entries: list[int]
    sheets: dict[int, Sheet] = field(default_factory=dict)


@dataclass(eq=False)
class Library:
    """Every entry, in batches."""

    problem: Problem
    candidates: Sequence[Candidate]
    entries: list[Entry] = field(default_factory=list)
    batches: list[Batch] = field(default_factory=list)

    @cached_property
    def groups(self) -> IntArray:
        """Each entry's candidate, shape (entries,)."""
        return np.array([entry.candidate for entry in self.entries], dtype=np.intp)

    @cached_property
    def families(self) -> IntArray:
        """Number of each entry's family, shape (entries,)."""
        names = [candidate.family for candidate in self.candidates]
        return np.unique(names, return_inverse=True)[1].astype(np.intp)[self.groups]

    @cached_property
    def blocks_of_entries(self) -> IntArray:
        """The blocks behind every entry, the most of any channel it acts on: shape (entries,)."""
        most_blocks = np.zeros(len(self.entries), dtype=np.intp)
        for batch in self.batches:
            counts = [len(self.problem.fixed[c].channel.starts) for c in batch.channels]
            most_blocks[batch.entries] = max(counts)
        return most_blocks

    def acts_on(self, channels: Collection[int]) -> BoolArray:
        """Say which entries act on any of some channels, shape (entries,)."""
        acting = np.zeros(len(self.entries), dtype=bool)
        for batch in self.batches:
            acting[batch.entries] = not set(channels).isdisjoint(batch.channels)
        return acting

    @cached_property
    def testable(self) -> BoolArray:
        """Which entries may be chosen: with few visits only what one visit excites."""
        blocks = self.blocks_of_entries
        allowed = np.zeros(len(self.entries), dtype=bool)
        for i, entry in enumerate(self.entries):
            candidate = self.candidates[entry.candidate]
            enough = candidate.within_visit or blocks[i] >= FEWEST_BLOCKS
            allowed[i] = entry.excited and enough and not candidate.generic
        return allowed

    def columns(
        self, batch: Batch, channel: int, chosen: Sequence[int] | None = None
    ) -> FloatArray:
        """Give a batch's columns in one channel, kept or evaluated again.

        Parameters
        ----------
        chosen
            Places in the batch of the only entries that are wanted; all without it.

        Returns
        -------
        ndarray, shape (n, g k)
        """
        stored_columns = batch.sheets[channel].columns
        if stored_columns is not None:
            if chosen is None:
                return stored_columns
            by_entry = stored_columns.reshape(len(stored_columns), len(batch.entries), batch.size)
            return by_entry[:, chosen].reshape(len(stored_columns), -1)
        wanted = batch.entries if chosen is None else [batch.entries[i] for i in chosen]
        return np.hstack([self.term(entry).columns[channel] for entry in wanted])

    def take(self, wanted: BoolArray) -> Library:
        """Read some entries again, with their products apart by cell; they keep their numbers.

        Parameters
        ----------
        wanted : ndarray, shape (entries,)

        Returns
        -------
        Library
            Without draws of noise.
        """
        taken = Library(self.problem, self.candidates, self.entries)
        builder = _BatchBuilder(taken, None, by_cell=True)
        for batch in self.batches:
            at = [i for i, entry in enumerate(batch.entries) if wanted[entry]]
            if at:
                emptied = replace(batch, entries=[batch.entries[i] for i in at], sheets={})
                builder.add_batch(emptied, {c: self.columns(batch, c, at) for c in batch.channels})
        return taken

    def term(self, entry: int) -> Term:
        """Evaluate one entry."""
        chosen = self.entries[entry]
        return self.problem.term(self.candidates[chosen.candidate], chosen.theta)


def read_library(
    problem: Problem,
    candidates: Sequence[Candidate],
    draws: Draws | None,
    step: Callable[[float], None] = lambda share: None,
    *,
    by_cell: bool = True,
) -> Library:
    """Evaluate every entry once and gather its products.

    Parameters
    ----------
    draws
        Draws of noise; None: none are needed.
    step
        Told how far it is, 0 to 1; may raise to stop.
    by_cell
        Whether products are kept apart by cell: they are then many times as large.

    Raises
    ------
    InvalidContent
        If the products would take more memory than is stated.
    """
    nothing = np.zeros(1)
    entries = [Entry(n, theta, nothing) for n, c in enumerate(candidates) for theta in c.thetas]
    library = Library(problem, candidates, entries)
    builder = _BatchBuilder(library, draws, by_cell)
    done = 0
    for numbers in _laid_out_together(library):
        step(done / len(entries))
        builder.add(numbers)
        done += len(numbers)
    return library


def _laid_out_together(library: Library) -> Iterator[list[int]]:
    """Part entries, by their numbers, into those of one layout, and those without any."""
    of_layout: dict[object, list[int]] = defaultdict(list)
    for number, entry in enumerate(library.entries):
        layout = library.candidates[entry.candidate].layout
        of_layout[layout and (layout.where, layout.parts)].append(number)
    together = max(1, TOGETHER // max(library.problem.count, 1))
    for numbers in of_layout.values():
        for first in range(0, len(numbers), together):
            yield numbers[first : first + together]


@dataclass(eq=False)
class _BatchBuilder:
    """Lays entries out and gathers their products in batches."""

    library: Library
    draws: Draws | None
    by_cell: bool
    kept_bytes: int = 0
    product_bytes: int = 0

    def add(self, numbers: Sequence[int]) -> None:
        """Lay entries out together, and make a batch of those that are alike."""
        library, chosen = self.library, [self.library.entries[number] for number in numbers]
        wanted = [(library.candidates[e.candidate], e.theta) for e in chosen]
        columns, norms, starts, ends, shows = library.problem.side_by_side(wanted)
        channels = np.array(list(columns), dtype=np.intp)
        alike: dict[tuple[tuple[int, ...], int, bool], list[int]] = defaultdict(list)
        for i, (number, (candidate, _)) in enumerate(zip(numbers, wanted, strict=True)):
            if shows[:, i].any():
                entry = replace(chosen[i], norms=norms[starts[i] : ends[i]])
                library.entries[number] = entry
                shown = tuple(channels[shows[:, i]].tolist())
                alike[shown, entry.size, candidate.generic].append(i)
        for (shown, size, is_generic), at in alike.items():
            batch = Batch(shown, size, is_generic, [numbers[i] for i in at])
            which = (starts[at, None] + np.arange(size)).ravel()
            # Copies: what is kept must not keep alive all that was laid out with it.
            self.add_batch(batch, {c: columns[c].T[which].T for c in shown})

    def add_batch(self, batch: Batch, columns: Mapping[int, FloatArray]) -> None:
        """Gather a batch's products, of its columns in each channel, shape (n, g k)."""
        for number, column in columns.items():
            keep = self.kept_bytes + column.nbytes <= KEPT_BYTES
            fixed = self.library.problem.fixed[number]
            sheet = _sheet(fixed, column, batch.size, self.draws, keep, self.by_cell)
            batch.sheets[number] = sheet
            self.kept_bytes += column.nbytes if keep else 0
            self.product_bytes += sheet.bytes_of_products
        self.library.batches.append(batch)
        self._expect_to_fit()

    def _expect_to_fit(self) -> None:
        """Stop before more memory is taken than is stated."""
        if self.product_bytes <= MOST_BYTES:
            return
        channels = [fixed.channel for fixed in self.library.problem.fixed.values()]
        visits = max(len(channel.starts) for channel in channels)
        directions = max(channel.nuisance.shape[1] for channel in channels)
        raise InvalidContent(
            f"expected a search whose candidates take at most {MOST_BYTES / 1e9:g} GB, got more, "
            f"of {visits:,} visits and {directions:,} ways in which the maps may be wrong: analyse "
            "fewer verifications at once, name the kinds of effects to be tested, or store maps "
            "with fewer positions"
        )


def _sheet(
    fixed: Fixed, columns: FloatArray, size: int, draws: Draws | None, keep: bool, by_cell: bool
) -> Sheet:
    channel = fixed.channel
    none = np.zeros((columns.shape[1], 0), dtype=np.float32)
    noise = draws.products(fixed, columns) if draws else none
    products: FloatArray = blocks(columns, size)[None]
    if by_cell:
        products = np.zeros((fixed.cells, *products.shape[1:]))
        for cell, part in channel.parts:
            products[cell] = blocks(columns[part], size)
    moments = moments_of(channel, columns, fixed.cells if by_cell else None)
    return Sheet(products, moments, noise, columns if keep else None)
