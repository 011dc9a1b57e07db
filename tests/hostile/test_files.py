"""Files of every reader, mutated: read or refused in our own words, and nothing else is raised."""

import io
import json
import random
import re
import zipfile
from functools import cache
from pathlib import Path

import pytest
from openpyxl import Workbook

from app.api.methods.registry import METHODS
from app.api.uploads import read_uploaded_map, read_uploaded_verification
from app.connections.config import read_connections
from app.controllers.format import ControllerFile
from app.errors import InvalidContent
from app.files.csv_comments import Header
from app.files.delimited_text import UnreadableFile, only_sheet, sheets_of
from app.files.recording import read_recording
from app.services.controllers import parse_files
from tests.controllers.example_tables import NEEDED
from tests.files.test_renishaw_rtl import BOTH_WAYS
from tests.hostile.mutations import mutated
from tests.service_examples import client_of, furnish_database, running

ROOT = Path(__file__).parents[2]
STATED = Header("Run #1", "2026-03-01T06:00:00Z", {"x-middle": 20.1})

PIECES = [
    *(b"\xe2\x80\xa8", b"\xc2\x85", b"\x0b", b"\x1c", b"\0", b"\r", b"\xff\xfe", b"\xef\xbb\xbf"),
    *(b"1" * 400, b"1e999", b"nan", b"-0", b"1_0", b"\xd9\xa3", b"9" * 30, b"1e-400", b"0x1F"),
    *(b'"', b"'", b"=", b"#", b"# ", b";", b",", b"\t", b"sep=", b"[", b"]", b"(", b":", b"::"),
    *(b" " * 300, b"," * 300, b"\n" * 300, b"[" * 300, b"\xc2\xb5m", b"\xb0C", b"$", b"%", b"{"),
    *(b"0001-01-01T00:00:00+01:00", b"9999-12-31T23:59:59-01:00", b"2026-03-01T06:00:00Z"),
    *(b"# axis: x\n", b"# datum: first\n", b"direction", b"state ", b"temperature ", b"run"),
    *(b"<!DOCTYPE x>", b"<c/>", b'r="XFD9"', b"<row/>", b"&#0;", b"&amp;", b"<v>1e308</v>"),
]

MAP = b"""# label: Run #1
# measured_at: 2026-03-01T06:00:00Z
# temperature x-middle: 20.1
component,position_mm,error_um,standard_error_um,backward_error_um
EXX,0,0.0,0.2,0.1
EXX,50,1.2,0.3,1.4
C0Y,,3.5,,
"""
VERIFICATION = b"""# label: night shift
# datum: first
time,component,position_mm,direction,measured_um,setup,state spindle_rpm
2026-03-01T06:00:00Z,EXX,250,+,4.31,a,0
2026-03-01T06:01:00Z,EXX,50,-,1.25,a,2000
"""
RECORDING = b"time,x-middle,z-column_c,state rpm\n2026-03-01T06:00:00Z,20.1,20.3,2000\n" * 1
CONNECTIONS = b"""[[mqtt]]
name = "a"
host = "127.0.0.1"
client_id = "thermap-1"
[[mqtt.topics]]
topic = "t"
machine = "m"
sensor = "x"
"""


@cache
def measurements():
    """Give a file of each method, as the page of files has them."""
    page = (ROOT / "docs" / "methods" / "files.md").read_text(encoding="utf-8")
    return [table.encode() for table in re.findall(r"```csv\n(.*?)```", page, re.S)]


@cache
def controllers_files():
    """Give the files of each format, of ours and of the field."""
    golden = ROOT / "tests" / "controllers" / "golden"
    return {
        name: [
            path.read_bytes()
            for path in sorted(golden.glob(f"{name}_*"))
            if "thermap-check" not in path.name
        ]
        for name in NEEDED
    }


def workbook(*rows):
    book = Workbook()
    for row in rows:
        book.active.append(row)
    content = io.BytesIO()
    book.save(content)
    return content.getvalue()


@cache
def workbooks():
    """Give workbooks of a map and of a verification."""
    return [
        workbook(*(line.split(",") for line in text.decode().splitlines()))
        for text in (MAP, VERIFICATION)
    ]


def repacked(random_, content):
    """Mutate one part of a workbook, or the zip itself."""
    if random_.random() < 0.2:
        return b"PK\x03\x04" + mutated(random_, [content], PIECES)[4:]
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    name = random_.choice(sorted(parts))
    parts[name] = mutated(random_, [parts[name]], PIECES)
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", random_.choice([0, zipfile.ZIP_DEFLATED])) as archive:
        for part, text in parts.items():
            archive.writestr(part, text)
    return packed.getvalue()


def expect_short(error):
    """What is answered repeats no file."""
    assert len(str(error)) < 50_000


def each(hostile_inputs, samples, read):
    """Read so many mutated samples; only refusals may come out."""
    random_ = random.Random(28)
    refused = 0
    for _ in range(hostile_inputs):
        content = mutated(random_, samples, PIECES)
        try:
            read(random_, content)
        except (InvalidContent, UnreadableFile) as error:
            refused += 1
            expect_short(error)
    assert hostile_inputs < 50 or 0 < refused < hostile_inputs


def test_maps(hostile_inputs):
    each(hostile_inputs, [MAP], lambda _, c: read_uploaded_map(c, "a.csv", "m", STATED))


def test_verifications(hostile_inputs):
    each(hostile_inputs, [VERIFICATION], lambda _, c: read_uploaded_verification(c, "a.csv", "m"))


def test_measurements(hostile_inputs):
    def read(random_, content):
        method = random_.choice(list(METHODS))
        text = only_sheet(sheets_of(content, Path("a")), Path("a"))
        METHODS[method].read(text, header=STATED, complete=True)

    each(hostile_inputs, measurements(), read)


def test_instrument_files(hostile_inputs):
    each(
        hostile_inputs,
        [BOTH_WAYS.encode()],
        lambda _, c: read_uploaded_map(c, "a.rtl", "m", STATED, None),
    )


def test_recordings(hostile_inputs, tmp_path):
    file = tmp_path / "a.csv"

    def read(_, content):
        file.write_bytes(content)
        read_recording(file, ["x-middle", "z-column"], {}, None)

    each(hostile_inputs, [RECORDING], read)


def test_connections(hostile_inputs, tmp_path):
    pytest.importorskip("paho.mqtt.client", reason="the extra mqtt is not installed")
    file = tmp_path / "a.toml"

    def read(_, content):
        file.write_bytes(content)
        read_connections(file)

    each(hostile_inputs, [CONNECTIONS], read)


def test_workbooks(hostile_inputs):
    random_ = random.Random(28)
    for _ in range(hostile_inputs):
        content = repacked(random_, random_.choice(workbooks()))
        try:
            if random_.random() < 0.5:
                read_uploaded_map(content, "a.xlsx", "m", STATED)
            else:
                read_uploaded_verification(content, "a.xlsx", "m")
        except InvalidContent as error:
            expect_short(error)


@pytest.mark.parametrize("name", NEEDED)
def test_controllers_files(hostile_inputs, name):
    def read(_, content):
        text = content.decode("utf-8", "replace")
        names = ("x.comp", "thermap.ini", "y.comp")
        others = controllers_files()[name]
        files = [ControllerFile(names[0], text)]
        files += [ControllerFile(n, o.decode()) for n, o in zip(names[1:], others, strict=False)]
        parse_files(name, files if name == "linuxcnc" else files[:1], NEEDED[name])

    each(hostile_inputs, controllers_files()[name], read)


@pytest.fixture
def furnished_url(databases):
    url = databases.prepared("sqlite", furnish_database)
    yield url
    databases.give_back(url)


@pytest.mark.anyio
async def test_no_file_is_answered_with_an_error_of_ours(hostile_inputs, furnished_url):
    """The same over HTTP, through what is checked and computed behind the readers."""
    random_ = random.Random(28)
    query = {"preview": "true", "name": "a.csv", "label": "x", "temperature": "x-middle=20"}
    with running(furnished_url) as service:
        async with client_of(service) as client:
            for _ in range(max(hostile_inputs // 4, 20)):
                kind = random_.randrange(4)
                if kind == 0:
                    name = random_.choice(sorted(NEEDED))
                    text = mutated(random_, controllers_files()[name], PIECES)
                    content = text.decode("utf-8", "replace")
                    body = {
                        "files": [{"name": "x.comp", "content": content}],
                        "options": NEEDED[name],
                    }
                    answer = await client.post(
                        f"/v1/controllers/{name}/parse",
                        content=json.dumps(body),
                        headers={"Content-Type": "application/json"},
                    )
                elif kind == 1:
                    answer = await client.post(
                        "/v1/machines/mcfv5050/files",
                        params={"preview": "true", "kind": "check", "name": "a.csv"},
                        content=mutated(random_, [VERIFICATION], PIECES),
                        headers={"Content-Type": "text/csv"},
                    )
                else:
                    samples = [MAP] if kind == 2 else [*measurements(), BOTH_WAYS.encode()]
                    method = {} if kind == 2 else {"method": random_.choice(list(METHODS))}
                    answer = await client.post(
                        "/v1/machines/mcfv5050/files",
                        params={
                            "kind": "map",
                            **query,
                            **method,
                            "measured_at": "2026-03-01T06:00:00Z",
                        },
                        content=mutated(random_, samples, PIECES),
                        headers={"Content-Type": "text/csv"},
                    )
                assert answer.status_code < 500, answer.text
