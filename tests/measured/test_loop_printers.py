"""The loop on two printers: the bed, a second source of heat that their maps do not know."""

import pytest

from app.identification.analysis.analyse import analyse
from examples.measured.data_folder import data_folder
from examples.measured.loop import (
    MAY_BE_ADOPTED,
    Figures,
    close_the_loop,
    effects_of,
    measured_and_left,
    without_ranges,
)
from examples.measured.printers import FOLDER, PARTS, PRINTERS, campaign, read_homings

pytestmark = pytest.mark.skipif(
    not (data_folder() / FOLDER).is_dir(), reason=f"no measured printers at {data_folder()}"
)

FACTOR = {"voron": 5.0, "annex": 3.0}


def said_to_move_z(effects):
    """Sensors of what was found, and of what is said to be tied with it."""
    return {
        sensor
        for found in effects
        for one in (found.effect, *(other for other in found.alternatives if other.tied))
        for sensor in one.sensors
    }


@pytest.mark.slow
@pytest.mark.parametrize("name", PRINTERS)
def test_the_bed_is_found_and_what_was_left_out_is_predicted(name):
    printer = PRINTERS[name]
    known, asked = campaign(printer, read_homings(data_folder(), printer), part=0)
    rounds = close_the_loop(known, most_rounds=1)
    strongest = rounds[0].adopted[0]
    assert "bed" in said_to_move_z(rounds[0].adopted)
    assert strongest.effect.kind in ("additional-sensor", "sensor-gradient")
    # Four sensors that warm in one run: which of them it is, and how late, is not sure.
    assert {found.status for found in rounds[0].adopted} == {"suspected"}
    before = Figures.of(measured_and_left(known, asked)[2]).rms
    effects = effects_of(known, rounds)
    after = Figures.of(measured_and_left(known, asked, effects)[2]).rms
    # The stretch left out has the cold start, a hot bed under a cold frame, which nothing else
    # of the run has: the effect of the bed is held there. Let go on, it is right there too.
    free = Figures.of(measured_and_left(known, asked, without_ranges(effects))[2]).rms
    assert free < before / FACTOR[name]
    assert after < before


@pytest.mark.slow
@pytest.mark.parametrize("part", range(PARTS))
def test_that_z_follows_the_bed_late_is_named_whatever_is_left_out(part):
    """Some three minutes: until shorter ones than five were tried, it was another sensor's."""
    printer = PRINTERS["annex"]
    known, _ = campaign(printer, read_homings(data_folder(), printer), part)
    strongest = analyse(known, kinds=MAY_BE_ADOPTED).effects[0]
    # The nozzle hardly moves: what the bed does, and what it does less the nozzle, is the same.
    either = {(strongest.kind, strongest.effect.sensors)}
    either |= {(a.kind, a.sensors) for a in strongest.alternatives if a.tied}
    assert either & {("additional-sensor", ("bed",)), ("sensor-gradient", ("bed", "nozzle"))}
    assert "bed" in strongest.effect.sensors
    assert 1.0 < strongest.effect.parameters["time_constant_min"] < 5.0


@pytest.mark.slow
def test_what_is_quicker_than_the_frame_is_the_bed_and_no_wrong_clock():
    """Z is ahead of the frame, as if the frame reported some minutes late."""
    printer = PRINTERS["annex"]
    known, _ = campaign(printer, read_homings(data_folder(), printer), part=0)
    answer = analyse(known)
    assert "bed" in said_to_move_z(answer.effects)
    assert answer.effects[0].helps
    untested = {one.kind: one.reason for one in answer.not_testable}
    assert "EZZ" in untested["late-sensor"]
    assert "EZZ" in untested["clock-offset"]
    assert not {"late-sensor", "clock-offset"} & {one.effect.kind for one in answer.effects}
