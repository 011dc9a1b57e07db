"""Thermal drift by a nest of sensors: by hand, by its own symmetries, by Monte Carlo."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from app.errors import InvalidContent
from app.geometry.chain import Chain
from app.geometry.error_field import ErrorField
from app.geometry.error_table import Table
from app.measurement.thermal_drift import evaluate_thermal_drift
from app.measurement.thermal_drift_readings import noise_between_neighbours

XYFZ = Chain.parse("XYFZ")
MINUTES = np.array([0.0, 30.0, 60.0, 90.0, 120.0, 150.0])
X = [1.0, 1.0, 2.0, 3.0, 3.0, 2.0]
X2 = [0.0, 0.0, 2.0, 4.0, 5.0, 3.0]
Z = [5.0, 5.0, 11.0, 14.0, 16.0, 9.0]
RUNNING = (30 * 60.0, 120 * 60.0)
POINT = [250.0, 200.0, 300.0]


def by_hand(chain=XYFZ, **changes):
    options = {"sensor_distance_mm": 100.0, "running_s": RUNNING, "point_mm": POINT} | changes
    displacements = {"x": X, "x2": X2, "z": Z}
    return evaluate_thermal_drift(chain, "spindle", 60 * MINUTES, displacements, **options)


def test_the_worked_example_by_hand():
    found = by_hand()
    figures = found.result.figures
    expected = {
        "d_X_60min_um": 2.0, "d_X_running_um": 2.0, "X_at_60min_um": 2.0, "X_at_stop_um": 2.0,
        "X_at_end_um": 1.0,
        "d_Z_60min_um": 9.0, "d_Z_running_um": 11.0, "Z_at_60min_um": 9.0, "Z_at_stop_um": 11.0,
        "Z_at_end_um": 4.0,
        "d_B_60min_urad": 20.0, "d_B_running_urad": 30.0, "B_at_60min_urad": 20.0,
        "B_at_stop_urad": 30.0, "B_at_end_urad": 20.0,
    }  # fmt: skip
    assert figures == pytest.approx(expected, abs=1e-12)
    first, last = found.states
    assert {t.component.code: t.errors.tolist() for t in first.tables} == {
        "EXZ": [0.0], "EZZ": [0.0], "EBZ": [0.0],
    }  # fmt: skip
    assert last.time_s == 120 * 60.0
    assert {t.component.code: t.errors[0] for t in last.tables} == pytest.approx(
        {"EXZ": 2.0, "EZZ": 11.0, "EBZ": 30.0}
    )
    assert all(t.positions_mm.tolist() == [300.0] for t in last.tables)


def test_the_tilt_about_x_turns_y_the_other_way():
    """A > 0 moves what lies further along Z to −Y, by the right-hand rule."""
    found = evaluate_thermal_drift(
        XYFZ, "environment", [0, 60], {"y": [0, 0], "y2": [0, -2]}, sensor_distance_mm=200.0
    )
    assert found.courses["a"][0].values[-1] == pytest.approx(10.0)
    assert found.result.figures["ETVE_A_urad"] == pytest.approx(10.0)


@pytest.mark.parametrize("chain", ["FXYZ", "XFYZ", "XYFZ", "FYXZ", "YFXZ"])
def test_the_map_gives_back_what_both_heights_of_the_nest_have_read(chain):
    """Growth and tilt of the spindle, anywhere in the volume."""
    drift = evaluate_thermal_drift(
        Chain.parse(chain), "spindle", [0, 3600],
        {"x": [0, 3], "y": [0, -2], "z": [0, 9], "x2": [0, 7], "y2": [0, -1]},
        sensor_distance_mm=-80.0, point_mm=POINT, tool_offset_mm=[5, 0, 160],
    )  # fmt: skip
    field = ErrorField.make(
        Chain.parse(chain),
        {t.component.code: Table(t.positions_mm, t.errors) for t in drift.result.tables},
        drift.result.measuring_lines,
    )
    for place in (POINT, [0.0, 0.0, 0.0], [480.0, 10.0, 77.0]):
        for height, read in ((160.0, [3.0, -2.0, 9.0]), (80.0, [7.0, -1.0, 9.0])):
            errors, _ = field.at([place], [5.0, 0.0, height])
            np.testing.assert_allclose(errors, [read], atol=1e-9)


def numbers(low, high):
    return st.integers(low, high).map(float)


@given(arrays(np.float64, st.integers(2, 30), elements=numbers(-300, 300)), st.integers(-400, 400))
def test_the_zero_of_the_sensors_changes_nothing(read, zero):
    times = 60.0 * np.arange(read.size)
    found, moved = (
        evaluate_thermal_drift(XYFZ, "spindle", times, {"z": values}, point_mm=POINT)
        for values in (read, read + zero)
    )
    assert moved.result.figures == pytest.approx(found.result.figures)
    assert moved.states[-1].tables[0].errors.tolist() == found.states[-1].tables[0].errors.tolist()


@given(arrays(np.float64, st.integers(3, 30), elements=numbers(-300, 300)))
def test_a_range_over_longer_is_never_smaller(read):
    times = 600.0 * np.arange(read.size)
    figures = evaluate_thermal_drift(XYFZ, "spindle", times, {"z": read}).result.figures
    assert figures["d_Z_running_um"] == pytest.approx(np.ptp(read))
    assert figures.get("d_Z_60min_um", 0.0) <= figures["d_Z_running_um"]
    assert ("d_Z_60min_um" in figures) == (times[-1] >= 3600.0)


def test_a_first_order_warm_up_has_its_known_figures():
    """12 µm with a time constant of 40 min: 1 − exp(−60/40) of it after an hour."""
    minutes = np.arange(0.0, 241.0)
    warm_up = 12.0 * (1.0 - np.exp(-minutes / 40.0))
    found = evaluate_thermal_drift(XYFZ, "spindle", 60.0 * minutes, {"z": warm_up})
    assert found.result.figures["d_Z_60min_um"] == pytest.approx(12.0 * (1.0 - np.exp(-1.5)))
    assert found.result.figures["Z_at_stop_um"] == pytest.approx(12.0 * (1.0 - np.exp(-6.0)))


def test_each_target_of_a_moving_axis_counts_from_its_own_first_reading():
    """Read at 50 and 450 mm in turn; the screw grows by 10 µm/m from the fixed end at 0."""
    places = np.tile([50.0, 450.0], 13)
    times = 300.0 * np.arange(26)
    grown = 10.0 * places / 1000.0 * np.minimum(times / 3600.0, 1.0)
    zeros = np.where(places == 50.0, 40.0, -7.0)
    found = evaluate_thermal_drift(
        XYFZ, "linear-axis", times, {"x": grown + zeros, "z": 0.0 * grown},
        axis="x", positions_mm=places, point_mm=[0, 200, 300],
    )  # fmt: skip
    scale, level = found.states[-1].tables
    assert (scale.component.code, level.component.code) == ("EXX", "EZX")
    assert scale.positions_mm.tolist() == [50.0, 450.0]
    # The second target's own first reading comes five minutes late: 10 µm/m · 0.45 m · 5/60.
    np.testing.assert_allclose(scale.errors, [0.5, 4.5 * 55 / 60], atol=1e-12)
    slope = (4.5 * 55 / 60 - 0.5) / 0.4
    assert found.result.figures["X_slope_change_um_per_m"] == pytest.approx(slope)
    assert found.result.figures["d_X_P2_running_um"] == pytest.approx(4.5 * 55 / 60)
    assert found.result.measuring_lines["x"].point_mm == (0.0, 200.0, 300.0)


def test_the_slope_changes_from_the_start_of_running():
    """ISO 230-3:2020, moving linear axes: the machine drifts by 40 µm/m before the axis moves.

    By hand: it stands for an hour while the second target drifts by 40 µm/m · 0.5 m; then the axis
    runs for two hours, and the screw grows by 20 (1 − exp(−t/1 h)) µm/m.
    """
    hours = np.arange(0.0, 3.01, 0.125)
    places = np.where(np.arange(hours.size) % 2, 550.0, 50.0)
    before = 40.0 * np.minimum(hours, 1.0)
    grown = 20.0 * (1.0 - np.exp(-np.maximum(hours - 1.0, 0.0)))
    found = evaluate_thermal_drift(
        XYFZ, "linear-axis", 3600.0 * hours, {"x": (before + grown) * (places - 50.0) / 1000.0},
        axis="x", positions_mm=places, running_s=(3600.0, 3.0 * 3600.0),
    )  # fmt: skip
    # The end of running is read at 50 mm; at 550 mm the last reading is that of 2.875 h. At 1 h
    # that target is between readings: of 0.875 h and of 1.125 h.
    start = (40.0 * 0.875 + 40.0 + 20.0 * (1.0 - np.exp(-0.125))) / 2.0
    end = 40.0 + 20.0 * (1.0 - np.exp(-1.875))
    assert found.result.figures["X_slope_change_um_per_m"] == pytest.approx(end - start)


def test_the_standard_error_is_the_scatter_of_repeated_tests():
    """A state between two readings, less the zero: 2000 tests of noise 0.5 µm."""
    rng = np.random.default_rng(5)
    times = 60.0 * np.arange(12)
    values, stated = [], []
    for read in rng.normal(0.0, 0.5, (2000, 12)):
        found = evaluate_thermal_drift(
            XYFZ, "environment", times, {"z": read},
            point_mm=POINT, states_s=[0.0, 330.0], repeatability_um=0.5,
        )  # fmt: skip
        (table,) = found.states[-1].tables
        values.append(table.errors[0])
        stated.append(table.standard_errors[0])
    assert np.std(values) == pytest.approx(np.mean(stated), rel=0.05)
    (start,) = found.states[0].tables
    assert start.standard_errors.tolist() == [0.0]


@pytest.mark.parametrize("every_s", [1.0, 45.0])
def test_noise_is_found_beside_a_drift(every_s):
    rng = np.random.default_rng(3)
    times = np.cumsum(rng.uniform(0.5, 1.5, 4000) * every_s)
    drifting = 20.0 * (1.0 - np.exp(-times / 3600.0))
    noise = noise_between_neighbours(times, drifting + rng.normal(0.0, 0.3, times.size))
    assert noise == pytest.approx(0.3, rel=0.06)


def test_readings_that_do_not_scatter_have_no_known_uncertainty():
    found = by_hand()
    assert all(table.covariance is None for table in found.states[-1].tables)
    assert any("repeatability_um" in note for note in found.result.notes)
    known = by_hand(repeatability_um=0.2)
    # At a reading: its own noise and that of the zero; two sensors over 100 mm for the tilt.
    errors = {t.component.code: t.standard_errors[0] for t in known.states[-1].tables}
    assert errors == pytest.approx({"EXZ": 0.2 * 2**0.5, "EZZ": 0.2 * 2**0.5, "EBZ": 0.2 * 2 / 0.1})


def test_where_nothing_carries_the_spindle_tilts_are_figures_alone():
    found = by_hand(Chain.parse("XYZF"))
    assert found.components == {"x": "EXZ", "z": "EZZ"}
    assert "d_B_running_urad" in found.result.figures
    assert any("Tilts B are in the figures alone" in note for note in found.result.notes)


def test_displacements_count_as_the_components_that_are_stated():
    lathe = Chain.parse("FZX")
    found = evaluate_thermal_drift(
        lathe, "spindle", [0, 60], {"x": [0, 2], "z": [0, 3]},
        components={"x": "EXX", "z": "EZZ"}, point_mm=[100, 0, 200],
    )  # fmt: skip
    places = {t.component.code: t.positions_mm.tolist() for t in found.states[-1].tables}
    assert places == {"EXX": [100.0], "EZZ": [200.0]}


WRONG = [
    ({"test": "dance"}, "test"),
    ({"times_s": [0, 60, 60]}, "readings.2.time"),
    ({"times_s": [0]}, "readings"),
    ({"displacements_um": {}}, "readings"),
    ({"displacements_um": {"w": [0, 1, 2]}}, "readings"),
    ({"displacements_um": {"z": [0, 1]}}, "z_um"),
    ({"displacements_um": {"z": [0, float("nan"), 2]}}, "z_um"),
    ({"displacements_um": {"z": [0, 1, 20_000]}}, "z_um"),
    ({"displacements_um": {"x2": [0, 1, 2]}, "sensor_distance_mm": 100.0}, "x2_um"),
    ({"displacements_um": {"x": [0, 1, 2], "x2": [0, 1, 2]}}, "sensor_distance_mm"),
    ({"axis": "x"}, "axis"),
    ({"positions_mm": [1, 1, 1]}, "position_mm"),
    ({"test": "linear-axis"}, "axis"),
    ({"test": "linear-axis", "axis": "x"}, "position_mm"),
    ({"test": "linear-axis", "axis": "x", "positions_mm": [0, 1, 1]}, "position_mm"),
    ({"running_s": (-60.0, 60.0)}, "running_from"),
    ({"running_s": (60.0, 60.0)}, "running_from"),
    ({"test": "environment", "running_s": (0.0, 60.0)}, "running_from"),
    ({"states_s": [0.0, 9999.0]}, "states_min"),
    ({"states_s": [0.0, 0.0]}, "states_min"),
    ({"components": {"z": "EXZ"}}, "components.z"),
    ({"components": {"x": "EXX"}}, "components.x"),
    ({"repeatability_um": 0.0}, "repeatability_um"),
    ({"point_mm": [1, 2]}, "point_mm"),
]


@pytest.mark.parametrize(("changes", "field"), WRONG)
def test_what_cannot_be_a_drift_test_is_refused(changes, field):
    stated = {
        "test": "spindle", "times_s": [0, 60, 120], "displacements_um": {"z": [0, 1, 2]},
        "point_mm": POINT,
    } | changes  # fmt: skip
    if "displacements_um" not in changes and len(stated["times_s"]) == 1:
        stated["displacements_um"] = {"z": [0]}
    with pytest.raises(InvalidContent) as caught:
        evaluate_thermal_drift(XYFZ, **stated)
    assert field in [error.field for error in caught.value.errors]
    assert "expected" in caught.value.detail
    assert "got" in caught.value.detail
