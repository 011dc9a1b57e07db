"""The maps' own uncertainty over the rows: linear, sparse, and no larger than it must be."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse import csr_array

from app.effects.supposition import left_by_temperatures
from app.errors import InvalidContent
from app.geometry.components import COMPONENTS
from app.identification.campaign import Campaign, residuals_of
from app.identification.residuals import map_uncertainty as module
from app.identification.residuals.inexact_sensors import (
    inexact_sensors,
    looked_back,
    map_temperature_columns,
    read_inexactly,
    reading_error_columns,
)
from app.identification.residuals.map_uncertainty import (
    between_positions,
    channel_entries,
    combined,
    entry_columns,
    entry_errors,
    map_uncertainty,
)
from app.identification.residuals.residuals import compute_residuals
from app.identification.watch.watching import WatchState, watch
from app.thermal.compile_model import compile_model
from app.thermal.error_map import ComponentTable
from app.thermal.temperature_history import TemperatureHistory
from tests.effects.example_campaign_view import ASSIGNMENT, example_view, observations, readings

MEBI = 2**20


def test_entries_of_the_maps_are_linear_in_the_prediction():
    """Moving one entry of one map by 1 µm moves the predictions by its column."""
    where = example_view()
    for code, label, at in (("EXX", "Run #3", 2), ("EZZ", "Run #6", 4), ("SXY", "Run #1", 0)):
        moved = []
        for m in where.maps:
            tables = dict(m.tables)
            if m.label == label:
                errors = tables[code].errors.copy()
                errors[at] += 1.0
                tables[code] = replace(tables[code], errors=errors)
            moved.append(replace(m, tables=tables))
        other = compile_model(where.machine, moved, ASSIGNMENT)
        change = (
            compute_residuals(other, where.rows, where.conditions).predicted
            - compute_residuals(where.model, where.rows, where.conditions).predicted
        )
        view = where.projection.view(code)
        columns = entry_columns(where.model, code, view).toarray()
        group, member = where.model.find(code)
        width = max(member.positions_mm.size, 1)
        column = group.labels.index(label) * width + at
        found = np.zeros(len(where.rows))
        assert columns.shape[1] == len(group.labels) * width
        found[view.rows] = columns[:, column]
        np.testing.assert_allclose(found, change, atol=1e-9)
        assert found.any()


def test_entry_errors_are_stated_or_assumed():
    where = example_view()
    assert set(entry_errors(where.model, where.maps, "EXX").tolist()) == {0.5}
    precise = [replace(m, repeatability_um=0.2) for m in where.maps]
    assert set(entry_errors(where.model, precise, "EXX").tolist()) == {0.2}
    # Repeatability in µm says nothing about µm/m.
    assert set(entry_errors(where.model, precise, "SXY").tolist()) == {0.5}
    stated = [
        replace(
            m, tables={**m.tables, "EXX": replace(m.tables["EXX"], covariance=np.full(5, 0.09))}
        )
        for m in where.maps
    ]
    model = compile_model(where.machine, stated, ASSIGNMENT)
    assert entry_errors(model, stated, "EXX").tolist() == pytest.approx([0.3] * 15)
    assert entry_errors(model, stated, "EYX").tolist() == [0.5] * 15


def test_combined_columns_give_the_rows_the_same_covariance():
    rng = np.random.default_rng(3)
    smooth = np.cos(np.outer(np.linspace(0, 3, 80), np.arange(200) % 7)) * rng.uniform(0.1, 1, 200)
    few = combined(csr_array(smooth))
    assert few.shape[1] <= 7
    largest = np.sum(smooth**2, axis=1).max()
    difference = np.diag(few @ few.T - smooth @ smooth.T)
    assert np.abs(difference).sum() <= 0.5 * largest * 1.001


@given(st.integers(0, 2**32 - 1), st.integers(1, 40), st.integers(1, 40))
def test_no_row_loses_more_than_a_tenth_of_its_own_variance(seed, rows, entries):
    """A point by itself, on entries that no other row has, kept nothing at all of a smaller one."""
    rng = np.random.default_rng(seed)
    dense = np.where(rng.random((rows, entries)) < 0.2, rng.uniform(0.0, 1.0, (rows, entries)), 0.0)
    few = combined(csr_array(dense))
    own, kept = np.sum(dense**2, axis=1), np.sum(few**2, axis=1)
    assert (kept >= 0.9 * own - 1e-9).all()
    assert (own - kept).sum() <= 0.5 * own.max() + 1e-9


def test_points_carry_all_components():
    where = example_view()
    by_channel = {
        where.rows.channels[n.channel]: n for n in map_uncertainty(where.projection, where.maps)
    }
    assert set(by_channel) == set(where.rows.channels)
    own = by_channel["EXX"]
    # Each row lies between two maps and two positions: the weights add up to one.
    np.testing.assert_allclose(own.columns.sum(axis=1) / 0.5, 1.0)
    assert by_channel["points z"].columns.shape[0] == where.rows.of_channel("points z").size


def test_channels_share_the_errors_of_one_map():
    """Columns times shared unit errors give back each channel's own entries."""
    where = example_view()
    entries = {one.channel: one for one in channel_entries(where.projection, where.maps)}
    nuisance = {one.channel: one for one in map_uncertainty(where.projection, where.maps)}
    assert set(nuisance) == set(entries)
    touched = np.unique(np.concatenate([one.touched for one in entries.values()]))
    largest = max(one.columns.toarray().max() for one in entries.values())
    for channel, one in nuisance.items():
        back = one.columns @ one.shared.T.toarray()
        own = entries[channel].columns[:, touched].toarray()
        np.testing.assert_allclose(back, own, atol=largest)
        np.testing.assert_allclose(back @ back.T, own @ own.T, atol=0.5 * largest**2)


def test_a_straight_line_between_positions_leaves_the_curve_of_the_error():
    """With EXX at 2 µm/K times the square of the share of travel, what lies between is known."""
    where, curved = example_view(), []
    along = np.linspace(0.0, 1.0, 5)
    for m in where.maps:
        above = m.temperatures_c["x-middle"] - 20.0
        table = ComponentTable.make(COMPONENTS["EXX"], 2.0 * above * along**2, 500.0 * along)
        curved.append(replace(m, tables={**m.tables, "EXX": table}, repeatability_um=1e-6))
    model = compile_model(where.machine, curved, ASSIGNMENT)
    projection = residuals_of(Campaign(model, curved, observations(), *readings())).projection
    view = projection.view("EXX")
    own = next(
        one
        for one in between_positions(projection, curved)
        if projection.rows.channels[one.channel] == "EXX"
    )
    at = np.searchsorted(view.rows, own.rows)
    above = view.conditions.temperatures_c["x-middle"][at] - 20.0
    u = view.places.positions_mm[at] / 125.0 % 1.0
    # The straight line is above the parabola; outside the maps their end values hold.
    left = 2.0 * np.clip(above, 0.0, 10.0) * u * (1.0 - u) / 16.0
    np.testing.assert_allclose(own.columns[:, 0], left, atol=1e-6)
    assert np.ptp(left) > 0.01
    # Once more gap by gap: no row lies in two of them.
    assert (np.count_nonzero(own.columns[:, 1:], axis=1) <= 1).all()
    assert own.columns.shape[1] > 2


def test_what_entries_scatter_is_not_taken_for_a_curve():
    """With the half micrometre that is assumed, a curve of less than that is nowhere to be seen."""
    where = example_view()
    channels = [one.channel for one in between_positions(where.projection, where.maps)]
    assert where.rows.channels.index("EXX") not in channels


def dense_maps(where, positions):
    """The same lines through the ends, but with many positions along each axis."""
    along = np.linspace(0.0, 500.0, positions)
    found = []
    for m in where.maps[:2]:
        slope = float(m.tables["EXX"].errors[-1]) / 500.0
        table = ComponentTable.make(COMPONENTS["EXX"], slope * along, along)
        found.append(replace(m, tables={**m.tables, "EXX": table}))
    return found


def test_a_small_verification_takes_little_memory_however_fine_the_maps_are():
    """20 observations on two maps of 20,000 positions: a matrix of all entries takes 12.8 GB."""
    where = example_view()
    maps = dense_maps(where, 20_000)
    model = compile_model(where.machine, maps, ASSIGNMENT)
    history, states = readings()
    line = [o for v in observations() for o in v.observations if o.component == "EXX"][:20]
    small = replace(observations()[0], observations=tuple(line), repeatability_um=0.5)
    assert len(line) == 20
    campaign = Campaign(model, maps, [small], history, states)
    tracemalloc.start()
    try:
        watch(campaign, WatchState(), 1)
        map_uncertainty(residuals_of(campaign).projection, maps)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 60 * MEBI


def test_more_columns_than_the_stated_memory_holds_are_refused(monkeypatch):
    where = example_view()
    monkeypatch.setattr(module, "MOST_NUMBERS", 1000)
    with pytest.raises(
        InvalidContent, match=r"at most 1,000 numbers, got [0-9,]+ for [0-9,]+ values of"
    ):
        map_uncertainty(where.projection, where.maps)


def test_a_coarse_sensor_is_one_unknown_for_each_stay_of_its_reading():
    """All components that follow it are off together, each by its own slope; no others are."""
    where = example_view()
    history, _ = readings()
    read = {name: values.copy() for name, values in history.temperatures_c.items()}
    read["x-middle"] = np.round(read["x-middle"])
    coarse = inexact_sensors(where.machine, TemperatureHistory(history.times_s, read))
    assert list(coarse) == ["x-middle"]
    steps = reading_error_columns(where.projection, history, coarse)
    off_k = np.full(len(where.rows), 1.0 / np.sqrt(12.0))
    change = left_by_temperatures(where.projection, {"x-middle": off_k})
    np.testing.assert_allclose(steps.sum(axis=1), change)
    assert (np.diff(steps.indptr) <= 1).all()
    # Rows of one column were read alike.
    at = np.searchsorted(history.times_s, where.rows.times_s)
    for column in range(steps.shape[1]):
        rows = np.flatnonzero(steps[:, [column]].toarray())
        assert np.ptp(read["x-middle"][np.minimum(at[rows], len(read["x-middle"]) - 1)]) <= 1.0
    plain, with_steps = (
        {n.channel: n.columns.shape[1] for n in map_uncertainty(where.projection, where.maps, one)}
        for one in (None, steps)
    )
    follows = where.rows.channels.index("EXX")
    others = where.rows.channels.index("EZZ")
    assert with_steps[follows] > plain[follows]
    assert with_steps[others] == plain[others]
    (said,) = read_inexactly(coarse)
    assert said.on == "x-middle"
    assert "steps of 1 K" in said.reason
    back = looked_back(TemperatureHistory(history.times_s, read), coarse).temperatures_c
    off = [np.std(one["x-middle"] - history.temperatures_c["x-middle"]) for one in (back, read)]
    assert off[0] < 0.7 * off[1]


def test_sensors_that_are_not_coarse_change_nothing():
    where = example_view()
    history, _ = readings()
    coarse = inexact_sensors(where.machine, history)
    assert coarse == {}
    assert reading_error_columns(where.projection, history, coarse).shape == (len(where.rows), 0)


def test_what_maps_state_is_rounded_too():
    """All maps of a sensor a little warmer are as its readings a little colder."""
    where = example_view()
    model = where.projection.model
    columns = map_temperature_columns(where.projection, {})
    begin = 0
    for group in {group.sensor: group for group in model.groups}.values():
        of_sensor = columns[:, begin : begin + len(group.labels)]
        begin += len(group.labels)
        error_k = model.machine.sensor(group.sensor).resolution_c / np.sqrt(12.0)
        colder = np.full(len(where.rows), -error_k)
        change = left_by_temperatures(where.projection, {group.sensor: colder})
        assert change.any()
        np.testing.assert_allclose(of_sensor.sum(axis=1), change, atol=0.01 * np.ptp(change))
        # Between two maps only these count.
        assert (np.diff(of_sensor.tocsr().indptr) <= 2).all()
    assert begin == columns.shape[1]


def test_a_noisy_sensor_is_read_as_its_neighbouring_readings_say():
    where = example_view()
    history, _ = readings()
    read = {name: values.copy() for name, values in history.temperatures_c.items()}
    read["x-middle"] += np.random.default_rng(1).normal(0.0, 0.3, len(history.times_s))
    recorded = TemperatureHistory(history.times_s, read)
    noisy = inexact_sensors(where.machine, recorded)
    assert list(noisy) == ["x-middle"]
    columns = reading_error_columns(where.projection, recorded, noisy)
    off_k = np.full(len(where.rows), noisy["x-middle"].error_k)
    change = left_by_temperatures(where.projection, {"x-middle": off_k})
    np.testing.assert_allclose(columns.sum(axis=1), change)
    (said,) = read_inexactly(noisy)
    assert "scatters by 0.3 K from reading to reading" in said.reason
    back = looked_back(recorded, noisy).temperatures_c["x-middle"]
    assert np.std(back - history.temperatures_c["x-middle"]) < 0.15
