"""Colours of the pictures: one scale for the length of errors, and greys for all else."""

from __future__ import annotations

from typing import Any, Final

INK: Final = "#1f2933"
"""Text, and what must be seen first."""

QUIET: Final = "#7b8794"
"""Axes, and the nominal box."""

FAINT: Final = "#e4e7eb"
"""Grids."""

WARNING: Final = "#8d4a0b"
"""What is to be said against the errors that are drawn."""

LABEL: Final = "rgba(255, 255, 255, 0.85)"
"""Behind a label that stands before the drawing."""

FONT: Final = "Inter, 'Helvetica Neue', Helvetica, Arial, sans-serif"

LENGTH_SCALE: Final = (
    "#a5db36",
    "#6ece58",
    "#35b779",
    "#1f9e89",
    "#26828e",
    "#31688e",
    "#3e4989",
    "#482878",
    "#440154",
)
"""From no error to the largest: viridis from its green on, so that the lightest colour is
still seen on white paper. Lightness falls evenly: it reads the same in grey, and without
telling red from green."""


def length_axis(largest_um: float, *, with_scale: bool) -> dict[str, Any]:
    """Describe the one colour scale of a picture, from no error to the largest.

    Parameters
    ----------
    largest_um
        Length of the largest error [µm].
    """
    steps = len(LENGTH_SCALE) - 1
    return {
        "colorscale": [[i / steps, colour] for i, colour in enumerate(LENGTH_SCALE)],
        "cmin": 0.0,
        # A scale needs a length even where nothing uses it.
        "cmax": largest_um if with_scale else 1.0,
        "showscale": with_scale,
        "colorbar": {
            "title": {
                "text": "Length of<br>error [µm]<br>&nbsp;",
                "font": {"size": 13, "color": INK},
            },
            "thickness": 16,
            "len": 0.7,
            "x": 1.0,
            "xanchor": "right",
            "xpad": 24,
            "outlinewidth": 0,
            "tickfont": {"size": 12, "color": INK},
            "nticks": 8,
            "exponentformat": "none",
        },
    }
