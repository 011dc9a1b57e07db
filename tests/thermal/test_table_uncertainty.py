"""The standard errors of the compensation table, held against maps drawn from their covariances."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.compensation.table import group_compensation
from app.geometry.components import COMPONENTS
from app.geometry.measuring_line import MeasuringLine
from app.thermal.bracket import Status
from app.thermal.compile_model import compile_model
from app.thermal.error_map import ComponentTable
from app.thermal.machine import OutOfRange, SameTemperature, Sensor
from app.thermal.uncertainty import MOST_CORRELATED
from tests.thermal.example_maps import error_map, machine, maps_of, state_of, table

DRAWS = 200
"""Standard deviations of so many draws scatter by 1/√400, 5 %."""

LINE = MeasuringLine((0.0, 40.0, 100.0))
OTHER = MeasuringLine((0.0, 310.0, 380.0), (12.0, -30.0, 75.0))
SIX = ("EXX", "EYX", "EZX", "EAX", "EBX", "ECX")
SLOPES = ("EXX^y", "EYX^z", "EAX^y", "ECX^z")


def uncertain(code, positions_mm, covariance, backward=None):
    """A table of zeros with this covariance, and another one of the backward errors."""
    zeros = np.zeros(max(len(positions_mm), 1))
    return ComponentTable.make(
        COMPONENTS[code],
        zeros,
        positions_mm,
        None if backward is None else zeros,
        covariance,
        backward,
    )


def random_covariance(rng, n):
    """Neighbours go together, as sums of increments do, and some sizes are unlike."""
    root = np.tril(rng.uniform(0.1, 1.0, (n, n)))
    return root @ root.T


def random_table(rng, code, n, backward=False):
    """Any errors, each with another uncertainty, on positions of its own."""
    if not COMPONENTS[code].is_table:
        return uncertain(code, (), random_covariance(rng, 1))
    inner = np.sort(rng.choice(np.arange(1.0, 500.0), n - 2, replace=False))
    positions = [0.0, *inner, 500.0]
    errors, backward_errors = rng.normal(scale=5.0, size=(2, n))
    covariance, of_backward = random_covariance(rng, n), random_covariance(rng, n)
    return ComponentTable.make(
        COMPONENTS[code],
        errors,
        positions,
        backward_errors if backward else None,
        covariance,
        of_backward if backward else None,
    )


def random_maps(codes, temperatures_c, lines=(), seed=5, backward=()):
    """A map for each temperature; `backward` names the components of both directions."""
    rng = np.random.default_rng(seed)
    lines = [*lines, *[None] * len(temperatures_c)]
    return [
        error_map(
            f"map {t_c}",
            t_c,
            *(random_table(rng, code, int(rng.integers(4, 7)), code in backward) for code in codes),
            lines=lines[i] and {"x": lines[i]},
        )
        for i, t_c in enumerate(temperatures_c)
    ]


EXTRAPOLATING = {"out_of_range": OutOfRange.EXTRAPOLATE, "extrapolation_margin_c": 10.0}
MEAN = {"same_temperature": SameTemperature.MEAN}
PLAIN = ("EXX", "EYX", "SXY")

CASES = {
    "between two of three maps": (random_maps(PLAIN, [20, 24, 30]), 25.5, {}),
    "at a map": (random_maps(PLAIN, [20, 24, 30]), 24.0, {}),
    "clamped": (random_maps(PLAIN, [20, 24, 30]), 33.0, {}),
    "extrapolated": (random_maps(PLAIN, [20, 24, 30]), 33.0, EXTRAPOLATING),
    "extrapolated down": (random_maps(PLAIN, [20, 24, 30]), 17.0, EXTRAPOLATING),
    "mean of maps": (random_maps(PLAIN, [20, 20.05, 30, 30.05, 30.08]), 23.0, MEAN),
    "both directions": (random_maps(("EXX", "EYX"), [20, 30], backward=("EXX",)), 23.0, {}),
    "moved lines": (random_maps(SIX, [20, 24, 30], [LINE, OTHER, LINE]), 22.0, {}),
    "moved lines, both directions": (
        random_maps(SIX, [20, 30], [LINE, OTHER], backward=SIX), 26.0, {},
    ),
    "one map in both directions": (
        [*random_maps(("EXX",), [20]), *random_maps(("EXX",), [30], backward=("EXX",))], 26.0, {},
    ),
    "past a map of one direction": (
        [
            *random_maps(("EXX",), [20], backward=("EXX",), seed=1),
            *random_maps(("EXX",), [24], seed=2),
            *random_maps(("EXX",), [28], seed=3),
            *random_maps(("EXX",), [40], backward=("EXX",), seed=4),
        ], 25.0, {},
    ),
    "mean with one map in both directions": (
        [
            *random_maps(("EXX",), [20], backward=("EXX",)),
            *random_maps(("EXX",), [20.05]),
            *random_maps(("EXX",), [30]),
        ], 23.0, MEAN,
    ),
    "one line stated": (random_maps(SIX, [20, 30], [None, OTHER]), 24.0, {}),
    "nonrigid, moved": (random_maps(SIX + SLOPES, [20, 30], [LINE, OTHER]), 28.0, {}),
    "nonrigid, one line stated": (random_maps(SIX + SLOPES, [20, 30], [OTHER]), 28.0, {}),
    "mean of moved maps": (random_maps(SIX, [20, 30, 30.05], [LINE, OTHER, LINE]), 27.0, MEAN),
}  # fmt: skip


@pytest.fixture(params=CASES.values(), ids=CASES)
def case(request):
    return request.param


def machine_of(policies):
    """Temperatures count as exact where maps are extrapolated: here it is the maps' part."""
    exact = [Sensor("x-middle", resolution_c=0.0), Sensor("z-column", resolution_c=0.0)]
    return machine(*(exact if policies is EXTRAPOLATING else ()), **policies)


def values(maps, t_c, policies):
    """All columns of all groups at a temperature."""
    states = compile_model(machine_of(policies), maps, {}).errors_at({"x-middle": t_c})
    return np.concatenate([state.values for state in states])


def stated(maps, t_c, policies):
    states = compile_model(machine_of(policies), maps, {}).errors_at({"x-middle": t_c})
    return np.sqrt(np.concatenate([state.variances for state in states]))


def changed(maps, change):
    """Maps without uncertainty whose errors are made by `change` of errors and covariance."""

    def table_of(t):
        backward = t.backward_errors
        return ComponentTable(
            t.component,
            t.positions_mm,
            change(t.errors, t.covariance),
            backward if backward is None else change(backward, t.backward_covariance),
        )

    return [replace(m, tables={c: table_of(t) for c, t in m.tables.items()}) for m in maps]


@pytest.mark.slow
def test_the_stated_standard_errors_are_those_of_drawn_maps(case):
    maps, t_c, policies = case
    rng = np.random.default_rng(2026)

    def draw(errors, covariance):
        return errors + np.linalg.cholesky(covariance) @ rng.normal(size=errors.size)

    drawn = np.array([values(changed(maps, draw), t_c, policies) for _ in range(DRAWS)])
    ratio = drawn.std(axis=0, ddof=1) / stated(maps, t_c, policies)
    scatter = 1 / math.sqrt(2 * DRAWS)
    assert np.abs(ratio - 1).max() < 5 * scatter
    # Positions of one component are correlated, and so their mean is uncertain as one is.
    assert abs(ratio.mean() - 1) < 2.5 * scatter


@pytest.mark.slow
def test_they_are_what_each_error_of_each_map_adds(case):
    maps, t_c, policies = case
    expected = added_up(maps, t_c, policies)
    np.testing.assert_allclose(stated(maps, t_c, policies), expected, atol=1e-9)


@pytest.mark.slow
def test_a_reversal_that_moving_a_line_brings_is_taken_for_less_certain_than_it_is():
    """A rotation's reversal enters a translation: both its directions share its own errors."""
    maps = random_maps(SIX, [20, 30], [LINE, OTHER], backward=("EBX",))
    at_least = added_up(maps, 26.0, {})
    assert (stated(maps, 26.0, {}) >= at_least - 1e-9).all()


def added_up(maps, t_c, policies):
    """The table is linear in the maps' errors: one error raised by 1 after another, J C Jᵀ."""
    before = values(maps, t_c, policies)
    blocks = []

    def note(errors, covariance):
        blocks.append(covariance)
        return errors

    changed(maps, note)
    gained = []
    for i, block in enumerate(blocks):
        for k in range(len(block)):
            turn = iter(range(len(blocks)))

            def raise_one(errors, _, i=i, k=k, turn=turn):
                return errors + (np.arange(errors.size) == k) * (next(turn) == i)

            gained.append(values(changed(maps, raise_one), t_c, policies) - before)
    variances, row = np.zeros(before.size), 0
    for block in blocks:
        jacobian = np.array(gained[row : row + len(block)]).T
        variances += np.diagonal(jacobian @ block @ jacobian.T)
        row += len(block)
    return np.sqrt(variances)


# --- by hand -----------------------------------------------------------------------------


def standard_errors(model, code, t_c):
    state, member = state_of(model, code, t_c)
    entries = {e.component.code: e for e in group_compensation(state)}
    found = entries[code].standard_errors
    again = state.standard_errors(member.forward)
    assert (found is None) == (again is None)
    return None if found is None else found.tolist()


def maps_with(code, temperatures_c, standard_errors_, positions_mm=()):
    """Maps of zeros; None states nothing."""
    return [
        error_map(
            f"map {t_c}",
            t_c,
            uncertain(code, positions_mm, None if s is None else np.square(s)),
        )
        for i, (t_c, s) in enumerate(zip(temperatures_c, standard_errors_, strict=True))
    ]


@pytest.mark.parametrize(
    ("t_c", "expected"),
    [
        (20.0, 3.0),
        (25.0, 2.5),  # √(1.5² + 2²)
        (30.0, 4.0),
        (32.0, math.sqrt(0.6**2 + 4.8**2)),
        (10.0, math.sqrt(6.0**2 + 4.0**2)),
    ],
)
def test_between_and_beyond_two_maps_by_hand(t_c, expected):
    maps = maps_with("SXY", [20.0, 30.0], [[3.0], [4.0]])
    model = compile_model(machine_of(EXTRAPOLATING), maps, {})
    assert standard_errors(model, "SXY", t_c) == pytest.approx([expected])


def test_clamped_it_is_the_nearest_maps_own():
    model = compile_model(machine(), maps_with("SXY", [20.0, 30.0], [[3.0], [4.0]]), {})
    assert state_of(model, "SXY", 35.0)[0].status is Status.CLAMPED
    assert [standard_errors(model, "SXY", t) for t in (10.0, 35.0)] == [[3.0], [4.0]]


def test_the_mean_of_four_maps_is_twice_as_certain():
    maps = maps_with("SXY", [20.0, 30.0, 30.01, 30.02, 30.03], [[1.0]] + 4 * [[4.0]])
    model = compile_model(machine(**MEAN), maps, {})
    assert standard_errors(model, "SXY", 40.0) == pytest.approx([2.0])


def test_a_pitch_between_two_lines_by_hand():
    """XYFZ: 2 µrad over 0.2 m are 0.4 µm beside 0.3 µm: 0.5 µm; the pitch itself stays."""
    low, high = (
        error_map(
            f"at {z}",
            t_c,
            uncertain("EXX", [0.0, 500.0], [0.09, 0.09]),
            uncertain("EBX", [0.0, 500.0], [[4.0, 4.0], [4.0, 4.0]]),
            lines={"x": MeasuringLine((0.0, 0.0, z))},
        )
        for t_c, z in ((20.0, 100.0), (30.0, 300.0))
    )
    model = compile_model(machine(), [low, high], {})
    assert standard_errors(model, "EXX", 20.0) == pytest.approx([0.3, 0.3])
    assert standard_errors(model, "EXX", 30.0) == pytest.approx([0.5, 0.5])
    assert standard_errors(model, "EBX", 30.0) == pytest.approx([2.0, 2.0])


# --- what is not known -------------------------------------------------------------------


def test_maps_that_state_none_have_none():
    model = compile_model(machine(), maps_of("EXX", [20.0, 30.0], [[1.0], [2.0]], [0.0]), {})
    assert [group.variances for group in model.groups] == [None]
    assert state_of(model, "EXX", 25.0)[0].variances is None
    assert standard_errors(model, "EXX", 25.0) is None


@pytest.mark.parametrize(
    ("t_c", "expected"),
    [(20.0, [3.0]), (22.0, [1.8]), (24.0, [0.0]), (25.0, None), (30.0, None), (35.0, None)],
)
def test_it_is_given_where_all_maps_that_enter_state_it(t_c, expected):
    """Not between the second and the third, but at the second; a stated 0 is known."""
    maps = maps_with("SXY", [20.0, 24.0, 30.0], [[3.0], [0.0], None])
    found = standard_errors(compile_model(machine(), maps, {}), "SXY", t_c)
    assert found == (expected and pytest.approx(expected[:1]) if t_c != 22.0 else [1.5])


def test_components_of_one_group_know_each_their_own():
    maps = [
        error_map(
            f"{t_c}",
            t_c,
            uncertain("EXX", [0.0, 1.0], [1.0, 4.0]),
            table("EYX", [0.0, 0.0, 0.0], [0.0, 1.0, 2.0]),
            uncertain("EXY", [0.0, 1.0], [9.0, 9.0]),
        )
        for t_c in (20.0, 30.0)
    ]
    model = compile_model(machine(), maps, {})
    assert len(model.groups) == 1
    assert standard_errors(model, "EXX", 20.0) == [1.0, 2.0]
    assert standard_errors(model, "EYX", 20.0) is None
    assert standard_errors(model, "EXY", 30.0) == [3.0, 3.0]
    assert model.groups[0].variances.shape == model.groups[0].nodes.shape


def test_each_direction_is_known_by_itself():
    maps = [
        error_map(f"{t}", t, uncertain("EXX", [0.0, 1.0], forward, [1.0, 4.0]))
        for t, forward in ((20.0, None), (30.0, [9.0, 9.0]))
    ]
    state, _ = state_of(compile_model(machine(), maps, {}), "EXX", 25.0)
    (entry,) = group_compensation(state)
    assert entry.standard_errors is None
    np.testing.assert_allclose(entry.backward_standard_errors, np.sqrt([0.5, 2.0]))


def test_a_mean_needs_all_its_maps():
    maps = maps_with("SXY", [20.0, 30.0, 30.01], [[1.0], [4.0], None])
    model = compile_model(machine(**MEAN), maps, {})
    assert standard_errors(model, "SXY", 20.0) == [1.0]
    assert standard_errors(model, "SXY", 40.0) is None


def moved(of_x, of_rotations, n=3):
    """Two maps of one axis on two lines; the second is brought to the first's."""
    positions = np.linspace(0.0, 500.0, n)
    return [
        error_map(
            label,
            t_c,
            uncertain("EXX", positions, of_x and np.full(n, of_x)),
            uncertain("EBX", positions, of_rotations and np.full(n, of_rotations)),
            lines={"x": line},
        )
        for label, t_c, line in (("one", 20.0, LINE), ("two", 30.0, OTHER))
    ]


@pytest.mark.parametrize(
    ("of_x", "of_rotations", "n", "known"),
    [
        (1.0, 1.0, 3, True),
        (1.0, None, 3, False),
        (None, 1.0, 3, False),
        (1.0, 1.0, MOST_CORRELATED, True),
        (1.0, 1.0, MOST_CORRELATED + 1, False),
    ],
)
def test_what_ends_on_the_way_to_another_line_is_said(of_x, of_rotations, n, known):
    model = compile_model(machine(), moved(of_x, of_rotations, n), {})
    found = standard_errors(model, "EXX", 30.0)
    assert (found is not None) == known
    said = [note for note in model.notes if "standard errors" in note]
    assert len(said) == (of_x is not None and not known)
    if said:
        assert "EXX" in said[0]
        assert "map 'two'" in said[0]


def test_rotations_that_do_not_enter_need_not_be_known():
    """A roll about x has no arm along y from one height to the other."""
    lines = [MeasuringLine((0.0, 0.0, 100.0)), MeasuringLine((0.0, 0.1 + 0.2 - 0.3, 300.0))]
    maps = [
        error_map(
            f"{t}",
            t,
            uncertain("EZX", [0.0, 500.0], [1.0, 4.0]),
            table("EAX", [5.0, 5.0], [0.0, 500.0]),
            lines={"x": line},
        )
        for t, line in zip((20.0, 30.0), lines, strict=True)
    ]
    assert standard_errors(compile_model(machine(), maps, {}), "EZX", 30.0) == [1.0, 2.0]


# --- properties --------------------------------------------------------------------------


@pytest.mark.slow
@settings(max_examples=30)
@given(st.floats(1e-3, 1e3), st.sampled_from(list(CASES)), st.integers(0, 9))
def test_maps_twice_as_uncertain_make_a_table_twice_as_uncertain(scale, name, seed):
    maps, t_c, policies = CASES[name]
    both = [
        replace(
            t,
            covariance=scale**2 * t.covariance,
            backward_covariance=t.backward_covariance
            if t.backward_covariance is None
            else scale**2 * t.backward_covariance,
        )
        for m in maps
        for t in m.tables.values()
    ]
    remade = iter(both)
    scaled = [replace(m, tables={c: next(remade) for c in m.tables}) for m in maps]
    np.testing.assert_allclose(
        stated(scaled, t_c, policies), scale * stated(maps, t_c, policies), rtol=1e-9
    )


@given(st.lists(st.floats(0.0, 50.0), min_size=3, max_size=3), st.floats(20.0, 30.0))
def test_independent_errors_may_be_stated_as_variances_or_as_a_matrix(spread, t_c):
    positions = ([0.0, 100.0, 500.0], [0.0, 70.0, 500.0])
    forms = [
        [
            error_map(f"{i}", t, uncertain("EXX", p, form(np.square(spread))))
            for i, (t, p) in enumerate(zip((20.0, 30.0), positions, strict=True))
        ]
        for form in (np.asarray, np.diag)
    ]
    np.testing.assert_array_equal(*(stated(maps, t_c, {}) for maps in forms))


@settings(max_examples=30)
@given(st.floats(20.0, 30.0))
def test_uncertainty_changes_no_error(t_c):
    maps = random_maps(SIX, [20.0, 30.0], [LINE, OTHER])
    without = changed(maps, lambda errors, _: errors)
    np.testing.assert_array_equal(values(maps, t_c, {}), values(without, t_c, {}))
