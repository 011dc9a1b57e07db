"""thermap serve --workers: several processes behind one socket."""

import os
import signal
import threading
import time
from datetime import timedelta
from pathlib import Path

import httpx
import pytest

from app.cli.workers import worker_settings
from app.settings import Settings
from app.storage.database import Database
from app.storage.readings import list_readings
from tests.cli.conftest import ended, wait_until_it_answers
from tests.service_examples import MACHINE, ROOM, START, iso, reading

SOON_S = 120.0
"""A machine may be slow, but nothing hangs."""


def workers_of(process):
    """Give the processes that a command started to serve."""
    found = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    return {int(pid) for pid in found if b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes()}


def until(is_so):
    end = time.monotonic() + SOON_S
    while not is_so():
        assert time.monotonic() < end, "it never was"
        time.sleep(0.05)


def worker_that_answers(url):
    """Ask on a connection of its own; give the number of the worker, None where none answers."""
    try:
        answer = httpx.get(f"{url}/metrics", trust_env=False, timeout=SOON_S)
    except httpx.TransportError:
        return None
    if answer.status_code != 200:  # it does not reach its database yet
        return None
    lines = answer.text.splitlines()
    (line,) = [one for one in lines if one.startswith("thermap_machines_in_memory{")]
    return line.partition('worker="')[2].partition('"')[0]


def everybody_answers(url):
    seen = set()
    until(lambda: seen.add(worker_that_answers(url)) or {"1", "2"} <= seen)


def test_more_than_one_worker_is_refused_on_sqlite(run, tmp_path):
    url = f"sqlite:///{tmp_path}/shop.db"
    found = run("serve", "--workers", "2", "--port", "0", "--database-url", url)
    assert found.exit_code == 2
    words = " ".join(found.stderr.replace("│", " ").split())
    assert "2 need PostgreSQL" in words
    assert not list(tmp_path.iterdir())


def test_connections_and_opcua_are_the_first_workers_alone():
    stated = Settings(
        config="shop.toml", opcua_endpoint="opc.tcp://127.0.0.1:4840/thermap", refresh_s=3.0
    )
    first, second = (worker_settings(stated, number) for number in (1, 2))
    assert (first.config, first.opcua_endpoint) == (stated.config, stated.opcua_endpoint)
    assert (second.config, second.opcua_endpoint) == (None, "")
    assert (first.worker, second.worker) == (1, 2)
    assert second.refresh_s == 3.0


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="needs /proc")
def test_workers_share_a_socket_are_started_again_and_end_together(
    start, run, free_port, postgresql_example, tmp_path
):
    """And each of them says how the first one's connections fare."""
    file = tmp_path / "thermap.toml"
    file.write_text(
        '[[mtconnect]]\nname = "mill"\nmachine = "mcfv5050"\nurl = "http://127.0.0.1:9"\n'
        'sensors = { x-middle = "X" }\n',
        encoding="utf-8",
    )
    process = start(
        *("serve", "--workers", "2", "--port", free_port, "--database-url", postgresql_example),
        *("--config", file),
    )
    url = f"http://127.0.0.1:{free_port}"
    wait_until_it_answers(url)
    everybody_answers(url)

    def names():
        found = httpx.get(f"{url}/v1/connections", trust_env=False, timeout=SOON_S).json()
        return [one["name"] for one in found["connections"]]

    until(lambda: names() == ["mill"])
    # Each time another connection, and so another worker now and then.
    assert [names() for _ in range(30)] == [["mill"]] * 30
    assert "mill" in run("connections", "--url", url).stdout
    doctor = run("doctor", "--url", url, columns=300)
    assert "no contact with http://127.0.0.1:9" in doctor.stdout
    before = workers_of(process)
    assert len(before) == 2
    os.kill(min(before), signal.SIGKILL)
    until(lambda: len(workers_of(process) - before) == 1)
    everybody_answers(url)
    running = workers_of(process)
    code, out, err = ended(process)
    assert code == 0
    assert "workers           2" in out
    assert "has died (exit code -9), starts again" in err
    assert not any(Path(f"/proc/{pid}").exists() for pid in running)


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="needs /proc")
def test_workers_end_when_what_started_them_is_killed(start, free_port, postgresql_example):
    process = start(
        *("serve", "--workers", "2", "--port", free_port, "--database-url", postgresql_example)
    )
    url = f"http://127.0.0.1:{free_port}"
    wait_until_it_answers(url)
    everybody_answers(url)
    running = workers_of(process)
    process.kill()
    until(lambda: not any(is_running(pid) for pid in running))


def is_running(pid):
    """Whether a process is there, and not only its name."""
    try:
        return "\nState:\tZ" not in Path(f"/proc/{pid}/status").read_text()
    except FileNotFoundError:
        return False


@pytest.mark.slow
def test_no_acknowledged_reading_is_lost_when_a_replica_is_killed(
    start, databases, postgresql_example
):
    """Two replicas; clients go over to the other one when theirs is killed, as a proxy does."""
    replicas = [
        start("serve", "--port", "0", "--database-url", postgresql_example, "--log-level", "error")
        for _ in range(2)
    ]
    urls = [_url_of(replica) for replica in replicas]
    for url in urls:
        wait_until_it_answers(url)
    acknowledged = set()
    stop = threading.Event()

    def send(first):
        k, place = first, first % 2
        with httpx.Client(trust_env=False, timeout=SOON_S) as client:
            while not stop.is_set():
                time_of = START - timedelta(milliseconds=10 * k)
                try:
                    answer = client.post(
                        f"{urls[place]}{ROOM}/readings", json=reading(time_of, 25.0)
                    )
                except httpx.TransportError:
                    place = 1 - place  # nobody knows whether it was stored: it is sent again
                    continue
                assert answer.status_code == 201, answer.text
                acknowledged.add(time_of)
                k += 4

    senders = [threading.Thread(target=send, args=(i,)) for i in range(4)]
    for sender in senders:
        sender.start()
    until(lambda: len(acknowledged) > 100)
    replicas[0].kill()
    count = len(acknowledged)
    until(lambda: len(acknowledged) > count + 100)
    stop.set()
    for sender in senders:
        sender.join()
    database = Database(postgresql_example)
    with database.reading() as session:
        stored = {one.time for one in list_readings(session, MACHINE["id"])}
    database.close()
    assert acknowledged <= stored
    table = httpx.get(f"{urls[1]}{ROOM}/compensation", trust_env=False, timeout=SOON_S)
    assert table.json()["reading_time"] == iso(max(stored))


def _url_of(process):
    """Read where a service listens."""
    return process.stdout.readline().split("listens on ")[1].strip()
