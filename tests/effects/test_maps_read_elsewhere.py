"""Effects that read the maps at another temperature: no more is said than the maps know."""

from datetime import UTC, datetime

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from app.compensation.table import compensation_table
from app.effects.adopted.in_table import add_effects
from app.effects.adopted.prediction import AskedPlaces, predict_with_effects
from app.effects.conditions import Conditions
from app.effects.driver import Always, Behind, Difference, State, StepAfter
from app.effects.effect import Effect, effect_from_json
from app.effects.shape import Everywhere, Exchange, Rising, Sensitivity
from app.effects.term import Term
from app.effects.valid import Valid
from app.errors import Conflict
from app.geometry.components import COMPONENTS
from app.thermal.compile_model import compile_model
from app.thermal.error_map import ComponentTable
from app.thermal.machine import OutOfRange, Sensor, Travel
from app.thermal.sensor_health import Health, SensorState
from tests.thermal.example_maps import error_map, machine, table

NOW = datetime(2026, 3, 1, tzinfo=UTC)
START_S = NOW.timestamp()
EVERYWHERE_C = {"x-middle": (-200.0, 300.0), "y-front": (-200.0, 300.0)}
LONG, SHORT = [0.0, 100.0, 300.0, 500.0], [0.0, 100.0]
STATES = {"spindle_rpm": 1000.0}


class Late:
    """A past in which every filter has the same output."""

    filters = ()

    def __init__(self, output_c):
        self.output_c = output_c

    def lagged(self, signal, time_constant_s, times_s):
        return np.full(times_s.shape, self.output_c)

    def why_missing(self, signal, time_constant_s, times_s):
        return ""


def error(x, t_c):
    """0.2 µm/mm, and 0.001 µm/mm more for each kelvin above 20 °C: linear in both."""
    return 0.2 * x + 0.001 * (t_c - 20.0) * x


def short_and_long(**policies):
    """Map 'a' of 20 °C ends at 100 mm, 'b' and 'c' of 25 and 30 °C reach to 500 mm."""
    maps = [
        error_map(
            label,
            {"x-middle": t_c, "y-front": t_c},
            table("EXX", [error(x, t_c) for x in at], at),
        )
        for label, t_c, at in (("a", 20.0, SHORT), ("b", 25.0, LONG), ("c", 30.0, LONG))
    ]
    return compile_model(machine(Sensor("x-middle"), Sensor("y-front"), **policies), maps, {})


def valid(**ranges):
    everything = {"temperatures_c": EVERYWHERE_C, "state": {"spindle_rpm": (0.0, 12_000.0)}}
    return Valid(**{"from_s": START_S, "to_s": START_S} | everything | ranges)


def lag(share=1.0, learnt=(-50.0, 50.0), codes=("EXX",)):
    behind = Behind("x-middle", 600.0)
    return Effect(
        "thermal-lag",
        codes,
        ("x-middle",),
        parameters={"share": share, "time_constant_min": 10.0},
        terms=tuple(Term(c, behind, Sensitivity(False), share, learnt=learnt) for c in codes),
        valid=valid(),
    )


def bias(bias_k):
    return Effect(
        "sensor-fault",
        ("EXX",),
        ("x-middle",),
        variant="bias",
        parameters={"bias_k": bias_k, "changed_at_unix_s": START_S},
        terms=(Term("EXX", StepAfter(START_S, -bias_k), Sensitivity(False)),),
        valid=valid(),
    )


def other(share, stated):
    return Effect(
        "other-sensor",
        ("EXX",),
        ("x-middle", "y-front"),
        parameters={"share": share},
        terms=(Term("EXX", Always(), Exchange.of("y-front", stated), share),),
        valid=valid(),
    )


def speed():
    return Effect(
        "state-variable",
        ("EXX",),
        states=("spindle_rpm",),
        variant="at once",
        parameters={"slope_um_per_spindle_rpm": 0.001},
        terms=(Term("EXX", State("spindle_rpm"), Everywhere(), 0.001),),
        valid=valid(),
    )


def slope(positions_mm=(0.0, 500.0)):
    return Effect(
        "outdated-map",
        ("EXX",),
        variant="slope",
        parameters={"slope_at_end_um": 5.0},
        terms=(Term("EXX", Always(), Rising(250.0, 250.0), 5.0),),
        valid=valid(positions_mm={"EXX": positions_mm}),
    )


SAME = {"a": 20.0, "b": 25.0, "c": 30.0}


def moment_of(t_c, late_c=None, front_c=None):
    temperatures = {"x-middle": t_c, "y-front": t_c if front_c is None else front_c}
    return Conditions.of_moment(
        START_S, temperatures, STATES, Late(t_c if late_c is None else late_c)
    )


def table_of(model, effects, moment):
    sensors = [
        SensorState(name, Health.OK, float(t[0])) for name, t in moment.temperatures_c.items()
    ]
    plain = compensation_table(model, 1, sensors, NOW)
    return add_effects(plain, model, effects, moment) if effects else plain


def row_of(found, code="EXX"):
    (entry,) = [e for e in found.components if e.component.code == code]
    return entry


def predicted(model, effects, moment, at_mm):
    n = len(at_mm)
    points = np.column_stack([at_mm, np.zeros(n), np.zeros(n)])
    places = AskedPlaces("EXX", points, np.zeros((n, 3)), np.zeros((n, 3)))
    return predict_with_effects(model, effects, places, moment.take(np.zeros(n, dtype=np.intp)))


# --- how far a row reaches ------------------------------------------------------------------


@pytest.mark.parametrize(
    ("effect", "late_c"), [(lag(), 23.0), (bias(3.0), None)], ids=["lag", "bias"]
)
def test_a_moved_temperature_cuts_the_row_to_the_maps_that_it_is_read_from(effect, late_c):
    """It was 81 µm short at 500 mm, complete and without a word: map 'a' ends at 100 mm."""
    found = table_of(short_and_long(), [effect], moment_of(26.0, late_c))
    row = row_of(found)
    assert row.positions_mm.tolist() == SHORT
    assert row.errors.tolist() == pytest.approx([0.0, error(100.0, 23.0)])
    assert found.complete is False
    assert found.warnings[0].startswith(
        "EXX: given from 0 to 100 mm only at this temperature, because map 'a' covers 0 to 100 mm"
    )


@pytest.mark.parametrize(
    ("share", "late_c", "positions_mm", "complete"),
    [
        (1.0, 27.0, LONG, True),  # the short map is no longer read at all
        (0.5, 27.0, SHORT, False),  # half of it is
        (1.0, 23.0, SHORT, False),
    ],
)
def test_only_the_maps_that_are_left_in_the_sum_count(share, late_c, positions_mm, complete):
    found = table_of(short_and_long(), [lag(share)], moment_of(22.0, late_c))
    row = row_of(found)
    assert row.positions_mm.tolist() == positions_mm
    there = (1.0 - share) * 22.0 + share * late_c
    np.testing.assert_allclose(row.errors, error(row.positions_mm, there), atol=1e-9)
    assert found.complete is complete


@pytest.mark.parametrize(("t_c", "front_c", "complete"), [(27.0, 22.0, False), (22.0, 27.0, True)])
def test_a_followed_sensor_says_how_far_its_own_maps_reach(t_c, front_c, complete):
    found = table_of(short_and_long(), [other(1.0, SAME)], moment_of(t_c, None, front_c))
    row = row_of(found)
    assert row.positions_mm.tolist() == (LONG if complete else SHORT)
    np.testing.assert_allclose(row.errors, error(row.positions_mm, front_c), atol=1e-9)
    assert found.complete is complete
    assert (found.warnings == []) is complete


@pytest.mark.parametrize("t_c", [22.0, 24.9, 25.0, 27.0])
@pytest.mark.parametrize("effect", [speed(), slope()], ids=["speed", "slope"])
def test_an_effect_never_makes_a_row_longer_than_its_maps(effect, t_c):
    model = short_and_long(axes={"x": Travel(0.0, 600.0)})
    plain = row_of(table_of(model, [], moment_of(t_c)))
    found = table_of(model, [effect], moment_of(t_c))
    row = row_of(found)
    ends = plain.positions_mm[[0, -1]].tolist()
    assert row.positions_mm[[0, -1]].tolist() == ends
    assert found.complete is (ends[1] == 500.0)


def test_maps_that_all_end_early_are_not_continued_by_an_effect():
    maps = [error_map(f"{t:g}", t, table("EXX", [0.0, t], SHORT)) for t in (20.0, 25.0)]
    here = machine(Sensor("x-middle"), axes={"x": Travel(0.0, 500.0)})
    row = row_of(table_of(compile_model(here, maps, {}), [slope()], moment_of(22.0)))
    assert row.positions_mm.tolist() == SHORT


def test_maps_without_a_range_in_common_leave_the_effect_out_and_the_row_as_it_is():
    """Half by 'a' and 'b', half by 'b' and 'c': 'a' and 'c' share nothing."""
    maps = [
        error_map(label, t, table("EXX", [t, t], at))
        for label, t, at in (("a", 20.0, [0, 100]), ("b", 25.0, [0, 300]), ("c", 30.0, [200, 300]))
    ]
    model = compile_model(machine(Sensor("x-middle")), maps, {})
    moment = moment_of(22.0, 28.0)
    found = table_of(model, [lag(0.5), speed()], moment)
    row = row_of(found)
    assert row.positions_mm.tolist() == SHORT
    assert row.errors.tolist() == pytest.approx([23.0, 23.0])  # 1 µm by the spindle
    assert row.effects == ("state-variable",)
    assert found.complete is False
    assert found.effects[0].missing == "the maps that it reads here share no range of positions"
    there = predicted(model, [lag(0.5), speed()], moment, [50.0])
    assert there.status == ["effect-missing"]
    assert there.values.tolist() == pytest.approx([23.0])


def test_maps_that_only_the_other_sensor_makes_neighbours_are_refused_for_that_effect():
    maps = [
        error_map(label, {"x-middle": x, "y-front": y}, table("EXX", [x, x], at))
        for label, x, y, at in (
            ("a", 20.0, 20.0, [0, 100]),
            ("b", 25.0, 30.0, [0, 300]),
            ("c", 30.0, 25.0, [200, 300]),
        )
    ]
    model = compile_model(machine(Sensor("x-middle"), Sensor("y-front")), maps, {})
    stated = {"a": 20.0, "b": 30.0, "c": 25.0}
    found = table_of(model, [other(1.0, stated)], moment_of(22.0, None, 22.0))
    assert row_of(found).positions_mm.tolist() == SHORT
    assert found.complete is False
    assert found.effects[0].missing == (
        "maps 'a' and 'c', neighbours in the temperature of y-front, share no range "
        "of positions of EXX"
    )


# --- beyond the maps ------------------------------------------------------------------------

LEVELLING = {20.0: 0.0, 24.0: 12.0, 28.0: 21.0, 31.0: 28.0, 33.0: 33.0, 33.9: 38.0}


def levelling(policy, margin_c=10.0):
    maps = [error_map(f"{t:g}", t, table("EXX", [e], [0.0])) for t, e in LEVELLING.items()]
    here = machine(Sensor("x-middle"), out_of_range=policy, extrapolation_margin_c=margin_c)
    return compile_model(here, maps, {})


@pytest.mark.parametrize("policy", [OutOfRange.CLAMP, OutOfRange.EXTRAPOLATE])
@pytest.mark.parametrize("late_c", [34.5, 36.0, 38.0, 15.0])
def test_a_moved_temperature_has_the_table_that_it_would_have_itself(policy, late_c):
    """It went on along the last slope up to 60.8 µm, whatever the policy, and called itself so."""
    model = levelling(policy)
    plain = row_of(table_of(model, [], moment_of(late_c)))
    found = table_of(model, [lag()], moment_of(33.5, late_c))
    row = row_of(found)
    assert row.errors.tolist() == pytest.approx(plain.errors.tolist())
    assert row.basis.status == plain.basis.status
    done = "extrapolated" if plain.basis.status == "extrapolated" else "held"
    assert found.warnings == [
        f"thermal-lag of EXX reads the maps at {late_c:g} °C of x-middle, outside their range of "
        f"20 to 33.9 °C: {done}"
    ]
    there = predicted(model, [lag()], moment_of(33.5, late_c), [0.0])
    assert there.values.tolist() == pytest.approx(plain.errors.tolist())
    assert there.status == [plain.basis.status]
    assert [r.sentence for r in there.held] == [found.warnings[0] + " (1 values)"]


def test_at_the_last_map_what_is_held_is_said_too():
    """Nothing is added, because a table at 38.9 °C would be that of the last map."""
    found = table_of(levelling(OutOfRange.CLAMP), [lag()], moment_of(33.9, 38.9))
    assert row_of(found).errors.tolist() == [38.0]
    assert row_of(found).basis.status == "clamped"


@pytest.mark.parametrize(
    ("policy", "edge_c"), [(OutOfRange.REJECT, 33.9), (OutOfRange.EXTRAPOLATE, 34.9)]
)
def test_where_no_table_is_allowed_the_effect_is_held_and_the_table_stays(policy, edge_c):
    model = levelling(policy, margin_c=1.0)
    found = table_of(model, [lag()], moment_of(33.5, 38.0))
    edge = row_of(table_of(model, [], moment_of(edge_c)))
    assert row_of(found).errors.tolist() == pytest.approx(edge.errors.tolist())
    assert row_of(found).basis.status == "clamped"
    assert found.complete is False
    assert found.warnings[0].endswith("held, because the machine's policy allows no table there")


def test_nothing_that_is_late_says_nothing():
    found = table_of(levelling(OutOfRange.CLAMP), [lag()], moment_of(33.5, 33.5))
    assert (found.warnings, found.complete) == ([], True)


@pytest.mark.parametrize("front_c", [26.0, 27.5, 28.0, 30.0, 35.0, 45.0])
@pytest.mark.parametrize("stand_in", [None, "y-front"])
def test_a_followed_sensors_row_is_what_its_basis_says(front_c, stand_in):
    """One limit: it was 35.6 µm where the basis said that it is held at 24.2."""
    at = (("a", 20.0, 21.0, 0.0), ("b", 25.0, 25.0, 10.0), ("c", 30.0, 27.0, 20.0))
    maps = [
        error_map(
            label,
            {"x-middle": x, "y-front": y},
            *(
                ComponentTable.make(COMPONENTS[code], [steep * e], [0.0], covariance=[0.09])
                for code, steep in (("EXX", 1.0), ("EYX", 25.0))
            ),
        )
        for label, x, y, e in at
    ]
    sensors = [Sensor("x-middle", stand_in=stand_in), Sensor("y-front", resolution_c=0.5)]
    here = machine(*sensors, out_of_range=OutOfRange.EXTRAPOLATE, extrapolation_margin_c=50.0)
    model = compile_model(here, maps, {})
    stated = {label: y for label, _, y, _ in at}
    row = row_of(table_of(model, [other(1.0, stated)], moment_of(26.0, None, front_c)))
    w = row.basis.weight
    values = {label: e for label, _, _, e in at}
    said = (1.0 - w) * values[row.basis.lower_map] + w * values[row.basis.upper_map]
    assert row.errors.tolist() == pytest.approx([said])


# --- where an effect was learnt -------------------------------------------------------------


def test_equal_drivers_have_one_range_whatever_component_showed_it():
    """EXX was measured while little was late, EYX while much was: what is one effect is one."""
    behind = Behind("x-middle", 600.0)
    terms = (
        Term("EXX", behind, Sensitivity(False), learnt=(-0.2, 0.4)),
        Term("EYX", behind, Sensitivity(False), learnt=(-1.8, 1.8)),
    )
    two = Effect("thermal-lag", ("EXX", "EYX"), ("x-middle",), terms=terms, valid=valid())
    assert {term.learnt for term in two.terms} == {(-1.8, 1.8)}
    assert effect_from_json(two.to_json()) == two
    assert list(two.learnt_fields["made_of"].values()) == [[-1.8, 1.8]]


def test_every_component_of_an_effect_is_held_alike_and_says_so():
    difference = Difference("y-front", "x-middle", 0.0)
    terms = (
        Term("EXX", difference, Everywhere(), 1.0, learnt=(0.0, 5.0)),
        Term("EAX", difference, Everywhere(), 1.0, learnt=(0.0, 20.0)),
    )
    parameters = {"slope_um_per_k": 1.0}
    sensors = ("y-front", "x-middle")
    two = Effect("sensor-gradient", ("EXX", "EAX"), sensors, (), "", parameters, {}, terms, valid())
    model = short_and_long()
    for apart_k, held in ((12.0, False), (30.0, True)):
        found = table_of(model, [two], moment_of(26.0, None, 26.0 + apart_k))
        plain = row_of(table_of(model, [], moment_of(26.0)))
        added = row_of(found).errors[0] - plain.errors[0]
        assert added == pytest.approx(row_of(found, "EAX").errors[0])
        assert added == pytest.approx(min(apart_k, 20.0))
        assert {row_of(found, c).basis.status == "held" for c in ("EXX", "EAX")} == {held}
        assert found.complete is not held


# --- against the plainest recomputation -----------------------------------------------------


def plainly(maps, sensor, t_c, x_mm, extend_k):
    """One component, maps in the order of a sensor's temperature, one line between two of them."""
    ordered = sorted(maps, key=lambda m: m[0][sensor])
    scale = [m[0][sensor] for m in ordered]
    t_c = min(max(t_c, scale[0] - extend_k), scale[-1] + extend_k)
    n = max(i for i in range(len(scale) - 1) if i == 0 or scale[i] <= t_c)
    w = (t_c - scale[n]) / (scale[n + 1] - scale[n])
    low, high = (np.interp(x_mm, ordered[n + i][1], ordered[n + i][2]) for i in (0, 1))
    return (1.0 - w) * low + w * high


@st.composite
def campaigns(draw):
    """Maps of EXX with ranges of their own, by two sensors."""
    count = draw(st.integers(2, 5))
    fronts = draw(st.permutations(range(count)))
    grids = st.lists(st.integers(0, 10), min_size=2, max_size=5, unique=True).map(sorted)
    full = st.just([0, 3, 10])
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    found = []
    for i in range(count):
        grid = 50.0 * np.array(draw(st.one_of(full, full, grids)))
        temperatures = {"x-middle": 20.0 + 4.0 * i, "y-front": 30.0 + 3.0 * fronts[i]}
        found.append((temperatures, grid, rng.normal(0.0, 10.0, grid.size)))
    return found


@settings(max_examples=150, deadline=None)
@given(
    maps=campaigns(),
    policy=st.sampled_from([OutOfRange.CLAMP, OutOfRange.EXTRAPOLATE]),
    t_c=st.one_of(st.floats(16.0, 42.0), st.sampled_from([20.0, 24.0, 28.0])),
    late_c=st.one_of(st.floats(5.0, 60.0), st.sampled_from([20.0, 24.0, 28.0])),
    front_c=st.floats(25.0, 46.0),
    shares=st.tuples(*[st.sampled_from([0.0, 0.0, 0.5, 1.0, 1.3])] * 2),
    bias_k=st.sampled_from([0.0, 0.0, 3.0, -2.5]),
    beside=st.tuples(st.booleans(), st.booleans()),
)
@pytest.mark.slow
def test_a_row_is_the_maps_read_plainly_and_complete_only_where_all_is_known(
    maps, policy, t_c, late_c, front_c, shares, bias_k, beside
):
    """Lag, bias and other sensor: maps at T, and what the effects change of them, read apart."""
    labels = [f"m{i}" for i in range(len(maps))]
    stored = [
        error_map(label, t, table("EXX", e, at))
        for label, (t, at, e) in zip(labels, maps, strict=True)
    ]
    # Without a limit but the margin, which is all that the plain recomputation knows.
    policies = {"out_of_range": policy, "extrapolation_margin_c": 60.0}
    sensors = (Sensor("x-middle"), Sensor("y-front"))
    here = machine(*sensors, **policies, extrapolation_error_ratio=1000.0)
    try:
        model = compile_model(here, stored, {})
    except Conflict:
        assume(False)
    late, exchange = shares
    stated = {label: t["y-front"] for label, (t, _, _) in zip(labels, maps, strict=True)}
    possible = [
        (late, lag(late)),
        (exchange, other(exchange, stated)),
        (bias_k, bias(bias_k)),
        (beside[0], speed()),
        (beside[1], slope()),
    ]
    effects = [effect for there, effect in possible if there]
    moment = moment_of(t_c, late_c, front_c)
    found = table_of(model, effects, moment)
    row = row_of(found)
    x = row.positions_mm
    extend_k = 60.0 if policy is OutOfRange.EXTRAPOLATE else 0.0

    def maps_at(sensor, at_c):
        return plainly(maps, sensor, at_c, x, extend_k)

    now = maps_at("x-middle", t_c)
    parts = {
        "thermal-lag": late * (maps_at("x-middle", late_c) - now),
        "other-sensor": exchange * (maps_at("y-front", front_c) - now),
        "sensor-fault": maps_at("x-middle", t_c - bias_k) - now,
        "state-variable": 1.0,
        "outdated-map": 5.0 * (np.clip(x, -25.0, 525.0) - 250.0) / 250.0,
    }
    expected = now + sum(part for kind, part in parts.items() if kind in row.effects)
    np.testing.assert_allclose(row.errors, expected, atol=1e-7)
    reach = (min(at[0] for _, at, _ in maps), max(at[-1] for _, at, _ in maps))
    if found.complete:
        assert (x[0], x[-1]) == reach
        assert set(row.effects) == {effect.kind for effect in effects}
    else:
        assert (x[0], x[-1]) != reach or len(set(row.effects)) < len(effects)
    inside = np.linspace(x[0], x[-1], 7)
    there = predicted(model, effects, moment, inside)
    np.testing.assert_allclose(there.values, np.interp(inside, x, row.errors), atol=1e-7)
    assert there.beyond == ()
    # A prediction counts the assigned sensor too where another one is followed.
    if not exchange:
        lacks = len(set(row.effects)) < len(effects)
        assert set(there.status) == {"effect-missing" if lacks else row.basis.status}
