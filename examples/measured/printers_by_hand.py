"""What can be learnt of the printers by hand, on the same stretches: what the loop stands beside.

A ridge on frame and bed with lags knows no maps. Least squares on the bed, now and late, do: they
say what an effect that the library lacks, a second sensor's own lag, would leave of them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np

from app.arrays import FloatArray, IntArray, rms
from app.effects.low_pass import low_pass
from app.search.response import Course, Group, Response, learn_response
from app.units import SECONDS_PER_MIN
from examples.measured.black_boxes import learn_ridge
from examples.measured.printers import PARTS, REST_S, Homings, Printer

RIDGE_MIN: Final = (0.0, 5.0, 20.0, 60.0)
RESPONSE_MIN: Final = (0.0, 20.0, 80.0)
LATE_MIN: Final = (1.0, 2.0, 3.0, 5.0, 7.0, 10.0, 15.0, 20.0, 30.0, 45.0, 60.0)
CONSTANT_K: Final = 10.0
"""The ridge's constant is shrunk as a temperature of so many kelvins would be."""

Predict: TypeAlias = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True, eq=False)
class Samples:
    """Means of the homings of each sample, in order of time, and its stretch."""

    ids: IntArray
    times_s: FloatArray
    z_um: FloatArray
    temperatures_c: dict[str, FloatArray]
    stretch: IntArray

    def late(self, sensor: str, minutes: float) -> FloatArray:
        """Give a temperature late by a time constant, its first reading held before [°C]."""
        values = self.temperatures_c[sensor]
        if not minutes:
            return values
        times_s = np.append(self.times_s[0] - REST_S, self.times_s)
        rested = np.append(values[0], values)
        return low_pass(times_s, rested, minutes * SECONDS_PER_MIN).outputs[1:]


def print_by_hand(name: str, printer: Printer, homings: Homings) -> None:
    """Print what is left of the stretches left out, and of the first one apart."""
    samples = _samples(printer, homings)
    late, minutes = _by_bed(printer, samples)
    for words, left in (
        ("a ridge on frame and bed with lags", _by_ridge(samples)),
        (f"the bed beyond the maps, now and {minutes} min late", late),
        ("a response, learnt of stretches as if they were set-ups", _by_response(printer, samples)),
    ):
        first = samples.stretch == 0
        print(
            f"  {name}, {words}: {rms(left):.1f} µm; the first stretch {rms(left[first]):.1f}, "
            f"all others {rms(left[~first]):.1f}"
        )


def _samples(printer: Printer, homings: Homings) -> Samples:
    ids = np.unique(homings.samples)
    own = [homings.samples == sample for sample in ids]

    def mean(values: FloatArray) -> FloatArray:
        return np.array([values[rows].mean() for rows in own])

    times_s = mean(homings.times_s)
    return Samples(
        ids,
        times_s,
        mean(homings.z_um),
        {name: mean(values) for name, values in homings.temperatures_c.items()},
        ((times_s - homings.times_s[0]) // printer.stretch_s).astype(np.intp),
    )


def _by_ridge(samples: Samples) -> FloatArray:
    """Give what a ridge leaves of each sample, shape (n,) [µm]."""
    columns = [np.full(samples.times_s.shape, CONSTANT_K)]
    for sensor in ("frame", "bed"):
        late = [samples.late(sensor, minutes) for minutes in RIDGE_MIN]
        columns += [values - values[0] for values in late]
    rows = np.column_stack(columns)
    left = np.empty(samples.times_s.shape)
    for asked in _parts(samples):
        known = [
            Course(samples.times_s[one], rows[one], samples.z_um[one], is_zeroed=False)
            for one in (samples.stretch == n for n in np.unique(samples.stretch[~asked]))
        ]
        left[asked] = samples.z_um[asked] - learn_ridge(known)(rows[asked])
    return left


def _by_bed(printer: Printer, samples: Samples) -> tuple[FloatArray, str]:
    """Give what least squares leave of the maps, and the lags that they choose."""
    over_frame = _over_frame(printer, samples)
    values = samples.z_um - over_frame(samples.z_um)

    def columns(minutes: float) -> FloatArray:
        both = (samples.late("bed", late) for late in (0.0, minutes))
        return np.column_stack([bed - over_frame(bed) for bed in both])

    left, chosen = np.empty(values.shape), []
    for asked in _parts(samples):
        tried = []
        for minutes in LATE_MIN:
            rows = columns(minutes)
            slopes = np.linalg.lstsq(rows[~asked], values[~asked], rcond=None)[0]
            rest = values - rows @ slopes
            tried.append((rms(rest[~asked]), minutes, rest[asked]))
        _, minutes, left[asked] = min(tried, key=lambda one: one[0])
        chosen.append(f"{minutes:g}")
    return left, ", ".join(dict.fromkeys(chosen))


def _by_response(printer: Printer, samples: Samples) -> FloatArray:
    """Give what a response beside the maps leaves, its groups of lags shrunk jointly."""
    sensors = sorted(samples.temperatures_c)
    late = [samples.late(sensor, m) for m in RESPONSE_MIN for sensor in sensors]
    centred = [values - values.mean() for values in late]
    columns = np.column_stack([*centred, np.full(samples.times_s.shape, CONSTANT_K)])
    each = np.split(np.eye(columns.shape[1]), np.arange(1, 1 + len(RESPONSE_MIN)) * len(sensors), 1)
    groups = [Group(str(i), directions, directions) for i, directions in enumerate(each)]
    values = samples.z_um - _over_frame(printer, samples)(samples.z_um)
    left = np.empty(values.shape)
    for asked in _parts(samples):
        courses = []
        for stretch in np.unique(samples.stretch[~asked]):
            own = samples.stretch == stretch
            times_s = samples.times_s[own]
            since_min = (times_s - times_s[0]) / SECONDS_PER_MIN
            courses.append(Course(since_min, columns[own], values[own], False, float(times_s[0])))
        fitted = learn_response(Response(courses, groups, np.zeros(columns.shape[1])))
        left[asked] = values[asked] - columns[asked] @ fitted.common()
    return left


def _parts(samples: Samples) -> list[np.ndarray]:
    return [samples.stretch % PARTS == part for part in range(PARTS)]


def _over_frame(printer: Printer, samples: Samples) -> Predict:
    """Make what maps from some samples say of others, as lines over the frame's temperature."""
    frame_c = samples.temperatures_c["frame"]
    at = np.searchsorted(samples.ids, printer.mapped)
    at = at[np.argsort(frame_c[at])]
    below = np.clip(np.searchsorted(frame_c[at], frame_c) - 1, 0, at.size - 2)
    low, high = at[below], at[below + 1]
    share = (frame_c - frame_c[low]) / (frame_c[high] - frame_c[low])
    return lambda values: values[low] + share * (values[high] - values[low])
