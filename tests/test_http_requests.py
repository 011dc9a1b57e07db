"""scripts/http_requests.sh has a request for every route, and each is answered as it says."""

import re
import time
from datetime import UTC, datetime

import anyio
import httpx
import pytest

from app.cli.demo_machine import set_up
from scripts.http_requests import (
    SCRIPT,
    CurlRequest,
    requests_of_script,
    routes_without_request,
)
from scripts.openapi_document import openapi_document
from tests.service_examples import client_of, running
from thermap import ThermapClient

REQUESTS = requests_of_script()

ANALYSIS = "/v1/machines/practice/analyses/1"


def test_every_route_has_a_request():
    missing = routes_without_request(REQUESTS, openapi_document())
    routes = ", ".join(f"{method.upper()} {path}" for method, path in missing)
    assert not missing, (
        f"there is no request for {routes}: write one into scripts/{SCRIPT.name}, where it "
        "works with what the requests before it made"
    )


@pytest.fixture
def service(sqlite_url):
    """The service as `thermap demo` has it, at the present time."""
    with running(sqlite_url, lambda: datetime.now(UTC)) as service:
        yield service


async def furnished(client):
    """Let the demonstration's own client, which waits for each answer, set its machine up."""

    async def send(request):
        answer = await client.request(
            request.method, request.url.raw_path.decode(),
            content=with_minus_zeros(request.content.decode()),
            headers={"Content-Type": request.headers.get("Content-Type", "application/json")},
        )  # fmt: skip
        return httpx.Response(answer.status_code, headers=answer.headers, content=answer.content)

    # Whatever is stated as 0 is stated as −0, and no answer has one.
    transport = httpx.MockTransport(lambda request: anyio.from_thread.run(send, request))
    with ThermapClient("http://thermap", transport=transport) as blocking:
        await anyio.to_thread.run_sync(set_up, blocking)


async def sent(client, request):
    """Send what curl would send."""
    headers = {"Accept": "*/*", **request.headers}
    path = request.url.removeprefix("http://127.0.0.1:8000")
    is_json = request.headers.get("Content-Type") == "application/json"
    body = with_minus_zeros(request.body) if is_json and request.body else request.body
    answer = await client.request(request.method, path, headers=headers, content=body)
    if answer.headers.get("Content-Type", "").startswith(WITH_NUMBERS):
        assert not minus_zeros(answer.text), request.text
    return answer


ZERO = re.compile(r'"(?:[^"\\]|\\.)*"|(?<![\w.-])0\.0(?![\w.])|(?<![\w.-])0(?=[,\s\]}])')
MINUS_ZERO = re.compile(r'"(?:[^"\\]|\\.)*"|(?<![\w.])[-−]0(?:\.0*)?(?![\w.])')
WITH_NUMBERS = ("application/json", "text/event-stream", "text/csv")


def with_minus_zeros(text):
    return ZERO.sub(lambda found: found[0] if found[0][0] == '"' else f"-{found[0]}", text)


def minus_zeros(text):
    return [found[0] for found in MINUS_ZERO.finditer(text) if found[0][0] != '"']


@pytest.mark.slow
@pytest.mark.anyio
async def test_the_requests_work_in_their_order(service):
    """As the demonstration's machine is; nobody waits for an analysis, and none runs."""
    service.state.runner.stop()
    service.state.streams.end()  # they end after what they have to tell now
    async with client_of(service) as client:
        await furnished(client)
        before = (await client.get("/v1/machines")).json()
        for request in REQUESTS:
            answer = await sent(client, request)
            expected = request.status_before or request.status
            assert answer.status_code == expected, f"{request.text}\n{answer.text[:1000]}"
        # What they made is gone.
        assert (await client.get("/v1/machines")).json() == before


@pytest.mark.slow
@pytest.mark.anyio
async def test_the_requests_work_in_their_order_once_the_analysis_is_done(service):
    service.state.streams.end()
    async with client_of(service) as client:
        await furnished(client)
        for request in REQUESTS:
            if request.path.startswith(ANALYSIS):
                await done(client)
            answer = await sent(client, request)
            assert answer.status_code == request.status, f"{request.text}\n{answer.text[:1000]}"


async def done(client):
    """Wait until the analysis has ended."""
    deadline = time.monotonic() + 120.0
    while (await client.get(ANALYSIS)).json()["status"] in ("queued", "running"):
        assert time.monotonic() < deadline
        await anyio.sleep(0.1)


@pytest.mark.parametrize(
    "text",
    [
        "curl http://127.0.0.1:8000/healthz",  # without a status
        "# 200\nwget http://127.0.0.1:8000/healthz",
        "# 200\ncurl http://127.0.0.1:8000/healthz --compressed",
        "# 200\ncurl http://127.0.0.1:8000/healthz\ncurl http://127.0.0.1:8000/readyz",
    ],
)
def test_what_is_no_request_is_refused(text):
    with pytest.raises(ValueError, match=r"expected `# STATUS: words` above one curl command"):
        CurlRequest.of(text)
