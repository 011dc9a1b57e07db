"""Workbooks: read as openpyxl reads them, and refused before they fill the memory."""

import io
import tracemalloc
import zipfile
from datetime import datetime, time, timedelta

import pytest
from openpyxl import Workbook, load_workbook

from app.files import workbooks
from app.files.delimited_text import workbook_sheets
from app.files.table_limits import LONGEST_CELL, MOST_COLUMNS, NoTable
from app.files.workbooks import read_sheets

MAIN = 'xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main"'
OFFICE = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
RELATIONS = 'xmlns="http://schemas.openxmlformats.org/package/2006/relationships"'


def relations(**targets):
    inside = "".join(
        f'<Relationship Id="{i}" Type="{OFFICE}/{i}" Target="{t}"/>' for i, t in targets.items()
    )
    return f"<Relationships {RELATIONS}>{inside}</Relationships>"


def packed(data, strings="", packing=zipfile.ZIP_DEFLATED, before="", more=()):
    """Pack a workbook of one sheet; `data` is what stands in its sheetData."""
    sheet = f"{before}<worksheet {MAIN}><sheetData>{data}</sheetData></worksheet>"
    parts = {
        "_rels/.rels": relations(officeDocument="xl/workbook.xml"),
        "xl/_rels/workbook.xml.rels": relations(
            worksheet="sheet.xml", sharedStrings="/xl/strings.xml"
        ),
        "xl/workbook.xml": f'<workbook {MAIN} xmlns:r="{OFFICE}"><sheets>'
        '<sheet name="S" sheetId="1" r:id="worksheet"/></sheets></workbook>',
        "xl/sheet.xml": sheet,
        "xl/strings.xml": f"<sst {MAIN}>{strings}</sst>",
        **dict(more),
    }
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", packing) as archive:
        for name, text in parts.items():
            archive.writestr(name, text)
    return content.getvalue()


def test_a_small_one_is_read():
    strings = (
        "<si><t>a</t></si><si><r><t>b </t></r><r><t>c</t></r><rPh><t>x</t></rPh></si>"
        "<si><t>_x0041_</t></si>"
    )
    rows = (
        '<row r="2"><c r="A2" t="s"><v>0</v></c><c r="C2" t="s"><v>1</v></c></row>'
        '<row><c><v>5</v></c><c><v>1E-3</v></c><c t="b"><v>1</v></c><c t="s"><v>2</v></c>'
        '<c t="inlineStr"><is><t>in</t></is></c><c t="str"><f>A1</f><v>out</v></c><c><v>x</v></c>'
        '<c s="7"/></row>'
    )
    assert read_sheets(packed(rows, strings)) == {
        "S": [[], ["a", "", "b c"], ["5", "0.0010", "True", "A", "in", "out", "x"]]
    }


VALUES = [
    *(datetime(2026, 3, 1, 6, 0, 1), datetime(1900, 1, 5), datetime(2026, 3, 1), time(6, 30)),
    *(timedelta(hours=30), 5, -2.5, 1e-7, 12345678901, 0.1 + 0.2, True, "a  b\n", "–°µ", "", "=1"),
]
FORMATS = [
    *("General", "0.00", "yyyy-mm-dd", "dd.mm.yy hh:mm", "[h]:mm", '0.0 "days"', "[Red]0.0"),
    *("@", "mm:ss.0", "#,##0;[Red]-#,##0", r"0\d", "[$-407]d. mmm yyyy", "_(* #,##0_)"),
]


@pytest.mark.parametrize("is_1904", [False, True])
def test_values_are_written_as_openpyxl_has_them(is_1904):
    book = Workbook()
    if is_1904:
        book.epoch = datetime(1904, 1, 1)
    sheet = book.active
    for value in VALUES:
        sheet.append([value])
    for form in FORMATS:
        for number in (0.25, 1.5, 59.75, 60.5, 45000.123456, 12):
            sheet.append([number])
            sheet.cell(sheet.max_row, 1).number_format = form
    content = io.BytesIO()
    book.save(content)

    def written(value):
        text = value.isoformat() if isinstance(value, datetime) else str(value)
        return " ".join(text.split())

    wanted = load_workbook(io.BytesIO(content.getvalue()), data_only=True).active
    expected = [[written(c)] if c is not None else [] for (c,) in wanted.values]
    (got,) = read_sheets(content.getvalue()).values()
    assert list(got) == expected


CELL = '<c r="A1"><v>1</v></c>'
TOO_MUCH = {
    "a row far down": (lambda: packed(f'<row r="999999999">{CELL}</row>'), "rows in order"),
    "rows backwards": (lambda: packed('<row r="5"/><row r="4"/>'), "rows in order"),
    "a column far right": (
        lambda: packed('<row r="1"><c r="XFD1"><v>1</v></c></row>'),
        f"at most {MOST_COLUMNS} columns",
    ),
    "unpacked": (lambda: packed(" " * 70_000_000), f"at most {workbooks.MOST_UNPACKED} bytes"),
    "tags": (lambda: packed("<x/>" * 6_000_001), f"at most {workbooks.MOST_TAGS} tags"),
    "a code page": (
        lambda: packed("", before='<?xml version="1.0" encoding="cp037"?>'),
        "UTF-8 or UTF-16",
    ),
    "depth": (lambda: packed("<x>" * 300), f"at most {workbooks.DEEPEST} deep"),
    "wide rows": (
        lambda: packed('<row><c r="ALL1"><v>1</v></c></row>' * 2_000),
        "at most 1500000 cells",
    ),
    "a text in every cell": (
        lambda: packed('<row><c t="s"><v>0</v></c></row>' * 40_000, f"<si><t>{'x' * 999}</t></si>"),
        f"at most {workbooks.MOST_CHARACTERS} characters",
    ),
    "a long text": (
        lambda: packed('<row><c t="s"><v>0</v></c></row>', f"<si><t>{'x' * 2_000_000}</t></si>"),
        f"at most {LONGEST_CELL} characters",
    ),
    "a long attribute": (lambda: packed(f'<row x="{"x" * 300_000}"/>'), "bytes without an element"),
    "entities": (
        lambda: packed(
            "<row><c><v>&b;</v></c></row>",
            before='<!DOCTYPE x [<!ENTITY a "ha"><!ENTITY b "&a;&a;">]>',
        ),
        "without document types",
    ),
    "packed otherwise": (lambda: packed("", packing=zipfile.ZIP_LZMA), "stored or deflated"),
    "many files": (
        lambda: packed("", more=[(f"x{i}", "") for i in range(10_001)]),
        f"at most {workbooks.MOST_PARTS} files",
    ),
    "no sheets": (lambda: b"PK\x03\x04" + b"\0" * 100, "got neither"),
    "no such part": (lambda: packed("", more=[("xl/workbook.xml", "<x/>")])[:-30], "got neither"),
    "a text that is not there": (
        lambda: packed('<row><c t="s"><v>7</v></c></row>'),
        "got neither",
    ),
}
"""Packed where it is used: most are megabytes."""


@pytest.mark.filterwarnings("ignore:Duplicate name")
@pytest.mark.parametrize("kind", TOO_MUCH)
def test_what_is_beyond_a_limit_is_refused_with_little_memory(kind):
    pack, says = TOO_MUCH[kind]
    content = pack()
    tracemalloc.start()
    with pytest.raises(NoTable, match=says):
        workbook_sheets(content)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 150_000_000
