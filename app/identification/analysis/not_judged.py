"""Residuals that are larger than the noise, where too few set-ups were made to say why.

Nothing was found, and yet the machine is not as its model says, or the instrument was not where
it should have been: of a few set-ups nobody can tell.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from app.arrays import FloatArray
from app.errors import counted, list_names
from app.identification.analysis.analysis import Analysis
from app.identification.analysis.before_after import without_zeros
from app.identification.analysis.finished_search import FinishedSearch
from app.identification.residuals.residuals import channel_unit
from app.search.findings import FAR_OFF, Unexplained, Verdict
from app.search.rows import Datum, Nuisance
from app.search.scatter import FEWEST_BLOCKS

LARGER: Final = 2.0
"""Root mean squares so many times what repeatability and maps explain are no chance: the maps'
errors are a few numbers, of which one may well be half as large again as usual."""


class TooLarge(NamedTuple):
    """One channel: what it shows, what is expected of it, and in how many set-ups."""

    name: str
    rms: float
    expected: float
    unit: str
    setups: int

    @property
    def sentence(self) -> str:
        """Say it."""
        setups = "one set-up" if self.setups == 1 else f"{self.setups} set-ups"
        return (
            f"{self.name} is {self.rms:.2g} {self.unit} (root mean square) in {setups}, where "
            f"repeatability and maps explain {self.expected:.2g} {self.unit}"
        )


def with_what_stays_large(found: FinishedSearch, maps: Sequence[Nuisance]) -> FinishedSearch:
    """Call what effects leave unexplained where it is still larger than the noise.

    A set-up of which nobody knows how it scatters, and maps that may be wrong, take up whatever
    is constant in it. Beside an effect that passes for an answer of which nothing is left.
    """
    effects = found.effects()
    if not effects:
        return found
    explained = sum((found.explained(e) for e in effects), np.zeros(len(found.use)))
    names = {one.name for one in too_large(found, maps, explained)}
    channels = [c for c, name in enumerate(found.residuals.rows.channels) if name in names]
    if not channels:
        return found
    left = tuple(Unexplained(FAR_OFF, c, None) for c in channels)
    findings = replace(
        found.findings,
        verdict=Verdict.UNEXPLAINED,
        unexplained=tuple(dict.fromkeys((*found.findings.unexplained, *left))),
    )
    return replace(found, findings=findings)


def too_large(
    found: FinishedSearch, maps: Sequence[Nuisance], explained: FloatArray | float = 0.0
) -> list[TooLarge]:
    """List the channels of few set-ups whose residuals are larger than the noise.

    Zeros that nobody knows are taken off. A channel of eight set-ups or more says by itself how
    its set-ups scatter, and takes no part.

    Parameters
    ----------
    explained : ndarray, shape (n,) [the channels' units]
        What effects say of each row.
    maps
        Change of each row for one standard error of each way in which the maps may be wrong.

    Returns
    -------
    list of TooLarge
        The one that exceeds most first.
    """
    rows, use = found.rows, found.use
    values = without_zeros(found.zeros, np.where(use, rows.values - explained, np.nan))
    variance = _of_maps(len(values), maps)
    large = []
    for channel, noise in found.findings.noise.items():
        own = use & (rows.channel == channel)
        setups = np.unique(rows.visit[own]).size
        if not own.any() or setups >= FEWEST_BLOCKS:
            continue
        size = float(np.sqrt(np.mean(values[own] ** 2)))
        # Counted from a first observation, all of them have its noise too.
        zeroed = np.mean(
            [rows.datum.get((int(v), channel)) is Datum.FIRST for v in rows.visit[own]]
        )
        expected = float(np.sqrt(noise.fitted**2 * (1.0 + zeroed) + np.mean(variance[own])))
        if size > LARGER * expected:
            name = found.residuals.rows.channels[channel]
            large.append(TooLarge(name, size, expected, channel_unit(name).symbol, setups))
    return sorted(large, key=lambda one: -one.rms / one.expected)


def withhold(answer: Analysis, large: Sequence[TooLarge]) -> Analysis:
    """Answer `not-judged` where nothing was found, or only that few set-ups lie far off."""
    parts = [test for part in answer.unexplained for test in part.tests]
    is_open = answer.verdict == "unexplained" and set(parts) <= {FAR_OFF}
    if not large or answer.effects or not (answer.verdict == "nothing-found" or is_open):
        return answer
    most = large[0]
    others = "" if len(large) == 1 else f", and {counted(len(large) - 1, 'other')} as well"
    return replace(
        answer,
        verdict="not-judged",
        summary=f"Nothing can be said of the machine: {most.sentence}{others}. So few set-ups do "
        "not tell what is the machine's and what is the set-up's.",
        what_next=(
            f"Measure {list_names([one.name for one in large], 4)} again in {FEWEST_BLOCKS} "
            "set-ups or more, the instrument mounted anew each time, at different temperatures.",
            *answer.what_next,
        ),
    )


def _of_maps(count: int, maps: Sequence[Nuisance]) -> FloatArray:
    """Give the variance that the maps' uncertainty leaves in each row, shape (n,)."""
    found = np.zeros(count)
    for one in maps:
        found[one.rows] += one.columns**2 @ one.prior**2
    return found
