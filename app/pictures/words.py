"""What the picture says in words."""

from __future__ import annotations

import html
import textwrap

from app.arrays import FloatArray
from app.geometry.components import LINEAR_LETTERS
from app.pictures.distorted_volume import DistortedVolume
from app.pictures.traces import Rounding
from app.units import true_minus


def drawn_sentence(distorted: DistortedVolume, rounding: Rounding) -> str:
    """Say what is drawn: the factor, and the largest error."""
    if not distorted.has_errors:
        return "No errors in this work volume (factor 1): the nominal box is the real one."
    errors_um = distorted.worst.errors_um[0]
    each = ", ".join(
        f"e{letter} {_signed(error, rounding.shown_um)}"
        for letter, error in zip(LINEAR_LETTERS, errors_um, strict=True)
    )
    return (
        f"Errors (actual minus nominal) drawn {_factor_words(distorted.exaggeration)}. "
        f"Largest error {largest_words(distorted, rounding)} at "
        f"{place_words(distorted.worst_point_mm)} ({each} µm)."
    )


def largest_words(distorted: DistortedVolume, rounding: Rounding) -> str:
    """Write the largest error's length with its unit.

    Returns
    -------
    str
        Such as `43.2 µm`.
    """
    return f"{distorted.largest_um:.{rounding.shown_um}f} µm"


def place_words(point_mm: FloatArray) -> str:
    """Write a point with its unit.

    Parameters
    ----------
    point_mm : ndarray, shape (3,) [mm]
        Nominal position.

    Examples
    --------
    >>> import numpy as np
    >>> place_words(np.array([500.0, -12.5, 0.0]))
    'X 500, Y −12.5, Z 0 mm'
    """
    places = zip(LINEAR_LETTERS.upper(), point_mm, strict=True)
    return ", ".join(f"{a} {true_minus(f'{place:.7g}')}" for a, place in places) + " mm"


def wrapped(text: str, letters: int) -> list[str]:
    """Break a user's text into lines that plotly shows letter by letter.

    Returns
    -------
    list of str
        Lines with plotly's markup made ineffective; none where there is no text.

    Examples
    --------
    >>> wrapped("two <b>lines</b>", 12)
    ['two', '&lt;b&gt;lines&lt;/b&gt;']
    """
    return [html.escape(line, quote=False) for line in textwrap.wrap(text, letters)]


def _factor_words(exaggeration: float) -> str:
    if exaggeration == 1:
        return "as large as they are"
    if exaggeration < 1:
        return f"{1 / exaggeration:.6g} times smaller"
    return f"{exaggeration:.12g} times larger"


def _signed(error: float, decimals: int) -> str:
    # Rounded first: −0.04 is no −0.0.
    return true_minus(f"{round(error, decimals) + 0.0:+.{decimals}f}")
