"""Sensors that show something else than the truth; the machine's errors stay what they are.

So the effect is in the residual: the error at the true temperature minus what exact maps say
at the one that is shown. It has one signature over all components of the sensor. How large it is
follows from how wrong the sensor is; what a believable fault cannot do, a thermally more
sensitive machine does.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from app.simulation.undeclared.components import ASSIGNED_SENSORS, COMPONENTS, FloatArray, following
from app.simulation.undeclared.duty_cycle import DAY_MIN
from app.simulation.undeclared.effect import Effect, Parameter
from app.simulation.undeclared.setting import Setting, table_difference

BIASES_C: Final = (0.5, 3.0)
SPIKES_C: Final = (3.0, 6.0)
SHARE_OF_SPIKES: Final = 0.1
TRIALS: Final = 40
LATE_MIN: Final = (10.0, 40.0)
AT_END_C: Final = (1.0, 3.0)

SHARES: Final = (0.4, 0.8)
"""Of its body in what a detached sensor shows."""


def sensor_fault(setting: Setting) -> Effect:
    """Let one of the sensors that components follow fail: a bias, a standstill or spikes."""
    sound = [sensor for sensor in ASSIGNED_SENSORS if sensor not in setting.faulty]
    if not sound:
        raise ValueError("expected a sensor without a fault, got none")
    sensor = str(setting.rng.choice(sound))
    make = {"bias": _biased, "stuck": _stuck, "spikes": _with_spikes}[setting.variant]
    return setting.fitted(make(setting, sensor))


def _biased(setting: Setting, sensor: str) -> Effect:
    """Shift a sensor from some time on, by so much that the machine need not be changed."""
    from_min = float(np.floor(setting.choose_moment_min(0.2, 0.6)))
    from_then_on = setting.history.minutes >= from_min
    true_c = setting.history.temperatures_c[sensor]
    sign = float(setting.rng.choice([-1.0, 1.0]))

    def biased(size_c: float) -> Effect:
        shown_c = true_c + sign * size_c * from_then_on
        return _misread(setting, {sensor: shown_c}, from_min=from_min, bias_c=sign * size_c)

    per_kelvin = setting.amplitude(biased(1.0))
    return biased(float(np.clip(setting.amplitude_um / per_kelvin, *BIASES_C)))


def _with_spikes(setting: Setting, sensor: str) -> Effect:
    """Let single minutes of a sensor jump from some time on."""
    from_min = float(np.floor(setting.choose_moment_min(0.1, 0.4)))
    minutes = setting.history.minutes
    size = float(setting.rng.uniform(*SPIKES_C) * setting.rng.choice([-1.0, 1.0]))
    jumps = setting.rng.uniform(size=minutes.size) < SHARE_OF_SPIKES
    sizes = setting.rng.uniform(0.5, 1.5, minutes.size)
    shown_c = setting.history.temperatures_c[sensor] + size * sizes * jumps * (minutes >= from_min)
    return _misread(
        setting,
        {sensor: shown_c},
        from_min=from_min,
        spike_c=size,
        share_of_readings=SHARE_OF_SPIKES,
    )


def _stuck(setting: Setting, sensor: str) -> Effect:
    """Try some standstills and take the one whose amplitude is nearest to the wanted one."""
    trials = [_standstill(setting, sensor) for _ in range(TRIALS)]
    wanted = np.log(max(setting.amplitude_um, 1e-9))
    away = [abs(np.log(max(setting.amplitude(trial), 1e-9)) - wanted) for trial in trials]
    return trials[int(np.argmin(away))]


def _standstill(setting: Setting, sensor: str) -> Effect:
    """Hold a sensor's value for three hours to four days."""
    true_c, minutes = setting.history.temperatures_c[sensor], setting.history.minutes
    from_min = np.floor(setting.choose_moment_min(0.1, 0.8))
    lasts = np.floor(np.exp(setting.rng.uniform(np.log(180.0), np.log(6000.0))))
    to_min = min(from_min + lasts, float(minutes[-1]))
    is_stuck = (minutes >= from_min) & (minutes < to_min)
    shown_c = np.where(is_stuck, setting.history.at(true_c, np.array([from_min]))[0], true_c)
    return _misread(setting, {sensor: shown_c}, from_min=float(from_min), to_min=float(to_min))


def exchanged_sensors(setting: Setting) -> Effect:
    """Exchange the plugs of the two sensors that components follow, or of one and another.

    The model asks its maps at the other place's temperature.
    """
    if setting.variant == "both-followed":
        first, other = ASSIGNED_SENSORS
    else:
        first = str(setting.rng.choice(ASSIGNED_SENSORS))
        other = setting.choose_other_sensor(first, but=ASSIGNED_SENSORS)
    true_c = setting.history.temperatures_c
    return setting.fitted(_misread(setting, {first: true_c[other], other: true_c[first]}))


def late_sensor(setting: Setting) -> Effect:
    """Let one of the sensors that components follow show what was so some time ago."""
    sensor = str(setting.rng.choice(ASSIGNED_SENSORS))
    late_min = float(setting.rng.uniform(*LATE_MIN))
    history = setting.history
    shown_c = history.at(history.temperatures_c[sensor], history.minutes - late_min)
    return setting.fitted(_misread(setting, {sensor: shown_c}, late_min=late_min))


def ageing_sensor(setting: Setting) -> Effect:
    """Let the bias of one of the sensors that components follow grow evenly during the visits."""
    sensor = str(setting.rng.choice(ASSIGNED_SENSORS))
    times_min = setting.visit_times_min
    since_min, days = float(times_min[0]), float(np.ptp(times_min)) / DAY_MIN
    at_end_c = float(setting.rng.choice([-1.0, 1.0]) * setting.rng.uniform(*AT_END_C))
    grown = np.maximum(setting.history.minutes - since_min, 0.0) / DAY_MIN
    shown_c = setting.history.temperatures_c[sensor] + at_end_c / days * grown
    effect = _misread(
        setting, {sensor: shown_c}, bias_c_per_day=at_end_c / days, since_min=since_min
    )
    return setting.fitted(effect)


def detached_sensor(setting: Setting) -> Effect:
    """Let a sensor come half off after the maps: it shows something between body and room."""
    sensor = str(setting.rng.choice(ASSIGNED_SENSORS))
    share = float(setting.rng.uniform(*SHARES))
    true_c = setting.history.temperatures_c
    shown_c = share * true_c[sensor] + (1.0 - share) * true_c["ambient"]
    effect = setting.fitted(_misread(setting, {sensor: shown_c}, share=share))
    return replace(effect, sensors=(sensor, "ambient"))


def _misread(
    setting: Setting, shown_c: Mapping[str, FloatArray], **parameters: Parameter
) -> Effect:
    """Make the effect of sensors that show something else than the truth.

    Parameters
    ----------
    shown_c : mapping of sensor to ndarray, shape (n,) [°C]
        What they show in all minutes of the history.
    """
    codes = tuple(
        code
        for sensor in shown_c
        for code in following(sensor)
        if code not in setting.machine.unmeasured
    )
    tables = {code: setting.machine.table(code) for code in codes}
    return setting.effect(
        {
            code: table_difference(
                code, table, table, other_c=shown_c[COMPONENTS[code].sensor], clamp=True
            )
            for code, table in tables.items()
        },
        sensors=tuple(shown_c),
        parameters=parameters,
        sensitive=codes,
        shown_c=shown_c,
    )
