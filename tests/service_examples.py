"""The machine, the maps and the readings that tests of the service speak of.

Three maps of one machine. Every error is chosen so that tables between the maps can
be computed by hand: see `error_map`.
"""

import asyncio
import re
from contextlib import contextmanager
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from functools import cache, lru_cache
from urllib.parse import quote

import httpx
import jsonschema_rs
from sqlalchemy import select

from app.main import create_app
from app.settings import Settings
from app.storage.tables import Base
from scripts.openapi_document import openapi_document

START = datetime(2026, 3, 1, 6, 0, tzinfo=UTC)
"""When the tests' clock stands."""

ROOM = "/v1/machines/mcfv5050"

MACHINE = {
    "id": "mcfv5050",
    "name": "MCFV5050LN",
    "configuration": "XYFZ",
    "axes": {
        "x": {"min_mm": 0, "max_mm": 500},
        "y": {"min_mm": 0, "max_mm": 500},
        "z": {"min_mm": 0, "max_mm": 500},
    },
    "sensors": [
        {"name": "x-middle", "min_c": -10, "max_c": 80, "max_age_s": 120},
        {"name": "y-front", "min_c": -10, "max_c": 80, "max_age_s": 120},
        {"name": "z-column", "max_age_s": 120},
        {"name": "spindle", "max_age_s": 120},
    ],
}

MAPS = {"Run #1": 20.0, "Run #3": 24.0, "Run #6": 30.0}
"""Label to the temperature of x-middle [°C]; y-front reads 1 °C less, z-column 2 °C more."""


class Clock:
    """A clock that moves when it is told to."""

    def __init__(self, time=START):
        self.time = time

    def __call__(self):
        return self.time

    def advance(self, seconds):
        self.time += timedelta(seconds=seconds)


def iso(time):
    """Write a time as the service does."""
    return time.astimezone(UTC).isoformat().replace("+00:00", "Z")


def temperatures(t_c):
    """All sensors' temperatures when x-middle has this one."""
    return {"x-middle": t_c, "y-front": t_c - 1.0, "z-column": t_c + 2.0, "spindle": t_c + 5.0}


def error_map(label, t_c, **changes):
    """A map measured at a temperature of x-middle [°C].

    EXX is (t − 20)·x/100 µm, EBX twice that in µrad, EZZ (t − 20)·z/50 µm where
    z-column reads t + 2, and SXY −t µm/m.
    """
    grown = t_c - 20.0
    content = {
        "label": label,
        "measured_at": iso(START - timedelta(days=1)),
        "temperatures_c": temperatures(t_c),
        "components": [
            table("EXX", [0, 100, 500], [0.0, grown, 5 * grown]),
            table("EBX", [0, 500], [0.0, 10 * grown], unit="urad"),
            table("EZZ", [0, 50, 500], [0.0, grown, 10 * grown]),
            {"component": "SXY", "value_um_per_m": -t_c},
        ],
    }
    return {**content, **changes}


def table(component, positions_mm, errors, unit="um", **more):
    """One component over positions."""
    return {
        "component": component,
        "positions_mm": positions_mm,
        f"errors_{unit}": errors,
        **more,
    }


def reading(time, t_c, **changes):
    """A reading of all sensors."""
    return {"time": iso(time), "temperatures_c": temperatures(t_c), "state": {}} | changes


UNHURRIED = {"lock_limit_s": 60, "statement_limit_s": 60, "waiting_limit_s": 60}
"""What answers on a busy machine must not depend on how busy it is."""


@contextmanager
def running(url, clock=None, **options):
    """Make a service whose clock moves only when it is told to; its database is closed after."""
    service = create_app(Settings(database_url=url, **UNHURRIED | options))
    service.state.context = replace(service.state.context, now=clock or Clock())
    try:
        yield service
    finally:
        service.state.runner.stop()
        service.state.context.database.close()


def client_of(service):
    """Make a client; the service's own exceptions come back as its answers."""
    transport = httpx.ASGITransport(app=service, raise_app_exceptions=False)
    return httpx.AsyncClient(
        transport=transport,
        base_url="http://localhost",
        trust_env=False,
        event_hooks={"response": [as_published]},
    )


async def as_published(answer):
    """Check that an answer in JSON is as the OpenAPI document says."""
    if not answer.headers.get("content-type", "").endswith("json"):
        return
    check = _published(
        _route_of(answer.request.url.path), answer.request.method, answer.status_code
    )
    if check is not None:
        await answer.aread()
        errors = [f"{e.instance_path}: {e.message}" for e in check.iter_errors(answer.json())]
        assert not errors, errors[:3]


@lru_cache(maxsize=1000)
def _route_of(path):
    """The route of a path; one without a parameter comes first, as in the service."""
    for route in sorted(openapi_document()["paths"], key=lambda route: route.count("{")):
        if re.fullmatch(re.sub(r"\{.*?\}", "[^/]+", route), path):
            return route
    return None


DOCUMENT = "urn:openapi"


@cache
def _published(route, method, status):
    """What checks a route's answer of one status; None where no shape of it is published."""
    operation = openapi_document()["paths"].get(route, {}).get(method.lower(), {})
    contents = operation.get("responses", {}).get(str(status), {}).get("content", {})
    kinds = [kind for kind in contents if kind.endswith("json")]
    if not kinds:
        return None
    way = ("paths", route, method.lower(), "responses", str(status), "content", kinds[0], "schema")
    pointer = "/".join(quote(step.replace("~", "~0").replace("/", "~1")) for step in way)
    return jsonschema_rs.Draft202012Validator(
        {"$ref": f"{DOCUMENT}#/{pointer}"}, registry=_documents(), validate_formats=True
    )


@cache
def _documents():
    return jsonschema_rs.Registry([(DOCUMENT, openapi_document())])


def furnish_database(url):
    """Store the example machine with its maps in an empty database."""

    async def store():
        async with client_of(service) as client:
            await furnish(client)

    with running(url) as service:
        asyncio.run(store())


async def furnish(client, machine=MACHINE, maps=MAPS):
    """Store the example machine with its maps."""
    answer = await client.post("/v1/machines", json=machine)
    assert answer.status_code == 201, answer.text
    for label, t_c in maps.items():
        answer = await client.post(
            f"/v1/machines/{machine['id']}/error-maps", json=error_map(label, t_c)
        )
        assert answer.status_code == 201, answer.text


def by_code(document):
    """A table's components by their codes."""
    return {entry["component"]: entry for entry in document["components"]}


def problem(answer, status):
    """Check that an answer is a problem as RFC 9457 has it, and return it."""
    assert answer.status_code == status, f"{answer.status_code} {answer.text[:1000]}"
    assert answer.headers["content-type"] == "application/problem+json"
    found = answer.json()
    assert set(found) == {"type", "title", "status", "detail", "errors"}
    assert found["status"] == status
    assert found["type"]
    assert found["title"]
    assert len(found["detail"]) > 10
    for error in found["errors"]:
        assert set(error) == {"field", "message"}
        assert error["field"]
        assert len(error["message"]) > 10
    return found


def contents(service):
    """Everything that a service's database holds: table to its rows, as they are stored."""
    with service.state.context.database.reading() as session:
        return {
            table.name: sorted(repr(tuple(row)) for row in session.execute(select(table)))
            for table in Base.metadata.sorted_tables
        }
