"""Only the maps in use count: how far a table reaches, at each temperature, and in predictions."""

import math
from datetime import UTC, datetime

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.compensation.table import compensation_table
from app.errors import Conflict
from app.thermal.compile_model import compile_model
from app.thermal.coverage import CoveredInterval, coverage
from app.thermal.machine import OutOfRange, SameTemperature, Sensor
from app.thermal.prediction import BeyondTables, predict_component
from app.thermal.sensor_health import Health, SensorState
from app.thermal.thermal_field import thermal_tables
from tests.thermal.example_maps import error_map, errors_of, machine, state_of, table

NOW = datetime(2026, 1, 1, tzinfo=UTC)

LONG_AND_SHORT = [
    error_map(
        "cold", 20.0, table("EXX", [0.0, 2.0, 10.0], [0, 100, 500]), table("EYX", [1.0], [0])
    ),
    error_map("warm", 30.0, table("EXX", [0.0, 20.0], [0, 500]), table("EYX", [3.0], [0])),
    error_map("short", 40.0, table("EXX", [5.0, 9.0], [0, 100]), table("EYX", [5.0], [0])),
]


def compiled(maps, **policies):
    return compile_model(machine(**policies), maps, {})


def live_table(model, temperature_c):
    return compensation_table(model, 1, [SensorState("x-middle", Health.OK, temperature_c)], NOW)


@pytest.mark.parametrize(
    ("temperature_c", "positions_mm", "errors"),
    [
        (15.0, [0, 100, 500], [0, 2, 10]),  # held at the coldest map
        (20.0, [0, 100, 500], [0, 2, 10]),
        (25.0, [0, 100, 500], [0, 3, 15]),  # 'warm' has 4 at 100 mm
        (30.0, [0, 500], [0, 20]),
        (35.0, [0, 100], [2.5, 6.5]),
        (40.0, [0, 100], [5, 9]),
        (99.0, [0, 100], [5, 9]),
    ],
)
def test_a_short_map_shortens_the_table_only_where_it_is_in_use(
    temperature_c, positions_mm, errors
):
    state, member = state_of(compiled(LONG_AND_SHORT), "EXX", temperature_c)
    assert member.positions_mm.tolist() == positions_mm
    assert state.values[member.forward].tolist() == errors


@pytest.mark.parametrize(("temperature_c", "complete"), [(25.0, True), (30.0, True), (35.0, False)])
def test_what_other_maps_cover_further_is_said_and_makes_the_table_incomplete(
    temperature_c, complete
):
    found = live_table(compiled(LONG_AND_SHORT), temperature_c)
    assert found.complete is complete
    assert (
        list(found.warnings) == []
        if complete
        else [
            "EXX: given from 0 to 100 mm only at this temperature, because map 'short' covers 0 to "
            "100 mm; the maps together reach from 0 to 500 mm"
        ]
    )


def test_maps_that_all_end_before_the_axis_does_lose_nothing_against_each_other():
    maps = [error_map(f"{t}", t, table("EXX", [0.0, 1.0], [0, 100])) for t in (20.0, 30.0)]
    assert live_table(compiled(maps), 25.0).complete


def test_where_all_positions_are_shared_nothing_is_copied_and_the_layout_is_one():
    maps = [error_map(f"{t}", t, table("EXX", [0.0, t], [0, 100])) for t in (20.0, 30.0, 40.0)]
    (group,) = compiled(maps).groups
    first, second = group.maps_in_use(0, 1), group.maps_in_use(1, 2)
    assert first.members is second.members is group.members
    assert np.shares_memory(first.nodes[0], group.nodes)
    assert group.maps_in_use(0, 1) is first


def test_neighbouring_maps_without_a_common_range_are_refused_and_others_need_none():
    """'left' and 'right' never are in use together: 'both' lies between them."""
    left = error_map("left", 20.0, table("EXX", [1.0, 1.0], [0, 100]))
    both = error_map("both", 30.0, table("EXX", [2.0, 2.0, 2.0], [0, 150, 500]))
    right = error_map("right", 40.0, table("EXX", [3.0, 3.0], [200, 500]))
    model = compiled([left, both, right])
    _, member = state_of(model, "EXX", 35.0)
    assert member.positions_mm.tolist() == [200, 500]
    with pytest.raises(Conflict) as refusal:
        compiled([left, right])
    assert refusal.value.detail == (
        "expected maps that follow each other in the temperature of x-middle to share a range of "
        "positions of EXX, got 'left' (0 to 100 mm) and 'right' (200 to 500 mm): between their "
        "temperatures there would be no table"
    )


def test_a_stand_in_that_brings_them_together_is_refused_too():
    sensors = [Sensor("x-middle", stand_in="y-front"), Sensor("y-front")]
    maps = [
        error_map(label, {"x-middle": x, "y-front": y}, table("EXX", [0.0, 1.0], ends))
        for label, x, y, ends in [
            ("left", 20.0, 20.0, [0, 100]),
            ("both", 30.0, 50.0, [0, 500]),
            ("right", 40.0, 40.0, [200, 500]),
        ]
    ]
    with pytest.raises(Conflict, match="in the temperature of y-front"):
        compile_model(machine(*sensors), maps, {})


def test_a_mean_of_maps_covers_what_all_of_them_do():
    maps = [
        error_map("a", 20.0, table("EXX", [0.0, 10.0], [0, 100])),
        error_map("b", 20.0, table("EXX", [2.0, 2.0], [0, 50])),
        error_map("c", 30.0, table("EXX", [3.0, 3.0], [0, 100])),
    ]
    model = compiled(maps, same_temperature=SameTemperature.MEAN)
    state, member = state_of(model, "EXX", 20.0)
    assert member.positions_mm.tolist() == [0, 50]
    assert "map 'a + b' covers 0 to 50 mm" in state.maps.shortened["EXX"]


def test_where_several_states_reach_differently_far_end_values_hold():
    model = compiled(LONG_AND_SHORT)
    states = [model.errors_at({"x-middle": t}) for t in (25.0, 35.0)]
    found = thermal_tables(states)["EXX"]
    assert found.positions_mm.tolist() == [0, 100, 500]
    assert found.values.tolist() == [[0, 3, 15], [2.5, 6.5, 6.5]]


def test_predictions_say_what_the_maps_in_use_do_not_cover():
    """At 300 mm the table of 25 °C has a value; that of 35 and 40 °C ends at 100 mm."""
    found = predict_component(
        compiled(LONG_AND_SHORT),
        "EXX",
        {"x-middle": np.array([25.0, 35.0, 40.0, np.nan])},
        np.full(4, 300.0),
        np.zeros(4),
    )
    assert found.values[:3].tolist() == [9.0, 6.5, 9.0]
    assert found.beyond == (BeyondTables("EXX", 2, ((0.0, 100.0),)),)


GRIDS = st.lists(
    st.lists(st.integers(-40, 40), min_size=1, max_size=6, unique=True).map(sorted),
    min_size=2,
    max_size=5,
)


@given(GRIDS, st.integers(0, 2**32 - 1), st.data())
def test_predictions_are_the_tables_interpolation_whatever_the_maps_cover(grids, seed, data):
    rng = np.random.default_rng(seed)
    maps = [
        error_map(
            f"Run #{i}",
            20.0 + 4.0 * i,
            table("EXX", rng.normal(size=len(grid)), grid, rng.normal(size=len(grid)))
            if rng.random() < 0.5
            else table("EXX", rng.normal(size=len(grid)), grid),
        )
        for i, grid in enumerate(grids)
    ]
    policy = data.draw(st.sampled_from([OutOfRange.CLAMP, OutOfRange.EXTRAPOLATE]))
    try:
        model = compiled(maps, out_of_range=policy)
    except Conflict:
        long = [g for g in grids if len(g) > 1]
        assert max(g[0] for g in long) >= min(g[-1] for g in long)
        return
    t = rng.uniform(16.0, 20.0 + 4.0 * len(grids), 12)
    t[: len(grids)] = 20.0 + 4.0 * np.arange(len(grids))
    x, sides = rng.uniform(-50.0, 50.0, 12), rng.choice([-1.0, 1.0], 12)
    found = predict_component(model, "EXX", {"x-middle": t}, x, sides).values
    for i in range(12):
        state, member = state_of(model, "EXX", float(t[i]))
        columns = member.forward if sides[i] > 0 else member.backward or member.forward
        expected = np.interp(x[i], member.positions_mm, state.values[columns])
        np.testing.assert_allclose(found[i], expected, rtol=1e-12, atol=1e-12)


def test_the_coverage_of_each_component_and_interval():
    found = coverage(compiled(LONG_AND_SHORT))
    assert found["EXX"].sensor == "x-middle"
    assert found["EXX"].intervals == (
        CoveredInterval(-math.inf, 20.0, 0.0, 500.0, "cold", "cold"),
        CoveredInterval(20.0, 30.0, 0.0, 500.0, "cold", "warm"),
        CoveredInterval(30.0, 40.0, 0.0, 100.0, "warm", "short"),
        CoveredInterval(40.0, math.inf, 0.0, 100.0, "short", "short"),
    )
    assert {(i.from_mm, i.to_mm) for i in found["EYX"].intervals} == {(-math.inf, math.inf)}


def test_the_coverage_beyond_the_maps_is_that_of_the_policy():
    extrapolating = coverage(
        compiled(LONG_AND_SHORT, out_of_range=OutOfRange.EXTRAPOLATE, extrapolation_margin_c=3.0)
    )["EXX"].intervals
    assert (extrapolating[0].from_c, extrapolating[0].to_mm) == (17.0, 500.0)
    assert (extrapolating[-1].to_c, extrapolating[-1].lower_map) == (43.0, "warm")
    rejecting = coverage(compiled(LONG_AND_SHORT, out_of_range=OutOfRange.REJECT))["EXX"].intervals
    assert [i.from_c for i in rejecting] == [20.0, 30.0]


@given(GRIDS)
def test_the_coverage_is_what_the_tables_have(grids):
    maps = [
        error_map(f"Run #{i}", 20.0 + 4.0 * i, table("EXX", [float(x) for x in grid], grid))
        for i, grid in enumerate(grids)
    ]
    try:
        model = compiled(maps)
    except Conflict:
        return
    for interval in coverage(model)["EXX"].intervals:
        middle = np.clip((interval.from_c + interval.to_c) / 2.0, 0.0, 100.0)
        _, member = state_of(model, "EXX", float(middle))
        if math.isfinite(interval.from_mm):
            ends = member.positions_mm[[0, -1]].tolist()
            assert ends == [interval.from_mm, interval.to_mm]
        else:
            assert len(set(errors_of(model, "EXX", float(middle)).tolist())) == 1


def test_sister_machines_share_their_members_and_others_do_not():
    """What is remembered of a member is then kept once for all sisters, however many."""

    def members(maps, temperature_c):
        model = compiled(maps)
        return [state_of(model, code, temperature_c)[1] for code in ("EXX", "EYX")]

    longer = [
        *LONG_AND_SHORT[:2],
        error_map("short", 40.0, table("EXX", [5.0, 9.0], [0, 101]), table("EYX", [5.0], [0])),
    ]
    for temperature_c in (25.0, 35.0):
        one, other = members(LONG_AND_SHORT, temperature_c), members(LONG_AND_SHORT, temperature_c)
        assert all(a is b for a, b in zip(one, other, strict=True))
        assert one[0] is not members(longer, temperature_c)[0]
