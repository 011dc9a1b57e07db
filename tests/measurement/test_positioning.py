"""Positioning by ISO 230-2: by hand, by its own symmetries, by Monte Carlo."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.stats import bartlett

from app.errors import InvalidContent
from app.measurement.positioning import evaluate_positioning
from app.measurement.run_means import mean_of_runs
from app.measurement.run_scatter import alike_by_chance
from tests.geometry.example_fields import random_field

TARGETS = [0.0, 90.0, 210.0]
FORWARD = [[-1.0, 3.0, 7.0], [0.0, 4.0, 9.0], [1.0, 5.0, 11.0]]
BACKWARD = [[-3.0, 1.0, 6.0], [-2.0, 3.0, 7.0], [-1.0, 5.0, 8.0]]

# docs/methods/positioning.md works this out by hand.
BY_HAND = {
    "E_forward_um": 9.0,
    "E_backward_um": 9.0,
    "E_um": 11.0,
    "M_um": 9.0,
    "B_um": 2.0,
    "B_mean_um": 5.0 / 3.0,
    "R_forward_um": 8.0,
    "R_backward_um": 8.0,
    "R_um": 8.0,
    "A_forward_um": 15.0,
    "A_backward_um": 13.0,
    "A_um": 17.0,
}


def by_hand(**options):
    return evaluate_positioning("y", TARGETS, FORWARD, BACKWARD, **options)


def test_the_worked_example_by_hand():
    found = by_hand()
    for name, value in BY_HAND.items():
        assert found.result.figures[name] == pytest.approx(value, abs=1e-12), name
    np.testing.assert_allclose(found.forward.standard_deviation, [1.0, 1.0, 2.0])
    np.testing.assert_allclose(found.backward.standard_deviation, [1.0, 2.0, 1.0])
    np.testing.assert_allclose(found.forward.repeatability, [4.0, 4.0, 8.0])
    np.testing.assert_allclose(found.reversal_um, [2.0, 1.0, 2.0])
    np.testing.assert_allclose(found.mean_um, [-1.0, 3.5, 8.0])
    np.testing.assert_allclose(found.bidirectional_repeatability_um, [6.0, 8.0, 8.0])


def test_the_component_keeps_both_directions():
    (table,) = by_hand().result.tables
    assert table.component.code == "EYY"
    assert table.positions_mm.tolist() == TARGETS
    np.testing.assert_allclose(table.errors, [0.0, 4.0, 9.0])
    np.testing.assert_allclose(table.backward_errors, [-2.0, 3.0, 7.0])
    assert table.covariance.shape == table.backward_covariance.shape == (3, 3)


def readings_of(low, high):
    numbers = st.integers(low, high).map(float)
    return st.tuples(st.integers(2, 5), st.integers(1, 6)).flatmap(
        lambda shape: st.tuples(
            arrays(np.float64, shape, elements=numbers), arrays(np.float64, shape, elements=numbers)
        )
    )


def evaluated(forward, backward):
    targets = 10.0 * np.arange(forward.shape[1]) ** 1.5
    return evaluate_positioning("x", targets, forward, backward)


INVARIANT = [name for name in BY_HAND if name != "B_mean_um"]


@given(readings_of(-300, 300), st.integers(-400, 400))
def test_a_datum_changes_no_figure(readings, datum):
    forward, backward = readings
    one, other = evaluated(forward, backward), evaluated(forward + datum, backward + datum)
    for name in BY_HAND:
        assert other.result.figures[name] == pytest.approx(one.result.figures[name], abs=1e-9)
    np.testing.assert_allclose(other.mean_um, one.mean_um + datum, atol=1e-9)


@given(readings_of(-300, 300))
def test_exchanging_the_directions_turns_the_sign_of_the_reversal_alone(readings):
    one, other = evaluated(*readings), evaluated(*readings[::-1])
    np.testing.assert_allclose(other.reversal_um, -one.reversal_um, atol=1e-12)
    for name in INVARIANT:
        exchanged = {"forward": "backward", "backward": "forward"}
        way = next((w for w in exchanged if w in name), None)
        there = name.replace(way, exchanged[way]) if way else name
        assert other.result.figures[there] == pytest.approx(one.result.figures[name], abs=1e-9)


@given(readings_of(-300, 300))
def test_turning_the_axis_round_is_the_same_machine(readings):
    """Seen from the other end, forward is backward, errors change sign, and B keeps it."""
    forward, backward = readings
    one, other = evaluated(forward, backward), evaluated(-backward, -forward)
    for name in ("E_um", "M_um", "B_um", "B_mean_um", "R_um", "A_um"):
        assert other.result.figures[name] == pytest.approx(one.result.figures[name], abs=1e-9)


@given(readings_of(-300, 300))
def test_the_figures_contain_each_other(readings):
    f = evaluated(*readings).result.figures
    rounding = 1e-9
    assert f["A_um"] >= max(f["A_forward_um"], f["A_backward_um"], f["E_um"], f["R_um"]) - rounding
    assert f["E_um"] >= max(f["E_forward_um"], f["E_backward_um"], f["M_um"], f["B_um"]) - rounding
    assert f["R_um"] >= max(f["R_forward_um"], f["R_backward_um"], f["B_um"]) - rounding
    assert f["E_um"] <= f["M_um"] + f["B_um"] + rounding
    assert abs(f["B_mean_um"]) <= f["B_um"] + rounding


@given(readings_of(-300, 300), st.randoms(use_true_random=False))
def test_the_order_of_the_runs_matters_to_the_drift_alone(readings, random):
    forward, backward = readings
    order = list(range(len(forward)))
    random.shuffle(order)
    one, other = evaluated(forward, backward), evaluated(forward[order], backward[order])
    for name in BY_HAND:
        assert other.result.figures[name] == pytest.approx(one.result.figures[name], abs=1e-9)


def test_each_target_is_evaluated_as_if_alone():
    rng = np.random.default_rng(230)
    forward, backward = rng.normal(scale=5.0, size=(2, 5, 7))
    found = evaluated(forward, backward)
    for i in range(7):
        alone = evaluate_positioning("x", [0.0], forward[:, [i]], backward[:, [i]])
        assert alone.reversal_um[0] == pytest.approx(found.reversal_um[i])
        assert alone.forward.repeatability[0] == pytest.approx(found.forward.repeatability[i])
        # One target's E is its reversal, and its A its repeatability.
        assert alone.result.figures["E_um"] == pytest.approx(abs(found.reversal_um[i]))
        assert alone.result.figures["R_um"] == pytest.approx(
            found.bidirectional_repeatability_um[i]
        )
        assert alone.result.figures["A_um"] == pytest.approx(alone.result.figures["R_um"])


def test_readings_of_a_known_machine_give_its_error_back():
    """The tool moves along z of a machine whose only errors are z's: its error is EZZ."""
    field = random_field("XYFZ", seed=2).only(lambda component: component.axis == "z")
    positions, values = field.tables["EZZ"]
    points = np.zeros((positions.size, 3))
    points[:, 2] = positions
    read = field.at(points)[0][:, 2]
    found = evaluate_positioning("z", positions, read, read - 3.0)
    (table,) = found.result.tables
    np.testing.assert_allclose(table.errors, values[0], atol=1e-12)
    assert found.result.figures["B_um"] == pytest.approx(3.0)
    assert table.covariance is None


def test_one_run_has_errors_but_no_repeatability():
    figures = evaluate_positioning("x", TARGETS, FORWARD[0], BACKWARD[0]).result.figures
    assert {"E_um", "M_um", "B_um"} <= set(figures)
    assert not any(name.startswith(("R", "A", "noise")) for name in figures)


def test_one_run_takes_the_stated_repeatability():
    found = evaluate_positioning("x", TARGETS, FORWARD[0], repeatability_um=0.5)
    (table,) = found.result.tables
    np.testing.assert_allclose(table.covariance, 0.25 * np.eye(3))


def test_one_direction_has_no_reversal():
    found = evaluate_positioning("x", TARGETS, FORWARD)
    assert found.reversal_um is None
    assert found.bidirectional_repeatability_um is None
    assert "B_um" not in found.result.figures
    assert "E_um" not in found.result.figures
    assert found.result.figures["A_forward_um"] == pytest.approx(15.0)
    assert found.result.tables[0].backward_errors is None
    assert any("one direction only" in note for note in found.result.notes)


SHIFT, NOISE, RUNS, POSITIONS = 2.0, 1.0, 5, 6
ALONG = np.array([0.0, 90.0, 210.0, 280.0, 430.0, 500.0])


def simulated_runs(rng, noise=NOISE, shift=SHIFT, slope=0.0):
    """A run's shift at 0, its slope [µm/mm] and noise."""
    common = rng.normal(scale=shift, size=(RUNS, 1)) + rng.normal(size=(RUNS, 1)) * slope * ALONG
    return common + noise * rng.normal(size=(RUNS, POSITIONS))


def averaged(readings):
    return mean_of_runs(ALONG, readings)


@pytest.mark.parametrize(("positions", "runs"), [(2, 3), (6, 4), (11, 5)])
def test_whether_positions_scatter_alike_is_bartletts_test(positions, runs):
    """Against SciPy's: alike, and one position of three times the others' standard deviation."""
    rng = np.random.default_rng(51)
    for spread in (1.0, np.where(np.arange(positions) == 1, 3.0, 1.0)):
        readings = spread * rng.normal(size=(runs, positions))
        found = alike_by_chance(readings.var(axis=0, ddof=1), runs - 1)
        assert found == pytest.approx(bartlett(*readings.T).pvalue, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(("shift", "slope"), [(0.0, 0.0), (0.5, 0.008)])
def test_the_stated_covariance_is_the_scatter_of_the_means(shift, slope):
    """3000 measurements: 3 % on a variance. A slope makes the far end scatter more than the near.

    The truth is (shift² + slope² x_i x_j + noise² on the diagonal)/n.
    """
    rng = np.random.default_rng(1)
    found = [averaged(simulated_runs(rng, shift=shift, slope=slope)) for _ in range(1000)]
    empirical = np.cov(np.array([f.mean for f in found]).T)
    stated = np.mean([f.covariance for f in found], axis=0)
    common = shift**2 + slope**2 * np.outer(ALONG, ALONG)
    truth = (common + NOISE**2 * np.eye(POSITIONS)) / RUNS
    np.testing.assert_allclose(stated, truth, atol=0.05 * truth.max())
    np.testing.assert_allclose(empirical, truth, atol=0.12 * truth.max())
    # What two targets of one run have in common cancels in their difference.
    between = np.array([1.0, 0.0, 0.0, 0.0, 0.0, -1.0])
    ratio = (between @ empirical @ between) / (between @ stated @ between)
    assert ratio == pytest.approx(1.0, abs=0.12)


@pytest.mark.slow
def test_where_positions_differ_each_has_its_own_standard_error():
    """Noise from 0.3 to 8 µm: the stated standard errors follow it, position by position."""
    rng = np.random.default_rng(2)
    noise = np.array([0.3, 0.5, 1.0, 2.0, 4.0, 8.0])
    found = [averaged(simulated_runs(rng, noise, shift=0.0)) for _ in range(600)]
    empirical = np.std([f.mean for f in found], axis=0, ddof=1)
    stated = np.sqrt(np.mean([np.diagonal(f.covariance) for f in found], axis=0))
    np.testing.assert_allclose(stated / empirical, 1.0, atol=0.12)


@pytest.mark.slow
def test_equal_positions_are_pooled_and_pooling_is_the_more_certain():
    """s of five readings varies by 35 %; beside a line of each run that of thirty by half."""
    rng = np.random.default_rng(3)
    found = [averaged(simulated_runs(rng, shift=0.0)) for _ in range(400)]
    own = [f.standard_deviation[0] for f in found]
    assert np.std(own) / np.mean(own) == pytest.approx(0.36, abs=0.04)
    for i in (0, 2):
        pooled = [math.sqrt(f.covariance[i, i] * RUNS) for f in found]
        assert np.std(pooled) / np.mean(pooled) < 0.23


@pytest.mark.slow
def test_shift_and_slope_of_the_runs_are_told_from_their_noise():
    """500 tests of five runs: the squares' mean is known to 5 to 10 %."""
    rng = np.random.default_rng(7)
    found = [averaged(simulated_runs(rng, shift=0.5, slope=0.008)).scatter for _ in range(500)]
    squares = np.mean(np.square([(f.shift, f.slope_per_m, f.noise) for f in found]), axis=0)
    # The shift is that at the mean position.
    assert squares[0] == pytest.approx(0.25 + (0.008 * ALONG.mean()) ** 2, rel=0.2)
    assert squares[1] == pytest.approx(8.0**2, rel=0.2)
    assert squares[2] == pytest.approx(1.0, rel=0.05)
    # 4 runs beyond their mean, 4 positions beyond a line.
    assert {f.degrees_of_freedom for f in found} == {16}


def test_two_positions_have_no_slope_and_one_has_no_shift():
    rng = np.random.default_rng(8)
    for m, shift in ((1, 0.0), (2, 2.0)):
        runs = 5.0 * rng.normal(size=(400, 1)) + rng.normal(size=(400, m))
        scatter = mean_of_runs(ALONG[:m], runs).scatter
        assert math.isnan(scatter.slope_per_m)
        assert scatter.noise == pytest.approx(1.0 if shift else math.sqrt(26.0), rel=0.1)
        assert scatter.shift == pytest.approx(5.0 if shift else 0.0, rel=0.1)


@pytest.mark.slow
def test_the_standard_error_of_the_mean_reversal_is_its_scatter():
    """Both directions of a run share its shift: paired by run, it cancels."""
    rng = np.random.default_rng(4)
    means, stated = [], []
    for _ in range(500):
        shift = rng.normal(scale=5.0, size=(RUNS, 1))
        forward, backward = shift + rng.normal(size=(2, RUNS, POSITIONS))
        figures = evaluated(forward, backward).result.figures
        means.append(figures["B_mean_um"])
        stated.append(figures["B_mean_standard_error_um"] ** 2)
    assert np.sqrt(np.mean(stated)) == pytest.approx(np.std(means), rel=0.12)
    assert np.std(means) == pytest.approx(np.sqrt(2 / (RUNS * POSITIONS)), rel=0.12)


@pytest.mark.slow
def test_covariances_are_positive_definite_whatever_the_readings():
    rng = np.random.default_rng(5)
    for _ in range(200):
        runs = np.round(simulated_runs(rng, shift=rng.choice([0.0, 3.0])), 1)
        assert np.linalg.eigvalsh(averaged(runs).covariance).min() > 0


def test_readings_that_never_vary_leave_the_noise_unknown_and_no_warning():
    """A coarse scale: filterwarnings makes a logarithm of zero an error."""
    runs = [[1.0, 2.0, 3.0]] * 5
    found = evaluate_positioning("x", TARGETS, runs, runs)
    assert found.result.figures["R_um"] == 0.0
    assert found.result.tables[0].covariance is None
    assert any("do not differ" in note for note in found.result.notes)
    stated = evaluate_positioning("x", TARGETS, runs, runs, repeatability_um=0.5)
    np.testing.assert_allclose(stated.result.tables[0].covariance, 0.05 * np.eye(3))


def test_a_warm_up_is_noted_and_scatter_is_not():
    rng = np.random.default_rng(6)
    noise = rng.normal(scale=0.3, size=(2, RUNS, 3))
    drift = 4.0 * np.arange(RUNS)[:, None]
    warming = evaluate_positioning("x", TARGETS, noise[0] + drift, noise[1] + drift)
    assert warming.result.figures["drift_um"] == pytest.approx(16.0, abs=0.6)
    assert any("drift by 1" in note for note in warming.result.notes)
    steady = evaluate_positioning("x", TARGETS, *noise)
    assert not any("drift" in note for note in steady.result.notes)


def test_what_the_standard_asks_for_is_noted():
    assert any("5 runs in each direction, got 3" in note for note in by_hand().result.notes)
    assert any("at least 5 targets here, got 3" in note for note in by_hand().result.notes)
    long = evaluate_positioning("x", [0.0, 700.0, 1000.0, 1200.0, 1500.0, 1600.0], np.zeros(6))
    assert any("at least 8 targets here, got 6" in note for note in long.result.notes)
    even = evaluate_positioning("x", [0.0, 50.0, 100.0], np.zeros(3))
    assert any("period divides 50 mm" in note for note in even.result.notes)
    assert not any("period" in note for note in by_hand().result.notes)


def test_readings_that_may_be_millimetres_are_noted():
    small = evaluate_positioning("x", TARGETS, np.array(FORWARD) / 1000.0)
    assert any("if the readings are in mm" in note for note in small.result.notes)
    assert not any("in mm, they" in note for note in by_hand().result.notes)


@pytest.mark.parametrize(
    ("change", "field", "message"),
    [
        ({"axis": "b"}, "axis", "expected axis x, y or z, got 'b'"),
        ({"axis": ""}, "axis", "expected axis x, y or z, got ''"),
        ({"targets_mm": []}, "targets_mm", "expected a list of positions in mm"),
        ({"targets_mm": [0, 90, 90]}, "targets_mm", "got 90 then 90 mm"),
        ({"targets_mm": [210, 90, 0]}, "targets_mm", "strictly increasing positions in mm"),
        ({"targets_mm": [0, 90000, 210000]}, "targets_mm", "perhaps in µm"),
        ({"targets_mm": [0, math.nan, 210]}, "targets_mm", r"got nan mm at index \[1\]$"),
        ({"forward_um": [[1.0, 2.0]]}, "forward_um", r"runs of 3 readings in µm.*\(1, 2\)"),
        ({"forward_um": [[1.0, 2.0, 3.0], [1.0]]}, "forward_um", "rows of equal length"),
        ({"forward_um": []}, "forward_um", "runs of 3 readings"),
        ({"forward_um": [[1.0, "a", 3.0]]}, "forward_um", "expected numbers in µm"),
        ({"backward_um": [[1.0, math.inf, 3.0]]}, "backward_um", r"got inf µm at index \[0, 1\]$"),
        ({"forward_um": [[0.0, 90002.0, 0.0]]}, "forward_um", "within ±10000 µm.*perhaps in nm"),
        ({"forward_um": [[0.001, 90.004, 210.009]]}, "forward_um", "measured positions in mm"),
        (
            {"forward_um": [[3.0, 90002.0 / 10, 9999.0]], "targets_mm": [0.0, 9.0, 10.0]},
            "forward_um",
            "a slope of 1 mm/mm over them",
        ),
        (
            {"forward_um": [[0.0] * 3, [1.0, -1999.0, -4001.0]], "targets_mm": [0, 2, 4]},
            "forward_um",
            "a slope of -1 mm/mm over them",
        ),
        ({"repeatability_um": -1.0}, "repeatability_um", "from 0 to 10000 µm, got -1 µm"),
    ],
)
def test_bad_input_is_refused_by_the_field_that_is_to_blame(change, field, message):
    arguments = {"axis": "y", "targets_mm": TARGETS, "forward_um": FORWARD} | change
    with pytest.raises(InvalidContent, match=message) as refused:
        evaluate_positioning(**arguments)
    assert refused.value.errors[0].field == field


@pytest.mark.parametrize(
    ("targets_mm", "errors_um"),
    [
        ([0.0, 250.0, 500.0, 1000.0], [0.1, 250.2, 499.9, 1000.3]),  # a scale error of 1 mm/m
        ([0.0, 250.0, 500.0], [0.0, -2500.0, -5000.0]),  # the largest that there is
        ([0.0, 0.01, 0.02], [0.0, -10.0, -20.0]),  # it stands still within its backlash
        ([0.0, 5.0, 10.0, 15.0], [0.0, 9000.0, -9000.0, 0.0]),
    ],
)
def test_large_errors_that_a_machine_can_have_are_evaluated(targets_mm, errors_um):
    found = evaluate_positioning("x", targets_mm, errors_um)
    assert found.mean_um.tolist() == errors_um
