"""What a response says of causes: which kinds take part, which single drivers, and by how much.

Three claims with evidence of their own. A kind of cause takes part if the values are less likely
without all its columns, everything else learnt anew. A single driver is named only if nothing
stands in for it. What it amounts to is said of a response of few causes: the states, how bodies
stood at the start, and the one sensor that explains most beside them, whose coefficients can be
told apart; its error is the larger one of posterior and jackknife over set-ups.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Final, NamedTuple

import numpy as np

from app.arrays import BoolArray, FloatArray
from app.effects.response_columns import LATE, LEVEL, ON, START, STATE, Column
from app.errors import list_names
from app.geometry.components import COMPONENTS
from app.identification.analysis.found_effect import Cause
from app.identification.analysis.response_rows import ResponseRows
from app.search.response import Prior, Response, misfit
from app.search.response_average import Average
from app.units import SECONDS_PER_MIN, unit_of_field

STAND_IN: Final = 6.0
"""A driver is named if without it 2 ln B falls by this: strong evidence (Kass and Raftery, Bayes
factors, Journal of the American Statistical Association 90, 1995)."""

TRIED: Final = 10
"""Steps of learning anew with fewer columns."""

MOST_TIED: Final = 4
MOST_TIES: Final = 2
"""So many drivers of a tie are named, and so many ties."""

AFTER_MIN: Final = {60.0: "within an hour", 300.0: "within five hours"}
WARMER_K: Final = 10.0
UNLIKE: Final = 1.2
"""Two levels of a state are compared if they differ by this factor."""

KINDS: Final = {
    LATE: "the temperatures, present and delayed",
    START: "how far the sensors differed at the start",
    LEVEL: "how warm the machine is as a whole",
}


class _Kind(NamedTuple):
    """A kind of causes: in words, as a plural or not, with the states and columns that it has."""

    words: str
    is_plural: bool
    states: tuple[str, ...]
    columns: list[Column]

    def said(self, loses: float) -> str:
        """Say whether it takes part."""
        takes, is_not = ("take", "are not") if self.is_plural else ("takes", "is not")
        verb = f"{takes} part" if loses >= STAND_IN else f"{is_not} needed"
        return f"{self.words} {verb} (2 ln B {loses:.0f})"


class _Amount(NamedTuple):
    """What is asked of a response: in words, what drives it, after how long [min], by which row."""

    words: str
    name: str
    minutes: float
    row: FloatArray


def causes_of(rows: ResponseRows, average: Average) -> tuple[Cause, ...]:
    """Say what takes part in a response, as far as the set-ups can tell.

    Parameters
    ----------
    rows
        The set-ups.
    average
        What was learnt of all of them.
    """
    return (
        *_kinds(rows, average.priors.constant),
        *_drivers(rows, average.priors.constant),
        *_amounts(rows),
    )


def _kinds(rows: ResponseRows, prior: Prior) -> list[Cause]:
    """Leave each kind of cause out whole, learn anew, and say what that loses."""
    response = rows.response
    whole = response.misfit(prior)
    found = []
    for kind in _kinds_of(rows.columns):
        groups = sorted({rows.groups.index(rows.group_of(column)) for column in kind.columns})
        kept = np.setdiff1d(np.arange(len(rows.groups)), groups)
        if kept.size:
            rest = response.without_groups(groups)
            start = Prior(prior.noise, prior.scales[kept])
            loses = 2.0 * (rest.misfit(rest.learn(start).prior) - whole)
            found.append(Cause("kind", kind.states, kind.said(loses), loses))
    return found


def _kinds_of(columns: Sequence[Column]) -> list[_Kind]:
    """List the kinds of causes that there are."""
    states = dict.fromkeys(c.name for c in columns if c.is_of_state)
    found = [
        _Kind(name, False, (name,), [c for c in columns if c.is_of_state and c.name == name])
        for name in states
    ]
    for form, words in KINDS.items():
        own = [c for c in columns if c.form == form]
        found.append(_Kind(words, form == LATE, (), own))
    return [kind for kind in found if kind.columns]


def _drivers(rows: ResponseRows, prior: Prior) -> list[Cause]:
    """Name the drivers that nothing stands in for, and those that stand in for each other."""
    normal = rows.response.normal(prior.noise)
    scale = prior.scales[rows.response.groups]
    whole = misfit(normal, scale)
    of = np.array([column.name for column in rows.columns])
    names = list(dict.fromkeys(of.tolist()))

    def loses(*without: str) -> float:
        return 2.0 * (misfit(normal, np.where(np.isin(of, without), 0.0, scale)) - whole)

    alone = {name: loses(name) for name in names}
    for name in names:
        if alone[name] >= STAND_IN:  # The others may take over, and their scales grow with it.
            rest = _with_columns(rows.response, of != name)
            alone[name] = 2.0 * (rest.misfit(_go_on(rest, rows, prior, of != name)) - whole)
    needed = sorted((n for n in names if alone[n] >= STAND_IN), key=lambda n: -alone[n])
    found = [
        Cause(
            "driver",
            (name,),
            f"nothing else can stand in for {name} (2 ln B {alone[name]:.0f})",
            alone[name],
        )
        for name in needed
    ]
    ties = _ties([name for name in names if name not in needed], loses)
    found += ties
    if len(needed) < len(names) and not ties:
        of_which = "none of the other drivers" if needed else "no driver"
        found.append(
            Cause("tie", (), f"{of_which} can be named: the rest can stand in for any two of them")
        )
    return found


def _ties(names: list[str], loses: Callable[..., float]) -> list[Cause]:
    """Group drivers that can be missed one at a time and not two at a time."""
    pairs = {frozenset(two): loses(*two) for two in combinations(names, 2)}
    found: list[Cause] = []
    for two, value in sorted(pairs.items(), key=lambda item: -item[1]):
        if value < STAND_IN or len(found) == MOST_TIES:
            break
        a, b = sorted(two, key=names.index)
        if not any(two & set(tie.names) for tie in found):
            with_a = [n for n in names if n not in two and pairs[frozenset((a, n))] >= STAND_IN]
            with_a.sort(key=lambda n: -pairs[frozenset((a, n))])
            group = (a, b, *with_a)
            named = list_names(group, MOST_TIED)
            words = f"{named}: one of these takes part, but they can stand in for one another"
            found.append(Cause("tie", group, words, value))
    return found


def _amounts(rows: ResponseRows) -> list[Cause]:
    """Say by how much a component moves with what a machinist can change."""
    sensors = list(dict.fromkeys(c.name for c in rows.columns if c.form == LATE))
    tried = {}
    for name in sensors:
        few = _few(rows, name)
        tried[name] = few.misfit(few.learn(iterations=TRIED).prior)
    if not tried:
        return []
    sensor = min(tried, key=lambda name: tried[name])
    few = _few(rows, sensor)
    prior = few.learn().prior
    normal = few.normal(prior.noise)
    columns = [c for c in rows.columns if _is_of_few(c, sensor)]
    asked = _asked(rows, columns, sensor)
    whole = few.posterior(prior, normal)
    parts = np.array(
        [few.posterior(prior, normal.without(i)).mean for i in range(len(rows.set_ups))]
    )
    symbol = COMPONENTS[rows.code].unit.symbol
    found: list[Cause] = []
    for words in dict.fromkeys(one.words for one in asked):
        own = [one for one in asked if one.words == words]
        said, sizes = [], []
        for one in own:
            size = float(one.row @ whole.mean)
            error = max(
                float(np.sqrt(one.row @ whole.covariance @ one.row)), _jackknife(parts @ one.row)
            )
            said.append(f"{_with_error(size, error)} {symbol} {AFTER_MIN[one.minutes]}")
            sizes.append((size, error))
        found.append(
            Cause(
                "amount",
                (own[0].name,),
                f"{words} moves {rows.code} by {' and '.join(said)}".replace("-", "−"),
                None,
                *sizes[-1],
            )
        )
    return found


def _is_of_few(column: Column, sensor: str) -> bool:
    is_own = column.form == LATE and column.name == sensor
    return column.is_of_state or column.form == START or is_own


def _few(rows: ResponseRows, sensor: str) -> Response:
    """Keep the states, the start, and one sensor."""
    kept = np.array([_is_of_few(column, sensor) for column in rows.columns])
    return _with_columns(rows.response, kept)


def _with_columns(response: Response, kept: BoolArray) -> Response:
    courses = [replace(one, columns=one.columns[:, kept]) for one in response.courses]
    _, groups = np.unique(response.groups[kept], return_inverse=True)
    return replace(response, courses=courses, groups=groups)


def _go_on(rest: Response, rows: ResponseRows, prior: Prior, kept: BoolArray) -> Prior:
    """Learn anew with some columns, from what was learnt with all."""
    scales = prior.scales[np.unique(rows.response.groups[kept])]
    return rest.learn(Prior(prior.noise, scales), TRIED).prior


def _asked(rows: ResponseRows, columns: Sequence[Column], sensor: str) -> list[_Amount]:
    """List what is asked, as far as something like it was seen."""
    longest_min = max(float(np.ptp(one.times_s)) for one in rows.set_ups) / SECONDS_PER_MIN
    times = [minutes for minutes in AFTER_MIN if minutes <= longest_min]
    found = []
    for name in dict.fromkeys(c.name for c in columns if c.is_of_state):
        low, high = _levels(rows, name)
        unit = unit_of_field(name) or ""
        words = f"{name} of {high:g} instead of {low:g} {unit}".rstrip()
        found += [
            _Amount(words, name, minutes, _of_state(columns, name, minutes, low, high))
            for minutes in times
        ]
    present = rows.columns.index(Column(LATE, sensor, 0.0))
    span_k = float(np.ptp(np.concatenate([one.found.values[:, present] for one in rows.set_ups])))
    warmer_k = min(WARMER_K, float(f"{span_k:.1g}"))
    words = f"{sensor} (the sensor that explains most beside the states) {warmer_k:g} K warmer"
    for minutes in times:
        row = np.array(
            [warmer_k * _risen(c.minutes, minutes) if c.form == LATE else 0.0 for c in columns]
        )
        found.append(_Amount(words, sensor, minutes, row))
    return found


def _levels(rows: ResponseRows, name: str) -> tuple[float, float]:
    """Give the smallest and the largest level at which a state was held; 0 and one of one only."""
    quick = min(
        (i for i, c in enumerate(rows.columns) if c.form == STATE and c.name == name),
        key=lambda i: rows.columns[i].minutes,
    )
    each = [float(np.abs(one.found.values[:, quick]).max()) for one in rows.set_ups]
    low, high = (float(f"{value:.2g}") for value in (min(each), max(each)))
    return (low, high) if low > 0.0 and high > UNLIKE * low else (0.0, high)


def _of_state(
    columns: Sequence[Column], name: str, minutes: float, low: float, high: float
) -> FloatArray:
    """Make the row of a state held at one level instead of another, from the start."""
    steps = {STATE: high - low, ON: float(high != 0.0) - float(low != 0.0)}
    return np.array(
        [
            steps[c.form] * _risen(c.minutes, minutes) if c.is_of_state and c.name == name else 0.0
            for c in columns
        ]
    )


def _risen(tau_min: float, minutes: float) -> float:
    return 1.0 - float(np.exp(-minutes / tau_min)) if tau_min else 1.0


def _with_error(value: float, error: float) -> str:
    """Write a value as far as its error goes: one digit of that, two where it begins with 1 or 2.

    >>> _with_error(-28.41, 7.3), _with_error(11.26, 1.72)
    ('-28 ± 7', '+11.3 ± 1.7')
    """
    first = int(np.floor(np.log10(max(error, 1e-12))))
    decimals = max(0, -first + (error < 3.0 * 10.0**first))
    return f"{value:+.{decimals}f} ± {error:.{decimals}f}"


def _jackknife(values: FloatArray) -> float:
    n = len(values)
    return float(np.sqrt((n - 1) / n * np.sum((values - values.mean()) ** 2)))
