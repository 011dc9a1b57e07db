"""The page of the work volume: largest error, three slices, corners, what is left, definitions."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from datetime import datetime
from typing import Any, Final
from urllib.parse import urlencode

import numpy as np
from markupsafe import Markup

from app.arrays import FloatArray
from app.geometry.compensation_levels import Level
from app.geometry.components import LINEAR_LETTERS
from app.geometry.work_volume import WorkVolume
from app.pages.dashboard.numbers import NO_BREAK, marked, number, position, signed, temperature
from app.pages.dashboard.pages import group_of
from app.pages.environment import render_machine
from app.pages.reader import reader
from app.pages.wording import _, counted, listed, message
from app.pictures.slices import LINES, Slice
from app.services.volume import PointError, VolumeNow, VolumeView
from app.units import UM_PER_MM

LEVELS: Final = {
    Level.NOTHING: message("Nothing is compensated"),
    Level.DISPLACEMENT: message("Displacement: EXX, EYY, EZZ"),
    Level.STRAIGHTNESS: message("… and straightness, squareness"),
    Level.ANGULAR: message("… and the nine rotations"),
    Level.NONRIGID: message("… and slopes of bending axes"),
}

_VIEWS: Final = {
    "Top": message("Top view"),
    "Front": message("Front view"),
    "Side": message("Side view"),
}

_ROUND: Final = (1.0, 2.0, 5.0)


def volume_page(view: VolumeView, now: datetime) -> str:
    """Write the page of a machine's work volume."""
    status = view.status
    shown = {} if view.found is None else _shown(view.found)
    return render_machine(
        "volume",
        "/volume",
        status.machine,
        status.name,
        now,
        status=status,
        group=group_of(status),
        why_not=view.why_not,
        volume=shown,
    )


def _shown(now: VolumeNow) -> dict[str, Any]:
    worst = now.worst
    largest = worst.length_um or 1.0
    base = {"times": f"{now.exaggeration:g}", "through": now.through}
    if any(now.tool_offset_mm):
        base |= {
            f"tool_{a}": f"{t:g}" for a, t in zip(LINEAR_LETTERS, now.tool_offset_mm, strict=True)
        }
    slices = _drawn(now.slices, now.volume)
    m = _margin_mm(slices, now.volume)
    first_mm, second_mm = _columns_mm(slices, now.volume, m)
    return {
        "title": _(
            "Largest error %(size)s µm at %(place)s, before compensation.",
            size=number(worst.length_um, 1),
            place=_place(worst),
        ),
        "conditions": _conditions(now),
        "zero": _zero(now),
        "warnings": now.warnings,
        "times": f"{now.exaggeration:g}",
        "asked": _asked(now),
        "columns": f"{first_mm:.2f}fr {second_mm:.2f}fr",
        "views": [_view(one, now, m) for one in slices],
        "bars": _bars(now, second_mm),
        "is_ringed": all(one.ringed is not None for one in slices),
        "exaggerations": [
            (f"{times:g}", urlencode(base | {"times": f"{times:g}"}), times == now.exaggeration)
            for times in _steps(now.automatic, now.exaggeration)
        ],
        "through": [
            (words, urlencode(base | {"through": words}), words == now.through)
            for words in (message("worst"), message("middle"))
        ],
        "corners": [
            _row(_("worst"), worst, largest),
            *(_row(str(i), one, largest) for i, one in enumerate(now.corners, start=1)),
        ],
        "levels": _levels(now),
        "definitions": [
            ("Ed, ISO 230\N{NON-BREAKING HYPHEN}6", now.accuracy.diagonals.ed_um),
            ("ESd", now.accuracy.diagonals.esd_um),
            (_("Definition 1"), now.accuracy.with_arms.definition_1),
            (_("Definition 2"), now.accuracy.with_arms.definition_2),
            ("ELv", now.accuracy.lines.elv_um),
            ("ELSv", now.accuracy.lines.elsv_um),
        ],
    }


def _asked(now: VolumeNow) -> str:
    """Write what the picture in 3D is asked with: the factor and the tool of this page."""
    asked = {
        "exaggeration": now.exaggeration,
        "tool_offset_mm": list(now.tool_offset_mm),
        "missing_components": "zero",
    }
    return json.dumps(asked)


def _place(one: PointError) -> str:
    words = [f"{a.upper()} {_mm(v)}" for a, v in zip(LINEAR_LETTERS, one.point_mm, strict=True)]
    return f"{', '.join(words)} {reader().length}"


def _conditions(now: VolumeNow) -> str:
    tool = ", ".join(_mm(t) for t in now.tool_offset_mm)
    at = ", ".join(
        f"{s} {temperature(t)} {reader().temperature}"
        for s, t in now.answer.temperatures_c[0].items()
    )
    chain = now.answer.machine.chain.text
    return _(
        "At %(temperatures)s; v%(version)s, tool offset (%(offset)s) %(unit)s, %(chain)s.",
        temperatures=at,
        version=now.answer.model_version,
        offset=tool,
        unit=reader().length,
        chain=chain,
    )


def _zero(now: VolumeNow) -> str:
    """Say what the numbers leave out: components without maps are not errors of zero."""
    missing = now.answer.counted_as_zero
    if not missing:
        return ""
    return counted(
        len(missing),
        "%(count)s component without two maps counts as zero: %(codes)s. "
        "The true error may be larger.",
        "%(count)s components without two maps count as zero: %(codes)s. "
        "The true error may be larger.",
        codes=listed(missing),
    )


def _row(name: str, one: PointError, largest_um: float) -> dict[str, Any]:
    return {
        "name": name,
        "point": [_mm(v) for v in one.point_mm],
        "error": [signed(v) for v in one.error_um],
        "length": number(one.length_um, 1),
        "share": round(100.0 * one.length_um / largest_um, 1),
    }


def _levels(now: VolumeNow) -> list[dict[str, Any]]:
    """Lay out what each level leaves; slopes only where the machine has any."""
    has_slopes = any("^" in code for code in now.answer.field.tables)
    largest = max((one.max_um for one in now.levels), default=0.0) or 1.0
    return [
        {
            "name": _(LEVELS[one.level]),
            "mean": number(one.mean_um, 1),
            "largest": number(one.max_um, 1),
            "share": round(100.0 * one.max_um / largest, 1),
            "mean_share": round(100.0 * one.mean_um / largest, 1),
        }
        for one in now.levels
        if has_slopes or one.level is not Level.NONRIGID
    ]


def _steps(automatic: float, chosen: float) -> list[float]:
    """Give the factor that suits with its neighbours in steps 1, 2, 5, and the chosen one."""
    return sorted({_next(automatic, -1), automatic, _next(automatic, 1), chosen})


def _next(factor: float, by: int) -> float:
    """Go up or down by one of the steps 1, 2, 5.

    >>> _next(500.0, 1), _next(500.0, -1), _next(1.0, -1)
    (1000.0, 200.0, 0.5)
    """
    power = math.floor(math.log10(factor) + 1e-9)
    at = min(range(3), key=lambda i: abs(_ROUND[i] - factor / 10.0**power)) + 3 * power + by
    return float(f"{_ROUND[at % 3]:g}e{at // 3}")


def _drawn(slices: Sequence[Slice], volume: WorkVolume) -> Sequence[Slice]:
    """Leave out slices that are a line: a lathe without Y has one that shows something."""
    long = [high > low for low, high in volume.ranges_mm]
    return [one for one in slices if long[one.across] and long[one.up]] or slices


def _columns_mm(
    slices: Sequence[Slice], volume: WorkVolume, margin_mm: float
) -> tuple[float, float]:
    """How wide both columns are at the slices' scale [mm]; one slice alone is not too tall."""
    sizes = [high - low + 2.0 * margin_mm for low, high in volume.ranges_mm]
    if len(slices) > 1:
        return sizes[0], sizes[1]
    across, up = sizes[slices[0].across], sizes[slices[0].up]
    share = min(0.5, 0.8 * across / up)
    return across, across * (1.0 - share) / share


def _margin_mm(slices: Sequence[Slice], volume: WorkVolume) -> float:
    """How far lines reach beyond the volume, and a little more: the same round all slices [mm]."""
    beyond = 0.0
    for one in slices:
        points = np.vstack(one.real)
        for i, axis in enumerate((one.across, one.up)):
            low, high = volume.ranges_mm[axis]
            beyond = max(beyond, low - points[:, i].min(), points[:, i].max() - high)
    longest = max(high - low for low, high in volume.ranges_mm)
    return float(beyond + 0.035 * longest)


def _view(one: Slice, now: VolumeNow, margin_mm: float) -> dict[str, Any]:
    across, up = (now.volume.ranges_mm[axis] for axis in (one.across, one.up))
    third = LINEAR_LETTERS[one.third].upper()
    left, top = across[0] - margin_mm, up[1] + margin_mm
    size = (across[1] - across[0] + 2 * margin_mm, up[1] - up[0] + 2 * margin_mm)

    def to(points_mm: FloatArray) -> str:
        return " ".join(f"{x - left:.2f},{top - y:.2f}" for x, y in points_mm)

    parts = [f'<polyline class="nominal" points="{to(line)}"/>' for line in one.nominal]
    edges = {0, LINES - 1, LINES, 2 * LINES - 1}
    for i, line in enumerate(one.real):
        kind = "edge" if i in edges else "real"
        parts.append(f'<polyline class="{kind}" points="{to(line)}"/>')
    ring = max(max(high - low for low, high in now.volume.ranges_mm) * 0.022, 1e-9)
    if one.ringed is not None:
        (a, b), (c, d) = ((x - left, top - y) for x, y in one.ringed)
        parts.append(f'<line class="edge" x1="{a:.2f}" y1="{b:.2f}" x2="{c:.2f}" y2="{d:.2f}"/>')
        parts.append(f'<circle class="from" cx="{a:.2f}" cy="{b:.2f}" r="{ring / 2:.2f}"/>')
        parts.append(f'<circle class="ringed" cx="{c:.2f}" cy="{d:.2f}" r="{ring:.2f}"/>')
    view = _(_VIEWS[one.name])
    plane = _("%(plane)s at %(place)s", plane=one.plane, place=f"{third} {_mm(one.at_mm)}")
    name = _(
        "%(view)s, %(plane)s %(unit)s: nominal grid and real one, errors drawn %(times)s times "
        "larger",
        view=view,
        plane=plane,
        unit=reader().length,
        times=f"{now.exaggeration:g}",
    )
    return {
        "name": view,
        "key": one.name.lower(),
        "words": plane,
        "svg": _svg(size, parts, name),
        "across": LINEAR_LETTERS[one.across].upper(),
        "up": LINEAR_LETTERS[one.up].upper(),
        "inset": round(100.0 * margin_mm / size[0], 2),
        "ends": [_mm(v) for v in across],
        "heights": [_mm(v) for v in up],
    }


def _bars(now: VolumeNow, width_mm: float) -> dict[str, Any]:
    """Draw the two bars for scale at the scale of the slices, in their second column."""
    travel = _round_below(width_mm / 3.0)
    error_um = _round_below(width_mm / 3.0 * UM_PER_MM / now.exaggeration)
    long_mm = error_um * now.exaggeration / UM_PER_MM
    high = 0.06 * width_mm

    def bar(kind: str, y: float, length: float) -> str:
        tick = 0.012 * width_mm
        points = (
            f"1,{y - tick:.2f} 1,{y:.2f} {1 + length:.2f},{y:.2f} {1 + length:.2f},{y - tick:.2f}"
        )
        return f'<polyline class="{kind}" points="{points}"/>'

    def words(length: float, unit: str) -> str:
        return marked(f"{length:,.10g}".replace(",", NO_BREAK)) + f" {unit}"

    return {
        "travel": _svg((width_mm, high), [bar("nominal bar-line", high * 0.7, travel)], ""),
        "travel_words": _("%(length)s of travel", length=f"{position(travel)} {reader().length}"),
        "error": _svg((width_mm, high), [bar("edge", high * 0.7, long_mm)], ""),
        "error_words": _("%(length)s of error", length=words(error_um, "µm")),
    }


def _round_below(value: float) -> float:
    power = math.floor(math.log10(value)) if value > 0.0 else 0
    return max(r * 10.0**power for r in _ROUND if r * 10.0**power <= value * (1 + 1e-9) or r == 1.0)


def _svg(size: tuple[float, float], parts: Iterable[str], name: str) -> Markup:
    said = Markup('role="img" aria-label="{}"').format(name) if name else 'aria-hidden="true"'
    return Markup(
        f'<svg class="slice" viewBox="0 0 {size[0]:.2f} {size[1]:.2f}" {said}>'
        f"{''.join(parts)}</svg>"
    )


def _mm(value: float) -> str:
    return position(round(value, 1))
