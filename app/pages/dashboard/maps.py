"""The page of maps and versions: which is active, two side by side, and what a new one would do."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import Any, Final

from app.compensation.table import CompensationTable, ComponentCompensation
from app.compensation.table_difference import ComponentChange
from app.effects.adopted.model_difference import Part
from app.geometry.components import COMPONENTS
from app.pages.dashboard.charts import Scale, before_after_svg, positions_scale, values_of
from app.pages.dashboard.numbers import (
    clock,
    number,
    place_words,
    position,
    short,
    signed,
    temperature,
)
from app.pages.environment import render_live, render_machine
from app.pages.reader import day_and_time
from app.pages.what_was_read import WhatWasRead, read_of_map
from app.pages.wording import _, counted, listed, message
from app.services.dashboard import MapsView
from app.services.models import Preview
from app.services.recorded_change import RecordedChanges
from app.storage.records import ModelVersion, StoredMap
from app.thermal.bracket import Status
from app.thermal.error_map import ErrorMap
from app.units import unit_of_field

MOST_RECORDED: Final = 4
"""Components that are named whose change was larger at what was recorded."""

SEEN: Final = 0.05
"""Changes below are 0.0 as they are written: their rows fold into one."""

_STATUSES: Final[Mapping[str, str]] = {
    Status.CLAMPED: message("outside its maps"),
    Status.EXTRAPOLATED: message("extrapolated"),
    Status.INTERPOLATED: message("interpolated"),
    Status.AT_MAP: message("at-map"),
    Status.STAND_IN: message("stand-in"),
}
"""A machine shop clamps workpieces."""


def maps_page(view: MapsView, now: datetime, methods: Mapping[str, str]) -> str:
    """Write the page of a machine's maps and versions."""
    status = view.status
    return render_machine(
        "maps",
        "/maps",
        status.machine,
        status.name,
        now,
        view=view,
        methods=methods,
        title=_title(view, now),
        maps=[_map(one, now) for one in _maps_in_use(view)],
        versions=[_version(one, view, now) for one in view.versions],
        difference=None if view.compared is None else _changes(view.compared.changes),
        why_not="" if view.compared is None else view.compared.why_not,
    )


def upload_preview(
    preview: Preview,
    name: str,
    error_map: ErrorMap,
    remarks: Sequence[str],
    method: str | None,
    figures: Mapping[str, float],
) -> str:
    """Write what storing a file's map would do, before anything is stored.

    Parameters
    ----------
    method, figures
        By which method the map was measured, and its figures by names that end in the unit,
        where the file holds an instrument's readings.
    """
    kind = _("map") if method is None else _("map by %(method)s", method=method)
    what = {"file": name, "kind": kind, "label": error_map.label}
    about = (
        _("%(file)s · %(kind)s ‘%(label)s’: it is stored already", **what)
        if preview.is_there
        else _("%(file)s · %(kind)s ‘%(label)s’: nothing is stored yet", **what)
    )
    return _preview_page(
        preview,
        "upload",
        _("Storing this map"),
        about,
        read=read_of_map(error_map),
        remarks=[*remarks, *preview.warnings],
        figures=[
            {"name": figure, "value": number(value), "unit": unit_of_field(figure) or ""}
            for figure, value in figures.items()
        ],
        name=name,
    )


def activation_preview(preview: Preview, version: int) -> str:
    """Write what activating a version would do, before it is done."""
    return _preview_page(
        preview,
        "activate",
        _("Activating v%(version)s", version=version),
        f"v{version}",
        version=version,
    )


def withdrawal_preview(preview: Preview, stored: StoredMap) -> str:
    """Write what taking a map out of use would do, before it is done."""
    label, measured = stored.error_map.label, day_and_time(stored.error_map.measured_at)
    return _preview_page(
        preview,
        "withdraw",
        _("Withdrawing ‘%(map)s’", map=label),
        _("map ‘%(map)s’, measured %(time)s", map=label, time=measured),
        withdrawn={"id": stored.id, "label": label},
    )


def _preview_page(
    preview: Preview,
    what: str,
    subject: str,
    about: str,
    *,
    version: int | None = None,
    withdrawn: Mapping[str, Any] | None = None,
    read: WhatWasRead | None = None,
    remarks: Sequence[str] = (),
    figures: Sequence[Mapping[str, str]] = (),
    name: str = "",
) -> str:
    return render_live(
        "dashboard/preview.html",
        what=what,
        about=about,
        version=version,
        withdrawn=withdrawn,
        active=preview.active_version,
        is_there=preview.is_there,
        loses=preview.loses,
        gains=preview.gains,
        reason=preview.reason,
        sentence=_worst(preview, subject),
        picture=_picture(preview),
        changes=_changes(preview.changes),
        why_not=preview.not_compared,
        waited=preview.waited_before,
        read=read,
        remarks=[*_recorded(preview.recorded), *remarks],
        figures=figures,
        name=name,
    )


def _title(view: MapsView, now: datetime) -> str:
    active = view.active_version
    if active is None:
        return _("No version yet: the first error map makes one.")
    return _(
        "v%(version)s is active, made %(time)s: %(parts)s.",
        version=active.version,
        time=clock(active.created_at, now),
        parts=_made_of(active),
    )


def _maps_in_use(view: MapsView) -> Sequence[StoredMap]:
    return () if view.active_version is None else view.active_version.maps


def _map(stored: StoredMap, now: datetime) -> dict[str, Any]:
    one = stored.error_map
    return {
        "id": stored.id,
        "label": one.label,
        "measured": clock(one.measured_at, now),
        "components": len(one.tables),
        "temperatures": ", ".join(f"{s} {temperature(t)}" for s, t in one.temperatures_c.items()),
    }


def _made_of(version: ModelVersion) -> str:
    count = len(version.effects)
    effects = counted(count, "%(count)s adopted effect", "%(count)s adopted effects")
    maps = counted(len(version.maps), "%(count)s map", "%(count)s maps")
    return _("%(maps)s and %(effects)s", maps=maps, effects=effects if count else _("no effect"))


def _version(one: ModelVersion, view: MapsView, now: datetime) -> dict[str, Any]:
    return {
        "number": one.version,
        "reason": one.reason,
        "made": clock(one.created_at, now),
        "made_of": _made_of(one),
        "maps": ", ".join(stored.error_map.label for stored in one.maps),
        "is_active": one.version == view.active,
        "is_waiting": one.version == view.waiting,
        "is_a": one.version == view.a,
        "is_b": one.version == view.b,
    }


def _worst(preview: Preview, subject: str) -> str:
    """Say the worst consequence: what is lost, else the largest change."""
    loses, changes = preview.loses, preview.changes
    if preview.is_there:
        return _("Storing this map again changes nothing.")
    if loses:
        lost = loses[0].text
        if len(loses) == 1:
            return _("%(change)s would lose %(lost)s.", change=subject, lost=lost)
        return _(
            "%(change)s would lose %(lost)s, and %(more)s more.",
            change=subject,
            lost=lost,
            more=len(loses) - 1,
        )
    if preview.not_compared:
        return _(
            "%(change)s loses nothing; by how much tables change is not known.", change=subject
        )
    if not changes or abs(changes[0].change) < SEEN:
        return _(
            "%(change)s loses nothing, and no value changes now by %(size)s or more.",
            change=subject,
            size=short(SEEN),
        )
    row = _row(changes[0])
    return _("%(change)s would change %(values)s.", change=subject, values=_by(row))


def _by(row: Mapping[str, str]) -> str:
    size = f"{row['change']} {row['unit']} {row['place']}".strip()
    return _("%(code)s by %(size)s", code=row["code"], size=size)


def _recorded(recorded: RecordedChanges) -> list[str]:
    """Say what would have changed more at what was recorded than at the latest reading."""
    if not recorded.changes:
        return []
    rows = ((_row(one), one.time) for one in recorded.changes)
    named = listed([f"{_by(row)} ({day_and_time(then)})" for row, then in rows], MOST_RECORDED)
    return [
        counted(
            recorded.count,
            "At the one recorded reading it would have changed more than now: %(changes)s.",
            "At the worst of %(count)s recorded readings it would have changed more than now: "
            "%(changes)s.",
            changes=named,
        )
    ]


def _changes(changes: Sequence[ComponentChange]) -> dict[str, Any]:
    """List what is seen to change, and fold the others into how many there are.

    >>> _changes([])["folded"]
    'No component is in both tables.'
    """
    seen = [one for one in changes if abs(one.change) >= SEEN]
    same = len(changes) - len(seen)
    limit = short(SEEN)
    folded = counted(
        same,
        "%(count)s component changes by less than %(limit)s.",
        "%(count)s components change by less than %(limit)s.",
        limit=limit,
    )
    if seen:
        folded = counted(
            same,
            "The other component changes by less than %(limit)s.",
            "The other %(count)s components change by less than %(limit)s.",
            limit=limit,
        )
    if not changes:
        folded = _("No component is in both tables.")
    elif not same:
        folded = ""
    elif not seen and max(abs(one.change) for one in changes) == 0.0:
        folded = counted(
            same, "The component is the same.", "All %(count)s components are the same."
        )
    return {"rows": [_row(one) for one in seen], "folded": folded}


def _row(one: ComponentChange) -> dict[str, Any]:
    """Write a change of the compensation: minus that of the error."""
    axis = COMPONENTS[one.component].axis
    place = ""
    if axis is not None and one.position_mm is not None:
        place = place_words(axis, one.position_mm, is_backward=one.direction == "-")
    return {
        "code": one.component,
        "change": signed(-one.change),
        "unit": one.unit,
        "place": place,
        "before": _(_STATUSES.get(one.status_before, one.status_before)),
        "after": _(_STATUSES.get(one.status_after, one.status_after)),
    }


def _picture(preview: Preview) -> dict[str, Any] | None:
    """Draw the component of the worst consequence, now and as it would be."""
    lost = next((one for one in preview.loses if one.component is not None), None)
    code = lost.component if lost is not None else None
    if code is None and preview.changes:
        code = preview.changes[0].component
    before, after = (_entry(table, code) for table in (preview.before, preview.after))
    if before is None and after is None:
        return None
    shown = [one for one in (before, after) if one is not None]
    component = shown[0].component
    if not component.is_table:
        return None
    scale = Scale.over(float(v) for one in shown for v in values_of(one))
    ends = (
        min(float(one.positions_mm[0]) for one in shown),
        max(float(one.positions_mm[-1]) for one in shown),
    )
    is_both_ways = any(one.backward_errors is not None for one in shown)
    code, unit = component.code, component.unit.symbol
    name = _(
        "%(code)s compensation in %(unit)s: faint now, strong afterwards", code=code, unit=unit
    )
    lost_mm = _lost_mm(lost, ends)
    return {
        "title": _(
            "%(code)s compensation at the latest temperatures, %(unit)s", code=code, unit=unit
        ),
        "svg": before_after_svg(before, after, scale, ends, lost_mm, name),
        "ticks": [
            {"top": round(100.0 * (1.0 - scale.share(t)), 2), "words": short(t)}
            for t in scale.ticks
        ],
        "positions": [position(x) for x in positions_scale(*ends)],
        "axis": (component.axis or "").upper(),
        "is_both_ways": is_both_ways,
        "lost": lost.text if lost is not None and lost_mm is not None else "",
    }


def _entry(table: CompensationTable | None, code: str | None) -> ComponentCompensation | None:
    if table is None or code not in COMPONENTS:
        return None
    return next((one for one in table.components if one.component.code == code), None)


def _lost_mm(lost: Part | None, ends: tuple[float, float]) -> tuple[float, float] | None:
    if lost is None or lost.what not in ("positions", "component"):
        return None
    low = ends[0] if lost.from_mm is None else max(lost.from_mm, ends[0])
    high = ends[1] if lost.to_mm is None else min(lost.to_mm, ends[1])
    return (low, high) if high > low else None
