"""The dashboard's pages: what services return, laid out; the verdict is theirs, word for word."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from itertools import groupby
from typing import Any, Final
from urllib.parse import urlencode

import numpy as np
from markupsafe import Markup

from app.languages import ENGLISH
from app.live.database_watch import Trouble, TroubleKind
from app.pages.dashboard.charts import (
    Scale,
    course_svg,
    curve_svg,
    positions_scale,
    small_svg,
    values_of,
)
from app.pages.dashboard.events import event_row
from app.pages.dashboard.numbers import (
    MINUS,
    NO_BREAK,
    age,
    clock,
    difference,
    difference_unit,
    marked,
    number,
    place_words,
    position,
    signed,
)
from app.pages.environment import render_live, render_machine
from app.pages.reader import reader, zone_name
from app.pages.wording import _, all_said, counted, message, said
from app.services.dashboard import Curve, MachineView
from app.status.machine_status import (
    LastCheck,
    MachineStatus,
    SensorNow,
    State,
    Verdict,
    in_micro,
)
from app.thermal.bracket import Status
from app.thermal.sensor_health import Health
from app.units import Unit

GROUPS: Final = ("not-trusted", "limited", "service", "trusted")
"""In the order of the page: `service` are machines that can be trusted although a sensor failed."""

MOST_LARGE: Final = 6
"""So many sensors are drawn large; of more, only the bad ones are."""

MOST_BAD_LARGE: Final = 3
"""So many of the bad ones."""

_LIMITED: Final = frozenset({Status.CLAMPED, Status.EXTRAPOLATED, "held"})
"""Statuses of components that are marked."""

_STATES: Final[Mapping[State, str]] = {
    State.NO_MODEL: message("No model"),
    State.NO_READING: message("No reading"),
    State.SENSOR_FAULT: message("Sensor fault"),
    State.OUTSIDE_MAPS: message("Outside the maps"),
    State.STALE: message("Stale"),
    State.EXTRAPOLATED: message("Extrapolated"),
    State.CLAMPED: message("Outside calibrated range"),
    State.HELD: message("Held at edge"),
    State.EFFECT_MISSING: message("Effect missing"),
    State.INCOMPLETE: message("Incomplete"),
    State.LATE: message("Sensor late"),
    State.DRIFTING: message("Drifting"),
    State.CHECK_OFF: message("Last check off"),
    State.EFFECT_NOT_ADOPTED: message("Effect not adopted"),
    State.STAND_IN: message("Stand-in"),
    State.FRESH: message("Up to date"),
}

_HEALTHS: Final[Mapping[Health, str]] = {
    Health.OK: message("ok"),
    Health.MISSING: message("missing"),
    Health.STALE: message("stale"),
    Health.OUT_OF_RANGE: message("out of range"),
    Health.STUCK: message("stuck"),
    Health.JUMP: message("jump"),
    Health.FAULTY: message("faulty"),
}

_HYPHEN: Final = "\N{NON-BREAKING HYPHEN}"


def machines_page(
    views: Sequence[MachineView], now: datetime, only: str = "", trouble: Trouble | None = None
) -> str:
    """Write the page of all machines: who can be trusted, who cannot and why.

    Parameters
    ----------
    only
        One of `GROUPS`: its machines alone are listed; empty for all.
    trouble
        What is the matter with the database, if anything is.
    """
    groups = {view.status.machine: group_of(view.status) for view in views}
    counts = {g: sum(group == g for group in groups.values()) for g in GROUPS}
    largest = max(
        (abs(v.status.largest.value) for v in views if v.status.largest is not None), default=0.0
    )
    shown = [v for v in views if not only or groups[v.status.machine] == only]
    shown.sort(key=lambda v: GROUPS.index(groups[v.status.machine]))
    return render_live(
        "dashboard/machines.html",
        page="machines",
        stream="/v1/stream",
        now=now,
        only=only,
        trouble="" if trouble is None else _trouble_words(trouble, now),
        summary=_summary([v.status for v in views], counts),
        rows=[_row(v, groups[v.status.machine], largest, now) for v in shown],
    )


def machine_page(view: MachineView, now: datetime, chosen: Mapping[str, str]) -> str:
    """Write the page of one machine now.

    Parameters
    ----------
    chosen
        Axis to the component that is drawn large; the largest displacement of the others.
    """
    status = view.status
    axes = _axes(view.curves, chosen)
    return render_machine(
        "machine",
        "",
        status.machine,
        status.name,
        now,
        status=status,
        group=group_of(status),
        state=_state_words(status, now),
        check=check_words(status.last_check),
        events=[event_row(event) for event in view.events],
        **_sensors(view),
        axes=axes,
        tick_letters=max((len(t["words"]) for a in axes for t in a.get("ticks", ())), default=0),
        uncertainty=_uncertainty(view.curves),
        tables=list(_tables(view.curves)),
    )


def check_words(check: LastCheck | None) -> str:
    """Say briefly by how much the last check was off, and what was expected."""
    if check is None:
        return _("none of this version")
    if check.off is None or check.at_most is None:
        return _("not judged")
    off, at_most = (marked(in_micro(size)) for size in (check.off, check.at_most))
    size = f"{off}{NO_BREAK}{check.unit}"
    return _("%(size)s (at most %(most)s)", size=size, most=at_most)


def group_of(status: MachineStatus) -> str:
    """Say in which group a machine stands, and which symbol it has."""
    return "service" if status.state is State.STAND_IN else str(status.verdict)


@dataclass(frozen=True, slots=True)
class Summary:
    """The sentence of the page of all machines, and the counts beside it."""

    trusted: str
    worst: str
    limited: str
    counts: Mapping[str, int]

    @property
    def title(self) -> str:
        """What a browser's tab says."""
        return " ".join(filter(None, (self.trusted, self.worst)))


def _summary(statuses: Sequence[MachineStatus], counts: Mapping[str, int]) -> Summary:
    if not statuses:
        return Summary(_("No machine yet."), "", "", counts)
    trusted = counts["trusted"] + counts["service"]
    limited = counts["limited"]
    failed = [s for s in statuses if s.verdict is Verdict.NOT_TRUSTED]
    worst = ""
    if len(failed) == 1:
        state = _(_STATES[failed[0].state])
        state = state.lower() if reader().language == ENGLISH else state
        worst = _("%(machine)s cannot: %(state)s.", machine=failed[0].name, state=state)
    elif failed:
        worst = counted(len(failed), "%(count)s cannot.", "%(count)s cannot.")
    return Summary(
        counted(
            trusted,
            "%(count)s of %(all)s can be trusted.",
            "%(count)s of %(all)s can be trusted.",
            all=len(statuses),
        ),
        worst,
        counted(limited, "%(count)s is limited.", "%(count)s are limited.") if limited else "",
        counts,
    )


def _trouble_words(trouble: Trouble, now: datetime) -> str:
    since = f"{clock(trouble.since, now)} {zone_name(trouble.since)}"
    match trouble.matter:
        case TroubleKind.AWAY:
            words = _("The database has been away since %(time)s", time=since)
        case TroubleKind.SILENT:
            words = _("The database has not answered since %(time)s", time=since)
        case TroubleKind.LOCKED:
            words = _("The database has been locked since %(time)s and takes nothing", time=since)
    going_on = _("tables go on from memory.")
    return f"{words}: {going_on}"


def _row(view: MachineView, group: str, largest: float, now: datetime) -> dict[str, Any]:
    status = view.status
    why = status.sentences[0] if status.sentences else ""
    leading = _leading(status)
    course = Markup("")
    if leading is not None:
        is_old = leading.health is not Health.OK
        name = _("%(sensor)s over two hours", sensor=leading.sensor)
        course = course_svg(view.courses[leading.sensor], leading.maps_c, name, is_old=is_old)
    return {
        "status": status,
        "group": group,
        "state": _state_words(status, now),
        "why": said(why, now),
        "more": "" if status.verdict is Verdict.TRUSTED else all_said(status.sentences, now),
        "leading": leading,
        "course": course,
        # Numbers that stand still look so too.
        "is_old": leading is None
        or leading.health is not Health.OK
        or status.state is State.NO_READING,
        "health": _health_words(leading),
        "length": round(100.0 * abs(status.largest.value) / largest, 1)
        if status.largest is not None and largest > 0.0
        else 0.0,
        "check": check_words(status.last_check),
    }


def _leading(status: MachineStatus) -> SensorNow | None:
    """Choose the sensor in the worst state, else the one that drives the largest compensation."""
    assigned = [s for s in status.sensors if s.assigned_to]
    if not assigned:
        return status.sensors[0] if status.sensors else None
    bad = _worst_first(assigned)[0]
    if bad.health is not Health.OK or bad.outside_maps_k:
        return bad
    largest = None if status.largest is None else status.largest.component
    return next((s for s in assigned if largest in s.assigned_to), assigned[0])


def _is_well(sensor: SensorNow) -> bool:
    return sensor.health is Health.OK and not _has_stopped(sensor) and not sensor.outside_maps_k


def _has_stopped(sensor: SensorNow) -> bool:
    """Whether its next value is missed, or it is said that there is none."""
    return sensor.is_late or sensor.no_value_since is not None


def _worst_first(sensors: Iterable[SensorNow]) -> list[SensorNow]:
    """Put the bad ones on top, and those that drive something before the others."""
    return sorted(
        sensors,
        key=lambda s: (
            _is_well(s),
            not s.assigned_to,
            s.health is Health.OK,
            -abs(s.outside_maps_k or 0.0),
        ),
    )


def _sensors(view: MachineView) -> dict[str, Any]:
    """Lay out the sensors: large where they are few or bad, those that drive nothing folded."""
    ordered = _worst_first(view.status.sensors)
    if len(ordered) <= MOST_LARGE:
        return {"sensors": [_sensor(view, s) for s in ordered], "slim_rows": [], "idle": []}
    bad = [s for s in ordered if not _is_well(s)]
    large, slim = bad[:MOST_BAD_LARGE], bad[MOST_BAD_LARGE:]
    well = [s for s in ordered if _is_well(s)]
    return {
        "sensors": [_sensor(view, s) for s in large],
        "slim_rows": [_sensor(view, s) for s in [*slim, *(s for s in well if s.assigned_to)]],
        "idle": [_sensor(view, s) for s in well if not s.assigned_to],
    }


def _state_words(status: MachineStatus, now: datetime) -> str:
    # A date is not broken at its hyphens.
    since = "" if status.since is None else f" · {clock(status.since, now).replace('-', _HYPHEN)}"
    return _(_STATES[status.state]) + since


def _sensor(view: MachineView, sensor: SensorNow) -> dict[str, Any]:
    is_fault = sensor.health not in (Health.OK, Health.STALE)
    outside = sensor.outside_maps_k
    if sensor.health is not Health.OK:
        words = _health_words(sensor)
    elif sensor.no_value_since is not None:
        words = _("no value")
    elif sensor.is_late and sensor.age_s is not None:
        words = _("%(age)s old", age=age(sensor.age_s))
    elif outside is None:
        words = _("not used")
    elif outside == 0.0:
        words = _("inside")
    else:
        by = _kelvins(outside)
        words = _("%(by)s over", by=by) if outside > 0 else _("%(by)s under", by=by)
    name = _("%(sensor)s over two hours: now %(state)s", sensor=sensor.sensor, state=words)
    return {
        "now": sensor,
        "is_fault": is_fault,
        "is_old": sensor.health is Health.STALE or _has_stopped(sensor),
        "is_well": _is_well(sensor),
        "words": words,
        "course": course_svg(
            view.courses[sensor.sensor],
            sensor.maps_c,
            name,
            is_old=sensor.health is not Health.OK or _has_stopped(sensor),
        ),
    }


def _kelvins(outside_k: float) -> str:
    return f"{number(difference(abs(outside_k)))} {difference_unit()}"


def _health_words(sensor: SensorNow | None) -> str:
    """Say what is the matter with a sensor, in two words; empty where nothing is."""
    if sensor is None or sensor.health is Health.OK:
        return ""
    if sensor.health is Health.STALE and sensor.age_s is not None:
        return _("%(age)s old", age=age(sensor.age_s))
    return _(_HEALTHS[sensor.health])


def _axes(curves: Sequence[Curve], chosen: Mapping[str, str]) -> list[dict[str, Any]]:
    """Lay out each axis: one curve large, all of its components in rows below."""
    by_axis = {axis: _of_axis(curves, axis) for axis in "xyz"}
    by_axis = {axis: own for axis, own in by_axis.items() if own}
    drawn = {axis: _chosen(own, chosen.get(axis)) for axis, own in by_axis.items()}
    # Charts side by side share their scale, one for each unit.
    scales = {
        unit: Scale.over(
            value
            for curve in drawn.values()
            if curve is not None and curve.component.unit is unit
            for value in _drawn_values(curve)
        )
        for unit in Unit
    }
    lengths = _lengths(curves)
    found = []
    for axis, own in by_axis.items():
        curve = drawn[axis]
        query = {a: c.component.code for a, c in drawn.items() if c is not None}
        found.append(
            {
                "name": axis,
                "title": _("%(axis)s axis", axis=axis.upper()),
                "chosen": curve,
                "rows": [_component_row(c, axis, curve, query, lengths, own) for c in own],
                **_chart(curve, scales, own),
            }
        )
    return found


def _of_axis(curves: Sequence[Curve], axis: str) -> list[Curve]:
    """List what stands below an axis: what moves with it, and squareness along it."""
    return [c for c in curves if (c.component.axis or c.component.times or "z") == axis]


def _chosen(curves: Sequence[Curve], code: str | None) -> Curve | None:
    """Choose what is drawn large: what was asked for, else the largest displacement."""
    tables = [c for c in curves if c.component.is_table]
    for curve in tables:
        if curve.component.code == code:
            return curve
    key = {c.component.code: (c.component.unit is Unit.UM, _size(c)) for c in tables}
    return max(tables, key=lambda c: key[c.component.code], default=None)


def _chart(
    curve: Curve | None, scales: Mapping[Unit, Scale], curves: Sequence[Curve]
) -> dict[str, Any]:
    if curve is None:
        return {"chart": "", "between": ""}
    scale = scales[curve.component.unit]
    ends = _ends_mm(curves)
    basis = curve.entry.basis
    if not curve.maps:
        between = _("not between two maps")
    else:
        between = f"{curve.maps[0].label} ↔ {curve.maps[1].label}"
    nearest = basis.upper_map if (basis.weight or 0.0) > 0.5 else basis.lower_map
    label = Markup("<b>{}</b>").format(_("now"))
    if curve.trend is not None:
        held = _("now = %(map)s (held)", map=nearest)
        label = Markup("<b>{}</b>; {}").format(held, _("amber: the trend"))
    elif basis.weight is not None:
        share = _("now, %(share).0f %% between", share=100.0 * basis.weight)
        maps = _(
            "%(lower)s (dots) and %(upper)s (dashes)",
            lower=curve.maps[0].label,
            upper=curve.maps[1].label,
        )
        label = Markup("<b>{}</b> {}").format(share, maps)
    if curve.entry.effects:
        label += _("; with %(effects)s", effects=", ".join(curve.entry.effects))
    if curve.entry.backward_errors is not None:
        label += _("; thin: backward")
    value, place = _largest_of(curve)
    name = _(
        "%(code)s: compensation now, largest %(size)s; maps %(between)s",
        code=curve.component.code,
        size=f"{signed(value)} {curve.component.unit.symbol}{place and ' ' + place}",
        between=between,
    )
    return {
        "chart": curve_svg(curve, scale, ends, name),
        "between": between if curve.trend is None else _("held at %(map)s", map=nearest),
        "label": label,
        "ticks": [
            {"top": round(100.0 * (1.0 - scale.share(t)), 2), "words": _tick(t)}
            for t in scale.ticks
        ],
        "positions": [position(x) for x in positions_scale(ends[0], ends[-1])],
    }


def _component_row(
    curve: Curve,
    axis: str,
    drawn: Curve | None,
    query: Mapping[str, str],
    lengths: Mapping[Unit, float],
    curves: Sequence[Curve],
) -> dict[str, Any]:
    value, place = _largest_of(curve)
    is_table = curve.component.is_table
    return {
        "code": curve.component.code,
        "value": value,
        "unit": curve.component.unit.symbol,
        "place": place,
        "is_chosen": drawn is not None and curve.component.code == drawn.component.code,
        "is_limited": curve.entry.basis.status in _LIMITED,
        "query": urlencode({**query, axis: curve.component.code} if is_table else query),
        "shape": small_svg(curve, lengths[curve.component.unit], _ends_mm(curves)),
    }


def _largest_of(curve: Curve) -> tuple[float, str]:
    """Find a component's largest compensation in either direction, and write its place."""
    values, count = values_of(curve.entry), curve.entry.compensation.size
    at = int(np.abs(values).argmax())
    axis, is_backward = curve.component.axis, at >= count
    if axis is None:
        return float(values[at]), _("backward") if is_backward else ""
    position_mm = float(round(curve.entry.positions_mm[at % count], 1))
    return float(values[at]), place_words(axis, position_mm, is_backward=is_backward)


def _size(curve: Curve) -> float:
    return float(np.abs(values_of(curve.entry)).max(initial=0.0))


def _lengths(curves: Sequence[Curve]) -> dict[Unit, float]:
    """The largest value of each unit: small curves of one unit share their scale."""
    found = dict.fromkeys(Unit, 0.0)
    for curve in curves:
        unit = curve.component.unit
        found[unit] = max(found[unit], _size(curve))
    return {unit: value or 1.0 for unit, value in found.items()}


def _ends_mm(curves: Sequence[Curve]) -> tuple[float, float]:
    """Between which positions an axis is drawn [mm]."""
    ends = [c.entry.positions_mm[[0, -1]] for c in curves if c.component.is_table]
    return (
        float(min(e[0] for e in ends)) if ends else 0.0,
        float(max(e[-1] for e in ends)) if ends else 1.0,
    )


def _drawn_values(curve: Curve) -> list[float]:
    """Every value that a chart has to hold."""
    drawn = [values_of(curve.entry), *(m.compensation for m in curve.maps)]
    if curve.trend is not None:
        drawn.append(curve.trend.compensation)
    return [float(v) for values in drawn for v in (values.min(), values.max())]


def _uncertainty(curves: Sequence[Curve]) -> str:
    """Say what the band is, or why there is none."""
    if any(c.entry.standard_errors is not None for c in curves):
        return _("Band: ± 2 σ of the maps' measurement.")
    if any(c.entry.effects for c in curves):
        return _("Uncertainty: not known with an adopted effect.")
    return _("Uncertainty: not stated in the maps.")


def _tables(curves: Sequence[Curve]) -> Iterable[dict[str, Any]]:
    """Lay out the whole table: components over the same positions share a table."""
    tables = [c for c in curves if c.component.is_table]
    single = [c for c in curves if not c.component.is_table]

    def positions(curve: Curve) -> tuple[str, tuple[float, ...]]:
        return curve.component.axis or "", tuple(curve.entry.positions_mm.tolist())

    for (axis, at), own in groupby(sorted(tables, key=positions), key=positions):
        letter = axis.upper()
        yield {
            "head": f"{letter}, {reader().length}",
            "caption": _("Compensation along %(axis)s", axis=letter),
            "positions": [position(x) for x in at],
            "rows": list(_rows(own)),
        }
    if single:
        yield {
            "head": _("Without a position"),
            "caption": _("Compensation that has no position"),
            "positions": [_("value")],
            "rows": list(_rows(single)),
        }


def _rows(curves: Iterable[Curve]) -> Iterator[dict[str, Any]]:
    for c in curves:
        ways = ("", c.entry.compensation), (" " + _("backward"), c.entry.backward_compensation)
        for way, values in ways:
            if values is not None:
                yield {
                    "code": c.component.code,
                    "way": way,
                    "unit": c.component.unit.symbol,
                    "values": values.tolist(),
                }


def _tick(value: float) -> str:
    return marked(f"{value:,.10g}".replace("-", MINUS).replace(",", NO_BREAK))
