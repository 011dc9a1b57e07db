"""What killed workers ran comes to its end, and of a machine one analysis runs at a time.

`python -m tests.faults workers` does the same a hundred times.
"""

import pytest

from tests.databases import reachable
from tests.faults.killed_workers import LOST, Turn, kill_workers, mistakes_in


@pytest.mark.slow
@pytest.mark.begin
def test_what_killed_workers_ran_comes_to_its_end(databases, tmp_path):
    url = reachable(databases.empty, "postgresql")
    killed = kill_workers(url, tmp_path, 2, machine_count=2, asked_ahead=2)
    assert killed.times >= 2
    assert killed.asked == killed.done + killed.failed
    assert killed.done > 0
    databases.give_back(url)


EXPECTED = {"m1": {"effects": ["its own"]}, "m2": {"effects": []}}
WELL = [
    *((1, "m1", "queued"), (2, "m1", "queued"), (3, "m2", "queued")),
    *((1, "m1", "running"), (3, "m2", "running"), (1, "m1", "queued"), (2, "m1", "running")),
    *((2, "m1", "done"), (1, "m1", "running"), (1, "m1", "done")),
    *((3, "m2", "queued"), (3, "m2", "running"), (3, "m2", "queued"), (3, "m2", "running")),
    (3, "m2", "failed"),
]
"""Of m1 two analyses, the first begun twice; of m2 one whose worker was killed three times."""

ANSWERS = {
    1: {"machine": "m1", "status": "done", "message": "done", "result": EXPECTED["m1"]},
    2: {"machine": "m1", "status": "done", "message": "done", "result": EXPECTED["m1"]},
    3: {"machine": "m2", "status": "failed", "message": LOST, "result": None},
}


def mistakes(turns=WELL, **changed):
    answers = {n: answer | changed.get(f"of_{n}", {}) for n, answer in ANSWERS.items()}
    return mistakes_in([Turn(*turn) for turn in turns], answers, EXPECTED)


def without(*places):
    return [turn for i, turn in enumerate(WELL) if i not in places]


def test_what_is_as_it_should_is_no_mistake():
    assert mistakes() == []


@pytest.mark.parametrize(
    ("turns", "changed", "words"),
    [
        (without(9), {"of_1": {"status": "running"}}, "1 of m1 is running"),
        (without(8, 9), {"of_1": {"status": "queued"}}, "1 of m1 is queued"),
        (without(5), {}, "2 began while 1 ran"),
        ([*WELL, (2, "m1", "running"), (2, "m1", "done")], {}, "2 began again after its end"),
        ([*WELL, (2, "m1", "done")], {}, "2 came to an end 2 times"),
        (without(10, 11), {}, "3, begun 2 times, failed"),
        (WELL, {"of_3": {"message": "unexpected error"}}, "failed: unexpected error"),
        (WELL, {"of_2": {"result": EXPECTED["m2"]}}, "2 has another result"),
        (
            [*WELL[:-1], (3, "m2", "queued"), (3, "m2", "running"), (3, "m2", "done")],
            {"of_3": {"status": "done", "result": EXPECTED["m2"]}},
            "3 was begun 4 times",
        ),
    ],
)
def test_mistakes_are_found(turns, changed, words):
    assert any(words in one for one in mistakes(turns, **changed))
