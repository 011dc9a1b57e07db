"""What all tests share: databases made fast by copying, the service, its clock, and a client."""

import os
from dataclasses import replace

import httpx
import pytest
from hypothesis import settings

from app.main import create_app
from app.settings import Settings
from tests.databases import Databases, NotReachable
from tests.service_examples import Clock, furnish

# The same examples in every run, and no clock in the verdict.
settings.register_profile("thermap", derandomize=True, deadline=None, database=None)
settings.load_profile("thermap")

KINDS = ("sqlite", "postgresql")


@pytest.fixture(scope="session")
def anyio_backend():
    return "asyncio"


@pytest.fixture(scope="session")
def databases(tmp_path_factory):
    """Databases of any kind; all that were not dropped go at the end of the session."""
    made = Databases(tmp_path_factory.mktemp("databases"))
    yield made
    made.close()


def reachable(make, kind):
    """Make a database, or skip the test where its server is not there."""
    try:
        return make(kind)
    except NotReachable as away:
        if os.environ.get("THERMAP_REQUIRE_SERVICES"):
            pytest.fail(str(away))
        pytest.skip(str(away))


@pytest.fixture(params=KINDS)
def empty_database_url(request, databases):
    """A database without a table."""
    url = reachable(databases.empty, request.param)
    yield url
    databases.drop(url)


@pytest.fixture(params=KINDS)
def database_url(request, databases):
    """A database with the newest tables and nothing in them."""
    url = reachable(databases.migrated, request.param)
    yield url
    databases.drop(url)


@pytest.fixture
def sqlite_url(databases):
    url = databases.migrated("sqlite")
    yield url
    databases.drop(url)


@pytest.fixture
def postgresql_url(databases):
    url = reachable(databases.migrated, "postgresql")
    yield url
    databases.drop(url)


@pytest.fixture
def clock():
    """The service's clock, which stands still until it is moved."""
    return Clock()


@pytest.fixture
def new_app(clock):
    """Make services on any database; closed at the end of the test."""
    made = []

    def make(url, **options):
        service = create_app(Settings(database_url=url, **options))
        service.state.context = replace(service.state.context, now=clock)
        made.append(service)
        return service

    yield make
    for service in made:
        service.state.context.database.close()


@pytest.fixture
def app(new_app, database_url):
    """The service on each kind of database."""
    return new_app(database_url)


@pytest.fixture
def client_of():
    """Make clients; the service's own exceptions come back as its answers."""

    def make(service):
        transport = httpx.ASGITransport(app=service, raise_app_exceptions=False)
        return httpx.AsyncClient(transport=transport, base_url="http://thermap", trust_env=False)

    return make


@pytest.fixture
async def client(app, client_of):
    async with client_of(app) as client:
        yield client


@pytest.fixture
async def furnished(client):
    """A client of a service that has the example machine with three maps."""
    await furnish(client)
    return client
