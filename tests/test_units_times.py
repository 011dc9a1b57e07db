"""Times at the calendar's ends, and what is none: refused by whoever reads them, never raised."""

from datetime import UTC, datetime, timedelta, timezone

import pytest
import typer

from app.cli.options import read_time as read_option
from app.connections.mqtt_payloads import JsonPath, TimeForm, Unusable, time_at
from app.units import LacksZone, read_time, time_since_1970

ENDS = [
    "0001-01-01T00:00:00+01:00",
    "0001-01-01T00:00:00Z",
    "9999-12-31T23:59:59-01:00",
    "9999-12-31T23:59:59.999999Z",
    "1899-12-31T23:59:59Z",
    "3000-01-01T00:00:00Z",
]


@pytest.mark.parametrize("text", [*ENDS, "", "yesterday", "2026-03-01T06:00:00+" + "0" * 10_000])
def test_what_cannot_be_reckoned_with_is_refused(text):
    with pytest.raises(ValueError):
        read_time(text)
    with pytest.raises(typer.BadParameter, match="expected a time with its zone"):
        read_option(text)
    with pytest.raises(Unusable, match="expected a time as ISO 8601"):
        time_at({"t": text}, JsonPath.parse("t"), TimeForm.ISO_8601)


def test_a_time_keeps_its_zone_or_has_the_one_that_is_given():
    zone = timezone(timedelta(hours=1))
    assert read_time("2026-03-01T06:00:00+01:00").tzinfo == zone
    assert read_time("2026-03-01T06:00:00", UTC) == datetime(2026, 3, 1, 6, tzinfo=UTC)
    with pytest.raises(LacksZone):
        read_time("2026-03-01T06:00:00")


@pytest.mark.parametrize("seconds", [1e300, -1e300, float("nan"), float("inf"), 2**63, -1e11])
def test_a_count_of_seconds_beyond_the_calendar_is_refused(seconds):
    with pytest.raises(ValueError):
        time_since_1970(seconds)
    with pytest.raises(Unusable, match="expected a time as seconds since 1970"):
        time_at({"t": seconds}, JsonPath.parse("t"), TimeForm.EPOCH_S)
