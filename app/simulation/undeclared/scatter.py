"""What measuring adds to the true values: set-up, repeatability, instrument, blunders, zero.

Of one visit all values of one group (a component, or one coordinate of points) share a set-up:
a shift, and a tilt for each axis that the group's positions vary along. A record has one set-up.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from app.simulation.undeclared.base_machine import TRAVELS_MM
from app.simulation.undeclared.components import (
    AXES,
    CODES,
    MM_PER_M,
    BoolArray,
    FloatArray,
    IntArray,
)
from app.simulation.undeclared.conditions import Conditions
from app.simulation.undeclared.history import History
from app.simulation.undeclared.observations import Observations

GROUPS = (*CODES, *AXES)
TAILS = 3
"""Degrees of freedom of heavy-tailed repeatability."""

FREE_CONSTANT_UM = 6.0
"""Standard deviation of the unknown constant of a `free` datum."""


@dataclass(frozen=True)
class Scatter:
    """What measuring added to each of m values.

    Parameters
    ----------
    setup, noise, instrument, blunder, datum : ndarray, shape (m,)
        Set-up shift and tilt; repeatability and lingering scatter; wander, drift and warm-up;
        outliers; the instrument's zero.
    is_blunder : ndarray of bool, shape (m,)
        Which values are outliers.
    """

    setup: FloatArray
    noise: FloatArray
    instrument: FloatArray
    blunder: FloatArray
    datum: FloatArray
    is_blunder: BoolArray

    def total(self) -> FloatArray:
        """Sum of all parts."""
        return self.setup + self.noise + self.instrument + self.blunder + self.datum


def draw_scatter(
    rng: np.random.Generator, observations: Observations, conditions: Conditions
) -> Scatter:
    """Draw everything but the datum, which needs the values.

    Returns
    -------
    Scatter
        Its datum is zero.
    """
    m = observations.of_value.size
    # Children of their own: what is asked of one kind leaves the others as they are.
    of_tails, of_instrument = rng.spawn(2)
    noise = conditions.repeatability_um * rng.standard_normal(m)
    if conditions.heavy_tails:
        # Student's t with ν degrees of freedom has the variance ν/(ν − 2).
        noise = conditions.repeatability_um * of_tails.standard_t(TAILS, m) * np.sqrt(1 - 2 / TAILS)
    setup = _setup(rng, observations, conditions)
    is_blunder = rng.uniform(size=m) < conditions.outliers
    size = 10.0 * conditions.unit_um * rng.uniform(0.6, 1.6, m) * rng.choice([-1.0, 1.0], m)
    if conditions.ar1_um > 0:
        noise += _lingering(rng, block_of_values(observations), conditions)
    instrument = instrument_errors(of_instrument, observations, conditions)
    blunder = np.where(is_blunder, size, 0.0)
    return Scatter(setup, noise, instrument, blunder, np.zeros(m), is_blunder)


def block_of_values(observations: Observations) -> IntArray:
    """Number the blocks of values that share a set-up: one visit, one group; shape (m,)."""
    block: IntArray = observations.value_visit * len(GROUPS) + group_of_values(observations)
    return block


def group_of_values(observations: Observations) -> IntArray:
    """Number each value's component or coordinate in `GROUPS`: shape (m,)."""
    place = {group: i for i, group in enumerate(GROUPS)}
    return np.array([place[group] for group in observations.group])


def instrument_errors(
    rng: np.random.Generator, observations: Observations, conditions: Conditions
) -> FloatArray:
    """Draw what the instrument and its stand add as time goes on.

    Parameters
    ----------
    observations
        What is measured, in order of time.

    Returns
    -------
    ndarray, shape (m,)
        In each component's own unit.
    """
    group = group_of_values(observations)
    value_min = observations.time_min[observations.of_value]
    of_wander, of_drift, of_warm_up = rng.spawn(3)
    errors = np.zeros(group.size)
    if conditions.wander_um or conditions.wander_tilt_um:
        paths = wander_paths(of_wander, observations.time_min, conditions.wander_min)
        here = paths[observations.of_value, group]
        errors += conditions.wander_um * here[:, 0]
        errors += conditions.wander_tilt_um * (here[:, 1:] * setup_shape(observations)).sum(axis=1)
    since_min = value_min - _begun_min(observations, conditions)
    rates = of_drift.standard_normal(len(GROUPS))
    errors += conditions.instrument_drift_um_per_h * rates[group] * since_min / 60.0
    ends = of_warm_up.standard_normal(len(GROUPS))
    errors += conditions.warm_up_um * ends[group] * -np.expm1(-since_min / conditions.warm_up_min)
    return errors


def length_errors(
    observations: Observations, history: History, conditions: Conditions
) -> FloatArray:
    """Say what an instrument adds that does not correct its lengths for a temperature.

    Lengths are positioning errors along their lines, and the coordinates of points, from 0.

    Returns
    -------
    ndarray, shape (m,) [µm]
    """
    errors = np.zeros(observations.of_value.size)
    if not conditions.length_um_per_m_per_k:
        return errors
    warm_c = history.temperature(conditions.length_sensor, observations.time_min)
    above_k = (warm_c - conditions.length_assumed_c)[observations.of_value]
    group = observations.group
    for i, axis in enumerate(AXES):
        along = (group == axis) | (group == f"E{axis}{axis}".upper())
        length_m = observations.point_mm[observations.of_value, i] / MM_PER_M
        errors[along] = (conditions.length_um_per_m_per_k * above_k * length_m)[along]
    return errors


def wander_paths(
    rng: np.random.Generator, time_min: FloatArray, correlation_min: float
) -> FloatArray:
    """Draw paths of an Ornstein-Uhlenbeck process of standard deviation 1, exact at any times.

    Parameters
    ----------
    time_min : ndarray, shape (n,) [min]
        Increasing.
    correlation_min
        Time in which the correlation falls to 1/e [min].

    Returns
    -------
    ndarray, shape (n, groups, 4)
        A shift and three tilts of each group.
    """
    correlations = np.exp(-np.diff(time_min) / correlation_min)
    paths = rng.standard_normal((time_min.size, len(GROUPS), 4))
    for i, rho in enumerate(correlations, start=1):
        paths[i] = rho * paths[i - 1] + np.sqrt(1 - rho**2) * paths[i]
    return paths


def _begun_min(observations: Observations, conditions: Conditions) -> FloatArray:
    """When each value's set-up began: shape (m,) [min]."""
    setup = conditions.setup_of(observations.visit)
    begun = np.full(int(setup.max(initial=0)) + 1, np.inf)
    np.minimum.at(begun, setup, observations.time_min)
    return begun[setup][observations.of_value]


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
    setups = int(conditions.setup_of(observations.visit).max()) + 1
    setup = conditions.setup_of(observations.value_visit)
    block = setup * len(GROUPS) + group_of_values(observations)
    rho = conditions.setup_correlation
    shift = rng.standard_normal(setups * len(GROUPS)).reshape(setups, -1)
    tilt = rng.standard_normal((setups * len(GROUPS), 3)).reshape(setups, -1)
    shift = conditions.setup_shift_um * _following(shift, rho).ravel()
    tilt = conditions.setup_tilt_um * _following(tilt, rho).reshape(-1, 3)
    shifts: FloatArray = shift[block] + (tilt[block] * setup_shape(observations)).sum(axis=1)
    return shifts


def _following(draws: FloatArray, rho: float) -> FloatArray:
    """Let each row follow the one before with a correlation, all of standard deviation 1."""
    steps = draws * np.sqrt(1 - rho**2)
    steps[0] = draws[0]
    followed: FloatArray = lfilter([1.0], [1.0, -rho], steps, axis=0)
    return followed


def _lingering(rng: np.random.Generator, block: IntArray, conditions: Conditions) -> FloatArray:
    """First-order autoregressive scatter within each block of values."""
    rho = conditions.ar1_correlation
    lingering = np.zeros(block.size)
    draws = rng.standard_normal(block.size)
    for number in np.unique(block):
        here = np.flatnonzero(block == number)
        lingering[here] = _following(draws[here], rho)
    return conditions.ar1_um * lingering


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
    visits = int(observations.visit.max(initial=0)) + 1
    constants = FREE_CONSTANT_UM * rng.standard_normal(visits * len(GROUPS))
    if conditions.datum == "free":
        return constants[shared]
    if conditions.datum == "first":
        _, first, number = np.unique(shared, return_index=True, return_inverse=True)
        return -measured[first][number]
    return np.zeros(measured.size)
