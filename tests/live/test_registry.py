"""Machines in memory: replaced whole, and only by newer ones."""

from datetime import timedelta

import pytest

from app.geometry.chain import Chain
from app.live.registry import Arrived, LiveModel, LiveRegistry
from app.services.load_machine import compile_version
from app.thermal.machine import Machine, Sensor
from app.thermal.reading import Reading
from tests.service_examples import START


def live(revision, born=START, version=1):
    machine = Machine("m", "M", Chain.parse("XYFZ"), sensors={"a": Sensor("a")})
    return LiveModel(compile_version(machine, None), version, born, revision, START)


def publish(registry, model, readings=()):
    machine = registry.publish(model)
    machine.add(Arrived(list(readings), 0), END)
    return machine


END = START + timedelta(days=1)
READING = Reading(START, {"a": 20.0}, {})
LATER = Reading(START + timedelta(seconds=60), {"a": 21.0}, {})


def test_a_registry_begins_empty():
    registry = LiveRegistry()
    assert len(registry) == 0
    assert registry.get("m") is None
    assert registry.stamps() == {}
    assert registry.ids() == set()
    registry.forget("m")
    assert registry.get("m") is None


def test_a_newer_revision_replaces_an_older_one_and_keeps_the_readings():
    registry = LiveRegistry()
    publish(registry, live(1), [READING])
    newer = live(2)
    registry.publish(newer)
    assert registry.get("m").current is newer
    assert registry.get("m").readings.latest == READING
    assert registry.stamps() == {"m": (START, 2, 0)}
    assert registry.ids() == {"m"}
    assert len(registry) == 1


def test_an_older_revision_that_comes_late_is_passed_over():
    registry = LiveRegistry()
    newer = live(2)
    publish(registry, newer, [READING])
    assert publish(registry, live(1), [LATER]).current is newer
    assert registry.get("m").current is newer
    assert registry.get("m").readings.latest == LATER, "its readings are no older for that"


def test_a_machine_made_again_begins_anew():
    registry = LiveRegistry()
    publish(registry, live(9), [READING])
    again = live(1, born=START + timedelta(seconds=1))
    registry.publish(again)
    assert registry.get("m").current is again
    assert registry.get("m").readings.latest is None


def test_a_machine_that_was_deleted_does_not_come_back_over_its_successor():
    registry = LiveRegistry()
    again = live(1, born=START + timedelta(seconds=1))
    registry.publish(again)
    registry.publish(live(9))
    assert registry.get("m").current is again
    assert registry.get("m").readings.latest is None


def test_readings_are_added_to_machines_in_memory():
    registry = LiveRegistry()
    publish(registry, live(1), [READING])
    registry.get("m").add(Arrived([LATER], 0), END)
    assert registry.get("m").readings.latest == LATER
    registry.forget("m")
    assert registry.get("m") is None
    registry.publish(live(1))
    assert registry.get("m").readings.latest is None


def test_a_reader_keeps_what_it_has_taken():
    """A request that began before a change ends with the model it began with."""
    registry = LiveRegistry()
    registry.publish(live(1, version=1))
    taken = registry.get("m").current
    registry.publish(live(2, version=2))
    assert taken.version == 1
    with pytest.raises(AttributeError):
        taken.version = 3


def test_what_is_read_again_replaces_what_was_there_but_for_what_came_meanwhile():
    machine = publish(LiveRegistry(), live(1), [READING])
    with machine.noting_arrivals() as meanwhile:
        machine.add(Arrived([LATER], 0), END)
    machine.reread(Arrived([], 0), meanwhile, END)
    assert machine.readings.held.used == (LATER,)
    assert not machine.is_behind


def test_what_came_before_a_withdrawal_is_read_again_after_it():
    """Whether it was withdrawn too, only the database knows."""
    machine = publish(LiveRegistry(), live(1), [READING])
    with machine.noting_arrivals() as meanwhile:
        machine.add(Arrived([LATER], 0), END)
    machine.reread(Arrived([READING], 1), meanwhile, END)
    assert machine.readings.latest == READING
    assert machine.is_behind
    machine.reread(Arrived([READING], 1), [], END)
    assert not machine.is_behind
    machine.add(Arrived([LATER], 0), END)
    assert machine.readings.latest == READING
    assert machine.is_behind


def test_who_read_earlier_does_not_undo_who_read_later():
    machine = publish(LiveRegistry(), live(1))
    machine.reread(Arrived([], 2), [], END)
    machine.reread(Arrived([READING], 1), [], END)
    assert machine.readings.latest is None


def test_it_knows_from_which_time_on_the_database_has_nothing():
    registry = LiveRegistry()
    machine = publish(registry, live(1), [READING])
    assert not machine.has_none_from(LATER.time), "what was stored before is not known here"
    machine.reread(Arrived([READING], 0), [], END)
    assert machine.has_none_from(LATER.time)
    assert not machine.has_none_from(READING.time)
    ahead = Reading(END + timedelta(seconds=60), {"a": 21.0}, {})
    machine.add(Arrived([LATER, ahead], 0), END)
    assert not machine.has_none_from(LATER.time)
    assert not machine.has_none_from(ahead.time)
    assert machine.has_none_from(ahead.time + timedelta(microseconds=1))
    machine.expect(1)
    assert not machine.has_none_from(ahead.time + timedelta(days=1))
