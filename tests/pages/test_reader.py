"""Times of pages in the reader's zone: said beside them, exact where the clock changes."""

import json
import shutil
import subprocess
from datetime import UTC, datetime
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import app
from app.pages.reader import day_and_time, local, localised, read_reader, zone_key, zone_name
from tests.api.test_api_dashboard import feed, shown
from tests.service_examples import START, reading

ZONES = ("UTC", "Europe/Berlin", "America/St_Johns", "Asia/Kolkata", "America/Sao_Paulo")
SUMMER = datetime(2026, 7, 2, 1, 0, tzinfo=UTC)


@pytest.fixture(autouse=True)
def in_utc():
    yield
    read_reader({})


@pytest.mark.parametrize(
    "name", ["", "Europe/Nowhere", "../../etc/passwd", "/etc/localtime", "Europe", "\0", "x" * 5000]
)
def test_what_is_no_zone_is_utc(name):
    read_reader({"thermap-zone": name})
    assert zone_key() == "UTC"
    assert day_and_time(SUMMER) == "2026-07-02 01:00:00 UTC"


def test_a_zone_without_letters_is_said_as_what_it_is_ahead():
    read_reader({"thermap-zone": "America/Sao_Paulo"})
    assert day_and_time(SUMMER) == "2026-07-01 22:00:00 UTC-03"


@given(st.datetimes(datetime(2020, 1, 1), datetime(2035, 1, 1)), st.sampled_from(ZONES))
def test_a_sentence_says_the_same_moment_in_every_zone(moment, zone):
    moment = moment.replace(microsecond=0, tzinfo=UTC)
    read_reader({"thermap-zone": zone})
    said = f"late since {moment:%Y-%m-%d %H:%M:%S} UTC, and {moment:%H:%M} UTC too."
    at = local(moment)
    name = zone_name(moment)
    # Of the second time the seconds are unknown; the date is the nearest one.
    short = local(moment.replace(second=0))
    assert localised(said, moment) == (
        f"late since {at:%Y-%m-%d %H:%M:%S} {name}, and {short:%H:%M} {name} too."
    )


def test_a_time_of_day_is_the_nearest_one():
    read_reader({"thermap-zone": "Europe/Berlin"})
    assert localised("since 23:30 UTC", SUMMER) == "since 01:30 CEST"
    # 23:30 of the evening before was still in summer time, and 01:30 was not any more.
    night = datetime(2026, 10, 25, 2, 0, tzinfo=UTC)
    assert localised("from 23:30 UTC to 01:30 UTC", night) == "from 01:30 CEST to 02:30 CET"


@pytest.mark.anyio
async def test_pages_are_written_in_the_zone_of_the_cookie(client):
    await feed(client, reading(START, 25.0))
    client.cookies.set("thermap-zone", "Asia/Kolkata")
    page = await shown(client, "/machines/mcfv5050/maps")
    assert "measured, IST" in page.text
    assert "Measured at, IST" in page.text
    assert "UTC" not in page.text
    client.cookies.set("thermap-zone", "Moon/Tycho")
    assert "measured, UTC" in (await shown(client, "/machines/mcfv5050/maps")).text


@pytest.mark.skipif(shutil.which("node") is None, reason="Node.js is not installed")
@pytest.mark.parametrize("zone", ZONES)
def test_what_is_typed_is_the_moment_that_is_shown(zone, tmp_path):
    """The page's own script, there and back, at hours beside a change of the clock too."""
    moments = [1774746000000 + n * 1800_000 for n in range(-4, 12)]  # 2026-03-29, 01:00 UTC
    moments += [1792890000000 + n * 1800_000 for n in (-8, 8)]  # 2026-10-25
    source = (Path(app.__file__).parent / "pages/assets/ask.js").read_text(encoding="utf-8")
    script = tmp_path / "ask.mjs"
    script.write_text(
        f"const document = {{ documentElement: {{ dataset: {{ zone: {json.dumps(zone)} }} }} }};\n"
        f"{source}\nconsole.log(JSON.stringify({json.dumps(moments)}.map((at) => "
        "[dayAndTime(at).slice(0, 19), Date.parse(momentOf(typedOf(at)))])));\n",
        encoding="utf-8",
    )
    answer = subprocess.run(["node", script], capture_output=True, text=True, check=True)
    read_reader({"thermap-zone": zone})
    for at, (words, back) in zip(moments, json.loads(answer.stdout), strict=True):
        assert words == day_and_time(datetime.fromtimestamp(at / 1000, UTC))[:19]
        assert back == at
