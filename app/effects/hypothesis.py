"""One thing that the model may lack, as terms whose amplitudes are to be estimated."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np

from app.arrays import FloatArray
from app.effects.claim import claim_of
from app.effects.driver import Driver
from app.effects.effect import Effect
from app.effects.flexible import flexible_versions
from app.effects.projection import Projection
from app.effects.shape import Sensitivity
from app.effects.supposition import Supposed
from app.effects.term import Term
from app.search.candidate import Candidate, Expected, Flexible, Form, Layout, Part, Traits
from app.units import SECONDS_PER_MIN

Amplitudes: TypeAlias = Sequence[Sequence[Term]]
"""For each amplitude the terms that it scales together."""


SHORTEST_LAG_S: Final = 60.0
"""What the shortest is refined to. Sensors are read about each minute: what is faster than that is
hardly told from what comes at once, and what is not looked for would be called five minutes late,
with an error that does not reach it."""

IN_SERIES: Final = "as two lags in series"
"""The variant of what comes late through a second body behind the first."""

SECOND_BODY: Final = 0.5
"""The second body's time constant as a share of the first one's: near enough to any other share.

What values tell is the sum of both: with the same sum, shares from 0.2 to 1 differ from it by less
than 0.2 % of their squares where temperatures change every 40 min.
"""


class Amplitude(NamedTuple):
    """What an amplitude is called in a report, and how much one unit of it is there."""

    name: str
    factor: float = 1.0


SHARE: Final = (Amplitude("share"),)
"""The amplitudes of what the maps say, or of what a mistake would cause: 1 is all of it."""

WHOLE: Final = Expected((1.0,), 0.05)
"""A mistake was made or not; 0.05 is what the maps' own slopes may be wrong by."""


@dataclass(frozen=True)
class Nonlinear:
    """The one parameter that is not linear.

    Parameters
    ----------
    name
        What it is called in a report, with its unit.
    per_unit
        How much of the internal unit one unit of the report is: 60 s for a minute.
    grid
        Values to try, increasing, in the internal unit.
    bounds
        Where it may be refined to; None where it stays on the grid.
    """

    name: str
    per_unit: float
    grid: tuple[float, ...]
    bounds: tuple[float, float] | None = None
    log_scale: bool = True

    @classmethod
    def time_constant(cls, grid_s: tuple[float, ...], each: int = 1) -> Nonlinear:
        """How late something is: each so many-th of the time constants that can be tested [s]."""
        ends_s = (SHORTEST_LAG_S, grid_s[-1])
        return cls("time_constant_min", SECONDS_PER_MIN, grid_s[::each], ends_s)

    @property
    def is_time(self) -> bool:
        """Whether it is a time constant."""
        return self.name.startswith("time_constant")


class Estimate(NamedTuple):
    """What a search found for a hypothesis.

    `covariance` is that of the k `coefficients`; `theta_error` is None where theta stayed on
    its grid.
    """

    theta: float | None
    theta_error: float | None
    coefficients: FloatArray
    covariance: FloatArray


class Reported(NamedTuple):
    """Parameters by name with unit, and their standard errors."""

    parameters: dict[str, float]
    standard_errors: dict[str, float]


def _no_terms(theta: float | None) -> Amplitudes:
    """Give nothing: what a mistake in the data adds to the model."""
    return ()


@dataclass(frozen=True, eq=False)
class Hypothesis(Traits):
    """One effect before it is fitted.

    Parameters
    ----------
    unit_terms
        Gives for a value of the nonlinear parameter the amplitudes' terms, with coefficient 1.
    report
        Turns an estimate into parameters where that is not one for each amplitude.
    stated
        Parameters that are not estimated.
    adopted_terms
        Makes the terms of what was found where `unit_terms` are only its linear part.
    supposed
        Of a mistake in the data, instead of `unit_terms`: what it would leave in every row.
    follows
        Which sensors its amplitudes answer, each by itself: to 1, or to −1 where it is subtracted.
    apart
        Of such a mistake, an effect for each place where it is the claim that their sizes are one:
        what each would leave in every row.
    """

    kind: str
    components: tuple[str, ...]
    unit_terms: Callable[[float | None], Amplitudes] = _no_terms
    amplitudes: tuple[Amplitude, ...] = SHARE
    sensors: tuple[str, ...] = ()
    states: tuple[str, ...] = ()
    variant: str = ""
    nonlinear: Nonlinear | None = None
    report: Callable[[Estimate], Reported] | None = None
    stated: Mapping[str, float] = field(default_factory=dict)
    adopted_terms: Callable[[Estimate], Sequence[Term]] | None = None
    supposed: Supposed | None = None
    follows: Mapping[str, int] = field(default_factory=dict)
    apart: Sequence[Supposed] = ()

    @property
    def key(self) -> str:
        """Name it among all hypotheses."""
        return claim_of(self).key

    def columns(self, projection: Projection, theta: float | None) -> FloatArray:
        """Give what each unit of its amplitudes does to n rows, shape (n, k); 0: not known."""
        if self.supposed is None:
            return np.nan_to_num(projection.columns(self.unit_terms(theta)), nan=0.0)
        return np.nan_to_num(self.supposed(projection, theta)[:, None], nan=0.0)

    def parts(self, projection: Projection, theta: float | None) -> list[Part]:
        """Lay out the same by channel, without channels in which nothing shows."""
        if self.supposed is None:
            return projection.parts(self.unit_terms(theta))
        return projection.parts_of(self.columns(projection, theta))

    def theta_of(self, effect: Effect) -> float | None:
        """Give the nonlinear parameter of an effect that was made of it, in the internal unit."""
        if self.nonlinear is None:
            return None
        return effect.parameters[self.nonlinear.name] * self.nonlinear.per_unit

    def candidate(self, projection: Projection) -> Candidate:
        """Hand it to the search."""
        nonlinear = self.nonlinear
        return Candidate(
            key=self.key,
            family=self.kind,
            columns=lambda theta: self.parts(projection, theta),
            grid=nonlinear.grid if nonlinear else (),
            bounds=nonlinear.bounds if nonlinear else None,
            log_scale=nonlinear.log_scale if nonlinear else True,
            layout=None
            if self.supposed
            else Layout(self.components, self.unit_terms, projection.parts),
            about=partial(self._about, projection) if self._is_bent else None,
            flexible=None if self.supposed else partial(self._flexible, projection),
            forms=partial(self._other_forms, projection),
            apart=self._apart(projection) if self.apart else None,
            follows={
                f"{code} {sensor}": sign
                for code in self.components
                for sensor, sign in self.follows.items()
            },
            **self.traits,
        )

    @property
    def _is_bent(self) -> bool:
        """Whether `unit_terms` are only the linear part of what it does, and its size is open."""
        return bool(self.adopted_terms) and self.supposed is None and self.expected is None

    def _about(self, projection: Projection, theta: float | None, amplitude: float) -> list[Part]:
        """Lay out what an amplitude as large as this does, for each unit of it."""
        terms = self.adopted_terms
        estimate = Estimate(theta, None, np.array([amplitude]), np.zeros((1, 1)))
        linear = projection.columns(self.unit_terms(theta))
        whole = projection.columns([terms(estimate)] if terms else []) / amplitude
        # Beyond the maps' temperatures the linear part is what is known.
        return projection.parts_of(np.where(np.isnan(whole), linear, whole))

    def _apart(self, projection: Projection) -> Candidate:
        """Lay out what it does with a size for each place."""

        def columns(theta: float | None) -> list[Part]:
            return projection.parts_of(
                np.column_stack([supposed(projection, theta) for supposed in self.apart])
            )

        return Candidate(f"{self.key} apart", self.kind, columns)

    def _other_forms(self, projection: Projection) -> list[Form]:
        words = f"it responds {IN_SERIES}"
        return [Form(words, form.candidate(projection)) for form in self.forms]

    @property
    def forms(self) -> tuple[Hypothesis, ...]:
        """The same cause with another course: of what is late, late by two lags in series."""
        if self.nonlinear is None or not self.nonlinear.is_time or self.supposed is not None:
            return ()
        if self.variant.endswith(IN_SERIES):  # it is one
            return ()
        variant = f"{self.variant}, {IN_SERIES}".removeprefix(", ")
        return (replace(self, variant=variant, unit_terms=partial(_in_series, self.unit_terms)),)

    def _flexible(self, projection: Projection, theta: float | None) -> list[Flexible]:
        bounds = self.nonlinear.bounds if self.nonlinear and self.nonlinear.is_time else None
        return flexible_versions(projection, self.unit_terms, theta, bounds)

    def fitted(self, estimate: Estimate) -> Effect:
        """Make the effect that a search has found.

        Parameters
        ----------
        estimate
            Coefficients in the units of the terms.
        """
        report = self.report(estimate) if self.report else self._reported(estimate)
        return Effect(
            kind=self.kind,
            variant=self.variant,
            components=self.components,
            sensors=self.sensors,
            states=self.states,
            parameters=report.parameters,
            standard_errors=report.standard_errors,
            # A mistake in the data adds nothing to the model.
            terms=()
            if self.supposed
            else tuple((self.adopted_terms or self._scaled_terms)(estimate)),
        )

    def _scaled_terms(self, estimate: Estimate) -> Sequence[Term]:
        amplitudes = self.unit_terms(estimate.theta)
        return [
            term.times(float(c))
            for c, terms in zip(estimate.coefficients, amplitudes, strict=True)
            for term in terms
        ]

    def _reported(self, estimate: Estimate) -> Reported:
        reported = reported_theta(self.nonlinear, estimate)
        errors = np.sqrt(np.diag(estimate.covariance))
        for amplitude, c, error in zip(self.amplitudes, estimate.coefficients, errors, strict=True):
            reported.parameters[amplitude.name] = float(c) * amplitude.factor
            reported.standard_errors[amplitude.name] = float(error) * abs(amplitude.factor)
        reported.parameters.update(self.stated)
        return reported


def series_text(nonlinear: Nonlinear, theta: float) -> str:
    """Tell of two lags in series how late each is.

    >>> series_text(Nonlinear("time_constant_min", 60.0, (600.0, 3600.0)), 3400.0)
    'two lags in series (57 and 28 min: heat that passes two bodies)'
    """
    first, second = (share * theta / nonlinear.per_unit for share in (1.0, SECOND_BODY))
    return f"two lags in series ({first:.0f} and {second:.0f} min: heat that passes two bodies)"


def _in_series(unit_terms: Callable[[float | None], Amplitudes], theta: float | None) -> Amplitudes:
    """Make what is late by θ late through a second body too.

    Two low-passes in series are a difference of the two, exactly, by partial fractions:
    1/((1 + sθ)(1 + srθ)) = (1/(1 + sθ) − r/(1 + srθ)) / (1 − r).
    """
    first, second = (unit_terms(share * float(theta or 0.0)) for share in (1.0, SECOND_BODY))
    return [
        [
            *(term.times(1.0 / (1.0 - SECOND_BODY)) for term in terms),
            *(term.times(-SECOND_BODY / (1.0 - SECOND_BODY)) for term in other),
        ]
        for terms, other in zip(first, second, strict=True)
    ]


def moved_temperature(
    codes: Sequence[str], driver: Callable[[float | None, float], Driver]
) -> dict[str, Any]:
    """Read components' maps at a temperature that is moved: `unit_terms` and `adopted_terms`.

    The search takes the linear part, the maps' slopes; what is found and adopted moves the
    temperature itself.

    Parameters
    ----------
    driver
        Gives by how much [K], for a value of the nonlinear parameter and an amplitude.
    """

    def linear(theta: float | None) -> Amplitudes:
        by_k = driver(theta, 1.0)
        return [[Term(code, by_k, Sensitivity(is_local=True)) for code in codes]]

    def whole(estimate: Estimate) -> Sequence[Term]:
        by_k = driver(estimate.theta, float(estimate.coefficients[0]))
        return [Term(code, by_k, Sensitivity(is_local=False)) for code in codes]

    return {"unit_terms": linear, "adopted_terms": whole}


def reported_theta(nonlinear: Nonlinear | None, estimate: Estimate) -> Reported:
    """Name the nonlinear parameter.

    Parameters
    ----------
    nonlinear
        What it is; None gives an empty report.
    """
    reported = Reported({}, {})
    if nonlinear is not None and estimate.theta is not None:
        reported.parameters[nonlinear.name] = estimate.theta / nonlinear.per_unit
        if estimate.theta_error is not None and np.isfinite(estimate.theta_error):
            reported.standard_errors[nonlinear.name] = estimate.theta_error / nonlinear.per_unit
    return reported
