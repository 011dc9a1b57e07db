"""Effects that are in none of the families: what an honest search calls unexplained.

Some of them resemble a family closely (a second time constant a lag, a chirped pitch a
periodic error): a finding of that family beside unexplained structure is then a proxy.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from app.simulation.undeclared.base_machine import TRAVELS_MM, normalised
from app.simulation.undeclared.components import COMPONENTS, TRANSLATIONS, BoolArray, FloatArray
from app.simulation.undeclared.conditions import Conditions
from app.simulation.undeclared.duty_cycle import DAY_MIN, PAYLOADS_KG
from app.simulation.undeclared.effect import Effect
from app.simulation.undeclared.history import low_pass
from app.simulation.undeclared.observations import Circumstances, ErrorFunction
from app.simulation.undeclared.planted.structure import PAIRS, lagging_codes, late_error
from app.simulation.undeclared.setting import Family, Profile, Setting, driven

LEVELS: Final = 60
"""Thresholds of hysteresis over the range of temperatures."""

SIDES: Final = {"y": ("EYZ", "SYZ"), "x": ("EXZ", "SZX")}
"""What bends where draughts strike that side of the column."""

TIME_CONSTANTS_MIN: Final = (60.0, 25.0)

WANDER_RAD: Final = 0.5
"""Standard deviation of a slow cause's phase after one period."""

BENDS: Final = (0.5, 1.0)
"""What the far end bends by, in parts of what is the same everywhere."""


def hysteresis(setting: Setting) -> Effect:
    """Let one component remember where its temperature turned back, not how fast it went.

    A Preisach model (F. Preisach, Z. Phys. 94, 277 (1935)): relays that switch up at α and down at
    β < α. Its output at a temperature depends on the past extremes alone, whatever the speed; a
    small loop closes where it began. What is linear in the temperature is taken off, as maps would
    have it.
    """
    code = setting.choose_component()
    sensor = COMPONENTS[code].sensor
    temperatures = setting.history.temperatures_c[sensor]
    width = float(setting.rng.uniform(0.15, 0.3))
    output = preisach(temperatures, relay_weights(LEVELS, width))
    line = np.polynomial.Polynomial.fit(temperatures, output, 1)
    return setting.following(
        setting.choose_profile(code),
        output - line(temperatures),
        sensors=(sensor,),
        parameters={"half_width_of_range": width},
    )


def relay_weights(levels: int, half_width: float) -> FloatArray:
    """Weigh relays: most of those whose thresholds lie some way apart.

    Parameters
    ----------
    levels
        Number of thresholds over the range.

    Returns
    -------
    ndarray, shape (levels, levels)
        Weight of the relay that switches up at the first and down at the second index's level;
        zero where that is no relay. Their sum is 1.
    """
    up, down = np.meshgrid(np.arange(levels), np.arange(levels), indexing="ij")
    apart = (up - down) / levels
    weights = np.where(up >= down, np.exp(-(((apart / 2 - half_width) / 0.1) ** 2)), 0.0)
    normalised: FloatArray = weights / weights.sum()
    return normalised


def preisach(series: FloatArray, weights: FloatArray) -> FloatArray:
    """Drive all relays by a series.

    Parameters
    ----------
    series : ndarray, shape (n,)
        The input; its range sets the thresholds.
    weights : ndarray, shape (k, k)
        As `relay_weights`.

    Returns
    -------
    ndarray, shape (n,)
        From −1, all relays down, to 1, all up.
    """
    levels = weights.shape[0]
    low, high = series.min(), series.max()
    reached = np.clip((series - low) / (high - low) * levels, 0.0, levels)
    # The level that the input stands on: relays up to it are up, relays above it down.
    step = np.floor(reached).astype(int)
    is_up = np.zeros(weights.shape, dtype=bool)
    places = np.arange(levels)
    output = np.empty(series.size)
    value, last = -1.0, -1
    for i, now in enumerate(step):
        if now != last:
            is_up[places < now, :] = True
            is_up[:, places >= now] = False
            value = 2.0 * float(weights[is_up].sum()) - 1.0
            last = now
        output[i] = value
    return output


def coolant_valve(setting: Setting) -> Effect:
    """Let a valve that nobody logs, open at random while the machine works, act within minutes."""
    code = setting.choose_component()
    tau = float(setting.rng.uniform(4.0, 12.0))
    acts = low_pass(random_switch(setting.rng, setting.history.working, 70.0), tau)
    return setting.following(
        setting.choose_profile(code), acts, parameters={"time_constant_min": tau}
    )


def random_switch(rng: np.random.Generator, may: BoolArray, mean_min: float) -> FloatArray:
    """Switch on and off at random moments.

    Parameters
    ----------
    may : ndarray of bool, shape (n,)
        Minutes in which it can be on.
    mean_min
        Mean duration of either state [min].

    Returns
    -------
    ndarray, shape (n,)
        0 or 1.
    """
    durations = rng.exponential(mean_min, int(3 * may.size / mean_min) + 20)
    turns = np.cumsum(durations)
    state = np.searchsorted(turns, np.arange(may.size)) % 2
    switched: FloatArray = state * may.astype(float)
    return switched


def door(setting: Setting) -> Effect:
    """Let draughts strike one side of the column, where no sensor sits.

    The column bends towards the other side, so a straightness of Z and a squareness change
    together.
    """
    side = SIDES[setting.variant]
    codes = [c for c in side if c not in setting.taken] or [setting.choose_component(side)]
    tau = float(setting.rng.uniform(12.0, 30.0))
    cold = low_pass(openings(setting.rng, setting.history.minutes), tau)
    profiles = {code: Profile(code, 1.0, 0.0 if code[0] == "S" else 1.0) for code in codes}
    return setting.planted(
        {c: driven(p, lambda circumstances: circumstances.at(cold)) for c, p in profiles.items()},
        parameters={"time_constant_min": tau},
        strengths={f"{c}_{k}": v for c, p in profiles.items() for k, v in p.named().items()},
    )


def openings(rng: np.random.Generator, minutes: FloatArray) -> FloatArray:
    """Draw draughts: three to eight a day, of 8 to 40 minutes, each of its own strength.

    Parameters
    ----------
    minutes : ndarray, shape (n,) [min]
        One minute apart.

    Returns
    -------
    ndarray, shape (n,)
        0 where the door is shut.
    """
    opened = np.zeros(minutes.size)
    for day in range(minutes.size // DAY_MIN):
        for opens in rng.uniform(6.0 * 60, 22.0 * 60, rng.integers(3, 9)):
            begin = day * DAY_MIN + int(opens)
            opened[begin : begin + int(rng.integers(8, 41))] = rng.uniform(0.4, 1.0)
    return opened


def stick_slip(setting: Setting) -> Effect:
    """Let a joint hold one component's expansion until the strain is too much, and then slip."""
    code = setting.choose_component()
    sensor = COMPONENTS[code].sensor
    holds_c = float(setting.rng.uniform(0.8, 2.0))
    strain = stored_strain(setting.rng, setting.history.temperatures_c[sensor], holds_c)
    profile = setting.choose_profile(code)
    return setting.following(
        profile, strain, "_per_k", sensors=(sensor,), parameters={"holds_c": holds_c}
    )


def stored_strain(
    rng: np.random.Generator, temperatures_c: FloatArray, holds_c: float
) -> FloatArray:
    """Follow the strain of a joint that sticks.

    Parameters
    ----------
    rng
        Source of chance: the joint never holds twice the same.
    temperatures_c : ndarray, shape (n,) [°C]
    holds_c
        Usual strain at which it slips, as the change of temperature that makes it [K].

    Returns
    -------
    ndarray, shape (n,) [K]
        Stored strain; a slip leaves a random fifth of it or less.
    """
    strains = np.empty(temperatures_c.size)
    strain, limit = 0.0, holds_c
    for i, change in enumerate(np.diff(temperatures_c, prepend=temperatures_c[0]).tolist()):
        strain += change
        if abs(strain) > limit:
            strain *= rng.uniform(0.0, 0.2)
            limit = holds_c * rng.uniform(0.6, 1.4)
        strains[i] = strain
    return strains


def interaction(setting: Setting) -> Effect:
    """Let payload and the bed's temperature bend one component together: u³·(T − T₀)·payload."""
    code = setting.choose_component(TRANSLATIONS)
    axis = COMPONENTS[code].axis or 0
    cold = float(setting.machine.map_temperatures_c["bed"][0])

    def error(circumstances: Circumstances) -> FloatArray:
        u = normalised(code, circumstances.point_mm[:, axis])
        rise = circumstances.temperature("bed") - cold
        return u**3 * rise * circumstances.state("payload_kg") / PAYLOADS_KG[-1]

    return setting.planted(
        {code: error},
        sensors=("bed",),
        parameters={"state": "payload_kg", "about_c": cold},
        strengths={"at_full_load_um_per_k": 1.0},
    )


def second_time_constant(setting: Setting) -> Effect:
    """Let a lag be that of two bodies one behind the other, of 60 and then of 25 minutes.

    A single time constant comes near it, with the right family and an incomplete shape.
    """
    codes = lagging_codes(setting)
    sensor = COMPONENTS[codes[0]].sensor
    late = setting.history.temperatures_c[sensor]
    for tau in TIME_CONSTANTS_MIN:
        late = low_pass(late, tau)
    return setting.planted(
        {code: late_error(setting, code, late) for code in codes},
        sensors=(sensor,),
        parameters={"time_constants_min": list(TIME_CONSTANTS_MIN)},
        sensitive=codes,
    )


def chirped_pitch(setting: Setting) -> Effect:
    """Give one component a cyclic error whose frequency grows evenly along the axis.

    No single period fits.
    """
    code = setting.choose_component(TRANSLATIONS)
    axis = COMPONENTS[code].axis or 0
    first = float(setting.rng.uniform(24.0, 40.0))
    last = first * float(setting.rng.uniform(0.4, 0.7))
    phase = float(setting.rng.uniform(0.0, 2 * np.pi))
    growth = (1.0 / last - 1.0 / first) / (2.0 * TRAVELS_MM[axis])

    def error(circumstances: Circumstances) -> FloatArray:
        along = circumstances.point_mm[:, axis]
        return np.sin(2 * np.pi * (along / first + growth * along**2) + phase)

    return setting.planted(
        {code: error},
        parameters={"first_pitch_mm": first, "last_pitch_mm": last, "phase_rad": phase},
        strengths={"amplitude_um": 1.0},
    )


def slow_cause(setting: Setting) -> Effect:
    """Let a wave of five to nine hours act that nobody observes, and whose phase wanders."""
    code = setting.choose_component()
    period = float(setting.rng.uniform(5.0, 9.0) * 60.0)
    n = setting.history.minutes.size
    steps = setting.rng.standard_normal(n) * WANDER_RAD / np.sqrt(period)
    begins = setting.rng.uniform(0.0, 2 * np.pi)
    wave = np.sin(2 * np.pi * np.arange(n) / period + begins + np.cumsum(steps))
    return setting.following(setting.choose_profile(code), wave, parameters={"period_min": period})


def setup_warp(setting: Setting) -> Effect:
    """Warp an axis' three translations, or one component, in every visit anew.

    Clamping bends what is measured. The declared set-up scatter is a shift and a tilt; a warp is of
    the second and third order, so it is more than set-up scatter and yet follows nothing but the
    visit.
    """
    chosen = setting.choose_component(TRANSLATIONS)
    codes = [chosen]
    if setting.variant == "axis":
        codes = [c for c in TRANSLATIONS if c[2] == chosen[2] and c not in setting.taken]
    under = setting.conditions
    last = under.setup_of(np.array([under.visits + under.later_visits - 1]))
    warps = {code: setting.rng.standard_normal((int(last[0]) + 1, 2)) for code in codes}
    return setting.planted(
        {code: _warp(code, of_setups, under) for code, of_setups in warps.items()},
        strengths={"second_order_um": 1.0, "third_order_um": 1.0},
    )


def _warp(code: str, of_setups: FloatArray, under: Conditions) -> ErrorFunction:
    """Make the Legendre polynomials of the second and third order with a set-up's coefficients."""
    axis = COMPONENTS[code].axis or 0

    def error(circumstances: Circumstances) -> FloatArray:
        u = normalised(code, circumstances.point_mm[:, axis])
        second, third = of_setups[under.setup_of(circumstances.observations.visit)].T
        warp: FloatArray = second * (3 * u**2 - 1) / 2 + third * (5 * u**3 - 3 * u) / 2
        return warp

    return error


def bent_by_difference(setting: Setting) -> Effect:
    """Let a difference of two sensors push one component, and bend it as a cantilever.

    What the difference does everywhere alike is larger than the bend along the axis. An instrument
    that is zeroed in every visit shows the bend alone, and whatever explains it says something of
    the rest too, which nobody saw. The maps know nothing of it.
    """
    code = setting.choose_component(TRANSLATIONS)
    axis = COMPONENTS[code].axis or 0
    warm, cold = PAIRS[int(setting.rng.integers(len(PAIRS)))]
    bend = float(setting.rng.uniform(*BENDS) * setting.rng.choice([-1.0, 1.0]))
    in_balance = setting.machine.map_temperatures_c
    middle = in_balance[warm].size // 2
    balance_k = float(in_balance[warm][middle] - in_balance[cold][middle])

    def error(circumstances: Circumstances) -> FloatArray:
        along = (normalised(code, circumstances.point_mm[:, axis]) + 1.0) / 2.0
        difference = circumstances.temperature(warm) - circumstances.temperature(cold)
        return (1.0 + bend * along**2) * (difference - balance_k)

    return setting.planted(
        {code: error},
        sensors=(warm, cold),
        parameters={"balance_k": balance_k},
        strengths={"everywhere_um_per_k": 1.0, "bend_um_per_k": bend},
    )


UNKNOWN: Final = {
    "hysteresis": Family(hysteresis, "preisach"),
    "coolant-valve": Family(coolant_valve, "unlogged"),
    "door": Family(door, *SIDES),
    "stick-slip": Family(stick_slip, "joint"),
    "interaction": Family(interaction, "cubic"),
    "second-time-constant": Family(second_time_constant, "component", "sensor"),
    "chirped-pitch": Family(chirped_pitch, "linear"),
    "slow-cause": Family(slow_cause, "wandering"),
    "setup-warp": Family(setup_warp, "axis", "component"),
    "bent-by-difference": Family(bent_by_difference, "cantilever"),
}
"""What nobody searches."""
