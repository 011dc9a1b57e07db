"""A machine's sensors, their stand-ins, and what a description may not say."""

import pytest

from app.errors import InvalidContent, UnknownThing
from app.geometry.chain import Chain
from app.thermal.machine import Machine, Sensor, Travel, sensors_by_name
from tests.thermal.example_maps import machine


def names(sensors):
    return [sensor.name for sensor in sensors]


def test_the_chapters_machine_lets_y_front_stand_in_for_x_middle():
    assert names(machine().with_stand_ins("x-middle")) == ["x-middle", "y-front"]
    assert names(machine().with_stand_ins("spindle")) == ["spindle"]


def test_stand_ins_are_followed_nearest_first_and_a_circle_ends():
    chain = machine(Sensor("a", stand_in="b"), Sensor("b", stand_in="c"), Sensor("c", stand_in="a"))
    assert names(chain.with_stand_ins("a")) == ["a", "b", "c"]
    assert names(chain.with_stand_ins("c")) == ["c", "a", "b"]


def test_default_sensors():
    assert machine().default_sensor("EXX") == "x-middle"
    assert machine().default_sensor("EBZ") == "z-column"
    assert machine().default_sensor("XOC") is None
    assert machine(Sensor("bed")).default_sensor("EXX") == "bed"
    assert machine(Sensor("bed")).default_sensor("XOC") == "bed"
    assert machine(Sensor("bed"), Sensor("ram")).default_sensor("EXX") is None
    assert machine(Sensor("bed"), Sensor("z-column")).default_sensor("EZZ") == "z-column"


@pytest.mark.parametrize(
    ("difference_c", "resolved"),
    [(0.1, True), (20.4 - 20.3, True), (0.3 - 0.2, True), (0.0999, False), (0.0, False)],
)
def test_a_resolution_of_a_tenth_resolves_a_tenth(difference_c, resolved):
    assert Sensor("a", resolution_c=0.1).resolves(difference_c) is resolved


def test_no_resolution_resolves_nothing():
    assert not Sensor("a", resolution_c=0.0).resolves(0.0)
    assert Sensor("a", resolution_c=0.0).resolves(1e-12)
    assert not Sensor("a").resolves(float("nan"))


@pytest.mark.parametrize(
    ("value", "accepted", "kelvin"),
    [
        (-50.0, True, False),
        (150.0, True, False),
        (-50.1, False, False),
        (293.15, False, True),
        (223.15, False, True),
        (424.0, False, False),
        (float("nan"), False, False),
        (float("inf"), False, False),
    ],
)
def test_the_range_and_what_looks_like_kelvin(value, accepted, kelvin):
    sensor = Sensor("spindle")
    assert sensor.accepts(value) is accepted
    assert sensor.looks_like_kelvin(value) is kelvin


def test_what_is_believable_in_celsius_is_not_taken_for_kelvin():
    """A furnace's sensor up to 400 °C: 300 may be either, so it is what was said."""
    assert not Sensor("furnace", max_c=400.0).looks_like_kelvin(300.0)
    assert Sensor("furnace", max_c=400.0).looks_like_kelvin(500.0)


def test_the_sentence_on_kelvin_says_what_was_meant():
    assert Sensor("spindle").expectation(295.25) == (
        "expected a temperature of spindle from -50 to 150 °C, got 295.25, which would be "
        "22.10 °C if it was meant in kelvin, and 29.52 °C in tenths of a degree"
    )
    assert "kelvin" not in Sensor("spindle").expectation(999.0)


def test_an_unknown_sensor_lists_those_that_exist():
    with pytest.raises(UnknownThing, match="has no sensor 'bed'; it has x-middle, y-front"):
        machine().sensor("bed")


@pytest.mark.parametrize(
    ("sensor", "field", "sentence"),
    [
        (Sensor("a", stand_in="b"), "sensors.a.stand_in", "another sensor of this machine (none)"),
        (Sensor("a", stand_in="a"), "sensors.a.stand_in", "got 'a'"),
        (Sensor("a", min_c=20.0, max_c=20.0), "sensors.a", "got 20 and 20 °C"),
        (Sensor("a", min_c=float("nan")), "sensors.a", "expected min_c below max_c, got nan"),
        (Sensor(""), "sensors", "got ''"),
        (Sensor("ä/b"), "sensors", "got 'ä/b'"),
        (Sensor("x" * 65), "sensors", "1 to 64 letters"),
    ],
)
def test_what_cannot_be_a_sensor_is_refused(sensor, field, sentence):
    with pytest.raises(InvalidContent) as refusal:
        machine(sensor)
    assert sentence in refusal.value.detail
    assert refusal.value.errors[0].field == field


def test_every_name_that_no_sensor_can_have_is_listed_at_once():
    with pytest.raises(
        InvalidContent, match=r"beginning with a letter or digit.*got '-Öl', 'a/b'$"
    ):
        machine(Sensor("-Öl"), Sensor("bed"), Sensor("a/b"))


@pytest.mark.parametrize(
    ("axes", "sentence"),
    [
        ({"b": Travel(0.0, 1.0)}, "expected the axes of XYFZ (x, y, z), got 'b'"),
        ({"x": Travel(500.0, 0.0)}, "expected min_mm below max_mm, got 500 and 0 mm"),
        ({"x": Travel(0.0, 0.0)}, "expected min_mm below max_mm, got 0 and 0 mm"),
    ],
)
def test_what_cannot_be_an_axis_is_refused(axes, sentence):
    with pytest.raises(InvalidContent) as refusal:
        Machine("m", "M", Chain.parse("XYFZ"), axes=axes)
    assert sentence in refusal.value.detail


def test_two_sensors_of_one_name_are_refused():
    with pytest.raises(InvalidContent, match="expected each name once, got a more than once"):
        sensors_by_name([Sensor("a"), Sensor("b"), Sensor("a")])
