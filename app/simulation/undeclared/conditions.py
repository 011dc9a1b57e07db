"""The circumstances of a campaign: how many visits, how noisy, what the instrument's zero is."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from typing import Final

import numpy as np

from app.simulation.undeclared.components import IntArray

RECORD_BEGINS_MIN: Final = 7 * 60
"""A record begins at seven in the morning, on a machine that was off all night."""

DATUMS: Final = ("absolute", "first", "free")


@dataclass(frozen=True)
class Conditions:
    """Everything about a campaign but its seed and its effects.

    Scatter is stated in µm and holds in each component's own unit: a repeatability of 1
    is 1 µm for EXX, 1 µrad for EBX and 1 µm/m for SXY.

    Parameters
    ----------
    visits, observations_per_visit, observation_interval_s
        Size of the campaign; an observation is one component's error or one point's three. Of a
        record, `visits` counts its blocks.
    block_every_min
        None: visits, each with a set-up of its own. Else a continuous record with one set-up, and
        the time from block to block [min].
    new_places
        Whether each block of a record has places of its own, as visits have, instead of the same
        ones in all: at a few places what never changes there can hardly be named.
    later_visits
        Visits after all that is handed out: where a correction is judged.
    days
        Over how many days the visits spread; as many as are needed where None.
    history_h
        Readings before the first day of visits [h], in whole days.
    repeatability_um
        Standard deviation of one measured value.
    setup_shift_um, setup_tilt_um
        Standard deviations, from visit to visit, of each component's set-up shift and of the
        tilt's effect at the ends of the travel.
    map_error_um
        Standard deviation of each entry of the error maps.
    maps
        Number of error maps, at least 2.
    state_standard_errors
        Whether the maps state `map_error_um`.
    state_repeatability
        Whether the verifications state `repeatability_um`.
    sensor_noise_c, quantum_c
        Noise and rounding of the readings [°C].
    datum
        Zero of the instrument: `absolute`, `first` or `free`.
    one_verification
        Whether one verification has all visits, or each visit its own.
    outliers
        Share of the values that are blunders of some ten times the repeatability.
    heavy_tails
        Whether the repeatability is Student's t with three degrees of freedom, of the same
        standard deviation, instead of normal.
    measured_quantum_um
        The instrument's resolution: measured values are multiples of it; 0 rounds to 0.1 nm.
    wander_um, wander_tilt_um, wander_min
        Standard deviations of a shift, and of a tilt's effect at the ends of the travel, that
        wander as the machine goes on (Ornstein, Uhlenbeck): each component's and each point
        coordinate's alone, over the whole campaign; and their correlation time [min].
    instrument_drift_um_per_h
        Standard deviation of each component's and coordinate's constant rate, from the
        beginning of the set-up.
    warm_up_um, warm_up_min
        Standard deviation of what the instrument's own warming adds in the end, alike in every
        set-up, and its time constant [min].
    length_um_per_m_per_k, length_sensor, length_assumed_c
        What the instrument's lengths grow by, on all axes and at points, with a temperature above
        the one that it counts on: no air compensation, or none for the material.
    setup_correlation
        Correlation of a component's set-up shift and tilt with those of the visit before.
    frozen
        How many times a sensor's readings stand still for some hours.
    ar1_um, ar1_correlation
        Scatter that lingers from one value of a visit's component to the next.
    maps_contain_effect
        Whether the maps were measured on the machine with its effect, so that what the effect
        did in the maps' thermal states is in their entries and only the rest is undeclared.
        False: the maps know nothing of it.
    start
        Midnight of the first reading, UTC.
    """

    visits: int = 100
    observations_per_visit: int = 40
    observation_interval_s: int = 20
    block_every_min: float | None = None
    new_places: bool = False
    later_visits: int = 0
    days: int | None = None
    history_h: int = 24
    repeatability_um: float = 1.0
    setup_shift_um: float = 0.3
    setup_tilt_um: float = 0.15
    map_error_um: float = 0.45
    maps: int = 3
    state_standard_errors: bool = False
    state_repeatability: bool = True
    sensor_noise_c: float = 0.02
    quantum_c: float = 0.01
    datum: str = "absolute"
    one_verification: bool = False
    outliers: float = 0.0
    heavy_tails: bool = False
    measured_quantum_um: float = 0.0
    wander_um: float = 0.0
    wander_tilt_um: float = 0.0
    wander_min: float = 60.0
    instrument_drift_um_per_h: float = 0.0
    warm_up_um: float = 0.0
    warm_up_min: float = 30.0
    length_um_per_m_per_k: float = 0.0
    length_sensor: str = "ambient"
    length_assumed_c: float = 20.0
    setup_correlation: float = 0.0
    frozen: int = 0
    ar1_um: float = 0.0
    ar1_correlation: float = 0.6
    maps_contain_effect: bool = True
    start: datetime = datetime(2026, 2, 2)

    def __post_init__(self) -> None:
        if self.datum not in DATUMS:
            raise ValueError(f"expected a datum of {', '.join(DATUMS)}, got {self.datum!r}")
        if self.maps < 2:
            raise ValueError(f"expected at least 2 maps, got {self.maps}")
        if not 0.0 <= self.setup_correlation < 1.0:
            raise ValueError(
                f"expected a correlation from 0 to below 1, got {self.setup_correlation:g}"
            )
        if self.wander_min <= 0 or self.warm_up_min <= 0:
            raise ValueError("expected correlation time and time constant above 0 min")
        if self.block_every_min is not None:
            if self.visits < 4 or not 0 < self.visit_min <= self.block_every_min:
                raise ValueError(
                    "expected at least 4 blocks that end before the next begins, got "
                    f"{self.visits} of {self.visit_min:g} min every {self.block_every_min:g} min"
                )
        elif self.visits < 4 or self.observations_per_visit < 12:
            raise ValueError(
                "expected at least 4 visits of 12 observations, "
                f"got {self.visits} of {self.observations_per_visit}"
            )

    @property
    def unit_um(self) -> float:
        """What amplitudes are counted in: the repeatability, or 1 µm where there is none."""
        return self.repeatability_um or 1.0

    @property
    def is_record(self) -> bool:
        """Whether it is one continuous record, not visits."""
        return self.block_every_min is not None

    @property
    def record_min(self) -> float:
        """Duration of the record [min]; 0 of visits."""
        return self.visits * (self.block_every_min or 0.0)

    @property
    def history_days(self) -> int:
        """Whole days of readings before the first day of visits."""
        return -(-self.history_h // 24)

    @property
    def visit_days(self) -> int:
        """Days with visits: as stated, or so many that no day has more than it can take."""
        if self.is_record:
            return self.record_days + self._days_of(self.later_visits)
        return self.days or self._days_of(self.visits + self.later_visits)

    @property
    def record_days(self) -> int:
        """Days that the record takes, begun ones counted; 0 of visits."""
        return int(-(-(RECORD_BEGINS_MIN + self.record_min) // 1440)) if self.is_record else 0

    def _days_of(self, visits: int) -> int:
        if not visits:
            return 0
        minutes = self.observations_per_visit * self.observation_interval_s / 60.0
        a_day = max(1, min(7, int(600 / minutes)))
        working = -(-visits // a_day)
        # One day in seven is a day of rest.
        return max(5, working + working // 6 + 1)

    def setup_of(self, visit: IntArray) -> IntArray:
        """Number the set-ups that visits belong to: a record's blocks share one."""
        return np.maximum(visit - (self.visits - 1), 0) if self.is_record else visit

    @property
    def visit_min(self) -> float:
        """Duration of a visit [min]."""
        return self.observations_per_visit * self.observation_interval_s / 60.0


NO_SCATTER: Final = {
    "repeatability_um": 0.0,
    "setup_shift_um": 0.0,
    "setup_tilt_um": 0.0,
    "map_error_um": 0.0,
    "sensor_noise_c": 0.0,
    "quantum_c": 0.0,
}
"""Conditions under which everything is known exactly."""
