"""Residuals that are larger than the noise, where too few set-ups were made to say why.

Nothing was found, and yet the machine is not as its model says, or the instrument was not where
it should have been: of a few set-ups nobody can tell.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from app.arrays import FloatArray, IntArray, rms
from app.effects.effect import Effect
from app.effects.words import MOST_NAMED
from app.errors import counted, list_names
from app.identification.analysis.analysis import Analysis
from app.identification.analysis.finished_search import FinishedSearch
from app.identification.residuals.residuals import channel_unit
from app.search.findings import FAR_OFF, Status, Unexplained, Verdict
from app.search.noise import KNOWN, shows_scatter
from app.search.priors import DECLARED_WEIGHT, ESTIMATED_WEIGHT
from app.search.rows import Datum, Nuisance
from app.search.scatter import FEWEST_BLOCKS, FEWEST_SETUPS
from app.search.sum_of_squares import surprise_of_squares
from app.search.zeros import without_zeros

LARGER: Final = 2.0
"""Root mean squares so many times what repeatability and maps explain are no chance: the maps'
errors are a few numbers, of which one may well be half as large again as usual."""


FEW: Final = "So few set-ups cannot show what comes from the machine and what from the set-up."

BY_CHANCE: Final = 0.01
"""Probability with which any channel is called larger than set-ups scatter although it is not."""


class TooLarge(NamedTuple):
    """One channel: what it shows, what is expected of it, and in how many set-ups."""

    name: str
    rms: float
    expected: float
    unit: str
    setups: int
    unknown_scatter_of: int = 0
    """Number of its observations, where they say nothing of their own scatter; else 0."""

    @property
    def sentence(self) -> str:
        """Say it."""
        setups = "one set-up" if self.setups == 1 else f"{self.setups} set-ups"
        expected = f"{self.expected:.2g} {self.unit}"
        if self.unknown_scatter_of == 1:
            return (
                f"the only observation of {self.name} is {self.rms:.2g} {self.unit} from what the "
                f"model predicts, where {expected} is to be expected; no repeatability is known, "
                "and one observation says nothing of its own scatter"
            )
        opening = (
            f"{self.name} has residuals of {self.rms:.2g} {self.unit} (root mean square) in "
            f"{setups}, where "
        )
        if self.unknown_scatter_of:
            return (
                f"{opening}{expected} is to be expected; no repeatability is known, and "
                f"{self.unknown_scatter_of} observations there say nothing of their own scatter"
            )
        return f"{opening}repeatability and maps explain {expected}"


class _RowScatter(NamedTuple):
    """How far one observation of a channel scatters, and what that is worth."""

    value: float
    freedom: float
    is_shown: bool


def with_what_stays_large(finished: FinishedSearch) -> FinishedSearch:
    """Call what effects leave unexplained where it is still larger than the noise.

    A set-up of which nobody knows how it scatters, and maps that may be wrong, take up whatever
    is constant in it. Beside an effect that passes for an answer of which nothing is left.

    Beside one that visits that were held out confirm, set-ups may scatter here as they do in the
    other channels: of twenty channels of two set-ups each, some are always large.
    """
    effects = finished.effects()
    if not effects:
        return finished
    names = {item.name for item in stays_large(finished)}
    if any(term.status is Status.CONFIRMED for term in finished.findings.terms):
        names &= _beyond_setups(finished, _explained(finished, effects))
    channels = [c for c, name in enumerate(finished.residuals.rows.channels) if name in names]
    if not channels:
        return finished
    far_off = tuple(Unexplained(FAR_OFF, c, None) for c in channels)
    findings = replace(
        finished.findings,
        verdict=Verdict.UNEXPLAINED,
        unexplained=tuple(dict.fromkeys((*finished.findings.unexplained, *far_off))),
    )
    return replace(finished, findings=findings)


def not_judged(finished: FinishedSearch) -> list[TooLarge]:
    """List the channels of few set-ups that are larger than the noise, and than set-ups scatter.

    With eight set-ups in all the other channels say how set-ups scatter.
    """
    large = too_large(finished)
    if large and np.unique(finished.rows.visit[finished.use]).size >= FEWEST_BLOCKS:
        beyond = _beyond_setups(finished, np.zeros(len(finished.use)))
        large = [item for item in large if item.name in beyond]
    return large


def judged_channels(finished: FinishedSearch) -> list[str]:
    """Name the channels that were measured in enough set-ups to be judged by themselves."""
    rows = finished.rows
    return [
        finished.residuals.rows.channels[c]
        for c in sorted(finished.findings.noise)
        if np.unique(rows.visit[finished.use & (rows.channel == c)]).size >= FEWEST_BLOCKS
    ]


def stays_large(finished: FinishedSearch) -> list[TooLarge]:
    """List the channels of few set-ups that effects leave larger than the noise."""
    return too_large(finished, _explained(finished, finished.effects()))


def _explained(finished: FinishedSearch, effects: Sequence[Effect]) -> FloatArray:
    zero: FloatArray = np.zeros(len(finished.use))
    return sum((finished.explained(e) for e in effects), zero)


def _beyond_setups(finished: FinishedSearch, explained: FloatArray) -> set[str]:
    """Name the channels of few set-ups that are larger than set-ups scatter in the others.

    By chance any is named in one campaign of a hundred: how well a channel's own repeatability
    is known counts, as two values of one set-up say little of it.
    """
    rows, channels = finished.rows, finished.residuals.rows.channels
    values = without_zeros(finished.zeros, np.where(finished.use, rows.values - explained, np.nan))
    setup = _variance_of_setups(finished)
    few = {
        c: rows_of_channel
        for c in finished.findings.noise
        if (rows_of_channel := np.flatnonzero(finished.use & (rows.channel == c))).size
        and np.unique(rows.visit[rows_of_channel]).size < FEWEST_BLOCKS
    }
    scatters, named = _scatters(finished, values, _of_maps(finished)), set()
    for c, rows_of_channel in few.items():
        scatter, visit = scatters[c], rows.visit[rows_of_channel]
        setups = np.unique(visit)
        if not scatter.freedom:
            named.add(channels[c])
            continue
        zeroed = _zeroed(finished, c)
        p = surprise_of_squares(
            float(np.sum(values[rows_of_channel] ** 2)),
            float(scatter.value**2 * (1.0 + zeroed)),
            scatter.freedom,
            (visit[:, None] == setups) * float(np.sqrt(setup / (1.0 + zeroed))),
            _columns(finished.of_maps, c, rows_of_channel),
            len(rows_of_channel),
        )
        if p * len(few) < BY_CHANCE:
            named.add(channels[c])
    return named


def tells_scatter(finished: FinishedSearch, channel: int) -> bool:
    """Whether anything is known of how far one observation of a channel scatters."""
    setups = np.unique(finished.rows.visit[finished.use & (finished.rows.channel == channel)]).size
    return setups >= FEWEST_SETUPS or not _is_without_scatter(finished, channel)


def _is_without_scatter(finished: FinishedSearch, channel: int) -> bool:
    """Whether observations show nothing of their own scatter, and nothing is stated of it."""
    return finished.findings.noise[channel].origin == "residuals" and not shows_scatter(
        finished.rows, channel, finished.use
    )


def _scatters(
    finished: FinishedSearch, values: FloatArray, of_maps: FloatArray
) -> dict[int, _RowScatter]:
    """Say how far one observation of each channel scatters.

    Where a shift and a tilt of each set-up leave nothing over that would show it, the search took
    the residuals themselves for it, and nothing could exceed that. Then four set-ups tell how
    they scatter in all; else it is taken for as many times the maps' own uncertainty as in the
    other channels; and where no channel shows it, nobody knows it.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Residuals; NaN takes no part.
    of_maps : ndarray, shape (n,)
        The variance that the maps' uncertainty leaves in each row.
    """
    rows, scatters, times = finished.rows, {}, []
    rows_of_channel = {
        c: np.flatnonzero(finished.use & (rows.channel == c)) for c in finished.findings.noise
    }
    rows_of_channel = {c: numbers for c, numbers in rows_of_channel.items() if numbers.size}
    for c, numbers in rows_of_channel.items():
        noise = finished.findings.noise[c]
        if _is_without_scatter(finished, c):
            continue
        declared = DECLARED_WEIGHT if noise.origin in KNOWN else 0.0
        spare = len(numbers) - np.unique(rows.visit[numbers]).size
        scatters[c] = _RowScatter(noise.fitted, max(declared + spare, 1.0), is_shown=True)
        if (uncertain := float(np.mean(of_maps[numbers]))) > 0.0:
            times.append(noise.fitted / np.sqrt(uncertain))
    for c in rows_of_channel.keys() - scatters.keys():
        numbers = rows_of_channel[c]
        if np.unique(rows.visit[numbers]).size >= FEWEST_SETUPS:
            size, freedom = float(np.std(values[numbers], ddof=1)), float(len(numbers) - 1)
        elif times:
            size = float(np.median(times) * np.sqrt(np.mean(of_maps[numbers])))
            freedom = ESTIMATED_WEIGHT
        else:
            size, freedom = 0.0, 0.0
        scatters[c] = _RowScatter(size, freedom, is_shown=False)
    return scatters


def _variance_of_setups(finished: FinishedSearch) -> float:
    """Give how set-ups scatter in the middle one of the channels, over the observations' variance.

    0 where fewer set-ups than tell that were made in all.
    """
    if np.unique(finished.rows.visit[finished.use]).size < FEWEST_BLOCKS:
        return 0.0
    floors = [judged.floor for judged in finished.findings.held_out.values()]
    shares = [(floor.setups / floor.noise) ** 2 if floor.noise > 0.0 else 0.0 for floor in floors]
    return float(np.median(shares)) if shares else 0.0


def _columns(maps: Sequence[Nuisance], channel: int, rows: IntArray) -> FloatArray:
    """Lay out what one standard error of each way in which the maps may be wrong does, (m, p)."""
    parts = [entries.at(rows) for entries in maps if entries.channel == channel]
    return np.hstack([np.zeros((len(rows), 0)), *parts])


def too_large(finished: FinishedSearch, explained: FloatArray | float = 0.0) -> list[TooLarge]:
    """List the channels of few set-ups whose residuals are larger than the noise.

    Zeros that nobody knows are taken off. A channel of eight set-ups or more says by itself how
    its set-ups scatter, and takes no part.

    Parameters
    ----------
    explained : ndarray, shape (n,) [the channels' units]
        What effects say of each row.

    Returns
    -------
    list of TooLarge
        The one that exceeds most first.
    """
    rows, use = finished.rows, finished.use
    values = without_zeros(finished.zeros, np.where(use, rows.values - explained, np.nan))
    variance = _of_maps(finished)
    large = []
    for channel, scatter in _scatters(finished, values, variance).items():
        of_channel = use & (rows.channel == channel)
        setups = np.unique(rows.visit[of_channel]).size
        if setups >= FEWEST_BLOCKS:
            continue
        size = rms(values[of_channel])
        own = scatter.value**2 * (1.0 + _zeroed(finished, channel))
        expected = float(np.sqrt(own + np.mean(variance[of_channel])))
        if size > LARGER * expected:
            name = finished.residuals.rows.channels[channel]
            unknown = 0 if scatter.is_shown else int(of_channel.sum())
            unit = channel_unit(name).symbol
            large.append(TooLarge(name, size, expected, unit, setups, unknown))
    return sorted(large, key=lambda item: -item.rms / max(item.expected, np.finfo(float).tiny))


def withhold(
    answer: Analysis,
    large: Sequence[TooLarge],
    remaining: Sequence[TooLarge],
    judged: Sequence[str] = (),
) -> Analysis:
    """Say of what few set-ups do not tell, and `not-judged` where nothing else was found.

    Parameters
    ----------
    judged
        Channels of enough set-ups.
    large, remaining
        Channels of few set-ups that are larger than the noise, and those that are so beside
        what was found.
    """
    parts = [test for part in answer.unexplained for test in part.tests]
    is_open = answer.verdict == "unexplained" and set(parts) <= {FAR_OFF}
    if answer.effects and answer.verdict == "effects-found" and remaining:
        return replace(
            answer,
            summary=(
                f"{answer.summary} Nothing more can be said about "
                f"{list_names([channel.name for channel in remaining], 4)}: "
                f"{_size_words(remaining)}. {FEW}"
            ),
            what_next=(*answer.what_next, _again(remaining)),
        )
    if not large or answer.effects or not (answer.verdict == "nothing-found" or is_open):
        return answer
    return replace(
        answer,
        verdict="not-judged",
        summary=f"{_what_can_be_said(large, judged)}: {_size_words(large)}. {FEW}",
        what_next=(_again(large), *answer.what_next),
    )


def _what_can_be_said(large: Sequence[TooLarge], judged: Sequence[str]) -> str:
    if not judged:
        return "Nothing can be said about the machine"
    where = list_names(judged, MOST_NAMED)
    return (
        f"Nothing was found that the model lacks in {where}; nothing can be said about "
        f"{list_names([channel.name for channel in large], MOST_NAMED)}"
    )


def _size_words(large: Sequence[TooLarge]) -> str:
    others = "" if len(large) == 1 else f", and {counted(len(large) - 1, 'other')} as well"
    return large[0].sentence + others


def _again(large: Sequence[TooLarge]) -> str:
    twice = any(channel.unknown_scatter_of for channel in large)
    return (
        f"Measure {list_names([channel.name for channel in large], 4)} again in at least "
        f"{FEWEST_BLOCKS} "
        "set-ups at different temperatures, mounting the instrument afresh each time"
        f"{' and each place twice' if twice else ''}."
    )


def _zeroed(finished: FinishedSearch, channel: int) -> float:
    """Give the share of a channel's rows that have the noise of a first observation too."""
    rows = finished.rows
    visits = rows.visit[finished.use & (rows.channel == channel)].tolist()
    return float(np.mean([rows.datum.get((v, channel)) is Datum.FIRST for v in visits]))


def _of_maps(finished: FinishedSearch) -> FloatArray:
    """Give the variance that the maps' uncertainty leaves in each row, shape (n,)."""
    variances = np.zeros(len(finished.use))
    for entries in finished.of_maps:
        variances[entries.rows] += np.sum(entries.columns**2, axis=1)
    return variances
