"""An effect that the model lacks: what it does to which components, and with what strength."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeAlias

import numpy as np

from app.simulation.undeclared.components import BoolArray, FloatArray
from app.simulation.undeclared.history import History
from app.simulation.undeclared.maps import MeasuredMaps
from app.simulation.undeclared.observations import ErrorFunction, Observations, evaluate

Parameter: TypeAlias = float | str | list[float]


@dataclass(frozen=True)
class Effect:
    """One undeclared effect.

    Parameters
    ----------
    kind
        Family, as the service calls it, or a name of what is in no family.
    errors : mapping of component to function
        What it adds to what the maps say, at a strength of 1. For a sensor's fault and for
        people's mistakes: to the residual, because the machine's error stays what it is.
    parameters
        What characterises it whatever its strength; units in the names.
    strengths
        What grows with its strength, at a strength of 1.
    strength
        Factor on `errors` and `strengths`.
    sensitive
        Components whose thermal sensitivity grows with the strength, because the effect is
        what a temperature does in full and has no strength of its own.
    unmeasured
        Components that the maps leave out.
    shown_c : mapping of sensor to ndarray, shape (n,) [°C]
        What faulty sensors show in all minutes of the history.
    maps
        Of a mistake in the stored maps: makes them of the measured ones.
    reported
        Of a mistake in what is written beside the values: makes it of what was so. What the model
        makes of that instead is left; `errors` are then those of the machine.
    about_zero
        Whether its amplitude is a root mean square, not a standard deviation: for what is the
        same in all values.
    in_library
        Whether it is of one of the families that the service searches.
    """

    kind: str
    variant: str
    components: tuple[str, ...]
    errors: Mapping[str, ErrorFunction]
    sensors: tuple[str, ...] = ()
    parameters: Mapping[str, Parameter] = field(default_factory=dict)
    strengths: Mapping[str, float | list[float]] = field(default_factory=dict)
    strength: float = 1.0
    sensitive: tuple[str, ...] = ()
    unmeasured: tuple[str, ...] = ()
    shown_c: Mapping[str, FloatArray] = field(default_factory=dict)
    maps: Callable[[MeasuredMaps], MeasuredMaps] | None = None
    reported: Callable[[Observations], Observations] | None = None
    about_zero: bool = False
    in_library: bool = True

    def contribution(self, observations: Observations, history: History) -> FloatArray:
        """What it adds to the observed values, or a mistake to residuals: shape (m,)."""
        contribution = evaluate(self.errors, observations, history)
        if self.reported is not None:
            contribution = contribution - evaluate(
                self.errors, self.reported(observations), history
            )
        return self.strength * contribution

    @property
    def is_of_machine(self) -> bool:
        """Whether the machine's error is another; else what is known of it is wrong."""
        return not self.shown_c and self.maps is None and self.reported is None

    def with_strength(self, factor: float) -> Effect:
        """Make it stronger or weaker by a factor."""
        return replace(self, strength=self.strength * factor)

    def described(self) -> dict[str, object]:
        """Say what it is: kind, components, sensors, parameters with units in their names."""
        grown = {name: _times(value, self.strength) for name, value in self.strengths.items()}
        if self.sensitive:
            grown["sensitivity_factor"] = self.strength
        return {
            "kind": self.kind,
            "variant": self.variant,
            "components": list(self.components),
            "sensors": list(self.sensors),
            "parameters": {**self.parameters, **grown},
            "in_library": self.in_library,
        }


def rows_of(contribution: FloatArray, observations: Observations) -> BoolArray:
    """Find the values that an effect can reach: all of each group in which it is not always zero.

    Parameters
    ----------
    contribution : ndarray, shape (m,)
        What the effect adds.
    observations
        Their values' groups are components, and the coordinates of points.

    Returns
    -------
    ndarray of bool, shape (m,)
    """
    group = observations.group
    reached = np.unique(group[np.abs(contribution) > 1e-12])
    return np.isin(group, reached)


def amplitude_of(contribution: FloatArray, observations: Observations, about_zero: bool) -> float:
    """Standard deviation of an effect over the values that it can reach (or their RMS).

    Returns
    -------
    float
        Zero where it reaches none.
    """
    here = contribution[rows_of(contribution, observations)]
    if not here.size:
        return 0.0
    return float(np.sqrt(np.mean(here**2))) if about_zero else float(np.std(here))


def _times(value: float | list[float], factor: float) -> float | list[float]:
    if isinstance(value, list):
        return [v * factor for v in value]
    return value * factor


def told_by(effects: Sequence[Effect], observations: Observations) -> Observations:
    """Write observations down as people did whose mistakes are among some effects."""
    for effect in effects:
        observations = effect.reported(observations) if effect.reported else observations
    return observations
