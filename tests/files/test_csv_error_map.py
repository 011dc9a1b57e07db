"""An error map from CSV: what is taken, and what is complained of, at which line and column."""

from datetime import UTC, datetime

import pytest

from app.files.csv_comments import Header
from app.files.delimited_text import UnreadableFile, read_text
from app.storage.error_maps import same_content
from app.thermal.error_map import ComponentAnswer, ComponentSchema
from tests.files.error_map_files import read_error_map

HEAD = """\
# label: Run #1
# measured_at: 2026-03-01T07:00:00+01:00
# temperature x-middle: 20.1
"""
ROWS = """\
component,position_mm,error_um
EXX,0,0.0
EXX,50,1.25
"""


@pytest.fixture
def read(tmp_path):
    def read_text(text, stated=Header(), encoding="utf-8"):
        file = tmp_path / "run.csv"
        file.write_bytes(text.encode(encoding))
        return read_error_map(file, stated)

    return read_text


@pytest.fixture
def complaints(read, tmp_path):
    """Read a file that is refused; give what is said of it, without the folder."""

    def refused(text, stated=Header()):
        with pytest.raises(UnreadableFile) as caught:
            read(text, stated)
        return caught.value.detail.replace(str(tmp_path / "run.csv"), "run.csv").splitlines()

    return refused


def values(found, code):
    fields = ComponentAnswer.of(found.error_map.tables[code]).model_dump()
    return {name: fields[name] for name in ComponentSchema.model_fields.keys() & fields.keys()}


def test_a_map(read):
    found = read(HEAD + "# machine: mcfv5050\n# instrument: laser\n" + ROWS)
    assert (found.machine, found.remarks) == ("mcfv5050", [])
    stated = found.error_map
    assert (stated.label, stated.instrument) == ("Run #1", "laser")
    assert stated.measured_at == datetime(2026, 3, 1, 6, 0, tzinfo=UTC)
    assert stated.temperatures_c == {"x-middle": 20.1}
    assert values(found, "EXX") == {
        "component": "EXX", "positions_mm": [0.0, 50.0], "errors_um": [0.0, 1.25],
    }  # fmt: skip


GERMAN = """\
"# label: Run #1";;
"# measured_at: 2026-03-01T06:00:00Z";;
# temperature x-middle: 20,1 °C;;

Component;Position [mm];Error [µm]
EXX;50,5;1,25

EXX;0;-0,5
;;
"""


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252"])
@pytest.mark.parametrize("ends", ["\n", "\r\n"])
def test_as_spreadsheets_write_it(read, encoding, ends):
    found = read(GERMAN.replace("\n", ends), encoding=encoding)
    assert found.error_map.temperatures_c == {"x-middle": 20.1}
    assert values(found, "EXX")["positions_mm"] == [0.0, 50.5]
    assert values(found, "EXX")["errors_um"] == [-0.5, 1.25]


def test_tabs_and_other_units_in_columns_of_their_own(read):
    found = read(
        HEAD
        + "component\tposition_mm\terror_um\terror_urad\tslope_um_per_m\tvalue_um_per_m\n"
        + "D_x(x)\t0\t1,5\n"
        + "EBX\t0\t\t2,5\n"
        + "SXY\t\t\t\t\t-12\n"
    )
    assert values(found, "EXX")["errors_um"] == [1.5]
    assert values(found, "EBX")["errors_urad"] == [2.5]
    assert values(found, "SXY")["value_um_per_m"] == -12.0


def test_a_value_in_another_units_column(complaints):
    text = "component,position_mm,error_um,error_urad\nEBX,0,1,\nSXY,,1,\n"
    assert complaints(HEAD + text) == [
        "run.csv, line 5, column 3 (error_um): expected EBX in µrad once, in the column "
        "error_urad, got '1'",
        "run.csv, line 6, column 3 (error_um): expected SXY in µm/m once, in the column "
        "error_urad, got '1'",
    ]


def test_squareness_in_the_column_of_angles(read):
    """1 µm/m is 1 µrad, as verifications read it and as arcseconds are converted."""
    found = read(HEAD + "component,position_mm,error_um,error_urad\nEXX,0,1,\nSXY,,,-2.72\n")
    assert values(found, "SXY")["value_um_per_m"] == -2.72
    assert found.remarks == []


def test_squareness_and_slopes_share_their_unit_but_not_two_columns(complaints):
    both = "component,position_mm,slope_um_per_m,value_um_per_m\nSXY,,1,2\n"
    assert complaints(HEAD + both)[0] == (
        "run.csv, line 5, column 4 (value_um_per_m): expected SXY in µm/m once, in the "
        "column slope_um_per_m or value_um_per_m, got '2'"
    )


def test_the_only_column_of_values_holds_every_unit_and_says_so(read):
    found = read(HEAD + ROWS + "EBX,0,3\nSXY,,-12.1\nC0Y2,,1\n".replace("C0Y2,,1\n", ""))
    assert values(found, "EBX")["errors_urad"] == [3.0]
    assert values(found, "SXY")["value_um_per_m"] == -12.1
    assert found.remarks == [
        "values of EBX in error_um are read in µrad",
        "values of SXY in error_um are read in µm/m",
    ]


def test_a_column_without_a_unit_says_in_which_one_it_was_read(read):
    found = read(HEAD + "component,position_mm,error\nEXX,0,1.5\nEBX,0,3\n")
    assert values(found, "EXX")["errors_um"] == [1.5]
    assert found.remarks == [
        "values of EXX in error are read in µm",
        "values of EBX in error are read in µrad",
    ]


@pytest.mark.parametrize(
    ("rows", "complaint"),
    [
        (
            "EXX;0;0,5\nEXX;1.250;2\n",
            "run.csv, line 6, column 2 (position_mm): expected numbers without marks between "
            "thousands, got '1.250' in a file that has a decimal comma in line 5: is it 1250 or "
            "1,250?",
        ),
        (
            "EXX;0;1,250\nEXX;1;2.5\nEXX;2;3,125\n",
            "run.csv, line 5, column 3 (error_um): expected numbers without marks between "
            "thousands, got '1,250' in a file that has a decimal point in line 6: is it 1250 or "
            "1.250?",
        ),
    ],
)
def test_what_may_be_thousands_beside_another_decimal_mark_is_refused(complaints, rows, complaint):
    assert complaints(HEAD + "component;position_mm;error_um\n" + rows) == [complaint]


@pytest.mark.parametrize("rows", ["EXX;0;1.250\nEXX;1;2.5\n", "EXX;0;0,5\nEXX;1.5;1,25\n"])
def test_three_decimals_are_decimals_where_nothing_contradicts(read, rows):
    found = read(HEAD + "component;position_mm;error_um\n" + rows)
    assert 1.25 in values(found, "EXX")["errors_um"]


def test_iso_squareness_keeps_its_name_and_so_its_sign(read):
    found = read(HEAD + "component,error\nC0Y,12.1\n")
    assert found.error_map.tables["SXY"].errors.tolist() == [-12.1]


def test_backward_errors(read):
    text = "component,position_mm,error_um,backward_error_um\nEXX,0,0,1\nEXX,9,2,3\nEYX,0,5,\n"
    found = read(HEAD + text)
    assert values(found, "EXX")["backward_errors_um"] == [1.0, 3.0]
    assert "backward_errors_um" not in values(found, "EYX")


def test_standard_errors(read):
    text = (
        "component,position_mm,error_um,standard_error_um,backward_error_um,"
        "backward_standard_error_um\n"
        "EXX,9,2,0.3,3,0.5\nEXX,0,0,0.2,1,0.4\nEYX,0,5,,,\nSXY,,-12,0.8,,\n"
    )
    found = read(HEAD + text)
    assert values(found, "EXX") == {
        "component": "EXX",
        "positions_mm": [0.0, 9.0],
        "errors_um": [0.0, 2.0],
        "standard_errors_um": [0.2, 0.3],
        "backward_errors_um": [1.0, 3.0],
        "backward_standard_errors_um": [0.4, 0.5],
    }
    assert "standard_errors_um" not in values(found, "EYX")
    assert values(found, "SXY")["standard_error_um_per_m"] == 0.8
    table = found.error_map.tables["EXX"]
    assert table.standard_errors.tolist() == [0.2, 0.3]
    assert table.backward_standard_errors.tolist() == [0.4, 0.5]


def test_standard_errors_in_columns_of_their_own_units(read):
    found = read(
        HEAD
        + "component;Position [mm];Error [µm];Error [µrad];Standard error [µm];"
        + "Standard errors [µrad];standard_error_um/m;slope_um_per_m\n"
        + "EXX;0;1,5;;0,25;;;\nEBX;0;;2,5;;0,5;;\nEYY^x;0;;;;;0,75;3\n"
    )
    assert values(found, "EXX")["standard_errors_um"] == [0.25]
    assert values(found, "EBX")["standard_errors_urad"] == [0.5]
    assert values(found, "EYY^x")["standard_errors_um_per_m"] == [0.75]
    assert found.remarks == []


def test_standard_errors_that_cannot_be(complaints):
    head = "component,position_mm,error_um,standard_error_um\n"
    assert complaints(HEAD + head + "EXX,0,0,-0.2\nEXX,9,1,x\n") == [
        "run.csv, line 5, column 4 (standard_error_um): expected a standard error of EXX in µm, "
        "which is not negative, got '-0.2'",
        "run.csv, line 6, column 4 (standard_error_um): expected a number in µm, got 'x'",
    ]
    assert complaints(HEAD + head + "EXX,0,0,0.2\nEXX,9,1,\n") == [
        "run.csv, line 6: expected a standard error of EXX in every line or in none, unlike line 5",
    ]
    two = "component,position_mm,error_um,standard_error_um,standard_error_urad\n"
    assert complaints(HEAD + two + "EXX,0,0,,0.1\n") == [
        "run.csv, line 5, column 5 (standard_error_urad): expected EXX in µm once, in the column "
        "standard_error_um, got '0.1'",
    ]
    backward = "component,position_mm,error_um,backward_standard_error_um\n"
    (said,) = complaints(HEAD + backward + "EXX,0,0,0.1\n")
    assert "expected backward_errors_um of EXX beside it, got none" in said


def test_one_value_has_no_direction(complaints):
    text = "component,position_mm,error_um,backward_error_um\nSXY,,-12,5\n"
    assert complaints(HEAD + text) == [
        "run.csv, line 5, column 4 (backward_error_um): expected nothing, as SXY has no "
        "direction of approach, got '5'"
    ]


def test_the_command_line_goes_before_the_file(read):
    stated = Header("Run #2", "2026-03-02T06:00:00Z", {"x-middle": 21.5, "spindle": 23.0})
    found = read(HEAD + ROWS, stated).error_map
    assert (found.label, found.measured_at.day) == ("Run #2", 2)
    assert found.temperatures_c == {"x-middle": 21.5, "spindle": 23.0}
    assert same_content(read(ROWS, stated).error_map, found)


def test_what_is_not_read_is_said(read):
    found = read(
        HEAD
        + "# temprature spindle: 20\n# just words\n"
        + ROWS.replace("error_um", "error_um,by").replace("0.0", "0.0,me")
    )
    assert found.remarks[0].startswith("line 4: 'temprature spindle' is not read; what is: label")
    assert found.remarks[1] == "comment lines that are not read: 'just words'"
    assert found.remarks[2] == "columns that are not read: by"


def test_lines_above_the_column_names_are_named_and_not_each_line_below(complaints):
    rows = "".join(f"EXX,{x},1,-\n" for x in range(5))
    above = "Test title,X axis\nMachine,Shop\n"
    assert complaints(f"{above}component,position_mm,error_um,note\n{rows}") == [
        "run.csv, line 1: expected the names of 4 columns, as line 3 has, got 2; what stands above "
        "the column names begins with #; decimal commas need semicolons between the columns"
    ]


@pytest.mark.parametrize(
    ("row", "complaint"),
    [
        ("EXX,100,abc", "column 3 (error_um): expected a number in µm, got 'abc'"),
        ("EXX,100,nan", "column 3 (error_um): expected a number in µm, got 'nan'"),
        ("EXX,1_00,1", "column 2 (position_mm): expected a number in mm, got '1_00'"),
        ("EXX,100,", "column 3 (error_um): expected the error of EXX in µm, got none"),
        ("EXX,,1", "column 2 (position_mm): expected a position of EXX in mm, got none"),
        ("SXY,5,1", "column 2 (position_mm): expected nothing, as SXY is one value without "
                    "position, got '5'"),
        ("EXX,50,1", "expected one value of EXX at 50 mm, got another one in line 6"),
        ("EXX,50,1,5", "expected 3 columns as in line 4, got 4; decimal commas need semicolons "
                       "between the columns"),
    ],
)  # fmt: skip
def test_a_wrong_row_is_named_by_line_and_column(complaints, row, complaint):
    assert f"run.csv, line 7, {complaint}".replace("line 7, expected", "line 7: expected") in (
        complaints(HEAD + ROWS + row + "\n")
    )


def test_an_unknown_component(complaints):
    (complaint,) = complaints(HEAD + ROWS + "EXW,0,1\n")
    assert complaint.startswith("run.csv, line 7, column 1 (component): expected an error compon")
    assert "got 'EXW'; near it: " in complaint


def test_backward_errors_in_some_lines_only(complaints):
    text = "component,position_mm,error_um,backward_error_um\nEXX,0,0,1\nEXX,9,2,\n"
    assert complaints(HEAD + text) == [
        "run.csv, line 6: expected a backward error of EXX in every line or in none, unlike line 5"
    ]


def test_all_that_is_wrong_is_said_at_once_up_to_a_limit(complaints):
    found = complaints(HEAD + ROWS + "EXX,x,1\n" * 20)
    assert len(found) == 9
    assert found[-1] == "run.csv: … and 12 more"


def test_what_is_missing(complaints):
    found = complaints(ROWS)
    assert [line.split(", got")[0] for line in found] == [
        "run.csv: expected a label",
        "run.csv: expected a time with its zone",
        "run.csv: expected every sensor's temperature in °C",
    ]
    assert "`# temperature x-middle: 20.1` or give --temperature" in found[2]


@pytest.mark.parametrize("time", ["2026-03-01T06:00:00", "yesterday"])
def test_a_time_without_its_zone(complaints, time):
    (complaint,) = complaints(HEAD.replace("2026-03-01T07:00:00+01:00", time) + ROWS)
    assert complaint.endswith(f"expected measured_at with its zone such as 2026-03-01T06:00:00Z, "
                              f"got {time!r}")  # fmt: skip


@pytest.mark.parametrize(
    ("again", "what", "got"),
    [
        ("temperature x-middle: 24.3", "the temperature of x-middle", "20.1 and 24.3"),
        ("label: Run #2", "label", "Run #1 and Run #2"),
        (
            "measured_at: 2026-03-01T09:00:00Z",
            "measured_at",
            "2026-03-01T07:00:00+01:00 and 2026-03-01T09:00:00Z",
        ),
    ],
)
def test_what_is_stated_otherwise_is_not_taken_from_the_last_line(complaints, again, what, got):
    """A sensor's line that was copied and not renamed: the map would lie at another temperature."""
    (complaint,) = complaints(f"{HEAD}# {again}\n{ROWS}")
    assert complaint == f"run.csv, line 4: expected {what} once, got {got}"


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "run.csv: expected a line of column names and lines of values, got none"),
        (HEAD + "a,b\n1,2\n", "run.csv, line 4: expected the columns component, position_mm and"),
        (HEAD + "component,position_mm,error_um\n", "run.csv: expected lines of values, got none"),
        (HEAD + "component,error_um\nEXX,1\n", "run.csv, line 4: expected a column position_mm"),
    ],
)
def test_files_without_what_they_need(complaints, text, complaint):
    assert complaints(text)[0].startswith(complaint)


def test_what_can_be_no_error_is_refused(complaints):
    (complaint,) = complaints(HEAD + ROWS + "EXX,99,5e9\n")
    assert "line 7, column 3 (error_um): expected errors within ±10000 µm, got 5e+09 µm" in (
        complaint
    )


def test_what_the_service_would_refuse_is_refused_here(complaints):
    (complaint,) = complaints(HEAD + "# repeatability_um: -1\n" + ROWS)
    assert complaint.startswith("run.csv: repeatability_um: expected ")


def test_other_units_are_converted_in_decimal(read):
    found = read(
        HEAD
        + "component;Position [m];Error [mm];Error [arcsec];standard error [mm];"
        + "backward_error_mm\nEXX;0,05;0,0012;;0,0001;-0,0003\nEBX;0,05;;1;;\nSXY;;;2;;\n"
    )
    assert values(found, "EXX") == {
        "component": "EXX",
        "positions_mm": [50.0],
        "errors_um": [1.2],
        "standard_errors_um": [0.1],
        "backward_errors_um": [-0.3],
    }
    # One second of arc is 4.848 µrad.
    assert values(found, "EBX")["errors_urad"] == pytest.approx([4.8481368])
    assert values(found, "SXY")["value_um_per_m"] == pytest.approx(9.6962736)


def test_a_column_in_mm_holds_lengths_alone(complaints):
    (complaint,) = complaints(HEAD + "component,position_mm,error_mm\nEXX,0,0.01\nEBX,0,1\n")
    assert complaint == (
        "run.csv, line 6, column 3 (error_mm): expected EBX in µrad once, in the column "
        "error_urad, got '1'"
    )


def test_millimetres_under_um_are_refused(complaints, read):
    """In the words in which the methods warn of them."""
    small = "component,position_mm,error_um\nEXX,0,0\nEXX,50,0.0012\nEXX,100,-0.0021\n"
    (complaint,) = complaints(HEAD + small)
    assert complaint.startswith(
        "run.csv: No reading is larger than 0.0021 µm (error_um): they may be in mm instead of µm"
    )
    assert "Call the column error_mm" in complaint
    assert values(read(HEAD + small.replace("error_um", "error_mm")), "EXX")["errors_um"] == [
        0.0, 1.2, -2.1,
    ]  # fmt: skip
    # A map of zeros, as of a reference state, is none of millimetres; nor is one of angles.
    read(HEAD + "component,position_mm,error_um\nEXX,0,0\nEXX,50,0\n")
    read(HEAD + "component,position_mm,error_urad\nEBX,0,0.001\n")


def test_positions_stand_in_one_column(complaints):
    head = "component,position_mm,Position [m],error_um\n"
    assert complaints(HEAD + head + "EXX,0,0,0.2\n") == [
        "run.csv, line 4: expected position in one column, got position_mm and Position [m]"
    ]


def test_what_is_no_text_is_said_to_be_none(tmp_path):
    picture = tmp_path / "run.csv"
    picture.write_bytes(b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR,,\n")
    with pytest.raises(UnreadableFile, match=r"expected text .* got a file of another kind"):
        read_text(picture)


@pytest.mark.parametrize("value", ["Fehler", "Abweichung", "Messwert"])
def test_a_german_file_says_the_same(read, complaints, value):
    head = "# Bezeichnung: Run #1\n# measured_at: 1.3.2026 07:00 +01:00\n"
    head += "# Temperatur x-middle: 20,1\n"
    rows = f"Komponente;Position [mm];{value} [µm]\nEXX;0;0,0\nEXX;50;1,25\n"
    if value == "Messwert":  # of a check: a map has errors
        assert "expected the columns component" in complaints(head + rows)[0]
    else:
        assert same_content(read(head + rows).error_map, read(HEAD + ROWS).error_map)


def test_a_date_with_the_day_first_lacks_its_zone_too(complaints):
    (said,) = complaints(HEAD.replace("2026-03-01T07:00:00+01:00", "28.11.2026 10:30") + ROWS)
    assert said.endswith("such as 2026-03-01T06:00:00Z, got '28.11.2026 10:30'")
