"""The empty files: refused as they are, and read back by the importers when they are filled in.

Their values are simulated; the methods then find what was put in.
"""

import csv
import io

import numpy as np
import pytest

from app.api.methods.registry import METHODS
from app.api.methods.thermal_drift import ThermalDriftRequest
from app.files.csv_comments import Header
from app.files.csv_verification import read_csv_verification
from app.files.delimited_text import UnreadableFile
from app.geometry.body_diagonal import DIAGONALS
from app.geometry.chain import Chain
from app.geometry.error_field import ErrorField
from app.geometry.error_table import Table
from app.geometry.work_volume import WorkVolume
from app.measurement.body_diagonal import body_diagonal
from app.measurement.positioning import evaluate_positioning
from app.measurement.step_diagonal import step_diagonal
from app.measurement.step_diagonal_readings import step_diagonal_readings
from app.programs.path import Manner
from app.programs.warm_up import SpindleStep, warm_up_program
from app.services.observations import VerificationRequest
from tests.geometry.example_fields import diagonal_displacements
from tests.programs.example_programs import MACHINE, PLANNED, START_S, every_program

PROGRAMS = every_program()

STATED = Header("Run #1", "2026-03-01T06:00:00Z", {"x-middle": 20.0, "z-column": 21.0})

FIELD = ErrorField.make(
    Chain.parse("XYFZ"),
    {"EXX": Table((0.0, 500.0), (0.0, 10.0)), "SXY": Table((), 20.0)},
)


def filled(content, value_of):
    """Fill in the empty cells whose column `value_of` knows: (row, column) to a value or None."""
    lines = content.splitlines()
    start = next(i for i, line in enumerate(lines) if not line.startswith("#"))
    rows = list(csv.DictReader(lines[start:]))
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    for row in rows:
        for column, cell in row.items():
            value = value_of(row, column)
            if not cell and value is not None:
                row[column] = repr(float(value))
        writer.writerow(row)
    return "\n".join(lines[:start]) + "\n" + text.getvalue()


def read_map(name, method, value_of):
    content = filled(PROGRAMS[name].readings.content, value_of)
    return METHODS[method].read(content, header=STATED, complete=True)


@pytest.mark.parametrize(
    ("name", "method"),
    [("POSX", "positioning"), ("STEPDIA", "step-diagonal"), ("BODYDIA", "body-diagonal")],
)
def test_an_empty_file_is_refused(name, method):
    content = PROGRAMS[name].readings.content
    with pytest.raises(UnreadableFile) as refusal:
        METHODS[method].read(content, header=STATED, complete=True)
    assert "got none" in refusal.value.detail
    full = filled(content, lambda row, column: 0.0 if column.endswith("_um") else None)
    with pytest.raises(UnreadableFile) as refusal:
        METHODS[method].read(full, complete=True)
    for lacking in ("a label", "a time with its zone", "the temperature of x-middle"):
        assert f"expected {lacking}" in refusal.value.detail
    # Half of the temperatures are not enough, and what is only looked at needs none.
    half = Header(STATED.label, STATED.measured_at, {"x-middle": 20.0})
    with pytest.raises(UnreadableFile, match="temperature of z-column in °C, got none"):
        METHODS[method].read(full, header=half, complete=True)
    assert METHODS[method].read(full).machine == "mcfv5050"


def test_positioning_is_found_again():
    """Of an axis with 20 µm/m and 3 µm of reversal."""
    sign = {"+": 1.5, "-": -1.5}
    read = read_map(
        "POSX", "positioning",
        lambda row, column: 0.02 * float(row["target_mm"]) + sign[row["direction"]]
        if column == "deviation_um" else None,
    )  # fmt: skip
    body = read.body
    found = evaluate_positioning(
        body["axis"], body["targets_mm"], body["forward_um"], body["backward_um"]
    )
    assert len(body["forward_um"]) == len(body["backward_um"]) == 2
    assert found.reversal_um == pytest.approx(3.0)
    assert np.diff(found.mean_um) == pytest.approx(0.02 * np.diff(found.targets_mm))
    assert not any("evenly spaced" in note for note in found.result.notes)


def test_step_diagonals_are_found_again():
    blank = read_map("STEPDIA", "step-diagonal", lambda row, c: 0.0 if "after" in c else None).body
    read = step_diagonal_readings(FIELD, blank["origin_mm"], blank["step_mm"], 4)
    columns = ["after_x_um", "after_y_um", "after_z_um"]
    body = read_map(
        "STEPDIA", "step-diagonal",
        lambda row, c: read[row["diagonal"]][int(row["step"]) - 1][columns.index(c)]
        if c in columns else None,
    ).body  # fmt: skip
    found = step_diagonal(
        MACHINE.chain, body["origin_mm"], body["step_mm"], body["diagonals"],
        travel_mm={a: (t.min_mm, t.max_mm) for a, t in MACHINE.axes.items()},
    )  # fmt: skip
    tables = {t.component.code: t for t in found.result.tables}
    span = 4 * body["step_mm"][0]
    assert tables["EXX"].errors[-1] - tables["EXX"].errors[0] == pytest.approx(0.02 * span)
    assert tables["SXY"].errors == pytest.approx([20.0], abs=1e-3)


def test_body_diagonals_are_found_again():
    blank = read_map("BODYDIA", "body-diagonal", lambda row, c: 0.0 if c.endswith("um") else None)
    ranges = blank.body["volume"]
    box = WorkVolume(*((ranges[a]["min_mm"], ranges[a]["max_mm"]) for a in "xyz"))
    read = diagonal_displacements(FIELD, box, steps=4)
    part = box.diagonal_mm / 4
    body = read_map(
        "BODYDIA", "body-diagonal",
        lambda row, c: read[row["diagonal"]][round(float(row["position_mm"]) / part)]
        if c.endswith("um") else None,
    ).body  # fmt: skip
    assert list(body["diagonals"]) == list(DIAGONALS)
    found = body_diagonal(body["diagonals"], volume=box)
    assert found.result.tables[0].errors == pytest.approx([20.0], abs=1e-2)
    assert found.reversal_um == pytest.approx(dict.fromkeys(DIAGONALS, 0.0))


def read_back(tmp_path, name, value_of):
    path = tmp_path / f"{name}.csv"
    path.write_text(filled(PROGRAMS[name].readings.content, value_of), encoding="utf-8")
    read = read_csv_verification(path)
    return read, VerificationRequest.model_validate(read.body).to_verification()


def test_a_visit_is_the_planned_verification_again(tmp_path):
    def value(row, column):
        if not row["component"]:
            return 1.5 if column in ("measured_x_um", "measured_y_um", "measured_z_um") else None
        is_angle = row["component"] in ("EBX", "SXY", "EYY^x")
        return 1.5 if column == ("measured_urad" if is_angle else "measured_um") else None

    _, found = read_back(tmp_path, "VISIT", value)
    assert (found.label, found.datum, found.repeatability_um) == ("Monday", PLANNED.datum, 0.5)
    for one, planned in zip(found.observations, PLANNED.observations, strict=True):
        for field in ("time_s", "component", "position_mm", "point_mm", "tool_offset_mm", "setup"):
            assert getattr(one, field) == getattr(planned, field)
        assert (one.directions, one.state) == (planned.directions, planned.state)
        assert set(one.measured) == {1.5}


def test_a_warm_up_at_several_places_is_a_verification_at_points(tmp_path):
    read, found = read_back(
        tmp_path, "WARMUP", lambda row, c: 2.5 if c.startswith("measured") else None
    )
    assert len(found.observations) == 44
    assert found.datum == "first"
    assert found.observations[0].point_mm == (250.0, 0.0, -200.0)
    assert found.observations[1].point_mm == (100.0, 50.0, -150.0)
    assert [one.state["spindle_rpm"] for one in found.observations] == [0] * 2 + [4000] * 6 + [
        0
    ] * 36
    assert any("after_min" in remark for remark in read.remarks)


@pytest.mark.parametrize("distance_mm", [None, 100.0])
def test_a_warm_up_at_one_place_is_a_drift_test(distance_mm):
    """Z grows by 10 µm an hour of turning, and the second X reads 2 µm more then."""
    program = warm_up_program(
        MACHINE, Manner(), [SpindleStep(6000.0, 60.0), SpindleStep(0.0, 30.0)], [(250, 0, -200)],
        every_min=30.0, sensor_distance_mm=distance_mm, start_s=START_S,
    )  # fmt: skip
    content = program.readings.content
    assert "thermap import --method thermal-drift FILE" in program.readings.command
    with pytest.raises(UnreadableFile, match="got none"):
        METHODS["thermal-drift"].read(content, header=Header("warm"), complete=True)

    def value(row, column):
        if column.startswith("temperature"):
            return 20.0
        grown = min(float(row["after_min"]) / 60.0, 1.0)
        slopes = {"x_um": 0.0, "y_um": 0.0, "z_um": 10.0, "x2_um": 2.0, "y2_um": 0.0}
        return slopes[column] * grown if column in slopes else None

    stated = Header("warm")
    read = METHODS["thermal-drift"].read(filled(content, value), header=stated)
    drift = ThermalDriftRequest.model_validate(read.body)
    assert [one.state["spindle_rpm"] for one in drift.readings] == [0, 6000, 6000, 0]
    assert drift.readings[2].z_um == pytest.approx(10.0)
    # It turns from the cold reading on, until the last pause at a speed is over.
    assert drift.running_from == drift.readings[0].time
    assert drift.readings[1].time < drift.running_to < drift.readings[2].time
    without_start = content.replace("# running_from: 2026", "# running_from: ")
    with pytest.raises(UnreadableFile, match="expected a time with its zone"):
        METHODS["thermal-drift"].read(without_start, header=stated)
    assert (drift.sensor_distance_mm, drift.readings[2].x2_um) == (
        (distance_mm, pytest.approx(2.0)) if distance_mm else (None, None)
    )


@pytest.mark.parametrize("steps", [[(3000, 10)], [(3000, 10), (0, 10)], [(0, 5), (9, 5), (7, 5)]])
def test_in_place_it_runs_until_it_is_stopped_after_its_last_reading(steps):
    program = warm_up_program(
        MACHINE, Manner(), [SpindleStep(*one) for one in steps], [(250, 0, -200)], every_min=5.0,
        in_place=True, start_s=START_S,
    )  # fmt: skip
    content = filled(program.readings.content, lambda *_: 0.0)
    drift = ThermalDriftRequest.model_validate(
        METHODS["thermal-drift"].read(content, header=Header("warm")).body
    )
    turning = [one.time for one in drift.readings if one.state["spindle_rpm"]]
    assert drift.running_to == turning[-1]
    assert drift.running_from < turning[0]


def test_a_moving_axis_is_a_verification_of_its_displacement(tmp_path):
    read, found = read_back(tmp_path, "MOVEY", lambda row, c: 2.5 if c == "measured_um" else None)
    assert len(found.observations) == 6 * 6
    assert found.datum == "first"
    first, last = found.observations[0], found.observations[-1]
    assert (first.component, first.position_mm, first.directions[1]) == ("EYY", -195.0, 1)
    assert (last.position_mm, last.directions[1]) == (-195.0, -1)
    feeds = [one.state["feed_mm_per_min"] for one in found.observations]
    assert feeds == [0] * 6 + [15_000] * 18 + [0] * 12
    assert any("after_min" in remark for remark in read.remarks)


@pytest.mark.parametrize("name", ["VISIT", "WARMUP", "MOVEY"])
def test_an_empty_verification_is_refused(name, tmp_path):
    path = tmp_path / "empty.csv"
    path.write_text(PROGRAMS[name].readings.content, encoding="utf-8")
    with pytest.raises(UnreadableFile, match="got none"):
        read_csv_verification(path)
