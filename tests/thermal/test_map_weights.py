"""One reading of maps: of one temperature and of many, by table and by weights."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.errors import OutsideMaps
from app.thermal.compile_model import compile_model
from app.thermal.machine import OutOfRange, Sensor
from app.thermal.map_weights import added, common_ranges, maps_at_places, read_maps, weights_of
from tests.thermal.example_maps import error_map, machine, table

SCALE = [20.0, 24.0, 24.9, 31.0]
ENDS = [[0, 9], [1, 9], [0, 5], [2, 9]]


def model_of(policy, margin_c=6.0):
    maps = [
        error_map(
            f"{t:g}",
            {"x-middle": t, "y-front": 50.0 - t},
            table("EXX", [e, 2 * e], ends),
        )
        for t, e, ends in zip(
            SCALE, [0.0, 9.0, 4.0, 5.0], [[0, 9], [1, 9], [0, 5], [2, 9]], strict=True
        )
    ]
    sensors = [Sensor("x-middle", stand_in="y-front"), Sensor("y-front")]
    policies = {"out_of_range": policy, "extrapolation_margin_c": margin_c}
    return compile_model(machine(*sensors, **policies), maps, {})


@pytest.mark.parametrize("policy", list(OutOfRange))
@given(
    st.lists(
        st.one_of(st.floats(0.0, 60.0), st.sampled_from([*SCALE, 14.0, 37.0])),
        min_size=1,
        max_size=9,
    ),
    st.integers(0, 1),
)
def test_many_temperatures_are_read_as_each_by_itself(policy, temperatures_c, place):
    model = model_of(policy)
    (group,) = model.groups
    scale = group.scales[place]
    found = model.brackets(group, scale, np.array([*temperatures_c, np.nan]))
    assert np.isnan(found.weight[-1])
    for i, t_c in enumerate(temperatures_c):
        try:
            one = model.bracket(group, scale, t_c)
        except OutsideMaps:
            assert found.is_refused[i]
            assert found.status[i] == "clamped"
            continue
        assert not found.is_refused[i]
        assert (found.lower[i], found.status[i]) == (one.lower, one.status)
        assert found.weight[i] == one.weight
        state = model.group_at(group, scale, t_c)
        (weights,) = weights_of(scale, type(found)(*(part[i : i + 1] for part in found)))
        rows = np.flatnonzero(weights).tolist()
        assert set(rows) == set(state.maps.rows)
        low, high = common_ranges(group.members[0], weights[None])
        assert [low[0], high[0]] == state.members[0].positions_mm[[0, -1]].tolist()


@pytest.mark.parametrize(
    ("policy", "weight"), [(OutOfRange.REJECT, 1.0), (OutOfRange.EXTRAPOLATE, 2.0)]
)
def test_what_is_refused_stands_at_the_edge_of_what_is_allowed(policy, weight):
    model = model_of(policy, margin_c=6.1)
    (group,) = model.groups
    found = model.brackets(group, group.scales[0], np.array([60.0]))
    assert found.weight.tolist() == pytest.approx([weight])
    assert found.is_refused.tolist() == [True]


def test_maps_that_cancel_do_not_enter():
    one = np.array([[0.3, 0.7, 0.0]])
    assert added(one, np.array([[-0.3 + 1e-16, 0.3, 0.0]])).tolist() == [[0.0, 1.0, 0.0]]


def test_a_component_by_itself_has_limits_of_its_own_that_others_do_not_see():
    model = model_of(OutOfRange.EXTRAPOLATE)
    (group,) = model.groups
    alone = group.on_scale(group.scales[1], group.members[0])
    assert alone is group.on_scale(group.scales[1], group.members[0])
    model.group_at(alone, alone.scales[0], 32.0)
    assert len(alone.limits) == 1
    assert not group.limits


@pytest.mark.parametrize("backward", [None, [1.0, 5.0, 2.0]])
def test_maps_read_at_places_once_give_what_is_read_with_any_weights(backward):
    maps = [
        error_map(
            f"{t:g}",
            {"x-middle": t},
            table("EXX", [t, 2 * t, -t], [0.0, 4.0, 9.0], backward),
        )
        for t in (20.0, 24.0, 31.0)
    ]
    ((group,),) = (compile_model(machine(Sensor("x-middle")), maps, {}).groups,)
    (member,) = group.members
    random = np.random.default_rng(2)
    at, sides = random.uniform(-2.0, 11.0, 40), random.integers(-1, 2, 40).astype(float)
    weights = random.normal(size=(40, 3))
    weights[::5], weights[3] = 0.0, np.nan
    known = maps_at_places(group, member, at, sides)
    assert known.shape == (40, 3)
    np.testing.assert_allclose(
        (weights * known).sum(axis=1), read_maps(group, member, weights, at, sides), rtol=1e-12
    )


def test_maps_of_different_ranges_are_not_read_before_it_is_known_which_enter():
    (group,) = model_of(OutOfRange.CLAMP).groups
    (member,) = group.members
    assert maps_at_places(group, member, np.array([4.0]), np.zeros(1)) is None
