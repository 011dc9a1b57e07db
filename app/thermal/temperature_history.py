"""Recorded temperatures over time, and the temperature between two readings."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from app.arrays import FloatArray, frozen


@dataclass(frozen=True, eq=False)
class TemperatureHistory:
    """Readings of several sensors, ordered in time.

    Parameters
    ----------
    times_s : ndarray, shape (n,) [s]
        Seconds since 1970-01-01 UTC, strictly increasing.
    temperatures_c : mapping of sensor to ndarray, shape (n,) [°C]
        NaN where a reading has no value of that sensor.
    """

    times_s: FloatArray
    temperatures_c: Mapping[str, FloatArray]

    @classmethod
    def of_readings(
        cls, sensors: Iterable[str], readings: Sequence[tuple[float, Mapping[str, float]]]
    ) -> TemperatureHistory:
        """Set readings, (time [s], sensor → temperature [°C]) in order of time, side by side."""
        return cls(
            frozen([time_s for time_s, _ in readings]) if readings else np.empty(0),
            {
                name: np.array([values.get(name, np.nan) for _, values in readings], dtype=float)
                for name in sensors
            },
        )

    def series(self, sensor: str) -> tuple[FloatArray, FloatArray]:
        """Return the times [s] and temperatures [°C] at which a sensor has a value."""
        values = self.temperatures_c[sensor]
        has_value = ~np.isnan(values)
        return self.times_s[has_value], values[has_value]

    def at(self, sensor: str, times_s: ArrayLike, max_gap_s: float) -> FloatArray:
        """Interpolate a sensor's temperature linearly in time.

        Parameters
        ----------
        times_s : array-like, shape (m,) [s]
        max_gap_s
            Neighbouring readings further apart than this are not bridged [s]; the
            last reading also serves alone for this long after it.

        Returns
        -------
        ndarray, shape (m,) [°C]
            NaN where no reading is near enough.

        Examples
        --------
        >>> history = TemperatureHistory.of_readings(
        ...     ["a"], [(0.0, {"a": 20.0}), (60.0, {"a": 23.0})])
        >>> history.at("a", [20.0, 300.0], max_gap_s=120.0).tolist()
        [21.0, nan]
        """
        return between_readings(*self.series(sensor), times_s, max_gap_s)


def between_readings(
    times_s: FloatArray, values: FloatArray, wanted_s: ArrayLike, max_gap_s: float
) -> FloatArray:
    """Interpolate readings linearly in time, as `TemperatureHistory.at`.

    Parameters
    ----------
    times_s, values : ndarray, shape (n,) [s], [°C]
        Readings in order of time, none of them NaN.
    wanted_s : array-like, shape (m,) [s]

    Returns
    -------
    ndarray, shape (m,) [°C]
    """
    wanted = np.atleast_1d(np.asarray(wanted_s, dtype=float))
    if times_s.size == 0:
        return np.full(wanted.shape, np.nan)
    # One search serves for all that is asked of the two neighbours.
    before = np.maximum(np.searchsorted(times_s, wanted, side="right") - 1, 0)
    elapsed = wanted - times_s[before]
    after = np.where(elapsed > 0.0, np.minimum(before + 1, times_s.size - 1), before)
    span, rise = times_s[after] - times_s[before], values[after] - values[before]
    interpolated = values[before] + rise / np.where(span > 0.0, span, 1.0) * elapsed
    too_wide, too_late, too_early = span > max_gap_s, elapsed > max_gap_s, elapsed < 0.0
    return np.where(too_wide | too_late | too_early, np.nan, interpolated)
