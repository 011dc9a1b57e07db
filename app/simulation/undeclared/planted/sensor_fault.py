"""A sensor reads wrong from some time on; the machine's errors stay what they are.

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

from app.simulation.undeclared.components import (
    ASSIGNED_SENSORS,
    COMPONENTS,
    FloatArray,
    following,
)
from app.simulation.undeclared.effect import Effect, Parameter
from app.simulation.undeclared.observations import Circumstances, ErrorFunction
from app.simulation.undeclared.setting import Setting

VARIANTS: Final = ("bias", "stuck", "spikes")

BIASES_C: Final = (0.5, 3.0)
SPIKES_C: Final = (3.0, 6.0)
SHARE_OF_SPIKES: Final = 0.1
TRIALS: Final = 40


def plant(setting: Setting, variant: str) -> Effect:
    """Let one of the sensors that components follow fail."""
    sound = [sensor for sensor in ASSIGNED_SENSORS if sensor not in setting.faulty]
    if not sound:
        raise ValueError("expected a sensor without a fault, got none")
    sensor = str(setting.rng.choice(sound))
    make = {"bias": _biased, "stuck": _stuck, "spikes": _with_spikes}[variant]
    return fitted(setting, make(setting, sensor))


def _biased(setting: Setting, sensor: str) -> Effect:
    """Shift a sensor from some time on, by so much that the machine need not be changed."""
    from_min = float(np.floor(setting.choose_moment_min(0.2, 0.6)))
    from_then_on = setting.history.minutes >= from_min
    true_c = setting.history.temperatures_c[sensor]
    sign = float(setting.rng.choice([-1.0, 1.0]))

    def biased(size_c: float) -> Effect:
        parameters: dict[str, Parameter] = {"from_min": from_min, "bias_c": sign * size_c}
        return _effect(setting, "bias", sensor, true_c + sign * size_c * from_then_on, parameters)

    per_kelvin = setting.amplitude(biased(1.0))
    return biased(float(np.clip(setting.amplitude_um / per_kelvin, *BIASES_C)))


def _with_spikes(setting: Setting, sensor: str) -> Effect:
    """Let single minutes of a sensor jump from some time on."""
    from_min = float(np.floor(setting.choose_moment_min(0.1, 0.4)))
    minutes = setting.history.minutes
    size = float(setting.rng.uniform(*SPIKES_C) * setting.rng.choice([-1.0, 1.0]))
    jumps = setting.rng.uniform(size=minutes.size) < SHARE_OF_SPIKES
    sizes = setting.rng.uniform(0.5, 1.5, minutes.size)
    read_c = setting.history.temperatures_c[sensor] + size * sizes * jumps * (minutes >= from_min)
    parameters: dict[str, Parameter] = {
        "from_min": from_min,
        "spike_c": size,
        "share_of_readings": SHARE_OF_SPIKES,
    }
    return _effect(setting, "spikes", sensor, read_c, parameters)


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
    read_c = np.where(is_stuck, setting.history.at(true_c, np.array([from_min]))[0], true_c)
    parameters: dict[str, Parameter] = {"from_min": float(from_min), "to_min": float(to_min)}
    return _effect(setting, "stuck", sensor, read_c, parameters)


def fitted(setting: Setting, effect: Effect) -> Effect:
    """Reach the wanted amplitude by the components' sensitivity, unless another effect set it."""
    if setting.machine.sensitivities.keys() & effect.components:
        return replace(effect, sensitive=())
    return setting.scaled(effect)


def misread(
    setting: Setting,
    kind: str,
    variant: str,
    shown_c: Mapping[str, FloatArray],
    parameters: dict[str, Parameter],
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
    return Effect(
        kind,
        variant,
        codes,
        {code: _misread(setting, code, shown_c[COMPONENTS[code].sensor]) for code in codes},
        sensors=tuple(shown_c),
        parameters=parameters,
        sensitive=codes,
        shown_c=shown_c,
    )


def _effect(
    setting: Setting,
    variant: str,
    sensor: str,
    shown_c: FloatArray,
    parameters: dict[str, Parameter],
) -> Effect:
    return misread(setting, "sensor-fault", variant, {sensor: shown_c}, parameters)


def _misread(setting: Setting, code: str, shown_c: FloatArray) -> ErrorFunction:
    """Make the true error minus what exact maps say at the shown temperature."""
    table = setting.machine.table(code)
    axis = COMPONENTS[code].axis or 0

    def residual(circumstances: Circumstances) -> FloatArray:
        position = circumstances.point_mm[:, axis]
        true = table.at(position, circumstances.temperature(COMPONENTS[code].sensor))
        return true - table.at(position, circumstances.at(shown_c), clamp=True)

    return residual
