"""What was answered with 201 is there after the service ended in any way; nothing is there by half.

`python -m tests.faults ending` does the same a hundred times.
"""

import signal

import pytest

from tests.databases import reachable
from tests.faults.ending import end_under_load
from tests.faults.service import Service
from tests.faults.writers import Lost, Writers, expect_all, make_machine


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "number", "times"),
    [
        ("sqlite", signal.SIGKILL, 1),
        ("postgresql", signal.SIGKILL, 1),
        ("sqlite", signal.SIGTERM, 1),
    ],
)
def test_what_was_answered_survives_the_end(databases, kind, number, times):
    url = reachable(databases.migrated, kind)
    ended = end_under_load(url, times, number, maps=1, batches=6)
    assert ended.maps >= times
    assert ended.readings >= 6 * 40 * times
    databases.give_back(url)


@pytest.mark.slow
def test_a_loss_would_be_found(sqlite_url):
    service = Service(sqlite_url)
    try:
        make_machine(service.url)
        writers = Writers(service.url, 0)
        writers.run_until(maps=1, batches=2)
        writers.join()
        expect_all(service.url, [writers])
        batch = writers.answered_batches[0]
        writers.answered_batches.append(dict.fromkeys(batch, 99.0))
        with pytest.raises(Lost, match="was answered with 201, and is not there"):
            expect_all(service.url, [writers])
    finally:
        service.end()
