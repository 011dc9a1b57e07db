"""What its motion, its load and time do to the machine, of which the maps have nothing."""

from __future__ import annotations

from typing import Final

import numpy as np

from app.simulation.undeclared.base_machine import POSITIONS, TRAVELS_MM, normalised
from app.simulation.undeclared.components import (
    AXES,
    COMPONENTS,
    MM_PER_M,
    ROTATIONS,
    SQUARENESS,
    TRANSLATIONS,
    FloatArray,
)
from app.simulation.undeclared.duty_cycle import (
    DAY_MIN,
    FASTEST_FEED_MM_PER_MIN,
    FASTEST_RPM,
    PAYLOADS_KG,
)
from app.simulation.undeclared.effect import Effect
from app.simulation.undeclared.history import low_pass
from app.simulation.undeclared.observations import Circumstances
from app.simulation.undeclared.setting import Profile, Setting

STATES: Final = {
    "speed": ("spindle_rpm", FASTEST_RPM, 1),
    "speed-squared": ("spindle_rpm", FASTEST_RPM, 2),
    "payload": ("payload_kg", PAYLOADS_KG[-1], 1),
    "feed": ("feed_mm_per_min", FASTEST_FEED_MM_PER_MIN, 1),
}
"""Name in the state, its largest value, and power."""

ROTATIONS_OF: Final = {
    "roll": ("EAX", "EBY", "ECZ"),
    "pitch": ("EBX", "EAY", "EAZ"),
    "yaw": ("ECX", "ECY", "EBZ"),
}
"""Rotation about the axis of motion, about a horizontal one across it, about the third."""


def state_variable(setting: Setting) -> Effect:
    """Let a state of the machine act on one component: spindle speed, its square, payload, feed.

    At once, or through a body with a time constant that no sensor sees. The maps were measured at
    rest and without payload, so they have nothing of it.
    """
    code = setting.choose_component()
    name, largest, power = STATES[setting.variant.removesuffix("-lagged")]
    profile = setting.choose_profile(code)
    series = (setting.history.state[name] / largest) ** power
    parameters: dict[str, float | str] = {"state": name, "power": power, "full_scale": largest}
    is_late = setting.variant.endswith("-lagged")
    if is_late:
        tau = setting.choose_time_constant_min(20.0, 120.0)
        series = low_pass(series, tau)
        parameters["time_constant_min"] = tau

    def driver(circumstances: Circumstances) -> FloatArray:
        if is_late:
            return circumstances.at(series)
        return circumstances.history.hold(series, circumstances.time_min)

    return setting.driven(profile, driver, "_at_full_scale", parameters=parameters)


def backlash(setting: Setting) -> Effect:
    """Give one axis a reversal error: usually in its own direction, now and then across.

    Half the value has the sign of the approach; it is constant, or grows along the axis. The maps
    have the mean of both directions.
    """
    along = [code for code in TRANSLATIONS if COMPONENTS[code].row == COMPONENTS[code].axis]
    across = [code for code in TRANSLATIONS if code not in along]
    code = setting.choose_component(along if setting.rng.uniform() < 0.7 else across)
    slope = 0.0 if setting.variant == "constant" else float(setting.rng.choice([-1, 1]))
    profile = Profile(code, -1.0, slope * setting.rng.uniform(0.4, 0.8))
    axis = COMPONENTS[code].axis or 0
    return setting.driven(
        profile,
        lambda circumstances: circumstances.observations.direction[:, axis],
        parameters={"axis": AXES[axis]},
        strengths={f"half_{name}": value for name, value in profile.named().items()},
    )


def periodic(setting: Setting) -> Effect:
    """Give one component a sine along its axis, that its maps have missed, or its harmonic too.

    The pitch of a screw, the period of a scale.
    """
    code = setting.choose_component(TRANSLATIONS)
    axis = COMPONENTS[code].axis or 0
    pitch = choose_pitch_mm(setting.rng, TRAVELS_MM[axis] / (POSITIONS - 1))
    phase, second_phase = setting.rng.uniform(0.0, 2 * np.pi, 2).tolist()
    share = 0.4 if setting.variant == "harmonic" else 0.0
    parameters: dict[str, float | str] = {"pitch_mm": pitch, "phase_rad": phase}
    strengths: dict[str, float | list[float]] = {"first_um": 1.0}
    if share:
        parameters["second_phase_rad"] = second_phase
        strengths["second_um"] = share

    def error(circumstances: Circumstances) -> FloatArray:
        turns = 2 * np.pi * circumstances.point_mm[:, axis] / pitch
        wave: FloatArray = np.sin(turns + phase) + share * np.sin(2 * turns + second_phase)
        return wave

    return setting.planted({code: error}, parameters=parameters, strengths=strengths)


def choose_pitch_mm(rng: np.random.Generator, step_mm: float) -> float:
    """Choose a pitch of 8 to 40 mm that no multiple of brings near the maps' step.

    Parameters
    ----------
    step_mm
        Distance of the maps' positions [mm].

    Returns
    -------
    float
        At least a tenth of a turn from any whole number of turns in a step.
    """
    while True:
        pitch = float(rng.uniform(8.0, 40.0))
        turns = step_mm / pitch
        if abs(turns - round(turns)) > 0.1:
            return pitch


def angular(setting: Setting) -> Effect:
    """Give one axis a roll, pitch or yaw that the maps leave out, and the machine has all of.

    It shows at points, through lever arms and tool.
    """
    visible = [code for code in ROTATIONS_OF[setting.variant] if _is_visible(setting, code)]
    code = setting.choose_component(visible)
    profile = setting.choose_profile(code)
    return setting.planted({code: profile}, strengths=profile.named(), unmeasured=(code,))


def _is_visible(setting: Setting, code: str) -> bool:
    """Whether it moves the tool's tip: the roll of Z turns about a tool that lies in Z."""
    effect = setting.effect({code: Profile(code, 1.0, 0.0)}, unmeasured=(code,))
    return setting.amplitude(effect) > 0.0


def nonrigid_slope(setting: Setting) -> Effect:
    """Let one component, a translation or a rotation, grow with the position of another axis.

    So the weight of a table bends its bed: slope × coordinate, the slope itself growing along the
    component's axis, for a constant one would be a squareness. On the component's own line the
    other axes stand at 0 and nothing is seen.
    """
    # The roll of Z turns about the tool, and does not move its tip.
    levered = [code for code in ROTATIONS if code != "ECZ"]
    code = setting.choose_component(TRANSLATIONS if setting.variant == "linear" else levered)
    axis = COMPONENTS[code].axis
    other = int(setting.rng.choice([i for i in range(3) if i != axis]))
    profile = Profile(code, float(setting.rng.uniform(-0.3, 0.3)), 1.0)
    return setting.driven(
        profile,
        lambda circumstances: circumstances.point_mm[:, other] / MM_PER_M,
        "_per_m",
        parameters={"slope": f"{code}^{AXES[other]}", "coordinate": AXES[other]},
    )


def drift(setting: Setting) -> Effect:
    """Let one component drift evenly from the first visit on: wear, creep, settling."""
    profile = setting.choose_profile(setting.choose_component())
    begins = float(setting.visit_times_min[0])
    return setting.driven(
        profile,
        lambda circumstances: (circumstances.time_min - begins) / DAY_MIN,
        "_per_day",
        parameters={"from_min": begins},
    )


def step(setting: Setting) -> Effect:
    """Change one component at one time between two visits: a collision, a re-levelling."""
    code = setting.choose_component(SQUARENESS if setting.variant == "squareness" else None)
    profile = setting.choose_profile(code)
    moment = setting.choose_moment_min()
    return setting.driven(
        profile,
        lambda circumstances: (circumstances.time_min >= moment).astype(float),
        parameters={"at_min": moment},
    )


def outdated_map(setting: Setting) -> Effect:
    """Change one component since its table was measured: a shift, a slope or a profile.

    A shift is the same in all values, so its amplitude is their root mean square.
    """
    code = choose_shaped(setting)
    axis = COMPONENTS[code].axis or 0
    legendre = legendre_of(setting.rng, setting.variant)

    def error(circumstances: Circumstances) -> FloatArray:
        u = normalised(code, circumstances.point_mm[:, axis])
        return np.asarray(np.polynomial.legendre.legval(u, legendre), dtype=np.float64)

    return setting.planted(
        {code: error},
        strengths={f"legendre_{COMPONENTS[code].unit}": legendre},
        about_zero=setting.variant == "shift",
    )


def choose_shaped(setting: Setting) -> str:
    """Choose a component that can have the variant's shape: of a squareness there is a shift."""
    return setting.choose_component(
        None if setting.variant == "shift" else TRANSLATIONS + ROTATIONS[:6]
    )


def legendre_of(rng: np.random.Generator, variant: str) -> list[float]:
    """Coefficients of the Legendre polynomials over the travel, from the constant one on."""
    sign = float(rng.choice([-1.0, 1.0]))
    if variant == "shift":
        return [sign]
    if variant == "slope":
        return [0.0, sign]
    return [0.0, 0.0, *(float(c) for c in rng.uniform(0.3, 1.0, 3) * rng.choice([-1, 1], 3))]
