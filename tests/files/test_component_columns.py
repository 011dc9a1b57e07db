"""Calibration sheets: a column for each component, blocks, sheets; as maps and as checks."""

import numpy as np
import pytest

from app.files.csv_comments import Header
from app.files.csv_verification import read_csv_verification
from app.files.delimited_text import UnreadableFile
from app.thermal.error_map import ComponentAnswer
from tests.files.error_map_files import read_error_map
from tests.files.test_spreadsheets import as_text, workbook

STATED = Header("Run #1", "2026-03-01T06:00:00Z", {"bed": 20.5})
HEADER = [
    ["# label", "Run #1"],
    ["# measured_at: 2026-03-01T06:00:00Z"],
    ["# temperature bed", 20.5, "°C"],
]
X = [["Position [mm]", "EXX [µm]", "EBX [µrad]"], [-50.5, 0.5, -2.5], [50.5, 1.5, 7.25]]
Y = [["Y [m]", "EYY [mm]", "EAY [arcsec]"], [0.0, 0.0, 0.0], [0.5, 0.0015, 1.0]]
ARCSEC_URAD = np.pi / 180 / 3600 * 1e6


def read(tmp_path, rows, way="semicolons", stated=STATED):
    if way == "workbook":
        file = workbook(tmp_path / "map.xlsx", rows)
    else:
        mark, decimal = {"semicolons": (";", ","), "commas": (",", "."), "tabs": ("\t", ",")}[way]
        file = tmp_path / "map.csv"
        file.write_text(as_text(rows, mark, decimal), encoding="utf-8")
    return read_error_map(file, stated)


def refusal(tmp_path, rows):
    with pytest.raises(UnreadableFile) as refused:
        read(tmp_path, rows)
    return str(refused.value)


def numbers(found):
    return {
        code: ComponentAnswer.of(table).model_dump(
            exclude={"component", "chapter", "iso", "iso_value_urad"}
        )
        for code, table in found.error_map.tables.items()
    }


@pytest.mark.parametrize("way", ["workbook", "semicolons", "commas", "tabs"])
def test_a_column_for_each_component_with_the_header_in_cells(tmp_path, way):
    found = read(tmp_path, [*HEADER, *X], way, Header())
    assert numbers(found) == {
        "EXX": {"positions_mm": [-50.5, 50.5], "errors_um": [0.5, 1.5]},
        "EBX": {"positions_mm": [-50.5, 50.5], "errors_urad": [-2.5, 7.25]},
    }
    assert (found.error_map.label, found.error_map.temperatures_c) == ("Run #1", {"bed": 20.5})
    assert found.remarks == []


@pytest.mark.parametrize(
    "heading", ["EXX_um", "exx (µm)", "D_x(x) [µm]", "Dx(x) µm", "EXX error [µm]"]
)
def test_components_are_known_by_every_name(tmp_path, heading):
    (one,) = numbers(read(tmp_path, [["Pos [mm]", heading], *(r[:2] for r in X[1:])])).values()
    assert one == {"positions_mm": [-50.5, 50.5], "errors_um": [0.5, 1.5]}


@pytest.mark.parametrize(
    ("place", "unit", "number", "expected"),
    [
        ("in", "in", 0.001, 25.4),
        ("inch", "mil", 1.0, 25.4),
        ("in", "thou", 2.0, 50.8),
        ("in", "µin", 100.0, 2.54),
        ("in", "nm", 1500.0, 1.5),
    ],
)
def test_inches_are_converted_exactly(tmp_path, place, unit, number, expected):
    rows = [[f"X [{place}]", f"xTx [{unit}]"], [0.0, 0.0], [10.0, number]]
    (exx,) = numbers(read(tmp_path, rows)).values()
    assert exx == {"positions_mm": [0.0, 254.0], "errors_um": [0.0, expected]}


@pytest.mark.parametrize(
    ("unit", "expected"), [("arcmin", 290.888208665722), ("′", 290.888208665722), ("nrad", 0.001),
                           ("ppm", 1.0), ("µin/in", 1.0)]
)  # fmt: skip
def test_angles_in_other_units(tmp_path, unit, expected):
    rows = [["X [mm]", f"E_BX [{unit}]"], [0.0, 0.0], [100.0, 1.0]]
    (ebx,) = numbers(read(tmp_path, rows)).values()
    assert ebx["errors_urad"][1] == pytest.approx(expected)


def test_a_column_that_names_no_component_surely_is_refused(tmp_path):
    rows = [["X [mm]", "EXX [µm]", "Yaw [arcsec]"], [0.0, 0.0, 0.0], [100.0, 1.0, 1.0]]
    assert "expected a rotation by its axis, as EAX, EBX or ECX" in refusal(tmp_path, rows)


def test_an_inch_mark_is_no_unit_of_angles(tmp_path):
    rows = [["X [mm]", 'EBX ["]'], [0.0, 0.0], [100.0, 1.0]]
    assert "expected EBX in µrad" in refusal(tmp_path, rows)


def test_blocks_below_and_beside_each_other_have_their_own_positions(tmp_path):
    below = [*X, [], ["Y axis"], *Y, [], ["SXY", -12.5, "µm/m"], ["SYZ", 0.0025, "mm/m"]]
    beside = [[*a, "", *b] for a, b in zip(X, Y, strict=True)]
    for rows in (below, beside):
        found = numbers(read(tmp_path, rows))
        assert found["EXX"]["positions_mm"] == [-50.5, 50.5]
        assert found["EYY"] == {"positions_mm": [0.0, 500.0], "errors_um": [0.0, 1.5]}
        assert found["EAY"]["errors_urad"][1] == pytest.approx(ARCSEC_URAD)
    found = read(tmp_path, below)
    assert numbers(found)["SXY"] == {"value_um_per_m": -12.5}
    assert numbers(found)["SYZ"] == {"value_um_per_m": 2.5}
    assert found.remarks == ["lines that are not read: 'Y axis'"]


def test_both_directions_standard_errors_and_a_line_of_units(tmp_path):
    rows = [
        ["Position", "EXX ↑", "EXX ↓", "u(EXX)", "EXX backward standard error"],
        ["[mm]", "[µm]", "[mm]", "[µm]", "µm"],
        [0.0, 0.0, 0.5, 0.1, 0.2],
        [9.0, 1.0, 0.25, 0.1, 0.2],
    ]
    assert numbers(read(tmp_path, rows)) == {
        "EXX": {
            "positions_mm": [0.0, 9.0],
            "errors_um": [0.0, 1.0],
            "backward_errors_um": [500.0, 250.0],
            "standard_errors_um": [0.1, 0.1],
            "backward_standard_errors_um": [0.2, 0.2],
        }
    }


def test_a_sheet_for_each_axis_a_protocol_and_squareness_are_one_map(tmp_path):
    protocol = [
        ["Machine", "HMC 630"],
        ["Date", "2026-11-16T06:30:00+01:00"],
        ["Title", "18 °C"],
        ["Bed front", 18.1, "°C"],
        ["Column [°C]", 18.0],
        ["Repeatability", 0.5, "µm"],
    ]
    squareness = [["SXY", 3.4, "µm/m"], ["SYZ", 3.5, "µm/m"]]
    file = workbook(tmp_path / "p.xlsx", protocol, X, Y, squareness, [["Remarks"], ["all fine"]])
    found = read_error_map(file, Header())
    assert set(numbers(found)) == {"EXX", "EBX", "EYY", "EAY", "SXY", "SYZ"}
    assert found.error_map.label == "18 °C"
    assert found.error_map.temperatures_c == {"Bed front": 18.1, "Column": 18.0}
    assert found.error_map.repeatability_um == 0.5
    assert found.error_map.measured_at.isoformat() == "2026-11-16T05:30:00+00:00"
    assert found.remarks == [
        "lines that are not read in sheet 'Sheet 1': 'Machine HMC 630'",
        "lines that are not read in sheet 'Sheet 5': 'Remarks', 'all fine'",
    ]


@pytest.mark.parametrize("title", ["Cold, in the morning", "Kalt, am Morgen, Halle 3, Bett"])
def test_commas_in_a_title_part_no_columns(tmp_path, title):
    rows = [[title], ["Titel", title], *X]
    for way in ("semicolons", "tabs"):
        found = read(tmp_path, rows, way, Header(None, STATED.measured_at, STATED.temperatures_c))
        assert found.error_map.label == title
        assert set(numbers(found)) == {"EXX", "EBX"}


def test_a_date_that_is_no_iso_date_is_said_and_asked_for(tmp_path):
    file = workbook(tmp_path / "p.xlsx", [["Datum", "02.11.2026 06:10"], *X])
    with pytest.raises(UnreadableFile) as caught:
        read_error_map(file, Header(STATED.label, None, STATED.temperatures_c))
    (lack,) = caught.value.lacks
    assert lack.field == "measured_at"
    assert "got '02.11.2026 06:10'" in lack.message
    assert read_error_map(file, STATED).error_map.measured_at.isoformat().startswith("2026-03-01")


def test_angles_as_a_level_states_them(tmp_path):
    rows = [["X [mm]", "EBX [mm/m]", "ECX [µm/m]"], [0, 0, 0], [9.0, 0.0012, 1.5]]
    found = numbers(read(tmp_path, rows))
    assert found["EBX"]["errors_urad"] == [0.0, 1.2]
    assert found["ECX"]["errors_urad"] == [0.0, 1.5]


def test_a_number_of_three_decimals_is_none_in_thousands(tmp_path):
    """Beside cells of text with decimal commas."""
    rows = [["X [mm]", "EXX [µm]", "EYX [µm]"], [0, "0,5", 1.284], [9.0, "1,25", 1.5]]
    assert numbers(read(tmp_path, rows))["EYX"]["errors_um"] == [1.284, 1.5]


def test_sheets_may_repeat_their_head_and_not_contradict_each_other(tmp_path):
    head = [["Titel", "18 °C"], ["Messgerät", "XL-80"], ["Bed front", "18,1", "°C"]]
    same = workbook(tmp_path / "p.xlsx", [*head, *X], [*head, *Y])
    found = read_error_map(same, STATED)
    assert found.error_map.temperatures_c["Bed front"] == 18.1
    assert found.error_map.instrument == "XL-80"
    assert found.remarks == []
    other = workbook(tmp_path / "p.xlsx", [*head, *X], [*head[:2], ["Bed front", 19, "°C"], *Y])
    with pytest.raises(
        UnreadableFile,
        match=r"sheet 'Sheet 2', line 3: expected the temperature of Bed front once, got 18.1 and",
    ):
        read_error_map(other, STATED)


def test_a_sheet_with_numbers_that_nobody_understands_is_refused_by_its_name(tmp_path):
    other = [["place", "reading", "reading", "reading"], [0.0, 1.0, 2.0, 3.0]]
    with pytest.raises(UnreadableFile, match=r"sheet 'Sheet 2', line 2: expected a line of column"):
        read_error_map(workbook(tmp_path / "p.xlsx", X, other), STATED)


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        ([["Position", "EXX [µm]"], [0, 0]], "line 1, column 1 (Position): expected the unit"),
        ([["Position [mm]", "EXX [µrad]"], [0, 0]], "(EXX [µrad]): expected EXX in µm"),
        ([["Position [mm]", "EXX [furlong]"], [0, 0]], "got the unit 'furlong'"),
        ([["Y [mm]", "EXX [µm]"], [0, 0]], "expected a column of positions of X at the left"),
        ([["EXX [µm]", "EYX [µm]"], [0, 0]], "positions of X at the left of EXX, got none"),
        ([X[0], [0, 0, 0], ["", 1, 1]], "line 3, column 1 (Position [mm]): expected a position"),
        ([X[0], [0, 0, 0], [1, "n/a", 1]], "line 3, column 2 (EXX [µm]): expected a number in um"),
        ([X[0], [0, 0, 0], [1, 20000, 1]], "expected errors within ±10000 µm, got 20000"),
        ([X[0], [0, 0, 0], [0, 1, 1]], "expected one value of EXX at 0 mm, got another one"),
        ([X[0], [0, 0.001, 0], [9, 0.002, 1]], "they may be in mm instead of µm"),
        ([["Position [mm]", "EXX [µm]", "u(EXX) [µm]"], [0, 1, 0.1], [9, 1, ""]], "standard error"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_with_line_and_column(tmp_path, rows, said):
    assert said in refusal(tmp_path, rows)


def test_columns_without_a_unit_are_said_to_be_read_in_the_components_own(tmp_path):
    found = read(tmp_path, [["Position [mm]", "EXX", "operator"], [0, 1, "me"], [9, 2, "me"]])
    assert "columns that are not read: operator" in found.remarks[0]
    assert found.remarks[1] == "columns that state no unit: read are EXX in µm"


@pytest.mark.parametrize("way", ["workbook", "csv"])
def test_a_check_with_a_column_for_each_component(tmp_path, way):
    at = "2026-03-01T06:00:00Z"
    rows = [
        ["# datum", "first"],
        ["time", "Position [mm]", "direction", "EXX [mm]", "EBX [µrad]"],
        [at, 100.5, "+", 0.0015, 2.5],
        [at, 200.5, "-", 0.0025, ""],
    ]
    if way == "workbook":
        file = workbook(tmp_path / "check.xlsx", rows)
    else:
        file = tmp_path / "check.csv"
        file.write_text(as_text(rows, ";", ","), encoding="utf-8")
    found = read_csv_verification(file)
    assert found.body["datum"] == "first"
    place = {"time": at, "position_mm": 100.5, "direction": "+"}
    assert found.body["observations"] == [
        {"component": "EXX", **place, "measured_um": 1.5},
        {"component": "EBX", **place, "measured_urad": 2.5},
        {
            "component": "EXX",
            "time": at,
            "position_mm": 200.5,
            "direction": "-",
            "measured_um": 2.5,
        },
    ]
    assert found.lines == [3, 3, 4]
    assert found.remarks == []


def test_sheets_of_a_check_are_measured_when_the_protocol_says(tmp_path):
    protocol = [["Date", "2026-03-01T06:00:00Z"]]
    file = workbook(tmp_path / "check.xlsx", protocol, X, Y, [["SXY", 3.5, "µm/m"]])
    found = read_csv_verification(file)
    assert len(found.body["observations"]) == 9
    assert {one["time"] for one in found.body["observations"]} == {"2026-03-01T06:00:00Z"}
    assert found.body["observations"][-1]["measured_um_per_m"] == 3.5
    with pytest.raises(UnreadableFile, match="expected a column time, or `# measured_at"):
        read_csv_verification(workbook(tmp_path / "none.xlsx", X))


def test_columns_of_states_stand_beside_components_of_a_check(tmp_path):
    rows = [
        ["time", "State: coolant", "X [mm]", "EXX [µm]", "EYX [µm]", "state spindle_rpm", "by"],
        ["2026-03-01T06:00:00Z", 1, 100.5, 1.5, 2.5, 3000, "me"],
        ["2026-03-01T06:01:00Z", "", 200.5, 2.5, "", 0, ""],
    ]
    found = read_csv_verification(workbook(tmp_path / "check.xlsx", rows))
    assert [one["state"] for one in found.body["observations"]] == [
        {"coolant": 1.0, "spindle_rpm": 3000.0},
        {"coolant": 1.0, "spindle_rpm": 3000.0},
        {"spindle_rpm": 0.0},
    ]
    assert found.remarks == ["line 1: columns that are not read: by"]
    rows[1][1] = "on"
    with pytest.raises(UnreadableFile, match="expected a number"):
        read_csv_verification(workbook(tmp_path / "wrong.xlsx", rows))
