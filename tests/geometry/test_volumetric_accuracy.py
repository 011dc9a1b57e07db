"""Every definition of 8.5 by hand, and against brute force on the model."""

import math

import numpy as np
import pytest

from app.errors import InvalidContent
from app.geometry import volumetric_accuracy as module
from app.geometry.body_diagonal import diagonal_accuracy, diagonal_displacements
from app.geometry.chain import Chain
from app.geometry.components import COMPONENTS
from app.geometry.error_field import ErrorField
from app.geometry.error_table import Table
from app.geometry.volumetric_accuracy import model_line_accuracy, volumetric_accuracy
from app.geometry.work_volume import WorkVolume
from tests.geometry.example_fields import NONRIGID, RIGID, TOOL, constant_field, random_field

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
    monkeypatch.setattr(module, "POINTS_AT_ONCE", 300)
    assert volumetric_accuracy(field, BOX, TOOL) == whole


def test_an_even_lattice_sees_at_most_as_much_as_the_tables_nodes():
    field = random_field("FXYZ", RIGID)
    nodes, lattice = (
        volumetric_accuracy(field, BOX),
        volumetric_accuracy(field, BOX, points_per_axis=9),
    )
    for name in ("linear", "angular", "with_arms"):
        assert getattr(lattice, name).definition_1 <= getattr(nodes, name).definition_1 + 1e-9
        assert getattr(lattice, name).definition_2 <= getattr(nodes, name).definition_2 + 1e-9


def test_body_diagonals_are_the_models():
    field = random_field("XYFZ", RIGID)
    found = volumetric_accuracy(field, BOX, TOOL, diagonal_steps=13)
    read = diagonal_displacements(field, BOX, 13, TOOL, at_nodes=True)
    assert found.diagonals == diagonal_accuracy(read)
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
    assert all(math.isnan(ratio) for ratio in perfect.ratios.values())


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


@pytest.mark.parametrize("points", [0, 1000])
def test_too_many_points_or_none_are_refused(points):
    with pytest.raises(
        InvalidContent, match="points_per_axis: expected 1 to 20000000 points in all"
    ):
        volumetric_accuracy(random_field(), BOX, points_per_axis=points)


def test_accuracy_is_of_one_thermal_state():
    field = ErrorField.make(Chain.parse("XYFZ"), {"EXX": Table((), [[1.0], [2.0]])})
    with pytest.raises(InvalidContent, match="expected one thermal state"):
        volumetric_accuracy(field, BOX)


@pytest.mark.parametrize("chain", ["FXYZ", "XYFZ"])
def test_ed_finds_the_extremes_between_even_steps(chain):
    """A fine walk along the diagonals finds no more than what nodes and middles show."""
    for seed in range(6):
        field = random_field(chain, RIGID, seed=seed, positions=5)
        volume = WorkVolume((0.0, 500.0), (0.0, 500.0), (0.0, 500.0))
        found = volumetric_accuracy(field, volume, TOOL).diagonals
        fine = diagonal_accuracy(diagonal_displacements(field, volume, 5000, TOOL))
        assert found.ed_um == pytest.approx(fine.ed_um, abs=0.02)
        assert found.esd_um == pytest.approx(fine.esd_um, abs=0.03)
