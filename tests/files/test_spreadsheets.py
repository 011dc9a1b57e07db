"""What spreadsheets write is read the same way for maps, methods, verifications and recordings."""

from datetime import datetime

import pytest
from openpyxl import Workbook

from app.api.methods.registry import METHODS
from app.api.uploads import read_uploaded_verification
from app.files.csv_comments import Header
from app.files.csv_verification import read_csv_verification
from app.files.delimited_text import UnreadableFile, read_text
from app.files.recording import read_recording
from tests.files.error_map_files import read_error_map

STATED = Header("Run #1", "2026-03-01T06:00:00Z", {"x-middle": 20.1})

READERS = {
    "map": (
        [["component", "position_mm", "error_um"], ["EXX", 0, 0.5], ["EXX", 50.5, 1.25]],
        lambda file: read_error_map(file, STATED).error_map.tables["EXX"].errors.tolist(),
        [0.5, 1.25],
    ),
    "method": (
        [["# axis: x"], ["target_mm", "forward_um"], [0, 0.5], [50.5, 1.25]],
        lambda file: METHODS["positioning"].read(read_text(file)).body["forward_um"],
        [[0.5, 1.25]],
    ),
    "verification": (
        [
            ["# datum: free"],
            ["time", "component", "position_mm", "measured_um"],
            ["2026-03-01T06:00:00Z", "EXX", 50.5, 0.5],
            ["2026-03-01T06:01:00Z", "EXX", 50.5, 1.25],
        ],
        lambda file: [
            o["measured_um"] for o in read_csv_verification(file).body["observations"]
        ],
        [0.5, 1.25],
    ),
    "recording": (
        [["time_s", "x-middle [°C]"], [0, 0.5], [60.5, 1.25]],
        lambda file: [
            values["x-middle"] for values in read_recording(file, ["x-middle"], {}, None)
            .temperatures_c
        ],
        [0.5, 1.25],
    ),
}  # fmt: skip


def as_text(rows, delimiter, decimal):
    def cell(value):
        return str(value).replace(".", decimal) if isinstance(value, float) else str(value)

    return "".join(delimiter.join(map(cell, row)) + "\n" for row in rows)


def workbook(file, *sheets):
    book = Workbook()
    book.remove(book.active)
    for i, rows in enumerate(sheets):
        sheet = book.create_sheet(f"Sheet {i + 1}")
        for row in rows:
            sheet.append(row)
    book.save(file)
    return file


@pytest.mark.parametrize("kind", READERS)
@pytest.mark.parametrize(
    ("before", "delimiter", "decimal", "encoding"),
    [
        ("", ";", ",", "cp1252"),
        ("sep=;\n", ";", ",", "utf-8-sig"),
        ('"sep=,"\n', ",", ".", "utf-8"),
        ("SEP=\t\r\n", "\t", ",", "utf-16"),
        ("sep=|\n", "|", ",", "utf-8"),
    ],
)
def test_text(tmp_path, kind, before, delimiter, decimal, encoding):
    rows, read, expected = READERS[kind]
    file = tmp_path / "run.csv"
    file.write_bytes((before + as_text(rows, delimiter, decimal)).encode(encoding))
    assert read(file) == expected


@pytest.mark.parametrize("kind", READERS)
def test_a_workbook(tmp_path, kind):
    rows, read, expected = READERS[kind]
    assert read(workbook(tmp_path / "run.xlsx", rows, [])) == expected


@pytest.mark.parametrize("kind", READERS)
def test_several_sheets_are_none_to_choose_from(tmp_path, kind):
    rows, read, _ = READERS[kind]
    with pytest.raises(UnreadableFile) as caught:
        read(workbook(tmp_path / "run.xlsx", rows, rows))
    assert "expected one sheet that holds values, got 2: Sheet 1, Sheet 2; keep one, or save" in (
        caught.value.detail
    )


@pytest.mark.parametrize("kind", READERS)
@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(600), "an old Excel workbook (.xls): save it"),
        (b"PK\x03\x04" + bytes(600), "expected CSV or an Excel workbook (.xlsx), got neither"),
    ],
)
def test_what_is_no_table_is_one_line(tmp_path, kind, content, said):
    file = tmp_path / "run.xls"
    file.write_bytes(content)
    with pytest.raises(UnreadableFile) as caught:
        READERS[kind][1](file)
    assert said in caught.value.detail
    assert "\n" not in caught.value.detail


def test_rows_of_a_workbook_keep_their_numbers_and_comments_their_cells(tmp_path):
    rows = [
        ["# label:", "Run #1"],
        ["# measured_at:", "2026-03-01T06:00:00Z"],
        ["# temperature x-middle:", 20.1],
        [],
        ["component", "Position, nominal, in mm", "position_mm", "error_um"],
        ["EXX", None, 0, 1.5],
        ["EXX", None, 50, "much"],
    ]
    with pytest.raises(UnreadableFile) as caught:
        read_error_map(workbook(tmp_path / "run.xlsx", rows), Header())
    assert caught.value.detail.endswith(
        "line 7, column 4 (error_um): expected a number in µm, got 'much'"
    )
    rows[-1][-1] = 2.5
    found = read_error_map(workbook(tmp_path / "run.xlsx", rows), Header()).error_map
    assert (found.label, found.temperatures_c) == ("Run #1", {"x-middle": 20.1})


HEADERS = {
    "map": (
        [
            ["# label", "Run: 1"],
            ["# measured at", "2026-03-01T06:00:00Z"],
            ["# temperature x-middle", 20.5, "°C"],
            ["#", "temperature", "Bed front", 18.5],
            ["# Repeatability", 0.5, "µm"],
        ],
        lambda file: {
            name: getattr(read_error_map(file, Header()).error_map, name)
            for name in ("label", "temperatures_c", "repeatability_um")
        },
        {
            "label": "Run: 1",
            "temperatures_c": {"x-middle": 20.5, "Bed front": 18.5},
            "repeatability_um": 0.5,
        },
    ),
    "verification": (
        [["# label", "two cells"], ["# datum", "first"], ["# repeatability [mm]", 0.0005]],
        lambda file: {
            k: v for k, v in read_csv_verification(file).body.items() if k != "observations"
        },
        {"label": "two cells", "datum": "first", "repeatability_um": 0.5},
    ),
    "method": (
        [["# axis", "x"], ["# repeatability", 0.5, "µm"]],
        lambda file: {
            k: v
            for k, v in METHODS["positioning"].read(read_text(file)).body.items()
            if k in ("axis", "repeatability_um")
        },
        {"axis": "x", "repeatability_um": 0.5},
    ),
}


@pytest.mark.parametrize("kind", HEADERS)
@pytest.mark.parametrize("way", ["workbook", "semicolons", "tabs", "quoted", "equals"])
def test_a_header_in_cells_of_its_own_is_read(tmp_path, kind, way):
    header, read, expected = HEADERS[kind]
    table = [row for row in READERS[kind][0] if not str(row[0]).startswith("#")]
    file = tmp_path / ("run.xlsx" if way == "workbook" else "run.csv")
    if way == "workbook":
        workbook(file, [*header, *table])
    elif way == "equals":
        written = [[f"{row[0]} = {' '.join(map(str, row[1:]))}"] for row in header if row[0] != "#"]
        file.write_text(as_text([*written, *header[3:4], *table], ";", ","), encoding="utf-8")
    else:
        rows = [*header, *table]
        if way == "quoted":
            rows = [[f'"{cell}"' if isinstance(cell, str) else cell for cell in r] for r in rows]
        file.write_text(as_text(rows, "\t" if way == "tabs" else ";", ","), encoding="utf-8")
    assert read(file) == expected


@pytest.mark.parametrize("mark", [";", "\t", " = ", ": ", ",", " : "])
def test_a_header_may_be_parted_otherwise_than_the_table(tmp_path, mark):
    file = tmp_path / "run.csv"
    rows = as_text(READERS["verification"][0][1:], ",", ".")
    file.write_text(f"# datum{mark}first\n{rows}", encoding="utf-8")
    found = read_csv_verification(file)
    assert (found.body["datum"], found.remarks) == ("first", [])


@pytest.mark.parametrize("line", ["# zero;first", "# datum first", "# zero: first", "# my notes"])
def test_no_header_line_is_passed_over_without_a_word(tmp_path, line):
    rows = READERS["verification"][0][1:]
    file = tmp_path / "run.csv"
    file.write_text(f"{line}\n{as_text(rows, ';', ',')}", encoding="utf-8")
    (remark,) = read_csv_verification(file).remarks
    assert "not read" in remark


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("# datum;sometimes", "expected datum among absolute, first, free, got 'sometimes'"),
        ("# repeatability;0,5", "expected the unit of repeatability in the name"),
        ("# repeatability_um;0,5;mm", "expected a number in µm"),
        ("# repeatability;0,5;furlong", "got the unit 'furlong'"),
    ],
)
def test_a_header_that_cannot_be_read_as_it_is_meant_is_refused(tmp_path, line, said):
    file = tmp_path / "run.csv"
    rows = READERS["verification"][0][1:]
    file.write_text(f"{line}\n{as_text(rows, ';', ',')}", encoding="utf-8")
    with pytest.raises(UnreadableFile) as refusal:
        read_csv_verification(file)
    assert said in str(refusal.value)


def test_what_stands_above_the_columns_without_a_hash_is_told_how_to_be_written(tmp_path):
    rows = [["label", "Warm"], ["temperature bed", 31.2], [], *READERS["map"][0]]
    file = workbook(tmp_path / "warm.xlsx", rows)
    with pytest.raises(UnreadableFile) as refusal:
        read_error_map(file, STATED)
    assert str(refusal.value) == (
        f"{file}, line 1: expected # before each line above the column names, such as "
        "`# label: Warm`, got 'label Warm'"
    )


def test_a_recording_may_begin_with_a_column_named_as_a_statement(tmp_path):
    file = tmp_path / "recording.csv"
    file.write_text("temperature bed,time_s\n20.5,0\n20.7,60\n")
    found = read_recording(file, ["temperature bed"], {}, None)
    assert [values["temperature bed"] for values in found.temperatures_c] == [20.5, 20.7]


def test_a_column_that_lacks_is_told_of_once_with_those_that_came(tmp_path):
    file = tmp_path / "map.csv"
    file.write_text("component,position,error_um\nEXX,0,0\nEXX,650,12\n")
    with pytest.raises(UnreadableFile) as refusal:
        read_error_map(file, STATED)
    (line,) = str(refusal.value).splitlines()
    assert line.endswith("a column position_mm for EXX, got component, position, error_um")


def test_times_of_a_workbook_have_no_zone_and_that_is_said(tmp_path):
    rows = [["time", "component", "measured_um"], [datetime(2026, 3, 1, 6), "SXY", 1.5]]
    with pytest.raises(UnreadableFile, match=r"its zone, such as 2026-03-01T06:00:00Z"):
        read_csv_verification(workbook(tmp_path / "run.xlsx", rows))


def test_sizes_are_judged_in_verifications_too(tmp_path):
    file = tmp_path / "night.csv"
    head = "time,component,position_mm,measured_um\n"
    file.write_text(head + "2026-03-01T06:00:00Z,EXX,5,0.004\n", encoding="utf-8")
    found = read_uploaded_verification(file.read_bytes(), file.name, "vmc")
    (remark,) = found.verification.remarks
    assert remark.startswith("No reading is larger than 0.004 µm (measured_um): they may be in mm")
    file.write_text(head + "2026-03-01T06:00:00Z,EXX,5,20000\n", encoding="utf-8")
    with pytest.raises(UnreadableFile, match=r"line 2: expected errors within ±10000 µm, got 200"):
        read_csv_verification(file)


def test_a_recording_in_kelvin_is_refused(tmp_path):
    file = tmp_path / "warm.csv"
    file.write_text("time_s,x-middle [K],z_c\n0,293.15,20\n", encoding="utf-8")
    with pytest.raises(UnreadableFile, match=r"expected x-middle in °C, got the unit 'k'"):
        read_recording(file, ["x-middle", "z"], {}, None)
