"""How far the line through two maps is trusted beyond them, and how uncertain it is there."""

from __future__ import annotations

import math

import numpy as np

from app.arrays import FloatArray
from app.thermal.group import Group, MapsInUse, Member, Scale
from app.thermal.machine import Machine


def weight_limits(machine: Machine, group: Group, scale: Scale, lower: int) -> tuple[float, float]:
    """Find between which weights two neighbouring maps may be extrapolated.

    Returns
    -------
    low, high
        At most 0 and at least 1. Between them the variance of an extrapolated value
        is at most the machine's `extrapolation_error_ratio`
        squared times that at the edge of the maps: on the average over a component's
        positions, for each component of the group, so the first that reaches it stops its
        neighbours. Where a map states no uncertainty
        both count as equally certain, and the ratio limits (1 − w)² + w².

    Notes
    -----
    With the variances v of the maps and q of their temperatures (`slope_variances`) the variance
    at weight w is (1 − w)² (v_n + q) + 2 w (1 − w) c + w² (v_m + q), and max(v_n, v_m) + q at the
    edge: like with like, so the temperatures alone never stop what the maps' own uncertainty
    would let go on, and maps that are equally certain have the limit of those that state nothing.
    The live reading's own q, which has a weight of 1 everywhere, is left out on both sides.
    """
    key = (scale, lower)
    cached = group.limits.get(key)
    if cached is None:
        maps = group.maps_in_use(*scale.rows[lower : lower + 2])
        slopes = slope_variances(
            maps, scale.span_c(lower), machine.sensor(scale.sensor).resolution_c
        )
        ratio = machine.extrapolation_error_ratio
        limits = [_weight_limits(maps, member, slopes, ratio) for member in maps.members]
        cached = group.limits[key] = (
            max(low for low, _ in limits),
            min(high for _, high in limits),
        )
    return cached


def variances_at(
    maps: MapsInUse, weight: float, span_c: float, resolution_c: float
) -> FloatArray | None:
    """Give the variances of (1 − w) E_n + w E_m, as far as the measurement of the maps goes.

    Parameters
    ----------
    span_c
        How far apart they are [K].
    resolution_c
        Of the sensor [°C].

    Returns
    -------
    ndarray, shape (w,), or None [the members' units squared]
        At a map its own (GUM, 5.1.2). The maps' temperatures count as exact at the maps and
        between them; beyond them what their resolution adds is how much it grows from the edge,
        2 w (w − 1) q: the q of the map at the edge is left out, as it is inside, so that
        there is no step, and so is that of the live reading. All of it would be
        q [(1 − w)² + w² + 1] everywhere.
    """
    if maps.variances is None:
        return None
    v_n, v_m, w = maps.variances[0], maps.variances[-1], weight
    # At a map that one is in use alone.
    if w in (0.0, 1.0):
        return v_m
    variances: FloatArray = (1.0 - w) ** 2 * v_n + w**2 * v_m
    if maps.covariances is not None:
        variances += 2.0 * w * (1.0 - w) * maps.covariances
    if not 0.0 < w < 1.0:
        # (1 − w)² + w² − 1: what the temperatures of both maps make uncertain, less what one does
        # at the edge.
        variances += 2.0 * w * (w - 1.0) * slope_variances(maps, span_c, resolution_c)
    return variances


def slope_variances(maps: MapsInUse, span_c: float, resolution_c: float) -> FloatArray:
    """What the resolution of one map's temperature makes uncertain, for each column: q.

    A reading of resolution r has the standard uncertainty r/√12 (GUM, F.2.2.1); it acts
    with the slope of the error over temperature, s: q = s² r²/12.

    Returns
    -------
    ndarray, shape (w,) [the members' units squared]
    """
    slopes = (maps.nodes[-1] - maps.nodes[0]) / span_c
    variances: FloatArray = slopes**2 * (resolution_c**2 / 12.0)
    return variances


def _weight_limits(
    maps: MapsInUse, member: Member, slopes: FloatArray, ratio: float
) -> tuple[float, float]:
    """Solve v(w) = ratio² max(v_n, v_m) for one component, means over its columns, q included."""
    columns = slice(member.forward.start, (member.backward or member.forward).stop)
    v_n, v_m, c = 1.0, 1.0, 0.0
    if maps.variances is not None:
        means = [float(v[columns].mean()) for v in (maps.variances[0], maps.variances[-1])]
        # Without a statement, or with one of no uncertainty at all, there is no measure.
        if np.isfinite(means).all() and max(means) > 0.0:
            q = float(slopes[columns].mean())
            v_n, v_m = (v + q for v in means)
            c = 0.0 if maps.covariances is None else float(maps.covariances[columns].mean())
    # v(w) = (1 − w)² v_n + 2 w (1 − w) c + w² v_m is v_n − 2 `half` w + `square` w²; where it is
    # `beyond` above v_n is a quadratic equation.
    square = v_n + v_m - 2.0 * c
    half = v_n - c
    beyond = ratio**2 * max(v_n, v_m) - v_n
    if square <= 0.0:
        return -math.inf, math.inf
    root = math.sqrt(half**2 + square * beyond)
    return min((half - root) / square, 0.0), max((half + root) / square, 1.0)
