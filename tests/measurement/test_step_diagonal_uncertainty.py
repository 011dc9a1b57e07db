"""Standard errors and covariances against many simulated measurements."""

import numpy as np
import pytest

from app.geometry.error_table import Table
from app.measurement.step_diagonal_input import take_walk
from app.measurement.step_diagonal_readings import step_diagonal_readings
from app.measurement.step_diagonal_uncertainty import neighbours_correlation, step_noise
from tests.measurement.step_diagonal_example import (
    ORIGIN,
    SQUARENESS,
    STEP,
    TRANSLATIONS,
    WAYS,
    derive,
    errors_of,
    field_of,
    increments_by_hand,
    nodes,
    random_tables,
    table_of,
)

RUNS = 500
N = 6
SIGMA = 0.4
THREE = ("ppp", "npp", "pnp")


def many(line="end-points", diagonals=tuple(WAYS), steps=N, runs=RUNS, seed=41, **options):
    """Repeat one measurement with new noise: the errors found, and the last derivation."""
    rng = np.random.default_rng(seed)
    field = field_of(random_tables(41, [*TRANSLATIONS, *SQUARENESS], steps=steps))
    drawn = {}
    found = []
    for _ in range(runs):
        read = step_diagonal_readings(
            field, ORIGIN, STEP, steps, diagonals=diagonals, noise_um=SIGMA, rng=rng
        )
        found.append(derive(read, line=line, mirror_angle_urad=0.0, **options))
        for code, values in errors_of(found[-1]).items():
            drawn.setdefault(code, []).append(values)
    return {code: np.array(values) for code, values in drawn.items()}, found


@pytest.mark.slow
@pytest.mark.parametrize("diagonals", [tuple(WAYS), THREE])
@pytest.mark.parametrize("line", ["end-points", "least-squares"])
def test_covariances_are_those_of_many_measurements(line, diagonals):
    stated_noise = {} if len(diagonals) == 4 else {"repeatability_um": SIGMA}
    drawn, found = many(line, diagonals, **stated_noise)
    for code, values in drawn.items():
        covariance = table_of(found[-1], code).covariance
        # As for the noise that was drawn, not as for this run's estimate of it.
        covariance = covariance * (SIGMA / found[-1].noise.reading_um) ** 2
        scatter = np.cov(values.T).reshape(covariance.shape)
        # 500 draws: a standard error of 3 %; correlations likewise, in parts of the largest.
        largest = np.diagonal(covariance).max()
        np.testing.assert_allclose(scatter, covariance, atol=0.25 * largest, err_msg=code)
        assert np.trace(scatter) / np.trace(covariance) == pytest.approx(1.0, abs=0.15), code


def test_errors_far_from_the_start_share_the_increments_on_the_way():
    """White readings: increments add up, so the variance grows with the number of steps."""
    _, found = many(runs=1)
    covariance = table_of(found[0], "EXX").covariance
    i = np.arange(N + 1)
    one = covariance[1, 1]
    np.testing.assert_allclose(covariance, one * np.minimum.outer(i, i), rtol=1e-12)
    # 2σ² R²/(4 X²) for a step of X.
    sigma = found[0].noise.reading_um
    assert one == pytest.approx(2 * sigma**2 * (STEP @ STEP) / (4 * STEP[0] ** 2))
    assert table_of(found[0], "EXX").standard_errors[0] == 0.0


def test_three_diagonals_have_twice_the_variance_of_four():
    options = {"repeatability_um": 0.4, "mirror_angle_urad": 0.0}
    rng = np.random.default_rng(42)
    read = step_diagonal_readings(field_of({}), ORIGIN, STEP, N, noise_um=0.4, rng=rng)
    four = derive(read, **options)
    three = derive({d: read[d] for d in THREE}, **options)
    scaled = (0.4 / four.noise.reading_um) ** 2
    for code in TRANSLATIONS:
        one, other = (table_of(f, code).covariance.trace() for f in (three, four))
        assert one == pytest.approx(2 * scaled * other)


@pytest.mark.slow
@pytest.mark.parametrize("mirror", [None, 0.0])
def test_the_noise_has_the_stated_degrees_of_freedom(mirror):
    """Unbiased, and with the spread of a χ² of so many degrees of freedom."""
    rng = np.random.default_rng(43)
    field = field_of({})
    drawn = []
    for _ in range(800):
        read = step_diagonal_readings(field, ORIGIN, STEP, 4, noise_um=1.0, rng=rng)
        found = derive(read, mirror_angle_urad=mirror)
        drawn.append(found.noise.reading_um**2)
    freedom = found.noise.degrees_of_freedom
    assert np.mean(drawn) == pytest.approx(1.0, abs=0.07)
    assert 2 / np.var(drawn) == pytest.approx(freedom, rel=0.25)
    # 12 closures less their 3 means, and fewer because neighbours share readings.
    assert 5.0 < freedom < (12.0 if mirror == 0.0 else 9.0)


@pytest.mark.slow
def test_squareness_by_the_ends_is_three_times_better_than_the_slopes_plain_sum():
    """√2 σ R/(2XY n) against the sum of both slopes, ten steps."""
    rng = np.random.default_rng(47)
    design = np.array(list(WAYS.values())) * STEP / np.linalg.norm(STEP)
    solution = np.linalg.pinv(design)
    ours, plain = [], []
    for _ in range(300):
        read = step_diagonal_readings(field_of({}), ORIGIN, STEP, 10, noise_um=1.0, rng=rng)
        found = derive(read, mirror_angle_urad=0.0)
        ours.append(errors_of(found)["SXY"][0])
        by_hand = increments_by_hand(read)
        sums = np.array([[sum(by_hand[d, u, i] for i in range(10)) for u in (0, 1)] for d in WAYS])
        slopes = [solution[1] @ sums[:, 0] / STEP[0], solution[0] @ sums[:, 1] / STEP[1]]
        plain.append(sum(slopes) / 10 * 1000.0)
    expected = 2**0.5 * np.linalg.norm(STEP) / (2 * STEP[0] * STEP[1] * 10) * 1000.0
    stated = table_of(found, "SXY").standard_errors[0] / found.noise.reading_um
    assert stated == pytest.approx(expected)
    assert np.std(ours) == pytest.approx(expected, rel=0.12)
    assert np.std(plain) / np.std(ours) == pytest.approx(3.3, abs=0.5)


def test_closures_are_as_large_as_the_noise_of_an_increment():
    rng = np.random.default_rng(44)
    read = step_diagonal_readings(field_of({}), ORIGIN, STEP, 200, noise_um=0.7, rng=rng)
    assert derive(read).result.figures["closure_rms_um"] == pytest.approx(0.7 * 2**0.5, rel=0.1)


def test_noise_of_positions_shows_in_neighbouring_closures():
    """Each stop of an axis has its own error that stays until the axis moves again."""
    rng = np.random.default_rng(45)
    n = 60
    read = {}
    for diagonal in WAYS:
        stops = rng.normal(size=(n + 1, 3))
        here = stops[0].copy()
        rows = []
        for step in range(1, n + 1):
            for axis in range(3):
                here[axis] = stops[step, axis]
                rows.append(here.sum() - stops[0].sum())
        read[diagonal] = np.reshape(rows, (n, 3))
    found = derive(read)
    assert found.result.figures["closure_neighbours_correlation"] == pytest.approx(-0.5, abs=0.15)
    assert any(note.startswith("Neighbouring closures correlate") for note in found.result.notes)
    white = step_diagonal_readings(field_of({}), ORIGIN, STEP, n, noise_um=1.0, rng=rng)
    found = derive(white)
    assert abs(found.result.figures["closure_neighbours_correlation"]) < 0.15
    assert not any(n.startswith("Neighbouring closures") for n in found.result.notes)


def test_closures_count_before_a_stated_repeatability_and_contradict_it():
    rng = np.random.default_rng(46)
    read = step_diagonal_readings(field_of({}), ORIGIN, STEP, 20, noise_um=1.0, rng=rng)
    found = derive(read, repeatability_um=0.1)
    assert found.noise.reading_um == pytest.approx(1.0, rel=0.3)
    assert any("exceeds the stated 0.1 µm" in note for note in found.result.notes)
    assert not any("exceeds" in note for note in derive(read, repeatability_um=1.1).result.notes)


def test_without_closures_the_stated_repeatability_counts():
    read = step_diagonal_readings(field_of({}), ORIGIN, STEP, 5, diagonals=THREE)
    found = derive(read, repeatability_um=0.3)
    assert (found.noise.reading_um, found.noise.degrees_of_freedom) == (0.3, np.inf)
    assert "degrees_of_freedom" not in found.result.figures
    silent = derive(read)
    assert all(table.covariance is None for table in silent.result.tables)
    assert any(note.startswith("No uncertainty:") for note in silent.result.notes)


@pytest.mark.parametrize("resolution", [None, 1.0])
@pytest.mark.parametrize("mirror", [None, 0.0, 20.0])
def test_closures_that_do_not_vary_leave_the_noise_unknown(resolution, mirror):
    """A simulation, or a display so coarse that nothing moves it: the noise is not 0."""
    field = field_of({"EXX": table_over_x(0.02)} if resolution is None else {})
    read = step_diagonal_readings(field, ORIGIN, STEP, N, resolution_um=resolution)
    silent = derive(read, mirror_angle_urad=mirror)
    assert silent.noise.reading_um is None
    assert all(table.covariance is None for table in silent.result.tables)
    said = " ".join(silent.result.notes)
    assert "The closures do not vary" in said
    assert "No uncertainty:" in said
    assert "reading_noise_um" not in silent.result.figures
    # A display of 1 µm: 1/√12.
    stated = derive(read, mirror_angle_urad=mirror, repeatability_um=0.29)
    assert (stated.noise.reading_um, stated.noise.degrees_of_freedom) == (0.29, np.inf)
    assert table_of(stated, "EXX").standard_errors[-1] > 0.29
    assert "The stated repeatability counts." in " ".join(stated.result.notes)


def table_over_x(slope):
    ends = nodes("x", N)[[0, -1]]
    return Table(ends, slope * (ends - ends[0]))


def test_one_step_has_closures_only_for_an_aligned_mirror():
    read = {d: [[0.1, 0.3, 0.2 if d == "ppp" else 0.1]] for d in WAYS}
    walk, _ = take_walk(ORIGIN, STEP, read, None)
    assert step_noise(walk, np.ones((3, 1)), None, None).reading_um is None
    aligned = step_noise(walk, np.ones((3, 1)), None, 0.0)
    # Three closures of variance 2σ² each.
    assert aligned.reading_um == pytest.approx(0.5**0.5)


def test_few_closures_have_no_neighbours():
    assert neighbours_correlation(np.ones((3, 3))) is None
    assert neighbours_correlation(np.zeros((3, 9))) is None
