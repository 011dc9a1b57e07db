"""Tables and verdicts as server-sent events, from a service that really listens."""

from contextlib import ExitStack
from dataclasses import replace

import httpx
import numpy as np
import pytest

from app.api.streamed_table import REMEMBERED, REMEMBERED_BYTES, Feed, Table, remember
from app.cli.listening import listening, serving, url_of
from app.compensation.table import Basis, ComponentCompensation
from app.geometry.components import COMPONENTS
from app.main import create_app
from app.settings import Settings
from tests.followed_streams import PATH, Stream, opened
from tests.service_examples import (
    MACHINE,
    ROOM,
    UNHURRIED,
    by_code,
    furnish_database,
)

pytestmark = pytest.mark.slow

# With each kelvin EXX at X 500 grows by 5 µm, EZZ at Z 500 by 10 µm, EBX at X 500 by 10 µrad.


@pytest.fixture
def sqlite_url(databases):
    url = databases.prepared("sqlite", furnish_database)
    yield url
    databases.give_back(url)


@pytest.fixture
def shop(sqlite_url, clock):
    with opened(sqlite_url, clock) as shop:
        yield shop


def test_the_table_of_another_service_is_none_that_is_known(sqlite_url, clock):
    """Two services on one database: what one told, the other does not take for its own."""
    with opened(sqlite_url, clock) as one, opened(sqlite_url, clock, refresh_s=0.05) as other:
        one.feed(25.0)
        with other.follow() as stream:
            assert exx_um(stream.until("table")) == 25.0
        with one.follow() as stream:
            last = stream.until("table")
        one.feed_after(10, 26.0)
        with other.follow() as stream:
            while exx_um(stream.until("table")) != 30.0:
                pass
        with other.follow(last=last.id) as stream:
            assert exx_um(stream.until("table")) == 30.0


def exx_um(event):
    return by_code(event.content)["EXX"]["errors_um"][-1]


def test_the_verdict_and_the_table_come_at_once_and_whenever_they_change(shop):
    shop.feed(25.0)
    with shop.follow() as stream:
        verdict, first = stream.next(), stream.next()
        assert (verdict.name, first.name) == ("status", "table")
        assert verdict.content == shop("GET", f"{ROOM}/status").json()
        assert first.content == shop("GET", f"{ROOM}/compensation").json()
        shop.feed_after(10, 25.1)
        second = stream.next()
        assert (second.name, exx_um(second)) == ("table", 25.5)
        assert second.number > first.number


def test_changes_that_are_left_aside_add_up(shop):
    shop.feed(25.0)
    with shop.follow(min_change_um=1.05) as stream:
        assert exx_um(stream.until("table")) == 25.0
        # EZZ and EBX grow by 0.5 each time, and by 1.5 in all.
        for i in range(1, 4):
            shop.feed_after(10, 25.0 + 0.05 * i)
        assert exx_um(stream.until("table")) == 25.75


def test_a_health_that_changes_without_any_value_is_a_state(shop):
    shop.feed(25.0)
    with shop.follow() as stream:
        table = stream.until("table")
        shop.clock.advance(121)
        found = [stream.next(), stream.next()]
        assert {event.name for event in found} == {"state", "status"}
        state, status = sorted(found, key=lambda event: event.name)
        assert state.content["components"] == table.content["components"]
        assert (state.content["complete"], state.content["stale"]) == (False, True)
        assert status.content["state"] == "stale"


def test_without_a_table_the_reason_comes_and_then_the_first_table(shop):
    with shop.follow() as stream:
        status, state = stream.next(), stream.next()
        assert (status.name, status.content["state"]) == ("status", "no-reading")
        assert state.name == "state"
        assert (state.content["machine"], state.content["complete"]) == ("mcfv5050", False)
        assert "no reading" in state.content["detail"]
        shop.feed(25.0)
        assert exx_um(stream.until("table")) == 25.0


def test_who_comes_back_has_the_table_again_only_if_it_has_changed(shop):
    shop.feed(25.0)
    with shop.follow() as stream:
        first = stream.until("table")
    with shop.follow(last=first.number) as stream:
        assert stream.next().name == "status"
        shop.feed_after(10, 26.0)
        second = stream.next()
        assert (second.name, exx_um(second)) == ("table", 30.0)
    shop.feed_after(10, 27.0)
    with shop.follow(last=first.number) as stream:
        verdict = stream.next()
        assert verdict.name == "status"
    for last in (first.number, verdict.number):  # broken off before the table came
        with shop.follow(last=last) as stream:
            assert exx_um(stream.until("table")) == 35.0
    for unknown in ("1", "yesterday", "9" * 30):
        with shop.follow(last=unknown) as stream:
            assert exx_um(stream.until("table")) == 35.0


@pytest.mark.slow
def test_no_value_jumps_by_more_than_a_follower_takes(shop):
    shop.feed(25.0)
    with shop.follow(max_step_um=6.0) as stream:
        first = stream.until("table")
        assert first.content["stepping"] is False
        shop.feed_after(10, 26.0)  # EZZ by 10 µm, EBX by 10 µrad, EXX by 5 µm
        step, last = stream.until("table"), stream.until("table")
        assert [e.content["stepping"] for e in (step, last)] == [True, False]
        assert (exx_um(step), exx_um(last)) == (28.0, 30.0)
        assert by_code(step.content)["EXX"]["compensation_um"][-1] == -28.0
        assert by_code(step.content)["SXY"]["error_um_per_m"] == -25.6
        assert last.content == shop("GET", f"{ROOM}/compensation").json() | {"stepping": False}
    # From where the follower left, not from where it would have got to.
    with shop.follow(last=step.number, max_step_um=3.0) as stream:
        assert exx_um(stream.until("table")) == pytest.approx(29.5)


def test_all_machines_in_one_stream_and_one_that_is_deleted(shop):
    shop.feed(25.0)
    with shop.follow("/v1/stream") as stream:
        assert exx_um(stream.until("table")) == 25.0
        shop("POST", "/v1/machines", json=MACHINE | {"id": "second"})
        status = stream.until("status")
        assert (status.content["machine"], status.content["state"]) == ("second", "no-model")
        with shop.follow("/v1/machines/second/compensation/stream") as other:
            assert other.next().name == "status"
            shop("DELETE", "/v1/machines/second")
            assert other.until("table") is None
        shop.feed_after(10, 26.0)
        assert exx_um(stream.until("table")) == 30.0


def test_another_model_comes_even_where_no_value_changes(shop):
    shop.feed(25.0)
    with shop.follow() as stream:
        assert stream.until("table").content["model_version"] == 3
        shop("PUT", f"{ROOM}/sensor-assignment", json={"EYY": "x-middle"})
        version = stream.until("state").content["model_version"]
        assert version == shop("GET", f"{ROOM}/compensation").json()["model_version"]


def test_the_end_of_the_service_ends_its_streams(databases, clock):
    database_url = databases.prepared("sqlite", furnish_database)
    service = create_app(Settings(database_url=database_url, **UNHURRIED))
    service.state.context = replace(service.state.context, now=clock)
    with (
        listening("127.0.0.1", 0, "serve") as socket,
        httpx.Client(base_url=url_of(socket), trust_env=False, timeout=60.0) as client,
        ExitStack() as following,
    ):
        with serving(service, socket, "warning"):
            answer = following.enter_context(client.stream("GET", PATH))
            stream = Stream(answer.iter_lines())
            assert stream.next().name == "status"
        assert stream.until("status") is None
    databases.give_back(database_url)


def test_what_cannot_be_followed_is_refused(shop):
    assert "mcfv5050" in shop.refused("/v1/machines/another/compensation/stream", 404)["detail"]
    for query in (
        "min_change_um=-1",
        "min_change_um=nan",
        "max_step_um=0",
        "max_step_um=1e-4",
        "every_s=1",
    ):
        shop.refused(f"{PATH}?{query}", 422)


def test_asked_for_the_head_alone_nothing_is_followed(shop):
    answer = shop("HEAD", PATH)
    assert answer.headers["content-type"].startswith("text/event-stream")


@pytest.mark.parametrize("count", [12, 50_000, REMEMBERED_BYTES])
def test_what_is_remembered_for_those_who_come_back_has_a_bounded_size(count):
    feed = Feed("m")
    values = np.zeros(count)
    basis = Basis(None, None, None, None, None, "interpolated")
    exx = ComponentCompensation(COMPONENTS["EXX"], values, values, None, None, None, basis)
    for i in range(1, 2 * REMEMBERED):
        remember(feed.tables, Table(i, {"EXX": exx}, (), b"the table"))
    kept = list(feed.tables.values())
    assert len(kept) == min(REMEMBERED, REMEMBERED_BYTES // (2 * values.nbytes))
    assert {table.content for table in kept} <= {b""}
    assert feed.known(2 * REMEMBERED) is (kept[-1] if kept else None)
