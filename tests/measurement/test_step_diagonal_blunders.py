"""One wrong reading among many: it is named with its diagonal and step, and kept."""

import re

import numpy as np
import pytest

from app.measurement.step_diagonal_readings import step_diagonal_readings
from tests.measurement.step_diagonal_example import (
    ORIGIN,
    SQUARENESS,
    STEP,
    STEPS,
    TRANSLATIONS,
    WAYS,
    derive,
    errors_of,
    field_of,
    random_tables,
)


def readings(seed, steps=STEPS):
    rng = np.random.default_rng(seed)
    field = field_of(random_tables(seed, [*TRANSLATIONS, *SQUARENESS], size=2.0, steps=steps))
    return step_diagonal_readings(field, ORIGIN, STEP, steps, noise_um=0.3, rng=rng)


def suspicions(read):
    return [note for note in derive(read).result.notes if note.startswith("Suspicious")]


@pytest.mark.parametrize("diagonal", WAYS)
@pytest.mark.parametrize("reading", [0, 7, 12, 23])
def test_a_wrong_reading_is_named_with_its_diagonal_and_step(diagonal, reading):
    read = readings(61)
    assert suspicions(read) == []
    step, axis = divmod(reading, 3)
    read[diagonal][step, axis] -= 30.0
    (said,) = suspicions(read)
    named = f"kept: {diagonal}, step {step + 1}, after {'xyz'[axis]} "
    assert re.search(named + r"\(by about -(29|30|31) µm\)\.$", said)


def test_a_wrong_reading_among_rounded_ones_is_named():
    """Closures that are 0 but for two have no scatter of their own."""
    read = step_diagonal_readings(field_of({}), ORIGIN, STEP, STEPS, resolution_um=0.1)
    read["npp"][3, 1] += 5.0
    (said,) = suspicions(read)
    assert "kept: npp, step 4, after y (by about 5 µm)." in said


def test_lost_counts_are_named_where_they_begin():
    read = readings(62)
    read["pnp"].reshape(-1)[10:] += 40.0
    (said,) = suspicions(read)
    assert "pnp, step 4, after y and from there on (by about 39 µm)" in said


def test_a_reading_that_two_diagonals_may_have_is_said_of_both():
    """8 µm among form of 2 µm: the closures show it, the form does not tell whose it is."""
    read = readings(65)
    read["ppp"][2, 0] += 8.0
    (said,) = suspicions(read)
    assert "ppp, step 3, after x" in said
    assert ", or ppn, step 3, after x" in said


def test_several_wrong_readings_are_no_single_one():
    read = readings(64)
    read["ppp"][2, 1] += 30.0
    read["npp"][6, 0] += 25.0
    (said,) = suspicions(read)
    assert "where x2, y3, y7, z3 (axis" in said
    assert "no single reading explains it" in said


def test_what_is_suspicious_is_kept():
    read = readings(65)
    before = errors_of(derive(read))
    read["ppn"][4, 2] += 30.0
    assert np.abs(errors_of(derive(read))["EZZ"] - before["EZZ"]).max() > 5.0


@pytest.mark.slow
@pytest.mark.parametrize(("steps", "most"), [(4, 0.07), (12, 0.02)])
def test_noise_alone_is_seldom_suspicious(steps, most):
    said = [bool(suspicions(readings(seed, steps))) for seed in range(300)]
    assert np.mean(said) < most
