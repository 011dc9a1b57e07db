"""Tables have the wrong sign, or are too large by a factor: a mistake in units or signs."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Final

import numpy as np

from app.arrays import FloatArray
from app.effects.campaign_view import CampaignView
from app.effects.effect import Effect
from app.effects.hypothesis import Amplitude, Estimate, Hypothesis, Reported
from app.effects.kind import EffectKind, Proposed, Shakes
from app.effects.map_tables import maps_of_label
from app.effects.projection import Projection
from app.effects.words import SURELY, TWO_ERRORS, components, parameter, verb
from app.geometry.components import COMPONENTS
from app.search.candidate import Expected
from app.search.priors import UNSTATED_MAP_ERROR
from app.thermal.error_map import ComponentTable, ErrorMap

WRONG_SIGN: Final = -1.0
TIMES: Final = (2.0, 10.0, 25.4, 1000.0)
"""A laser's optics that count twice; a decimal; inches for millimetres; mm for µm."""

TO_MULTIPLY_BY: Final = (WRONG_SIGN, *(1.0 / t for t in TIMES), *TIMES)
"""What puts such a table right."""

MISTAKES: Final = Expected(tuple(factor - 1.0 for factor in TO_MULTIPLY_BY), 0.03)
"""Amplitudes; 0.03 is what the table's own errors may do."""

ABOVE_ITS_ERRORS: Final = 4.0
"""A table is not looked for as too large if its values are not so many standard errors."""

NOT_TOO_LARGE: Final = Expected(tuple(v for v in MISTAKES.values if abs(v) > 1.0), MISTAKES.spread)
"""Amplitudes of the other tables. Their own errors are in the residuals too: minus a share of what
they say is there, as if they were too large by a factor."""

OF_ITS_FACTOR: Final = 0.5
"""A table of one map that is so many times too large is at least half as many times as large as in
the other maps. Else whatever was wrong only while it was measured is as likely: another kind."""

MULTIPLY: Final = "to_multiply_by"


class MapFactor(EffectKind):
    """Measured minus predicted is (c − 1) times what the tables say, which should be c times it.

    One component in all maps or in one, all of one map, or everything. Only the sign and the
    factors that people make are looked for: a table that is off by some per cent is an
    outdated one.
    """

    kind = "map-factor"
    text = "tables have the wrong sign or the wrong unit"
    drawn_over = "position"
    only_once = True
    shown_by = "compare the stored tables of {component} with the instrument's own report"
    not_adopted = (
        "the stored maps are wrong: store them right, for a correction beside them would then be "
        "wrong"
    )
    shakes = Shakes.VALUES

    def propose(self, view: CampaignView) -> Proposed:
        """Every component in all maps and in each; all of each map; everything."""
        for codes, label in _tables(view):
            yield Hypothesis(
                kind=self.kind,
                variant=label,
                components=codes,
                amplitudes=(Amplitude(MULTIPLY),),
                supposed=partial(_supposed, codes, label),
                expected=_expected(view, codes, label),
                report=_reported,
                within_visit=any(COMPONENTS[code].is_table for code in codes),
            )

    def explain(self, effect: Effect) -> str:
        """Say which tables are wrong, and how."""
        what = f"the {verb(effect.components, 'table', 'tables')} of {components(effect)}"
        where = f" in map {effect.variant!r}" if effect.variant else " in all maps"
        have = verb(effect.components, "has", "have")
        are = verb(effect.components, "is", "are")
        possible = _possible(effect)
        errors = [_how_wrong(factor) for factor in possible if factor != WRONG_SIGN]
        if _is_nothing_left(effect):
            it = verb(effect.components, "it", "they")
            return (
                f"the measured values show nothing of {what}{where}: {it} {are} wrong as a "
                f"whole, or {' or '.join(errors)}"
            )
        if WRONG_SIGN in possible:
            return f"{what}{where} {have} the wrong sign"
        return f"{what}{where} {are} {' or '.join(errors)}"

    def which_map(self, variant: str) -> str:
        """Give the map's label: the variant."""
        return variant

    def what_to_do(self, effect: Effect) -> str:
        """Say what to multiply by."""
        factors = " or ".join(_number(factor) for factor in _possible(effect))
        where = f"map {effect.variant!r}" if effect.variant else "all maps"
        how = f"again multiplied by {factors}"
        if _is_nothing_left(effect):
            how = "as it says, or measure them again"
        return (
            f"Look up {components(effect)} of {where} in the instrument's report; store them "
            f"{how}, then analyse again."
        )

    def doubt(self, effect: Effect) -> str:
        """A unit or a sign is one of few factors, and what a table says by it must be seen.

        Values whose sum with the table is nothing say that it is wrong. By 1000 or by anything
        else that is far too much: which, only what is left of the table by that factor can tell.
        """
        if MULTIPLY not in effect.parameters:
            return ""
        factor, error = effect.parameters[MULTIPLY], effect.standard_errors.get(MULTIPLY, 0.0)
        nearest = _possible(effect)[0]
        if _is_nothing_left(effect):
            return (
                "nothing of the stored values is seen, by which a factor could be told: whatever "
                "was wrong only while the map was measured would look the same"
            )
        if _away(factor, error, nearest) > SURELY:
            return (
                f"they would have to be multiplied by {parameter(effect, MULTIPLY)}, which is no "
                "factor of a unit or a sign"
            )
        return ""


def _tables(view: CampaignView) -> Iterator[tuple[tuple[str, ...], str]]:
    """List which tables may be wrong together: components, and a map's label or nothing."""
    labels: dict[str, list[str]] = {}
    for code in view.components:
        located = view.model.find(code)
        map_labels = located[0].labels if located else ()
        yield (code,), ""
        for label in map_labels:
            yield (code,), label
            labels.setdefault(label, []).append(code)
    together = [*labels.items(), *([("", list(view.components))] if labels else [])]
    for label, codes in together:
        if len(codes) > 1:
            yield tuple(codes), label


def _is_above_errors(view: CampaignView, codes: tuple[str, ...], label: str) -> bool:
    """Whether tables say clearly more than what they may be wrong by."""
    squares: list[float] = []
    for code in codes:
        located = view.model.find(code)
        for map_label in located[0].labels if located else ():
            if label in ("", map_label):
                having = (m for m in maps_of_label(view.maps, map_label) if code in m.tables)
                squares += [_square_over_error(m, m.tables[code]) for m in having]
    return bool(squares) and bool(np.mean(squares) > ABOVE_ITS_ERRORS**2)


def _expected(view: CampaignView, codes: tuple[str, ...], label: str) -> Expected:
    """Say by which factors tables may be wrong, by what they say."""
    if not _is_above_errors(view, codes, label):
        return NOT_TOO_LARGE
    largest = _times_others(view, codes, label) / OF_ITS_FACTOR
    possible = (v for v in MISTAKES.values if not -1.0 < v < 0.0 or 1.0 / (1.0 + v) <= largest)
    return Expected(tuple(possible), MISTAKES.spread)


def _times_others(view: CampaignView, codes: tuple[str, ...], label: str) -> float:
    """Say how many times as large a map's tables are as those of the same components elsewhere."""
    if not label:
        return np.inf
    of_label = {id(error_map) for error_map in maps_of_label(view.maps, label)}
    squares: dict[bool, list[float]] = {True: [], False: []}
    for error_map in view.maps:
        tables = (error_map.tables[code] for code in codes if code in error_map.tables)
        squares[id(error_map) in of_label] += [float(np.mean(table.errors**2)) for table in tables]
    size, others = (float(np.mean(squares[which] or [0.0])) for which in (True, False))
    return float(np.sqrt(size / others)) if others > 0.0 else np.inf


def _square_over_error(error_map: ErrorMap, table: ComponentTable) -> float:
    unstated = max(error_map.repeatability_um or 0.0, UNSTATED_MAP_ERROR)
    error = unstated if table.standard_errors is None else table.standard_errors
    return float(np.mean((table.errors / np.maximum(error, np.finfo(float).tiny)) ** 2))


def _supposed(
    codes: tuple[str, ...], label: str, projection: Projection, theta: float | None
) -> FloatArray:
    # Counted once more: what is left is c − 1 of what the maps say.
    return projection.predicted_by(codes, label or None)


def _reported(estimate: Estimate) -> Reported:
    """Give c of c − 1."""
    (less_one,), error = estimate.coefficients, float(np.sqrt(estimate.covariance[0, 0]))
    return Reported({MULTIPLY: 1.0 + float(less_one)}, {MULTIPLY: error})


def _possible(effect: Effect) -> list[float]:
    """List the factors that the estimate allows, the nearest first."""
    fitted = effect.parameters[MULTIPLY]
    error = effect.standard_errors.get(MULTIPLY, 0.0)
    near = sorted(TO_MULTIPLY_BY, key=lambda factor: _away(fitted, error, factor))
    others = (factor for factor in near[1:] if _away(fitted, error, factor) < TWO_ERRORS)
    return [near[0], *others]


def _away(fitted: float, error: float, factor: float) -> float:
    """Say how many standard errors an estimate is from a factor, the tables' own included."""
    spread = MISTAKES.spread * (factor - 1.0)
    return float(abs(fitted - factor) / np.hypot(error, spread))


def _is_nothing_left(effect: Effect) -> bool:
    """Whether a table that is said to be too large cannot be told from one without any truth.

    A table of µm that is read as mm leaves a thousandth of itself, which is the machine's error
    and as large as of any other table: values that tell that the rest is wrong, see it too.
    """
    error = effect.standard_errors.get(MULTIPLY, 0.0)
    nearest = _possible(effect)[0]
    return 0.0 < nearest < 1.0 and nearest < SURELY * error


def _how_wrong(factor: float) -> str:
    return (
        f"{_number(1.0 / factor)} times too large"
        if factor < 1.0
        else f"{_number(factor)} times too small"
    )


def _number(factor: float) -> str:
    """Write a factor; a small one as a fraction.

    >>> _number(1 / 25.4), _number(-1.0), _number(10.0)
    ('1/25.4', '-1', '10')
    """
    return f"1/{1.0 / factor:g}" if 0.0 < factor < 1.0 else f"{factor:g}"
