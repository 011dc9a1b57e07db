"""What waits for the database: in order, and nobody's flood takes another's place."""

from dataclasses import dataclass

import pytest

from app.connections.waiting import Waiting


@dataclass(frozen=True)
class One:
    machine: str
    number: int


def filled(*ones):
    waiting = Waiting()
    for one in ones:
        waiting.add(one)
    return waiting


A, B = [One("a", i) for i in range(5)], [One("b", i) for i in range(5)]


def test_a_batch_is_of_the_machine_that_waits_longest():
    waiting = filled(A[0], B[0], A[1], A[2])
    assert waiting.next_batch(2) == [A[0], A[1]]
    waiting.remove(A[0])
    assert waiting.next_batch(10) == [B[0]]
    waiting.remove(B[0])
    assert waiting.next_batch(10) == [A[1], A[2]]
    assert list(waiting) == [A[1], A[2]]
    assert (len(waiting), A[0] in waiting, A[1] in waiting) == (2, False, True)
    with pytest.raises(KeyError):
        waiting.remove(A[0])


def test_who_has_more_than_its_share_gives_way():
    waiting = filled(A[0], B[0], B[1], B[2], B[3])
    assert waiting.one_too_many("b") == B[0]
    assert waiting.one_too_many("a") == B[0]
    assert filled(A[0], A[1]).one_too_many("a") == A[0]
    assert filled(A[0], B[0], A[1], B[1]).one_too_many("b") == A[0]
