"""Lengths on all axes grow alike with one temperature: the instrument, not the machine.

A laser counts wavelengths, and in air these are longer by 0.93 µm/m for each kelvin: lengths that
are not corrected for it come out shorter by as much (B. Edlén, Metrologia 2 (1966) 71; 20 °C,
1013 hPa). Lengths that are referred to 20 °C by a material's temperature that was entered once,
or of a sensor that is off, are wrong by that material's expansion: 11.7 µm/(m K) of steel.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np

from app.arrays import FloatArray, IntArray
from app.effects.campaign_view import CampaignView
from app.effects.driver import BeyondMaps
from app.effects.effect import Effect
from app.effects.hypothesis import Amplitude, Hypothesis, Nonlinear
from app.effects.kind import EffectKind, Need, Proposed, constant_sensors
from app.effects.observations import POINT_CHANNELS
from app.effects.projection import Projection
from app.effects.words import TWO_ERRORS, parameter
from app.errors import list_names
from app.geometry.components import COMPONENTS, LINEAR_LETTERS, Kind
from app.search.candidate import Expected
from app.units import um_from_urad_mm

OF_AIR: Final = -0.93
OF_STEEL: Final = 11.7
"""What lengths grow by without air compensation, and without a steel's [µm/(m K)]."""

AIR_OR_STEEL: Final = Expected((OF_AIR, OF_STEEL, -OF_STEEL), 0.1)
"""On one axis alone its size is all that tells it; 0.1 is what steels, and the air at a sensor
and on the laser's way, differ by."""

FEWEST_AXES: Final = 2
"""Of several axes so many must show it, or nothing says that they are alike."""

ASSUMED_C: Final = tuple(np.arange(12.5, 32.6, 2.5).tolist())
"""Temperatures that an instrument may count on."""

LEAST_C, MOST_C = 0.0, 50.0

LENGTH: Final = "length_um_per_m_per_k"
UNIT: Final = "µm/(m K)"
ASSUMED: Final = "assumed_c"
BEYOND: Final = "beyond the maps"
"""The maps were measured with the same mistake, and contain what it was then."""

AT_POINTS, EVERYWHERE = "at points", "along lines and at points"
"""What one instrument measured, where that is not lines alone."""


class InstrumentCompensation(EffectKind):
    """Measured minus predicted is c · (T − T_assumed) · length, with one c for all axes.

    A length counts from the axis' zero, or from that end of the travel that is nearest to it. Of
    an instrument that measures lines, points, or both. A machine whose scales all expand alike
    with one temperature looks the same, so its name is never sure. On one axis alone nothing but
    its size tells it from the machine: then it is what air or steel would do, or nothing.
    """

    kind = "instrument-compensation"
    text = (
        "lengths on all axes grow alike with one temperature, as with an instrument that does "
        "not correct them for the air or the material"
    )
    needs = Need.MOMENTS
    only_once = True
    never_sure = (
        "it may come from the instrument rather than the machine: an instrument that corrects "
        "its lengths wrongly for the air or the material shows exactly this"
    )
    shown_by = (
        "measure {component} at two temperatures of {sensor} with another instrument, or against "
        "a gauge block or step gauge of known expansion: an error of the machine shows again; "
        "also warm one axis alone: its own scale grows with its own temperature, but an "
        "instrument's lengths keep growing with {sensor}"
    )
    against = {
        "instrument-compensation": (
            "create a temperature difference between {sensor} and {rival}, and measure "
            "{component} in that state"
        )
    }
    not_adopted = (
        "the instrument may show it as well as the machine, and nothing of the instrument may "
        "come into the tables: a machine's scales have temperatures of their own and hardly all "
        "expand alike with one, and the air of a laser's path does not reach a machined part"
    )

    def propose(self, view: CampaignView) -> Proposed:
        """Every sensor, with what one instrument may have measured: lines, points, or both."""
        yield from constant_sensors(self, view)
        measured = list(_measured_together(view))
        if not measured:
            reason = "needs positioning errors at two or more positions, or observations at points"
            yield self.refuse("lengths", reason)
        for channels in measured:
            for sensor in view.varying_sensors:
                yield from _hypotheses(view, channels, sensor)

    def explain(self, effect: Effect) -> str:
        """Say what grows with what, by how much, and what would do so."""
        what = list_names(effect.components, 3)
        grow = "change by" if len(effect.components) == 1 else "all change alike, by"
        assumed = ""
        if ASSUMED in effect.parameters:
            assumed = f" (zero at {parameter(effect, ASSUMED, '°C')})"
        return (
            f"the lengths of {what} {grow} {parameter(effect, LENGTH, UNIT)} with "
            f"{effect.sensors[0]}{assumed}, {_cause(effect)}"
        )

    def what_to_do(self, effect: Effect) -> str:
        """Say what to switch on, and how to find out."""
        return (
            "Look at the instrument first: is the laser's weather station on (air temperature, "
            "pressure, humidity), and is the material sensor on the measured axis, with the "
            "right expansion coefficient? If not, switch them on and measure again. If they were "
            "on, measure one of the axes with another instrument, or against a gauge block or "
            f"step gauge, at two temperatures of {effect.sensors[0]}."
        )


def _cause(effect: Effect) -> str:
    """Say what has such a size."""
    size, error = effect.parameters[LENGTH], effect.standard_errors.get(LENGTH, 0.0)

    def is_about(value: float) -> bool:
        return abs(size - value) <= math.hypot(TWO_ERRORS * error, AIR_OR_STEEL.spread * value)

    machine = "or with a machine whose scales all expand alike with it"
    if is_about(OF_AIR):
        return f"as with a laser that is not corrected for air temperature, {machine}"
    if is_about(OF_STEEL) or is_about(-OF_STEEL):
        return f"as with an instrument that is not told the temperature of the steel, {machine}"
    return f"as with an instrument that corrects lengths wrongly for it, {machine}"


def _measured_together(view: CampaignView) -> Iterator[tuple[str, ...]]:
    """List the channels in which one instrument may have read lengths."""
    lines = tuple(code for code in view.rows.components if _is_length(view, code))
    points = tuple(name for name in POINT_CHANNELS if name in view.rows.channels_left)
    if lines:
        yield lines
    if points:
        yield points
    if lines and points:
        yield (*lines, *points)


def _is_length(view: CampaignView, code: str) -> bool:
    """Whether a component is a positioning error that was observed at several positions."""
    if COMPONENTS[code].kind is not Kind.LINEAR or code not in view.components:
        return False
    rows = view.rows.of_channel(code)
    along = view.rows.points_mm[rows, LINEAR_LETTERS.index(str(COMPONENTS[code].axis))]
    return bool(np.ptp(along) > 0.0)


def _hypotheses(view: CampaignView, channels: tuple[str, ...], sensor: str) -> Iterator[Hypothesis]:
    zeros_mm = {channel: _zero_mm(view, channel) for channel in channels}
    hypothesis = Hypothesis(
        kind=InstrumentCompensation.kind,
        variant=_measured(channels),
        components=tuple(dict.fromkeys(_code(channel) for channel in channels)),
        sensors=(sensor,),
        amplitudes=(Amplitude(LENGTH),),
    )
    by_axis = _by_axis(channels)
    yield replace(
        hypothesis,
        nonlinear=Nonlinear(ASSUMED, 1.0, ASSUMED_C, (LEAST_C, MOST_C), log_scale=False),
        supposed=partial(_supposed, zeros_mm, sensor, channels),
        expected=AIR_OR_STEEL if len(by_axis) == 1 else None,
        apart=[partial(_supposed, zeros_mm, sensor, axis_channels) for axis_channels in by_axis],
    )
    beyond = {channel: view.beyond_maps(_code(channel), sensor) for channel in channels}
    drivers = {channel: driver for channel, driver in beyond.items() if driver is not None}
    # What follows this sensor itself has maps that contain all of it: it shows no size.
    remaining = _by_axis(
        [channel for channel in channels if view.sensor_of(_code(channel)) != sensor]
    )
    if len(drivers) < len(channels) or len(remaining) < min(len(by_axis), FEWEST_AXES):
        return
    yield replace(
        hypothesis,
        variant=", ".join(filter(None, (hypothesis.variant, BEYOND))),
        supposed=partial(_beyond_maps, zeros_mm, drivers, channels),
        expected=AIR_OR_STEEL if len(by_axis) == 1 else None,
        apart=[
            partial(_beyond_maps, zeros_mm, drivers, axis_channels) for axis_channels in remaining
        ],
    )


def _measured(channels: Collection[str]) -> str:
    at_points = [channel in POINT_CHANNELS for channel in channels]
    return "" if not any(at_points) else AT_POINTS if all(at_points) else EVERYWHERE


def _by_axis(channels: Collection[str]) -> list[tuple[str, ...]]:
    """Gather the channels that show lengths along each axis."""
    axes = dict.fromkeys(_axis(channel) for channel in channels)
    return [tuple(c for c in channels if _axis(c) == axis) for axis in axes]


def _axis(channel: str) -> str:
    """Name the axis along which a channel shows lengths."""
    return channel[-1].lower()


def _code(channel: str) -> str:
    """Name the positioning error of a channel."""
    axis = _axis(channel).upper()
    return f"E{axis}{axis}"


def _zero_mm(view: CampaignView, channel: str) -> float:
    travel = view.travel(_code(channel))
    return 0.0 if travel is None else float(np.clip(0.0, travel.min_mm, travel.max_mm))


def _lengths(projection: Projection, channel: str, zero_mm: float) -> tuple[IntArray, FloatArray]:
    """Give a channel's rows, and what 1 µm/m does to each of them [µm]."""
    rows = projection.rows.of_channel(channel)
    along = projection.rows.points_mm[rows, LINEAR_LETTERS.index(_axis(channel))]
    return rows, np.asarray(um_from_urad_mm(1.0) * (along - zero_mm))


def _supposed(
    zeros_mm: Mapping[str, float],
    sensor: str,
    channels: Collection[str],
    projection: Projection,
    theta: float | None,
) -> FloatArray:
    above_k = projection.conditions.temperature(sensor) - float(theta or 0.0)
    supposed = np.zeros(len(projection.rows))
    for channel in channels:
        rows, lengths = _lengths(projection, channel, zeros_mm[channel])
        supposed[rows] = above_k[rows] * lengths
    return supposed


def _beyond_maps(
    zeros_mm: Mapping[str, float],
    drivers: Mapping[str, BeyondMaps],
    channels: Collection[str],
    projection: Projection,
    theta: float | None,
) -> FloatArray:
    supposed = np.zeros(len(projection.rows))
    for channel in channels:
        rows, lengths = _lengths(projection, channel, zeros_mm[channel])
        supposed[rows] = drivers[channel].at(projection.conditions)[rows] * lengths
    return supposed
