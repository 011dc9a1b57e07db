"""What a laser would read: by hand, against the printed equations, noise, mirrors, rounding."""

import numpy as np
import pytest

from app.errors import InvalidContent
from app.geometry.error_table import Table
from app.geometry.work_volume import WorkVolume
from app.measurement.step_diagonal_readings import step_diagonal_readings
from tests.geometry.example_fields import diagonal_displacements
from tests.measurement.step_diagonal_example import (
    ANGULAR,
    CHAINS,
    ORIGIN,
    SQUARENESS,
    STEP,
    STEPS,
    TOOL,
    TRANSLATIONS,
    WAYS,
    field_of,
    increments_by_hand,
    nodes,
    random_tables,
)

R = np.linalg.norm(STEP)


def test_increments_are_those_of_equation_6_for_each_axis():
    """dR(x) on npp is −E_x X/R + E_y Y/R + E_z Z/R for E over one step up, and so on."""
    tables = random_tables(1, TRANSLATIONS)
    read = increments_by_hand(step_diagonal_readings(field_of(tables), ORIGIN, STEP, STEPS))
    assert len(read) == 4 * 3 * STEPS
    for (diagonal, u, interval), increment in read.items():
        errors = [np.diff(tables[f"E{v}{'XYZ'[u]}"].values)[interval] for v in "XYZ"]
        expected = sum(w * e * s / R for w, e, s in zip(WAYS[diagonal], errors, STEP, strict=True))
        assert increment == pytest.approx(expected, abs=1e-12)


def test_one_axis_that_turns_acts_where_the_others_stand():
    """XYFZ by hand: EBX of 10 µrad in the first x interval, lever arms z and x."""
    field = field_of({"EBX": Table(nodes("x"), [0.0] + [10.0] * STEPS)})
    read = step_diagonal_readings(field, ORIGIN, STEP, STEPS)["ppp"]
    # x at 150 mm, z still at 20 mm: E_x = 10 · 0.02 µm, E_z = −10 · 0.15 µm.
    assert read[0, 0] == pytest.approx((0.2 * 50.0 - 1.5 * 40.0) / R)
    # y adds nothing; then z at 60 mm: E_x = 10 · 0.06 µm.
    assert read[0, 1] == pytest.approx(read[0, 0])
    assert read[0, 2] == pytest.approx((0.6 * 50.0 - 1.5 * 40.0) / R)


@pytest.mark.parametrize("chain", CHAINS)
def test_after_z_they_are_the_body_diagonals(chain):
    field = field_of(random_tables(2, [*TRANSLATIONS, *ANGULAR, *SQUARENESS]), chain)
    read = step_diagonal_readings(field, ORIGIN, STEP, STEPS, tool_offset_mm=TOOL)
    ends = zip(ORIGIN, ORIGIN + STEPS * STEP, strict=True)
    expected = diagonal_displacements(field, WorkVolume(*ends), STEPS, TOOL)
    for diagonal, rows in read.items():
        np.testing.assert_allclose(rows[:, 2], expected[diagonal][1:], atol=1e-10)


def test_a_tilting_mirror_moves_what_stands_beside_the_beam():
    """XYFZ, x turns the table by ω = ECX = 10 µrad: after x the mirror's middle is 50 mm on.

    The beam still meets the mirror on the diagonal, at T + (0, 0, 0) from its start, so
    that the arm is what the diagonal reached, and not where the mirror's middle stands.
    """
    field = field_of({"ECX": Table(nodes("x"), [0.0] + [10.0] * STEPS)}, "XYFZ")
    ray = STEP / R
    middle = step_diagonal_readings(field, ORIGIN, STEP, STEPS, tool_offset_mm=TOOL)
    mirror = step_diagonal_readings(
        field, ORIGIN, STEP, STEPS, tool_offset_mm=TOOL, target="flat-mirror"
    )
    moved = np.array([50.0, 0.0, 0.0])
    beside = moved - (moved @ ray) * ray
    added = -np.cross([0.0, 0.0, 10.0], beside / 1000.0) @ ray
    assert abs(added) > 0.05
    assert mirror["ppp"][0, 0] - middle["ppp"][0, 0] == pytest.approx(added)
    # After x, y and z it stands on the diagonal again.
    np.testing.assert_allclose(mirror["ppp"][:, 2], middle["ppp"][:, 2], atol=1e-12)


def test_a_misaligned_mirror_adds_a_constant_to_each_axis_step_that_sums_to_zero():
    """[V IV C]: proportional to angle and step; 0.5 mrad and 50 mm make 25 µm at most."""
    tilts = {"ppp": (500.0, 0.0), "npp": (0.0, -300.0)}
    read = step_diagonal_readings(field_of({}), ORIGIN, STEP, STEPS, mirror_tilts_urad=tilts)
    for diagonal, angle in (("ppp", 500.0), ("npp", 300.0)):
        added = np.diff(read[diagonal].ravel(), prepend=0.0).reshape(STEPS, 3)
        assert np.ptp(added, axis=0).max() < 1e-9
        np.testing.assert_allclose(added.sum(axis=1), 0.0, atol=1e-9)
        assert 1.0 < np.abs(added).max() <= angle * STEP.max() / 1000.0
    # e1 is level: k × r = (−30, 50, 0)/√3400, so that x adds −30/√3400 · 0.5 µm/mm · 50 mm.
    assert read["ppp"][0, 0] == pytest.approx(-30.0 / np.sqrt(3400.0) * 25.0)
    assert read["pnp"].any() == read["ppn"].any() == False  # noqa: E712


@pytest.mark.slow
def test_noise_is_of_every_reading_and_of_the_zero():
    rng = np.random.default_rng(7)
    runs = [
        step_diagonal_readings(field_of({}), ORIGIN, STEP, 3, noise_um=0.5, rng=rng)["pnp"]
        for _ in range(2000)
    ]
    covariance = np.cov(np.array(runs).reshape(2000, 9).T)
    np.testing.assert_allclose(covariance, 0.25 * (np.eye(9) + 1), atol=0.05)


def test_readings_are_rounded_to_the_instruments_resolution():
    field = field_of(random_tables(3, TRANSLATIONS))
    fine = step_diagonal_readings(field, ORIGIN, STEP, STEPS)
    coarse = step_diagonal_readings(field, ORIGIN, STEP, STEPS, resolution_um=0.5)
    for diagonal, rows in coarse.items():
        np.testing.assert_array_equal(rows * 2, np.round(rows * 2))
        assert 0.05 < np.abs(rows - fine[diagonal]).max() <= 0.25


def test_only_the_wanted_diagonals():
    assert list(step_diagonal_readings(field_of({}), ORIGIN, STEP, 1, diagonals=["pnp"])) == ["pnp"]


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"steps": 0}, "expected at least 1 step, got 0"),
        ({"diagonals": ["nnn"]}, "expected ppp, npp, pnp, ppn, got 'nnn'"),
        ({"noise_um": 1.0}, "a random generator for it, got 1"),
        ({"noise_um": -1.0, "rng": np.random.default_rng(0)}, "standard deviation in µm"),
        ({"target": "prism"}, "expected point, flat-mirror, got 'prism'"),
    ],
)
def test_what_cannot_be_simulated_is_refused(wrong, said):
    with pytest.raises(InvalidContent, match=said):
        step_diagonal_readings(
            **{"field": field_of({}), "origin_mm": ORIGIN, "step_mm": STEP, "steps": 2, **wrong}
        )
