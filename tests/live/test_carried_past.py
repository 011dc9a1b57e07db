"""Filters carried along with readings from threads, in any order, and rebuilt when behind."""

import threading
from datetime import timedelta

import numpy as np
import pytest

from app.effects.conditions import Signal
from app.effects.past import Needed
from app.geometry.chain import Chain
from app.live.carried_past import REMEMBERED, CarriedPast
from app.thermal.machine import Machine, Sensor, sensors_by_name
from app.thermal.reading import Reading
from tests.service_examples import START

A = Signal("temperature", "a")
NEEDED = Needed(frozenset({(A, 300.0)}), frozenset({"rpm"}))
MACHINE = Machine(
    "m", "M", Chain.parse("XYFZ"), sensors=sensors_by_name([Sensor("a"), Sensor("b")])
)


def at(seconds, a=None):
    value = 20.0 + np.sin(seconds / 500.0) if a is None else a
    time = START + timedelta(seconds=seconds)
    return Reading(time, {"a": float(value), "b": 21.0}, {"rpm": float(seconds)})


MINUTES = [at(60.0 * i) for i in range(60)]


def output(past, seconds=59 * 60.0):
    return past.now.lags.lagged(A, 300.0, np.array([START.timestamp() + seconds]))[0]


def restored(readings):
    past = CarriedPast(MACHINE, NEEDED)
    past.restore(lambda: readings)
    return past


def test_it_is_behind_until_the_stored_history_was_read():
    past = CarriedPast(MACHINE, NEEDED)
    assert past.is_behind
    past.restore(list)
    assert not past.is_behind


def test_without_need_there_is_nothing_to_do():
    past = CarriedPast(MACHINE, Needed())
    assert not past.is_behind
    past.add([], MINUTES)
    past.restore(lambda: pytest.fail("nothing is to be read"))
    assert past.now.states == {}


@pytest.mark.parametrize("batch", [1, 7, 60])
def test_one_by_one_in_batches_and_restored_are_the_same(batch):
    expected = output(restored(MINUTES))
    assert np.isfinite(expected)
    past = restored([])
    for i in range(0, 60, batch):
        past.add(MINUTES[:i], MINUTES[i : i + batch])
    assert not past.is_behind
    assert output(past) == pytest.approx(expected, rel=1e-12)
    assert past.now.states["rpm"] == (MINUTES[-1].time.timestamp(), 3540.0)


def test_the_same_again_changes_nothing():
    past = restored(MINUTES)
    before = past.now
    past.add(MINUTES, MINUTES[10:20])
    assert past.now is before
    assert not past.is_behind


def test_a_late_reading_puts_it_behind_and_restoring_takes_it_in():
    past = restored(MINUTES)
    late = at(90.0, a=20.3)
    past.add(MINUTES, [late])
    assert past.is_behind
    everything = sorted([*MINUTES, late], key=lambda r: r.time)
    past.restore(lambda: everything)
    assert output(past) == output(restored(everything))


def test_a_value_that_jumped_is_not_filtered():
    spoilt = [*MINUTES[:40], at(2400.0, a=70.0), *MINUTES[41:]]
    expected = output(restored([*MINUTES[:40], *MINUTES[41:]]))
    assert output(restored(spoilt)) == pytest.approx(expected, rel=1e-12)
    past = restored([])
    for i, reading in enumerate(spoilt):
        past.add(spoilt[:i], [reading])
    assert output(past) == pytest.approx(expected, rel=1e-12)


def test_what_arrives_while_it_is_being_restored_is_not_lost():
    past = CarriedPast(MACHINE, NEEDED)

    def read():
        past.add(MINUTES[:30], MINUTES[30:])  # committed after the question was asked
        return MINUTES[:30]

    past.restore(read)
    assert not past.is_behind
    assert output(past) == output(restored(MINUTES))


def test_readings_stored_before_and_added_after_it_was_restored_are_known():
    past = restored(MINUTES)
    past.add([], MINUTES[-5:])
    assert not past.is_behind


def test_a_failure_to_read_leaves_it_behind_and_what_it_knew_in_place():
    past = restored(MINUTES)
    past.add(MINUTES, [at(90.0)])
    before = output(past)

    def away():
        raise ConnectionError

    with pytest.raises(ConnectionError):
        past.restore(away)
    assert past.is_behind
    assert output(past) == before
    past.restore(lambda: MINUTES)
    assert not past.is_behind


def test_memory_of_what_is_known_is_bounded():
    many = [at(float(i)) for i in range(REMEMBERED + 500)]
    past = restored(many)
    past.add([], many[-REMEMBERED:])
    assert not past.is_behind
    past.add([], many[:1])
    assert past.is_behind  # forgotten: asking the history is always right


def test_other_settings_of_the_sensors_need_another_past():
    past = restored(MINUTES)
    assert past.serves(MACHINE, NEEDED)
    assert not past.serves(MACHINE, Needed())
    stricter = sensors_by_name([Sensor("a", max_c=30.0), Sensor("b")])
    assert not past.serves(Machine("m", "M", MACHINE.chain, sensors=stricter), NEEDED)


def test_threads_that_add_and_restore_lose_nothing():
    past = restored([])
    stored, lock = [], threading.Lock()

    def writer(k):
        for reading in MINUTES[k::4]:
            with lock:
                stored.append(reading)
            past.add([], [reading])
            past.restore(lambda: sorted(stored, key=lambda r: r.time))

    threads = [threading.Thread(target=writer, args=(k,)) for k in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    past.restore(lambda: sorted(stored, key=lambda r: r.time))
    assert not past.is_behind
    assert output(past) == pytest.approx(output(restored(MINUTES)), rel=1e-12)
