"""What would be read wrongly is refused, with what was expected; no text makes a parser fall."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.controllers.export import export
from app.controllers.format import CHECK_FILE, ControllerFile
from app.controllers.registry import FORMATS, format_named, options_of
from app.controllers.thermap_csv import COLUMNS
from app.errors import InvalidContent, UnknownThing
from tests.controllers.example_tables import curve, error_table, options_for, read_back, tables

PLAIN = error_table(
    curve("EXX", [-100.0, 0.0, 100.0, 200.0], [-4.0, 0.0, 3.0, 5.0]),
    curve("EYY", [-100.0, 0.0, 100.0, 200.0], [1.0, 0.0, 2.0, -3.0]),
)


def parse(name, content, file="x.comp", **options):
    return format_named(name).parse([ControllerFile(file, content)], options_for(name, **options))


def refused(name, content, match, file="x.comp", **options):
    with pytest.raises(InvalidContent, match=match):
        parse(name, content, file, **options)


def test_linuxcnc_refuses_what_the_controller_drops_without_a_word():
    refused("linuxcnc", "0 0 0\n# head\n100 0 0\n", r"line 2: expected three numbers")
    refused("linuxcnc", "0 0 0\n\n100 0 0\n", r"line 2: .* got a blank line")
    refused("linuxcnc", "0, 0, 0\n", "expected three numbers")
    refused("linuxcnc", "\ufeff0 0 0\n", "a byte-order mark")
    refused("linuxcnc", "0 nan 0\n", "expected three numbers")
    refused("linuxcnc", "0 0 0\n0 0 0\n", "increasing nominal positions")
    refused("linuxcnc", "0 0 0\n200 200 200\n", "are these positions of type 0", type=1)
    refused("linuxcnc", "0 0 0\n200 0.01 0.01\n", "are these trims of type 1", type=0)
    refused("linuxcnc", "".join(f"{i} 0 0\n" for i in range(257)), "at most 256 rows")
    refused("linuxcnc", "0 0 0\n", "the name of an axis", file="spindle.txt")


def test_linuxcnc_settings_say_type_and_joint():
    files = [
        ControllerFile("left.comp", "0 0.01 0\n100 100.02 100\n"),
        ControllerFile(
            "m.ini",
            "[TRAJ]\nLINEAR_UNITS = mm\nCOMP_FILE_TYPE = 1\n[JOINT_1]\nCOMP_FILE = left.comp\n",
        ),
    ]
    read = format_named("linuxcnc").parse(files, options_for("linuxcnc"))
    # Without COMP_FILE_TYPE of the joint the controller reads type 0: nominal and actual.
    assert read.curves["EYY"].errors == pytest.approx([10.0, 20.0])
    assert read.warnings == []


def test_a_cut_off_file_is_refused():
    for name in ("siemens-cec", "siemens-enc-comp", "siemens-temperature", "fanuc", "heidenhain",
                 "mdsi", "fagor", "etalon"):  # fmt: skip
        options = options_for(name)
        for file in export(format_named(name), PLAIN, options).files:
            if file.name == CHECK_FILE:
                continue
            lines = file.content.splitlines(keepends=True)
            cut = "".join(lines[: len(lines) - (2 if name == "mdsi" else 1)])
            with pytest.raises(InvalidContent, match="expected"):
                format_named(name).parse([ControllerFile(file.name, cut)], options)


def test_siemens_refuses_a_gap_and_a_step_that_does_not_fit():
    (file, _) = export(format_named("siemens-cec"), PLAIN, options_for("siemens-cec")).files
    gap = file.content.replace("$AN_CEC[0,1]=+0.0000\n", "")
    refused("siemens-cec", gap, r"got no point 1: the controller would keep an old value")
    odd = file.content.replace("STEP[0]=+100", "STEP[0]=+90")
    refused("siemens-cec", odd, "whole sections")
    twice = file.content.replace("$AN_CEC[0,1]=", "$AN_CEC[0,0]=")
    refused("siemens-cec", twice, "each point once")
    modulo = file.content.replace("IS_MODULO[0]=0", "IS_MODULO[0]=1")
    refused("siemens-cec", modulo, "repeats")
    tail = file.content + "$AN_CEC[0,0]=+0.5000\n"
    refused("siemens-cec", tail, "nothing after the end")


def test_heidenhain_refuses_positions_that_its_head_does_not_give():
    content = "BEGIN TX.COM DATUM: -200.0 DIST: 16\nNR 1 = f ( )\n0 +0.0 +0\n1 +6.5536 +0\n[END]\n"
    refused("heidenhain", content, "the position -200 mm that DATUM and DIST give")


def test_a_file_of_another_format_is_refused():
    for name in FORMATS:
        for other in FORMATS:
            exported = export(format_named(other), PLAIN, options_for(other))
            files = [f for f in exported.files if f.name != CHECK_FILE]
            if name == other:
                continue
            with pytest.raises(InvalidContent):
                format_named(name).parse(files, options_for(name))


DIGITS = "9" * 5000


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("heidenhain", f"BEGIN TX.COM DATUM: +0.0 DIST: {DIGITS}\nNR 1 = f ( )\n[END]\n"),
        ("heidenhain", f"BEGIN T.CMA ACT: {DIGITS}\nNR 1\n0 TX\n[END]\n"),
        ("heidenhain", "BEGIN T.CMA ACT: 0\nNR ²\n0 TX\n[END]\n"),
        ("heidenhain", "BEGIN T.CMA ACT: 0\n[END]\n"),
        ("siemens-cec", "$AN_CEC[²,0]=0\nM17\n"),
        ("siemens-cec", f"$AN_CEC[{DIGITS},0]=0\nM17\n"),
        ("mdsi", f"axLSCompCount[0] {DIGITS}\n"),
        ("mdsi", "axLSCompCount[0] 2\naxLSCompSpacing[0] 999999999999999\naxLSCompPosMin[0] 0\n"),
        ("fanuc", f"%\nN3620Q1A1P{DIGITS}\n%\n"),
        ("linuxcnc", "0 ٣ 0\n"),
        ("linuxcnc", f"0 {DIGITS} 0\n"),
        ("csv", COLUMNS + "\n" + "x" * 200_000 + "\n"),
        ("etalon", f"[EXX]\nGridpoints = {{\n{DIGITS} 0\n}}\n"),
    ],
)
def test_absurd_numbers_are_refused(name, content):
    refused(name, content, "expected")


LETTERS = st.text(alphabet="0123456789+-.,;:%#[]{}()=$ \n\tNPQAXYZEx_/", max_size=120)


@pytest.mark.parametrize("name", FORMATS)
@given(content=st.one_of(st.text(max_size=200), LETTERS), file=st.sampled_from(["x.comp", "t.ini"]))
def test_no_text_makes_a_parser_fall(name, content, file):
    try:
        read = parse(name, content, file)
    except InvalidContent as error:
        said = error.detail
    else:
        said = "expected" if read.curves else "accepted, and nothing is in it"
    assert "expected" in said


@pytest.mark.slow
@pytest.mark.parametrize("name", [n for n in FORMATS if n not in ("linuxcnc",)])
@given(table=tables(), data=st.data())
def test_a_file_with_a_line_less_is_another_table_or_refused(name, table, data):
    """Never is a damaged file read as if it were whole: values, places or refusal."""
    options = options_for(name)
    found = export(format_named(name), table, options)
    whole = read_back(name, found, options)
    files = [f for f in found.files if f.role == "table" or name == "siemens-temperature"]
    file = data.draw(st.sampled_from([f for f in files if f.name != CHECK_FILE]))
    lines = [i for i, line in enumerate(file.content.splitlines()) if says_something(line)]
    place = data.draw(st.sampled_from(lines))
    kept = [line for i, line in enumerate(file.content.splitlines()) if i != place]
    damaged = ControllerFile(file.name, "\n".join(kept) + "\n", file.role, file.axis)
    others = [f for f in found.files if f.name not in (CHECK_FILE, file.name)]
    try:
        read = format_named(name).parse([damaged, *others], options)
    except InvalidContent:
        return
    # Formats that list their positions without a count can lose a row unseen: our CSV, Etalon and
    # ISG; in the others nothing but the unit may go without a trace.
    if name in ("csv", "etalon", "isg-csv"):
        return
    gone = file.content.splitlines()[place]
    last_row = name == "heidenhain" and place == max(lines) - 1  # no count says that it is gone
    assert last_row or "INCHES" in gone
    assert set(read.curves) == set(whole.curves)


def says_something(line):
    return (
        bool(line.strip())
        and not line.startswith((";", "#", "//"))
        and "CHANDATA" not in line
        and not line.startswith("%_N_")
    )


def test_an_unknown_controller_and_unknown_options_are_told():
    with pytest.raises(UnknownThing, match="expected a controller of linuxcnc, siemens-cec"):
        format_named("haas")
    with pytest.raises(InvalidContent, match=r"options\.speed: expected the options of linuxcnc"):
        options_of(format_named("linuxcnc"), {"speed": 3})
    with pytest.raises(InvalidContent, match=r"options\.type: expected 0 or 1, got '2'"):
        options_of(format_named("linuxcnc"), {"type": 2})


def test_what_a_format_cannot_take_is_refused_and_nothing_is_written():
    def refuses(name, table, match, **options):
        with pytest.raises(InvalidContent, match=match):
            export(format_named(name), table, options_for(name, **options))

    steep = error_table(curve("EXX", [0.0, 100.0], [0.0, 900.0]))
    refuses("fanuc", steep, "increments of at most 7 units", spacing_mm=100.0)
    refuses("fanuc", steep, "got 900", magnification=1, spacing_mm=100.0)
    refuses("siemens-cec", PLAIN, "spacing of at least 33.3334 mm for at most 10", spacing_mm=1.0,
            most_points=10)  # fmt: skip
    refuses("siemens-cec", PLAIN, "at most 1 tables", most_tables=1)
    refuses("siemens-cec", PLAIN, "whole multiple of 0.0001 mm", spacing_mm=0.00015)
    refuses("siemens-cec", PLAIN, "an entry of axis y", axes={"x": "AX1"})
    refuses("heidenhain", PLAIN, "a power from 14 to 23", power=10)
    refuses("fagor", error_table(curve("EXX", [0.0, 2e5], [0.0, 1.0])), "within ±99999.9999 mm")
    refuses("linuxcnc", PLAIN, "there is no map of it", components=["EZZ"])
    straight = error_table(curve("EYX", [0.0, 100.0], [0.0, 1.0]))
    refuses("linuxcnc", straight, "can hold .EXX, EYY, EZZ., got EYX")
    refuses("linuxcnc", error_table(curve("EYX", [0.0, 1.0], [0.0, 1.0]),
                                    curve("EXX", [0.0, 1.0], [0.0, 1.0])),
            "has no table for it", components=["EYX"])  # fmt: skip


def test_fagor_refuses_a_negative_side_that_the_controller_would_not_see():
    table = error_table(curve("EXX", [0.0, 100.0], [0.0, 5.0], [0.0, 0.0]))
    with pytest.raises(InvalidContent, match="would take those of the positive direction"):
        export(format_named("fagor"), table, options_for("fagor"))


def test_values_beyond_what_a_machine_can_have_are_refused():
    (file, _) = export(format_named("siemens-cec"), PLAIN, options_for("siemens-cec")).files
    micrometres = file.content.replace("=-0.0040", "=-40.0")
    refused("siemens-cec", micrometres, "within ±10 mm")
    assert np.isfinite(parse("siemens-cec", file.content).curves["EXX"].errors).all()
