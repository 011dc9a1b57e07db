"""What was really so in a campaign, value by value."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from app.simulation.undeclared.components import BoolArray, FloatArray
from app.simulation.undeclared.observations import Observations
from app.simulation.undeclared.scatter import Scatter


@dataclass(frozen=True)
class Truth:
    """The truth behind the measured values.

    Arrays of m values run over the observations of all verifications in their order, one value
    for a component, three for a point: `by_observation` gives them the observations' shape. Every
    value is in its component's unit, at points µm.

    Parameters
    ----------
    effects
        What each is: kind, variant, components, sensors, parameters, amplitude.
    true_um : ndarray, shape (m,)
        The machine's error, free of any measurement.
    model_um : ndarray, shape (m,)
        What maps and readings without any error of their own would say.
    contributions_um : ndarray, shape (effects, m)
        What each effect adds to `true_um` − `model_um`; their sum is that difference.
    measured_um : ndarray, shape (m,)
        What the verifications say.
    predicted_um : ndarray, shape (m,)
        What the maps and readings that are handed out say.
    scatter
        What measuring added, part by part: `measured_um` − `true_um` but for rounding.
    is_frozen : ndarray of bool, shape (m,)
        Values at whose time a sensor of theirs stood still.
    reported
        Where and when, as it was written down.
    """

    seed: int
    names: tuple[str, ...]
    effects: tuple[dict[str, object], ...]
    observations: Observations
    true_um: FloatArray
    model_um: FloatArray
    contributions_um: FloatArray
    measured_um: FloatArray
    predicted_um: FloatArray
    scatter: Scatter
    is_frozen: BoolArray
    reported: Observations

    @property
    def contribution_um(self) -> FloatArray:
        """What all effects add together: shape (m,)."""
        total: FloatArray = self.contributions_um.sum(axis=0)
        return total

    @property
    def residual_um(self) -> FloatArray:
        """Measured minus predicted, as an analysis of the campaign finds it: shape (m,)."""
        return self.measured_um - self.predicted_um

    @property
    def group(self) -> np.ndarray:
        """Component of each value, or x, y, z of points: shape (m,)."""
        return self.observations.group

    @property
    def visit(self) -> np.ndarray:
        """Visit of each value: shape (m,)."""
        return self.observations.value_visit

    @property
    def is_known(self) -> bool:
        """Whether all effects are of families that the service searches."""
        return all(bool(effect["in_library"]) for effect in self.effects)

    def by_observation(self, values: ArrayLike) -> list[float | list[float]]:
        """Give values the observations' shape: a number each, three for a point.

        Parameters
        ----------
        values : array-like, shape (m,)
            One of the arrays.

        Returns
        -------
        list
            Of n numbers or lists of three.
        """
        return self.observations.shaped(values)

    def rms_by_group_um(self) -> dict[str, float]:
        """Root mean square of the residual of each component, and of points' x, y, z."""
        return {
            str(name): float(np.sqrt(np.mean(self.residual_um[self.group == name] ** 2)))
            for name in np.unique(self.group)
        }
