"""The visits that are proposed: they can be made, and planning takes them as they are."""

import json
from dataclasses import replace
from datetime import datetime, timedelta
from types import SimpleNamespace

import numpy as np
import pytest

from app.cli.analyse import write_visits
from app.effects.observations import Observation
from app.effects.registry import KINDS, separating_measurement
from app.files.csv_verification import read_csv_verification
from app.files.csv_writing import csv_of_visit
from app.identification.analysis.analyse import analyse
from app.identification.analysis.next_visits import propose_visits
from app.identification.plan.planning import plan
from app.search.rows import Datum
from app.services.analyses import PlanRequest
from app.simulation.undeclared import make_campaign
from app.storage.analysis_results import RESULTS
from scripts.campaign_of_bodies import campaign_of_bodies


@pytest.fixture(scope="module")
def campaign():
    made = make_campaign(7, None, 3.0, visits=10, days=3)
    return campaign_of_bodies(made.machine, made.error_maps, made.readings, made.verifications)


def effect(kind="other-sensor", components=("EZZ",), sensors=(), states=(), ties=(), **changes):
    own = {
        "kind": kind,
        "variant": "",
        "components": components,
        "sensors": sensors,
        "states": states,
    }
    usual = own | {"states": (), "separating_measurement": "warm one without the other"}
    rivals = tuple(SimpleNamespace(**{**usual, **rival}) for rival in ties)
    return SimpleNamespace(
        **own, ties=rivals, **{"status": "confirmed", "parameters": {}, **changes}
    )


def proposed(campaign, *effects):
    """Propose a single visit."""
    (visit,) = propose_visits(campaign, effects, []).visits
    return visit


def components_of(visit):
    return {o.component for o in visit.planned.observations}


def test_where_nothing_is_open_nothing_is_proposed(campaign):
    assert propose_visits(campaign, [effect()], []) == ((), (), frozenset())


def test_few_visits_ask_for_one_that_is_unlike_them(campaign):
    few = replace(campaign, verifications=campaign.verifications[:3])
    found = proposed(few)
    assert "It shows what changes from visit to visit." in found.sentence
    assert found.planned.observations


def test_it_is_measured_as_the_visit_whose_places_it_takes(campaign):
    """The first verification, of a single place, was measured by something else."""
    first, largest, *_ = campaign.verifications
    first = replace(
        first, observations=first.observations[:1], datum=Datum.FREE, repeatability_um=9.0
    )
    found = proposed(replace(campaign, verifications=[first, largest]))
    assert found.planned.datum == str(largest.datum) != str(Datum.FREE)
    assert found.planned.repeatability_um == largest.repeatability_um != 9.0


def test_of_many_places_both_directions_are_kept(campaign):
    """There and back in turn: every second observation would be one direction alone."""
    (first, *_) = campaign.verifications
    start_s = first.observations[0].time_s
    both = [
        Observation(start_s + i, (0.0,), "EXX", 5.0 * (i // 2), directions=((-1) ** i, 0, 0))
        for i in range(100)
    ]
    found = proposed(replace(campaign, verifications=[replace(first, observations=both)]))
    signs = [o.direction["x"] for o in found.planned.observations[:-2]]
    assert 20 < len(signs) <= 40
    assert signs.count("+") == signs.count("-")
    assert ", from both sides" in found.points


def test_a_tie_is_measured_when_its_drivers_are_apart(campaign):
    """One reading of the record is bent: there, and only there, two sensors leave their course."""
    history = campaign.readings
    one, other = list(campaign.model.machine.sensors)[:2]
    middle = between_visits(campaign)
    found = proposed(
        replace(campaign, readings=with_bump(history, one, middle)),
        effect(sensors=(one,), ties=[{"sensors": (other,)}]),
    )
    assert abs(found.like_time.timestamp() - middle) < 3600.0
    assert found.state.name == "warm"
    assert found.state.conditions.startswith(f"{one} above ")
    assert f" while {other} about " in found.state.conditions
    assert set(found.state.target_c) == {one, other}
    assert all(2.0 * t == round(2.0 * t) for t in found.state.target_c.values())
    assert (
        f"tells other-sensor of EZZ with {one} (effect 0) from that of EZZ with {other}"
        == found.decides
    )
    assert components_of(found) == {"EZZ"}
    # The first place is measured twice more at the end: the floor is known then.
    *_, again, last = found.planned.observations
    first = found.planned.observations[0]
    assert again.position_mm == last.position_mm == first.position_mm


@pytest.mark.parametrize(
    ("known", "rounds"),
    [({}, 7), ({"time_constant_min": 25.0}, 7), ({"time_constant_min": 60.0}, 10)],
    ids=["unknown", "short", "long"],
)
def test_what_comes_late_is_measured_while_its_sensor_warms(campaign, known, rounds):
    """For three time constants, and two hours at least."""
    sensor = next(iter(campaign.model.machine.sensors))
    late = effect("thermal-lag", sensors=(sensor,), ties=[{"kind": "drift"}], parameters=known)
    found = proposed(campaign, late)
    assert (found.state.name, found.state.rounds) == ("while-warming", rounds)
    assert f"{sensor} from about " in found.state.conditions
    assert f"every 20 min, {rounds} times. It tells thermal-lag (effect 0) from drift." in (
        found.sentence
    )
    times = [datetime.fromisoformat(o.time) for o in found.planned.observations]
    assert times[-1] - times[0] >= timedelta(minutes=20 * (rounds - 1))
    assert times == sorted(times)


def test_the_wait_comes_from_the_time_constants_in_question_where_they_are_known(campaign):
    one, other = list(campaign.model.machine.sensors)[:2]
    warm = with_bump(campaign.readings, one, between_visits(campaign))
    bent = replace(campaign, readings=warm)
    ties = [{"sensors": (other,)}]
    known = proposed(
        bent, effect(sensors=(one,), ties=ties, parameters={"time_constant_min": 25.0})
    )
    assert known.state.wait_min == 80.0
    assert "go on so for 80 min, three of the time constants in question (25 min)" in (
        known.sentence
    )
    unknown = proposed(bent, effect(sensors=(one,), ties=ties))
    assert unknown.state.wait_min is None
    assert f"not known: measure once {one} changes by less than 0.5 K in 20 min" in (
        unknown.sentence
    )


def test_visits_in_one_state_are_one_and_a_list_is_in_the_order_of_a_day(campaign):
    one, other = list(campaign.model.machine.sensors)[:2]
    warm = with_bump(campaign.readings, one, between_visits(campaign))
    late = effect("thermal-lag", sensors=(other,), status="suspected")
    tied = effect(sensors=(one,), ties=[{"sensors": (other,)}])
    found = propose_visits(replace(campaign, readings=warm), [tied, tied, late], []).visits
    assert [v.state.name for v in found] == ["while-warming", "warm"]
    assert [v.planned.label for v in found] == ["visit 1, while-warming", "visit 2, warm"]
    assert "(effect 0)" in found[1].decides
    assert ", and tells other-sensor" in found[1].decides
    assert "(effect 1)" in found[1].decides


@pytest.mark.parametrize("apart_k", [0.0, 0.4])
def test_sensors_that_cannot_be_brought_apart_are_not_asked_to(campaign, apart_k):
    """A twin reads what the other reads; half a kelvin nobody sets on purpose."""
    one, other = list(campaign.model.machine.sensors)[:2]
    history = campaign.readings
    values = dict(history.temperatures_c)
    bump = np.exp(-(((history.times_s - between_visits(campaign)) / 1800.0) ** 2))
    values[other] = values[one] + apart_k * bump
    found = propose_visits(
        replace(campaign, readings=replace(history, temperatures_c=values)),
        [effect(sensors=(one,), ties=[{"sensors": (other,)}])],
        [],
    )
    assert found.visits == ()
    (said,) = found.untellable
    assert said.startswith(f"No visit tells other-sensor of EZZ with {one} (effect 0) from that")
    assert f"{one} never departed by 1 K, the least that can be set," in said
    assert "Move one of the two to another place" in said
    # What advises to bring them apart all the same is not said beside it.
    assert found.replaced == {
        f"Warm one without the other (this separates other-sensor of EZZ with {one} from that of "
        f"EZZ with {other})."
    }


def between_visits(campaign):
    first, second, *_ = (min(o.time_s for o in v.observations) for v in campaign.verifications)
    return (first + second) / 2


def with_bump(history, sensor, at_s):
    """Warm one sensor by 30 K for an hour about a time."""
    near = np.exp(-(((history.times_s - at_s) / 1800.0) ** 2))
    return replace(
        history,
        **{
            name: {s: v + (30.0 * near if s == sensor else 0.0) for s, v in values.items()}
            for name, values in vars_of(history).items()
            if isinstance(values, dict) and sensor in values
        },
    )


def vars_of(history):
    names = getattr(history, "__dataclass_fields__", {})
    return {name: getattr(history, name) for name in names}


def test_sensors_that_were_apart_in_the_visits_are_not_said_to_go_together(campaign):
    """In every other visit one of two twins is warmer by far: nowhere in the record by more."""
    one, other = list(campaign.model.machine.sensors)[:2]
    history = campaign.readings
    begins = np.array([min(o.time_s for o in v.observations) for v in campaign.verifications])
    nearest = np.abs(history.times_s[:, None] - begins).argmin(axis=1)
    moved = history.temperatures_c[other] + 20.0 * (nearest % 2)
    apart = replace(history, temperatures_c=history.temperatures_c | {one: moved})
    found = proposed(
        replace(campaign, readings=apart),
        effect(components=(), sensors=(one,), ties=[{"sensors": (other,)}]),
    )
    assert "tells other-sensor" in found.sentence


def test_nothing_is_brought_apart_from_itself():
    for kind in KINDS:
        for rival in KINDS:
            own = SimpleNamespace(kind=kind, components=("EZZ",), sensors=("tc07",), states=())
            for components in (("EZZ",), ("EZZ", "EYZ")):
                other = SimpleNamespace(
                    kind=rival, components=components, sensors=("tc07",), states=()
                )
                told = separating_measurement(own, other)
                assert told
                assert "tc07 and tc07" not in told
                assert "tc07 without tc07" not in told
                assert "{" not in told


@pytest.mark.slow
def test_planning_takes_the_proposal_as_it_is_in_json_and_as_a_file(campaign, tmp_path):
    few = replace(campaign, verifications=campaign.verifications[:5])
    found = analyse(few, kinds=["backlash"])
    visit = found.next_visits[0]
    assert visit.sentence in found.what_next
    written = json.loads(RESULTS.text(found))["next_visits"][0]["planned"]
    planned = PlanRequest.model_validate({"planned": [written]}).planned
    file = tmp_path / "next.csv"
    file.write_text(csv_of_visit("mill", visit), encoding="utf-8")
    read = read_csv_verification(file, is_planned=True)
    assert read.machine == "mill"
    of_file = PlanRequest.model_validate({"planned": [read.body]}).planned
    assert [vars_of(o) for o in of_file[0].observations] == [
        vars_of(o) for o in planned[0].observations
    ]
    assert (of_file[0].datum, of_file[0].label) == (planned[0].datum, visit.planned.label)
    answer = plan(replace(few, verifications=[*few.verifications, *planned]), 1)
    assert answer.visits == 6
    assert not any("outside the record" in note for note in answer.notes)


def test_where_no_visit_is_proposed_nothing_is_written_and_nothing_more_claimed(tmp_path, capsys):
    """A tie of the instrument is open too, and no visit of the machine tells it."""
    write_visits(None, tmp_path / "visits", "vmc", 1, ())
    assert capsys.readouterr().err.endswith("nothing written: the analysis proposes no visit\n")
    assert not list(tmp_path.iterdir())
