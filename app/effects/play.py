"""The play operator: how something follows its temperature that sticks until it is pulled along.

A bolted joint holds until the stress of a temperature lets it slip. A play stays where it is while
its input moves within a dead band, and beyond it follows at half the band's width:

    p(t) = min(max(p(t − h), u(t) − r), u(t) + r)

It depends on where the input turned back, and not on how fast it moved. A sum of plays of several
widths is a hysteresis with closed loops (L. Prandtl, Z. Angew. Math. Mech. 8 (1928) 85; M. Brokate,
J. Sprekels, *Hysteresis and Phase Transitions* (1996)).
"""

from __future__ import annotations

import math

import numpy as np

from app.arrays import FloatArray


def play(
    times_s: FloatArray, inputs: FloatArray, half_width: float, max_gap_s: float = math.inf
) -> FloatArray:
    """Follow readings with play.

    Parameters
    ----------
    times_s : ndarray, shape (n,) [s]
        Strictly increasing.
    inputs : ndarray, shape (n,)
    half_width
        r, half the width of the dead band, in the inputs' unit.
    max_gap_s
        Longest gap that is bridged; after a longer one nothing is known of the past [s].

    Returns
    -------
    ndarray, shape (n,)
        NaN until the readings have moved by the whole width of the dead band: from then on it no
        longer matters where in it the play began.

    Examples
    --------
    >>> play(np.arange(6.0), np.array([0.0, 1.0, 3.0, 2.0, 1.5, 0.0]), 1.0).tolist()
    [nan, nan, 2.0, 2.0, 2.0, 1.0]
    """
    output = np.full(inputs.shape, np.nan)
    begins = np.flatnonzero(np.diff(times_s) > max_gap_s) + 1
    for stretch in np.split(np.arange(inputs.size), begins):
        values = inputs[stretch]
        # Wherever it began: a highest input pushes it to u − r or above, a lowest to u + r or
        # below, and where these two meet it has one place left.
        moved = np.maximum.accumulate(values) - np.minimum.accumulate(values)
        has_begun = moved >= 2.0 * half_width
        output[stretch[has_begun]] = _followed(values, half_width)[has_begun]
    return output


def play_at(
    times_s: FloatArray,
    played: FloatArray,
    half_width: float,
    wanted_s: FloatArray,
    wanted: FloatArray,
) -> FloatArray:
    """Give a play between its readings, where its input goes straight from one to the next.

    Parameters
    ----------
    times_s, played : ndarray, shape (n,)
        The readings' times [s], at least one, and the play there (`play`).
    wanted_s, wanted : ndarray, shape (m,)
        When [s], and what the input was then; NaN: not known.

    Returns
    -------
    ndarray, shape (m,)
        NaN where the play or the input is not known.
    """
    before = np.searchsorted(times_s, wanted_s, side="right") - 1
    stayed = np.where(before >= 0, played[np.maximum(before, 0)], np.nan)
    return np.clip(stayed, wanted - half_width, wanted + half_width)


def _followed(inputs: FloatArray, half_width: float) -> FloatArray:
    """Follow readings without a gap, from the middle of the dead band."""
    output = inputs.tolist()
    at = output[0] if output else 0.0
    # One after the other: where a play stands depends on all turning points before.
    for i, value in enumerate(output):
        at = min(max(value - half_width, at), value + half_width)
        output[i] = at
    return np.array(output)
