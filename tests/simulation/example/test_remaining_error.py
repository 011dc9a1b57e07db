"""Three maps leave less than two, two less than none (C. Wang, 8.2.9)."""

import numpy as np
import pytest

from app.geometry.components import Kind
from app.simulation.example.error_maps import run_map
from app.simulation.example.remaining_error import COMPARED_RUNS, remaining_errors

ROWS = {(row.run, len(row.stored)): row for row in remaining_errors()}
LABELS = [f"Run #{n}" for n in COMPARED_RUNS]


def test_each_unseen_run_is_compared_with_no_two_and_three_maps():
    assert list(ROWS) == [(label, n) for label in LABELS for n in (0, 2, 3)]
    assert {row.stored for row in ROWS.values()} == {
        (),
        ("Run #1", "Run #6"),
        ("Run #1", "Run #3", "Run #6"),
    }


@pytest.mark.parametrize("label", LABELS)
@pytest.mark.parametrize("figure", ["rms_um", "max_um", "rms_um_per_m", "max_um_per_m"])
def test_three_maps_leave_less_than_two_and_less_than_half_of_uncompensated(label, figure):
    none, two, three = (getattr(ROWS[label, n], figure) for n in (0, 2, 3))
    assert three < 0.75 * two
    assert two < none
    assert three < 0.5 * none


@pytest.mark.parametrize("label", LABELS)
@pytest.mark.parametrize("figure", ["rms_urad", "max_urad"])
def test_of_the_angles_too_three_maps_leave_less_than_two(label, figure):
    # Rotations change by less than displacements do, so that noise is most of what remains.
    none, two, three = (getattr(ROWS[label, n], figure) for n in (0, 2, 3))
    assert three < two < 0.2 * none


def test_an_uncompensated_row_is_the_measured_map_itself():
    tables = run_map(4).tables.values()
    angular = np.concatenate([t.errors for t in tables if t.component.kind is Kind.ANGULAR])
    linear = np.concatenate(
        [t.errors for t in tables if t.component.is_table and not t.component.is_rotation]
    )
    squareness = [abs(t.errors[0]) for t in tables if not t.component.is_table]
    assert linear.size == angular.size == 9 * 21
    assert ROWS["Run #4", 0].rms_um == pytest.approx(np.sqrt(np.mean(linear**2)))
    assert ROWS["Run #4", 0].max_um_per_m == max(squareness)
    assert ROWS["Run #4", 0].rms_urad == pytest.approx(np.sqrt(np.mean(angular**2)))
    assert ROWS["Run #4", 0].max_urad == np.abs(angular).max()
