"""Golden files: each format's form, as C. Wang's Tables 8.3 to 8.6 and 8.4.5 print it.

The files in `golden` were written here; their numbers follow from the example below by hand. To
write them anew after a change that is meant: `python -m tests.controllers.test_forms`.
"""

from pathlib import Path

import numpy as np
import pytest

from app.controllers.export import export
from app.controllers.format import CHECK_FILE, ControllerFile
from app.controllers.registry import FORMATS, format_named
from tests.controllers.example_tables import curve, error_table, options_for

GOLDEN = Path(__file__).parent / "golden"

EXAMPLE = error_table(
    curve("EXX", [-200.0, -100.0, 0.0, 100.0], [-2.0, -1.0, 0.0, 3.6], [-1.0, 0.4, 1.0, 5.0]),
    curve("EYX", [-200.0, 0.0, 100.0], [1.0, 0.0, -0.5]),
    curve("EBX", [-200.0, 100.0], [-10.0, 20.0]),
    curve("EYY", [0.0, 50.0, 100.0, 150.0], [0.0, 0.5, 2.0, 4.0]),
    curve("SXY", [], [-25.0]),
    ranges_mm={"x": (-200.0, 100.0), "y": (0.0, 150.0)},
    sizes_um={"EBX": 3.0, "SXY": 3.75},
)
"""EXX in both directions, straightness, an angle, EYY, and squareness: EXY = -25 µm/m · y."""

OPTIONS = {
    "siemens-cec": {"spacing_mm": 100.0},
    "siemens-enc-comp": {},
    "fanuc": {"spacing_mm": 50.0, "reference_mm": {"x": 100.0}},
    "heidenhain": {"power": 20, "name": "CompHeidenhain"},
    "mdsi": {"spacing_mm": 50.0},
}


def files_of(name):
    options = options_for(name, **OPTIONS.get(name, {}))
    found = export(format_named(name), EXAMPLE, options)
    return {f"{name}_{file.name}": file.content for file in found.files}


@pytest.mark.parametrize("name", FORMATS)
def test_the_form_of_each_format(name):
    written = files_of(name)
    assert written == {file: (GOLDEN / file).read_text(encoding="utf-8") for file in written}


def test_no_golden_file_is_left_over():
    assert {p.name for p in GOLDEN.iterdir()} == {f for name in FORMATS for f in files_of(name)}


# The lines below stand in the chapter; files of this kind are read as they are.

TABLE_8_3 = """%_N_NC_CEC_INI
CHANDATA(1)
$AN_CEC[0,0]=0.0000
$AN_CEC[0,1]=+0.0001
$AN_CEC[0,2]=+0.0000
$AN_CEC[0,3]=+0.0005
$AN_CEC[0,4]=+0.0024
$AN_CEC_INPUT_AXIS[0]=(AX1)
$AN_CEC_OUTPUT_AXIS[0]=(AX1)
$AN_CEC_STEP[0]=+50.0000
$AN_CEC_MIN[0]=-2100.0000
$AN_CEC_MAX[0]=-1900.0000
$AN_CEC_DIRECTION[0]=1
$AN_CEC_MULT_BY_TABLE[0]=0
$AN_CEC_IS_MODULO[0]=0
$an_cec[1.0] +0.0010
$an_cec[1.1]=-0.0010
$an_cec_input_axis[1]=(ax1)
$an_cec_output_axis[1]=(ax1)
$an_cec_step[1]=+200.0000
$an_cec_min[1]=-2100.0000
$an_cec_max[1]=-1900.0000
$an_cec_direction[1]=-1
$an_cec_mult_by_table[1]=0
$an_cec_is_modulo[1]=0
M23
"""

TABLE_8_5 = """BEGIN CompHeidenhainX.com DATUM: +0.0 DIST: 13
NR 1 = f ( )
0 +0.0 +0
1 +0.8192 -0.00027
2 +1.6384 -0.00036
3 +2.4576 -0.00036
[END]
"""

TABLE_8_6 = """# Compensation tune file for X stage
#
axLSCompCount[0] 3
axLSCompSpacing[0] 5000000
axLSCompPosMin[0] 0
#
axLSCompDirNeg [0] [0] 544
axLSCompDirNeg[1][0]   230
axLSCompDirNeg[2][0] 107
#
axLSCompDirPos[0] [0]\t28
axLSCompDirPos[1] [0] -28
axLSCompDirPos[2][0] -125
#
"""

# Table 8.4: seven points an axis, X from its reference at point 6, Y from point 100.
TABLE_8_4 = "\n".join(
    [
        "%",
        "N3620Q1A1P6A2P100",
        "N3621Q1A1P0A2P100",
        "N3622Q1A1P6A2P106",
        "N3623Q1A1P1A2P1",
        "N3624Q1A1P50000A2P50000",
        "N5711Q1P1",
        "N5721Q1P2",
        "N13381Q1P300",
        "N13391Q1P1",
        *(f"N{10000 + i}P{v}" for i, v in enumerate([1, 0, 0, 0, 1, 0, 0])),
        *(f"N{10100 + i}P{v}" for i, v in enumerate([0, 0, 0, 1, 0, 0, -1])),
        *(f"N{10300 + i}P{v}" for i, v in enumerate([0, 2, 0, 0, 0, 0, 0])),
        "%",
    ]
)


def parsed(name, content, file="x.txt", **options):
    stated = options_for(name, **options)
    return format_named(name).parse([ControllerFile(file, content)], stated).curves


def test_table_8_3_is_read_with_lower_case_dots_and_a_missing_sign():
    exx = parsed("siemens-cec", TABLE_8_3, sign="error")["EXX"]
    assert exx.at(np.array([-2100.0, -1950.0, -1900.0, 0.0])) == pytest.approx([0, 0.5, 2.4, 2.4])
    assert exx.at(np.array([-2100.0, -2000.0, 0.0]), "-") == pytest.approx([1.0, 0.0, -1.0])


def test_table_8_5_is_read():
    exx = parsed("heidenhain", TABLE_8_5, sign="error")["EXX"]
    assert exx.positions_mm.tolist() == [0.0, 0.8192, 1.6384, 2.4576]
    assert exx.errors == pytest.approx([0.0, -0.27, -0.36, -0.36])


def test_table_8_6_is_read_in_machine_counts():
    exx = parsed("mdsi", TABLE_8_6, sign="compensation", counts_per_mm=100_000.0)["EXX"]
    assert exx.positions_mm.tolist() == [0.0, 50.0, 100.0]
    assert exx.errors == pytest.approx([-0.28, 0.28, 1.25])  # a count is 0.01 µm
    assert exx.backward_errors == pytest.approx([-5.44, -2.30, -1.07])


def test_table_8_4_sums_increments_from_the_reference():
    read = parsed("fanuc", TABLE_8_4, sign="error", reference_mm={"x": 300.0})
    at = np.array([0.0, 50.0, 200.0, 300.0])
    # X: point 6 is at 300 mm; the section that ends at point 4 (200 mm) has +1.
    assert read["EXX"].at(at).tolist() == [-1.0, -1.0, 0.0, 0.0]
    assert read["EYY"].at(np.array([0.0, 100.0, 150.0, 300.0])).tolist() == [0.0, 0.0, 1.0, 0.0]
    assert read["EYX"].at(at).tolist() == [-2.0, 0.0, 0.0, 0.0]


def test_increments_of_the_parameter_manual():
    """Reference 40, interval 50 mm: No. 41 ends at +50 mm, No. 40 at 0 (B-63980EN, page 99)."""
    values = [2, 1, 1, -2, 0, -1, 0, -1, 2, 1, 0, -1, -1, -2, 0, 1, 2]
    lines = [
        "%",
        *(f"N{n}Q1A1P{v}" for n, v in {3620: 40, 3621: 33, 3622: 49, 3623: 1, 3624: 50000}.items()),
    ]
    lines += [f"N{10033 + i}P{v}" for i, v in enumerate(values)] + ["%"]
    exx = parsed("fanuc", "\n".join(lines), sign="error")["EXX"]
    assert exx.positions_mm[[0, -1]].tolist() == [-400.0, 450.0]
    assert exx.at(np.array([-400.0, -50.0, 0.0, 50.0, 100.0, 450.0])).tolist() == [0, 1, 0, 2, 3, 2]


def test_the_check_table_says_what_has_to_move():
    found = export(format_named("linuxcnc"), EXAMPLE, options_for("linuxcnc"))
    assert [(c.axis, c.position_mm, c.direction, c.moved_axis) for c in found.check] == [
        ("x", 100.0, "+", "x"),
        ("x", 100.0, "-", "x"),
        ("y", 150.0, "+", "y"),
    ]
    assert [c.expected_movement_um for c in found.check] == pytest.approx([-3.6, -5.0, -4.0])
    assert found.files[-1].name == CHECK_FILE


if __name__ == "__main__":
    GOLDEN.mkdir(exist_ok=True)
    for format_name in FORMATS:
        for file_name, content in files_of(format_name).items():
            (GOLDEN / file_name).write_text(content, encoding="utf-8")
