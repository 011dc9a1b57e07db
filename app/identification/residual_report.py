"""What a model leaves of verifications, before anything is fitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from app.arrays import BoolArray, FloatArray
from app.identification.before_after import lengths, pooled, unknown_zeros, without_zeros
from app.identification.residual_summary import Summary, summarise
from app.identification.residuals import LeftOut, Residuals, channel_unit
from app.identification.search.figures import rms
from app.identification.search.noise import repeatability
from app.identification.search.rows import Rows


@dataclass(frozen=True, slots=True)
class Size:
    """Size of some residuals, in the unit `unit`.

    `share_above` is the share that exceeds the repeatability `noise` in size (noise alone:
    32 %), whose origin is `declared`, `replicates` or `residuals`.
    """

    component: str
    unit: str
    count: int
    mean: float
    rms: float
    p95: float
    noise: float | None
    noise_origin: str
    share_above: float | None


@dataclass(frozen=True, eq=False)
class ResidualReport:
    """Residuals and their size.

    Parameters
    ----------
    residuals
        What could be compared with the model.
    values : ndarray, shape (n,) [the channels' units]
        Measured minus predicted, without the unknown zero of a datum that is not absolute.
    overall
        All lengths together; None where no value is one.
    components
        Each channel by itself.
    summaries
        Along everything that they may depend on.
    excluded
        What could not be compared.
    """

    residuals: Residuals
    values: FloatArray
    overall: Size | None
    components: Sequence[Size]
    summaries: Sequence[Summary]
    excluded: Sequence[LeftOut]


def residual_report(residuals: Residuals) -> ResidualReport:
    """Sum residuals up.

    Parameters
    ----------
    residuals
        Measured minus predicted.

    Returns
    -------
    ResidualReport
    """
    rows = residuals.as_rows()
    values = without_zeros(unknown_zeros(residuals, rows), rows.values)
    components = component_sizes(residuals, rows, values)
    in_um = [size for size in components if size.unit == "µm"]
    overall = None
    noise_um = None
    if in_um:
        noise_um = pooled([s.noise or 0.0 for s in in_um], [s.count for s in in_um])
        origins = "/".join(dict.fromkeys(s.noise_origin for s in in_um))
        overall = _size("all", "µm", values[lengths(residuals)], noise_um, origins)
    return ResidualReport(
        residuals=residuals,
        values=values,
        overall=overall,
        components=components,
        summaries=summarise(residuals, values, noise_um),
        excluded=residuals.left_out,
    )


def component_sizes(residuals: Residuals, rows: Rows, values: FloatArray) -> list[Size]:
    """Sum each channel up, in the order of the channels.

    Parameters
    ----------
    residuals, rows
        The rows.
    values : ndarray, shape (n,) [the channels' units]
        Their residuals.

    Returns
    -------
    list of Size
    """
    everything: BoolArray = np.ones(len(values), dtype=np.bool_)
    found = []
    for number, name in enumerate(residuals.rows.channels):
        own = rows.channel == number
        if own.any():
            noise = repeatability(rows, number, everything)
            unit = channel_unit(name).symbol
            found.append(_size(name, unit, values[own], noise.value, noise.origin))
    return found


def _size(component: str, unit: str, values: FloatArray, noise: float | None, origin: str) -> Size:
    size = np.abs(values)
    return Size(
        component=component,
        unit=unit,
        count=int(values.size),
        mean=float(values.mean()),
        rms=rms(values),
        p95=float(np.quantile(size, 0.95)),
        noise=noise,
        noise_origin=origin,
        share_above=None if noise is None else float(np.mean(size > noise)),
    )
