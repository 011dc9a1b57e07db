"""From errors of components to rows: one projection for all effects and for the maps.

An observation of a component shows that component alone. An observation at a point shows
every component through the rule of the volumetric error, which is linear: a component's
gain is what the rule makes of one unit of it there.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from app.arrays import FloatArray, IntArray
from app.effects.conditions import Conditions
from app.effects.effect import Effect, acting_on
from app.effects.observations import POINT_CHANNELS, ObservationRows
from app.effects.shape import Places
from app.effects.term import Term
from app.effects.valid import Valid
from app.geometry.chain import Chain
from app.geometry.components import COMPONENTS, LINEAR_LETTERS
from app.geometry.measuring_line import MeasuringLines
from app.geometry.needed_components import needed_components
from app.geometry.volumetric_error import volumetric_error
from app.search.candidate import Part
from app.thermal.compiled_model import CompiledModel
from app.thermal.map_weights import maps_at_places, read_maps, weights_of


@dataclass(frozen=True, eq=False)
class View:
    """The rows in which one component shows, and how.

    Parameters
    ----------
    rows : ndarray, shape (m,)
    gains : ndarray, shape (m,)
        The rows' change for one unit of the component.
    places
        Where the component's axis stood, and from which side it came, shape (m,) each.
    """

    rows: IntArray
    channels: tuple[int, ...]
    gains: FloatArray
    places: Places
    conditions: Conditions


@dataclass(frozen=True, eq=False)
class RowsOfChannels:
    """The rows in which any of some components shows.

    Parameters
    ----------
    channels
        Number of each channel, its rows, and which of all these they are.
    places
        Component to where the rows of its view are among these.
    """

    channels: Sequence[tuple[int, IntArray, IntArray]]
    places: Mapping[str, IntArray | slice]
    count: int

    @classmethod
    def of_views(cls, views: Mapping[str, View], channel: IntArray) -> RowsOfChannels:
        """Gather the rows of views; `channel` is that of each of all rows."""
        rows = np.unique(np.concatenate([np.empty(0, np.intp), *(v.rows for v in views.values())]))
        whole = slice(None)  # of what has all of these: an index would copy
        places = {
            code: whole if len(view.rows) == len(rows) else np.searchsorted(rows, view.rows)
            for code, view in views.items()
        }
        by_channel = [
            (n, np.flatnonzero(channel[rows] == n)) for n in np.unique(channel[rows]).tolist()
        ]
        return cls([(n, rows[index], index) for n, index in by_channel], places, len(rows))


@dataclass(frozen=True, eq=False)
class Projection:
    """The rows of a campaign, ready to be asked how a component shows in them."""

    model: CompiledModel
    rows: ObservationRows
    conditions: Conditions
    _views: dict[str, View] = field(default_factory=dict)
    _layouts: dict[frozenset[str], RowsOfChannels] = field(default_factory=dict)
    _maps: dict[str, FloatArray | None] = field(default_factory=dict)

    @cached_property
    def _rows_of_channels(self) -> list[IntArray]:
        return [np.flatnonzero(self.rows.channel == n) for n in range(len(self.rows.channels))]

    def view(self, code: str) -> View:
        """Find the rows in which a component shows, or those of a direction at points.

        Computed once for each.
        """
        if code not in self._views:
            self._views[code] = self._make_view(code)
        return self._views[code]

    def errors(self, term: Term, valid: Valid | None = None) -> tuple[View, FloatArray]:
        """Evaluate a term where it shows.

        Parameters
        ----------
        valid
            The effect's ranges, outside which it is held (`Term.at`).

        Returns
        -------
        view, errors : View, and ndarray of shape (m,)
            In the rows' unit: µm for points.
        """
        view = self.view(term.component)
        reading = term.reading(self.model, view.conditions, valid)
        if reading is not None:
            return view, view.gains * self.of_maps(term.component, reading.weights)
        return view, view.gains * term.at(self.model, view.places, view.conditions, valid)

    def of_maps(self, code: str, weights: FloatArray) -> FloatArray:
        """Add up the maps of a component that has some, where it shows.

        Parameters
        ----------
        weights : ndarray, shape (m, M)
            How much of each map in each of the m rows of its view.

        Returns
        -------
        ndarray, shape (m,) [the component's unit]
            As `read_maps`.
        """
        located, places = self.model.find(code), self.view(code).places
        if located is None:
            raise KeyError(code)
        if code not in self._maps:
            self._maps[code] = maps_at_places(*located, *places)
        at_maps = self._maps[code]
        if at_maps is None:
            return read_maps(*located, weights, *places)
        return np.asarray(np.einsum("nm,nm->n", weights, at_maps))

    @cached_property
    def predicted(self) -> FloatArray:
        """What all maps say of each row by the assigned sensors, shape (n,) [the rows' units]."""
        return self.predicted_by()

    def predicted_by(
        self, codes: Collection[str] | None = None, label: str | None = None
    ) -> FloatArray:
        """Give what maps say of each row by the assigned sensors.

        Parameters
        ----------
        codes
            Components whose tables count; None: all.
        label
            The only map that counts; None: all.

        Returns
        -------
        ndarray, shape (n,) [the rows' units]
        """
        total = np.zeros(len(self.rows))
        for group in self.model.groups:
            counts = np.array([label in (None, map_label) for map_label in group.labels])
            counted_codes = [code for code in group.codes if codes is None or code in codes]
            if not counted_codes or not counts.any():
                continue
            scale, now_c = group.scales[0], self.conditions.temperature(group.sensor)
            weights = weights_of(scale, self.model.brackets(group, scale, now_c)) * counts
            for code in counted_codes:
                view = self.view(code)
                total[view.rows] += view.gains * self.of_maps(code, weights[view.rows])
        return total

    def columns(
        self, amplitudes: Sequence[Sequence[Term]], valid: Valid | None = None
    ) -> FloatArray:
        """Lay the unit errors of amplitudes out over all rows.

        Parameters
        ----------
        amplitudes
            For each of k amplitudes the terms that it scales together.

        Returns
        -------
        ndarray, shape (n, k)
            NaN where a condition is missing.
        """
        matrix = np.zeros((len(self.rows), len(amplitudes)))
        for j, terms in enumerate(amplitudes):
            for term in terms:
                view, errors = self.errors(term, valid)
                matrix[view.rows, j] += errors
        return matrix

    def parts(self, amplitudes: Sequence[Sequence[Term]]) -> list[Part]:
        """Take the columns apart by channel, as the search wants them.

        Returns
        -------
        list of Part
            Channels in which nothing shows are left out; rows in which a condition is
            missing count as not moved.
        """
        layout = self._where(frozenset(term.component for terms in amplitudes for term in terms))
        errors = np.zeros((len(amplitudes), layout.count))
        for column, terms in zip(errors, amplitudes, strict=True):
            for term in terms:
                column[layout.places[term.component]] += self.errors(term)[1]
        np.copyto(errors, 0.0, where=np.isnan(errors))
        parts = (
            Part(number, rows, errors.take(at, axis=1).T) for number, rows, at in layout.channels
        )
        return [part for part in parts if part.columns.any()]

    def parts_of(self, columns: FloatArray) -> list[Part]:
        """Take columns over all rows apart by channel; NaN counts as not moved.

        Parameters
        ----------
        columns : ndarray, shape (n, k)
            Of k amplitudes.
        """
        columns = np.where(np.isnan(columns), 0.0, columns)
        parts = (
            Part(number, rows, columns[rows]) for number, rows in enumerate(self._rows_of_channels)
        )
        return [part for part in parts if part.columns.any()]

    def _where(self, codes: frozenset[str]) -> RowsOfChannels:
        """Find the rows in which any of some components shows; computed once for each set."""
        if codes not in self._layouts:
            views = {code: self.view(code) for code in codes}
            self._layouts[codes] = RowsOfChannels.of_views(views, self.rows.channel)
        return self._layouts[codes]

    def _make_view(self, code: str) -> View:
        gains = np.zeros(len(self.rows))
        gains[self.rows.of_channel(code)] = 1.0
        for direction, channel in enumerate(POINT_CHANNELS):
            rows = self.rows.of_channel(channel)
            if rows.size and code not in POINT_CHANNELS:
                gains[rows] = unit_errors(
                    self.model.machine.chain,
                    code,
                    self.rows.points_mm[rows],
                    self.rows.tool_offsets_mm[rows],
                    self.model.measuring_lines,
                )[:, direction]
        shows = np.flatnonzero(gains)
        return View(
            shows,
            tuple(np.unique(self.rows.channel[shows]).tolist()),
            gains[shows],
            places_of(code, self.rows.points_mm[shows], self.rows.directions[shows]),
            self.conditions.take(shows),
        )


def unit_errors(
    chain: Chain,
    code: str,
    points_mm: FloatArray,
    tool_offsets_mm: FloatArray,
    measuring_lines: MeasuringLines,
) -> FloatArray:
    """Say what one unit of a component does at points, by the rule of the volumetric error.

    Parameters
    ----------
    points_mm, tool_offsets_mm : ndarray, shape (n, 3) [mm]

    Returns
    -------
    ndarray, shape (n, 3) [µm for each unit of the component]

    Examples
    --------
    >>> unit_errors(Chain.parse("FXYZ"), "EBX", np.array([[0.0, 0.0, 200.0]]), np.zeros((1, 3)), {})
    array([[0.2, 0. , 0. ]])
    """
    unit = {code: np.ones(len(points_mm))}
    errors, _ = volumetric_error(chain, unit, points_mm, tool_offsets_mm, measuring_lines)
    return errors


def places_of(code: str, points_mm: FloatArray, directions: FloatArray) -> Places:
    """Pick the coordinate and the direction that are a component's argument.

    Parameters
    ----------
    points_mm : ndarray, shape (n, 3) [mm]
    directions : ndarray, shape (n, 3)

    Returns
    -------
    Places
        Without an argument, positions are NaN and directions 0.
    """
    axis = COMPONENTS[code].axis if code in COMPONENTS else None
    if axis is None:
        return Places(np.full(len(points_mm), np.nan), np.zeros(len(points_mm)))
    column = LINEAR_LETTERS.index(axis)
    return Places(points_mm[:, column], directions[:, column])


def sum_of_terms(projection: Projection, terms: Sequence[Term]) -> FloatArray:
    """Add terms up over all rows.

    Returns
    -------
    ndarray, shape (n,)
        NaN where a condition is missing.
    """
    return projection.columns([terms])[:, 0]


def missing_at_points(
    model: CompiledModel, effects: Iterable[Effect], tool_offsets_mm: ArrayLike
) -> list[str]:
    """List the components that the error at points needs and nothing gives.

    Parameters
    ----------
    tool_offsets_mm : array-like, shape (n, 3) [mm]
        Tool offsets: without a lever arm a rotation is not needed.

    Returns
    -------
    list of str
        Codes; at points these components count as zero.
    """
    have = {code for group in model.groups for code in group.codes} | acting_on(effects)
    needed = needed_components(
        model.machine.chain, tool_offsets_mm, model.measuring_lines, orientation=False
    )
    return [code for code in needed if code not in have]
