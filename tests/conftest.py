"""What all tests share: databases made fast by copying, the service, its clock, and a client."""

import gc
import math
import os
import re
from contextlib import ExitStack
from pathlib import Path

import pytest
from _pytest.doctest import DoctestModule
from hypothesis import settings
from sqlalchemy import make_url

from app.arrays import one_blas_thread
from app.services.follow_database import DatabaseFollower
from tests.databases import KINDS, Databases, reachable
from tests.service_examples import Clock, client_of, furnish_database, running
from tests.services.tcp_proxy import TcpProxy

# The same examples in every run, and no clock in the verdict. CI tries more of them, with
# `--hypothesis-profile=thorough` beside the slow tests.
settings.register_profile(
    "thermap", derandomize=True, deadline=None, database=None, max_examples=20
)
settings.register_profile("thorough", settings.get_profile("thermap"), max_examples=100)
settings.load_profile("thermap")

# As analyses have it. Of small matrices, the threads of several test processes wait for each
# other: a search that is called here took fifteen times its processor time.
one_blas_thread()


def pytest_xdist_auto_num_workers():
    """Run one more process than there are cores: many tests wait for a process or for a timer."""
    return len(os.sched_getaffinity(0)) + 1


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """Keep what is imported and collected, which stays to the end, from the collector of cycles.

    Half a million objects: it took 0.4 s to go through them, in the midst of some test.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.collect()
        gc.freeze()
        gc.enable()


HERE = Path(__file__).parent
POSTGRESQL = re.compile(r"[\[-]postgresql[\]-]")

API_ON_POSTGRESQL = {
    f"test_api_{subject}.py"
    for subject in (
        *("access", "analyses", "error_maps", "events", "history", "machines", "models"),
        *("readings", "readings_at_once", "stream_news", "verifications", "watch"),
    )
} | {"test_large_numbers.py"}
"""What asks the database something of its own; the other tests read the same rows."""

EACH_CASE_ON_POSTGRESQL = {"test_foreign_text.py", "test_migrations.py"}
SQLITE_ALONE = {
    *("test_languages.py", "test_reader.py", "test_adopted_effects.py", "test_cli_serve.py"),
}


@pytest.hookimpl(wrapper=True)
def pytest_collection_modifyitems(config, items):
    """Run on SQLite, which is what a user gets, everything, and some of it on PostgreSQL too.

    There, of a test with many cases, the first: cases differ in what the service makes of them.
    What takes longest begins, each on a process of its own, of which each is given one stretch of
    the tests: at the end, nothing else would be left to run beside it.
    """
    seen, left_out = set(), set()
    for item in items:
        if not POSTGRESQL.search(item.name):
            continue
        folder, name = item.path.relative_to(HERE).parts[0], item.path.name
        test = (item.path, item.originalname)
        each_case = folder == "storage" or name in EACH_CASE_ON_POSTGRESQL
        if folder == "api":
            item.add_marker(pytest.mark.slow)
        if (
            name in SQLITE_ALONE
            or (folder == "api" and name not in API_ON_POSTGRESQL)
            or (test in seen and not each_case)
        ):
            left_out.add(item)
        seen.add(test)
    config.hook.pytest_deselected(items=list(left_out))
    items[:] = [item for item in items if item not in left_out]
    yield
    processes = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
    stretch = math.ceil(len(items) / processes)
    longest = [item for item in items if item.get_closest_marker("begin")]
    items[:] = [item for item in items if item not in longest]
    for i, item in enumerate(longest):
        items.insert(i % processes * stretch, item)


class Doctests:
    """For every folder that is collected: modules are asked for doctests where they have any."""

    @pytest.hookimpl(wrapper=True)
    def pytest_collect_file(self, file_path):
        collected = yield
        if file_path.suffix != ".py" or b">>> " in file_path.read_bytes():
            return collected
        return [one for one in collected if not isinstance(one, DoctestModule)]


def pytest_configure(config):
    config.pluginmanager.register(Doctests())


@pytest.fixture(scope="session")
def anyio_backend():
    return "asyncio"


@pytest.fixture(scope="session")
def databases(tmp_path_factory):
    """Databases of any kind; all that are kept go at the end of the session."""
    made = Databases(tmp_path_factory.mktemp("databases"))
    yield made
    made.close()


@pytest.fixture(params=KINDS)
def empty_database_url(request, databases):
    """A database without a table."""
    url = reachable(databases.empty, request.param)
    yield url
    databases.give_back(url)


@pytest.fixture(params=KINDS)
def database_url(request, databases):
    """A database with the newest tables and nothing in them."""
    url = reachable(databases.migrated, request.param)
    yield url
    databases.give_back(url)


@pytest.fixture(params=KINDS)
def furnished_url(request, databases):
    """A database that has the example machine with three maps."""
    url = reachable(lambda kind: databases.prepared(kind, furnish_database), request.param)
    yield url
    databases.give_back(url)


@pytest.fixture
def sqlite_url(databases):
    url = databases.migrated("sqlite")
    yield url
    databases.give_back(url)


@pytest.fixture
def postgresql_url(databases):
    url = reachable(databases.migrated, "postgresql")
    yield url
    databases.give_back(url)


@pytest.fixture
def sqlite_example(databases):
    """The example machine with three maps, on SQLite alone."""
    url = databases.prepared("sqlite", furnish_database)
    yield url
    databases.give_back(url)


@pytest.fixture
def postgresql_example(databases):
    """The example machine with three maps, on PostgreSQL alone."""
    url = reachable(lambda kind: databases.prepared(kind, furnish_database), "postgresql")
    yield url
    databases.give_back(url)


@pytest.fixture
def clock():
    """The service's clock, which stands still until it is moved."""
    return Clock()


@pytest.fixture
def new_app(clock):
    """Make services on any database; closed at the end of the test."""
    with ExitStack() as services:
        yield lambda url, **options: services.enter_context(running(url, clock, **options))


@pytest.fixture
def empty_app(new_app, database_url):
    """The service on an empty database of each kind."""
    return new_app(database_url)


@pytest.fixture
async def empty(empty_app):
    """A client of the service on an empty database."""
    async with client_of(empty_app) as client:
        yield client


@pytest.fixture
def app(new_app, furnished_url):
    """The service with the example machine and its maps, on each kind of database."""
    return new_app(furnished_url)


@pytest.fixture
async def client(app):
    """A client of the service with the example machine."""
    async with client_of(app) as client:
        yield client


@pytest.fixture
def wire(postgresql_example):
    """A cut-able wire to a database with the example machine, and the URL through it."""
    parsed = make_url(postgresql_example)
    proxy = TcpProxy(parsed.host, parsed.port or 5432)
    proxy.url = parsed.set(host="127.0.0.1", port=proxy.port).render_as_string(False)
    yield proxy
    proxy.cut()


@pytest.fixture
def wired(new_app, wire):
    """A service on that wire, with its machine in memory."""
    service = new_app(wire.url)
    service.follower = DatabaseFollower(service.state.context, every_s=1.0)
    service.follower.look()
    return service
