"""Which numbers of readings may still appear."""

from datetime import timedelta

from hypothesis import given
from hypothesis import strategies as st

from app.live.unseen_numbers import MOST_GAPS, PATIENCE, UnseenNumbers
from tests.service_examples import START


def test_numbers_without_gaps_move_the_highest():
    unseen = UnseenNumbers(10)
    unseen.mark_seen([11, 12, 13], START)
    assert (unseen.highest, unseen.gaps) == (13, [])
    unseen.mark_seen([], START)
    assert (unseen.highest, unseen.gaps) == (13, [])


def test_a_number_that_comes_late_closes_its_gap():
    unseen = UnseenNumbers(0)
    unseen.mark_seen([5], START)
    assert unseen.gaps == [(1, 4)]
    unseen.mark_seen([2, 7], START)
    assert (unseen.highest, unseen.gaps) == (7, [(1, 1), (3, 4), (6, 6)])
    unseen.mark_seen([1, 3, 4, 6], START)
    assert (unseen.highest, unseen.gaps) == (7, [])


def test_a_gap_that_nobody_fills_is_forgotten():
    unseen = UnseenNumbers(0)
    unseen.mark_seen([5], START)
    almost = START + PATIENCE - timedelta(seconds=1)
    unseen.mark_seen([7], almost)
    assert unseen.gaps == [(1, 4), (6, 6)]
    unseen.mark_seen([], START + PATIENCE)
    assert unseen.gaps == [(6, 6)]


def test_a_gap_does_not_grow_younger_by_being_filled_in_part():
    unseen = UnseenNumbers(0)
    unseen.mark_seen([9], START)
    unseen.mark_seen([4], START + PATIENCE / 2)
    unseen.mark_seen([], START + PATIENCE)
    assert unseen.gaps == []


def test_not_more_gaps_are_kept_than_can_be_asked_for():
    unseen = UnseenNumbers(0)
    unseen.mark_seen(range(0, 10_000, 2), START)
    assert len(unseen.gaps) == MOST_GAPS
    assert unseen.gaps[-1] == (9997, 9997)


@given(st.lists(st.sets(st.integers(1, 40)), max_size=6))
def test_every_number_is_either_seen_or_still_asked_for(looks):
    unseen = UnseenNumbers(0)
    seen = set()
    for appeared in looks:
        asked = {n for n in appeared if n > unseen.highest} | {
            n for first, last in unseen.gaps for n in appeared if first <= n <= last
        }
        seen |= asked
        unseen.mark_seen(asked, START)
    waiting = {n for first, last in unseen.gaps for n in range(first, last + 1)}
    assert seen | waiting == set(range(1, unseen.highest + 1))
    assert not seen & waiting


def test_known_numbers_leave_what_others_may_still_show():
    unseen = UnseenNumbers(10)
    unseen.mark_known([12, 13, 16], START)
    assert (unseen.highest, unseen.gaps) == (16, [(11, 11), (14, 15)])
    unseen.mark_seen([11, 17], START)
    assert (unseen.highest, unseen.gaps) == (17, [(14, 15)])


def test_known_numbers_with_too_much_between_are_asked_for_nevertheless():
    unseen = UnseenNumbers(0)
    unseen.mark_known(range(2, 10_000, 2), START)
    assert (unseen.highest, unseen.gaps) == (0, [])
