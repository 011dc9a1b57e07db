"""Instruments that lie: what they do is named, and nothing of it is adopted."""

import numpy as np
import pytest

from app.identification.analysis.analyse import analyse
from app.simulation.undeclared import make_campaign, make_record
from scripts.campaign_of_bodies import campaign_of_bodies

KINDS = ("outdated-map", "instrument-warm-up", "thermal-lag")


def analysed(made, verifications=None, kinds=KINDS):
    own = made.verifications if verifications is None else verifications
    return analyse(
        campaign_of_bodies(made.machine, made.error_maps, made.readings, own), kinds=kinds
    )


@pytest.mark.slow
def test_a_laser_that_warms_up_in_every_visit_is_no_outdated_map():
    """2 µm and µrad within some five minutes of each visit, and the machine as its model says."""
    made = make_campaign(91, visits=40, warm_up_um=2.0, warm_up_min=5.0)
    found = analysed(made).effects
    warm = [e for e in found if e.kind == "instrument-warm-up"]
    assert warm
    tau_min = [e.effect.parameters["time_constant_min"] for e in warm]
    assert 2.0 <= np.median(tau_min) <= 12.0
    assert not any(e.helps for e in found)
    assert all("mounting" in e.why_not for e in warm)


@pytest.mark.slow
def test_zeros_declared_wrongly_are_no_outdated_maps():
    made = make_record(101, hours=6.0, datum="first")
    absolute = [body | {"datum": "absolute"} for body in made.verifications]
    found = analysed(made, absolute)
    assert found.effects == ()
    assert "the first value of every component is exactly 0" in found.not_testable[0].reason
    assert found.what_next[0].startswith("Store 'record' again with the datum `first`")


@pytest.mark.slow
def test_the_constant_of_one_mounting_is_no_outdated_map():
    """Blocks with pauses of 12 min between them, in one set-up that is 2 µm and µrad off."""
    made = make_record(71, hours=8.0, setup_shift_um=2.0, setup_tilt_um=1.0)
    assert analysed(made).effects == ()


@pytest.mark.slow
@pytest.mark.parametrize("seed", [704, 707])
def test_set_ups_much_like_the_ones_before_are_nothing_in_the_machine(seed):
    """15 of them: drifts, maps, a warm-up and more were found, or something unexplained."""
    alike = {"setup_shift_um": 1.0, "setup_tilt_um": 0.5, "setup_correlation": 0.85}
    made = make_campaign(seed, visits=15, **alike)
    found = analysed(made, kinds=None)
    assert (found.verdict, found.effects) == ("nothing-found", ())


@pytest.mark.slow
def test_one_short_visit_far_from_the_model_is_not_judged():
    """It was “nothing found”: 4 µm off in one set-up may be the machine or its mounting."""
    made = make_campaign(5, visits=20)
    one = made.verifications[0]
    assert analysed(made, [one]).verdict == "nothing-found"
    moved = [
        o | {"measured_um": o["measured_um"] + 4.0} if "component" in o else o
        for o in one["observations"]
    ]
    found = analysed(made, [one | {"observations": moved}])
    assert (found.verdict, found.effects) == ("not-judged", ())
    assert "in one set-up, where repeatability and maps explain" in found.summary
    assert any("at least 8 set-ups" in words for words in found.what_next)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "planted", "size", "status"),
    [(32, "coolant-valve", 4.0, "suspected"), (41, "thermal-lag:component", 2.0, "confirmed")],
)
def test_what_imitates_a_hidden_cause_in_one_record_is_not_confirmed(seed, planted, size, status):
    """A valve that nobody logs was confirmed as a sensor gradient: stretches held out showed it.

    What the gradient leaves wanders there as in no other component; beside a lag nothing does.
    """
    made = make_record(seed, planted, size, hours=12.0)
    found = analysed(made, kinds=("thermal-lag", "sensor-gradient", "state-variable")).effects
    assert {e.status for e in found} == {status}
    odd = "what it leaves wanders unlike the residuals of any other component"
    assert all((odd in e.doubts) == (status == "suspected") for e in found)


LENGTHS = ("instrument-compensation", "additional-sensor", "sensor-gradient", "other-sensor")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("per_k", "sensor", "words"),
    [(-0.93, "ambient", "air temperature"), (11.7, "bed", "the temperature of the steel")],
)
def test_lengths_that_no_instrument_corrected_are_no_expansion_of_the_machine(per_k, sensor, words):
    """They were confirmed as three sensitivities to the room; adopting these did harm."""
    made = make_campaign(3, visits=30, length_um_per_m_per_k=per_k, length_sensor=sensor)
    answer = analysed(made, kinds=LENGTHS)
    (found,) = answer.effects
    assert (found.kind, found.effect.sensors) == ("instrument-compensation", (sensor,))
    size = found.effect.parameters["length_um_per_m_per_k"]
    error = found.effect.standard_errors["length_um_per_m_per_k"]
    assert abs(size - per_k) < 4.0 * error
    assert error < 0.2 * abs(per_k)
    assert found.status == "suspected"
    assert not found.helps
    assert words in found.explanation
    assert answer.what_next[0].startswith("Look at the instrument first")


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "axes", "visits"), [(7, 2, 30), (8, 3, 60)])
def test_a_machine_whose_scales_expand_is_not_called_an_instrument(seed, axes, visits):
    """With seed 8 X and Y follow one sensor, not alike: it was one size, and a rest of Y's own."""
    made = make_campaign(seed, ["additional-sensor:expansion"] * axes, 2.0, visits=visits)
    found = analysed(made, kinds=LENGTHS).effects
    told = {e.effect.components: e.effect.sensors for e in found if e.kind == "additional-sensor"}
    assert len(found) == len(told) == axes
    assert told == {tuple(e["components"]): tuple(e["sensors"]) for e in made.truth.effects}
    assert all(e.helps for e in found)


@pytest.mark.slow
def test_on_one_axis_alone_nobody_can_tell_air_from_a_scale():
    """The same lengths of X, and of nothing else."""
    made = make_campaign(3, visits=60, length_um_per_m_per_k=-0.93)
    lines = [
        body | {"observations": [o for o in body["observations"] if o.get("component") == "EXX"]}
        for body in made.verifications
    ]
    found = analysed(made, [body for body in lines if body["observations"]], LENGTHS).effects
    assert found
    for effect in found:
        either = {effect.kind, *(a.kind for a in effect.alternatives if a.tied)}
        assert "instrument-compensation" in either
        assert (effect.status, effect.helps) == ("suspected", False)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 3])
def test_sensors_whose_readings_scatter_are_neither_late_nor_by_another_clock(seed):
    made = make_campaign(seed, visits=16, days=4, observations_per_visit=24)
    noise = np.random.default_rng(seed)
    read = [
        body
        | {
            "temperatures_c": {
                name: round(at_c + noise.normal(0.0, 0.4), 2)
                for name, at_c in body["temperatures_c"].items()
            }
        }
        for body in made.readings
    ]
    found = analyse(
        campaign_of_bodies(made.machine, made.error_maps, read, made.verifications),
        kinds=("clock-offset", "thermal-lag", "late-sensor"),
    )
    assert found.effects == ()
    assert any("from reading to reading" in one.reason for one in found.not_testable)
