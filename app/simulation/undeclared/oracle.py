"""What a search could reach at best: it knows the effects and fits their amplitudes alone.

Family, component, sensor and nonlinear parameters are given; least squares finds how much of
each effect there is in the training visits, and the held-out visits judge it. It also re-fits
the maps within their uncertainty and counts on the set-up scatter of each visit, as any fair
rival may; without that (`refit_maps=False`) it is plain least squares on the residuals.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import cho_factor, cho_solve

from app.simulation.undeclared.components import BoolArray, FloatArray
from app.simulation.undeclared.conditions import Conditions
from app.simulation.undeclared.mapped_model import entry_weights
from app.simulation.undeclared.maps import MeasuredMaps
from app.simulation.undeclared.observations import Observations
from app.simulation.undeclared.scatter import (
    GROUPS,
    datum_groups,
    group_of_values,
    setup_shape,
)
from app.simulation.undeclared.sensors import SensorRecord
from app.simulation.undeclared.truth import Truth

UNKNOWN_ZERO_UM = 300.0
"""Standard deviation of a shift that nobody knows."""


@dataclass(frozen=True)
class OracleFit:
    """What the oracle finds.

    Parameters
    ----------
    amplitudes, standard_errors : ndarray, shape (effects,)
        Share of each effect that was found: 1 is all of it.
    train_rms_um, holdout_rms_um
        Residual with the fitted effects.
    holdout_rms_without_um
        Held-out residual with re-fitted maps but without effects.
    floor_um
        Root mean square of the held-out scatter itself: nobody can get below it for long.
    """

    amplitudes: FloatArray
    standard_errors: FloatArray
    train_rms_um: float
    holdout_rms_um: float
    holdout_rms_without_um: float
    floor_um: float


def fit_oracle(
    truth: Truth,
    maps: MeasuredMaps,
    record: SensorRecord,
    conditions: Conditions,
    held_out_visits: ArrayLike,
    *,
    refit_maps: bool = True,
) -> OracleFit:
    """Fit the true effects' amplitudes to the training visits.

    Parameters
    ----------
    held_out_visits : array-like of int
        Visits that take no part in the fit.
    refit_maps
        Whether maps and set-up are nuisances of the fit.

    Raises
    ------
    ValueError
        If blocks of a record are held out: what its one set-up adds is in all of them.
    """
    if conditions.is_record and np.size(held_out_visits):
        raise ValueError("expected no held-out blocks of a continuous record, which is one set-up")
    sound = ~truth.scatter.is_blunder & ~truth.is_frozen
    held_out = np.isin(truth.visit, held_out_visits)
    columns = truth.contributions_um.T
    nuisance = np.zeros((columns.shape[0], 0))
    prior = np.zeros(0)
    if refit_maps and conditions.map_error_um > 0:
        nuisance = entry_weights(maps, record, truth.observations)
        prior = np.full(nuisance.shape[1], conditions.map_error_um)
    zeros = _zero_columns(truth.observations, conditions)
    nuisance = np.hstack([nuisance, zeros])
    prior = np.concatenate([prior, np.full(zeros.shape[1], UNKNOWN_ZERO_UM)])
    train = sound & ~held_out
    rows = _whitened(
        np.column_stack([columns, nuisance, truth.residual_um])[train],
        truth.observations,
        train,
        conditions,
        refit_maps,
    )
    effects, others, residual = np.split(rows, [columns.shape[1], -1], axis=1)
    fits = []
    for chosen, of_chosen in ((columns, effects), (columns[:, :0], effects[:, :0])):
        fit = _fit(of_chosen, others, prior, residual[:, 0])
        residuals = truth.residual_um - chosen @ fit.amplitudes - nuisance @ fit.nuisances
        fits.append((fit, _without_zero(residuals, truth, conditions)))
    (fit, residuals), (_, left_without) = fits
    test = sound & held_out
    total = truth.scatter.setup + truth.scatter.noise
    return OracleFit(
        fit.amplitudes,
        fit.standard_errors,
        _rms(residuals[sound & ~held_out]),
        _rms(residuals[test]),
        _rms(left_without[test]),
        _rms(_without_zero(total, truth, conditions)[test]),
    )


class _Fit(NamedTuple):
    amplitudes: FloatArray
    standard_errors: FloatArray
    nuisances: FloatArray


def _fit(effects: FloatArray, nuisance: FloatArray, prior: FloatArray, values: FloatArray) -> _Fit:
    """Least squares, with each nuisance's prior standard deviation as a further row."""
    normal = cho_factor(nuisance.T @ nuisance + np.diag(prior**-2.0)) if prior.size else None

    def of_nuisance(rows: FloatArray) -> FloatArray:
        if normal is None:
            return np.zeros((0, *rows.shape[1:]))
        return np.asarray(cho_solve(normal, nuisance.T @ rows), dtype=np.float64)

    # The nuisances eliminated: what is left of the effects when these are fitted, each against its
    # prior, which stands in the normal equations as 1/σ².
    remaining = effects - nuisance @ of_nuisance(effects)
    covariance = np.asarray(np.linalg.pinv(effects.T @ remaining, hermitian=True), dtype=np.float64)
    amplitudes = covariance @ (remaining.T @ values)
    nuisances = of_nuisance(values - effects @ amplitudes)
    return _Fit(amplitudes, np.sqrt(np.diag(covariance)), nuisances)


def _whitened(
    rows: FloatArray,
    observations: Observations,
    chosen: BoolArray,
    conditions: Conditions,
    with_setup: bool,
) -> FloatArray:
    """Divide by the scatter's standard deviation; values of a group share their set-up's.

    That is a shift, a tilt, and what wanders while it lasts.
    """
    noise = float(np.hypot(conditions.repeatability_um, conditions.ar1_um)) or 1.0
    if not with_setup and not _zero_by_visit(conditions):
        return rows / noise
    shift = conditions.setup_shift_um if with_setup else 0.0
    tilt = conditions.setup_tilt_um if with_setup else 0.0
    wander_um = conditions.wander_um if with_setup else 0.0
    wander_tilt_um = conditions.wander_tilt_um if with_setup else 0.0
    if _zero_by_visit(conditions):
        shift = UNKNOWN_ZERO_UM
    setup = conditions.setup_of(observations.value_visit)
    block = (setup * len(GROUPS) + group_of_values(observations))[chosen]
    along = setup_shape(observations)[chosen]
    shape = np.hstack([np.full((block.size, 1), shift), tilt * along])
    wander = np.hstack([np.full((block.size, 1), wander_um), wander_tilt_um * along])
    at_min = observations.time_min[observations.of_value][chosen]
    order = np.argsort(block, kind="stable")
    whitened = np.empty(rows.shape)
    for here in np.split(order, np.flatnonzero(np.diff(block[order])) + 1):
        covariance = noise**2 * np.eye(here.size) + shape[here] @ shape[here].T
        apart_min = np.abs(at_min[here, None] - at_min[here])
        together = np.exp(-apart_min / conditions.wander_min)
        covariance += together * (wander[here] @ wander[here].T)
        whitened[here] = np.linalg.solve(np.linalg.cholesky(covariance), rows[here])
    return whitened


def _zero_by_visit(conditions: Conditions) -> bool:
    """Whether every visit has its own unknown zero."""
    return conditions.datum != "absolute" and not conditions.one_verification


def _zero_columns(observations: Observations, conditions: Conditions) -> FloatArray:
    """Columns of unknown zeros that visits share: shape (m, groups)."""
    if conditions.datum == "absolute" or not conditions.one_verification:
        return np.zeros((observations.of_value.size, 0))
    shared = datum_groups(observations, conditions)
    columns: FloatArray = (shared[:, None] == np.unique(shared)).astype(float)
    return columns


def _without_zero(values: FloatArray, truth: Truth, conditions: Conditions) -> FloatArray:
    """Take the mean off the values that share an unknown zero of their own visit."""
    if not _zero_by_visit(conditions):
        return values
    _, number = np.unique(datum_groups(truth.observations, conditions), return_inverse=True)
    means: FloatArray = np.bincount(number, values) / np.bincount(number)
    return values - means[number]


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else 0.0
