"""The compensation table, evaluated once more from the maps as they were posted.

Plain Python on the bodies of the requests; nothing of app is imported. Written from the chapter
(C. Wang, 8.105–8.107) and from what docs/ and the OpenAPI document say of sensors that fail
(docs/nomenclature.md) and of temperatures outside the maps, so that a mistake on one side shows on
the other.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

Body = Mapping[str, Any]

CLOCKS_DIFFER_S = 2.0
"""A reading no further ahead than this is of now."""

CLEARLY = 10.0
"""So many resolutions are a change that a sensor must show, and one that may come at once."""

HALF_A_DIGIT = 0.5e-4 + 1e-9
"""Answers are written to 0.1 nm, 0.1 nrad and 0.1 nm/m."""

CHAPTER = {
    **dict.fromkeys(("EXX", "EYY", "EYX", "EZX", "EXY", "EZY", "SXY"), "x-middle"),
    **dict.fromkeys(("EAX", "EBX", "ECX", "EAY", "EBY", "ECY"), "x-middle"),
    **dict.fromkeys(("EZZ", "EXZ", "EYZ", "EAZ", "EBZ", "ECZ", "SYZ", "SZX"), "z-column"),
}
"""Whom a component follows when nobody has said otherwise (8.2.9)."""


class NoTable(Exception):
    """There is to be a refusal instead of a table."""


@dataclass(frozen=True)
class Line:
    """One component of a table: what it must be, and what it must say that it rests on."""

    code: str
    positions_mm: list[float] | None
    errors: list[float]
    backward_errors: list[float] | None
    standard_errors: list[float] | None
    sensor: str
    temperature_c: float
    lower_map: str
    upper_map: str
    weight: float
    status: str
    is_whole: bool


@dataclass(frozen=True)
class Sensors:
    """What the sensors of a machine are at one moment: usable and old temperatures [°C].

    `health` is what is the matter with each; None where there is no record to judge it by.
    """

    usable: Mapping[str, float]
    stale: Mapping[str, float]
    latest: float | None
    health: Mapping[str, str] | None = None


Reading = tuple[float, Mapping[str, float]]
"""A time [s since 1970] and temperatures by sensor [°C]."""

Record = list[tuple[float, float]]
"""A sensor's times [s since 1970] and temperatures [°C], in order of time."""


def sensors_at(machine: Body, readings: Iterable[Reading], now_s: float) -> Sensors:
    """Judge every sensor by its values that can have been measured by now.

    Parameters
    ----------
    readings
        In any order.
    """
    past = sorted((r for r in readings if r[0] <= now_s + CLOCKS_DIFFER_S), key=lambda r: r[0])
    latest = past[-1][0] if past else None
    names = [sensor["name"] for sensor in machine["sensors"]]
    kept = _kept(machine, past)
    records = {name: [(t, came[name]) for t, came in kept if name in came] for name in names}
    usable: dict[str, float] = {}
    stale: dict[str, float] = {}
    health: dict[str, str] = {}
    for sensor in machine["sensors"]:
        name = sensor["name"]
        health[name] = _health(machine, sensor, records)
        if health[name] != "ok":
            continue
        time_s, value = records[name][-1]
        # What is ahead by no more than clocks differ makes no other value older.
        if max(now_s, latest or now_s) - time_s > sensor["max_age_s"]:
            health[name] = "stale"
        (stale if health[name] == "stale" else usable)[name] = value
    return Sensors(usable, stale, latest, health)


def _kept(machine: Body, past: Sequence[Reading]) -> list[Reading]:
    """Leave what sensors are judged by: 720 parts of twice `stuck_after_s`, or of `max_age_s`.

    Of each part, counted from 1970, the first reading of each sensor, each sensor's last two, and
    its last 31 of that time.
    """
    span_s = max(max(2.0 * (s["stuck_after_s"] or 0.0), s["max_age_s"]) for s in machine["sensors"])
    part_s = span_s / 720.0
    needed: set[float] = set()
    for sensor in machine["sensors"]:
        times = [time_s for time_s, came in past if sensor["name"] in came]
        needed.update(times[-2:])
        firsts = {time_s // part_s: time_s for time_s in reversed(times)}
        begins_s = past[-1][0] - span_s if past else 0.0
        in_span = {part for part in firsts if (part + 1.0) * part_s > begins_s}
        needed.update(time_s for part, time_s in firsts.items() if part in in_span)
        needed.update(t for t in times[-31:] if t // part_s in in_span)
    return [reading for reading in past if reading[0] in needed]


def _health(machine: Body, sensor: Body, records: Mapping[str, Record]) -> str:
    """Say what is the matter with a sensor's last value, whatever its age."""
    record = records.get(sensor["name"], [])
    if not record:
        return "missing"
    believable = _in_range(sensor, record)
    if not believable or believable[-1] != record[-1]:
        return "out-of-range"
    if _has_jumped(sensor, believable):
        return "jump"
    return "stuck" if _stands_still(machine, sensor, records) else "ok"


def _in_range(sensor: Body, record: Record) -> Record:
    return [one for one in record if sensor["min_c"] <= one[1] <= sensor["max_c"]]


def _has_jumped(sensor: Body, record: Record) -> bool:
    """Whether the last value came faster than heat does, seen from the last one believed."""
    believed_at, believed_c = record[0]
    for time_s, value in record:
        minutes = (time_s - believed_at) / 60.0
        may_change_c = sensor["max_rate_c_per_min"] * minutes + CLEARLY * sensor["resolution_c"]
        if abs(value - believed_c) <= may_change_c:
            believed_at, believed_c = time_s, value
    return believed_at != record[-1][0]


def _stands_still(machine: Body, sensor: Body, records: Mapping[str, Record]) -> bool:
    """Whether the neighbours moved since the last change, `stuck_after_s` ago or more."""
    if sensor["stuck_after_s"] is None:
        return False
    record = records[sensor["name"]]
    since_s = last_s = record[-1][0]
    for time_s, value in reversed(record):
        if value != record[-1][1] or since_s - time_s > sensor["max_age_s"]:
            break
        since_s = time_s
    until_s = last_s - sensor["stuck_after_s"]
    if until_s < since_s:
        return False
    steps = [abs(b - a) for (_, a), (_, b) in pairwise(record) if a != b]
    clear_c = CLEARLY * max(sensor["resolution_c"], min(steps, default=0.0))
    moved = []
    for other in machine["sensors"]:
        if other["name"] != sensor["name"]:
            since = [o for o in _in_range(other, records.get(other["name"], [])) if o[0] >= since_s]
            values = [value for time_s, value in since if time_s <= until_s]
            if since:
                moved.append(max(values) - min(values) if values else 0.0)
    return bool(moved) and sorted(moved)[(len(moved) - 1) // 2] >= clear_c


def stated(machine: Body, temperatures_c: Mapping[str, float]) -> Sensors:
    """Judge temperatures that a request states: there is no age."""
    limits = {s["name"]: (s["min_c"], s["max_c"]) for s in machine["sensors"]}
    usable = {n: t for n, t in temperatures_c.items() if limits[n][0] <= t <= limits[n][1]}
    return Sensors(usable, {}, None)


def table(
    machine: Body, maps: Collection[Body], assignment: Mapping[str, str], sensors: Sensors
) -> dict[str, Line]:
    """Evaluate every component that two maps have.

    Raises
    ------
    NoTable
        Where a component has no sensor that could serve, or the machine's policy allows no answer.
    """
    having: dict[str, list[tuple[Body, Body]]] = {}
    for one in maps:
        for part in one["components"]:
            having.setdefault(part["component"], []).append((one, part))
    found = {
        code: _line(machine, code, assignment.get(code, CHAPTER[code]), of, sensors)
        for code, of in having.items()
        if len(of) > 1
    }
    if not found:
        raise NoTable("no component has two maps")
    return found


def _line(
    machine: Body,
    code: str,
    assigned: str,
    having: Sequence[tuple[Body, Body]],
    sensors: Sensors,
) -> Line:
    sensor, live_c = _serving(machine, assigned, sensors)
    ordered = sorted(having, key=lambda pair: pair[0]["temperatures_c"][sensor])
    scale = [one["temperatures_c"][sensor] for one, _ in ordered]
    lower, weight, status = _between(machine, scale, live_c)
    if sensor != assigned and status in ("interpolated", "at-map"):
        status = "stand-in"
    (map_n, part_n), (map_m, part_m) = ordered[lower], ordered[lower + 1]
    if weight == 0.0:
        in_use = [part_n]
    elif weight == 1.0:
        in_use = [part_m]
    else:
        in_use = [part_n, part_m]
    shares = [1.0] if len(in_use) == 1 else [1.0 - weight, weight]
    positions = _positions(in_use)

    def combined(name: str) -> list[float] | None:
        rows = [_values(part, positions, name) for part in in_use]
        if any(row is None for row in rows):
            return None
        return [
            sum(share * value for share, value in zip(shares, column, strict=True))
            for column in zip(*[row for row in rows if row is not None], strict=True)
        ]

    errors = combined("errors")
    assert errors is not None
    variances = [_variances(part, positions) for part in in_use]
    standard_errors = None
    if 0.0 <= weight <= 1.0 and all(v is not None for v in variances):
        standard_errors = [
            math.sqrt(sum(share**2 * v for share, v in zip(shares, column, strict=True)))
            for column in zip(*[v for v in variances if v is not None], strict=True)
        ]
    return Line(
        code,
        positions,
        errors,
        combined("backward_errors"),
        standard_errors,
        sensor,
        live_c,
        map_n["label"],
        map_m["label"],
        weight,
        status,
        _is_whole([part for _, part in having], positions),
    )


def _serving(machine: Body, assigned: str, sensors: Sensors) -> tuple[str, float]:
    """Take the assigned sensor, else the first stand-in that can be used, else an old value."""
    stand_in = {s["name"]: s["stand_in"] for s in machine["sensors"]}
    chain: list[str] = []
    name: str | None = assigned
    while name is not None and name not in chain:
        chain.append(name)
        name = stand_in[name]
    for known in (sensors.usable, sensors.stale):
        for one in chain:
            if one in known:
                return one, known[one]
    raise NoTable(f"nothing can serve for {assigned}")


def _between(machine: Body, scale: Sequence[float], live_c: float) -> tuple[int, float, str]:
    """Find the maps T_n ≤ T_u ≤ T_m, the share (T_u − T_n)/(T_m − T_n), and what to call it."""
    if live_c in scale:
        place = scale.index(live_c)
        last = place == len(scale) - 1
        return place - last, float(last), "at-map"
    for lower, (t_n, t_m) in enumerate(pairwise(scale)):
        if t_n < live_c < t_m:
            return lower, (live_c - t_n) / (t_m - t_n), "interpolated"
    below = live_c < scale[0]
    lower = 0 if below else len(scale) - 2
    policy = machine["out_of_range"]
    if policy == "clamp":
        return lower, 0.0 if below else 1.0, "clamped"
    beyond_c = scale[0] - live_c if below else live_c - scale[-1]
    if policy == "reject" or beyond_c > machine["extrapolation_margin_c"]:
        raise NoTable(f"{live_c} °C is outside the maps")
    weight = (live_c - scale[lower]) / (scale[lower + 1] - scale[lower])
    # Of two maps that state no uncertainty: (1 − w)² + w² ≤ ratio².
    root = math.sqrt(2.0 * machine["extrapolation_error_ratio"] ** 2 - 1.0)
    low, high = (1.0 - root) / 2.0, (1.0 + root) / 2.0
    if low <= weight <= high:
        return lower, weight, "extrapolated"
    return lower, min(max(weight, low), high), "clamped"


def _positions(parts: Sequence[Body]) -> list[float] | None:
    """Unite the positions of the maps in use inside the range that they share."""
    if "positions_mm" not in parts[0]:
        return None
    low = max(part["positions_mm"][0] for part in parts)
    high = min(part["positions_mm"][-1] for part in parts)
    return sorted({p for part in parts for p in part["positions_mm"] if low <= p <= high})


def _is_whole(parts: Sequence[Body], positions: list[float] | None) -> bool:
    """Whether a line reaches as far as any map of its component."""
    if positions is None:
        return True
    return positions[0] == min(p["positions_mm"][0] for p in parts) and positions[-1] == max(
        p["positions_mm"][-1] for p in parts
    )


def _field(part: Body, name: str) -> Any:
    """Find a field by its name without the unit; None where it is not there."""
    for unit in ("um", "urad"):
        if f"{name}_{unit}" in part:
            return part[f"{name}_{unit}"]
    return None


def _values(part: Body, positions: list[float] | None, name: str) -> list[float] | None:
    if positions is None:
        return [part["value_um_per_m"]] if name == "errors" else None
    row = _field(part, name)
    if row is None:
        return None
    return [_line_between(part["positions_mm"], row, p) for p in positions]


def _line_between(x: Sequence[float], y: Sequence[float], at: float) -> float:
    for (x0, y0), (x1, y1) in pairwise(zip(x, y, strict=True)):
        if x0 <= at <= x1:
            return float(y0 + (y1 - y0) * (at - x0) / (x1 - x0))
    raise ValueError(f"{at} mm is outside {x[0]} to {x[-1]} mm")


def _variances(part: Body, positions: list[float] | None) -> list[float] | None:
    if positions is None:
        return None
    errors = _field(part, "standard_errors")
    if errors is None:
        return None
    x = part["positions_mm"]
    found = []
    for p in positions:
        for (x0, s0), (x1, s1) in pairwise(zip(x, errors, strict=True)):
            if x0 <= p <= x1:
                share = (p - x0) / (x1 - x0)
                found.append((1.0 - share) ** 2 * s0**2 + share**2 * s1**2)
                break
    return found


def differences(answer: Body, expected: Mapping[str, Line], version: int | None) -> list[str]:
    """Hold an answer against what it must be; an empty list where all of it agrees."""
    found = []
    if version is not None and answer["model_version"] != version:
        found.append(f"model version {answer['model_version']}, expected {version}")
    lines = {line["component"]: line for line in answer["components"]}
    if lines.keys() != expected.keys():
        found.append(f"components {sorted(lines)}, expected {sorted(expected)}")
    for code in lines.keys() & expected.keys():
        found += _differences_of_line(lines[code], expected[code])
    return found


def _differences_of_line(line: Body, expected: Line) -> list[str]:
    found = [
        f"{name} {line[name]}, expected {getattr(expected, name)}"
        for name in ("sensor", "lower_map", "upper_map", "status", "temperature_c")
        if line[name] != getattr(expected, name)
    ]
    if abs(line["weight"] - expected.weight) > 1e-6 * max(1.0, abs(expected.weight)):
        found.append(f"weight {line['weight']}, expected {expected.weight}")
    if line.get("positions_mm") != expected.positions_mm:
        found.append(f"positions {line.get('positions_mm')}, expected {expected.positions_mm}")
        return [f"{expected.code}: {words}" for words in found]
    minus = [-value for value in expected.errors]
    minus_backward = expected.backward_errors and [-v for v in expected.backward_errors]
    for name, values in (
        ("errors", expected.errors),
        ("compensation", minus),
        ("backward_errors", expected.backward_errors),
        ("backward_compensation", minus_backward),
        ("standard_errors", expected.standard_errors),
    ):
        came = _came(line, name)
        if (came is None) != (values is None):
            found.append(f"{name} {came}, expected {values}")
        elif values is not None and came is not None:
            is_right = len(came) == len(values) and all(
                abs(a - b) <= HALF_A_DIGIT for a, b in zip(came, values, strict=True)
            )
            if not is_right:
                found.append(f"{name} {came}, expected {values}")
    return [f"{expected.code}: {words}" for words in found]


def _came(line: Body, name: str) -> list[float] | None:
    """Find numbers in a line of an answer, whatever their unit."""
    single = {"errors": "error_um_per_m", "compensation": "compensation_um_per_m"}
    value = _field(line, name)
    if value is None and name in single:
        value = line.get(single[name])
    if value is None or isinstance(value, list):
        return value
    return [value]
