"""Text files: every limit is refused with a sentence, and twice as long takes twice as long."""

import sys
from pathlib import Path

import pytest

from app.api.methods.registry import METHODS
from app.api.uploads import parse_error_map
from app.controllers import lines
from app.controllers.format import ControllerFile
from app.controllers.registry import FORMATS
from app.decimal_text import LONGEST_NUMBER, read_number
from app.errors import InvalidContent
from app.files import delimited_text
from app.files.csv_comments import Header
from app.files.csv_verification import parse_csv_verification
from app.files.delimited_text import Problems, UnreadableFile, parse_delimited, split_lines
from app.files.instrument_files.renishaw_rtl import read_renishaw_rtl
from app.geometry.components import unknown_component

FILE = Path("run.csv")
STATED = Header("Run #1", "2026-03-01T06:00:00Z", {"x-middle": 20.1})

ENDS_OF_LINES_FOR_PYTHON_ALONE = "\v\f\x1c\x1d\x1e\x85\u2028\u2029"


@pytest.mark.parametrize("end", ENDS_OF_LINES_FOR_PYTHON_ALONE)
def test_a_line_ends_where_an_editor_ends_it(end):
    assert split_lines(f"a{end}b\r\nc\rd\ne") == [f"a{end}b", "c", "d", "e"]
    table = parse_delimited(f"name,value\nleft{end}right,1\n", Problems(FILE))
    assert [row.cells for row in table.rows] == [[f"left{end}right", "1"]]


def test_a_controller_s_file_with_such_a_character_is_refused():
    for end in ENDS_OF_LINES_FOR_PYTHON_ALONE:
        for name in FORMATS:
            options = FORMATS[name].options.model_construct(sign="error", counts_per_mm=1000.0)
            with pytest.raises(InvalidContent):
                FORMATS[name].parse([ControllerFile("x.comp", f"{end}\nX EXX\n0 0\n")], options)


def refusal_of(text):
    with pytest.raises(UnreadableFile) as refused:
        parse_delimited(text, Problems(FILE))
    return refused.value.detail


def test_a_table_s_limits_are_said():
    assert refusal_of("a\n" + "1" * (delimited_text.LONGEST_LINE + 1)) == (
        "run.csv, line 2: expected at most 20000 characters, got 20001"
    )
    assert refusal_of("a,b\n1," + "x" * 1001) == (
        "run.csv, line 2: expected cells of at most 1000 characters"
    )
    assert refusal_of("x" * 1001 + ",b\n1,2") == (
        "run.csv, line 1: expected cells of at most 1000 characters"
    )
    assert refusal_of(",".join(["a"] * 1001) + "\n1\n") == (
        "run.csv, line 1: expected at most 1000 columns, got 1001"
    )
    assert refusal_of("# a: b\n" * 1001 + "a\n1\n") == (
        "run.csv: expected at most 1000 comment lines, got 1001"
    )
    assert refusal_of(",".join("ab" * 500) + "\n" + "1\n" * 1501) == (
        "run.csv: expected at most 1500000 cells, lines by columns, got 1501 by 1000"
    )


def test_lines_are_counted_before_they_are_split(monkeypatch):
    monkeypatch.setattr(delimited_text, "MOST_LINES", 5_000)
    assert refusal_of("a\n" * 5_001) == "run.csv: expected at most 5000 lines, got more"
    assert len(parse_delimited("a\r\n" * 6_000, Problems(FILE), is_sent=False).rows) == 5_999


@pytest.mark.parametrize("first", ['""', '"",""', "sep=|\n||", '" "'])
def test_a_line_of_nothing_names_no_columns(first):
    refusal_of(f"{first}\n1\n")


def test_names_near_a_wrong_one_are_looked_for_where_they_are_shown(monkeypatch):
    """Each takes as long as a hundred lines: 500,000 wrong ones would take minutes."""
    asked = []
    monkeypatch.setattr(
        "app.geometry.components.difflib.get_close_matches",
        lambda name, *_, **__: asked.append(name) or [],
    )
    rows = "".join(f"E{i},0,0\n" for i in range(1000))
    with pytest.raises(UnreadableFile):
        parse_error_map({"": f"component,position_mm,error_um\n{rows}"}, FILE, STATED)
    assert len(asked) == delimited_text.MOST_PROBLEMS


def test_a_long_name_of_a_component_is_cut_where_it_is_repeated():
    assert len(unknown_component("E" * 2_000_000)) < 300


def test_a_long_number_is_none():
    assert read_number("1" * LONGEST_NUMBER) is not None
    assert read_number("1" * (LONGEST_NUMBER + 1)) is None


def test_problems_are_counted_and_only_the_first_are_held():
    problems = Problems(FILE)
    for line in range(100_000):
        problems.add("expected a number", line)
        problems.add_once("expected a column", 1)
    assert len(problems.first) == delimited_text.MOST_PROBLEMS
    assert problems.listed()[-1] == "run.csv: … and 99993 more"


def test_a_controller_s_line_is_no_longer_than_a_control_writes_it():
    long = "N1 " + "1" * (lines.LONGEST_LINE - 3)
    assert [line.text for line in lines.lines_of("x", long)] == [long]
    with pytest.raises(InvalidContent, match="at most 1000 characters"):
        list(lines.lines_of("x", long + "1"))
    with pytest.raises(InvalidContent, match="a number"):
        lines.Line("x", 1, "").number_of("1" * (lines.LONGEST_NUMBER + 1), "a value")


def steps_of(read, *given):
    """Count the lines and calls of Python that a function runs."""
    steps = 0

    def count(_frame, _event, _argument):
        nonlocal steps
        steps += 1
        return count

    before = sys.gettrace()
    sys.settrace(count)
    try:
        read(*given)
    except (UnreadableFile, InvalidContent):
        pass
    finally:
        sys.settrace(before)
    return steps


def measurement(method):
    return lambda text: METHODS[method].read(text, header=STATED)


RTL = (
    "HEADER::\nFile type: rtl\nOwner: Linear\nTARGET DATA::\nFiletype: ISO\nTarget-count: 2\n"
    "Targets: 0 50\nFlags: 0 1 2 0\nRUNS::\nRun-count: 1\n{}DEVIATIONS::\nRun Target Data:\n{}EOF::"
)

GROWING = {
    "same place again": (
        measurement("positioning"),
        lambda n: "# axis: x\ntarget_mm,forward_um\n" + "0,1\n" * n,
    ),
    "a run in each line": (
        measurement("positioning"),
        lambda n: (
            "# axis: x\nrun,target_mm,forward_um\n" + "".join(f"{i},{i},1\n" for i in range(n))
        ),
    ),
    "columns of states": (
        lambda text: parse_csv_verification({"": text}, FILE),
        lambda n: (
            "time,component,position_mm,measured_um" + "".join(f",state s{i % 7}" for i in range(n))
        ),
    ),
    "wrong in each line": (
        lambda text: parse_csv_verification({"": text}, FILE),
        lambda n: "time,component,measured_um\n" + "x,y,z\n" * n,
    ),
    "no column for it": (
        lambda text: parse_error_map({"": text}, FILE, STATED),
        lambda n: "component,error_um\n" + "".join(f"EXX,{i}\nq,1\n" for i in range(n)),
    ),
    "comments": (
        lambda text: parse_error_map({"": text}, FILE, STATED),
        lambda n: (
            "".join(f"# label {i}: a\n# temperature s{i}: 20\n" for i in range(n))
            + "component,position_mm,error_um\nEXX,0,1\nEXX,5,1\n"
        ),
    ),
    "columns of sensors": (
        measurement("thermal-drift"),
        lambda n: "# test: spindle\ntime,x_um" + "".join(f",temperature {i}" for i in range(n)),
    ),
    "numbered runs": (
        measurement("positioning"),
        lambda n: "# axis: x\ntarget_mm" + "".join(f",forward_{i}_um" for i in range(n)) + "\n0\n",
    ),
    "sections": (
        lambda text: read_renishaw_rtl(text, FILE, "x"),
        lambda n: RTL.format("".join(f"A{'B' * i}::\n" for i in range(n)), ""),
    ),
    "values": (
        lambda text: read_renishaw_rtl(text, FILE, "x"),
        lambda n: RTL.format("", "1 1 0.5\n" * n),
    ),
}


@pytest.mark.parametrize("kind", GROWING)
def test_a_file_of_four_times_the_length_takes_four_times_the_steps(kind):
    read, text = GROWING[kind]
    few, many = (steps_of(read, text(n)) for n in (60, 240))
    assert many < 7 * few


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize(
    "line",
    [
        "$AN_CEC[0,{}]=0.1", "$AA_ENC_COMP[0,{},AX1]=0.1", "axLSCompDirPos[{}][0] 1", "N{}P1",
        "P{} X {} EX 0", "{} 0 0", "{} 0", "X {}", "P16 NPOINTS{} = 1", "[EXX]",
    ],
)  # fmt: skip
def test_so_does_a_controller_s_file(name, line):
    options = FORMATS[name].options.model_construct(sign="error", counts_per_mm=1000.0)

    def read(n):
        content = "\n".join(line.replace("{}", str(i + 1)) for i in range(n))
        FORMATS[name].parse([ControllerFile("x.comp", f"%\n{content}\n%\nM17")], options)

    assert steps_of(read, 240) < 7 * max(steps_of(read, 60), 300)


@pytest.mark.parametrize("position", ["1e30", "-2000000"])
def test_a_position_that_no_map_may_have_is_refused_as_the_service_does(position):
    with pytest.raises(
        UnreadableFile, match=r"positions_mm\.\d: expected at (most|least) -?1e\+06"
    ):
        parse_error_map(
            {"": f"component,position_mm,error_um\nEXX,{position},1\nEXX,5,1\n"}, FILE, STATED
        )
