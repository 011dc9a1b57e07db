"""A disk that is full for a while: a small one of our own, on which the database lies."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from tests.faults.cluster import Cluster
from tests.faults.ending import expect_whole
from tests.faults.service import Service
from tests.faults.writers import (
    PATIENCE_S,
    ROOM,
    Lost,
    Writers,
    big_map,
    client_of,
    expect_all,
    make_machine,
    temperatures,
)

TABLE = {"temperatures_c": temperatures(21.0)}


@dataclass(frozen=True)
class Filled:
    """How often there was no room, and how many readings were stored before and after."""

    no_room: int
    before: int
    after: int


def why_not() -> str:
    """Say why there can be no small disk here; nothing where there can."""
    if os.geteuid() != 0:
        return "a small disk needs the rights of root"
    with tempfile.TemporaryDirectory() as folder:
        tried = subprocess.run(_mount(Path(folder), 1), capture_output=True, text=True)
        if tried.returncode == 0:
            subprocess.run(["umount", folder], check=True)
    return tried.stderr.strip()


@contextmanager
def small_disk(megabytes: int) -> Iterator[Path]:
    """Give a folder that holds no more; everybody may look into it."""
    folder = Path(tempfile.mkdtemp(prefix="thermap-disk-"))
    folder.chmod(0o755)
    subprocess.run(_mount(folder, megabytes), check=True)
    try:
        yield folder
    finally:
        subprocess.run(["umount", "--lazy", folder], check=True)
        folder.rmdir()


def _mount(folder: Path, megabytes: int) -> list[str]:
    return ["mount", "-t", "tmpfs", "-o", f"size={megabytes}m,mode=755", "tmpfs", str(folder)]


def database_on(disk: Path, cluster: Cluster | None) -> str:
    """Make a database on a disk: a file, or where there is a server one of its tablespaces."""
    if cluster is None:
        return f"sqlite:///{disk}/thermap.db"
    place = disk / "tablespace"
    place.mkdir(mode=0o700)
    shutil.chown(place, "postgres", "postgres")
    cluster.execute(f"CREATE TABLESPACE small LOCATION '{place}'")
    cluster.execute("DROP DATABASE thermap")
    cluster.execute("CREATE DATABASE thermap TABLESPACE small")
    return cluster.url


def fill_under_load(disk: Path, database_url: str) -> Filled:
    """Fill the disk while clients store, look at what still works, and make room again.

    Raises
    ------
    Lost
        If anything that was answered with 201 is not there, or is there by half, or what needs no
        room is not answered meanwhile.
    """
    service = Service(database_url)
    try:
        make_machine(service.url)
        with client_of(service.url) as client:
            for i, t_c in enumerate((18.0, 19.0)):
                sent = big_map(f"before {i}", t_c)
                client.post(f"{ROOM}/error-maps", json=sent).raise_for_status()
        writers = Writers(service.url, 0, maps=False)
        writers.run_until(maps=0, batches=3)
        filler = disk / "filler"
        _fill(filler)
        _until(lambda: writers.no_room > 5)
        before = len(writers.answered_batches)
        _expect_answers(service.url)
        filler.unlink()
        writers.wait_for(maps=0, batches=before + 3)
        writers.join()
        expect_all(service.url, [writers])
    finally:
        service.end()
    expect_whole(database_url)
    return Filled(writers.no_room, before, len(writers.answered_batches) - before)


def _fill(file: Path) -> None:
    """Take all the room that there is."""
    with file.open("wb", buffering=0) as opened, suppress(OSError):
        while True:
            opened.write(bytes(4096))


def _until(is_so: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not is_so():
        if time.monotonic() > deadline:
            raise Lost("nobody was told that the disk is full")
        time.sleep(0.05)


def _expect_answers(url: str) -> None:
    """See that what needs no room is answered, and what needs some is refused in words."""
    with client_of(url) as client:
        for answer in (
            client.post(f"{ROOM}/compensation", json=TABLE),
            client.get(f"{ROOM}/error-maps"),
            client.get(f"{ROOM}/readings?limit=10"),
        ):
            if answer.status_code != 200:
                raise Lost(f"expected 200 on a full disk, got {answer.text[:300]}")
        refused = client.post(f"{ROOM}/error-maps", json=big_map("no room", 30.0))
        if refused.status_code != 507 or "make room" not in refused.text:
            raise Lost(f"expected 507 with words, got {refused.status_code} {refused.text[:300]}")
