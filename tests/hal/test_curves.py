"""The curves of the live compensation: read, folded, bounded, and moved without a jump."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.hal.curves import (
    AXES,
    CURVES,
    MOST_POINTS,
    Following,
    NotFollowed,
    Table,
    between,
    interpolated,
    largest_moves,
    nodes_of,
    stepped,
    table_of,
    zero_curves,
)

NODES = {"x": (0.0, 100.0, 500.0), "y": (0.0, 300.0), "z": (-200.0, 0.0)}

microns = st.floats(-400, 400)
curves = st.fixed_dictionaries(
    {code: st.tuples(*[microns] * len(NODES[along])) for code, (_, along) in CURVES.items()}
)


def answer(*components, stale=False, complete=True):
    return {"components": components, "stale": stale, "complete": complete}


def row(code, positions, compensation, **more):
    return {
        "component": code,
        "positions_mm": positions,
        "compensation_um": compensation,
        **more,
    }


def table(**values):
    return Table({**zero_curves(NODES), **values}, 0.0, (), stale=False, complete=True)


def following(most_um=1.0, held=None):
    return Following(NODES, held or zero_curves(NODES), most_um, patience_s=30.0)


def test_each_curve_is_the_service_s_compensation():
    found = table_of(answer(row("EYX", [0, 100, 500], [0, -2.0, 4.0])), NODES, 100.0)
    assert found.curves["EYX"] == [0.0, -2.0, 4.0]
    assert found.deviation_um == 0.0
    assert set(found.curves) == set(CURVES)
    assert found.curves["EXX"] == [0.0, 0.0, 0.0]


def test_a_lathe_has_curves_of_its_two_axes_only():
    nodes = {axis: NODES[axis] for axis in "xz"}
    components = [
        row("EZX", [0, 500], [0, 3.0]),
        row("EYX", [0, 500], [0, 5.0]),
        {"component": "SZX", "compensation_um_per_m": 10.0},
        {"component": "SXY", "compensation_um_per_m": 10.0},
    ]
    found = table_of(answer(*components), nodes, 100.0)
    assert list(found.curves) == ["EXX", "EZX", "EXZ", "EZZ"]
    assert found.curves["EXZ"] == pytest.approx([-2.0, 0.0])
    assert found.not_held == ("EYX", "SXY")
    assert largest_moves(found.curves) == pytest.approx({"x": 2.0, "z": 3.0})


def test_squareness_is_folded_into_straightness():
    """E_x gains SXY·y + SZX·z, E_y gains SYZ·z: 10 µm/m over 300 mm are 3 µm."""
    rows = [
        {"component": code, "compensation_um_per_m": value}
        for code, value in (("SXY", 10.0), ("SZX", -5.0), ("SYZ", 20.0))
    ]
    found = table_of(answer(row("EXY", [0, 300], [1.0, 1.0]), *rows), NODES, 100.0)
    assert found.curves["EXY"] == pytest.approx([1.0, 4.0])
    assert found.curves["EXZ"] == pytest.approx([1.0, 0.0])
    assert found.curves["EYZ"] == pytest.approx([-4.0, 0.0])
    assert found.not_held == ()


def test_both_directions_share_their_mean_and_half_of_the_reversal_is_told():
    both = row("EYY", [0, 300], [0.0, 4.0], backward_compensation_um=[0.0, 7.0])
    found = table_of(answer(both, {"component": "EBX"}), NODES, 100.0)
    assert found.curves["EYY"] == [0.0, 5.5]
    assert found.deviation_um == 1.5
    assert found.not_held == ("half of the reversal of EYY, up to 1.50 µm", "EBX")


def test_what_the_nodes_leave_of_a_table_is_told():
    """Between nodes at 100 and 500 the line passes 5 at 300, where the table has 9."""
    found = table_of(answer(row("EXX", [0, 100, 300, 500], [0, 0, 9.0, 10.0])), NODES, 100.0)
    assert found.curves["EXX"] == [0.0, 0.0, 10.0]
    assert found.deviation_um == pytest.approx(4.0)


@pytest.mark.parametrize("last", [101.0, math.nan])
def test_a_table_beyond_the_limit_is_not_followed(last):
    rows = row("EXX", [0, 500], [0.0, last]), row("EXY", [0, 300], [0.0, 0.0])
    with pytest.raises(NotFollowed, match=r"expected a compensation of X within ±100 µm, got"):
        table_of(answer(*rows), NODES, 100.0)


def test_the_limit_is_of_the_sum_on_an_axis():
    rows = row("EXX", [0, 500], [0.0, 60.0]), row("EXY", [0, 300], [0.0, 60.0])
    with pytest.raises(NotFollowed, match=r"120\.0 µm"):
        table_of(answer(*rows), NODES, 100.0)


@given(st.lists(st.floats(0, 500), max_size=40))
def test_nodes_cover_the_travel_and_are_no_more_than_hal_takes(positions):
    nodes = nodes_of((0.0, 500.0), positions)
    assert len(nodes) <= MOST_POINTS
    assert (nodes[0], nodes[-1]) == (0.0, pytest.approx(500.0))
    assert list(nodes) == sorted(set(nodes))


def test_nodes_are_the_maps_positions_where_they_are_few():
    assert nodes_of((0.0, 500.0), [50.0, 0.0, 50.0, 480.0]) == (0.0, 50.0, 480.0, 500.0)


@given(curves, curves, st.floats(0.01, 50), st.data())
def test_a_step_moves_no_axis_further_wherever_the_machine_stands(held, target, most_um, data):
    after = stepped(held, target, most_um)
    point = {axis: data.draw(st.floats(-300, 600), label=axis) for axis in AXES}

    def offset(curves, axis):
        own = [(code, along) for code, (moved, along) in CURVES.items() if moved == axis]
        return sum(interpolated(point[along], NODES[along], curves[code]) for code, along in own)

    for axis in AXES:
        assert abs(offset(after, axis) - offset(held, axis)) <= most_um + 1e-9


@given(curves, curves, st.floats(5, 50))
def test_steps_arrive_in_the_number_that_the_way_needs(held, target, most_um):
    way = max(largest_moves(between(held, target)).values())
    steps = math.ceil(way / most_um) + 1
    for _ in range(steps):
        held = stepped(held, target, most_um)
    assert held == target


def test_without_a_table_what_was_found_is_held():
    """A component that is started again goes on from what another left."""
    left = {**zero_curves(NODES), "EXX": (0.0, 3.0, 7.0)}
    moved = following(held=left)
    assert moved.step(active=True) == left
    assert moved.is_stale(0.0)


def test_a_table_is_held_while_the_service_is_gone_and_is_stale_in_time():
    moved = following()
    moved.answered(table(EYY=(0.0, 2.5)), 100.0)
    went = [moved.step(active=True)["EYY"][1] for _ in range(5)]
    assert went == pytest.approx([1.0, 2.0, 2.5, 2.5, 2.5])
    assert not moved.is_stale(130.0)
    assert moved.is_stale(130.5)
    moved.answered(None, 140.0)
    assert not moved.is_stale(150.0)
    assert moved.step(active=True)["EYY"][1] == 2.5


def test_a_table_that_comes_back_far_away_is_gone_to_in_steps():
    moved = following()
    moved.answered(table(EXX=(0.0, 0.0, 2.0)), 0.0)
    for _ in range(2):
        moved.step(active=True)
    moved.answered(table(EXX=(0.0, 0.0, -50.0)), 9000.0)
    assert moved.to_go_um(active=True) == pytest.approx(52.0)
    assert moved.step(active=True)["EXX"][2] == pytest.approx(1.0)


def test_a_stale_table_of_the_service_is_stale_here():
    moved = following()
    moved.answered(table_of(answer(stale=True), NODES, 1.0), 0.0)
    assert moved.is_stale(0.0)


def test_switched_off_it_goes_to_nothing_in_steps():
    moved = following(held={**zero_curves(NODES), "EZZ": (0.0, 1.5)})
    went = [moved.step(active=False)["EZZ"][1] for _ in range(3)]
    assert went == pytest.approx([0.5, 0.0, 0.0])
    assert moved.to_go_um(active=False) == 0.0
