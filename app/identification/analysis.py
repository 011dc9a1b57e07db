"""The answer of an analysis: what a campaign says of the model, in plain numbers and sentences."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any, Final

import numpy as np

from app.errors import list_names
from app.identification.effects.effect import Effect
from app.identification.effects.kind import NotTested
from app.identification.residuals import LeftOut

MOST_SUBJECTS: Final = 12
"""So many subjects are named behind one reason."""


@dataclass(frozen=True, slots=True)
class Figures:
    """Size of residuals over all lengths [µm], or over all values where none is a length.

    Parameters
    ----------
    rms_um, p95_um
        Root mean square, and 95th percentile of the size, of all visits together.
    holdout_rms_um, holdout_rms_ci95_um
        The same on visits that took no part in what predicts them, with its 95 % interval over
        visits; None where nothing could be held out.
    """

    rms_um: float
    p95_um: float
    holdout_rms_um: float | None
    holdout_rms_ci95_um: tuple[float, float] | None


@dataclass(frozen=True, slots=True)
class ComponentFigures:
    """One component (or one direction at points) before and after, in its own unit.

    Parameters
    ----------
    component, unit
        Which, and the symbol of its unit.
    count
        How many values took part.
    before_rms, after_rms, before_p95, after_p95
        Of all visits together.
    holdout_before_rms, holdout_after_rms
        On held-out visits; None where nothing could be held out.
    noise, noise_origin
        Standard deviation of one observation, and whether it was `declared`, or came from
        `replicates` or from the `residuals`.
    floor
        What repeatability and set-up scatter alone would leave (RMS).
    """

    component: str
    unit: str
    count: int
    before_rms: float
    after_rms: float
    before_p95: float
    after_p95: float
    holdout_before_rms: float | None
    holdout_after_rms: float | None
    noise: float
    noise_origin: str
    floor: float | None


@dataclass(frozen=True, slots=True)
class Evidence:
    """How sure an effect is.

    Parameters
    ----------
    likelihood_ratio, degrees_of_freedom
        Twice the rise of the log likelihood, and how many numbers were fitted for it.
    two_ln_bayes_factor
        Against its absence, the prior spread evenly inside its family; above 10: very strong.
    p_global
        Probability that noise surprises as much anywhere in the library.
    calibration_slope, calibration_slope_error
        Measured against predicted contribution on held-out visits: 1 is right, 0 is nothing.
    forward_slope
        The same on the last visits, for trends.
    found_again_share
        Share of the folds that find it, or what it is tied with, again.
    seen_in_readings
        How a faulty sensor's own record shows it; all else is None then.
    """

    likelihood_ratio: float | None = None
    degrees_of_freedom: int | None = None
    two_ln_bayes_factor: float | None = None
    p_global: float | None = None
    calibration_slope: float | None = None
    calibration_slope_error: float | None = None
    forward_slope: float | None = None
    found_again_share: float | None = None
    seen_in_readings: str | None = None


@dataclass(frozen=True, slots=True)
class Alternative:
    """Another explanation; `evidence` is its 2 ln B against no effect, `behind` the difference.

    `tied` says that these observations cannot tell the two apart; then `separating_measurement`
    names what would.
    """

    kind: str
    variant: str
    components: tuple[str, ...]
    sensors: tuple[str, ...]
    states: tuple[str, ...]
    evidence: float
    behind: float
    alias_share: float
    tied: bool
    separating_measurement: str | None = None


@dataclass(frozen=True, slots=True)
class StrongVisit:
    """A visit that carries much of the evidence: what was measured, and when it began (UTC)."""

    label: str
    time: str


@dataclass(frozen=True, eq=False)
class FoundEffect:
    """One effect that the model lacks.

    Parameters
    ----------
    effect
        What adoption stores: kind, components, sensors, states, parameters, standard errors.
    before_rms_um, after_rms_um
        Of the components that it acts on, on held-out visits where there are any.
    unit
        Their unit's symbol: lengths where any is one.
    status
        `confirmed`, `suspected` or `not-confirmable`: what held-out visits say.
    is_proxy
        Whether structure remains beside it that no effect explains.
    evidence, alternatives
        How sure, and what else it could be: ties first.
    explanation
        One plain sentence.
    strongest_visits, leverage
        The two visits that carry most of the evidence, and their share of it.
    leverage_warning
        Said where most of the evidence stands on two visits.
    measure_again
        Of an effect that grows with time: until when it may be used, and what to measure then.
    """

    effect: Effect
    before_rms_um: float
    after_rms_um: float
    unit: str
    status: str
    is_proxy: bool
    evidence: Evidence
    alternatives: tuple[Alternative, ...]
    explanation: str
    strongest_visits: tuple[StrongVisit, ...]
    leverage: float
    leverage_warning: str | None
    measure_again: str | None

    @property
    def ties(self) -> tuple[Alternative, ...]:
        """The alternatives that these observations cannot tell from it."""
        return tuple(a for a in self.alternatives if a.tied)

    def to_json(self) -> dict[str, Any]:
        """Write it down, with the stored effect beside its parts."""
        own = self.effect.to_json()
        parts = {name: value for name, value in own.items() if name != "terms"}
        parts["valid"] = self.effect.learnt_in
        rest = {f.name: plain(getattr(self, f.name)) for f in fields(self) if f.name != "effect"}
        return {**plain(parts), **rest, "effect": own}


@dataclass(frozen=True, slots=True)
class UnexplainedPart:
    """Structure that no effect of the library explains: where, how large, what it moves with."""

    component: str
    rms_um: float
    noise_um: float
    unit: str
    leads: tuple[str, ...]
    tests: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class SmallestSeen:
    """The smallest effect of one kind on one component that would have been seen.

    `smallest_rms` is over the rows that it acts on, in the component's unit.
    """

    kind: str
    component: str
    unit: str
    smallest_rms: float


@dataclass(frozen=True, eq=False)
class Analysis:
    """The whole answer.

    Parameters
    ----------
    verdict
        `effects-found`, `nothing-found` or `unexplained`.
    summary
        Two plain sentences.
    kinds
        The kinds of effects that were looked for; None: all.
    unit
        Of the figures over all values: µm, or that of the angles where no length was measured.
    noise_um, floor_um
        Repeatability, and what repeatability and set-up scatter alone would leave.
    before, after
        Residuals without and with the effects as they would be adopted.
    after_with_maps_refitted
        The same where the maps are also corrected within their own uncertainty.
    p_global
        Probability that noise alone surprises as much as the strongest candidate did.
    visits, values
        How many took part.
    components, effects, unexplained, excluded, not_testable, detectable
        Each in its order of importance.
    what_next
        Sentences: what to measure or to do.
    plots
        Arrays for a page, at most some hundred points each.
    """

    verdict: str
    summary: str
    kinds: tuple[str, ...] | None
    unit: str
    noise_um: float | None
    floor_um: float | None
    before: Figures
    after: Figures
    after_with_maps_refitted: Figures | None
    p_global: float
    visits: int
    values: int
    components: tuple[ComponentFigures, ...]
    effects: tuple[FoundEffect, ...]
    unexplained: tuple[UnexplainedPart, ...]
    excluded: tuple[LeftOut, ...]
    not_testable: tuple[NotTested, ...]
    detectable: tuple[SmallestSeen, ...]
    what_next: tuple[str, ...]
    plots: Mapping[str, Any] = field(default_factory=dict)

    def to_json(self) -> dict[str, Any]:
        """Write it down: JSON's own types, every number finite."""
        found: dict[str, Any] = plain(self)
        return found


def by_reason(not_tested: Iterable[NotTested]) -> tuple[NotTested, ...]:
    """Name what one kind cannot show for the same reason together.

    Parameters
    ----------
    not_tested
        One by one, repeated or not.

    Examples
    --------
    >>> by_reason([NotTested("drift", "EXX", "few"), NotTested("drift", "EXY", "few")])
    (NotTested(kind='drift', on='EXX, EXY', reason='few'),)
    """
    together: dict[tuple[str, str], dict[str, None]] = defaultdict(dict)
    for one in not_tested:
        together[one.kind, one.reason] |= {one.on: None} if one.on else {}
    return tuple(
        NotTested(kind, list_names(names, MOST_SUBJECTS) if names else "", reason)
        for (kind, reason), names in together.items()
    )


def plain(value: Any) -> Any:
    """Turn an answer into what JSON can hold; numbers that are not finite become None.

    Parameters
    ----------
    value
        Dataclasses, mappings, sequences, arrays, numbers, strings.

    Returns
    -------
    dict, list, str, int, float, bool or None

    Examples
    --------
    >>> plain({"rms": np.float64(0.5), "low": float("inf"), "of": (1, "x")})
    {'rms': 0.5, 'low': None, 'of': [1, 'x']}
    """
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, FoundEffect):
        return value.to_json()
    if is_dataclass(value) and not isinstance(value, type):
        return {f.name: plain(getattr(value, f.name)) for f in fields(value)}
    if isinstance(value, Mapping):
        return {str(key): plain(each) for key, each in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [plain(each) for each in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value
