"""Renishaw's linear .rtl: read as it is known, refused wherever something would be guessed."""

import math
import re
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.files.csv_comments import Header
from app.files.delimited_text import UnreadableFile, read_text
from app.files.instrument_files import format_of_text
from app.files.instrument_files.renishaw_rtl import read_renishaw_rtl
from tests.files.error_map_files import read_error_map

NAME = Path("x.rtl")

BOTH_WAYS = """\
HEADER::
File type  : rtl
Owner      : Linear
Version no : 12

TARGET DATA::
Filetype  : ISO
Target-count: 6
Targets :
  0.0000  98.5000  203.2500  301.0000  397.7500
  500.0000
Flags: 0 0 2 0

USER-TEXT::
Machine: MCFV 5050
Serial No: 4711
Date: 2026-03-01 06:30:00
By: K.
Axis: X
Location: hall 2
TITLE: cold

RUNS::
Run-count: 4

DEVIATIONS::
Run Target Data:
    1    1    0.000000
    1    2    0.400000
    1    3    1.100000
    1    4    1.900000
    1    5    2.600000
    1    6    3.100000
    2    1    -1.000000
    2    2    -0.600000
    2    3    0.100000
    2    4    0.900000
    2    5    1.600000
    2    6    2.100000
    3    1    0.200000
    3    2    0.500000
    3    3    1.300000
    3    4    2.000000
    3    5    2.800000
    3    6    3.300000
    4    1    -0.900000
    4    2    -0.500000
    4    3    0.300000
    4    4    1.100000
    4    5    1.700000
    4    6    2.300000
EQUIPMENT::
Serial: 12
ENVIRONMENT::
Air temp : 20.1
EOF::
"""

FORWARD = [[0.0, 0.4, 1.1, 1.9, 2.6, 3.1], [0.2, 0.5, 1.3, 2.0, 2.8, 3.3]]
BACKWARD = [[-1.0, -0.6, 0.1, 0.9, 1.6, 2.1], [-0.9, -0.5, 0.3, 1.1, 1.7, 2.3]]
TARGETS = [0.0, 98.5, 203.25, 301.0, 397.75, 500.0]


def one_way(even="0.0"):
    """A file of one direction, whose even runs hold something."""
    text = BOTH_WAYS.replace("Flags: 0 0 2 0", "Flags: 0 1 2 0")
    lines = []
    for line in text.splitlines():
        words = line.split()
        if len(words) == 3 and words[0] in "24":
            line = f"{words[0]} {words[1]} {even}"
        lines.append(line)
    return "\n".join(lines)


def read(text, **options):
    return read_renishaw_rtl(text, NAME, **options)


def refused(text, **options):
    with pytest.raises(UnreadableFile) as found:
        read(text, **options)
    return found.value.detail


def test_both_directions():
    found = read(BOTH_WAYS)
    assert found.body == {
        "label": "cold",
        "instrument": "Renishaw laser, .rtl",
        "axis": "x",
        "targets_mm": TARGETS,
        "forward_um": FORWARD,
        "backward_um": BACKWARD,
    }
    assert found.machine is None
    said = "\n".join(found.remarks)
    assert "0 µm at 0 mm, with the instrument's own screen" in said
    assert "Machine 'MCFV 5050', Serial No '4711', Date '2026-03-01 06:30:00'" in said
    assert "not read: EQUIPMENT::, ENVIRONMENT::" in said


@pytest.mark.parametrize(
    "text",
    [
        BOTH_WAYS.replace("\n", "\r\n"),
        "\ufeff" + BOTH_WAYS,
        BOTH_WAYS.replace(".", ","),
        BOTH_WAYS.replace(" : ", ":").replace("Target-count", "target-COUNT").lower(),
        BOTH_WAYS.replace("::", "  ::").replace("    ", "\t"),
        BOTH_WAYS.replace("Axis: X", "Axis: X-axis of the machine"),
        BOTH_WAYS.replace("Axis: X", "Axis: x1"),
    ],
    ids=["crlf", "bom", "decimal commas", "letters and colons", "blanks", "words", "number"],
)
def test_spelling_does_not_matter(text):
    body = read(text).body
    assert (body["axis"], body["targets_mm"]) == ("x", TARGETS)
    assert (body["forward_um"], body["backward_um"]) == (FORWARD, BACKWARD)


@pytest.mark.parametrize(
    ("page", "machine", "title"),
    [
        ("gbk", "立式加工中心", "X轴补偿前"),
        ("gb18030", "卧式加工中心", "补偿后 20 ℃"),
        ("cp932", "横形マシニングセンタ", "X軸補正前"),
        ("cp932", "立形", "補正後"),
        ("cp1252", "Fräsmaschine Größe 2", "Überprüfung kalt"),
        ("cp1252", "Centro de usinagem", "MEDIÇÃO à froid"),
        ("utf-8", "立式加工中心", "X轴补偿前"),
        ("utf-16", "立式加工中心", "X轴补偿前"),
    ],
)
def test_free_text_of_other_code_pages_is_read(tmp_path, page, machine, title):
    file = tmp_path / "x.rtl"
    text = BOTH_WAYS.replace("MCFV 5050", machine).replace("TITLE: cold", f"TITLE: {title}")
    file.write_bytes(text.encode(page))
    found = read_renishaw_rtl(read_text(file), file)
    assert found.body["label"] == title
    assert any(f"Machine {machine!r}" in remark for remark in found.remarks)


def test_text_that_cannot_be_told_is_said_to_be_unread(tmp_path):
    file = tmp_path / "x.rtl"
    text = BOTH_WAYS.replace("TITLE: cold", "TITLE: до компенсации")
    file.write_bytes(text.encode("cp1251"))
    found = read_renishaw_rtl(read_text(file), file)
    assert "label" not in found.body
    assert any("code page that cannot be told" in remark for remark in found.remarks)
    table = tmp_path / "x.csv"
    rows = "component,position_mm,error_um\nEXX,0,0\n"
    table.write_bytes(f"# label: компенсация\n{rows}".encode("cp1251"))
    with pytest.raises(UnreadableFile, match="line 1: expected text in UTF-8"):
        read_error_map(table, Header("x", "2026-03-01T06:00:00Z", {"bed": 20.0}))


def test_decreasing_targets_turn_the_directions():
    turned = BOTH_WAYS.replace("  0.0000  98.5000  203.2500  301.0000  397.7500\n  500.0000",
                               "  500.0 397.75 301.0 203.25 98.5 0.0")  # fmt: skip
    found = read(turned)
    assert found.body["targets_mm"] == TARGETS
    assert found.body["forward_um"] == [run[::-1] for run in BACKWARD]
    assert found.body["backward_um"] == [run[::-1] for run in FORWARD]
    assert any("the targets decrease" in remark for remark in found.remarks)
    assert "expected targets that increase" in refused(
        turned.replace("Flags: 0 0 2 0", "Flags: 0 1 2 0")
    )


def test_zeros_in_a_file_of_one_direction_are_no_measurement():
    found = read(one_way())
    assert found.body["forward_um"] == FORWARD
    assert "backward_um" not in found.body
    assert any("2 even runs of nothing but zeros left out" in remark for remark in found.remarks)
    every = read(one_way("0.7"))
    assert every.body["forward_um"] == [FORWARD[0], [0.7] * 6, FORWARD[1], [0.7] * 6]


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (": Linear", ": Angular", "line 3: expected Owner: Linear .*'Angular'"),
        ("Run-count: 4", "Run-count: 4\nRun-count: 6", "expected Run-count: once in RUNS::"),
        ("File type  : rtl", "File type  : rta", "line 2: expected File type: rtl .*'rta'"),
        ("Owner      : Linear\n", "", "line 1: expected Owner: Linear in HEADER::, got none"),
        ("Filetype  : ISO", "Filetype  : VDI", "expected Filetype: ISO .*'VDI'"),
        ("Flags: 0 0 2 0", "Flags: 0 2 2 0", "line 12: expected Flags: 0 0 2 0 .*got '0 2 2 0'"),
        ("Flags: 0 0 2 0\n", "", "expected Flags: .*got none"),
        ("Target-count: 6", "Target-count: 7", "expected 7 targets as Target-count says, got 6"),
        ("Target-count: 6", "Target-count: six", "Target-count as a number from 1, got 'six'"),
        ("301.0000", "203.2500", "only increase, or only decrease"),
        ("301.0000", "3O1.0000", "line 10: expected a target position in mm, got '3O1.0000'"),
        ("Axis: X", "Axis: X and Y", r"line 19: expected Axis: x, y or z, got 'X and Y'"),
        ("Axis: X\n", "", "expected Axis: x, y or z, got none"),
        ("Run-count: 4", "Run-count: 3", "even Run-count in a file of both directions, got 3"),
        ("Run-count: 4", "Run-count: 6", "6 runs and 6 targets, got 24: none of run 5, target 1"),
        ("Run-count: 4", "Run-count: 999999", "got 24"),
        ("    3    2    0.500000\n", "", "got 23: none of run 3, target 2"),
        ("    3    2    0.5", "    3    1    0.5", "a target from 1 to 6, each once"),
        ("    3    2    0.5", "    3    9    0.5", "a run from 1 to 4 and a target from 1 to 6"),
        ("    3    2    0.500000", "    3    2    0,500000", "comma in line .* and a point in"),
        ("    3    2    0.500000", "    3    2    nan", "expected a deviation in µm, got 'nan'"),
        ("    3    2    0.500000", "    3    2", "expected run, target and deviation"),
        ("Run Target Data:", "Target Run Data:", "expected Run Target Data:"),
        ("EOF::\n", "", r"got no EOF:: \(is the file cut off\?\)"),
        ("EOF::\n", "EOF::\nmore", "expected nothing after EOF::, got 'more'"),
        ("RUNS::", "DEVIATIONS::", "expected DEVIATIONS:: once, came again"),
        ("HEADER::\n", "target_mm,deviation_um\n", "expected nothing before HEADER::"),
    ],
)  # fmt: skip
def test_what_would_be_guessed_is_refused(old, new, said):
    assert BOTH_WAYS.count(old) >= 1
    assert re.search(said, refused(BOTH_WAYS.replace(old, new, 1)))


@pytest.mark.parametrize("count", ["Run-count: 0", "Run-count: 400000000"])
def test_a_wrong_number_of_runs_is_said_once(count):
    said = refused(BOTH_WAYS.replace("Run-count: 4", count))
    assert "expected Run-count as a number from 1" in said
    assert "expected a run from" not in said


def test_the_axis_may_be_stated():
    text = BOTH_WAYS.replace("Axis: X", "Axis: spindle side")
    assert read(text, axis="Y").body["axis"] == "y"
    assert "expected axis x, y or z, got 'w'" in refused(text, axis="w")


def test_files_are_known_by_name_or_beginning():
    for name, content, known in (
        ("a.RTL", "x", True), ("a.txt", BOTH_WAYS, True), ("a.csv", "target_mm\n", False),
    ):  # fmt: skip
        assert (format_of_text(Path(name), content) is not None) is known


def test_a_file_that_is_cut_off_is_refused():
    for end in range(0, len(BOTH_WAYS) - len("EOF::\n"), 23):
        refused(BOTH_WAYS[:end])


FREE = ("Version", "Mach", "Ser", "Date", "By", "Loc", "TIT", "EQ", "Air", "ENV")
CRITICAL = [
    i for i, line in enumerate(BOTH_WAYS.splitlines()) if line and not line.startswith(FREE)
]


@pytest.mark.parametrize("dropped", CRITICAL)
def test_no_line_that_counts_may_be_missing(dropped):
    lines = BOTH_WAYS.splitlines()
    refused("\n".join(lines[:dropped] + lines[dropped + 1 :]))


@pytest.mark.slow
@settings(max_examples=80, deadline=None)
@given(
    at=st.integers(0, len(BOTH_WAYS) - 1),
    put=st.text(alphabet="0123456789.,:- \n\tXYZruneEof\x00é", max_size=6),
    cut=st.integers(0, 6),
)
def test_whatever_is_changed_is_read_whole_or_refused(at, put, cut):
    """What comes out has every value, finite; nothing but a refusal is raised."""
    try:
        body = read(BOTH_WAYS[:at] + put + BOTH_WAYS[at + cut :]).body
    except UnreadableFile:
        return
    assert body["axis"] in "xyz"
    assert body["targets_mm"] == sorted(body["targets_mm"])
    runs = body["forward_um"] + body.get("backward_um", [])
    assert len(runs) in (2, 4)
    assert {len(run) for run in runs} == {len(body["targets_mm"])} == {6}
    assert all(math.isfinite(value) for run in runs for value in run)


@settings(max_examples=60, deadline=None)
@given(st.text(alphabet="HEADR:: \n0123é"))
@pytest.mark.slow
def test_any_text_is_refused(text):
    refused(text)
