"""Effects that tests adopt on the example machine, and readings that drive them."""

import math
from dataclasses import replace
from datetime import timedelta
from itertools import pairwise

import numpy as np
from pydantic import TypeAdapter

from app.effects.driver import (
    AboveReference,
    Always,
    Behind,
    BeyondMaps,
    SinceReference,
    State,
    StepAfter,
)
from app.effects.effect import Effect
from app.effects.response_columns import LATE, STATE, Column
from app.effects.response_driver import Responding, written, written_root
from app.effects.shape import Everywhere, Rising, Sensitivity, Wave
from app.effects.term import Term
from app.effects.valid import Valid
from app.services.adopt_analysis import version_with_effects
from app.services.change_model import changing_machine
from tests.service_examples import ROOM, START, iso, reading

HALF = Rising(250.0, 250.0)


def as_stored(part):
    """What a model version stores of a part of an effect."""
    return TypeAdapter(type(part)).dump_python(part, mode="json", by_alias=True)


def read_back(kind, written):
    return TypeAdapter(kind).validate_python(written)


LEARNT_FROM, LEARNT_TO = START - timedelta(days=30), START + timedelta(days=2)


def learnt(effect, days=30.0, **ranges):
    """An effect that was learnt in all that these tests do, or in the ranges that are given.

    What grows with time may be used for `days` after it was learnt.
    """
    names = ("x-middle", "y-front", "z-column", "spindle")
    grows = any(term.driver.grows_with_time for term in effect.terms)
    wide = {
        "from_s": LEARNT_FROM.timestamp(),
        "to_s": LEARNT_TO.timestamp(),
        "temperatures_c": dict.fromkeys(names, (-10.0, 80.0)),
        "state": dict.fromkeys(effect.states, (0.0, 12_000.0)),
        "positions_mm": dict.fromkeys(effect.components, (0.0, 500.0)),
        "use_until_s": LEARNT_TO.timestamp() + 86400.0 * days if grows else None,
    }
    return replace(effect, valid=Valid(**wide | ranges))


TAU_S = 600.0
LAG = learnt(
    Effect(
        "thermal-lag",
        ("EZZ",),
        ("z-column",),
        parameters={"time_constant_min": TAU_S / 60.0, "share": 1.0},
        terms=(Term("EZZ", Behind("z-column", TAU_S), Sensitivity(is_local=False)),),
    )
)
SPEED = learnt(
    Effect(
        "state-variable",
        ("EXX",),
        states=("spindle_rpm",),
        variant="at once",
        parameters={"slope_um_per_spindle_rpm": 0.001},
        terms=(Term("EXX", State("spindle_rpm"), Everywhere(), 0.001),),
    )
)
SPEED_LATE = learnt(
    Effect(
        "state-variable",
        ("EXX",),
        states=("spindle_rpm",),
        variant="late",
        parameters={"slope_um_per_spindle_rpm": 0.001, "time_constant_min": 15.0},
        terms=(Term("EXX", State("spindle_rpm", 1, 900.0), Everywhere(), 0.001),),
    )
)
SPINDLE_LATE = learnt(
    Effect(
        "additional-sensor",
        ("EXX",),
        ("spindle",),
        variant="beyond the maps, late",
        parameters={"time_constant_min": TAU_S / 60.0, "slope_um_per_k": 1.5},
        terms=(
            Term(
                "EXX",
                # Where x-middle reads t, the spindle reads t + 5: in every map, and after that.
                BeyondMaps("spindle", "", "x-middle", ((20.0, 25.0), (30.0, 35.0)), TAU_S),
                Everywhere(),
                1.5,
                learnt=(-3.0, 3.0),
            ),
        ),
    ),
    temperatures_c={"x-middle": (-10.0, 80.0)},
)
BACKLASH = learnt(
    Effect(
        "backlash",
        ("EXX",),
        variant="constant",
        parameters={"reversal_um": 3.0},
        terms=(Term("EXX", Always(), Everywhere(), 1.5, is_reversing=True),),
    )
)
SINE = learnt(
    Effect(
        "periodic",
        ("EXX",),
        parameters={"pitch_mm": 20.0, "amplitude_um": 2.0, "phase_deg": 0.0},
        terms=(Term("EXX", Always(), Wave(20.0, is_cosine=False), 2.0),),
    )
)
ROLL = learnt(
    Effect(
        "angular",
        ("EAX",),
        variant="constant",
        parameters={"angle_urad": 7.0, "angle_rise_urad": 4.0},
        terms=(Term("EAX", Always(), Everywhere(), 7.0), Term("EAX", Always(), HALF, 4.0)),
    )
)
SLOPE = learnt(
    Effect(
        "nonrigid-slope",
        ("EXX^z",),
        ("spindle",),
        variant="with temperature",
        parameters={"slope_um_per_m_per_k": 2.0},
        terms=(Term("EXX^z", AboveReference("spindle", 25.0), Everywhere(), 2.0),),
    )
)
DRIFT = learnt(
    Effect(
        "drift",
        ("SXY",),
        parameters={"drift_um_per_m_per_day": 2.0},
        terms=(Term("SXY", SinceReference(START.timestamp() - 86400.0), Everywhere(), 2.0),),
    )
)
OUTDATED = learnt(
    Effect(
        "outdated-map",
        ("EXX",),
        variant="shift",
        parameters={"shift_um": 3.0},
        terms=(Term("EXX", Always(), Everywhere(), 3.0),),
    )
)


def fault(sensor, codes, bias_k=1.5):
    changed_s = START.timestamp() - 3600.0
    term = (StepAfter(changed_s), Sensitivity(is_local=True), -bias_k)
    return learnt(
        Effect(
            "sensor-fault",
            codes,
            (sensor,),
            variant="bias",
            parameters={"bias_k": bias_k, "changed_at_unix_s": changed_s},
            terms=tuple(Term(code, *term) for code in codes),
        )
    )


def response(code, sensor):
    """A response of a component to one sensor, at once and late, of which nearly all is sure."""
    columns = (Column(LATE, sensor, 0.0), Column(LATE, sensor, 20.0))
    return _response(code, columns, (2.0, 1.0), (sensor,))


def response_of_all(code):
    """A response of a component to several sensors and the spindle, late by minutes and hours."""
    columns = (
        *(
            Column(LATE, name, late)
            for name in ("x-middle", "y-front")
            for late in (0.0, 20.0, 80.0)
        ),
        *(Column(STATE, "spindle_rpm", late) for late in (3.0, 15.0, 90.0, 400.0)),
    )
    amplitudes = (0.6, -0.8, 1.5, 0.3, 0.5, -1.0, 2e-4, 4e-4, 6e-4, 8e-4)
    return _response(code, columns, amplitudes, ("x-middle", "y-front"), ("spindle_rpm",))


def _response(code, columns, amplitudes, sensors, states=()):
    driver = Responding(
        columns=columns,
        references_c=(),
        level_c=22.0,
        ranges=tuple((0.0, 5000.0) if c.is_of_state else (-20.0, 20.0) for c in columns),
        days_s=(0.0,),
        drift_span_s=86400.0,
        coefficients=written([amplitudes, amplitudes]),
        spread=written_root(1e-12 * np.eye(len(columns))),
        noise=(0.1, 0.01, 300.0, 0.01, 200.0),
        longest_min=240.0,
    )
    told = ("held_out_before_um", "held_out_after_um", "worst_before_um", "worst_after_um")
    parameters = {"set_ups": 12.0, **dict.fromkeys(told, 1.0)}
    terms = (Term(code, driver),)
    return learnt(Effect("response", (code,), sensors, states, parameters=parameters, terms=terms))


def adopt(service, *effects, machine_id="mcfv5050", accept_losses=True):
    """Adopt effects, whether or not readings state what they need."""
    context = service.state.context
    with changing_machine(context, machine_id) as change:
        return version_with_effects(
            context, change, effects, "adopted in a test", accept_losses=accept_losses
        )


def warm_up(minutes=70, start=START):
    """A reading a minute up to the start: a slow rise with a wave, and a speed that changes."""
    found = []
    for minute in range(minutes + 1):
        t_c = 22.0 + 0.05 * minute + 0.4 * math.sin(minute / 7.0)
        state = {"spindle_rpm": 1000.0 * (minute // 9 % 4)}
        time = start - timedelta(minutes=minutes - minute)
        found.append(reading(time, round(t_c, 3), state=state))
    return found


async def stored(client, readings):
    answer = await client.post(f"{ROOM}/readings", json=readings)
    assert answer.status_code == 201, answer.text


async def current(client):
    answer = await client.get(f"{ROOM}/compensation")
    assert answer.status_code == 200, answer.text
    return answer.json()


async def predicted(client, *observations, time=START):
    asked = [{"time": iso(time), **observation} for observation in observations]
    body = {"observations": asked, "missing_components": "zero"}
    answer = await client.post(f"{ROOM}/predictions", json=body)
    assert answer.status_code == 200, answer.text
    return answer.json()


def numbers(document):
    """All numbers of a table, one after the other."""
    return np.concatenate(
        [
            np.atleast_1d(value)
            for entry in document["components"]
            for name, value in sorted(entry.items())
            if "error" in name or "compensation" in name or name == "positions_mm"
        ]
    )


def low_pass_by_steps(readings, value, tau_s):
    """The filter once more, by small steps of Euler's rule along lines between readings."""
    values = [value(r) for r in readings]
    y = values[0]
    for a, b in pairwise(values):
        for i in range(500):
            u = a + (b - a) * (i + 0.5) / 500
            y += (u - y) * (60.0 / 500) / tau_s
    return y


ALL = (LAG, SPEED, SPEED_LATE, SPINDLE_LATE, BACKLASH, SINE, ROLL, SLOPE, DRIFT)
