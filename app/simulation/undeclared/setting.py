"""What a planter of effects works with: the machine, its history, the plan, and its own chance."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from app.simulation.undeclared.base_machine import BaseMachine, normalised
from app.simulation.undeclared.components import (
    COMPONENTS,
    ROTATIONS,
    SQUARENESS,
    TRANSLATIONS,
    FloatArray,
)
from app.simulation.undeclared.conditions import Conditions
from app.simulation.undeclared.effect import Effect, amplitude_of
from app.simulation.undeclared.error_tables import ErrorTable
from app.simulation.undeclared.history import SENSORS, History
from app.simulation.undeclared.observations import Circumstances, ErrorFunction, Observations

TOO_ALIKE: Final = 0.98
"""Sensors that agree better than this over the visits are the same to anybody."""


class NothingToSee(Exception):
    """An effect that these observations do not show at all: another one must be drawn."""


@dataclass(frozen=True)
class Profile:
    """How an effect varies along its axis: a level, and what it gains towards the upper end.

    `level` + `slope` · u, with u from −1 to 1; of a squareness the level alone.
    """

    code: str
    level: float
    slope: float

    def __call__(self, circumstances: Circumstances) -> FloatArray:
        """Give the profile where the observations lie: shape (n,)."""
        axis = COMPONENTS[self.code].axis
        position = circumstances.point_mm[:, axis or 0]
        return self.level + self.slope * normalised(self.code, position)

    def named(self, per: str = "") -> dict[str, float]:
        """Give level and slope with their unit, per whatever drives the effect."""
        unit = COMPONENTS[self.code].unit + per
        return {f"level_{unit}": self.level, f"slope_{unit}": self.slope}


@dataclass(frozen=True)
class Setting:
    """Where an effect is planted, and which one.

    Parameters
    ----------
    kind, variant, in_library
        As the effect has them.
    amplitude_um
        Wanted standard deviation of the effect over the values that it reaches.
    taken
        Components that another effect has.
    faulty
        Sensors that another effect has.
    rng
        Source of chance, of this effect alone.
    """

    kind: str
    variant: str
    in_library: bool
    machine: BaseMachine
    history: History
    observations: Observations
    conditions: Conditions
    amplitude_um: float
    taken: frozenset[str]
    faulty: frozenset[str]
    rng: np.random.Generator

    def choose_component(self, codes: Sequence[str] | None = None) -> str:
        """Choose a free component: usually a translation, now and then an angle or squareness."""
        if codes is None:
            kind = self.rng.uniform()
            codes = TRANSLATIONS if kind < 0.75 else ROTATIONS if kind < 0.9 else SQUARENESS
        free = [c for c in codes if c not in self.taken and c not in self.machine.unmeasured]
        if not free:
            raise ValueError(f"expected a free component of {', '.join(codes)}, got none")
        return str(self.rng.choice(free))

    def choose_profile(self, code: str) -> Profile:
        """Choose how the effect varies along the axis."""
        level, slope = (self.rng.uniform(0.4, 1.0, 2) * self.rng.choice([-1.0, 1.0], 2)).tolist()
        return Profile(code, level, 0.0 if COMPONENTS[code].axis is None else slope)

    def choose_other_sensor(self, than: str, but: Collection[str] = ()) -> str:
        """Choose a sensor, none of some, that does not simply read the same as another."""
        times = self.visit_times_min
        series = self.history.temperature(than, times)
        others = [
            sensor
            for sensor in SENSORS
            if sensor != than
            and sensor not in but
            and np.corrcoef(series, self.history.temperature(sensor, times))[0, 1] < TOO_ALIKE
        ]
        if not others:
            raise NothingToSee(f"no sensor that differs from {than}")
        return str(self.rng.choice(others))

    def choose_time_constant_min(self, low: float = 20.0, high: float = 180.0) -> float:
        """Choose a time constant, evenly in its logarithm; the history lasts five of them."""
        high = min(high, self.conditions.history_days * 24 * 60 / 5.0)
        return float(np.exp(self.rng.uniform(np.log(low), np.log(high))))

    def choose_moment_min(self, earliest: float = 0.3, latest: float = 0.7) -> float:
        """Choose a moment between two visits, in the campaign's middle [min]."""
        starts = self.visit_times_min
        visit = int(self.rng.integers(int(earliest * len(starts)), int(latest * len(starts)) + 1))
        visit = max(visit, 1)
        before = starts[visit - 1] + self.conditions.visit_min
        return float(self.rng.uniform(min(before, starts[visit] - 1.0), starts[visit]))

    @property
    def visit_times_min(self) -> FloatArray:
        """When each visit begins [min]."""
        _, first = np.unique(self.observations.visit, return_index=True)
        return self.observations.time_min[first]

    def beyond_maps(
        self,
        code: str,
        driver: ErrorFunction,
        at_maps: FloatArray,
    ) -> ErrorFunction:
        """Count a driver from what the maps contain of it.

        The maps were measured on the machine that has the effect. So they have it as it was in
        their thermal states, and the model interpolates that over the assigned sensor; what is
        undeclared is the rest. Where the maps know nothing of the effect, all of it counts from
        the middle thermal state.

        Parameters
        ----------
        code
            The component, whose sensor the model follows.
        at_maps : ndarray, shape (M,)
            The driver in the maps' thermal states.
        """
        sensor = COMPONENTS[code].sensor
        nodes = self.machine.map_temperatures_c[sensor]

        def undeclared(circumstances: Circumstances) -> FloatArray:
            if not self.conditions.maps_contain_effect:
                return driver(circumstances) - float(at_maps[nodes.size // 2])
            in_maps = np.interp(circumstances.temperature(sensor), nodes, at_maps)
            beyond: FloatArray = driver(circumstances) - in_maps
            return beyond

        return undeclared

    def effect(
        self, errors: Mapping[str, ErrorFunction], components: Sequence[str] = (), **more: Any
    ) -> Effect:
        """Make the effect as it is.

        Parameters
        ----------
        errors, **more
            As `Effect` has them.
        components
            Those that it is of, where they are others than have errors.
        """
        of = tuple(components or errors)
        return Effect(self.kind, self.variant, of, errors, in_library=self.in_library, **more)

    def planted(self, errors: Mapping[str, ErrorFunction], **more: Any) -> Effect:
        """Make the effect with the wanted amplitude; NothingToSee where it does nothing."""
        return self.scaled(self.effect(errors, **more))

    def driven(self, profile: Profile, driver: ErrorFunction, per: str = "", **more: Any) -> Effect:
        """Plant a profile along the axis times what drives it, in units `per` that."""
        strengths = {"strengths": profile.named(per), **more}
        return self.planted({profile.code: driven(profile, driver)}, **strengths)

    def following(self, profile: Profile, series: FloatArray, per: str = "", **more: Any) -> Effect:
        """Plant a profile along the axis times a series of the history's minutes."""
        return self.driven(profile, lambda circumstances: circumstances.at(series), per, **more)

    def fitted(self, effect: Effect) -> Effect:
        """Reach the wanted amplitude by the sensitivity, unless another effect has set it."""
        if self.machine.sensitivities.keys() & effect.components:
            return replace(effect, sensitive=())
        return self.scaled(effect)

    def amplitude(self, effect: Effect) -> float:
        """Amplitude of an effect as it is, in what can be observed [µm, µrad, µm/m]."""
        usable = self.observations.without(self.machine.unmeasured.union(effect.unmeasured))
        contribution = effect.contribution(usable, self.history)
        return amplitude_of(contribution, usable, effect.about_zero)

    def scaled(self, effect: Effect) -> Effect:
        """Give an effect the wanted amplitude.

        Raises
        ------
        NothingToSee
            If it does nothing in these observations.
        """
        has = self.amplitude(effect)
        if has < 1e-9:
            raise NothingToSee(f"{effect.kind} of {', '.join(effect.components)}")
        return effect.with_strength(self.amplitude_um / has)


class Family:
    """How effects of one kind are planted; some variants only where they are asked for."""

    def __init__(
        self,
        plant: Callable[[Setting], Effect],
        *variants: str,
        only_asked_for: tuple[str, ...] = (),
    ) -> None:
        self.plant, self.variants, self.only_asked_for = plant, variants, only_asked_for


def table_difference(
    code: str,
    first: ErrorTable,
    other: ErrorTable,
    *,
    first_c: FloatArray | None = None,
    other_c: FloatArray | None = None,
    clamp: bool = False,
) -> ErrorFunction:
    """Make what one table says of a component minus what another one says.

    Parameters
    ----------
    first_c, other_c : ndarray, shape (n,) [°C]
        Temperatures at which they are asked, in all minutes of the history; where left out, those
        of the component's sensor.
    clamp
        Whether the other one holds beyond its temperatures.
    """
    component = COMPONENTS[code]

    def difference(circumstances: Circumstances) -> FloatArray:
        position = circumstances.point_mm[:, component.axis or 0]
        first_at, other_at = (
            circumstances.temperature(component.sensor) if c is None else circumstances.at(c)
            for c in (first_c, other_c)
        )
        return first.at(position, first_at) - other.at(position, other_at, clamp=clamp)

    return difference


def driven(profile: Profile, driver: ErrorFunction) -> ErrorFunction:
    """Multiply a profile along the axis by what drives it."""
    return lambda circumstances: profile(circumstances) * driver(circumstances)
