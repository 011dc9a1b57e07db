"""What measuring adds to the true values: set-up, repeatability, lingering scatter, blunders, zero.

Of one visit all values of one group (a component, or one coordinate of points) share a set-up:
a shift, and a tilt for each axis that the group's positions vary along.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from benchmarks.undeclared.base_machine import TRAVELS_MM
from benchmarks.undeclared.components import AXES, CODES, BoolArray, FloatArray, IntArray
from benchmarks.undeclared.conditions import Conditions
from benchmarks.undeclared.observations import Observations

GROUPS = (*CODES, *AXES)
FREE_CONSTANT_UM = 6.0
"""Standard deviation of the unknown constant of a `free` datum."""


@dataclass(frozen=True)
class Scatter:
    """What measuring added to each of m values.

    Parameters
    ----------
    setup, noise, blunder, datum : ndarray, shape (m,)
        Set-up shift and tilt; repeatability and lingering scatter; outliers; the instrument's zero.
    is_blunder : ndarray of bool, shape (m,)
        Which values are outliers.
    """

    setup: FloatArray
    noise: FloatArray
    blunder: FloatArray
    datum: FloatArray
    is_blunder: BoolArray

    def total(self) -> FloatArray:
        """Sum of all parts."""
        return self.setup + self.noise + self.blunder + self.datum


def draw_scatter(
    rng: np.random.Generator, observations: Observations, conditions: Conditions
) -> Scatter:
    """Draw everything but the datum, which needs the values.

    Parameters
    ----------
    rng
        Source of chance.
    observations
        What is measured.
    conditions
        Standard deviations.

    Returns
    -------
    Scatter
        Its datum is zero.
    """
    m = observations.of_value.size
    noise = conditions.repeatability_um * rng.standard_normal(m)
    setup = _setup(rng, observations, conditions)
    is_blunder = rng.uniform(size=m) < conditions.outliers
    size = 10.0 * conditions.unit_um * rng.uniform(0.6, 1.6, m) * rng.choice([-1.0, 1.0], m)
    if conditions.ar1_um > 0:
        noise += _lingering(rng, block_of_values(observations), conditions)
    return Scatter(setup, noise, np.where(is_blunder, size, 0.0), np.zeros(m), is_blunder)


def block_of_values(observations: Observations) -> IntArray:
    """Number the blocks of values that share a set-up: one visit, one group; shape (m,)."""
    place = {group: i for i, group in enumerate(GROUPS)}
    groups = np.array([place[group] for group in observations.group])
    block: IntArray = observations.value_visit * len(GROUPS) + groups
    return block


def setup_shape(observations: Observations) -> FloatArray:
    """Where each value lies along its tilts, from −1 to 1 over each travel: shape (m, 3).

    A component's value has its own axis only, a squareness none.
    """
    along = 2.0 * observations.point_mm / np.array(TRAVELS_MM) - 1.0
    # A line's direction is 0 on the axes that do not move.
    moved = (observations.direction != 0) | observations.is_point[:, None]
    return np.where(moved, along, 0.0)[observations.of_value]


def _setup(
    rng: np.random.Generator, observations: Observations, conditions: Conditions
) -> FloatArray:
    blocks = (int(observations.visit.max()) + 1) * len(GROUPS)
    block = block_of_values(observations)
    shift = conditions.setup_shift_um * rng.standard_normal(blocks)
    tilt = conditions.setup_tilt_um * rng.standard_normal((blocks, 3))
    found: FloatArray = shift[block] + (tilt[block] * setup_shape(observations)).sum(axis=1)
    return found


def _lingering(rng: np.random.Generator, block: IntArray, conditions: Conditions) -> FloatArray:
    """First-order autoregressive scatter within each block of values."""
    rho = conditions.ar1_correlation
    found = np.zeros(block.size)
    draws = rng.standard_normal(block.size)
    for number in np.unique(block):
        here = np.flatnonzero(block == number)
        steps = draws[here] * np.sqrt(1 - rho**2)
        steps[0] = draws[here[0]]
        found[here] = lfilter([1.0], [1.0, -rho], steps)
    return conditions.ar1_um * found


def datum_groups(observations: Observations, conditions: Conditions) -> IntArray:
    """Number what shares a zero of the instrument: one verification, one group; shape (m,)."""
    block = block_of_values(observations)
    return block % len(GROUPS) if conditions.one_verification else block


def datum_of(
    rng: np.random.Generator,
    measured: FloatArray,
    observations: Observations,
    conditions: Conditions,
) -> FloatArray:
    """Work out what the instrument's zero adds.

    Parameters
    ----------
    rng
        Source of chance.
    measured : ndarray, shape (m,)
        Values with all other scatter.
    observations, conditions
        Which values share a zero, and which kind it is.

    Returns
    -------
    ndarray, shape (m,)
        Zero for `absolute`; minus the first value of each for `first`; any constant for `free`.
    """
    shared = datum_groups(observations, conditions)
    visits = int(observations.visit.max()) + 1
    constants = FREE_CONSTANT_UM * rng.standard_normal(visits * len(GROUPS))
    if conditions.datum == "free":
        return constants[shared]
    if conditions.datum == "first":
        _, first, number = np.unique(shared, return_index=True, return_inverse=True)
        return -measured[first][number]
    return np.zeros(measured.size)
