"""Measurements from CSV: the files on the page, what is taken, and where what is wrong is."""

import csv
import json
import math
import re
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

from app.api.methods.registry import METHODS
from app.files.csv_columns import ANGLE, LENGTH, POSITION, SMALL_ANGLE
from app.files.delimited_text import UnreadableFile
from app.geometry.chain import Chain
from app.geometry.work_volume import WorkVolume
from app.measurement.body_diagonal import body_diagonal
from app.measurement.drilled_plate import evaluate_drilled_plate
from app.measurement.machined_part import evaluate_machined_part
from app.measurement.positioning import evaluate_positioning
from app.measurement.rotary_axis import measure_rotary_axis
from app.measurement.six_dof import evaluate_six_dof
from app.measurement.step_diagonal import step_diagonal
from app.measurement.thermal_drift import evaluate_thermal_drift
from examples.measured.data_folder import data_folder

PAGE = Path(__file__).parents[2] / "docs" / "methods" / "files.md"
BODIES = json.loads(Path(__file__).with_name("measurement_bodies.json").read_text("utf-8"))

STATE = """\
# label: Run #1
# measured_at: 2026-03-01T06:00:00Z
# temperature x-middle: 20.1
"""


def read_measurement(method, text, **options):
    """Give the body alone."""
    return METHODS[method].read(text, **options).body


def examples():
    """Find the file of each section of the page, and the body that it is to give."""
    sections = PAGE.read_text(encoding="utf-8").split("\n## ")[1:]
    for section in sections:
        (table,) = re.findall(r"```csv\n(.*?)```", section, re.S)
        method = section.splitlines()[0]
        yield method, table, BODIES[method]


EXAMPLES = {method: (table, body) for method, table, body in examples()}


def complaints(method, text, **options):
    """Read a text that is refused; give what is said of it."""
    with pytest.raises(UnreadableFile) as caught:
        read_measurement(method, text, name="run.csv", **options)
    return caught.value.detail.splitlines()


def test_the_page_has_a_file_of_every_method():
    assert EXAMPLES.keys() == METHODS.keys()


@pytest.mark.parametrize("method", METHODS)
def test_the_files_on_the_page_have_their_bodies(method):
    table, body = EXAMPLES[method]
    found = METHODS[method].read(table)
    assert found.body == body
    assert (found.machine, found.remarks) == (None, [])
    assert json.loads(json.dumps(found.body)) == body


@pytest.mark.parametrize("method", METHODS)
def test_the_service_knows_every_field_of_a_body(method):
    table, body = EXAMPLES[method]
    state = STATE + "# instrument: laser\n# repeatability_um: 0.5\n"
    found = read_measurement(method, state + table, complete=True)
    request = METHODS[method].request.model_validate(found)
    sent = request.model_dump(exclude_unset=True, mode="json")
    assert {name: sent[name] for name in body} == body
    assert sent.keys() == found.keys()


@pytest.mark.parametrize("method", METHODS)
def test_the_service_knows_every_comment_line_that_a_method_reads(method):
    known = {one.thing.full for one in METHODS[method].file.statements}
    fields = METHODS[method].request.model_fields.keys() | {f"volume_{axis}_mm" for axis in "xyz"}
    assert known <= fields


def evaluated(method, body):
    """Hand a body to its method, as the arguments of the same names."""
    if method == "step-diagonal":
        return step_diagonal(Chain.parse("XYFZ"), **body)
    if method == "body-diagonal":
        sides = [tuple(body["volume"][axis].values()) for axis in "xyz"]
        return body_diagonal(body["diagonals"], volume=WorkVolume(*sides))
    if method == "rotary-axis":
        points = body["points"]
        columns = ([p[key] for p in points] for key in ("angle_deg", "position_mm"))
        return measure_rotary_axis(body["axis"], *columns)
    if method == "drilled-plate":
        columns = ([h[key] for h in body["holes"]] for key in ("nominal_mm", "measured_mm"))
        return evaluate_drilled_plate(*columns)
    if method == "thermal-drift":
        columns = {f: [r[f"{f}_um"] for r in body["readings"]] for f in ("x", "x2", "z")}
        times = [datetime.fromisoformat(r["time"]).timestamp() for r in body["readings"]]
        named = {k: body[k] for k in ("sensor_distance_mm", "point_mm", "components")}
        return evaluate_thermal_drift(Chain.parse("XYFZ"), body["test"], times, columns, **named)
    evaluate = {
        "positioning": evaluate_positioning,
        "six-dof": evaluate_six_dof,
        "machined-part": evaluate_machined_part,
    }[method]
    return evaluate(**body)


@pytest.mark.parametrize("method", METHODS)
def test_each_method_takes_what_its_file_says(method):
    found = evaluated(method, read_measurement(method, EXAMPLES[method][0]))
    assert getattr(found, "result", found).tables


def test_the_pages_complaint_is_the_real_one():
    (shown,) = re.findall(r"^ +(feed\.csv, .*)$", PAGE.read_text(encoding="utf-8"), re.M)
    text = "# axis: x\nposition_mm,linear [mm]\n0,0\n50,0.001\n100,abc\n"
    with pytest.raises(UnreadableFile) as caught:
        read_measurement("six-dof", text, name="feed.csv")
    assert caught.value.detail == shown


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("ends", ["\n", "\r\n"])
def test_as_spreadsheets_write_it(method, ends):
    """Semicolons, decimal commas, a byte order mark, and every line filled up with cells."""
    table, body = EXAMPLES[method]
    lines = []
    for line in table.splitlines():
        if line.startswith("#"):
            lines.append(f'"{line}";;')
        elif ";" in line:
            lines.append(f"{line};;")
        else:
            lines.append(line.replace(",", ";").replace(".", ",") + ";;")
    text = "\ufeff" + ends.join([*lines, ";;;", ""])
    assert read_measurement(method, text) == body


def test_the_thermal_state_is_in_the_body():
    table, body = EXAMPLES["machined-part"]
    extra = "# machine: mcfv5050\n# instrument: CMM\n# repeatability [mm]: 0,0003\n"
    found = METHODS["machined-part"].read(STATE + extra + table, complete=True)
    assert found.body == body | {
        "label": "Run #1",
        "measured_at": "2026-03-01T06:00:00Z",
        "temperatures_c": {"x-middle": 20.1},
        "instrument": "CMM",
        "repeatability_um": 0.3,
    }
    assert found.machine == "mcfv5050"


def test_a_state_is_needed_only_where_it_is_to_be_stored():
    table, body = EXAMPLES["machined-part"]
    assert read_measurement("machined-part", table) == body
    only_label = read_measurement("machined-part", "# label: Run #1\n" + table)
    assert only_label == body | {"label": "Run #1"}
    found = complaints("machined-part", "# label: Run #1\n" + table, complete=True)
    assert [line.split(", got")[0] for line in found] == [
        "run.csv: expected a time with its zone",
        "run.csv: expected every sensor's temperature in °C",
    ]
    (zone,) = complaints("machined-part", "# measured_at: 2026-03-01T06:00:00\n" + table)
    assert "expected measured_at with its zone" in zone


def test_what_is_not_read_is_said():
    text = (
        "# axis: x\n# operator: me\nposition_mm,linear_um,linear_error_of_x_um,EYY_um,by\n0,1,,2,me"
    )
    found = METHODS["six-dof"].read(text)
    assert found.body == {"axis": "x", "positions_mm": [0.0], "linear_um": [1.0]}
    unread, columns = found.remarks
    assert unread.startswith("line 2: 'operator' is not read; what is: label, measured_at,")
    assert "of this method: axis, measuring_line_mm, tool_offset_mm, straightness_line" in unread
    assert columns == "columns that are not read: linear_error_of_x_um, EYY_um, by"


@pytest.mark.parametrize(
    ("heading", "written", "value"),
    [
        ("linear_um", "1.2", 1.2),
        ("linear [mm]", "0.0012", 1.2),
        ("linear (mm)", "0.0001", 0.1),
        ("Linear [µm]", "\N{MINUS SIGN}3.5", -3.5),
        ("linear [\N{GREEK SMALL LETTER MU}m]", "7", 7.0),
        ("linear_m", "0.0000123", 12.3),
        ("EXX [mm]", "0.1234567", 123.4567),
        ("exx_micron", "1e-1", 0.1),
    ],
)
def test_lengths_are_converted_exactly(heading, written, value):
    text = f"# axis: x\nposition [m],{heading}\n0.1,{written}\n"
    found = read_measurement("six-dof", text)
    assert found["linear_um"] == [value]
    assert found["positions_mm"] == [100.0]


@pytest.mark.parametrize(
    ("unit", "urad"),
    [
        ("urad", 1.0),
        ("µm/m", 1.0),
        ("mrad", 1000.0),
        ("rad", 1e6),
        ("arcsec", math.pi / 648_000 * 1e6),
        ("″", math.pi / 648_000 * 1e6),
        ("arcmin", math.pi / 10_800 * 1e6),
        ("°", math.pi / 180 * 1e6),
    ],
)
def test_small_angles(unit, urad):
    text = f"# axis: x\nposition_mm,EBX [{unit}],backward_angular_b [{unit}]\n0,2,-3\n"
    found = read_measurement("six-dof", text)
    assert found["angular_urad"]["b"] == pytest.approx([2.0 * urad], rel=1e-15)
    assert found["backward_angular_urad"]["b"] == pytest.approx([-3.0 * urad], rel=1e-15)


def test_the_tables_of_units_agree_with_each_other():
    assert LENGTH.convert(1.0, "m") == 1e6
    assert POSITION.convert(1.0, "um") == 1e-3
    assert ANGLE.convert(math.pi, "rad") == pytest.approx(180.0, rel=1e-15)
    assert SMALL_ANGLE.convert(1.0, "deg") == pytest.approx(3600 * SMALL_ANGLE.convert(1, "arcsec"))


@pytest.mark.parametrize(
    ("method", "headings", "complaint"),
    [
        ("six-dof", "position_mm,linear [furlong]",
         "column 2 (linear [furlong]): expected the unit of linear in the name, such as linear_um "
         "(um, micron, nm, mm, m, in, inch, mil, thou, uin), got the unit 'furlong'"),
        ("six-dof", "position_mm,linear", "column 2 (linear): expected the unit of linear in the "
         "name, such as linear_um (um, micron, nm, mm, m, in, inch, mil, thou, uin), got no unit"),
        ("six-dof", "position,linear_um", "column 1 (position): expected the unit of position in "
         "the name, such as position_mm (mm, um, m, in, inch), got no unit"),
        ("six-dof", "position_mm,linear_um,linear_mm",
         "expected linear in one column, got linear_um and linear_mm"),
        ("six-dof", "position_mm,by", "expected columns of the axis x among linear_um, "
         "straightness_y_um, straightness_z_um, angular_a_urad"),
        ("rotary-axis", "angle_deg,x_mm,y_mm", "expected the columns angle_deg, x_mm, y_mm, z_mm, "
         "without z_mm got angle_deg, x_mm, y_mm"),
        ("rotary-axis", "angle_mm,x_mm,y_mm,z_mm", "column 1 (angle_mm): expected the unit of "
         "angle in the name, such as angle_deg (deg, rad), got the unit 'mm'"),
        ("drilled-plate", "nom_x,nom_y,meas_x,meas_y", "column 4 (meas_y): expected the unit of "
         "measured_y in the name, such as measured_y_mm (mm, um, m, in, inch), got no unit"),
        ("positioning", "target_mm,run", "expected the columns target_mm, error_um (and may be "
         "run, direction), without error_um got target_mm, run"),
        ("step-diagonal", "diagonal,after_x_um,after_y_um", "without after_z_um got"),
    ],
)  # fmt: skip
def test_columns_that_are_wrong(method, headings, complaint):
    heads = {
        "rotary-axis": "# axis: A",
        "machined-part": "# component: EXY",
        "step-diagonal": "# origin_mm: 0 0 0\n# step_mm: 1 1 1",
    }
    head = heads.get(method, "# axis: x")
    row = ",".join("1" for _ in headings.split(","))
    found = complaints(method, f"{head}\n{headings}\n{row}\n")
    assert any(complaint in line for line in found), found
    assert all(re.match(r"run\.csv, line [23]\b", line) for line in found), found


@pytest.mark.parametrize(
    ("method", "row", "complaint"),
    [
        ("step-diagonal", "ppp,3,1,x,2",
         "column 4 (after_y_um): expected a number in µm, got 'x'"),
        ("step-diagonal", "ppp,3,1,,2", "column 4 (after_y_um): expected after_y in µm, got none"),
        ("step-diagonal", "qqq,3,1,1,2",
         "column 1 (diagonal): expected a diagonal among ppp, npp, pnp, ppn, got 'qqq'"),
        ("step-diagonal", "ppp,4,1,1,2", "column 2 (step): expected step 3 of ppp next, got 4"),
        ("body-diagonal", "ppp;140;1;",
         "column 4 (backward [µm]): expected backward of run 1 at 140 mm, got none"),
        ("positioning", "100,2,+,0.1", ": expected forward of run 2 at 100 mm once, came again"),
        ("positioning", "100,2,sideways,0.1",
         "column 3 (direction): expected forward or backward (+ or -), got 'sideways'"),
        ("positioning", ",2,+,0.1", "column 1 (target_mm): expected target in mm, got none"),
        ("positioning", "100,,+,0.1", "column 2 (run): expected run, got none"),
        ("six-dof", "750,1,2,3,4,5,", "column 7 (angular_c_urad): expected angular_c of run 1 at "
         "750 mm, got none"),
        ("rotary-axis", "-270,1,2,3,4", ": expected 4 columns as in line 2, got 5; decimal commas "
         "need semicolons between the columns"),
    ],
)  # fmt: skip
def test_a_wrong_row_is_named_by_line_and_column_once(method, row, complaint):
    text = EXAMPLES[method][0] + row + "\n"
    last = len(text.splitlines())
    found = [line for line in complaints(method, text) if f"line {last}" in line]
    separator = "" if complaint.startswith(":") else ", "
    assert found == [f"run.csv, line {last}{separator}{complaint}"]


@pytest.mark.parametrize(
    ("method", "comment", "complaint"),
    [
        ("positioning", "# axis: w", "line 1: expected axis among x, y, z, got 'w'"),
        ("positioning", "", "expected axis, got none: write `# axis: x`"),
        ("machined-part", "# component: EXW", "line 1: expected an error component such as EXX"),
        ("machined-part", "# component: EXY\n# line: curved",
         "line 2: expected line among least-squares, end-points, got 'curved'"),
        ("step-diagonal", "# origin_mm: 0, 0, 0", "expected step, got none: write `# step_mm: 50"),
        ("step-diagonal", "# origin_mm: 0, 0\n# step_mm: 1 1 1", "line 1: expected 3 numbers in mm "
         "such as `# origin_mm: 0, 0, 0`, got '0, 0'"),
        ("step-diagonal", "# origin: 0, 0, 0\n# step_mm: 1 1 1", "line 1: expected the unit of "
         "origin in the name, such as origin_mm (mm, um, m, in, inch), got no unit"),
        ("step-diagonal", "# origin_mm: 0 0 0\n# origin_mm: 0 0 0\n# step_mm: 1 1 1",
         "line 2: expected origin_mm once, came again"),
        ("positioning", "# axis: x\n# repeatability_um: small",
         "line 2: expected a number in µm such as `# repeatability_um: 0.5`, got 'small'"),
        ("positioning", "# axis: x\n# temperature spindle: warm",
         "line 2: expected the temperature of spindle in °C, got 'warm'"),
    ],
)  # fmt: skip
def test_comment_lines_that_are_wrong(method, comment, complaint):
    table = "\n".join(line for line in EXAMPLES[method][0].splitlines() if line[0] != "#")
    found = complaints(method, f"{comment}\n{table}")
    assert any(complaint in line for line in found), found


@pytest.mark.parametrize(
    "written",
    ["1.5, 2.5, -3", "1.5 2.5 -3", "1,5; 2,5; -3", "1,5 2,5 -3", "1.5;2.5;-3", "1.5,2.5,-3",
     "1,5, 2,5, -3"],
)  # fmt: skip
def test_three_numbers_however_they_are_parted(written):
    text = f"# axis: x\n# measuring line [mm]: {written}\nposition_mm,linear_um\n0,0\n"
    assert read_measurement("six-dof", text)["measuring_line_mm"] == [1.5, 2.5, -3.0]


ARRANGEMENTS = [
    "target_mm,cycle,direction,error_um\n0,1,up,0\n9,1,up,1\n9,1,down,3\n0,1,down,2\n"
    "0,2,up,4\n9,2,up,5\n9,2,down,7\n0,2,down,6\n",
    "direction,target_mm,error_um\n+,0,0\n+,9,1\n-,9,3\n-,0,2\n+,0,4\n+,9,5\n-,9,7\n-,0,6\n",
    "target_mm,run,forward_um,backward_um\n0,1,0,2\n9,1,1,3\n9,2,5,7\n0,2,4,6\n",
    "target_mm,forward_um,backward_um\n0,0,2\n9,1,3\n0,4,6\n9,5,7\n",
    "target_mm,forward_1_um,backward_1_um,forward_2_um,backward_2_um\n9,1,3,5,7\n0,0,2,4,6\n",
    "Target [mm];Run 1 ↑ [µm];Run 1 ↓ [µm];Run 2 ↑ [µm];Run 2 ↓ [mm]\n"
    "0;0;2;4;0,006\n9;1;3;5;0,007\n",
    "Target [mm];direction;Actual position [mm]\n"
    "0;+;0\n9;+;9,001\n9;-;9,003\n0;-;0,002\n0;+;0,004\n9;+;9,005\n9;-;9,007\n0;-;0,006\n",
    "position_mm;↑1 [µm];↑2 [µm];↓1 [µm];↓2 [µm]\n0;0;4;2;6\n9;1;5;3;7\n",
]


@pytest.mark.parametrize("table", ARRANGEMENTS)
def test_arrangements_of_a_positioning_test(table):
    assert read_measurement("positioning", f"# axis: Y\n{table}") == {
        "axis": "y",
        "targets_mm": [0.0, 9.0],
        "forward_um": [[0.0, 1.0], [4.0, 5.0]],
        "backward_um": [[2.0, 3.0], [6.0, 7.0]],
    }


@pytest.mark.parametrize(
    "table",
    ["target_mm,error_um\n0,1\n9,2\n", "target_mm,forward_um,backward_um\n0,1,\n9,2,\n",
     "target_mm,forward_1_um\n9,2\n0,1\n"],
)  # fmt: skip
def test_a_unidirectional_test_has_no_backward_readings(table):
    found = read_measurement("positioning", f"# axis: x\n{table}")
    assert found == {"axis": "x", "targets_mm": [0.0, 9.0], "forward_um": [[1.0, 2.0]]}


def test_a_run_that_lacks_a_target_is_named():
    text = "# axis: x\ntarget_mm,run,forward_um\n0,1,0\n9,1,1\n0,2,2\n"
    assert complaints("positioning", text) == [
        "run.csv, line 4, column 3 (forward_um): expected forward of run 2 at 9 mm, got none"
    ]
    (only_backward,) = complaints("positioning", "# axis: x\ntarget_mm,error_um,direction\n0,0,-\n")
    assert only_backward == "run.csv, line 2: expected forward readings, got none"


def test_repeated_runs_make_lists_of_lists():
    text = "# axis: z\nposition_mm,EZZ_um,run\n0,1,1\n5,2,1\n0,3,2\n5,4,2\n"
    assert read_measurement("six-dof", text)["linear_um"] == [[1.0, 2.0], [3.0, 4.0]]
    text = "# component: D_x(y)\nposition_mm,measured_um\n5,2\n0,1\n0,3\n5,4\n"
    found = read_measurement("machined-part", text)
    assert (found["component"], found["positions_mm"]) == ("D_x(y)", [0.0, 5.0])
    assert found["measured_um"] == [[1.0, 2.0], [3.0, 4.0]]
    table = EXAMPLES["body-diagonal"][0]
    again = "\n".join(line for line in table.splitlines() if line.startswith(("ppp", "npp")))
    once = read_measurement("body-diagonal", table)["diagonals"]["npp"]
    twice = read_measurement("body-diagonal", table + again)["diagonals"]["npp"]
    assert twice["forward_um"] == [once["forward_um"]] * 2
    assert twice["positions_mm"] == once["positions_mm"]


def test_steps_in_any_order_and_diagonals_of_unequal_length():
    table, body = EXAMPLES["step-diagonal"]
    head, rows = table.splitlines()[:3], table.splitlines()[3:]
    assert read_measurement("step-diagonal", "\n".join(head + rows[::-1])) == body
    without = "\n".join(head + rows[:-1])
    assert complaints("step-diagonal", without) == [
        "run.csv, line 10: expected 2 steps of ppn as of ppp, got 1"
    ]
    three = read_measurement("step-diagonal", "\n".join(head + rows[:-2]))
    assert list(three["diagonals"]) == ["ppp", "npp", "pnp"]


@pytest.mark.parametrize("method", METHODS)
def test_files_without_what_they_need(method):
    nothing = "run.csv: expected a line of column names and lines of values, got none"
    assert complaints(method, "# only: words\n") == [nothing]
    table = EXAMPLES[method][0]
    head = [line for line in table.splitlines() if line.startswith("#")]
    names = table.splitlines()[len(head)]
    found = complaints(method, "\n".join([*head, names]))
    assert found == ["run.csv: expected lines of values, got none"]


MEASURED = data_folder() / "ess-target-drive" / "iso230_2_deviations.csv"


@pytest.mark.skipif(not MEASURED.exists(), reason="the measured positioning tests are not here")
def test_a_measured_positioning_test_is_read_as_it_stands():
    """Its columns: test, direction, position_index, cycle, target_mm, measured_mm, deviation_um."""
    lines = MEASURED.read_text(encoding="utf-8").splitlines()
    first = next(csv.reader(lines[1:2]))[0]
    kept = [lines[0], *(line for line in lines[1:] if line.startswith(first))]
    found = METHODS["positioning"].read("\n".join(["# axis: x", *kept]))
    shape = np.shape(found.body["forward_um"])
    assert shape == np.shape(found.body["backward_um"]) == (5, len(found.body["targets_mm"]))
    assert found.remarks == ["columns that are not read: test, position_index, measured_mm"]
    by_hand = [
        float(row["deviation_um"])
        for row in csv.DictReader(kept)
        if row["direction"].startswith("f") and float(row["cycle"]) == 1
    ]
    assert sorted(by_hand) == sorted(found.body["forward_um"][0])
