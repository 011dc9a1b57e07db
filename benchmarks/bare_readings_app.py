"""The floor for readings: a bare ASGI application that hands a body over to PostgreSQL.

It checks nothing, keeps nothing in memory, tells nobody, and answers a constant. The database takes
the JSON apart, into a table of the same columns and keys as the readings'.
"""

from __future__ import annotations

import asyncio
import os
import threading

import orjson
import psycopg

URL = os.environ["BENCHMARK_POSTGRESQL"]
INSERT = """
INSERT INTO bare (machine_id, time, temperatures_c, state)
SELECT 'mcfv5050', time, temperatures_c, '{}'
FROM json_to_recordset(CAST(%s AS json)) AS stated (time timestamptz, temperatures_c json)
"""
HEADERS = [(b"content-type", b"application/json"), (b"content-length", b"2")]
START = {"type": "http.response.start", "status": 201, "headers": HEADERS}
ANSWER = {"type": "http.response.body", "body": b"{}"}

of_thread = threading.local()


def store(body: bytes) -> None:
    """Insert a batch and commit, on a connection of the thread's own."""
    stated = orjson.loads(body)
    if not hasattr(of_thread, "connection"):
        of_thread.connection = psycopg.connect(URL)
    with of_thread.connection.transaction():
        of_thread.connection.execute(INSERT, [orjson.dumps(stated).decode()])


async def app(scope, receive, send):
    """Store what is sent in a thread, and answer when it is committed."""
    if scope["type"] != "http":
        return
    body, more = b"", True
    while more:
        message = await receive()
        body += message.get("body", b"")
        more = message.get("more_body", False)
    if body:
        await asyncio.get_running_loop().run_in_executor(None, store, body)
    await send(START)
    await send(ANSWER)
