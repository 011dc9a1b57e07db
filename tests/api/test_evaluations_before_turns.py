"""Readings are evaluated before a request waits for its turn at the database."""

import asyncio
from contextlib import AsyncExitStack

import pytest

from app.api.methods import positioning
from app.api.turns import AT_WORK
from tests.service_examples import ROOM

pytestmark = pytest.mark.anyio

SOON_S = 60.0
"""A machine may be slow, but nothing hangs."""

FILE = "target_mm,forward_um,backward_um\n0,0.0,-1.0\n250,1.2,0.3\n500,2.0,1.2\n"
"""A table of readings as `thermap import --method positioning` takes it."""

BODY = {
    "axis": "x",
    "targets_mm": [0, 250, 500],
    "forward_um": [0.0, 1.2, 2.0],
    "backward_um": [-1.0, 0.3, 1.2],
}


def as_json(client):
    return client.post(f"{ROOM}/measurements/positioning", json=BODY)


def as_file(client):
    return client.post(
        f"{ROOM}/files",
        params={
            "name": "x.csv",
            "method": "positioning",
            "axis": "x",
            "label": "laser",
            "measured_at": "2026-03-01T05:30:00Z",
            "temperature": ["x-middle=27.0", "y-front=26.0", "z-column=29.0", "spindle=30.0"],
            "preview": True,
        },
        content=FILE,
        headers={"Content-Type": "text/csv"},
    )


@pytest.mark.parametrize("send", [as_json, as_file])
async def test_readings_are_evaluated_while_others_have_every_turn(app, client, monkeypatch, send):
    first = await send(client)  # it brings the machine into memory
    assert first.status_code == 200, first.text
    evaluate = positioning.evaluate_positioning
    evaluated = asyncio.Event()
    loop = asyncio.get_running_loop()

    def noticed(*readings, **stated):
        found = evaluate(*readings, **stated)
        loop.call_soon_threadsafe(evaluated.set)
        return found

    monkeypatch.setattr(positioning, "evaluate_positioning", noticed)
    async with asyncio.timeout(SOON_S):
        async with AsyncExitStack() as others:
            for _ in range(AT_WORK):
                await others.enter_async_context(app.state.turns.taken())
            sent = asyncio.create_task(send(client))
            seen = asyncio.create_task(evaluated.wait())
            await asyncio.wait({sent, seen}, return_when=asyncio.FIRST_COMPLETED)
            assert evaluated.is_set(), (await sent).text
            assert not sent.done()
        answer = await sent
    seen.cancel()
    assert answer.status_code == 200, answer.text
