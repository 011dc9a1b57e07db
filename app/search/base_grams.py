"""What is left of every entry's information beside visits and maps, on one set of visits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from app.arrays import FloatArray
from app.search.library import Batch, Library
from app.search.state import State

NOTHING_LEFT: Final = 1e-5
"""A direction is not tested if maps and given terms take up all but this share of it."""

NOTHING_SEEN: Final = 1e-7
"""Nor if the visits' free constants take up all but this share."""


@dataclass(frozen=True, eq=False)
class BaseGram:
    """A batch's information in one channel, without given terms.

    Parameters
    ----------
    gram : ndarray, shape (L, g, k, k)
        At each set of visit variances.
    floor : ndarray, shape (L, g)
        Information below which a direction counts as not seen.
    with_nuisance : ndarray, shape (g k, p)
        Products of the columns with the nuisance, on these cells.
    reduced : ndarray, shape (b, 1 + q, g k)
        Shapes times the columns, each of these cells' visits.
    """

    gram: FloatArray
    floor: FloatArray
    with_nuisance: FloatArray
    reduced: FloatArray


class BaseGrams:
    """Base grams of a library on one set of cells, each computed when it is first asked for.

    They are the costly part of a scan and do not depend on the values or on given terms.

    Parameters
    ----------
    states
        Channel to state on these cells, without terms.
    """

    def __init__(self, library: Library, states: Mapping[int, State]) -> None:
        self._states = states
        self.library = library
        self._known: dict[tuple[int, int], BaseGram] = {}

    def of(self, number: int, channel: int) -> BaseGram:
        """Give a batch's information in one channel."""
        key = (number, channel)
        if key not in self._known:
            self._known[key] = _base_gram(self.library.batches[number], self._states[channel])
        return self._known[key]


def _base_gram(batch: Batch, state: State) -> BaseGram:
    sheet, k = batch.sheets[state.fixed.channel.number], batch.size
    moments = sheet.moments
    with_nuisance = sheet.within(moments.nuisance, state.cells)
    products = sheet.within(sheet.gram, state.cells)
    reduced = moments.reduced if state.blocks.all() else moments.reduced[state.blocks]
    of_visits, of_nuisance = state.levels.taken(with_nuisance.T, reduced, k)
    left = products - of_visits
    seen = np.trace(left, axis1=2, axis2=3)
    floor = np.maximum(NOTHING_LEFT * seen, NOTHING_SEEN)
    return BaseGram(left - of_nuisance, floor, with_nuisance, reduced)
