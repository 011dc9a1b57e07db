"""Machines' values for Prometheus: temperatures, verdicts, compensations, watches, analyses.

Units are Prometheus' base units, except °C, as its conventions allow. What is not known has no
sample: a 0 in its place would be drawn, and believed.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.core import GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from app.identification.watch.watching import LIMIT
from app.services.watching_values import ShopValues
from app.status.machine_status import Largest, Verdict
from app.storage.records import AnalysisStatus
from app.units import MM_PER_M, UM_PER_MM, URAD_PER_RAD, Unit

UM_PER_M: Final = UM_PER_MM * MM_PER_M

VERDICTS: Final = {Verdict.TRUSTED: 0, Verdict.LIMITED: 1, Verdict.NOT_TRUSTED: 2}


def machine_metrics(values: ShopValues | None) -> bytes:
    """Write the machines' values in Prometheus' text format.

    Parameters
    ----------
    values
        None where they did not come in time: then only that is said.
    """
    registry = CollectorRegistry()
    registry.register(_Values(values))
    return generate_latest(registry)


class _Values(Collector):
    """The values of one moment."""

    def __init__(self, values: ShopValues | None) -> None:
        self._values = values

    def collect(self) -> Iterator[Metric]:
        """Hand them out."""
        yield GaugeMetricFamily(
            "thermap_machine_values_missing",
            "1 where the machines' values could not be computed in time, and are left out",
            value=float(self._values is None),
        )
        if self._values is None:
            return
        yield GaugeMetricFamily(
            "thermap_machines_left_out",
            "Machines beyond the first 1000 by id, whose values are left out",
            value=self._values.left_out,
        )
        yield from _of_sensors(self._values)
        yield from _of_machines(self._values)
        if self._values.analyses is not None:
            yield from _of_database(self._values)


def _of_sensors(values: ShopValues) -> Iterator[Metric]:
    labels = ["machine", "sensor"]
    temperature = GaugeMetricFamily(
        "thermap_sensor_temperature_celsius", "Latest temperature of a sensor [°C]", labels=labels
    )
    age = GaugeMetricFamily(
        "thermap_sensor_age_seconds", "Age of a sensor's latest temperature [s]", labels=labels
    )
    health = GaugeMetricFamily(
        "thermap_sensor_health",
        "1 with what is the matter with a sensor in `health`: ok, missing, stale, out-of-range, "
        "stuck, jump or faulty",
        labels=[*labels, "health"],
    )
    for machine in values.machines:
        for sensor in machine.sensors:
            which = [machine.machine, sensor.sensor]
            if sensor.temperature_c is not None:
                temperature.add_metric(which, sensor.temperature_c)
            if sensor.age_s is not None:
                age.add_metric(which, sensor.age_s)
            health.add_metric([*which, sensor.health.value], 1.0)
    yield from (temperature, age, health)


def _of_machines(values: ShopValues) -> Iterator[Metric]:
    verdict = _family(
        "thermap_machine_verdict", "Verdict on a machine: 0 trusted, 1 limited, 2 not-trusted"
    )
    state = GaugeMetricFamily(
        "thermap_machine_state",
        "1 with the worst of what is the matter with a machine in `state`, fresh where nothing is",
        labels=["machine", "state"],
    )
    components = _family(
        "thermap_machine_components", "Components of a machine's table, 0 without one"
    )
    complete = _family(
        "thermap_machine_table_complete",
        "1 where a machine's table lacks nothing and rests on nothing old, else 0",
    )
    age = _family("thermap_reading_age_seconds", "Age of the latest reading in use [s]")
    lengths = _family(
        "thermap_largest_compensation_meters",
        "Largest compensation of a machine's table, with its sign [m]",
    )
    angles = _family(
        "thermap_largest_compensation_radians",
        "Largest compensation, with its sign, of a table without displacements [rad]",
    )
    for machine in values.machines:
        which = [machine.machine]
        verdict.add_metric(which, VERDICTS[machine.verdict])
        state.add_metric([*which, machine.state.value], 1.0)
        components.add_metric(which, machine.components)
        complete.add_metric(which, float(machine.complete))
        if machine.reading_age_s is not None:
            age.add_metric(which, machine.reading_age_s)
        if machine.largest is not None:
            _add_largest(lengths, angles, which, machine.largest)
    yield from (verdict, state, components, complete, age, lengths, angles)


def _add_largest(
    lengths: GaugeMetricFamily, angles: GaugeMetricFamily, which: list[str], largest: Largest
) -> None:
    if largest.unit == Unit.UM.symbol:
        lengths.add_metric(which, largest.value / UM_PER_M)
    elif largest.unit in (Unit.URAD.symbol, Unit.UM_PER_M.symbol):  # µm/m is µrad
        angles.add_metric(which, largest.value / URAD_PER_RAD)


def _of_database(values: ShopValues) -> Iterator[Metric]:
    """Tell what is known while the database answers."""
    beyond = _family(
        "thermap_machine_watch_beyond",
        "1 where verifications are beyond what a machine's model allows, 0 where within; none "
        "where nothing could be judged yet",
    )
    as_expected = _family(
        "thermap_machine_last_check_as_expected",
        "1 where the latest verification was off by no more than was to be expected, 0 where by "
        "more; none where that is not known",
    )
    not_adopted = _family(
        "thermap_machine_effects_not_adopted",
        "Effects that the latest analysis of the active model confirmed and nobody adopted",
    )
    waits = _family(
        "thermap_machine_analysis_progress_ratio",
        "Share that is done of the oldest analysis of a machine that waits or runs",
    )
    for machine in values.machines:
        which = [machine.machine]
        if machine.watch in _WATCHES:
            beyond.add_metric(which, _WATCHES[machine.watch])
        if machine.last_check is not None and machine.last_check.as_expected is not None:
            as_expected.add_metric(which, float(machine.last_check.as_expected))
        not_adopted.add_metric(
            which, 0 if machine.not_adopted is None else len(machine.not_adopted.effects)
        )
        if machine.analysis is not None:
            waits.add_metric(which, machine.analysis.progress)
    analyses = GaugeMetricFamily(
        "thermap_analyses", "Analyses in the database by status", labels=["status"]
    )
    counted = values.analyses or {}
    for status in AnalysisStatus:
        analyses.add_metric([status.value], counted.get(status.value, 0))
    limit = GaugeMetricFamily(
        "thermap_watch_evidence_limit",
        "Evidence above which a machine's watch is beyond: a ratio of likelihoods",
        value=LIMIT,
    )
    yield from (beyond, as_expected, not_adopted, waits, analyses, limit)
    yield from _of_watches(values)


def _of_watches(values: ShopValues) -> Iterator[Metric]:
    """Tell what the last verifications left."""
    evidence = _family(
        "thermap_machine_watch_evidence",
        "Evidence of all verifications that a machine has changed; see the limit",
    )
    sigmas = _family(
        "thermap_machine_watch_largest_sigmas",
        "Largest latest deviation of a followed number, over the standard deviation that was to be "
        "expected of it",
    )
    times = _family(
        "thermap_verification_time_seconds", "When the latest verification was measured [Unix time]"
    )
    quantity = "of the latest verification: measured minus predicted"
    rms = {
        Unit.UM: _family("thermap_verification_rms_meters", f"Root mean square {quantity} [m]"),
        Unit.URAD: _family(
            "thermap_verification_rms_radians", f"Root mean square {quantity} [rad]"
        ),
    }
    largest = {
        Unit.UM: _family(
            "thermap_verification_largest_meters", f"Largest, with its sign, {quantity} [m]"
        ),
        Unit.URAD: _family(
            "thermap_verification_largest_radians", f"Largest, with its sign, {quantity} [rad]"
        ),
    }
    for machine in values.machines:
        which, watched = [machine.machine], values.watches.get(machine.machine)
        if watched is None or watched.figures is None:
            continue
        figures = watched.figures
        evidence.add_metric(which, figures.evidence)
        times.add_metric(which, figures.latest.time_s)
        if figures.most_sigmas is not None:
            sigmas.add_metric(which, figures.most_sigmas)
        for unit, factor in ((Unit.UM, UM_PER_M), (Unit.URAD, URAD_PER_RAD)):
            if unit.symbol in figures.latest.rms:
                rms[unit].add_metric(which, figures.latest.rms[unit.symbol] / factor)
                largest[unit].add_metric(which, figures.latest.largest[unit.symbol] / factor)
    yield from (evidence, sigmas, times, *rms.values(), *largest.values())


_WATCHES: Final = {"within": 0.0, "beyond": 1.0}


def _family(name: str, description: str) -> GaugeMetricFamily:
    return GaugeMetricFamily(name, description, labels=["machine"])
