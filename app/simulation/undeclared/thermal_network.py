"""A lumped thermal network of a mid-size vertical machining centre.

Eight bodies and the room. Each exchanges heat with its neighbours and with the air, and
takes up the heat of the spindle, the feed drives, the hydraulics and the coolant. Between
two minutes the heat is constant, so each of the network's modes is an exponential: the
solution is exact and stable at any step.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.signal import lfilter

from app.simulation.undeclared.components import FloatArray

MINUTE_S: Final = 60.0
J_PER_KJ: Final = 1000.0

CAPACITIES_KJ_PER_K: Final = {
    "spindle": 18.0,
    "headstock": 90.0,
    "column-front": 150.0,
    "column-rear": 150.0,
    "bed": 420.0,
    "x-middle": 60.0,
    "y-front": 75.0,
    "table": 120.0,
}
"""Mass × 0.46 kJ/(kg·K): a spindle of 40 kg to a bed of 900 kg."""

TO_AIR_W_PER_K: Final = {
    "spindle": 5.0,
    "headstock": 9.0,
    "column-front": 13.0,
    "column-rear": 14.0,
    "bed": 26.0,
    "x-middle": 7.0,
    "y-front": 8.0,
    "table": 10.0,
}
"""Surface × some 8 W/(m²·K)."""

LINKS_W_PER_K: Final = {
    ("spindle", "headstock"): 26.0,
    ("headstock", "column-front"): 34.0,
    ("column-front", "column-rear"): 24.0,
    ("column-front", "bed"): 14.0,
    ("column-rear", "bed"): 14.0,
    ("bed", "y-front"): 20.0,
    ("bed", "x-middle"): 6.0,
    ("y-front", "x-middle"): 30.0,
    ("x-middle", "table"): 24.0,
}
BODIES: Final = tuple(CAPACITIES_KJ_PER_K)
SPREAD: Final = 0.12
"""Standard deviation of the logarithm of each constant from machine to machine."""


@dataclass(frozen=True)
class ThermalNetwork:
    """Heat balance C·dT/dt = −K·T + to_air·T_air + heat.

    Parameters
    ----------
    capacities : ndarray, shape (8,) [J/K]
        In the order of `BODIES`.
    conductances : ndarray, shape (8, 8) [W/K]
        K: symmetric; its rows sum to `to_air`.
    to_air : ndarray, shape (8,) [W/K]
        Conductance to the room's air.
    """

    capacities: FloatArray
    conductances: FloatArray
    to_air: FloatArray

    def modes(self) -> tuple[FloatArray, FloatArray]:
        """Return the rates [1/s] of decay and the bodies' shares in each mode, symmetrised."""
        root = np.sqrt(self.capacities)
        # With y = √C T the balance is y' = −C^(−½) K C^(−½) y + …: a symmetric matrix, whose rates
        # are real and whose modes orthogonal.
        rates, shapes = np.linalg.eigh(self.conductances / np.outer(root, root))
        return rates, shapes

    def temperatures(
        self, air_c: FloatArray, heat_w: Mapping[str, FloatArray]
    ) -> dict[str, FloatArray]:
        """Follow the bodies' temperatures from minute to minute.

        Parameters
        ----------
        air_c : ndarray, shape (n,) [°C]
            The room's temperature, constant through each minute.
        heat_w : mapping of body to ndarray, shape (n,) [W]
            Heat taken up through each minute; bodies left out take none.

        Returns
        -------
        dict of body to ndarray, shape (n,) [°C]
            At the beginning of each minute, from rest at the first air temperature.
        """
        root = np.sqrt(self.capacities)
        rates, shapes = self.modes()
        heat = np.outer(air_c - air_c[0], self.to_air)
        for body, watts in heat_w.items():
            heat[:, BODIES.index(body)] += watts
        drive = heat / root @ shapes
        decay = np.exp(-rates * MINUTE_S)
        # Each mode is y' = −λ y + q with q constant through a minute: y(t + 1) = d y(t) + q(t) (1 −
        # d)/λ with d = e^(−λ · 60 s), which a filter that looks back by one does.
        modal = np.stack(
            [
                lfilter([0.0, (1 - d) / rate], [1.0, -d], column)
                for d, rate, column in zip(decay, rates, drive.T, strict=True)
            ],
            axis=1,
        )
        rise = modal @ shapes.T / root
        return {body: air_c[0] + rise[:, i] for i, body in enumerate(BODIES)}


def make_network(rng: np.random.Generator) -> ThermalNetwork:
    """Make one machine of the type: each constant differs a little."""

    def vary(constants: FloatArray) -> FloatArray:
        return constants * np.exp(SPREAD * rng.standard_normal(constants.shape))

    capacities = vary(J_PER_KJ * np.array(list(CAPACITIES_KJ_PER_K.values())))
    to_air = vary(np.array(list(TO_AIR_W_PER_K.values())))
    between = np.zeros((len(BODIES), len(BODIES)))
    values = vary(np.array(list(LINKS_W_PER_K.values())))
    for (first, other), value in zip(LINKS_W_PER_K, values, strict=True):
        i, j = BODIES.index(first), BODIES.index(other)
        between[i, j] = between[j, i] = value
    return ThermalNetwork(capacities, np.diag(between.sum(axis=1) + to_air) - between, to_air)


def room_temperature(rng: np.random.Generator, minutes: FloatArray) -> FloatArray:
    """Daily wave with its warmest time at four in the afternoon, and a slow random walk.

    Parameters
    ----------
    minutes : ndarray, shape (n,) [min]
        Since a midnight, one minute apart.

    Returns
    -------
    ndarray, shape (n,) [°C]
    """
    swing = rng.uniform(1.3, 2.2)
    days = minutes / 1440.0
    wave = swing * np.sin(2 * np.pi * (days - 10.0 / 24.0))
    # The walk is drawn back within a day, or weeks would carry it out of the hall.
    decay = np.exp(-1.0 / 1440.0)
    steps = rng.standard_normal(minutes.size) * 0.8 * np.sqrt(1 - decay**2)
    return rng.uniform(20.0, 22.5) + wave + lfilter([1.0], [1.0, -decay], steps)
