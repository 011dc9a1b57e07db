"""Channels of few set-ups: what is the set-ups' own is nothing unexplained."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

from app.effects.effect import Effect
from app.identification.analysis.analyse import analyse
from app.identification.analysis.not_judged import (
    TooLarge,
    not_judged,
    stays_large,
    with_what_stays_large,
    withhold,
)
from app.search.findings import FAR_OFF, ChannelNoise, Figure, Floor, HeldOut, Status, Verdict
from app.search.rows import Nuisance, Rows
from app.simulation.undeclared import make_campaign
from app.storage.analysis_results import RESULTS
from scripts.campaign_of_bodies import campaign_of_bodies
from tests.pages.example_analyses import NOTHING

CHANNELS, SETUPS, EACH = 20, 8, 8
CODES = tuple(f"E{a}{b}" for a in "XYZABC" for b in "XYZ")[:CHANNELS]


def finished(shift, *, off=0.0, status=Status.CONFIRMED, seed=0, origin="declared"):
    """Each channel in two of eight set-ups, which scatter by `shift`; the first is off by more."""
    random = np.random.default_rng(seed)
    count = len(CODES)
    channel = np.repeat(np.arange(count), 2 * EACH)
    setup = np.repeat((np.arange(2 * count) * 3) % SETUPS, EACH)
    values = random.normal(size=len(channel))
    values += np.repeat(shift * random.normal(size=2 * count), EACH) + off * (channel == 0)
    noise = {c: ChannelNoise(1.0, origin, 1.0, 2, 2 * EACH) for c in range(count)}
    floor = Floor(noise=1.0, setups=shift)
    figure = Figure(floor.total, floor.total, floor.total)
    held = dict.fromkeys(range(count), HeldOut(EACH, 1, figure, floor))
    findings = SimpleNamespace(
        noise=noise,
        held_out=held,
        terms=(SimpleNamespace(status=status),),
        verdict=Verdict.FOUND,
        unexplained=(),
    )
    return SimpleNamespace(
        rows=SimpleNamespace(values=values, channel=channel, visit=setup, datum={}),
        residuals=SimpleNamespace(rows=SimpleNamespace(channels=CODES)),
        use=np.ones(len(channel), dtype=bool),
        zeros=[],
        of_maps=(),
        findings=findings,
        effects=lambda: [Effect("backlash", ("EXX",))],
        explained=lambda effect: np.zeros(len(channel)),
    )


def left(monkeypatch, found):
    """Names of what is called unexplained."""
    said = []

    def replaced(one, **changes):
        said.extend(changes.get("unexplained", ()))
        return one

    monkeypatch.setattr("app.identification.analysis.not_judged.replace", replaced)
    with_what_stays_large(found)
    assert all(one.test == FAR_OFF for one in said)
    return {CODES[one.channel] for one in said}


@pytest.mark.parametrize("seed", range(10))
def test_what_setups_do_in_all_channels_is_nothing_unexplained(monkeypatch, seed):
    """It was said in 6 of 9 campaigns of 8 visits: of twenty channels some are always large."""
    found = finished(1.5, seed=seed)
    assert stays_large(found)  # and it is told of them that nothing more can be said
    assert left(monkeypatch, found) == set()


@pytest.mark.parametrize("seed", range(5))
def test_what_no_setup_elsewhere_does_stays_unexplained(monkeypatch, seed):
    found = finished(0.3, off=4.0, seed=seed)
    assert left(monkeypatch, found) == {"EXX"}


def test_beside_an_effect_that_nothing_confirms_all_of_it_does(monkeypatch):
    """It may be what the effect stands for."""
    found = finished(1.5, status=Status.SUSPECTED)
    assert left(monkeypatch, found) == {one.name for one in stays_large(found)}


def test_fewer_setups_than_tell_how_they_scatter_are_judged_by_the_repeatability(monkeypatch):
    found = finished(1.5)
    found.rows.visit[:] = found.rows.visit % 4
    assert left(monkeypatch, found)


@pytest.mark.slow
def test_what_maps_leave_open_where_no_effect_acts_is_nothing_unexplained():
    """Eight set-ups of one component, five of them known, say little of its two maps' errors."""
    made = make_campaign(3110, ["periodic:single"], 2.0, visits=40, later_visits=20)
    answer = analyse(
        campaign_of_bodies(made.machine, made.error_maps, made.readings, made.verifications)
    )
    assert (answer.verdict, answer.unexplained) == ("effects-found", ())
    assert [one.kind for one in answer.effects] == ["periodic"]


@pytest.mark.parametrize("seed", range(5))
def test_where_nothing_was_found_too_setups_may_scatter_as_in_the_other_channels(seed):
    found = finished(1.5, seed=seed)
    assert not not_judged(found)
    off = finished(0.3, off=4.0, seed=seed)
    assert [one.name for one in not_judged(off)] == ["EXX"]
    # Of four set-ups in all zeros knows.
    found.rows.visit[:] = found.rows.visit % 4
    assert not_judged(found)


@pytest.mark.parametrize(
    ("values", "named"),
    [
        ([9.8], True),
        ([9.8, -9.8], True),  # a tilt of the set-up, or the machine's slope
        ([9.8, 9.8], True),
        ([9.8, -9.8, 9.7, -9.6], False),  # repeated: as it is, however far off
        ([0.3], False),
    ],
)
def test_few_observations_are_not_their_own_scatter(values, named):
    """Maps explain 0.25 µm, and no repeatability is stated."""
    count, zeros = len(values), np.zeros(len(values), int)
    size = float(np.sqrt(np.mean(np.square(values))))
    places = np.array([-1.0, 1.0, -1.0, 1.0])[:count, None]
    rows = Rows(np.array(values), zeros, zeros, places, zeros - 1, minutes=1.0 * zeros)
    found = SimpleNamespace(
        rows=rows,
        residuals=SimpleNamespace(rows=SimpleNamespace(channels=("EXX",))),
        use=np.ones(count, dtype=bool),
        zeros=[],
        of_maps=[Nuisance(0, np.arange(count), np.full((count, 1), 0.25))],
        findings=SimpleNamespace(
            noise={0: ChannelNoise(size, "residuals", size, 1, count)}, held_out={}
        ),
    )
    large = not_judged(found)
    assert [one.name for one in large] == ["EXX"] * named
    if named:
        assert "of its own scatter" in large[0].sentence or "of their own" in large[0].sentence


def test_what_can_be_judged_is_said_and_what_cannot_is_named():
    answer = RESULTS.read_text(json.dumps(NOTHING))
    large = [TooLarge("SXY", 5.0, 1.2, "µm/m", 3)]
    said = withhold(answer, large, [], ["EXX", "EYY"])
    assert said.verdict == "not-judged"
    assert said.summary.startswith(
        "Nothing was found that the model lacks in EXX, EYY; nothing can be said about SXY: SXY "
        "has residuals of 5 µm/m (root mean square) in 3 set-ups"
    )
    alone = withhold(answer, large, [], [])
    assert alone.summary.startswith("Nothing can be said about the machine: SXY has")
    assert withhold(answer, [], [], ["EXX"]) is answer
