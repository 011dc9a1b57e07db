"""The true extremes over a box: by hand, and against a search that comes from below."""

import math

import numpy as np
import pytest

from app.geometry import box_extremes as module
from app.geometry.box_extremes import EXACT_WITHIN, box_extremes, error_extremes
from app.geometry.chain import Chain
from app.geometry.error_field import ErrorField
from app.geometry.error_table import Table
from app.geometry.work_volume import WorkVolume, points_of
from tests.geometry.example_fields import LINES, NONRIGID, RIGID, TOOL, random_field

BOX = WorkVolume((0.0, 500.0), (50.0, 400.0), (100.0, 300.0))


def parabola(low, high):
    """ECX runs from `low` to `high` µrad over 1 m of a workpiece-side X, its own arm."""
    tables = {"ECX": Table([0.0, 1000.0], [low, high])}
    return ErrorField.make(Chain.parse("XYFZ"), tables)


def test_a_parabola_by_hand():
    """E_y = x (300 x − 100) µm with x in m: −25/3 µm at 1/6 m; on to 0.3 m, −3 µm."""
    field = parabola(-100.0, 200.0)
    found = error_extremes(field, WorkVolume((0.0, 300.0), (0.0, 0.0), (0.0, 0.0)))
    assert found.least[1] == pytest.approx(-25 / 3, abs=EXACT_WITHIN)
    assert found.most.tolist() == [0.0, 0.0, 0.0]
    assert found.longest == pytest.approx(25 / 3, abs=EXACT_WITHIN)
    assert found.where_mm[0] == pytest.approx(1000 / 6, abs=1.0)
    assert found.within <= EXACT_WITHIN


def test_what_ends_and_middles_miss_is_found():
    """On to 1/3 m ends are 0 and −0: what is seen there, and at a quarter, is too little."""
    field = parabola(-100.0, 200.0)
    third = 1000 / 3
    sampled = field.at(np.outer([0.0, 0.25, 0.75, 1.0], [third, 0.0, 0.0]))[0]
    assert sampled[:, 1].min() == pytest.approx(0.75 * -25 / 3)
    found = error_extremes(field, WorkVolume((0.0, third), (0.0, 0.0), (0.0, 0.0)))
    assert found.least[1] == pytest.approx(-25 / 3, abs=EXACT_WITHIN)


def test_a_saddle_of_two_parabolas_by_hand():
    """XYZF, EBX = 100 µrad/m · x − 50, EAY = 100 µrad/m · y − 30 turn their own arms.

    E_z = −x (100 x − 50) + y (100 y − 30) µm over 1 m: from −50 − 2.25 to 6.25 + 70.
    """
    tables = {
        "EBX": Table([0.0, 1000.0], [-50.0, 50.0]),
        "EAY": Table([0.0, 1000.0], [-30.0, 70.0]),
    }
    field = ErrorField.make(Chain.parse("XYZF"), tables)
    found = error_extremes(field, WorkVolume((0.0, 1000.0), (0.0, 1000.0), (0.0, 0.0)))
    assert found.least[2] == pytest.approx(-52.25, abs=EXACT_WITHIN)
    assert found.most[2] == pytest.approx(76.25, abs=EXACT_WITHIN)


@pytest.mark.slow
@pytest.mark.parametrize("chain", ["FXYZ", "XYFZ", "XYZF"])
@pytest.mark.parametrize("kinds", [RIGID, NONRIGID], ids=["rigid", "nonrigid"])
@pytest.mark.parametrize("lines", [None, LINES], ids=["axes", "lines"])
def test_searching_from_below_comes_up_to_it_and_never_beyond(chain, kinds, lines):
    """Lattices that close in on the best point of the last one, from many starts."""
    tables = {
        code: Table(positions if positions.size < 2 else [0.0, 170.0, 310.0, 500.0], values[0])
        for code, (positions, values) in random_field(chain, kinds, 7, positions=4).tables.items()
    }
    field = ErrorField.make(Chain.parse(chain), tables, lines)
    found = error_extremes(field, BOX, TOOL)
    assert found.within <= EXACT_WITHIN
    wanted = {
        "longest": lambda e: np.linalg.norm(e, axis=1),
        **{f"most {i}": lambda e, i=i: e[:, i] for i in range(3)},
        **{f"least {i}": lambda e, i=i: -e[:, i] for i in range(3)},
    }
    exact = [found.longest, *found.most, *-found.least]
    for measure, expected in zip(wanted.values(), exact, strict=True):
        climbed = climb(field, measure)
        assert climbed <= expected + EXACT_WITHIN
        assert climbed == pytest.approx(expected, abs=3 * EXACT_WITHIN)


def climb(field, measure):
    low, high = np.array(BOX.ranges_mm).T
    sides = [np.union1d(np.linspace(a, b, 7), [170.0, 310.0]) for a, b in BOX.ranges_mm]
    points = points_of(*sides)
    points = np.clip(points, low, high)
    values = measure(field.at(points, TOOL)[0])
    best = -np.inf
    for start in points[np.argsort(values)[-8:]]:
        where, reach = start, (high - low) / 6
        for _ in range(25):
            near = where + WorkVolume((-1.0, 1.0), (-1.0, 1.0), (-1.0, 1.0)).lattice(5) * reach
            near = np.clip(near, low, high)
            here = measure(field.at(near, TOOL)[0])
            where, reach = near[here.argmax()], reach * 0.6
            best = max(best, float(here.max()))
    return best


def test_where_no_axis_turns_itself_extremes_are_at_nodes_exactly():
    field = random_field("FXYZ", RIGID, positions=5)
    found = error_extremes(field, BOX, TOOL)
    assert found.within == 0.0
    fine = field.at(BOX.lattice(30), TOOL)[0]
    assert (fine.max(axis=0) <= found.most + 1e-12).all()
    assert (fine.min(axis=0) >= found.least - 1e-12).all()


@pytest.mark.slow
@pytest.mark.parametrize("cells", [1, 5, 40])
def test_a_search_that_must_end_early_says_what_it_may_have_missed(cells, monkeypatch):
    field = random_field("XYZF", NONRIGID, seed=9, positions=3)
    whole = error_extremes(field, BOX, TOOL)
    monkeypatch.setattr(module, "MOST_CELLS", cells)
    found = error_extremes(field, BOX, TOOL)
    slack = found.within + EXACT_WITHIN
    assert found.longest <= whole.longest + EXACT_WITHIN
    assert whole.longest <= found.longest + slack
    assert (whole.most <= found.most + slack).all()
    assert (whole.least >= found.least - slack).all()


def test_of_two_parabolas_the_one_not_looked_into_is_bounded_by_its_coefficients(monkeypatch):
    """ECX −100, 200, 50 µrad at 0, 0.5, 1 m: E_y = x (600 x − 100), then x (350 − 300 x) µm.

    The first is least at 1/12 m, −25/6; the second most at 7/12 m, 102.083. Its ends, 100
    and 50, and its middle, 93.75, bound it by 2 · 93.75 − 75 = 112.5.
    """
    tables = {"ECX": Table([0.0, 500.0, 1000.0], [-100.0, 200.0, 50.0])}
    field = ErrorField.make(Chain.parse("XYFZ"), tables)
    box = WorkVolume((0.0, 1000.0), (0.0, 0.0), (0.0, 0.0))
    whole = error_extremes(field, box)
    assert whole.most[1] == pytest.approx(350**2 / 1200, abs=EXACT_WITHIN)
    monkeypatch.setattr(module, "MOST_CELLS", 1)
    found = error_extremes(field, box)
    assert found.least[1] == pytest.approx(-25 / 6, abs=EXACT_WITHIN)
    assert (found.most[1], found.within) == (100.0, 12.5)


def test_huge_errors_are_as_exact_as_their_digits_allow():
    field = parabola(-1e11, 2e11)
    found = error_extremes(field, WorkVolume((0.0, 300.0), (0.0, 0.0), (0.0, 0.0)))
    assert found.least[1] == pytest.approx(-25e9 / 3, rel=1e-11)
    assert found.within < 0.1


def test_a_point_is_a_box_too():
    field = random_field("XYZF", RIGID)
    point = WorkVolume((10.0, 10.0), (60.0, 60.0), (110.0, 110.0))
    found = box_extremes(lambda points: field.at(points)[0], field, point, (2, 2, 2))
    expected = field.at([[10.0, 60.0, 110.0]])[0][0]
    assert found.most.tolist() == found.least.tolist() == expected.tolist()
    assert found.longest == pytest.approx(math.hypot(*expected))
