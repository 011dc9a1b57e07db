"""What the simulated machine's errors really are at any temperature, before any noise.

Each error goes from its cold value (Run #1) to its hot one (Run #6) with the
temperature of the sensor that C. Wang assigns to it (8.2.9), but not linearly:
screws and guideways take the heat of friction first and settle while the
castings, where the sensors sit, go on warming. In terms of a sensor's rise ΔT
that is (1 − e^{−ΔT/θ}), each component with its own θ. The straightness errors
have the extremes of 8.2.8. All other numbers are invented: displacement by the
expansion of the screws, squareness "large" as in 8.2.9, roll, pitch and yaw of the
size that is common on vertical machining centres; the chapter gives no angular errors.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np

from app.arrays import FloatArray
from app.geometry.components import COMPONENTS
from app.simulation.example.machine import POSITIONS, TRAVEL_MM
from app.simulation.example.warm_up import RUNS, run_temperatures
from app.units import MM_PER_M

SCREW_EXPANSION_UM_PER_M_C: Final = 11.0
"""Thermal expansion of a ball screw's steel [µm/(m·°C)]."""

SPINDLE_SHARE: Final = 0.03
"""Share of each change that follows the spindle directly, whatever the assigned sensor says."""

COLD_C: Final = run_temperatures(RUNS[0])
HOT_C: Final = run_temperatures(RUNS[-1])


class _Displacement(NamedTuple):
    """Cold lead error and its wave [µm]; the screw's warming from cold to hot; θ [°C]."""

    lead_um: float
    wave_um: float
    screw_rise_c: float
    settling_c: float


class _Straightness(NamedTuple):
    """Signed extremes cold and hot [µm]; skewness and ripple of the shape; θ [°C]."""

    cold_um: float
    hot_um: float
    skew: float
    ripple: float
    settling_c: float


class _Rotation(NamedTuple):
    """Signed extremes cold and hot [µrad]; bend and ripple of the shape; θ [°C]."""

    cold_urad: float
    hot_urad: float
    bend: float
    ripple: float
    settling_c: float


class _Squareness(NamedTuple):
    """Values cold and hot [µm/m]; θ [°C]."""

    cold_um_per_m: float
    hot_um_per_m: float
    settling_c: float


_DISPLACEMENT: Final = {
    "EXX": _Displacement(lead_um=-6.0, wave_um=1.5, screw_rise_c=5.6, settling_c=4.0),
    "EYY": _Displacement(lead_um=4.0, wave_um=-1.2, screw_rise_c=5.0, settling_c=4.5),
    "EZZ": _Displacement(lead_um=-3.0, wave_um=0.9, screw_rise_c=7.4, settling_c=6.0),
}
_STRAIGHTNESS: Final = {
    "EYX": _Straightness(cold_um=-10.0, hot_um=-7.0, skew=0.3, ripple=0.10, settling_c=5.0),
    "EZX": _Straightness(cold_um=4.0, hot_um=3.2, skew=-0.2, ripple=0.15, settling_c=5.5),
    "EXY": _Straightness(cold_um=-12.0, hot_um=-3.0, skew=-0.4, ripple=0.08, settling_c=4.5),
    "EZY": _Straightness(cold_um=-5.0, hot_um=-4.0, skew=0.1, ripple=-0.12, settling_c=5.5),
    "EXZ": _Straightness(cold_um=9.0, hot_um=3.0, skew=0.5, ripple=-0.08, settling_c=7.0),
    "EYZ": _Straightness(cold_um=17.0, hot_um=13.0, skew=-0.3, ripple=0.05, settling_c=8.0),
}
_SQUARENESS: Final = {
    "SXY": _Squareness(cold_um_per_m=8.0, hot_um_per_m=58.0, settling_c=4.0),
    "SYZ": _Squareness(cold_um_per_m=-22.0, hot_um_per_m=41.0, settling_c=5.5),
    "SZX": _Squareness(cold_um_per_m=15.0, hot_um_per_m=-31.0, settling_c=7.0),
}
_ANGULAR: Final = {
    # Roll, pitch and yaw of x; pitch, roll and yaw of y; z has pitch, yaw and roll.
    "EAX": _Rotation(cold_urad=-10.0, hot_urad=-16.0, bend=0.2, ripple=0.06, settling_c=5.5),
    "EBX": _Rotation(cold_urad=22.0, hot_urad=36.0, bend=-0.3, ripple=-0.04, settling_c=5.0),
    "ECX": _Rotation(cold_urad=12.0, hot_urad=21.0, bend=0.5, ripple=0.05, settling_c=4.5),
    "EAY": _Rotation(cold_urad=-24.0, hot_urad=-38.0, bend=0.3, ripple=0.03, settling_c=5.0),
    "EBY": _Rotation(cold_urad=11.0, hot_urad=17.0, bend=-0.2, ripple=-0.07, settling_c=5.5),
    "ECY": _Rotation(cold_urad=-13.0, hot_urad=-22.0, bend=0.6, ripple=0.04, settling_c=4.0),
    "EAZ": _Rotation(cold_urad=20.0, hot_urad=33.0, bend=-0.4, ripple=0.05, settling_c=7.5),
    "EBZ": _Rotation(cold_urad=-14.0, hot_urad=-24.0, bend=0.1, ripple=-0.06, settling_c=7.0),
    "ECZ": _Rotation(cold_urad=10.0, hot_urad=15.0, bend=0.4, ripple=0.08, settling_c=8.0),
}


def true_errors(temperatures_c: Mapping[str, float]) -> dict[str, FloatArray]:
    """Give all linear, angular and squareness errors in one thermal state, free of noise.

    Parameters
    ----------
    temperatures_c
        Temperatures of x-middle, z-column and spindle [°C].

    Returns
    -------
    dict of component code to ndarray, shape (21,) [µm] or [µrad], or (1,) [µm/m]
        Actual minus nominal at `machine.positions_mm`; displacement and rotation
        count from the start of the travel, straightness from the line through both
        ends. Rotation is positive by the right-hand rule.

    Notes
    -----
    Simulated. Section 8.2.8 gives the extremes of straightness, 8.2.9 the sensors;
    angular errors are invented.

    Examples
    --------
    >>> float(true_errors(COLD_C)["EYX"].min()), float(true_errors(HOT_C)["EYX"].min())
    (-10.0, -7.0)
    """
    along = np.linspace(0.0, 1.0, POSITIONS)
    errors: dict[str, FloatArray] = {}
    for code, d in _DISPLACEMENT.items():
        growth_um = _warming(code, d.settling_c, temperatures_c) * _full_growth_um(code, d)
        lead_um = d.lead_um * along + d.wave_um * np.sin(3.0 * np.pi * along)
        errors[code] = lead_um + growth_um * _growth_shape(along)
    for code, s in _STRAIGHTNESS.items():
        share = _warming(code, s.settling_c, temperatures_c)
        errors[code] = _between(s.cold_um, s.hot_um, share) * _straightness_shape(along, s)
    for code, q in _SQUARENESS.items():
        share = _warming(code, q.settling_c, temperatures_c)
        errors[code] = np.array([_between(q.cold_um_per_m, q.hot_um_per_m, share)])
    for code, r in _ANGULAR.items():
        share = _warming(code, r.settling_c, temperatures_c)
        errors[code] = _between(r.cold_urad, r.hot_urad, share) * _rotation_shape(along, r)
    return errors


def _between(cold: float, hot: float, share: float) -> float:
    return (1.0 - share) * cold + share * hot


def _warming(code: str, settling_c: float, temperatures_c: Mapping[str, float]) -> float:
    """Say how far an error has come from cold (0) to hot (1) by its sensor's rise [°C].

    `settling_c` is θ: 63 % of where the change would end is reached after a rise of θ.
    """
    sensor = str(COMPONENTS[code].default_sensor)
    full_c = HOT_C[sensor] - COLD_C[sensor]
    rise_c = temperatures_c[sensor] - COLD_C[sensor]
    warmed = float(np.expm1(-rise_c / settling_c) / np.expm1(-full_c / settling_c))
    spindle = (temperatures_c["spindle"] - COLD_C["spindle"]) / (
        HOT_C["spindle"] - COLD_C["spindle"]
    )
    return (1.0 - SPINDLE_SHARE) * warmed + SPINDLE_SHARE * spindle


def _full_growth_um(code: str, displacement: _Displacement) -> float:
    """Expansion of the whole screw from cold to hot [µm]."""
    length_m = TRAVEL_MM[str(COMPONENTS[code].axis)] / MM_PER_M
    return SCREW_EXPANSION_UM_PER_M_C * displacement.screw_rise_c * length_m


def _growth_shape(along: FloatArray) -> FloatArray:
    """Share of the expansion up to a point: the screw is warmest where the nut runs most."""
    shape: FloatArray = along - 0.04 * np.sin(2.0 * np.pi * along)
    return shape


def _straightness_shape(along: FloatArray, s: _Straightness) -> FloatArray:
    """A bow that is zero at both ends and +1 where it is greatest."""
    bow = 4.0 * along * (1.0 - along) * (1.0 + s.skew * (2.0 * along - 1.0))
    bow += s.ripple * np.sin(3.0 * np.pi * along)
    bow[-1] = 0.0
    shape: FloatArray = bow / bow[np.abs(bow).argmax()]
    return shape


def _rotation_shape(along: FloatArray, r: _Rotation) -> FloatArray:
    """A turn that is zero at the start and +1 where it is greatest."""
    turn = along + r.bend * along * (1.0 - along) + r.ripple * np.sin(3.0 * np.pi * along)
    shape: FloatArray = turn / turn[np.abs(turn).argmax()]
    return shape
