"""Two measured ISO 230-2 tests of a drive, against the evaluation their author printed.

The author's reports and the table of deviations name the directions differently: what the
reports call forward is the table's backward, in both tests, reading by reading. The
drive's log decides for the table (the first target, −20 mm, is approached from −20.5 mm
and reads −20.0492 mm, which the report lists as backward). The reports' E and R are not the
standard's: E is that of one direction and R leaves the reversal out; every other figure
agrees.
"""

import csv
import re

import numpy as np
import pytest

from app.measurement.positioning import evaluate_positioning
from examples.measured.data_folder import data_folder

FOLDER = data_folder() / "ess-target-drive"

pytestmark = pytest.mark.skipif(
    not FOLDER.is_dir(), reason=f"no measured positioning of a drive at {FOLDER}"
)

TESTS = {"b02_x_target_x": "x", "week42_22_xyz_target_y_report_ILD50": "y"}
PRINTED_TO_UM = 0.02
"""The reports print mm with five decimals, cut off; A and R add several of them."""

IN_THE_REPORT = {"forward": "backward", "backward": "forward"}


def read_runs(test):
    """Targets, and deviations of each direction with one row for each cycle [µm]."""
    with (FOLDER / "iso230_2_deviations.csv").open(encoding="utf-8", newline="") as lines:
        rows = [row for row in csv.DictReader(lines) if row["test"] == test]
    targets = sorted({float(row["target_mm"]) for row in rows})
    runs = {}
    for way in ("forward", "backward"):
        own = [row for row in rows if row["direction"] == way]
        cycles = max(int(row["cycle"]) for row in own)
        runs[way] = np.full((cycles, len(targets)), np.nan)
        for row in own:
            place = int(row["cycle"]) - 1, int(row["position_index"]) - 1
            runs[way][place] = (float(row["measured_mm"]) - float(row["target_mm"])) * 1000.0
    return targets, runs


def report_of(test):
    return (FOLDER / "iso230_reports" / f"{test}.md").read_text(encoding="utf-8")


def printed(test, name):
    """One figure of the report [µm]."""
    return float(re.search(rf"^\**{name} = ([-\d.]+)", report_of(test), re.M)[1]) * 1000.0


def table_under(test, heading):
    """The rows of the report's table whose header has this column [mm]."""
    lines = report_of(test).splitlines()
    start = next(i for i, line in enumerate(lines) if heading in line and line.startswith("i |"))
    rows = []
    for line in lines[start + 2 :]:
        if not re.match(r"\d+\|", line):
            break
        rows.append([float(cell) for cell in line.strip("|").split("|")])
    return np.array(rows)


def evaluated(test):
    targets, runs = read_runs(test)
    return evaluate_positioning(TESTS[test], targets, runs["forward"], runs["backward"])


@pytest.mark.slow
@pytest.mark.parametrize("test", TESTS)
def test_the_reports_exchange_the_directions(test):
    _, runs = read_runs(test)
    for way, there in IN_THE_REPORT.items():
        section = report_of(test).split(f"### Data {there} direction")[1].split("### ")[0]
        rows = re.findall(r"^\d+\|([-\d.|]+)\|$", section, re.M)
        numbers = np.array([[float(cell) for cell in row.split("|")] for row in rows])
        deviations = (numbers[:, 1:] - numbers[:, :1]).T * 1000.0
        np.testing.assert_allclose(runs[way], deviations, atol=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("test", TESTS)
def test_each_position_is_as_the_report_has_it(test):
    found = evaluated(test)
    scatter = table_under(test, "S_fwd(i)") * 1000.0
    for way, column in (("backward", 1), ("forward", 2)):
        means = getattr(found, way)
        atol = PRINTED_TO_UM
        np.testing.assert_allclose(means.standard_deviation, scatter[:, column], atol=atol)
        np.testing.assert_allclose(means.repeatability, scatter[:, column + 2], atol=atol)
    np.testing.assert_allclose(
        found.bidirectional_repeatability_um, scatter[:, 5], atol=2 * PRINTED_TO_UM
    )
    both = table_under(test, "B(i)") * 1000.0
    np.testing.assert_allclose(found.mean_um, both[:, 1], atol=PRINTED_TO_UM)
    np.testing.assert_allclose(found.reversal_um, -both[:, 2], atol=PRINTED_TO_UM)


@pytest.mark.slow
@pytest.mark.parametrize("test", TESTS)
def test_the_axis_figures_are_the_reports(test):
    figures = evaluated(test).result.figures
    for way, there in (("forward", "bwd"), ("backward", "fwd")):
        for letter in "ERA":
            expected = printed(test, f"{letter}_{there}")
            assert figures[f"{letter}_{way}_um"] == pytest.approx(expected, abs=PRINTED_TO_UM)
    for name in "BMA":
        assert figures[f"{name}_um"] == pytest.approx(printed(test, name), abs=PRINTED_TO_UM)
    assert figures["B_mean_um"] == pytest.approx(-printed(test, "B_avg"), abs=PRINTED_TO_UM)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("test", "e", "r", "e_printed", "r_printed"),
    [
        ("b02_x_target_x", 122.85, 55.16, 90.65, 28.31),
        ("week42_22_xyz_target_y_report_ILD50", 26.48, 94.33, 15.14, 94.33),
    ],
)
def test_e_and_r_of_an_axis_are_the_standards_and_not_the_reports(test, e, r, e_printed, r_printed):
    """E over both directions together; R with the reversal."""
    figures = evaluated(test).result.figures
    assert figures["E_um"] == pytest.approx(e, abs=PRINTED_TO_UM)
    assert figures["R_um"] == pytest.approx(r, abs=2 * PRINTED_TO_UM)
    assert printed(test, "E") == printed(test, "E_fwd") == pytest.approx(e_printed)
    assert printed(test, "R") == pytest.approx(r_printed)
    assert printed(test, "R") == max(printed(test, "R_fwd"), printed(test, "R_bwd"))
    # The report's own table of positions has the standard's R.
    assert figures["R_um"] == pytest.approx(
        table_under(test, "S_fwd(i)")[:, 5].max() * 1000.0, abs=2 * PRINTED_TO_UM
    )


@pytest.mark.slow
def test_the_warm_up_is_noted_and_is_what_the_uncertainty_is_made_of():
    """Y drifts by 42 µm in five cycles; noise beside the cycles' shift and slope is 2 µm."""
    found = evaluated("week42_22_xyz_target_y_report_ILD50")
    figures = found.result.figures
    assert figures["drift_um"] == pytest.approx(-42.3, abs=0.1)
    assert figures["noise_um"] == pytest.approx(2.3, abs=0.1)
    assert figures["run_shift_um"] > 5 * figures["noise_um"]
    assert any("drift by -42" in note for note in found.result.notes)
    # Between two targets the shift cancels: known three times better than either of them.
    covariance = found.result.tables[0].covariance
    between = covariance[0, 0] + covariance[-1, -1] - 2 * covariance[0, -1]
    assert between < covariance[0, 0] / 10.0
