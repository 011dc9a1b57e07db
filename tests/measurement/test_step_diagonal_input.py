"""Readings and set-ups that cannot be right are refused, and strange ones are named."""

import numpy as np
import pytest

from app.errors import InvalidContent
from app.geometry.chain import Chain
from app.measurement.step_diagonal import step_diagonal
from tests.measurement.step_diagonal_example import ORIGIN, STEP, WAYS, derive

RNG = np.random.default_rng(51)
READ = {d: RNG.normal(size=(4, 3)) for d in WAYS}


def without(*names):
    return {d: rows for d, rows in READ.items() if d not in names}


def changed(index, value, diagonal="pnp"):
    rows = READ[diagonal].copy()
    rows[index] = value
    return READ | {diagonal: rows}


def nominal_mm():
    """The movement along each diagonal, as a display in mm shows it."""
    one = np.cumsum(STEP**2) / np.linalg.norm(STEP)
    return one + np.arange(4)[:, None] * np.linalg.norm(STEP)


@pytest.mark.parametrize(
    ("diagonals", "said"),
    [
        (READ | {"nnn": READ["ppp"]}, "expected ppp, npp, pnp, ppn, got 'nnn'"),
        (without("ppp", "npp"), "expected at least 3 of ppp, npp, pnp, ppn .* got pnp, ppn"),
        ({}, "expected at least 3 of .* got none"),
        (READ | {"npp": READ["npp"][:3]}, "same number of steps .* got ppp 4, npp 3, pnp 4"),
        (READ | {"npp": [[0.1, 0.2]]}, r"diagonals.npp: expected at least one row of 3 readings"),
        (READ | {"npp": []}, r"diagonals.npp: expected at least one row of 3 readings"),
        (READ | {"npp": [[0.1], [0.2, 0.3]]}, "rows of unequal length or no numbers"),
        (READ | {"npp": [["a", "b", "c"]]}, "rows of unequal length or no numbers"),
        (changed((2, 1), np.nan), r"diagonals.pnp: .* got nan \(row 2, after y\)"),
        (changed((0, 2), np.inf), r"diagonals.pnp: .* got inf \(row 0, after z\)"),
        (changed((3, 0), -2.0e4), r"within ±10000 µm, got -20000 µm: are they in nm"),
        ({d: nominal_mm() for d in WAYS}, "got the nominal displacements themselves in mm"),
    ],
)
def test_readings_that_cannot_be_right_are_refused(diagonals, said):
    with pytest.raises(InvalidContent, match=said):
        derive(diagonals)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"step_mm": [50.0, 0.0, 40.0]}, r"step_mm: expected steps above 0 .* got \[50.0, 0.0"),
        ({"step_mm": [50.0, -30.0, 40.0]}, "step_mm: expected steps above 0"),
        ({"step_mm": [50.0, 30.0]}, "step_mm: expected finite x, y and z in mm"),
        ({"step_mm": "fifty"}, "step_mm: expected x, y and z in mm"),
        ({"step_mm": [5.0e6, 3.0e6, 4.0e6]}, "step_mm: .* within ±100000 mm, .* are they in µm"),
        ({"origin_mm": [0.0, np.nan, 0.0]}, "origin_mm: expected finite x, y and z in mm"),
        ({"line": "median"}, "line: expected least-squares or end-points, got 'median'"),
        ({"target": "prism"}, "target: expected point, flat-mirror, got 'prism'"),
        ({"repeatability_um": 0.0}, "repeatability_um: .* more than 0 in µm, got 0"),
        ({"mirror_angle_urad": -1.0}, "mirror_angle_urad: .* 0 or more in µrad, got -1"),
        ({"mirror_angle_urad": np.nan}, "mirror_angle_urad: .* got nan"),
        ({"tool_offset_mm": [0.0, 1.0]}, "expected x, y and z of a point in mm"),
        ({"travel_mm": {"y": (-50.0, 69.0)}}, "y within its travel of -50 to 69 mm, got 4 steps"),
        ({"travel_mm": {"y": (-49.0, 100.0)}}, "from -50 to 70 mm"),
        ({"travel_mm": {"w": (0.0, 1.0)}}, "travel_mm: expected axes x, y, z, got 'w'"),
        ({"chain": Chain.parse("FZX")}, "expected a machine with axes x, y and z, got FZX"),
    ],
)
def test_set_ups_that_cannot_be_right_are_refused(wrong, said):
    right = {
        "chain": Chain.parse("XYFZ"), "origin_mm": ORIGIN, "step_mm": STEP, "diagonals": READ
    }  # fmt: skip
    with pytest.raises(InvalidContent, match=said):
        step_diagonal(**right | wrong)


def test_steps_may_use_the_whole_travel():
    travel = {"x": (100.0, 300.0), "y": (-50.0, 70.0), "z": (20.0, 180.0)}
    assert derive(READ, travel_mm=travel).result.tables


def test_readings_of_a_few_hundredths_may_be_in_mm():
    small = {d: rows / 1000.0 for d, rows in READ.items()}
    (note,) = [n for n in derive(small).result.notes if "may be in mm" in n]
    assert note.startswith("No reading is larger than 0.00")
    assert not any("may be in mm" in n for n in derive(READ).result.notes)


def test_a_diagonal_that_was_entered_twice_is_named():
    twice = READ | {"ppn": READ["npp"]}
    assert "npp and ppn have the same readings throughout." in derive(twice).result.notes
    zero = {d: np.zeros((4, 3)) for d in WAYS}
    assert not any("same readings" in note for note in derive(zero).result.notes)


def test_readings_that_are_all_zero_are_no_error():
    found = derive({d: np.zeros((4, 3)) for d in WAYS})
    assert all(not table.errors.any() for table in found.result.tables)
