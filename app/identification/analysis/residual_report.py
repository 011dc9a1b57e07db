"""What a model leaves of verifications, before anything is fitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from pydantic import Field

from app.answer import IN_ITS_UNIT, Answer, UnitSymbol
from app.arrays import BoolArray, FloatArray, rms
from app.identification.analysis.before_after import (
    SCATTER_OF_DIFFERENCE,
    lengths,
    pooled,
    scatter_in_repeatabilities,
    zero_of,
)
from app.identification.analysis.figures import Zero
from app.identification.observed_scatter import ObservedScatter
from app.identification.residuals.residuals import LeftOut, Residuals, channel_unit
from app.identification.residuals.summary import Summary, share_above, summarise
from app.search.noise import repeatability
from app.search.rows import Rows
from app.search.zeros import UnknownZero, unknown_zeros, without_zeros


@dataclass(frozen=True, slots=True)
class Size(Answer, published_as="SizeAnswer"):
    """Size of the residuals of one component, or of all lengths together."""

    component: Annotated[str, Field(examples=["EZZ"])]
    """Component code, `points x`, or `all`"""

    unit: UnitSymbol
    """Unit of its numbers"""

    count: int
    """How many values"""

    mean: Annotated[float, Field(description=f"Mean {IN_ITS_UNIT}")]
    rms: Annotated[float, Field(description=f"Root mean square {IN_ITS_UNIT}")]
    p95: Annotated[float, Field(description=f"95th percentile of the size {IN_ITS_UNIT}")]
    repeatability: Annotated[
        float | None, Field(description=f"Standard deviation of one observation {IN_ITS_UNIT}")
    ]
    repeatability_origin: str
    """`declared`, what nearly all lengths have in `common` where they contradict that, from
    `replicates`, or guessed from the `residuals` within visits"""

    share_above_repeatability: float | None
    """Share that exceeds it in size, with that of a zero that was measured too; noise alone:
    0.32"""

    zero: Zero
    """What its figures are relative to, as in an analysis"""

    @property
    def by_noise(self) -> float | None:
        """Standard deviation of one residual by repeatability alone.

        Counted from a first observation, a residual has the noise of both.
        """
        if self.repeatability is None or self.zero != "first":
            return self.repeatability
        return SCATTER_OF_DIFFERENCE * self.repeatability

    @property
    def ratio(self) -> float:
        """The root mean square over `by_noise`; 0 where nothing is known of that."""
        return self.rms / self.by_noise if self.by_noise else 0.0


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ResidualFigures(Answer):
    """What is said of residuals in figures."""

    overall: Size | None
    """All lengths; null where nothing is one"""
    components: Sequence[Size]
    """Each component in its own unit"""
    contradiction: str | None = None
    """What is said of a stated repeatability that nearly all lengths contradict, as in an analysis:
    the figures rest on what they show; null where nothing is contradicted"""
    summaries: Sequence[Summary]
    """Components, and lengths along everything that they may depend on"""
    excluded: Sequence[LeftOut]
    """What cannot be compared with the model"""

    @property
    def count(self) -> int:
        """How many values could be held against the model."""
        return sum(size.count for size in self.components)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ResidualReport(ResidualFigures):
    """Residuals and their size.

    Parameters
    ----------
    values : ndarray, shape (n,) [the channels' units]
        Measured minus predicted: from its first observation where the instrument was zeroed
        there, less the mean where nobody knows its zero.
    scatter : ndarray, shape (n,) [standard deviations of one observation]
        By how much noise alone scatters each of them.
    """

    residuals: Residuals
    values: FloatArray
    scatter: FloatArray


def residual_report(residuals: Residuals, scatter: ObservedScatter) -> ResidualReport:
    """Sum residuals up.

    Parameters
    ----------
    scatter
        By what the campaign's observations scatter: some of its rows may be left out here.
    """
    rows = replace(residuals.as_rows(), noise=scatter.noise)
    denied = scatter.contradiction
    zeros = unknown_zeros(rows)
    values = without_zeros(zeros, rows.values)
    own_scatter = scatter_in_repeatabilities(zeros, len(values))
    components = component_sizes(residuals, rows, values, zeros, own_scatter)
    in_um = [size for size in components if size.unit == "µm"]
    overall = None
    noise_um = None
    if in_um:
        noise_um = pooled([s.repeatability or 0.0 for s in in_um], [s.count for s in in_um])
        origins = "/".join(dict.fromkeys(s.repeatability_origin for s in in_um))
        chosen = lengths(residuals)
        zero = zero_of(zeros, chosen)
        overall = _size("all", "µm", values[chosen], own_scatter[chosen], noise_um, origins, zero)
    return ResidualReport(
        residuals=residuals,
        values=values,
        scatter=own_scatter,
        overall=overall,
        components=components,
        summaries=summarise(
            residuals, values, None if noise_um is None else noise_um * own_scatter
        ),
        excluded=residuals.left_out,
        contradiction=None if denied is None else denied.sentence,
    )


def component_sizes(
    residuals: Residuals,
    rows: Rows,
    values: FloatArray,
    zeros: Sequence[UnknownZero],
    scatter: FloatArray,
) -> list[Size]:
    """Sum each channel up, in the order of the channels.

    Parameters
    ----------
    values, scatter : ndarray, shape (n,) [the channels' units; repeatabilities]
        Their residuals, and by how much noise alone scatters each.
    """
    everything: BoolArray = np.ones(len(values), dtype=np.bool_)
    sizes = []
    for number, name in enumerate(residuals.rows.channels):
        of_channel = rows.channel == number
        if of_channel.any():
            noise = repeatability(rows, number, everything)
            unit = channel_unit(name).symbol
            zero = zero_of(zeros, of_channel)
            sizes.append(
                _size(
                    name,
                    unit,
                    values[of_channel],
                    scatter[of_channel],
                    noise.value,
                    noise.origin,
                    zero,
                )
            )
    return sizes


def _size(
    component: str,
    unit: str,
    values: FloatArray,
    scatter: FloatArray,
    noise: float | None,
    origin: str,
    zero: Zero,
) -> Size:
    size = np.abs(values)
    return Size(
        component=component,
        unit=unit,
        count=int(values.size),
        mean=float(values.mean()),
        rms=rms(values),
        p95=float(np.quantile(size, 0.95)),
        repeatability=noise,
        repeatability_origin=origin,
        share_above_repeatability=None if noise is None else share_above(values, noise * scatter),
        zero=zero,
    )
