"""The visit that is proposed: it can be made, and planning takes it as it is."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from app.api.files.csv_verification import read_csv_verification
from app.api.schemas.analyses import PlanRequest
from app.api.schemas.campaigns import campaign_of_bodies
from app.cli.planned_visit import visit_csv, write_next_visit
from app.effects.registry import KINDS, separating_measurement
from app.identification.analysis.analyse import analyse
from app.identification.analysis.next_visit import propose_visit
from app.identification.plan.planning import plan
from app.search.rows import Datum
from app.simulation.undeclared import make_campaign
from app.storage.analysis_results import RESULTS


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
    rivals = tuple(SimpleNamespace(**{**own, "states": (), **rival}) for rival in ties)
    return SimpleNamespace(**own, ties=rivals, **{"status": "confirmed", **changes})


def components_of(visit):
    return {o.component for o in visit.planned.observations}


def test_where_nothing_is_open_nothing_is_proposed(campaign):
    assert propose_visit(campaign, [effect()], []) is None


def test_few_visits_ask_for_one_that_is_unlike_them(campaign):
    few = replace(campaign, verifications=campaign.verifications[:3])
    found = propose_visit(few, [], [])
    assert "to see what changes from visit to visit" in found.sentence
    assert found.planned.observations


def test_it_is_measured_as_the_visit_whose_places_it_takes(campaign):
    """The first verification, of a single place, was measured by something else."""
    first, largest, *_ = campaign.verifications
    first = replace(
        first, observations=first.observations[:1], datum=Datum.FREE, repeatability_um=9.0
    )
    found = propose_visit(replace(campaign, verifications=[first, largest]), [], [])
    assert found.planned.datum == str(largest.datum) != str(Datum.FREE)
    assert found.planned.repeatability_um == largest.repeatability_um != 9.0


def test_a_tie_is_measured_when_its_drivers_are_apart(campaign):
    """One reading of the record is bent: there, and only there, two sensors leave their course."""
    history = campaign.readings
    one, other = list(campaign.model.machine.sensors)[:2]
    begins = [min(o.time_s for o in v.observations) for v in campaign.verifications]
    middle = (begins[0] + begins[1]) / 2
    bent = with_bump(history, one, middle)
    found = propose_visit(
        replace(campaign, readings=bent),
        [effect(sensors=(one,), ties=[{"sensors": (other,)}])],
        [],
    )
    assert abs(found.like_time.timestamp() - middle) < 3600.0
    assert f"when {one} is far above the value that it had beside {other}" in found.sentence
    assert (
        f"to tell other-sensor of EZZ with {one} (effect 0) from that of EZZ with {other}"
        in found.sentence
    )
    assert components_of(found) == {"EZZ"}
    # The first place is measured twice more at the end: the floor is known then.
    *_, again, last = found.planned.observations
    first = found.planned.observations[0]
    assert again.position_mm == last.position_mm == first.position_mm


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


def test_sensors_that_never_came_apart_are_not_asked_to(campaign):
    """A twin reads what the other reads: no measurement on this machine tells them apart."""
    one = next(iter(campaign.model.machine.sensors))
    names = list(campaign.model.machine.sensors)
    other = names[1]
    values = vars_of(campaign.readings)
    table = next(k for k, v in values.items() if isinstance(v, dict) and one in v)
    twins = replace(campaign.readings, **{table: values[table] | {other: values[table][one]}})
    found = propose_visit(
        replace(campaign, readings=twins),
        [effect(sensors=(one,), ties=[{"sensors": (other,)}])],
        [],
    )
    assert "never departed from the relation that they had" in found.sentence
    assert "cannot be told apart" in found.sentence
    assert "is far above" not in found.sentence


def test_sensors_that_were_apart_in_the_visits_are_not_said_to_go_together(campaign):
    """In every other visit one of two twins is warmer by far: nowhere in the record by more."""
    one, other = list(campaign.model.machine.sensors)[:2]
    history = campaign.readings
    begins = np.array([min(o.time_s for o in v.observations) for v in campaign.verifications])
    nearest = np.abs(history.times_s[:, None] - begins).argmin(axis=1)
    moved = history.temperatures_c[other] + 20.0 * (nearest % 2)
    apart = replace(history, temperatures_c=history.temperatures_c | {one: moved})
    found = propose_visit(
        replace(campaign, readings=apart),
        [effect(components=(), sensors=(one,), ties=[{"sensors": (other,)}])],
        [],
    )
    assert "never departed" not in found.sentence
    assert "to tell other-sensor" in found.sentence


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
    visit = found.next_visit
    assert visit is not None
    assert visit.sentence in found.what_next
    written = json.loads(RESULTS.text(found))["next_visit"]["planned"]
    planned = PlanRequest.model_validate({"planned": [written]}).to_verifications()
    file = tmp_path / "next.csv"
    file.write_text(visit_csv("mill", visit), encoding="utf-8")
    read = read_csv_verification(file, is_planned=True)
    assert read.machine == "mill"
    of_file = PlanRequest.model_validate({"planned": [read.body]}).to_verifications()
    assert [vars_of(o) for o in of_file[0].observations] == [
        vars_of(o) for o in planned[0].observations
    ]
    assert (of_file[0].datum, of_file[0].label) == (planned[0].datum, "next visit")
    answer = plan(replace(few, verifications=[*few.verifications, *planned]), 1)
    assert answer.visits == 6
    assert not any("outside the record" in note for note in answer.notes)


def test_where_no_visit_is_proposed_nothing_is_written_and_nothing_more_claimed(tmp_path, capsys):
    """A tie of the instrument is open too, and no visit of the machine tells it."""
    write_next_visit(tmp_path / "next.csv", "vmc", None)
    assert capsys.readouterr().err.endswith("not written: the analysis proposes no visit\n")
    assert not list(tmp_path.iterdir())
