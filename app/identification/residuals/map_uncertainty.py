"""The maps' own uncertainty, and that of sensors, as something that residuals may follow.

Each entry of each map was measured with a standard error. An entry acts on all rows between
its neighbours, in position and in temperature, with the weights of the interpolation. A row
lies between two maps and two positions, so of all entries at most four of each component act
on it: they are kept sparse, and memory follows the observations, not the maps.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import sparse

from app.arrays import FloatArray, IntArray, SparseArray
from app.effects.map_tables import maps_of_label
from app.effects.observations import POINT_CHANNELS
from app.effects.projection import Projection, View
from app.errors import InvalidContent
from app.search.priors import UNSTATED_MAP_ERROR
from app.search.rows import Nuisance
from app.thermal.compiled_model import CompiledModel
from app.thermal.error_map import ErrorMap
from app.thermal.group import Member
from app.thermal.map_weights import common_ranges, maps_at
from app.thermal.resampling import hat_weights
from app.units import Unit

NEGLIGIBLE: Final = 0.5
"""Squares, summed over all rows, that combined entries may leave out: of one row's variance."""

NEGLIGIBLE_IN_A_ROW: Final = 0.1
"""Share of its own variance that they may leave out in any row."""

ROUNDED: Final = 1e-12
"""What rounding leaves in a row that no entry enters, as a share of the largest variance."""

NOTHING_BETWEEN: Final = 0.01
"""Share of an entry's standard error that a straight line between two of them may leave."""

COLUMNS_AT_ONCE: Final = 64
"""Columns that are looked at together: memory follows the observations, not the entries."""

MOST_NUMBERS: Final = 100_000_000
"""Numbers that the columns of a search may have: of all that an analysis holds it is these that
grow as observations times entries, and the search keeps a few copies of them."""


@dataclass(frozen=True, eq=False)
class ChannelEntries:
    """How much the tables' entries enter the rows of one channel.

    Parameters
    ----------
    rows : ndarray, shape (m,)
    columns : sparse array, shape (m, e)
        Change of each row for one standard error of each entry, by entries of all components:
        the same e for all channels.
    """

    channel: int
    rows: IntArray
    columns: SparseArray

    @property
    def touched(self) -> IntArray:
        """The entries that enter some row."""
        return np.unique(self.columns.indices).astype(np.intp)


def channel_entries(
    projection: Projection, maps: Sequence[ErrorMap], steps: SparseArray | None = None
) -> list[ChannelEntries]:
    """Lay the maps' entries out over the rows of each channel.

    Parameters
    ----------
    steps : sparse array, shape (n, s), or None
        Change of each row for one standard error of a coarse or noisy sensor; these are
        taken as entries too (`error_columns`).

    Returns
    -------
    list of ChannelEntries
        Of each channel in which some entry shows.
    """
    codes = _codes(projection)
    return _in_channels(
        projection, {code: _in_standard_errors(projection, maps, code) for code in codes}, steps
    )


def map_uncertainty(
    projection: Projection, maps: Sequence[ErrorMap], steps: SparseArray | None = None
) -> list[Nuisance]:
    """Lay the maps' uncertainty out as columns for each channel, and that of sensors.

    Returns
    -------
    list of Nuisance
        One for each channel: entry by entry for a component; for points all components'
        entries, combined to as few columns as say the same. Entries that enter no row are
        left out.

    Raises
    ------
    InvalidContent
        If the columns would not fit into the memory that an analysis may take.
    """
    return _nuisances(projection, channel_entries(projection, maps, steps))


def between_positions(projection: Projection, maps: Sequence[ErrorMap]) -> list[Nuisance]:
    """Lay out what straight lines between the tables' positions leave of a curved error.

    Nothing was measured there, so no standard error of an entry has it. With the curvature e''
    of the tables' second differences, a straight line over a gap h leaves −u (1 − u) h² e''/2 at
    the share u of the gap. That is one error of the whole component, and once more one of each
    gap by itself, at its mean size: how shorter waves run there is not known.

    Returns
    -------
    list of Nuisance
        As those of `map_uncertainty`, of a standard deviation of one.
    """
    bows = {code: _bows(projection, maps, code) for code in _codes(projection)}
    return _nuisances(projection, _in_channels(projection, bows))


def entry_columns(model: CompiledModel, code: str, view: View) -> SparseArray:
    """Say how much each entry of a component's tables enters each row.

    Parameters
    ----------
    view
        The rows in which it shows.

    Returns
    -------
    sparse array, shape (m, d M k)
        Weights by direction, map and position: d is 2 where directions have entries of their
        own, those of the positive approach first. Zero where the temperature is not known.
    """
    located = model.find(code)
    assert located is not None
    group, member = located
    conditions = view.conditions
    weights = maps_at(model, group, conditions.temperatures_c, len(conditions)).weights
    weights = np.nan_to_num(weights)
    # Beyond what the maps with a weight cover, the end values of that range hold.
    inside = np.clip(view.places.positions_mm, *common_ranges(member, weights))
    left, right, share = hat_weights(member.positions_mm, inside)
    count = max(member.positions_mm.size, 1)
    width = weights.shape[1] * count
    rows, at_map = np.nonzero(weights)
    of_map = weights[rows, at_map] * view.gains[rows]
    placed = [
        (at_map * count + position[rows], of_map * part[rows])
        for position, part in ((left, 1.0 - share), (right, share))
    ]
    if member.backward is not None:
        # Of an unknown approach half of each direction.
        ahead = (1.0 + np.sign(view.places.directions))[rows] / 2.0
        placed = [
            *((entry, value * ahead) for entry, value in placed),
            *((entry + width, value * (1.0 - ahead)) for entry, value in placed),
        ]
        width *= 2
    entries, values = (np.concatenate(column) for column in zip(*placed, strict=True))
    of_rows = np.tile(rows, len(placed))
    columns = sparse.csr_array((values, (of_rows, entries)), shape=(len(left), width))
    columns.eliminate_zeros()
    return columns


def entry_errors(
    model: CompiledModel, maps: Sequence[ErrorMap], code: str, *, backward: bool = False
) -> FloatArray:
    """Find the standard error of each entry of a component's tables.

    Parameters
    ----------
    backward
        Whether the entries of the negative approach are meant.

    Returns
    -------
    ndarray, shape (M k,) [the component's unit]
        What the maps state; else their repeatability for lengths in µm; else half a unit.
    """
    located = model.find(code)
    assert located is not None
    group, member = located
    columns = member.backward if backward and member.backward else member.forward
    fallback = [[_unstated(maps, label, member)] for label in group.labels]
    errors = np.broadcast_to(np.array(fallback), group.nodes[:, columns].shape)
    if group.variances is not None:
        declared = np.sqrt(group.variances[:, columns])
        errors = np.where(np.isnan(declared), errors, declared)
    return errors.ravel()


def combined(scaled: SparseArray) -> FloatArray:
    """Replace many columns by few that give the rows the same covariance.

    Parameters
    ----------
    scaled : sparse array, shape (m, p)
        Columns times their standard deviations.

    Returns
    -------
    ndarray, shape (m, q)
        q ≤ p; all that is left out, summed over the rows, is at most half the variance of one
        (`NEGLIGIBLE`), and in no row more than a tenth of its own (`NEGLIGIBLE_IN_A_ROW`).

    Examples
    --------
    >>> combined(sparse.csr_array(np.diag([1.0, 0.6])))
    array([[1. , 0. ],
           [0. , 0.6]])
    """
    if scaled.shape[1] < 2:
        return scaled.toarray()
    # scaled = U S Vᵀ. The columns U S have the same covariance, and their squares' sums are S².
    # They come from the smaller product: U itself, or the columns turned by V.
    is_wide = scaled.shape[0] < scaled.shape[1]
    product = scaled @ scaled.T if is_wide else scaled.T @ scaled
    squares, turned = np.linalg.eigh(product.toarray())
    squares = np.maximum(squares, 0.0)

    def columns(chosen: IntArray) -> FloatArray:
        if is_wide:
            return np.asarray(turned[:, chosen] * np.sqrt(squares[chosen]))
        return np.asarray(scaled @ turned[:, chosen])

    variances: FloatArray = np.asarray(scaled.power(2).sum(axis=1))
    return columns(_not_negligible(squares, columns, variances)[::-1])


def _not_negligible(
    squares: FloatArray, columns: Callable[[IntArray], FloatArray], variances: FloatArray
) -> IntArray:
    """Choose the columns that are kept, of columns whose sums of squares increase."""
    # However small in each row, what many rows share is seen: so their sum counts.
    most = NEGLIGIBLE * float(variances.max())
    small = int(np.searchsorted(np.cumsum(squares), most, side="right"))
    room = NEGLIGIBLE_IN_A_ROW * variances + ROUNDED * float(variances.max())
    chosen = [*range(small, len(squares))]
    for start in range(0, small, COLUMNS_AT_ONCE):
        block = np.arange(start, min(start + COLUMNS_AT_ONCE, small))
        for number, column in zip(block.tolist(), columns(block).T ** 2, strict=True):
            if (column <= room).all():
                room = room - column
            else:
                chosen.append(number)
    return np.array(sorted(chosen), dtype=np.intp)


def _codes(projection: Projection) -> list[str]:
    """List the components that have tables."""
    return [code for group in projection.model.groups for code in group.codes]


def _in_channels(
    projection: Projection, scaled: Mapping[str, SparseArray], steps: SparseArray | None = None
) -> list[ChannelEntries]:
    """Put the columns of components' errors into the channels in which they show."""
    rows = projection.rows
    widths = [columns.shape[1] for columns in scaled.values()]
    starts = dict(zip(scaled, np.cumsum([0, *widths]).tolist(), strict=False))
    by_channel = []
    for number, channel in enumerate(rows.channels):
        rows_of_channel = rows.of_channel(channel)
        entering = scaled if channel in POINT_CHANNELS else [c for c in scaled if c == channel]
        parts = [
            _placed(scaled[c], projection.view(c).rows, rows_of_channel, starts[c], sum(widths))
            for c in entering
        ]
        if rows_of_channel.size and any(part.nnz for part in parts):
            columns = _sum(parts)
            if steps is not None:
                columns = sparse.csr_array(sparse.hstack([columns, steps[rows_of_channel]]))
            by_channel.append(ChannelEntries(number, rows_of_channel, columns))
    return by_channel


def _nuisances(projection: Projection, entries: Sequence[ChannelEntries]) -> list[Nuisance]:
    """Make the columns of all channels; refuse what memory does not hold."""
    if not entries:
        return []
    touched = np.unique(np.concatenate([source.touched for source in entries]))
    nuisances: list[Nuisance] = []
    for entry in entries:
        taken = sum(n.columns.size for n in nuisances)
        _refuse_too_large(projection, entry, taken)
        nuisances.append(_nuisance(projection, entry, touched))
    return nuisances


def _bows(projection: Projection, maps: Sequence[ErrorMap], code: str) -> SparseArray:
    """Columns of one component on the rows of its view: all its gaps at once, then each gap."""
    model, view = projection.model, projection.view(code)
    located = model.find(code)
    assert located is not None
    group, member = located
    x, n = member.positions_mm, len(view.rows)
    if x.size < 3:
        return sparse.csr_array((n, 0))
    h = np.diff(x)
    nodes = group.nodes[:, member.forward]
    errors = entry_errors(model, maps, code).reshape(nodes.shape)
    slopes, apart = np.diff(nodes, axis=1) / h, (h[1:] + h[:-1]) / 2.0
    curvature = np.diff(slopes, axis=1) / apart
    # The three factors of a second difference: `noise` is what the entries' errors make of it.
    steps = np.stack([1.0 / h[:-1], -1.0 / h[:-1] - 1.0 / h[1:], 1.0 / h[1:]]) / apart
    noise = sum((step * errors[:, k : k + len(step)]) ** 2 for k, step in enumerate(steps))
    square, by_noise = float(np.mean(curvature**2)), float(np.mean(noise))
    # In the middle of a gap u (1 − u)/2 is 1/8.
    largest = float(h.max()) ** 2 / 8.0 * np.sqrt(max(square - by_noise, 0.0))
    if largest <= NOTHING_BETWEEN * float(np.median(errors)):
        return sparse.csr_array((n, 0))
    # Of second differences that are mostly noise, little is curvature.
    curvature = curvature * np.sqrt(1.0 - by_noise / square)
    at_ends = np.pad(curvature, ((0, 0), (1, 1)), mode="edge")
    of_gaps = (at_ends[:, 1:] + at_ends[:, :-1]) / 2.0
    conditions = view.conditions
    weights = np.nan_to_num(
        maps_at(model, group, conditions.temperatures_c, len(conditions)).weights
    )
    gap, _, u = hat_weights(x, view.places.positions_mm)
    bow = view.gains * u * (1.0 - u) * h[gap] ** 2 / 2.0
    whole = bow * np.einsum("nm,mn->n", weights, of_gaps[:, gap])
    each = bow * np.sqrt(square - by_noise) * (weights != 0.0).any(axis=1)
    rows = np.arange(n)
    return sparse.csr_array(
        (np.concatenate([whole, each]), (np.tile(rows, 2), np.concatenate([0 * gap, 1 + gap]))),
        shape=(n, 1 + h.size),
    )


def _nuisance(
    projection: Projection, channel_entries: ChannelEntries, touched: IntArray
) -> Nuisance:
    """Make one channel's columns; the unit errors that channels share are those of `touched`."""
    mine = channel_entries.touched
    entries = channel_entries.columns[:, mine]
    if projection.rows.channels[channel_entries.channel] in POINT_CHANNELS:
        columns = combined(entries)
        # The columns are orthogonal: entries come back by projection.
        weights = sparse.csr_array(entries.T @ columns / np.sum(columns**2, axis=0))
    else:
        columns = entries.toarray()
        weights = sparse.eye_array(len(mine), format="csr")
    places = np.searchsorted(touched, mine)
    back = sparse.csr_array(
        (np.ones(len(mine)), (places, np.arange(len(mine)))), shape=(len(touched), len(mine))
    )
    return Nuisance(channel_entries.channel, channel_entries.rows, columns, back @ weights)


def _refuse_too_large(projection: Projection, entries: ChannelEntries, taken: int) -> None:
    """Refuse what would need more memory than is stated, before it is taken."""
    channel = projection.rows.channels[entries.channel]
    m, p = len(entries.rows), entries.touched.size
    # Points' columns are combined from a product of the smaller side with itself.
    numbers = taken + (min(m, p) ** 2 if channel in POINT_CHANNELS else m * p)
    if numbers > MOST_NUMBERS:
        raise InvalidContent(
            f"expected observations for which the maps' uncertainty takes at most "
            f"{MOST_NUMBERS:,} numbers, got {numbers:,} for {m:,} values of {channel} that lie "
            f"between {p:,} entries of the maps: analyse fewer verifications at once, measure at "
            "the same positions again, or store maps with fewer positions"
        )


def _in_standard_errors(projection: Projection, maps: Sequence[ErrorMap], code: str) -> SparseArray:
    """Columns of one component's entries on the rows of its view, in standard errors."""
    model = projection.model
    columns = entry_columns(model, code, projection.view(code))
    errors = [entry_errors(model, maps, code)]
    if columns.shape[1] > errors[0].size:
        errors.append(entry_errors(model, maps, code, backward=True))
    scaled = columns.copy()
    scaled.data *= np.concatenate(errors)[columns.indices]
    return scaled


def _placed(
    columns: SparseArray, rows: IntArray, rows_of_channel: IntArray, start: int, width: int
) -> SparseArray:
    """Keep the rows that are a channel's, at their places there, and the columns at theirs."""
    coordinates = columns.tocoo()
    place = np.full(
        int(max(rows.max(initial=-1), rows_of_channel.max(initial=-1))) + 1, -1, dtype=np.intp
    )
    place[rows_of_channel] = np.arange(len(rows_of_channel))
    at, entry = place[rows[coordinates.coords[0]]], coordinates.coords[1]
    here = at >= 0
    return sparse.csr_array(
        (coordinates.data[here], (at[here], entry[here] + start)),
        shape=(len(rows_of_channel), width),
    )


def _sum(parts: Sequence[SparseArray]) -> SparseArray:
    total = parts[0]
    for part in parts[1:]:
        total = total + part
    return total


def _unstated(maps: Sequence[ErrorMap], label: str, member: Member) -> float:
    if member.component.unit is not Unit.UM:
        return UNSTATED_MAP_ERROR
    declared = [m.repeatability_um for m in maps_of_label(maps, label) if m.repeatability_um]
    return float(np.mean(declared)) if declared else UNSTATED_MAP_ERROR
