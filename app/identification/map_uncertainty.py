"""The maps' own uncertainty as something that the residuals may follow.

Each entry of each map was measured with a standard error. An entry acts on all rows between
its neighbours, in position and in temperature, with the weights of the interpolation.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from app.arrays import FloatArray, IntArray
from app.identification.map_tables import hat_weights, maps_of_label
from app.identification.observations import POINT_CHANNELS
from app.identification.projection import Projection, View
from app.identification.search.rows import Nuisance
from app.thermal.compiled_model import CompiledModel, Group, Member
from app.thermal.error_map import ErrorMap
from app.units import Unit

UNSTATED: Final = 0.5
"""Standard error where a map states none, in the component's unit."""

NEGLIGIBLE: Final = 0.5
"""Squares, summed over all rows, that combined entries may leave out: of one row's variance."""


def map_uncertainty(projection: Projection, maps: Sequence[ErrorMap]) -> list[Nuisance]:
    """Lay the maps' uncertainty out as columns for each channel.

    Parameters
    ----------
    projection
        The rows.
    maps
        The error maps that the model was made of.

    Returns
    -------
    list of Nuisance
        One for each channel: entry by entry for a component; for points all components'
        entries, combined to as few columns as say the same.
    """
    model, rows = projection.model, projection.rows
    all_codes = [c for group in model.groups for c in group.codes]
    starts = np.cumsum([0, *(_entry_count(model, code) for code in all_codes)])
    found = []
    for number, channel in enumerate(rows.channels):
        own = rows.of_channel(channel)
        codes = all_codes if channel in POINT_CHANNELS else [c for c in all_codes if c == channel]
        if not codes or not own.size:
            continue
        blocks = [_in_channel(projection, maps, code, own) for code in codes]
        entries = np.hstack(blocks)
        columns = combined(entries) if channel in POINT_CHANNELS else entries
        columns = columns[:, columns.any(axis=0)]
        if not columns.size:
            continue
        first = starts[all_codes.index(codes[0])]
        shared = np.zeros((starts[-1], columns.shape[1]))
        # The columns are orthogonal, or single entries: both come back by projection.
        weights = entries.T @ columns / np.sum(columns**2, axis=0)
        if channel not in POINT_CHANNELS:
            weights = np.eye(entries.shape[1])[:, entries.any(axis=0)]
        shared[first : first + len(weights)] = weights
        found.append(Nuisance(number, own, columns, np.ones(columns.shape[1]), shared))
    return found


def entry_columns(
    model: CompiledModel, code: str, view: View
) -> tuple[FloatArray, FloatArray | None]:
    """Say how much each entry of a component's tables enters each row.

    Parameters
    ----------
    model
        The compiled model.
    code
        A component that it has.
    view
        The rows in which it shows.

    Returns
    -------
    forward, backward : ndarray, shape (m, M k)
        Weights, by map and position; None where directions share their entries. Zero where
        the temperature is not known.
    """
    found = model.find(code)
    assert found is not None
    group, member = found
    weights = _map_weights(group, view)
    left, right, share = hat_weights(member.positions_mm, view.places.positions_mm)
    count = max(member.positions_mm.size, 1)
    hats = np.zeros((len(left), count))
    np.add.at(hats, (np.arange(len(left)), left), 1.0 - share)
    np.add.at(hats, (np.arange(len(left)), right), share)
    columns = (weights[:, :, None] * hats[:, None, :]).reshape(
        len(left), weights.shape[1] * hats.shape[1]
    )
    columns = columns * view.gains[:, None]
    if member.backward is None:
        return columns, None
    ahead = (1.0 + np.sign(view.places.directions))[:, None] / 2.0
    return columns * ahead, columns * (1.0 - ahead)


def entry_errors(
    model: CompiledModel, maps: Sequence[ErrorMap], code: str, *, backward: bool = False
) -> FloatArray:
    """Find the standard error of each entry of a component's tables.

    Parameters
    ----------
    model
        The compiled model.
    maps
        The error maps that it was made of.
    code
        A component that it has.
    backward
        Whether the entries of the negative approach are meant.

    Returns
    -------
    ndarray, shape (M k,) [the component's unit]
        What the maps state; else their repeatability for lengths in µm; else half a unit.
    """
    found = model.find(code)
    assert found is not None
    group, member = found
    columns = member.backward if backward and member.backward else member.forward
    fallback = [[_unstated(maps, label, member)] for label in group.labels]
    errors = np.broadcast_to(np.array(fallback), group.nodes[:, columns].shape)
    if group.variances is not None:
        stated = np.sqrt(group.variances[:, columns])
        errors = np.where(np.isnan(stated), errors, stated)
    return errors.ravel()


def combined(scaled: FloatArray) -> FloatArray:
    """Replace many columns by few that give the rows the same covariance.

    Parameters
    ----------
    scaled : ndarray, shape (m, p)
        Columns times their standard deviations.

    Returns
    -------
    ndarray, shape (m, q)
        q ≤ p; all that is left out, summed over the rows, is half the variance of one.
    """
    if scaled.shape[1] < 2:
        return scaled
    if len(scaled) < scaled.shape[1]:
        # scaled scaledᵀ = U S² Uᵀ: the columns U S have the same.
        squares, left = np.linalg.eigh(scaled @ scaled.T)
        parts = (left * np.sqrt(np.maximum(squares, 0.0)))[:, ::-1]
    else:
        # As scaled = U S Vᵀ, the columns U S are the columns themselves, turned by V.
        _, turned = np.linalg.eigh(scaled.T @ scaled)
        parts = scaled @ turned[:, ::-1]
    # However small in each row, what many rows share is seen: so their sum counts.
    left_out = np.cumsum(np.sum(parts**2, axis=0)[::-1])
    largest = float(np.sum(scaled**2, axis=1).max())
    dropped = int(np.searchsorted(left_out, NEGLIGIBLE * largest, side="right"))
    kept: FloatArray = parts[:, : parts.shape[1] - dropped]
    return kept


def _entry_count(model: CompiledModel, code: str) -> int:
    """Count the entries of a component's tables, those of both directions."""
    found = model.find(code)
    assert found is not None
    group, member = found
    directions = 1 if member.backward is None else 2
    return len(group.labels) * max(member.positions_mm.size, 1) * directions


def _in_channel(
    projection: Projection, maps: Sequence[ErrorMap], code: str, own: IntArray
) -> FloatArray:
    """Columns of one component's entries on a channel's rows, in standard errors."""
    view = projection.view(code)
    here = np.isin(view.rows, own)
    forward, backward = entry_columns(projection.model, code, view)
    blocks = [forward * entry_errors(projection.model, maps, code)]
    if backward is not None:
        blocks.append(backward * entry_errors(projection.model, maps, code, backward=True))
    every = np.hstack(blocks)
    found = np.zeros((len(own), every.shape[1]))
    found[np.searchsorted(own, view.rows[here])] = every[here]
    return found


def _map_weights(group: Group, view: View) -> FloatArray:
    """Weight of each map in each row, shape (m, M): by rows of the group's matrix."""
    scale = group.scales[0]
    t = np.clip(
        view.conditions.temperature(scale.sensor),
        scale.temperatures_c[0],
        scale.temperatures_c[-1],
    )
    left, right, share = hat_weights(np.array(scale.temperatures_c), np.nan_to_num(t))
    order = np.array(scale.rows, dtype=np.intp)
    weights = np.zeros((len(t), len(order)))
    known = ~np.isnan(t)
    rows = np.flatnonzero(known)
    weights[rows, order[left[known]]] += 1.0 - share[known]
    weights[rows, order[right[known]]] += share[known]
    return weights


def _unstated(maps: Sequence[ErrorMap], label: str, member: Member) -> float:
    if member.component.unit is not Unit.UM:
        return UNSTATED
    stated = [m.repeatability_um for m in maps_of_label(maps, label) if m.repeatability_um]
    return float(np.mean(stated)) if stated else UNSTATED
