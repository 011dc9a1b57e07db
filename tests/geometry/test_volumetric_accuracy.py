"""Every definition of 8.5 by hand, and against brute force on the model."""

import math

import numpy as np
import pytest

from app.errors import InvalidContent
from app.geometry import box_extremes
from app.geometry.body_diagonal import (
    diagonal_accuracy,
    extreme_displacements,
)
from app.geometry.chain import Chain
from app.geometry.components import COMPONENTS
from app.geometry.error_field import ErrorField
from app.geometry.error_table import Table
from app.geometry.volumetric_accuracy import model_line_accuracy, volumetric_accuracy
from app.geometry.work_volume import WorkVolume
from tests.geometry.example_fields import (
    NONRIGID,
    RIGID,
    TOOL,
    constant_field,
    diagonal_displacements,
    random_field,
)

BOX = WorkVolume((0.0, 500.0), (50.0, 400.0), (100.0, 300.0))


def field_of(chain, tables):
    return ErrorField.make(Chain.parse(chain), {c: Table(*t) for c, t in tables.items()})


def test_all_definitions_by_hand():
    """EXX runs from −3 to 5 µm, EYY from 0 to 6, squareness adds 10 µm/m of y to x."""
    field = field_of(
        "XYFZ",
        {
            "EXX": ([0.0, 500.0], [-3.0, 5.0]),
            "EYY": ([0.0, 200.0, 400.0], [0.0, 6.0, 0.0]),
            "SXY": ((), 10.0),
            "EBX": ([0.0, 500.0], [-4.0, 8.0]),
            "ECZ": ([100.0, 300.0], [0.0, 5.0]),
        },
    )
    found = volumetric_accuracy(field, WorkVolume((0.0, 500.0), (0.0, 400.0), (0.0, 300.0)))
    # X from −3 + 0 to 5 + 4; the longest vector where x = 500, y = 200: (5 + 2, 6, 0).
    np.testing.assert_allclose(found.linear.ranges, [12.0, 6.0, 0.0])
    assert found.linear.definition_1 == pytest.approx(math.hypot(7.0, 6.0))
    assert found.linear.definition_2 == pytest.approx(math.hypot(12.0, 6.0))
    assert found.linear.worst_point_mm[:2] == (500.0, 200.0)
    np.testing.assert_allclose(found.angular.ranges, [0.0, 12.0, 5.0])
    assert found.angular.definition_1 == pytest.approx(math.hypot(8.0, 5.0))
    assert found.angular.definition_2 == 13.0
    # With its arm z of 300 mm, EBX adds −1.2 to 2.4 µm to x; its own arm x 500 mm, −4 to z.
    assert found.with_arms.ranges[0] == pytest.approx(12.0 + 0.3 * 12.0)
    assert found.with_arms.ranges[2] > 4.0


def test_definition_1_takes_the_root_of_the_sum_of_squares_not_of_their_mean():
    """The text of 8.118 says RMS, its equation has no third."""
    found = volumetric_accuracy(constant_field("FXYZ", {"EXX": 2.0, "EYY": -3.0, "EZZ": 6.0}), BOX)
    assert found.linear.definition_1 == pytest.approx(7.0)
    assert found.linear.definition_2 == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("chain", ["FXYZ", "XYFZ", "XYZF"])
@pytest.mark.parametrize("kinds", [RIGID, NONRIGID], ids=["rigid", "nonrigid"])
def test_no_random_point_beats_the_sums_and_the_printed_ones_have_no_arms(chain, kinds):
    field = random_field(chain, kinds, seed=5, positions=6)
    found = volumetric_accuracy(field, BOX, TOOL)
    low, high = np.array(BOX.ranges_mm).T
    points = np.random.default_rng(6).uniform(low, high, (40_000, 3))
    sums = {
        "linear": field.only(lambda c: not c.is_rotation).at(points)[0],
        "angular": field.rotation_at(points),
        "with_arms": field.at(points, TOOL)[0],
    }
    for name, vectors in sums.items():
        spread = getattr(found, name)
        assert (np.ptp(vectors, axis=0) <= np.array(spread.ranges) + 1e-9).all()
        assert np.linalg.norm(vectors, axis=1).max() <= spread.definition_1 + 1e-9
        assert spread.definition_2 == pytest.approx(math.hypot(*spread.ranges))
    worst = np.array(found.with_arms.worst_point_mm)
    assert ((worst >= low) & (worst <= high)).all()
    there = np.linalg.norm(field.at(worst, TOOL)[0])
    assert there == pytest.approx(found.with_arms.definition_1, rel=1e-12)


def test_in_slabs_it_is_the_same_as_at_once(monkeypatch):
    field = random_field("XYFZ", RIGID)
    whole = volumetric_accuracy(field, BOX, TOOL)
    monkeypatch.setattr(box_extremes, "POINTS_AT_ONCE", 300)
    parts = volumetric_accuracy(field, BOX, TOOL)
    assert (parts.linear, parts.angular) == (whole.linear, whole.angular)
    assert parts.with_arms.definition_1 == pytest.approx(whole.with_arms.definition_1, abs=2e-5)
    assert parts.with_arms.ranges == pytest.approx(whole.with_arms.ranges, abs=4e-5)


def test_body_diagonals_are_the_models():
    field = random_field("XYFZ", RIGID)
    found = volumetric_accuracy(field, BOX, TOOL)
    assert found.diagonals == diagonal_accuracy(extreme_displacements(field, BOX, TOOL))
    assert found.diagonals.ed_um <= found.diagonals.esd_um


def test_lines_along_the_edges_by_hand():
    """EXX spans 8 µm; with EBX of 0 to 20 µrad and z at 100 and 300 mm, 10 and 14 µm: mean 12.

    Straightness EXY of 1 µm and SXY of 10 µm/m over y's 350 mm: 4.5 µm. ELSv's x is then 16.5.
    """
    field = field_of(
        "FXYZ",
        {
            "EXX": ([0.0, 500.0], [0.0, 8.0]),
            "EBX": ([0.0, 500.0], [0.0, 20.0]),
            "EXY": ([50.0, 400.0], [0.0, 1.0]),
            "SXY": ((), 10.0),
        },
    )
    found = model_line_accuracy(field, BOX)
    assert found.elv_um == pytest.approx(12.0)
    assert found.elsv_um == pytest.approx(16.5)
    assert volumetric_accuracy(field, BOX).lines == found


def test_a_kink_inside_the_volume_is_straightness_too_and_outside_it_is_none():
    for position, expected in ((225.0, 3.0), (450.0, 3.0 * 350.0 / 400.0)):
        field = field_of("FXYZ", {"EXY": ([50.0, position, 500.0], [0.0, 3.0, 0.0])})
        assert model_line_accuracy(field, BOX).elsv_um == pytest.approx(expected)


def test_the_chapters_ratios():
    field = random_field("XYFZ", RIGID, seed=2)
    found = volumetric_accuracy(field, BOX)
    ratios = found.ratios
    assert ratios["M1"] == pytest.approx(found.lines.ratio)
    assert ratios["M2"] == pytest.approx(found.lines.elsv_um / found.diagonals.ed_um)
    assert ratios["M3"] == pytest.approx(found.lines.elsv_um / found.diagonals.esd_um)
    assert ratios["M3"] <= ratios["M2"]
    perfect = volumetric_accuracy(constant_field("XYFZ", {}), BOX)
    assert all(ratio is None for ratio in perfect.ratios.values())


def test_a_lathe_has_a_flat_work_volume():
    field = field_of("FZX", {"EXX": ([0.0, 200.0], [0.0, 4.0]), "EZZ": ([0.0, 400.0], [0.0, 3.0])})
    found = volumetric_accuracy(field, WorkVolume((0.0, 200.0), (0.0, 0.0), (0.0, 400.0)))
    np.testing.assert_allclose(found.linear.ranges, [4.0, 0.0, 3.0])
    assert found.lines.elv_um == pytest.approx(5.0)


def test_doubled_errors_double_every_measure():
    field = random_field("XYFZ", RIGID, seed=3)
    twice = ErrorField.make(
        field.chain, {c: Table(p, 2.0 * v[0]) for c, (p, v) in field.tables.items()}
    )
    one, two = (volumetric_accuracy(f, BOX, TOOL) for f in (field, twice))
    assert two.linear.definition_1 == pytest.approx(2.0 * one.linear.definition_1)
    assert two.with_arms.definition_2 == pytest.approx(2.0 * one.with_arms.definition_2)
    assert two.diagonals.esd_um == pytest.approx(2.0 * one.diagonals.esd_um)
    assert two.lines.elsv_um == pytest.approx(2.0 * one.lines.elsv_um)


def test_components_that_are_no_rotation_are_the_linear_sums():
    """8.112: EXX + EXY + EXZ at one point, squareness in, and nothing of EBX's arm."""
    field = random_field("XYFZ", RIGID, seed=4)
    point = WorkVolume((123.0, 123.0), (77.0, 77.0), (211.0, 211.0))
    found = volumetric_accuracy(field, WorkVolume(*((lo, hi + 1e-3) for lo, hi in point.ranges_mm)))
    by_hand = np.zeros(3)
    for code, (positions, values) in field.tables.items():
        component = COMPONENTS[code]
        at = {"x": 123.0, "y": 77.0, "z": 211.0}
        if not component.is_rotation:
            value = (
                np.interp(at[component.axis], positions, values[0])
                if component.axis
                else (values[0, 0] * at[component.times] / 1000.0)
            )
            by_hand["xyz".index(component.direction)] += value
    assert found.linear.definition_1 == pytest.approx(np.linalg.norm(by_hand), abs=1e-3)


def test_too_many_nodes_are_refused(monkeypatch):
    monkeypatch.setattr(box_extremes, "MOST_POINTS", 1000)
    with pytest.raises(InvalidContent, match="volume: expected tables with at most 1000 nodes"):
        volumetric_accuracy(random_field(), BOX)


def test_accuracy_is_of_one_thermal_state():
    field = ErrorField.make(Chain.parse("XYFZ"), {"EXX": Table((), [[1.0], [2.0]])})
    with pytest.raises(InvalidContent, match="expected one thermal state"):
        volumetric_accuracy(field, BOX)


@pytest.mark.parametrize("chain", ["FXYZ", "XYFZ"])
@pytest.mark.parametrize("kinds", [RIGID, NONRIGID], ids=["rigid", "nonrigid"])
def test_walks_along_the_diagonals_come_up_to_ed_from_below(chain, kinds):
    """The finer the walk, the nearer: by the square of its step, as at every vertex."""
    volume = WorkVolume((0.0, 500.0), (0.0, 500.0), (0.0, 500.0))
    for seed in range(2):
        field = random_field(chain, kinds, seed=seed, positions=5)
        found = diagonal_accuracy(extreme_displacements(field, volume, TOOL))
        # Nodes are whole mm: every walk of n × 500 steps stops at all of them.
        for steps, within in ((500, 2e-3), (3000, 6e-5)):
            walk = diagonal_accuracy(diagonal_displacements(field, volume, steps, TOOL))
            assert walk.ed_um <= found.ed_um + 1e-9
            assert walk.ed_um == pytest.approx(found.ed_um, abs=within)
            assert walk.esd_um <= found.esd_um + 1e-9
            assert walk.esd_um == pytest.approx(found.esd_um, abs=within)


def test_the_diagonals_of_a_parabola_and_of_a_cubic_by_hand():
    """From (0, 0, 0) to (0.9, 0.3, 0.4) m with an angle of 300 t − 100 at the share t of x.

    ECX [µrad] has x as its arm in y: 0.27 (300 t² − 100 t) along the way's metres, least at
    t = 1/6, −2.25, and 54 at the end. EAX^y [µrad/m] with y as factor and z as arm in y:
    −0.036 (300 t³ − 100 t²), most at t = 2/9, 0.036 · 400/243, and −7.2 at the end.
    """
    box = WorkVolume((0.0, 900.0), (0.0, 300.0), (0.0, 400.0))
    way = math.hypot(0.9, 0.3, 0.4)
    for code, metres in (("ECX", 56.25), ("EAX^y", 7.2 + 0.036 * 400 / 243)):
        field = field_of("XYFZ", {code: ([0.0, 900.0], [-100.0, 200.0])})
        read = extreme_displacements(field, box)
        assert np.ptp(read["ppp"]) == pytest.approx(metres / way, rel=1e-12)
        assert volumetric_accuracy(field, box).diagonals.ranges_um["ppp"] == np.ptp(read["ppp"])
