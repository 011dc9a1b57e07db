"""PostgreSQL goes away or stands still: what was answered stays, tables go on."""

import shutil
import tempfile
import time
from pathlib import Path

import pytest

from tests.faults.cluster import Cluster, programs
from tests.faults.service import Service
from tests.faults.writers import (
    ROOM,
    Writers,
    big_map,
    client_of,
    expect_all,
    make_machine,
    temperatures,
)

pytestmark = pytest.mark.slow

TABLE = {"temperatures_c": temperatures(21.0)}


@pytest.fixture
def new_cluster():
    made = []
    # Not below pytest's own folder, into which no other user may look.
    folder = Path(tempfile.mkdtemp(prefix="thermap-cluster-"))
    folder.chmod(0o755)

    def new():
        if programs() is None:
            pytest.skip("there is no PostgreSQL here to be started")
        made.append(Cluster(folder))
        return made[-1]

    yield new
    for cluster in made:
        cluster.stop()
    shutil.rmtree(folder)


@pytest.fixture
def new_service():
    made = []

    def new(url):
        made.append(Service(url, THERMAP_STATEMENT_LIMIT_S="2", THERMAP_LOCK_LIMIT_S="2"))
        make_machine(made[-1].url)
        with client_of(made[-1].url) as client:
            for i, t_c in enumerate((18.0, 24.0)):
                sent = big_map(f"before {i}", t_c)
                client.post(f"{ROOM}/error-maps", json=sent).raise_for_status()
        return made[-1]

    yield new
    for service in made:
        service.end()


def until(condition, within_s=60.0):
    deadline = time.monotonic() + within_s
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.05)


@pytest.mark.parametrize("how", ["stopped", "paused"])
def test_a_server_that_goes_and_comes_back(new_cluster, new_service, how):
    cluster = new_cluster()
    service = new_service(cluster.url)
    writers = Writers(service.url, 0, maps=False)
    writers.run_until(maps=0, batches=5)
    cluster.stop() if how == "stopped" else cluster.pause()
    with client_of(service.url) as client:
        until(lambda: writers.refused > 2)
        answer = client.post(f"{ROOM}/compensation", json=TABLE)
        assert answer.status_code == 200, answer.text
        assert client.get("/readyz").status_code == 503
        assert client.get("/healthz").status_code == 200
    cluster.start() if how == "stopped" else cluster.resume()
    writers.wait_for(maps=0, batches=len(writers.answered_batches) + 5)
    writers.join()
    expect_all(service.url, [writers])
