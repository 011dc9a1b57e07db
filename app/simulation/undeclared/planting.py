"""From names to effects: which there are, and in what order they are planted."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from app.simulation.undeclared.base_machine import BaseMachine
from app.simulation.undeclared.components import FloatArray
from app.simulation.undeclared.conditions import Conditions
from app.simulation.undeclared.effect import Effect
from app.simulation.undeclared.history import History
from app.simulation.undeclared.observations import Observations
from app.simulation.undeclared.planted import FAMILIES
from app.simulation.undeclared.setting import Family, NothingToSee, Setting
from app.simulation.undeclared.unknown import UNKNOWN

ALL: Final = {**FAMILIES, **UNKNOWN}
"""Every effect that can be planted, by name."""

DRAWS: Final = 50


def chance(seed: int, purpose: str) -> np.random.Generator:
    """Make a source of chance that no other purpose shares.

    So what is drawn for one purpose does not depend on what another one needs.
    """
    return np.random.default_rng([seed, zlib.crc32(purpose.encode())])


def _parse(name: str) -> tuple[str, Family, str | None]:
    """Read `family` or `family:variant`."""
    kind, _, variant = name.partition(":")
    if kind not in ALL:
        raise ValueError(f"expected an effect of {', '.join(ALL)}, got {kind!r}")
    family = ALL[kind]
    variants = (*family.variants, *family.only_asked_for)
    if variant and variant not in variants:
        raise ValueError(f"expected {kind}:{'|'.join(variants)}, got {variant!r}")
    return kind, family, variant or None


def _rank(kind: str) -> int:
    """Plant first what changes the machine that the other effects see."""
    first = (
        *("angular", "thermal-lag", "second-time-constant", "other-sensor", "sensor-fault"),
        *("exchanged-sensors", "map-temperature", "clock-offset", "late-sensor", "ageing-sensor"),
        "detached-sensor",
    )
    return first.index(kind) if kind in first else len(first)


def plant_effects(
    seed: int,
    names: Sequence[str],
    amplitudes: FloatArray,
    machine: BaseMachine,
    history: History,
    planned: Observations,
    under: Conditions,
) -> tuple[BaseMachine, list[Effect]]:
    """Plant effects, on different components where they have components of their own.

    Parameters
    ----------
    amplitudes : ndarray, shape (effects,)
        In units of the repeatability.

    Returns
    -------
    machine, effects
        The machine as the effects need it, and the effects in the order of their names.

    Raises
    ------
    ValueError
        If there is no such effect, or no component is left for it.
    """
    effects: dict[int, Effect] = {}
    parsed = [_parse(name) for name in names]
    for i in sorted(range(len(names)), key=lambda i: _rank(parsed[i][0])):
        kind, family, variant = parsed[i]
        others = effects.values()
        setting = Setting(
            kind,
            variant or "",
            kind in FAMILIES,
            machine,
            history,
            planned,
            under,
            float(amplitudes[i]) * under.unit_um,
            frozenset(c for e in others if e.is_of_machine for c in e.components),
            frozenset(sensor for e in others for sensor in e.shown_c),
            chance(seed, f"effect {i} {kind}"),
        )
        effect = _plant(setting, family)
        effects[i] = effect
        machine = machine.with_sensitivities(dict.fromkeys(effect.sensitive, effect.strength))
        machine = machine.without(frozenset(effect.unmeasured))
    return machine, [effects[i] for i in range(len(names))]


def _plant(setting: Setting, family: Family) -> Effect:
    """Plant one effect; draw again where the observations do not show it."""
    for _ in range(DRAWS):
        drawn = str(setting.rng.choice(family.variants))
        try:
            return family.plant(replace(setting, variant=setting.variant or drawn))
        except NothingToSee:
            continue
    raise ValueError(f"expected observations that show an effect, got none in {DRAWS} draws")
