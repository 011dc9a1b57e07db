"""The live table is answered from memory: not a single question to the database."""

from datetime import timedelta

import pytest
from sqlalchemy import event

from tests.service_examples import ROOM, START, problem, reading, temperatures

pytestmark = pytest.mark.anyio


def forbid(engine):
    """Make every use of a database an error."""

    def refuse(*_arguments, **_named):
        raise AssertionError("the live table asked the database")

    for name in ("checkout", "do_connect", "connect"):
        event.listen(engine, name, refuse)
    event.listen(engine, "before_cursor_execute", refuse)


@pytest.mark.slow
@pytest.mark.parametrize("content_type", ["application/json", "application/json; charset=utf-8"])
async def test_the_live_table_does_not_ask_the_database(app, client, clock, content_type):
    stated = {"temperatures_c": temperatures(25.5)}
    before = await client.post(f"{ROOM}/compensation", json=stated)  # brings it into memory
    rising = [reading(START - timedelta(seconds=60 * m), 25.5) for m in range(3)]
    await client.post(f"{ROOM}/readings", json=rising)
    current = await client.get(f"{ROOM}/compensation")
    assert current.status_code == 200
    forbid(app.state.context.database.engine)

    headers = {"content-type": content_type}
    answer = await client.post(f"{ROOM}/compensation", json=stated, headers=headers)
    assert answer.json() == before.json()
    other = {"temperatures_c": temperatures(27.0)}
    answer = await client.post(f"{ROOM}/compensation", json=other, headers=headers)
    assert answer.status_code == 200
    clock.advance(1)
    answer = await client.get(f"{ROOM}/compensation")
    assert answer.status_code == 200
    answer = await client.get(
        f"{ROOM}/compensation", headers={"if-none-match": answer.headers["etag"]}
    )
    assert answer.status_code == 304
    wrong = {"temperatures_c": {"nose": 1.0}}
    problem(await client.post(f"{ROOM}/compensation", json=wrong, headers=headers), 422)
    assert (await client.get("/healthz")).status_code == 200
    # /metrics is no part of it: it asks for watches and analyses, where the database is there.
    problem(await client.get("/v1/machines"), 500)  # the trap does catch


async def test_the_live_table_follows_every_change_without_asking(app, client):
    """The process that makes a change puts it into memory itself."""
    stated = {"temperatures_c": temperatures(25.5)}
    await client.post(f"{ROOM}/models/2/activate")
    await client.post(f"{ROOM}/readings", json=reading(START, 23.0))
    forbid(app.state.context.database.engine)
    table = (await client.post(f"{ROOM}/compensation", json=stated)).json()
    assert table["model_version"] == 2
    current = (await client.get(f"{ROOM}/compensation")).json()
    assert current["model_version"] == 2
    assert current["components"][0]["temperature_c"] == 23.0
