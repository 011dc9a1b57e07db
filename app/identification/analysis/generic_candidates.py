"""Smooth shapes without a physical meaning: they say what something unexplained moves with.

A generic candidate is never found as an effect. It only tells that structure is left, and over
which quantity a person should look at it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final

import numpy as np

from app.arrays import FloatArray, IntArray
from app.effects.campaign_view import CampaignView
from app.effects.observations import POINT_CHANNELS
from app.search.candidate import Candidate, Part

RANGE_WAVES: Final = 3
"""Cosines over the range of a quantity: half a period, one, one and a half."""

FEWEST_FOR_SHAPES: Final = 24
"""A channel with fewer rows gets none."""

CROSSED_WITH: Final = " and the position"


def generic_candidates(view: CampaignView) -> list[Candidate]:
    """List smooth functions of everything that was recorded, for each channel.

    Returns
    -------
    list of Candidate
        Generic ones; their keys end in what they move with, in words (`words_of`).
    """
    candidates = []
    for number, channel in enumerate(view.rows.channels):
        rows = view.rows.of_channel(channel)
        if len(rows) < FEWEST_FOR_SHAPES:
            continue
        for words, columns in _shapes(view, rows, channel in POINT_CHANNELS):
            candidates.append(
                Candidate.of_parts(
                    f"{channel}: {words}",
                    "generic",
                    [Part(number, rows, columns)],
                    generic=True,
                    within_visit=True,
                )
            )
    return candidates


def words_of(key: str) -> str:
    """Say what a generic candidate moves with.

    >>> words_of("EXX: the rate of z-column")
    'the rate of z-column'
    """
    return key.partition(": ")[2]


def _shapes(
    view: CampaignView, rows: IntArray, at_points: bool
) -> Iterator[tuple[str, FloatArray]]:
    """Give words and columns, shape (m, k), for one channel."""
    places = {
        f"the position of {axis.upper()}": _scaled(view.rows.points_mm[rows, i])
        for i, axis in enumerate("xyz")
        if _varies(view.rows.points_mm[rows, i])
    }
    for words, values in _slow(view, rows).items():
        if _varies(values):
            waves = _cosines(values)
            yield words, waves
            if not at_points:
                for place in places.values():
                    yield words + CROSSED_WITH, waves * place[:, None]
    for words, place in places.items():
        yield words, np.column_stack([_cosines(place), np.cos(4.0 * np.pi * place)])
    yield from _of_directions(view, rows, places)
    if at_points:
        yield from _of_points(view, rows, places)


def _slow(view: CampaignView, rows: IntArray) -> Mapping[str, FloatArray]:
    """Everything that changes with time rather than with the place."""
    conditions = view.conditions
    quantities = {"time": conditions.times_s[rows]}
    for sensor in view.varying_sensors:
        quantities[f"the temperature of {sensor}"] = conditions.temperature(sensor)[rows]
        rates = conditions.rates_c_per_h.get(sensor)
        if rates is not None:
            quantities[f"the rate of {sensor}"] = rates[rows]
    for state in view.varying_states:
        quantities[state] = conditions.state(state)[rows]
    return quantities


def _of_directions(
    view: CampaignView, rows: IntArray, places: Mapping[str, FloatArray]
) -> Iterator[tuple[str, FloatArray]]:
    for i, axis in enumerate("xyz"):
        signs = np.sign(view.rows.directions[rows, i])
        place = places.get(f"the position of {axis.upper()}")
        if place is not None and (signs > 0).any() and (signs < 0).any():
            yield (
                f"the direction of {axis.upper()}{CROSSED_WITH}",
                signs[:, None] * np.column_stack([np.ones(len(rows)), place, place**2]),
            )


def _of_points(
    view: CampaignView, rows: IntArray, places: Mapping[str, FloatArray]
) -> Iterator[tuple[str, FloatArray]]:
    """Products of coordinates, and the tool."""
    names = list(places)
    for i, first in enumerate(names):
        for second in names[i + 1 :]:
            product = (places[first] - 0.5) * (places[second] - 0.5)
            yield f"{first} times {second}", product[:, None]
    for i, axis in enumerate("xyz"):
        tool = view.rows.tool_offsets_mm[rows, i]
        if _varies(tool):
            yield f"the tool offset in {axis.upper()}", _scaled(tool)[:, None]


def _varies(values: FloatArray) -> bool:
    finite = values[~np.isnan(values)]
    return finite.size >= FEWEST_FOR_SHAPES and float(np.ptp(finite)) > 0.0


def _scaled(values: FloatArray) -> FloatArray:
    """Count from 0 to 1 over the range."""
    low, high = np.nanmin(values), np.nanmax(values)
    scaled: FloatArray = (values - low) / (high - low) if high > low else np.zeros(values.shape)
    return scaled


def _cosines(values: FloatArray) -> FloatArray:
    """Give cosines over the quantity's range, shape (m, 3); zero where it is not known."""
    angle = np.pi * _scaled(values)
    waves = np.column_stack([np.cos(k * angle) for k in range(1, RANGE_WAVES + 1)])
    cosines: FloatArray = np.nan_to_num(waves, nan=0.0)
    return cosines
