"""Long bodies and files wait for their turn: one for each sender, few in all, and not for ever."""

import asyncio

import pytest
from starlette.exceptions import HTTPException

from app.api import long_bodies
from app.api.long_bodies import AT_ONCE, LONGEST_WAIT_S, LongBodies
from app.json_text import SHORT_TEXT
from tests.service_examples import ROOM, START, problem, reading

pytestmark = pytest.mark.anyio

JSON = {"content-type": "application/json"}


async def take(turns, sender, began, going_on):
    async with turns.taken(sender):
        began.append(sender)
        await going_on.wait()


@pytest.fixture
async def at_work():
    """Let senders begin in this order; who has begun, and what lets them end."""
    going_on = asyncio.Event()
    tasks = []

    async def begin(*senders):
        turns, began = LongBodies(), []
        for sender in senders:
            tasks.append(asyncio.create_task(take(turns, sender, began, going_on)))
            await asyncio.sleep(0)
        for _ in range(20):
            await asyncio.sleep(0)
        return turns, began

    yield begin, going_on
    going_on.set()
    await asyncio.gather(*tasks)


async def test_who_sends_many_waits_for_himself_and_keeps_nobody_out(at_work):
    begin, going_on = at_work
    _, began = await begin("viewer", "viewer", "viewer", "metrologist")
    assert began == ["viewer", "metrologist"]
    going_on.set()
    for _ in range(20):
        await asyncio.sleep(0)
    assert sorted(began) == ["metrologist", "viewer", "viewer", "viewer"]


async def test_few_are_at_work_and_nobody_is_remembered(at_work):
    begin, going_on = at_work
    turns, began = await begin(*"abcdef")
    assert began == list("abcdef"[:AT_ONCE])
    going_on.set()
    while len(began) < 6:
        await asyncio.sleep(0)
    await asyncio.sleep(0)
    assert not dict(turns._by_sender)


async def test_who_waits_too_long_is_told_so(at_work, monkeypatch):
    monkeypatch.setattr(long_bodies, "LONGEST_WAIT_S", 0.01)
    begin, _ = at_work
    turns, _ = await begin("a", "b")
    for sender in ("a", "c"):
        with pytest.raises(HTTPException) as refused:
            async with turns.taken(sender):
                pass
        assert (refused.value.status_code, refused.value.headers) == (503, {"Retry-After": "5"})
    assert LONGEST_WAIT_S > 0.01


async def test_a_long_body_has_its_turn_and_a_short_one_needs_none(client, app, monkeypatch):
    monkeypatch.setattr(long_bodies, "LONGEST_WAIT_S", 0.01)
    body = b" " * SHORT_TEXT
    async with app.state.long_bodies.taken("address 127.0.0.1"):
        answer = await client.post(f"{ROOM}/predictions", content=body + b"{}", headers=JSON)
        assert "long bodies" in problem(answer, 503)["detail"]
        assert answer.headers["Retry-After"] == "5"
        csv = {"content-type": "text/csv"}
        answer = await client.post(f"{ROOM}/files", content=b"1", headers=csv)
        problem(answer, 503)
        assert (await client.post(f"{ROOM}/predictions", json={})).status_code == 422
        assert (await client.post(f"{ROOM}/readings", json=reading(START, 24.0))).status_code == 201
    answer = await client.post(f"{ROOM}/predictions", content=body + b"{}", headers=JSON)
    problem(answer, 422)
