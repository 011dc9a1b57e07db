"""One thing that the model may lack, as terms whose amplitudes are to be estimated."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np

from app.arrays import FloatArray
from app.effects.effect import Effect
from app.effects.projection import Projection
from app.effects.term import Term
from app.search.candidate import Candidate

Amplitudes: TypeAlias = Sequence[Sequence[Term]]
"""For each amplitude the terms that it scales together."""


class Amplitude(NamedTuple):
    """What an amplitude is called in a report, and how much one unit of it is there."""

    name: str
    factor: float = 1.0


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
    log_scale
        Whether it is refined in its logarithm.
    """

    name: str
    per_unit: float
    grid: tuple[float, ...]
    bounds: tuple[float, float] | None = None
    log_scale: bool = True


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


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """One effect before it is fitted.

    Parameters
    ----------
    kind, variant
        Which kind, and which of its forms.
    components, sensors, states
        What it acts on and what drives it.
    unit_terms
        Gives for a value of the nonlinear parameter the amplitudes' terms, with coefficient 1.
    amplitudes
        How the amplitudes are called.
    nonlinear
        The nonlinear parameter, if there is one.
    is_trending
        Whether it must also hold forward in time.
    is_within_visit
        Whether a single visit shows it.
    is_only_once
        Whether one place has it once at most.
    report
        Turns an estimate into parameters where that is not one for each amplitude.
    adopted_terms
        Makes the terms of what was found where `unit_terms` are only its linear part.
    """

    kind: str
    components: tuple[str, ...]
    unit_terms: Callable[[float | None], Amplitudes]
    amplitudes: tuple[Amplitude, ...]
    sensors: tuple[str, ...] = ()
    states: tuple[str, ...] = ()
    variant: str = ""
    nonlinear: Nonlinear | None = None
    is_trending: bool = False
    is_within_visit: bool = False
    is_only_once: bool = False
    report: Callable[[Estimate], Reported] | None = None
    adopted_terms: Callable[[Estimate], Sequence[Term]] | None = None

    @property
    def key(self) -> str:
        """Name it among all hypotheses."""
        parts = (self.variant, *self.components, *self.sensors, *self.states)
        return " ".join([self.kind, *filter(None, parts)])

    def candidate(self, projection: Projection) -> Candidate:
        """Hand it to the search.

        Parameters
        ----------
        projection
            The rows.
        """
        nonlinear = self.nonlinear
        return Candidate(
            key=self.key,
            family=self.kind,
            columns=lambda theta: projection.parts(self.unit_terms(theta)),
            grid=nonlinear.grid if nonlinear else (),
            bounds=nonlinear.bounds if nonlinear else None,
            log_scale=nonlinear.log_scale if nonlinear else True,
            trending=self.is_trending,
            within_visit=self.is_within_visit,
            only_once=self.is_only_once,
        )

    def fitted(self, estimate: Estimate) -> Effect:
        """Make the effect that a search has found.

        Parameters
        ----------
        estimate
            Coefficients in the units of the terms.
        """
        found = self.report(estimate) if self.report else self._reported(estimate)
        return Effect(
            kind=self.kind,
            variant=self.variant,
            components=self.components,
            sensors=self.sensors,
            states=self.states,
            parameters=found.parameters,
            standard_errors=found.standard_errors,
            terms=tuple((self.adopted_terms or self._scaled_terms)(estimate)),
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
        return reported


def reported_theta(nonlinear: Nonlinear | None, estimate: Estimate) -> Reported:
    """Name the nonlinear parameter.

    Parameters
    ----------
    nonlinear
        What it is; None gives an empty report.
    estimate
        What was found.
    """
    reported = Reported({}, {})
    if nonlinear is not None and estimate.theta is not None:
        reported.parameters[nonlinear.name] = estimate.theta / nonlinear.per_unit
        if estimate.theta_error is not None and np.isfinite(estimate.theta_error):
            reported.standard_errors[nonlinear.name] = estimate.theta_error / nonlinear.per_unit
    return reported
