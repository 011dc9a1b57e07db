"""The coarsest grid within a tolerance: by hand, by brute force, and when there is none."""

import itertools

import numpy as np
import pytest

from app.errors import InvalidContent
from app.geometry.chain import Chain
from app.geometry.error_field import ErrorField
from app.geometry.error_table import Table
from app.geometry.grid import sample_grid
from app.geometry.grid_difference import grid_difference
from app.geometry.grid_spacing import spacing_for_tolerance
from app.geometry.nonrigid_presets import find_preset
from app.geometry.work_volume import WorkVolume
from tests.geometry.example_fields import NONRIGID, RIGID, TOOL, constant_field, random_field

BOX = WorkVolume((0.0, 500.0), (0.0, 400.0), (0.0, 300.0))


def field_of(chain, tables):
    return ErrorField.make(Chain.parse(chain), {c: Table(*t) for c, t in tables.items()})


def bent(chain, kinds=RIGID, size=2.0, seed=3, codes=()):
    """Tables of 21 positions that bend slowly, as thermal errors do."""
    rng = np.random.default_rng(seed)
    u = np.linspace(0.0, 1.0, 21)
    tables = {}
    for code, (positions, _) in random_field(chain, kinds).tables.items():
        if "^" in code and codes and code not in codes:
            continue
        a, b = rng.normal(scale=size, size=2)
        tables[code] = (
            Table(500.0 * u, a * u**2 + b * np.sin(5 * u)) if positions.size else Table((), a)
        )
    return ErrorField.make(Chain.parse(chain), tables)


def left_by(field, intervals, tool=TOOL):
    nodes = [np.linspace(*r, n + 1) for r, n in zip(BOX.ranges_mm, intervals, strict=True)]
    return grid_difference(field, sample_grid(field, *nodes, tool), tool)


def test_a_straight_machine_needs_one_cell():
    found = spacing_for_tolerance(constant_field("XYFZ", {"SXY": 10.0, "EAX": 5.0}), BOX, 0.01)
    assert found.intervals == (1, 1, 1)
    assert found.spacing_mm == (500.0, 400.0, 300.0)
    assert found.points == 8
    assert found.bound_um < 1e-12


def test_a_kink_in_the_middle_needs_a_node_there():
    """One interval misses it by 4 µm, two hit it, three miss it by 4/3 µm."""
    field = field_of("FXYZ", {"EXX": ([0.0, 250.0, 500.0], [0.0, 4.0, 0.0])})
    assert left_by(field, (1, 1, 1)).largest_um == pytest.approx(4.0)
    assert left_by(field, (3, 1, 1)).largest_um == pytest.approx(4.0 / 3.0)
    found = spacing_for_tolerance(field, BOX, 1.0)
    assert found.intervals == (2, 1, 1)
    assert found.bound_um < 1e-12


def test_a_parabola_needs_as_many_as_its_formula_says():
    """E_y = q x² misses the chord by q h²/4: 40 µm over 500 mm needs n² ≥ 10/tolerance."""
    field = field_of("XFYZ", {"ECX": ([0.0, 500.0], [0.0, 80.0])})
    for tolerance, n in ((10.7, 1), (2.7, 2), (0.43, 5)):
        assert spacing_for_tolerance(field, BOX, tolerance).intervals == (n, 1, 1)


@pytest.mark.parametrize("chain", ["FXYZ", "XYFZ"])
@pytest.mark.parametrize("tolerance", [3.0, 0.8])
def test_the_tolerance_is_kept_and_no_axis_can_have_fewer(chain, tolerance):
    field = bent(chain)
    found = spacing_for_tolerance(field, BOX, tolerance, TOOL, 30)
    assert found.attained_um <= found.bound_um <= tolerance
    assert left_by(field, found.intervals).largest_um <= tolerance
    for i in range(3):
        for fewer in range(1, found.intervals[i]):
            coarser = [fewer if i == j else n for j, n in enumerate(found.intervals)]
            assert left_by(field, coarser).largest_um > tolerance


@pytest.mark.slow
def test_by_brute_force_on_small_numbers_it_is_among_the_best():
    """All grids of up to 5 intervals an axis: none that keeps it is coarser on every axis."""
    field = bent("XYFZ", seed=6)
    found = spacing_for_tolerance(field, BOX, 4.0, TOOL, 5)
    keeping = [
        n for n in itertools.product(range(1, 6), repeat=3) if left_by(field, n).largest_um <= 4.0
    ]
    assert found.intervals in keeping
    assert not [
        n for n in keeping if n != found.intervals and np.all(n <= np.array(found.intervals))
    ]


def test_what_the_axes_leave_bounds_what_the_grid_leaves():
    """The module's inequality on random fields: at most the sum, at least the largest."""
    for chain in ("FXYZ", "XYZF"):
        field = random_field(chain, NONRIGID, seed=2, positions=4)
        fine = [np.linspace(*r, 61) for r in BOX.ranges_mm]
        intervals = (2, 3, 2)
        errors = sample_grid(field, *fine, TOOL).errors_um
        left = []
        for i, n in enumerate(intervals):
            nodes = errors.take(np.arange(0, 61, 60 // n), axis=i)
            share = np.linspace(0, n, 61)
            cell = np.minimum(share.astype(int), n - 1)
            w = (share - cell).reshape([-1 if d == i else 1 for d in range(4)])
            along = (1 - w) * nodes.take(cell, axis=i) + w * nodes.take(cell + 1, axis=i)
            left.append(np.linalg.norm(along - errors, axis=-1).max())
        whole = left_by(field, intervals)
        assert whole.attained_length_um.max() >= max(left) - 1e-9
        assert np.linalg.norm(errors, axis=-1).max() > 0
        points = np.stack(np.meshgrid(*fine, indexing="ij"), axis=-1).reshape(-1, 3)
        nodes = [np.linspace(*r, n + 1) for r, n in zip(BOX.ranges_mm, intervals, strict=True)]
        grid = sample_grid(field, *nodes, TOOL)
        seen = np.linalg.norm(grid.at(points) - errors.reshape(-1, 3), axis=1).max()
        assert seen <= sum(left) + 1e-9


def test_the_gantrys_slopes_are_within_reach():
    preset = find_preset("large-gantry")
    field = bent(preset.configuration, NONRIGID, codes=preset.slopes)
    found = spacing_for_tolerance(field, BOX, 2.0, TOOL, 12)
    assert left_by(field, found.intervals).largest_um <= 2.0


def test_a_rotation_that_grows_with_its_own_arm_is_seen_where_it_is_largest():
    """XYFZ: E_z = −x² EBY^x(y), 25 µm at x = 500, y = 110 mm, and nothing beside that y.

    n intervals of x leave 25/4n² µm, but only there; y needs every 10 mm to have a node there.
    """
    positions = [0.0, 100.0, 110.0, 120.0, 400.0]
    field = field_of("XYFZ", {"EBY^x": (positions, [0.0, 0.0, 100.0, 0.0, 0.0])})
    found = spacing_for_tolerance(field, BOX, 0.75, most_intervals=40)
    assert found.intervals == (3, 40, 1)
    assert found.bound_um == pytest.approx(25.0 / 36.0, rel=0.02)


def test_when_one_axis_alone_leaves_too_much_it_says_how_much():
    """A kink 1 mm from the end is hit by no grid of up to 20 intervals."""
    field = field_of("FXYZ", {"EXX": ([0.0, 499.0, 500.0], [0.0, 4.0, 0.0])})
    with pytest.raises(
        InvalidContent,
        match=r"at most 20 intervals .* got 1 µm: along x alone at least 3\.\d+ µm are left",
    ):
        spacing_for_tolerance(field, BOX, 1.0, most_intervals=20)


def test_when_each_axis_would_do_but_not_all_together_it_says_so_too():
    kinked = ([0.0, 299.0, 300.0], [0.0, 4.0, 0.0])
    field = field_of("FXYZ", {"EXX": kinked, "EXY": kinked, "EXZ": kinked})
    cube = WorkVolume((0.0, 300.0), (0.0, 300.0), (0.0, 300.0))
    with pytest.raises(InvalidContent, match=r"the best one, .* leaves \d+\.\d+ µm somewhere"):
        spacing_for_tolerance(field, cube, 5.0, most_intervals=10)


@pytest.mark.parametrize(
    ("tolerance", "most", "volume", "message"),
    [
        (0.0, 10, BOX, "expected a tolerance above 0 µm, got 0 µm"),
        (np.nan, 10, BOX, "got nan µm"),
        (1.0, 0, BOX, "most_intervals: expected 1 to 1000, got 0"),
        (1.0, 1001, BOX, "got 1001"),
        (1.0, 10, WorkVolume((0, 1), (0, 0), (0, 1)), "y_mm: expected a range in mm to divide"),
    ],
)
def test_what_cannot_be_asked_is_refused(tolerance, most, volume, message):
    with pytest.raises(InvalidContent, match=message):
        spacing_for_tolerance(random_field(), volume, tolerance, TOOL, most)
