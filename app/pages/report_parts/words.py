"""Numbers, times and sentences as a report writes them."""

from __future__ import annotations

import html
import math
import re
from collections.abc import Iterable
from typing import Final

from app.pages.dashboard.numbers import marked
from app.units import true_minus

MOST_DECIMALS: Final = 4

ORIGINS: Final = {
    "declared": "what the verifications state, adjusted where the residuals say otherwise",
    "common": "what nearly all lengths show within their set-ups, which contradicts what the "
    "verifications state",
    "replicates": "from repeats at the same place in the same visit",
    "residuals": "from the residuals within each visit",
    "rounding": "from the steps in which the instrument reads",
}
"""Where the scatter of one observation comes from."""

_NEGATIVE: Final = re.compile(r"(?<![\w.)])-(?=\d)")


def escaped(text: object) -> str:
    """Write any text so that plotly, which reads some markup, shows it letter by letter.

    Examples
    --------
    >>> escaped("<b>night & day</b>")
    '&lt;b&gt;night &amp; day&lt;/b&gt;'
    """
    return html.escape(str(text))


def sentence(text: str) -> str:
    """Write one of the analysis' sentences, negative numbers with a true minus.

    Examples
    --------
    >>> sentence("z-column 2 falls by -3.7 µm")
    'z-column 2 falls by −3.7 µm'
    """
    return _NEGATIVE.sub("−", text)


ZEROS: Final = {
    "absolute": "Figures count from the model's own zero.",
    "first": "Figures count from each set-up's first observation, at which the instrument was "
    "zeroed.",
    "removed": "Where the zero is not known, the mean of the values that share it is taken off.",
}


def zeros_text(found: Iterable[str | None]) -> str:
    """Say what figures are relative to, each once; of older results nothing is known.

    >>> zeros_text(["first", "first", None])
    "Figures count from each set-up's first observation, at which the instrument was zeroed."
    """
    occurring = set(found)
    return " ".join(words for zero, words in ZEROS.items() if zero in occurring)


def origins_text(found: Iterable[str]) -> str:
    """Explain where the scatter of one observation comes from, as far as it occurs.

    Examples
    --------
    >>> origins_text(["residuals", "residuals"])
    'Scatter of one observation – residuals: from the residuals within each visit.'
    """
    occurring = set(found)
    origins = [f"{origin}: {words}" for origin, words in ORIGINS.items() if origin in occurring]
    return f"Scatter of one observation – {'; '.join(origins)}."


def decimals_for(noise: float | None) -> int:
    """Choose how many decimals say something beside a scatter: its third digit or so.

    Parameters
    ----------
    noise
        Standard deviation of one observation [any unit]; None where it is not known.

    Returns
    -------
    int
        0 to 4.

    Examples
    --------
    >>> decimals_for(0.9), decimals_for(0.06), decimals_for(340.0), decimals_for(None)
    (2, 3, 0, 2)
    """
    if noise is None or not noise > 0:
        return 2
    return min(max(2 - round(math.log10(noise)), 0), MOST_DECIMALS)


def figure_text(value: float | None, decimals: int) -> str:
    """Write a figure with a true minus; a dash where there is none.

    Examples
    --------
    >>> figure_text(-1.456, 2), figure_text(-0.001, 2), figure_text(None, 2)
    ('−1.46', '0.00', '–')
    """
    if value is None:
        return "–"
    return marked(true_minus(f"{round(value, decimals) + 0.0:.{decimals}f}"))


def chance_text(probability: float) -> str:
    """Write a probability as far as it means something.

    Parameters
    ----------
    probability
        From 0 to 1.

    Examples
    --------
    >>> chance_text(0.3412), chance_text(0.0042), chance_text(3e-80), chance_text(1.0)
    ('34 %', '0.42 %', 'below 0.01 %', '100 %')
    """
    percent = 100.0 * probability
    if percent < 0.01:
        return "below 0.01 %"
    return marked(f"{percent:.2g} %") if percent < 99.5 else "100 %"


def percent_text(share: float) -> str:
    r"""Write a share in per cent, on one line.

    Parameters
    ----------
    share
        From 0 to 1.

    Examples
    --------
    >>> percent_text(0.5)
    '50\xa0%'
    """
    return f"{share:.0%}".replace("%", "\xa0%")
