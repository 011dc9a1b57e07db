"""No client takes its key, or its password, to where a service or an agent redirects it."""

import asyncio
import json
import threading
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from types import SimpleNamespace
from urllib.parse import parse_qs, urlsplit

import httpx
import pytest
from typer.testing import CliRunner

from app import __version__
from app.cli import application
from app.connections.mtconnect_connection import AgentConnection, MtconnectTable
from app.hal.component import Service
from tests.connections.mtconnect_agent_example import ExampleAgent
from tests.service_examples import START, Clock, reading
from thermap import AsyncThermapClient, ThermapClient
from thermap.errors import ThermapClientError

pytestmark = pytest.mark.anyio

each_status = pytest.mark.parametrize("status", [301, 302, 303, 307, 308])
two_statuses = pytest.mark.parametrize("status", [302, 308])
"""One status after which a client would ask with GET, and one after which as before."""

KEY = "Bearer tm_key"
PASSWORD = httpx.BasicAuth("me", "s3cret")._auth_header


@contextmanager
def listening(answer):
    """A server that notes who asks for what, and answers with a status, headers and a body."""
    heard = []

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self):
            heard.append((urlsplit(self.path).path, self.headers.get("Authorization")))
            status, headers, body = answer(self.path)
            self.send_response(status)
            for name, value in headers.items():
                self.send_header(name, value)
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

        do_POST = do_GET  # noqa: N815

        def log_message(self, *_said):
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=server.serve_forever, args=(0.02,))
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}", heard
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


@contextmanager
def redirecting(status, answer=lambda _path: None):
    """A server that redirects what it does not answer; what is sent to the other one is wrong."""
    with listening(lambda _path: (200, {}, b"{}")) as (elsewhere, heard_elsewhere):

        def redirected(path):
            return answer(path) or (status, {"Location": f"{elsewhere}{path}"}, b"")

        with listening(redirected) as (url, heard):
            yield url, heard
    assert heard_elsewhere == []


@pytest.fixture(autouse=True)
def key(monkeypatch):
    monkeypatch.setenv("THERMAP_KEY", KEY.removeprefix("Bearer "))


@each_status
def test_the_component_of_hal(status):
    with redirecting(status) as (url, heard):
        component = Service(url, "vmc", 20.0)
        with pytest.raises(ValueError, match=f"answered with {status}"):
            component.table()
        with pytest.raises(ValueError, match=f"answered with {status}"):
            component.store_reading({"x": 20.0}, {})
    assert [key for _, key in heard] == [KEY] * 2


@each_status
def test_the_client(status):
    with redirecting(status) as (url, heard), ThermapClient(url) as client:
        for ask in (
            lambda: client.machine("vmc"),
            lambda: client.store_readings("vmc", reading(START, 25.0)),
            lambda: next(client.follow("vmc")),
            lambda: next(client.follow_all()),
        ):
            with pytest.raises(ThermapClientError, match=f"answered {status} "):
                ask()
    assert [key for _, key in heard] == [KEY] * 4


@two_statuses
async def test_the_asynchronous_client(status):
    with redirecting(status) as (url, heard):
        async with AsyncThermapClient(url) as client:
            for ask in (
                lambda: client.machine("vmc"),
                lambda: client.store_readings("vmc", reading(START, 25.0)),
                lambda: anext(client.follow("vmc")),
                lambda: anext(client.follow_all()),
            ):
                with pytest.raises(ThermapClientError, match=f"answered {status} "):
                    await ask()
    assert [key for _, key in heard] == [KEY] * 4


@two_statuses
def test_doctor(status):
    with redirecting(status) as (url, heard):
        examined = CliRunner().invoke(application, ["doctor", "--url", url, "--json"])
    assert examined.exit_code == 1
    (finding,) = json.loads(examined.stdout)["findings"]
    assert f"answered {status} " in finding["sentence"]
    assert heard == [("/healthz", KEY)]


@two_statuses
def test_doctor_where_the_service_answers_that_it_lives(status):
    health = json.dumps({"status": "ok", "version": __version__}).encode()
    kind = {"Content-Type": "application/json"}

    def answer(path):
        return (200, kind, health) if path == "/healthz" else None

    with redirecting(status, answer) as (url, heard):
        examined = CliRunner().invoke(application, ["doctor", "--url", url])
    assert examined.exit_code == 1
    assert ("/readyz", KEY) in heard


@two_statuses
@pytest.mark.parametrize("question", ["probe", "current", "sample"])
@pytest.mark.parametrize("is_streamed", [False, True])
async def test_the_connection_to_an_agent(status, question, is_streamed):
    pytest.importorskip("defusedxml", reason="the extra mtconnect is not installed")
    agent = ExampleAgent()
    agent.observe("t1", "21.5")

    def answer(path):
        url = urlsplit(path)
        asked = url.path.removeprefix("/")
        if asked == question:
            return None
        return 200, {"Content-Type": "text/xml"}, agent.answer(asked, parse_qs(url.query)).encode()

    with redirecting(status, answer) as (url, heard):
        table = MtconnectTable(
            name="mill",
            machine="vmc",
            url=url.replace("//", "//me:s3cret@"),
            sensors={"x-middle": "t1"},
            every_s=0.1,
            stream=is_streamed,
        )
        connection = AgentConnection(table, Taker(), lambda: SimpleNamespace(now=Clock()))
        with pytest.raises(ExceptionGroup) as lost:
            async with asyncio.timeout(60.0):
                await connection.run()
        assert f"got HTTP {status}" in str(lost.value.exceptions)
    assert heard[-1] == (f"/{question}", PASSWORD)


class Taker:
    """Takes values for nothing."""

    def tell_values(self, *_told):
        """Who has a value and who has none is judged elsewhere."""

    def offer(self, *_values):
        pass
