"""A disk that is full: who stores is told, nothing is lost, and with room it goes on.

`python -m tests.faults full` does it as often as it is asked to.
"""

import shutil
import tempfile
from pathlib import Path

import pytest

from tests.faults.cluster import Cluster, programs
from tests.faults.full import database_on, fill_under_load, small_disk, why_not

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(("kind", "megabytes"), [("sqlite", 4), ("postgresql", 32)])
def test_a_disk_that_is_full_for_a_while(kind, megabytes):
    if reason := why_not():
        pytest.skip(reason)
    if kind == "postgresql" and programs() is None:
        pytest.skip("there is no PostgreSQL here to be started")
    # Not below pytest's own folder, into which no other user may look.
    folder = Path(tempfile.mkdtemp(prefix="thermap-cluster-"))
    folder.chmod(0o755)
    cluster = Cluster(folder) if kind == "postgresql" else None
    try:
        with small_disk(megabytes) as disk:
            filled = fill_under_load(disk, database_on(disk, cluster))
            if cluster is not None:
                cluster.stop()
    finally:
        if cluster is not None:
            cluster.stop()
        shutil.rmtree(folder)
    assert filled.no_room > 5
    assert filled.after >= 3
