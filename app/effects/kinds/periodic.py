"""A periodic error over position: screw, encoder, gear."""

from __future__ import annotations

from functools import partial
from typing import Final

import numpy as np

from app.arrays import FloatArray
from app.effects.campaign_view import CampaignView
from app.effects.driver import Always
from app.effects.effect import Effect
from app.effects.hypothesis import (
    Amplitude,
    Amplitudes,
    Estimate,
    Hypothesis,
    Nonlinear,
    Reported,
    reported_theta,
)
from app.effects.kind import EffectKind, Proposed
from app.effects.shape import Wave
from app.effects.term import Term
from app.effects.words import parameter, symbol_of
from app.geometry.components import COMPONENTS

SHORTEST_MM: Final = 2.0
"""Shorter pitches are an encoder's own: they are tried where positions lie close enough."""

POSITIONS_A_PITCH: Final = 4.0
"""So many positions must fall into a pitch that is shorter."""

PERIODS_SEEN: Final = 2.0
"""So many pitches must fit into the positions' span: a longer one is a profile."""

OVERSAMPLED: Final = 2.0
"""Frequencies to the width of a peak, 1 / span."""

MOST_PITCHES: Final = 300
FEWEST_POSITIONS: Final = 12
STEP_DIGITS: Final = 3
"""Positions are told apart to a micrometre."""


class Periodic(EffectKind):
    """A sine over position of unknown pitch; its harmonics are found as further sines."""

    kind = "periodic"
    text = "a sine over position with unknown pitch, and its harmonics"
    alternates = True
    drawn_over = "position"
    of_the_type = True
    shown_by = "measure {component} at 50 or more randomly spaced positions over some 100 mm"
    against = {
        "periodic": "measure {component} every 0.5 mm over 40 mm: both pitches show at once",
    }

    def propose(self, view: CampaignView) -> Proposed:
        """Every translation over its own axis, if the positions can show a pitch."""
        for code in view.tables:
            if COMPONENTS[code].is_rotation:
                continue
            positions = view.projection.view(code).places.positions_mm
            if reason := why_no_pitch(positions):
                yield self.refuse(code, reason)
            else:
                yield _hypothesis(code, pitches(positions))

    def explain(self, effect: Effect) -> str:
        """Say what swings with which pitch, and how far."""
        code = effect.components[0]
        swing = parameter(effect, f"amplitude_{COMPONENTS[code].unit}", symbol_of(code))
        return (
            f"{code} varies as a sine over position, with an amplitude of {swing} and a pitch of "
            f"{parameter(effect, 'pitch_mm')}"
        )


def pitches(positions_mm: FloatArray) -> tuple[float, ...]:
    """Choose pitches so close that the best cannot hide between two of them.

    Parameters
    ----------
    positions_mm : ndarray, shape (n,) [mm]
        Where the axis was observed; their span is above 0.

    Returns
    -------
    tuple of float [mm]
        Increasing: even steps of frequency, half the width of a peak each.

    Examples
    --------
    >>> found = pitches(np.array([0.0, 37.0, 100.0]))
    >>> len(found), round(found[0], 2), found[-1]
    (97, 2.0, 50.0)
    >>> round(pitches(np.arange(0.0, 5.0, 0.05))[0], 2)
    0.2
    """
    span = float(np.ptp(positions_mm))
    step = 1.0 / (OVERSAMPLED * span)
    lowest = PERIODS_SEEN / span
    count = int((1.0 / _shortest_mm(positions_mm) - lowest) / step) + 1
    frequencies = lowest + step * np.arange(min(max(count, 1), MOST_PITCHES))
    return tuple((1.0 / frequencies[::-1]).tolist())


def why_no_pitch(positions_mm: FloatArray) -> str:
    """Say why positions cannot show a pitch, empty where they can.

    Parameters
    ----------
    positions_mm : ndarray, shape (n,) [mm]
        Where the axis was observed.

    Examples
    --------
    >>> why_no_pitch(np.arange(0.0, 501.0, 25.0)).partition(":")[0]
    'all positions are multiples of one step of 25 mm'
    """
    distinct = np.unique(np.round(positions_mm, STEP_DIGITS))
    if distinct.size < FEWEST_POSITIONS:
        return f"needs at least {FEWEST_POSITIONS} different positions, got {distinct.size}"
    step = common_step(distinct)
    shortest = pitches(distinct)[0]
    if 2.0 * step <= shortest:
        return ""
    hidden = [step / k for k in range(1, 4)]
    example = 3.0 * step
    same = ", ".join(f"{pitch:.3g}" for pitch in aliases(example, step))
    return (
        f"all positions are multiples of one step of {step:g} mm: pitches of "
        f"{', '.join(f'{p:.3g}' for p in hidden)} mm … look constant, and one of {example:.3g} mm "
        f"looks the same as {same} mm … (measure at randomly spaced positions)"
    )


def common_step(positions_mm: FloatArray) -> float:
    """Find the largest step of which all distances are multiples [mm].

    Parameters
    ----------
    positions_mm : ndarray, shape (n,) [mm]
        At least two different positions, told apart to a micrometre.

    Examples
    --------
    >>> common_step(np.array([12.5, 37.5, 112.5])), common_step(np.array([0.0, 10.0, 13.37]))
    (25.0, 0.01)
    """
    scale = 10.0**STEP_DIGITS
    whole = np.round((positions_mm - positions_mm.min()) * scale).astype(np.int64)
    return float(np.gcd.reduce(whole)) / scale


def aliases(pitch_mm: float, step_mm: float, count: int = 4) -> list[float]:
    """List pitches that look the same at multiples of one step [mm].

    Examples
    --------
    >>> [round(p, 2) for p in aliases(75.0, 25.0, 2)]
    [37.5, 18.75]
    """
    beats = [k / step_mm + sign / pitch_mm for k in (1, 2, 3, 4) for sign in (-1, 1)]
    return [1.0 / f for f in beats if f > 0][:count]


def _shortest_mm(positions_mm: FloatArray) -> float:
    """Say which pitch is the shortest that these positions can follow [mm]."""
    distinct = np.unique(np.round(positions_mm, STEP_DIGITS))
    return min(SHORTEST_MM, POSITIONS_A_PITCH * float(np.median(np.diff(distinct))))


def _hypothesis(code: str, grid: tuple[float, ...]) -> Hypothesis:
    unit = COMPONENTS[code].unit
    nonlinear = Nonlinear("pitch_mm", 1.0, grid, (grid[0], grid[-1]), log_scale=True)
    return Hypothesis(
        kind=Periodic.kind,
        components=(code,),
        unit_terms=partial(_terms, code),
        amplitudes=(Amplitude(f"sine_{unit}"), Amplitude(f"cosine_{unit}")),
        nonlinear=nonlinear,
        within_visit=True,
        report=partial(_report, nonlinear, f"amplitude_{unit}"),
    )


def _terms(code: str, theta: float | None) -> Amplitudes:
    pitch = float(theta or np.inf)
    return [[Term(code, Always(), Wave(pitch, is_cosine))] for is_cosine in (False, True)]


def _report(nonlinear: Nonlinear, name: str, estimate: Estimate) -> Reported:
    """Turn sine and cosine into amplitude and phase (GUM: J C Jᵀ)."""
    reported = reported_theta(nonlinear, estimate)
    sine, cosine = estimate.coefficients
    amplitude = float(np.hypot(sine, cosine))
    if amplitude == 0.0:
        jacobian = np.eye(2)
    else:
        across = np.array([-cosine, sine]) / amplitude**2
        jacobian = np.array([np.array([sine, cosine]) / amplitude, np.rad2deg(across)])
    errors = np.sqrt(np.diag(jacobian @ estimate.covariance @ jacobian.T))
    reported.parameters[name] = amplitude
    reported.parameters["phase_deg"] = float(np.rad2deg(np.arctan2(cosine, sine)))
    reported.standard_errors[name] = float(errors[0])
    reported.standard_errors["phase_deg"] = float(errors[1])
    return reported
