"""The scene: equal scales, axes with their unit, and a camera that sees all of it."""

from __future__ import annotations

import math
from typing import Any, Final, TypeAlias

import numpy as np

from app.arrays import FloatArray
from app.geometry.components import LINEAR_LETTERS
from app.geometry.work_volume import WorkVolume
from app.pictures.colours import FAINT, INK, QUIET

Json: TypeAlias = dict[str, Any]

TALL: Final = 0.82
"""Half of the picture's height is 1: so much of it the box may take, tick labels stand around."""

WIDE: Final = 1.25
"""The same to each side, in a window that is wider than high."""

WITHOUT_SCALE: Final = 0.9
"""Of the picture's width: the rest is the colour scale's."""

MARGIN: Final = 0.04
"""Around all that is drawn, of its longest side."""

LONG: Final = 1.6
"""A box that is so many times longer than wide is looked at from its long side."""

DISTANCE: Final = 3.0
"""Of the camera: anywhere outside the box, without perspective."""

TICK_SPACING: Final = 0.2
"""Numbers stand at least so far apart where the picture is 2 high."""

NARROW_PX: Final = 560
"""Of a window's width: numbers stand over each other in narrower ones [px]."""

NARROW_SCALE: Final[Json] = {
    "orientation": "h",
    **{"x": 0.5, "xanchor": "center", "y": 1.0, "yanchor": "top"},
    **{"len": 0.9, "thickness": 12, "nticks": 6, "xpad": 0, "ypad": 0},
    **{"title.text": "", "ticksuffix": " µm"},
}
"""The colour scale of a narrow picture: lying above the box, which leaves it this room."""

NARROW_BOX: Final = [0.0, 0.82]
"""Of a narrow picture's height: what is above is the colour scale's."""


def scene(volume: WorkVolume, drawn_mm: FloatArray) -> Json:
    """Lay out the axes and the camera.

    Parameters
    ----------
    drawn_mm : ndarray, shape (n, 3) [mm]
        All points that are drawn.

    Returns
    -------
    dict
        plotly's `scene`. A millimetre is equally long along all axes, and parallels
        stay parallel: squareness is seen as it is. plotly's own way to equal scales,
        `aspectmode: data`, makes a gantry of 30 m longer than its window, so here
        the scale is the one at which everything just fills the picture.
    """
    low, high = drawn_mm.min(axis=0), drawn_mm.max(axis=0)
    pad = MARGIN * float((high - low).max())
    low, high = low - pad, high + pad
    eye, up = _viewpoint(volume)
    sides = (high - low) * _scale(high - low, eye, up)
    axes = {
        f"{letter}axis": _axis(volume, i, [float(low[i]), float(high[i])], float(sides[i]), up)
        for i, letter in enumerate(LINEAR_LETTERS)
    }
    return {
        **axes,
        "domain": {"x": [0.0, WITHOUT_SCALE], "y": [0.0, 1.0]},
        "aspectmode": "manual",
        "aspectratio": _xyz(sides),
        "camera": {
            "eye": _xyz(DISTANCE * eye),
            "up": _xyz(up),
            "center": _xyz(np.zeros(3)),
            "projection": {"type": "orthographic"},
        },
        "dragmode": "orbit",
    }


def narrow_scene(volume: WorkVolume, wide: Json) -> Json:
    """What changes in a scene where its window is too narrow for an axis' numbers.

    Letters do not become smaller with the window, and would stand over each other: each axis keeps
    one label, at its far end, with both of its ends. The colour scale lies above the box, out of
    its way and as wide as the picture.

    Returns
    -------
    dict
        Changes of a layout by their path, as plotly's `relayout` takes them.
    """
    changes: Json = {
        "scene.domain.x": [0.0, 1.0],
        "scene.domain.y": NARROW_BOX,
        **{f"coloraxis.colorbar.{name}": value for name, value in NARROW_SCALE.items()},
    }
    for letter, (low, high) in zip(LINEAR_LETTERS, volume.ranges_mm, strict=True):
        ticks = wide[f"{letter}axis"].get("tickvals")
        if ticks:
            words = f"<b>{letter.upper()}</b> {_number(low)}…{_number(high)} mm"
            changes[f"scene.{letter}axis.ticktext"] = [*[""] * (len(ticks) - 1), words]
    return changes


def _xyz(vector: FloatArray) -> Json:
    return dict(zip(LINEAR_LETTERS, vector.tolist(), strict=True))


def _viewpoint(volume: WorkVolume) -> tuple[FloatArray, FloatArray]:
    """Where the viewer stands and what is up, both of length 1."""
    right, up, front = _directions(volume)
    rightward, forward, upward = _toward(volume)
    eye = rightward * right + forward * front + upward * up
    return eye / np.linalg.norm(eye), up


def _scale(lengths_mm: FloatArray, eye: FloatArray, up: FloatArray) -> float:
    """Find how long a millimetre is drawn so that the box fills the picture."""
    across, upward = _picture_axes(eye, up)
    wide = float(np.abs(across) @ lengths_mm) / 2
    tall = float(np.abs(upward) @ lengths_mm) / 2
    return min(WIDE / wide, TALL / tall)


def _picture_axes(eye: FloatArray, up: FloatArray) -> tuple[FloatArray, FloatArray]:
    """What is rightward and what upward in the picture."""
    across = np.cross(up, eye)
    across /= np.linalg.norm(across)
    return across, np.cross(eye, across)


def _directions(volume: WorkVolume) -> FloatArray:
    """Which axes point right, up and to the viewer: as one stands before the machine.

    With a missing axis the other two lie in the picture. Z points up unless it is the
    missing one or by far the longest: then it is a lathe's, and points to the right.
    """
    x, y, z = np.eye(3)
    lengths = [high - low for low, high in volume.ranges_mm]
    if lengths[2] == 0:
        return np.array([x, y, z])
    if lengths[1] == 0 or lengths[2] > LONG * max(lengths[:2]):
        return np.array([z, x, y])
    if lengths[0] == 0 or lengths[1] > LONG * lengths[0]:
        return np.array([y, z, x])
    return np.array([x, z, -y])


def _toward(volume: WorkVolume) -> tuple[float, float, float]:
    """Where the viewer stands, to the right, in front and above."""
    lengths = sorted(high - low for low, high in volume.ranges_mm)
    if lengths[0] == 0:
        return (0.05, 1.0, 0.08)
    if lengths[2] > LONG * lengths[1]:
        return (0.35, 1.0, 0.45)
    return (0.62, 1.0, 0.55)


def _axis(volume: WorkVolume, i: int, shown_mm: list[float], side: float, up: FloatArray) -> Json:
    low, high = volume.ranges_mm[i]
    if low == high:
        return {"visible": False, "range": shown_mm}
    ticks = _ticks(low, high, int(side / TICK_SPACING))
    return {
        # Without perspective plotly writes an axis' title over its numbers, so the
        # last number says which axis it is, and the unit.
        "title": {"text": ""},
        "range": shown_mm,
        "tickmode": "array",
        "tickvals": ticks,
        "ticktext": _tick_words(LINEAR_LETTERS[i], ticks, is_upright=bool(up[i])),
        "tickangle": 0,
        "tickfont": {"size": 13, "color": INK},
        "ticks": "outside",
        "tickcolor": QUIET,
        "showbackground": False,
        "gridcolor": FAINT,
        "showline": True,
        "linecolor": QUIET,
        "zeroline": False,
        "showspikes": False,
    }


def _tick_words(letter: str, ticks: list[float], *, is_upright: bool) -> list[str]:
    """Numbers, the last with axis and unit: beside one so long, the one before has no room."""
    words = [_number(tick) for tick in ticks]
    words[-1] = f"<b>{letter.upper()}</b> {words[-1]} mm"
    if len(words) > 2 and not is_upright:
        words[-2] = ""
    return words


def _number(tick: float) -> str:
    return f"{tick:.10g}".replace("-", "−")


def _ticks(low: float, high: float, most: int) -> list[float]:
    """Round positions, at most so many intervals; of a short axis its ends, or one."""
    if most < 2:
        return [low, high][-1 - most :]
    least = (high - low) / most
    power = 10.0 ** math.floor(math.log10(least))
    step = next(power * digit for digit in (1, 2, 5, 10) if power * digit >= least * (1 - 1e-9))
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    ticks = [float(f"{n * step:.12g}") for n in range(first, last + 1)]
    return ticks if len(ticks) > 1 else [low, high]
