"""A lathe-like machine that shares nothing with the project's own simulator.

Bodies of first order with heat passing between them, spindle power in cycles, a room with days,
fronts and doors. Each component follows one body, whose sensor is the assigned one, linearly and
at once: without a cause the model is right but for the maps' own scatter. Causes are what people
and machines do, most of them in no library. Numbers come from one generator for each campaign.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from itertools import pairwise, product
from typing import Any, Final

import numpy as np

from app.arrays import FloatArray
from app.effects.hypothesis import IN_SERIES

BEGINS: Final = datetime(2025, 9, 1, tzinfo=UTC)
BODIES: Final = ("room", "bed", "headstock", "screw-x", "screw-z", "column")
SHARES: Final = {"bed": 0.15, "headstock": 0.6, "screw-x": 0.25, "screw-z": 0.35, "column": 0.1}
"""What the cycle's power puts into each body."""
TAU_MIN: Final = {"bed": 420.0, "headstock": 55.0, "screw-x": 80.0, "screw-z": 95.0, "column": 210}
RISE_K: Final = 14.0
FOLLOWS: Final = {
    "EXX": "screw-x",
    "EZZ": "screw-z",
    "EYX": "bed",
    "EXZ": "column",
    "EYZ": "headstock",
    "EBX": "bed",
    "SZX": "column",
}
"""Component, and the body that moves it."""
TRAVEL_MM: Final = {"x": 400.0, "y": 200.0, "z": 600.0}
POSITIONS: Final = 7
EVERY_MIN: Final = 4
"""Readings are sent as often [min]."""
DAYS: Final = 10
MAP_NOISE_UM: Final = 0.3

DOOR: Final = "door in the afternoon"
"""Where it stood open beside a map, that map is wrong, and the cause has a name for once."""

CAUSES: Final[Mapping[str, frozenset[str]]] = {
    "nothing": frozenset(),
    "play of a bolted joint": frozenset(),
    "product of temperatures": frozenset(),
    "saturating growth": frozenset({"temperature-curvature"}),
    "sensor placed between bodies": frozenset(
        {"other-sensor", "additional-sensor", "sensor-gradient", "detached-sensor"}
    ),
    DOOR: frozenset(),
    "flow on a relay": frozenset(),
    "relaxing after a crash": frozenset({"step", "drift"}),
    "plugs exchanged": frozenset({"exchanged-sensors"}),
    "one table with the wrong sign": frozenset({"map-factor"}),
    "an hour between the clocks": frozenset({"clock-offset"}),
    "one map's temperature noted 4 K too high": frozenset({"map-temperature"}),
    "lag of two bodies in turn": frozenset({"thermal-lag"}),
    "laser warms up": frozenset({"instrument-warm-up"}),
    "laser walks from visit to visit": frozenset(),
    "zeroed, declared absolute": frozenset(),
    "door open beside one map": frozenset({"wrong-map"}),
}
"""What each campaign has in it, and what kinds name it rightly (none: it is in no library)."""

FORMS: Final[Mapping[str, str]] = {"lag of two bodies in turn": IN_SERIES}
"""Causes that are another form of their kind. The kind alone would be another machine's cause: what
is said has to say the form too, as a tie or as a doubt."""


@dataclass(frozen=True)
class OutsideCampaign:
    """What a shop would send, and what is true later.

    Parameters
    ----------
    machine, error_maps, assignment, readings, verifications
        Bodies of requests.
    later
        A verification of later visits whose values are the machine's true errors.
    right : frozenset of str
        Kinds that name the cause rightly.
    components
        Those that the cause acts on, lower case; empty: any.
    form : str or None
        Form of these kinds that the cause has.
    """

    machine: dict[str, Any]
    error_maps: list[dict[str, Any]]
    assignment: dict[str, str]
    readings: list[dict[str, Any]]
    verifications: list[dict[str, Any]]
    later: dict[str, Any]
    right: frozenset[str]
    components: frozenset[str]
    form: str | None


def make_outside(
    seed: int, cause: str, visits: int = 24, size_um: float = 3.0, later: int = 12
) -> OutsideCampaign:
    """Simulate a campaign.

    Parameters
    ----------
    seed, cause
        One of `CAUSES`; the same seed has the same machine and weather.
    visits, later
        Numbers of visits that are sent, and of those after them.
    size_um
        About the standard deviation of what a cause adds [µm].
    """
    rng = np.random.default_rng([seed, 4711])
    n = DAYS * 1440
    minutes = np.arange(n, dtype=float)
    duty = _duty(rng, n)
    truth = _bodies(rng, minutes, duty)
    slopes = {code: _slope(rng, code) for code in FOLLOWS}
    profiles = {code: rng.normal(0.0, 2.0, 3) for code in FOLLOWS}
    struck = str(rng.choice(["EXX", "EZZ", "EYX", "EXZ", "EYZ"]))
    shape = rng.uniform(0.4, 1.0, 2)
    extra, all_struck = _extra(rng, cause, struck, truth, minutes, size_um)

    def error(code: str, u: FloatArray, minute: int) -> FloatArray:
        at = truth[FOLLOWS[code]] if extra is None or code != struck or _adds(cause) else extra
        level = slopes[code] * (at[minute] - 20.0)
        a, b, c = profiles[code]
        found = a * u + b * u**2 + c * np.sin(2.0 * u) + level[0] + level[1] * u
        if extra is not None and code == struck and _adds(cause):
            found = found + extra[minute] * (shape[0] + shape[1] * u)
        return np.asarray(found)

    sensors = _sensors(rng, cause, struck, truth)
    maps, mapped_at = _maps(rng, cause, struck, error, sensors, truth, size_um)
    right = CAUSES[cause]
    if cause == DOOR and extra is not None and extra[mapped_at].max() > extra.max() / 2.0:
        right |= {"wrong-map"}  # it stood open there
    starts = _starts(rng, visits + later)
    walk, settles = np.cumsum(rng.normal(0.0, 0.7, (visits + later, len(FOLLOWS))), axis=0), 8.0
    bodies: list[dict[str, Any]] = []
    for number, start in enumerate(starts):
        is_later = number >= visits
        rows: list[dict[str, Any]] = []
        zero: dict[str, float] = {}
        for n_code, code in enumerate(FOLLOWS):
            axis = code[2].lower() if code[0] == "E" else ""
            shift, tilt = rng.normal(0.0, 0.3), rng.normal(0.0, 0.15)
            drawn = rng.uniform(-1, 1, 3).tolist() if axis else [0.0]
            places = [*drawn, drawn[0]]
            for u_, sign in product(places[: 4 if axis else 1], ("+", "-")):
                minute = start + len(rows) // 2
                value = float(error(code, np.array([u_]), minute)[0])
                if not is_later:
                    value += shift + tilt * u_ + rng.normal(0.0, 0.8)
                    if cause == "laser warms up":
                        value += 1.5 * size_um * (1.0 - np.exp(-(minute - start) / settles))
                    if cause == "laser walks from visit to visit":
                        value += walk[number, n_code]
                    if cause == "zeroed, declared absolute":
                        zero.setdefault(code, value)
                        value -= zero[code]
                rows.append(_row(code, axis, u_, sign, minute, value))
        if cause == "an hour between the clocks":
            for row in rows:
                row["time"] += timedelta(hours=0 if is_later else 1)
        body = {"label": f"visit {number:02d}", "datum": "absolute", "observations": rows}
        bodies.append(body if is_later else body | {"repeatability_um": 0.8})
    together = [row for body in bodies[visits:] for row in body["observations"]]
    readings = [
        {
            "time": BEGINS + timedelta(minutes=float(m)),
            "temperatures_c": {s: round(float(t[int(m)]), 2) for s, t in sensors.items()},
            "state": {"power": round(float(duty[int(m)]), 2)},
        }
        for m in minutes[::EVERY_MIN]
    ]
    return OutsideCampaign(
        _machine(seed),
        maps,
        dict(FOLLOWS),
        readings,
        bodies[:visits],
        {"label": "later", "datum": "absolute", "observations": together},
        right,
        frozenset() if all_struck else frozenset({struck.lower()}),
        FORMS.get(cause),
    )


def _duty(rng: np.random.Generator, n: int) -> FloatArray:
    """Power of the spindle, 0 to 1, in shifts with pauses."""
    duty = np.zeros(n)
    for day in range(n // 1440):
        if day % 7 == 6:
            continue
        at = day * 1440 + int(rng.uniform(330, 420))
        while at < day * 1440 + 1200:
            length = int(rng.uniform(20, 160))
            duty[at : at + length] = rng.choice([0.0, 0.3, 0.6, 1.0])
            at += length
    return duty


def _bodies(
    rng: np.random.Generator, minutes: FloatArray, duty: FloatArray
) -> dict[str, FloatArray]:
    """Temperatures of all bodies [°C], minute by minute."""
    fronts = np.interp(
        minutes,
        np.arange(0, minutes[-1] + 2000, 1440),
        rng.normal(0, 1.5, minutes.size // 1440 + 2),
    )
    room = 20.5 + fronts + 1.8 * np.sin(2 * np.pi * (minutes / 1440 - 0.4))
    found = {"room": room}
    at = dict.fromkeys(SHARES, room[0])
    series: dict[str, list[float]] = {name: [] for name in SHARES}
    tau = {name: TAU_MIN[name] * rng.uniform(0.8, 1.25) for name in SHARES}
    for minute in range(minutes.size):
        mean = (at["headstock"] + at["column"]) / 2.0
        for name, share in SHARES.items():
            leads = room[minute] + RISE_K * share / 0.6 * duty[minute]
            coupled = 0.15 * (mean - at[name])
            at[name] += (leads - at[name] + coupled) / tau[name]
            series[name].append(at[name])
    return {**found, **{name: np.array(values) for name, values in series.items()}}


def _slope(rng: np.random.Generator, code: str) -> FloatArray:
    """Growth of level, and from the middle to the end of the travel, per kelvin."""
    size = 1.8 if code in ("EXX", "EZZ") else 0.8
    return np.array([rng.normal(0.0, 0.4), rng.choice([-1, 1]) * size * rng.uniform(0.6, 1.2)])


def _adds(cause: str) -> bool:
    """Whether a cause adds to the error; else the body's temperature is another one."""
    return cause not in ("lag of two bodies in turn", "saturating growth")


def _extra(
    rng: np.random.Generator,
    cause: str,
    struck: str,
    truth: Mapping[str, FloatArray],
    minutes: FloatArray,
    size_um: float,
) -> tuple[FloatArray | None, bool]:
    """What the cause adds in each minute, and whether it strikes more than one component."""
    own = truth[FOLLOWS[struck]]
    makers: dict[str, Callable[[], FloatArray]] = {
        "play of a bolted joint": lambda: _play(own, 2.5),
        "product of temperatures": lambda: (truth["headstock"] - 24.0) * (truth["room"] - 20.5),
        DOOR: lambda: _door(rng, minutes),
        "flow on a relay": lambda: _relay(truth["headstock"]),
        "relaxing after a crash": lambda: _crash(rng, minutes),
    }
    if cause in makers:
        raw = makers[cause]()
        return size_um * (raw - raw.mean()) / max(float(np.std(raw)), 1e-9), False
    if cause == "lag of two bodies in turn":
        return _late(_late(own, 60.0), 35.0), False
    if cause == "saturating growth":
        over = own - own.min()
        full = float(np.percentile(over, 70)) + 0.5
        return own.min() + full * (1.0 - np.exp(-over / full)) * 1.6, False
    several = ("plugs exchanged", "an hour", "sensor placed", "one map's", "laser", "zeroed")
    return None, cause.startswith((*several, "nothing"))


def _play(own: FloatArray, width_k: float) -> FloatArray:
    """The play operator: it stays until the temperature has gone back by the width."""
    at, found = own[0], np.empty(own.size)
    for i, t in enumerate(own):
        at = min(max(at, t - width_k / 2), t + width_k / 2)
        found[i] = t - at
    return found


def _relay(own: FloatArray) -> FloatArray:
    """A pump that starts above one temperature and stops below another."""
    high, low = np.percentile(own, [70, 45])
    on, found = False, np.empty(own.size)
    for i, t in enumerate(own):
        on = t > (low if on else high)
        found[i] = on
    return _late(found, 20.0)


def _door(rng: np.random.Generator, minutes: FloatArray) -> FloatArray:
    """A gate that stands open for some afternoons, nobody notes when."""
    is_open = np.zeros(minutes.size)
    for day in range(DAYS):
        if rng.random() < 0.6:
            at = day * 1440 + int(rng.uniform(700, 1000))
            is_open[at : at + int(rng.uniform(40, 200))] = 1.0
    return _late(is_open, 25.0)


def _crash(rng: np.random.Generator, minutes: FloatArray) -> FloatArray:
    """A step that goes back by two thirds within some days."""
    since = (minutes - rng.uniform(3, 6) * 1440) / 1440.0
    return np.where(since > 0, 1.0 / 3.0 + 2.0 / 3.0 * np.exp(-np.maximum(since, 0) / 1.5), 0.0)


def _late(series: FloatArray, tau_min: float) -> FloatArray:
    """Late by a first-order body [same unit]."""
    at, found, share = series[0], np.empty(series.size), 1.0 - np.exp(-1.0 / tau_min)
    for i, value in enumerate(series):
        at += share * (value - at)
        found[i] = at
    return found


def _sensors(
    rng: np.random.Generator, cause: str, struck: str, truth: Mapping[str, FloatArray]
) -> dict[str, FloatArray]:
    """What the sensors read [°C]."""
    found = {name: truth[name] + 0.03 * rng.standard_normal(truth[name].size) for name in BODIES}
    body = FOLLOWS[struck]
    other = "column" if body == "headstock" else "headstock"
    if cause == "sensor placed between bodies":
        found[body] = 0.5 * found[body] + 0.5 * found[other]
    if cause == "plugs exchanged":
        found[body], found[other] = found[other], found[body]
    return found


def _maps(
    rng: np.random.Generator,
    cause: str,
    struck: str,
    error: Callable[[str, FloatArray, int], FloatArray],
    sensors: Mapping[str, FloatArray],
    truth: Mapping[str, FloatArray],
    size_um: float,
) -> tuple[list[dict[str, Any]], list[int]]:
    """Three maps over the range; plugs were still right then. And when the struck one was made."""
    u = np.linspace(-1.0, 1.0, POSITIONS)
    own = truth["headstock"]
    moments = [
        int(np.argmin(own)),
        int(np.argmin(np.abs(own - np.median(own)))),
        int(np.argmax(own)),
    ]
    wrong = int(rng.integers(len(moments))) if cause == "door open beside one map" else None
    found, mapped_at = [], []
    for number, minute in enumerate(moments):
        plugged = truth if cause == "plugs exchanged" else sensors
        temperatures = {name: float(plugged[name][minute]) for name in BODIES}
        # Each body is mapped from its coldest to its warmest, whenever that was.
        temperatures = _spread(temperatures, plugged, number)
        tables = []
        for code in FOLLOWS:
            series = plugged[FOLLOWS[code]]
            nearest = int(np.argmin(np.abs(series - temperatures[FOLLOWS[code]])))
            is_line = code[0] == "E"
            errors = error(code, u if is_line else np.zeros(1), nearest)
            errors = errors + rng.normal(0.0, MAP_NOISE_UM, errors.size)
            if code == struck:
                mapped_at.append(nearest)
            if cause == "one table with the wrong sign" and code == struck:
                errors = -errors
            if number == wrong and code == struck:
                errors = errors - size_um * (0.8 + 0.6 * u + 0.5 * u**2)
            tables.append(_table(code, u, errors))
        if cause == "one map's temperature noted 4 K too high" and number == 1:
            temperatures[FOLLOWS[struck]] += 4.0
        noted = {name: round(t, 2) for name, t in temperatures.items()}
        found.append(
            {
                "label": f"map {number + 1}",
                "measured_at": (BEGINS - timedelta(days=9 - number)).isoformat(),
                "temperatures_c": noted,
                "components": tables,
                "repeatability_um": MAP_NOISE_UM,
            }
        )
    return found, mapped_at


def _table(code: str, u: FloatArray, errors: FloatArray) -> dict[str, Any]:
    if code[0] == "S":
        return {"component": code, "value_um_per_m": round(float(errors[0]), 4)}
    unit = "urad" if code[1] in "ABC" else "um"
    return {
        "component": code,
        "positions_mm": [round(float(p), 3) for p in (u + 1) / 2 * TRAVEL_MM[code[2].lower()]],
        f"errors_{unit}": [round(float(e), 4) for e in errors],
    }


def _spread(
    temperatures: Mapping[str, float], series: Mapping[str, FloatArray], number: int
) -> dict[str, float]:
    """Give each body its coldest, middle or warmest temperature."""
    share = (0.0, 50.0, 100.0)[number]
    return {name: float(np.percentile(series[name], share)) for name in temperatures}


def _starts(rng: np.random.Generator, visits: int) -> list[int]:
    """Two or three visits a day from the second day on, at any hour of the shift."""
    per_day = visits / (DAYS - 2.0)
    days = 1 + np.floor(np.arange(visits) / per_day).astype(int)
    slots = [np.flatnonzero(days == day) for day in np.unique(days)]
    found = np.zeros(visits, dtype=int)
    for own in slots:
        edges = np.linspace(400, 1340, own.size + 1)
        found[own] = [
            days[own[0]] * 1440 + int(rng.uniform(low, high - 50)) for low, high in pairwise(edges)
        ]
    return [int(m) for m in found]


def _row(code: str, axis: str, u: float, sign: str, minute: int, value: float) -> dict[str, Any]:
    row: dict[str, Any] = {
        "time": BEGINS + timedelta(minutes=minute),
        "component": code,
        "measured_um": round(value, 4),
    }
    if axis:
        row |= {"position_mm": round((u + 1) / 2 * TRAVEL_MM[axis], 3), "direction": sign}
    return row


def _machine(seed: int) -> dict[str, Any]:
    return {
        "id": f"outside-{seed}",
        "name": f"Outside machine {seed}",
        "configuration": "XYFZ",
        "axes": {axis: {"min_mm": 0.0, "max_mm": mm} for axis, mm in TRAVEL_MM.items()},
        "sensors": [
            {"name": name, "min_c": -10.0, "max_c": 90.0, "max_age_s": 600.0} for name in BODIES
        ],
        "out_of_range": "clamp",
        "extrapolation_margin_c": 5.0,
    }
