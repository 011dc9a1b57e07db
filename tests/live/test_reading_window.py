"""The latest readings of one machine in memory."""

import threading
from datetime import timedelta

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.geometry.chain import Chain
from app.live import reading_window
from app.live.reading_window import LIMIT
from app.thermal.machine import Machine, Sensor, sensors_by_name
from app.thermal.reading import Reading
from app.thermal.sensor_health import RECENT, Health, record_needed_s
from tests.service_examples import START

END = START + timedelta(days=365)


class ReadingWindow(reading_window.ReadingWindow):
    """One in which everything has come already, unless something else is stated."""

    def add(self, machine, readings, until=END):
        return super().add(machine, readings, until)


def until(seconds):
    return START + timedelta(seconds=seconds)


def machine(*sensors):
    return Machine("m", "M", Chain.parse("XYFZ"), sensors=sensors_by_name(list(sensors)))


TWO = machine(Sensor("a", stuck_after_s=600.0), Sensor("b"))


def at(seconds, a=20.0, b=20.0):
    return Reading(START + timedelta(seconds=seconds), {"a": a, "b": b}, {})


def only(seconds, sensor, value=20.0):
    return Reading(START + timedelta(seconds=seconds), {sensor: value}, {})


def kept(window, seconds=range(-100_000, 100_000)):
    """Which of these times [s] a window still has; found by looking, not by its inside."""
    return [r.time for r in window.held.used if r.time >= START + timedelta(seconds=seconds[0])]


def test_an_empty_window_has_no_latest_reading():
    assert ReadingWindow().latest is None
    assert {s.health for s in ReadingWindow().judge(TWO)} == {Health.MISSING}


@pytest.mark.slow
@given(st.permutations(range(20)))
def test_the_order_of_arrival_does_not_count(order):
    window = ReadingWindow()
    for i in order:
        window.add(TWO, [at(60.0 * i, a=20 + 0.01 * i)])
    assert window.latest == at(60.0 * 19, a=20.19)
    states = {s.sensor: s for s in window.judge(TWO)}
    assert states["a"].temperature_c == 20.19
    assert len(kept(window)) == 20


def test_the_same_reading_again_changes_nothing():
    window = ReadingWindow()
    window.add(TWO, [at(0), at(60)])
    window.add(TWO, [at(0), at(60)])
    assert len(kept(window)) == 2


def test_what_is_known_at_a_time_stays():
    window = ReadingWindow()
    window.add(TWO, [at(0, a=20.0)])
    window.add(TWO, [at(0, a=99.0)])
    assert window.latest == at(0, a=20.0)


def test_readings_older_than_twice_the_longest_time_to_be_stuck_are_dropped():
    assert record_needed_s(TWO.sensors.values()) == 7200.0
    window = ReadingWindow()
    window.add(TWO, [at(0), at(100), at(7290), at(7300)])
    assert kept(window) == [at(100).time, at(7290).time, at(7300).time]
    window.add(TWO, [at(-10_000)])
    assert kept(window) == [at(100).time, at(7290).time, at(7300).time]


def test_sensors_that_report_apart_from_each_other_are_all_kept():
    """Two gateways once a minute, 2 s apart; and one sensor that reports only now and then."""
    window = ReadingWindow()
    for minute in range(300):
        window.add(TWO, [only(60.0 * minute, "a"), only(60.0 * minute + 2.0, "b")])
        assert {s.health for s in window.judge(TWO)} == {Health.OK}
    fast = ReadingWindow()
    fast.add(TWO, [only(5.0, "b")])
    for second in range(600):
        fast.add(TWO, [only(float(second), "a")])
    assert {s.sensor: s.health for s in fast.judge(TWO)} == {"a": Health.OK, "b": Health.OK}


def test_a_sensors_newest_value_stays_however_old_it_is():
    window = ReadingWindow()
    window.add(TWO, [only(0.0, "b")])
    window.add(TWO, [only(100_000.0 + i, "a") for i in range(50)])
    states = {s.sensor: s for s in window.judge(TWO)}
    assert (states["b"].health, states["b"].temperature_c) == (Health.STALE, 20.0)


def test_a_jump_is_seen_however_long_the_window():
    patient = machine(Sensor("a", stuck_after_s=86_400.0), Sensor("b"))
    window = ReadingWindow()
    window.add(patient, [at(float(i)) for i in range(600)])
    window.add(patient, [at(600.0, a=50.0)])
    assert {s.sensor: s.health for s in window.judge(patient)}["a"] is Health.JUMP


@pytest.mark.slow
def test_fast_readings_are_thinned_but_the_newest_is_always_there():
    window = ReadingWindow()
    for i in range(20_000):
        if i % 7 == 0:
            window.add(TWO, [at(0.9 * i)])
            assert window.latest == at(0.9 * i)
    times = kept(window)
    assert len(times) <= LIMIT + RECENT
    assert times[-1] - times[0] > timedelta(seconds=7000)


@pytest.mark.slow
def test_a_single_batch_is_thinned_like_readings_one_by_one():
    one_by_one, at_once = ReadingWindow(), ReadingWindow()
    readings = [at(2.0 * i) for i in range(3000)]
    for reading in readings:
        one_by_one.add(TWO, [reading])
    at_once.add(TWO, readings)
    assert kept(one_by_one) == kept(at_once)


def test_a_machine_without_sensors_keeps_its_latest_reading():
    window = ReadingWindow()
    window.add(machine(), [at(0), at(60)])
    assert window.latest == at(60)
    assert window.judge(machine()) == []


def test_sensors_are_judged_by_the_settings_that_hold_now():
    window = ReadingWindow()
    window.add(TWO, [at(0, a=20.0)])
    assert {s.sensor: s.health for s in window.judge(TWO)}["a"] is Health.OK
    stricter = machine(Sensor("a", max_c=19.0), Sensor("b"), Sensor("new"))
    states = {s.sensor: s.health for s in window.judge(stricter)}
    assert states == {"a": Health.OUT_OF_RANGE, "b": Health.OK, "new": Health.MISSING}


def test_judging_again_follows_new_readings():
    window = ReadingWindow()
    window.add(TWO, [at(0, a=20.0)])
    window.judge(TWO)
    window.add(TWO, [at(60, a=21.0)])
    assert {s.sensor: s.temperature_c for s in window.judge(TWO)}["a"] == 21.0


def test_readings_from_many_threads_all_arrive():
    window = ReadingWindow()
    threads = [
        threading.Thread(
            target=lambda k=k: [window.add(TWO, [at(10.0 * (8 * i + k))]) for i in range(50)]
        )
        for k in range(8)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert kept(window) == [at(10.0 * i).time for i in range(400)]


@pytest.mark.parametrize("step_s", [0.5, 1.0, 9.99, 10.0, 60.0])
def test_a_stuck_sensor_is_found_however_fast_the_readings_come(step_s):
    window = ReadingWindow()
    count = int(960 / step_s)  # b has moved by 1 °C after 250 s, and 600 s more may pass
    window.add(TWO, [at(step_s * i, a=20.0, b=20.0 + 0.004 * step_s * i) for i in range(count)])
    assert {s.sensor: s.health for s in window.judge(TWO)}["a"] is Health.STUCK


# --- what lies in the future ----------------------------------------------------------------


def test_what_lies_ahead_is_kept_and_not_used_until_its_time():
    window = ReadingWindow()
    assert window.add(TWO, [at(58, a=30.0), at(0)], until(2)) == [at(0)]
    assert (window.latest, window.held.ahead) == (at(0), (at(58, a=30.0),))
    assert {s.sensor: s.temperature_c for s in window.judge(TWO)}["a"] == 20.0
    assert window.held.is_as_of(until(57))
    assert not window.held.is_as_of(until(58))
    assert window.add(TWO, [], until(58)) == [at(58, a=30.0)]
    assert (window.latest, window.held.ahead) == (at(58, a=30.0), ())


def test_a_clock_that_is_set_back_puts_what_was_used_ahead():
    window = ReadingWindow()
    window.add(TWO, [at(0), at(30), at(60)], until(60))
    assert window.held.reaches_past(until(31))
    window.add(TWO, [], until(31))
    assert (window.latest, window.held.ahead) == (at(30), (at(60),))


@given(st.permutations(range(12)), st.integers(-1, 11), st.integers(-1, 11))
def test_what_is_used_depends_on_the_time_alone(order, first, last):
    window = ReadingWindow()
    for i in order:
        window.add(TWO, [at(10.0 * i)], until(10.0 * first))
    window.add(TWO, [], until(10.0 * last))
    assert kept(window) == [at(10.0 * i).time for i in range(last + 1)]
    assert [r.time for r in window.held.ahead] == [at(10.0 * i).time for i in range(last + 1, 12)]


def test_of_many_ahead_the_first_are_kept_and_no_later_one_takes_their_place():
    window = ReadingWindow()
    most = reading_window.MOST_AHEAD
    window.add(TWO, [at(10.0 * i) for i in range(1, most + 11)], until(0))
    assert (len(window.held.ahead), window.held.more_ahead) == (most, True)
    window.add(TWO, [], until(100))
    window.add(TWO, [at(1e6)], until(100))
    assert window.held.ahead[-1] == at(10.0 * most)
    window.replace(TWO, [at(0), at(1e6)], until(100))
    assert (window.held.ahead, window.held.more_ahead) == ((at(1e6),), False)


def test_what_is_dropped_is_gone():
    window = ReadingWindow()
    window.add(TWO, [at(0), at(10), at(20), at(30)], until(15))
    window.drop(until(10), until(20))
    assert (window.held.used, window.held.ahead) == ((at(0),), (at(30),))


def test_a_reading_that_was_ahead_and_comes_again_is_taken_once():
    window = ReadingWindow()
    early, later = at(0), at(60)
    assert window.add(TWO, [early, later], until(30)) == [early]
    assert window.add(TWO, [later, at(50)], until(90)) == [later, at(50)]
    assert window.latest == later
