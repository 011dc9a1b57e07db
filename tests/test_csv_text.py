"""What we write as CSV a spreadsheet shows and does not compute, and we read it as it was."""

import re
from pathlib import Path

import pytest

import app
from app.csv_text import csv_line, no_formula
from app.files.delimited_text import Problems, parse_delimited

FORMULAS = [
    "=1+1", "+1+1", "-1+1", "@SUM(A1)", "=cmd|' /C calc'!A0", "-2+3|A1", "＝1+1", "a;=1+1",
    "a\t@SUM(A1)", "+cmd", "-", "'=1", "-1;=2",
]  # fmt: skip


@pytest.mark.parametrize("text", FORMULAS)
@pytest.mark.parametrize("delimiter", ",;")
def test_no_cell_begins_as_a_formula_wherever_a_spreadsheet_parts_the_line(text, delimiter):
    for cell in csv_line(["x", text]).rstrip("\n").split(delimiter):
        bare = cell.strip('"')
        assert bare == "-" or bare[:1] not in tuple("=+-@＝")


@pytest.mark.parametrize("text", FORMULAS)
def test_what_was_marked_is_read_as_it_was(text):
    table = parse_delimited(csv_line(["name", "value"]) + csv_line([text, 1]), Problems(Path("x")))
    assert table.rows[0].cells == [text, "1"]


@pytest.mark.parametrize("cell", [-1.5, "-1.5", "+", "-", "+2e-3", "EXX", "2026-03-01T06:00:00Z"])
def test_numbers_directions_and_names_stay(cell):
    assert csv_line([cell]) == f"{cell}\n"


def test_a_comment_line_is_marked_within():
    assert no_formula("# label: a;=1+1") == "# label: a;'=1+1"


def test_all_csv_is_written_by_one_function():
    imported = re.compile(r"^\s*import csv\b", re.MULTILINE)
    wrong = [
        path.name
        for path in Path(app.__file__).parent.rglob("*.py")
        if path.name not in ("csv_text.py", "delimited_text.py")
        and imported.search(path.read_text(encoding="utf-8"))
    ]
    assert wrong == []
