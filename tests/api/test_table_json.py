"""The table's bytes against a slow writing of the same table, field by field."""

import json
import math
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.api.table_json import Layouts, table_json
from app.compensation.table import compensation_table
from app.geometry.components import COMPONENTS
from app.thermal.compile_model import compile_model
from app.thermal.error_map import ComponentTable
from app.thermal.machine import OutOfRange
from app.thermal.sensor_health import Health, SensorState
from tests.thermal.example_maps import error_map, machine

NOW = datetime(2026, 1, 1, tzinfo=UTC)
SMALL_AND_LARGE = [0.0, -0.0, 1e-5, -4e-5, 5e-5, -6e-5, 1e-300, 0.1, -0.25, 1e6, -1e6]
VARIANCES = [0.0, 1e-300, 1e-12, 2.5e-9, 0.01, 0.5, 1e4]
CODES = ("EXX", "EYX", "EZZ", "EBX", "SZX", "SXY")


def any_table(rng, code):
    """A component over any of four positions, in one direction or both, sure or not."""
    component = COMPONENTS[code]
    inner = rng.choice([50.0, 120.5], rng.integers(3), replace=False)
    positions = sorted([0.0, *inner, 300.0]) if component.is_table else ()
    n = len(positions) or 1

    def errors():
        return np.where(rng.random(n) < 0.5, rng.choice(SMALL_AND_LARGE, n), rng.normal(0, 9, n))

    backward = errors() if component.is_table and rng.random() < 0.5 else None
    covariance = np.diag(rng.choice(VARIANCES, n)) if rng.random() < 0.5 else None
    return ComponentTable.make(component, errors(), positions, backward, covariance)


def any_compensation_table(seed):
    """A table at any temperature, with components that have effects or without."""
    rng = np.random.default_rng(seed)
    maps = [
        error_map(f"map {t:g}", t, *(any_table(rng, code) for code in CODES))
        for t in (20.0, 23.5, 30.0)
    ]
    policy = rng.choice([OutOfRange.CLAMP, OutOfRange.EXTRAPOLATE])
    model = compile_model(machine(out_of_range=OutOfRange(policy)), maps, {})
    some = [20.0, 30.0, math.nextafter(20.0, 21.0), *rng.uniform(15.0, 35.0, 5)]
    sensors = [SensorState(s, Health.OK, float(rng.choice(some))) for s in ("x-middle", "z-column")]
    table = compensation_table(model, 3, sensors, NOW)
    corrected = [
        replace(entry, errors=entry.errors + rng.normal(), effects=("machine-state",))
        for entry in table.components
        if rng.random() < 0.3
    ]
    return table._replace(corrected=corrected)


def decimal(error):
    return float(np.round(error, 4)) + 0.0


def standard_error(value):
    return max(float(np.round(value, 4)), 1e-4) if value > 0 else 0.0


def slowly(entry):
    """What `ComponentCompensationAnswer` documents, of one component."""
    component = entry.component
    fields = {"component": component.code, "chapter": component.chapter, "axis": component.axis}

    def written(values, write):
        numbers = [write(value) for value in values]
        return numbers if component.is_table else numbers[0]

    if component.is_table:
        fields["positions_mm"] = entry.positions_mm.tolist()
    for before, errors, minus, uncertain in (
        ("", entry.errors, entry.compensation, entry.standard_errors),
        (
            "backward_",
            entry.backward_errors,
            None if entry.backward_errors is None else 0.0 - entry.backward_errors,
            entry.backward_standard_errors,
        ),
    ):
        if errors is not None:
            fields[before + component.error_field] = written(errors, decimal)
            fields[before + component.compensation_field] = written(minus, decimal)
        if uncertain is not None:
            fields[before + component.standard_error_field] = written(uncertain, standard_error)
    if component.iso:
        fields["iso"] = component.iso
        fields["iso_error_urad"] = decimal(component.iso_sign * entry.errors[0])
    origin = entry.basis
    return fields | {
        "sensor": origin.sensor,
        "temperature_c": origin.temperature_c,
        "lower_map": origin.lower_map,
        "upper_map": origin.upper_map,
        "weight": round(origin.weight, 6),
        "status": origin.status,
        "effects": list(entry.effects),
    }


@pytest.mark.slow
@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1))
def test_every_number_is_the_tables_to_a_tenth_of_a_nanometre(seed):
    table = any_compensation_table(seed)
    content = table_json(table)
    assert json.loads(content)["components"] == [slowly(entry) for entry in table.components]
    assert b"-0.0," not in content
    assert b"-0.0]" not in content


def test_what_is_remembered_of_tables_has_a_bounded_size(monkeypatch):
    kept = Layouts(40_000)
    monkeypatch.setattr("app.api.table_json.LAYOUTS", kept)
    sizes = []
    for seed in range(60):
        table = any_compensation_table(seed)
        fresh = table_json(table)
        assert table_json(table) == fresh  # from what was kept
        sizes.append(kept.bytes)
    assert max(sizes) <= 40_000
    assert sizes[-1] > 10_000, "nothing was kept"
    table = any_compensation_table(61)
    monkeypatch.setattr("app.api.table_json.LAYOUTS", Layouts(0))
    assert table_json(table) == table_json(table), "a layout that has no room is made each time"
