"""What each kind needs, and what it says where that is missing."""

from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest

from app.effects.campaign_view import CampaignView
from app.effects.claim import claim_of
from app.effects.conditions import Conditions, Lags, Signal
from app.effects.effect import Effect
from app.effects.kinds.periodic import aliases, common_step, why_no_pitch
from app.effects.kinds.state_variable import StateVariable
from app.effects.observations import Observation, Verification
from app.effects.registry import KINDS, do_the_same, kind_of, repertoire
from app.effects.term import Term
from app.errors import InvalidContent
from app.search.rows import Datum
from tests.effect_examples import read_back
from tests.effects.example_campaign_view import START_S, example_view, observations


def refused(kind, where):
    proposals = KINDS[kind].candidates(where)
    return {n.on: n.reason for n in proposals.not_testable}


@pytest.mark.parametrize("kind", ["angular", "nonrigid-slope"])
def test_points_are_needed(kind):
    where = example_view(with_points=False)
    assert not KINDS[kind].candidates(where).hypotheses
    assert "points" in refused(kind, where)[""]


def test_one_visit_shows_only_what_acts_within_it():
    where = example_view(verifications=observations()[:1])
    found = {h.kind for h in repertoire(where).hypotheses.values() if h.within_visit}
    assert {"backlash", "angular", "nonrigid-slope", "outdated-map"} <= found
    assert refused("periodic", where)["EXX"] == "needs at least 12 different positions, got 8"
    for kind in ("thermal-lag", "drift", "step", "sensor-fault", "temperature-curvature"):
        assert (
            refused(kind, where)[""]
            == "needs several visits, or one that lasts hours, got one short visit"
        )


def test_directions_are_needed():
    one_way = [
        Verification(
            "one way",
            [Observation(START_S + 90000.0 + 60.0 * i, (0.0,), "EXX", 10.0 * i) for i in range(30)],
        )
    ]
    where = example_view(verifications=one_way)
    assert refused("backlash", where)[""] == "needs observations approached from both directions"


def test_an_axis_that_came_from_one_side_has_no_reversal():
    assert (
        refused("backlash", example_view())["EYX"] == "X was always approached from the same side"
    )


def test_states_that_do_not_change_cannot_be_tested():
    assert "payload_kg did not change" in refused("state-variable", example_view())["payload_kg"]
    where = example_view()
    stateless = Conditions(where.conditions.times_s, where.conditions.temperatures_c)
    bare = CampaignView(where.model, where.maps, where.rows, stateless)
    assert "needs the machine's state" in refused("state-variable", bare)[""]


@pytest.mark.parametrize("there_rpm", [8000.0, None])
def test_a_state_that_stood_while_a_component_was_observed_is_a_constant_of_that(there_rpm):
    """It is as well a map that no longer holds, however the state changed elsewhere."""
    where = example_view(verifications=observations(with_points=False))
    rpm = where.conditions.states["spindle_rpm"].copy()
    if there_rpm is not None:
        rpm[where.projection.view("EYY").rows] = there_rpm
    conditions = replace(where.conditions, states={"spindle_rpm": rpm})
    view = CampaignView(where.model, where.maps, where.rows, conditions)
    proposed = StateVariable().candidates(view)
    at_once = {h.components[0] for h in proposed.hypotheses if h.nonlinear is None}
    late = {h.components[0] for h in proposed.hypotheses if h.nonlinear is not None}
    assert "EZZ" in at_once
    assert ("EYY" in at_once) == (there_rpm is None)
    assert "EYY" in late
    (still,) = proposed.not_testable
    assert ("EYY" in still.on) == (there_rpm is not None)


@pytest.mark.parametrize(("datum", "is_tested"), [("absolute", True), ("free", False)])
def test_maps_may_be_off_by_a_straight_line_where_a_shift_shows(datum, is_tested):
    """With a zero of their own in every visit, a slope says the same with one number less."""
    shown = [replace(one, datum=Datum(datum)) for one in observations(with_points=False)]
    proposed = KINDS["outdated-map"].candidates(example_view(verifications=shown)).hypotheses
    lines = {h.components[0]: h for h in proposed if h.variant == "straight line"}
    assert set(lines) == ({"EXX", "EYY", "EZZ"} if is_tested else set())
    assert all(len(line.unit_terms(None)) == 2 for line in lines.values())


@pytest.mark.parametrize("at_mm", [(5.0, 120.0, 130.0, 490.0), (5.0, 60.0, 70.0, 100.0)])
def test_a_profile_has_corners_only_next_to_what_was_measured(at_mm):
    """At 5 mm the corner at 125 mm has 4 % of its size: what is measured there is not its."""
    fixed = iter(np.tile(np.repeat(at_mm, 2), 1000).tolist())
    shown = [
        replace(
            visit,
            observations=[
                one if one.position_mm is None else replace(one, position_mm=next(fixed))
                for one in visit.observations
            ],
        )
        for visit in observations(with_points=False)
    ]
    proposed = KINDS["outdated-map"].candidates(example_view(verifications=shown)).hypotheses
    profiles = [h for h in proposed if h.variant == "profile"]
    corners = {0.0, 125.0, 500.0} if at_mm[3] > 100.0 else set()  # two corners are a line
    assert len(profiles) == (3 if corners else 0)
    for profile in profiles:
        shapes = [term.shape for (term,) in profile.unit_terms(None)]
        assert {at for shape in shapes for at in shape.positions_mm} == corners
        assert np.linalg.matrix_rank([s.factors(np.array(at_mm)) for s in shapes]) == 3


def test_without_history_nothing_is_late():
    where = example_view()
    bare = CampaignView(
        where.model,
        where.maps,
        where.rows,
        Conditions(where.conditions.times_s, where.conditions.temperatures_c, lags=Lags()),
    )
    unknown = "the history of x-middle is not known here"
    assert refused("thermal-lag", bare)["x-middle"] == unknown
    for kind in ("additional-sensor", "sensor-gradient"):
        assert refused(kind, bare)["x-middle, late"] == unknown
        assert all(h.nonlinear is None for h in KINDS[kind].candidates(bare).hypotheses)
        assert any(h.nonlinear for h in KINDS[kind].candidates(where).hypotheses)


def test_a_second_sensor_and_a_difference_are_tried_late_in_their_neighbours_forms():
    where = example_view()
    found = {kind: KINDS[kind].candidates(where).hypotheses for kind in LATE_TOO}
    for kind, variants in LATE_TOO.items():
        late = [h for h in found[kind] if h.nonlinear]
        assert {h.variant for h in late} == variants
        at_once = {(h.variant, h.components, h.sensors) for h in found[kind] if not h.nonlinear}
        for one in late:
            assert (one.variant.removesuffix(", late"), one.components, one.sensors) in at_once
            assert one.nonlinear.bounds == (60.0, 9600.0)
            assert one.nonlinear.grid == (300.0, 1200.0, 4800.0)
            assert one.follows == dict(zip(one.sensors, (1, -1), strict=False))
            (driver,) = {term.driver for terms in one.unit_terms(2400.0) for term in terms}
            assert driver.time_constant_s == 2400.0


LATE_TOO = {
    "additional-sensor": {"beyond the maps, late", "since the maps, late"},
    "sensor-gradient": {"beyond the maps, late"},
}


def test_what_was_late_in_the_maps_is_what_the_record_knows_of_it():
    where, tau_s = example_view(), 2400.0
    at_s = START_S + np.array([2.0, 2.2, 3.1]) * 86400.0
    measured = [
        replace(m, measured_at=datetime.fromtimestamp(t, UTC))
        for m, t in zip(where.maps, [*at_s[:2], START_S - 86400.0], strict=True)
    ]
    within = CampaignView(where.model, measured, where.rows, where.conditions)
    at_once = within.beyond_maps("EXX", "spindle", "y-front")
    late = within.late_beyond_maps("EXX", at_once, tau_s)
    behind = {
        name: where.conditions.lags.lagged(signal, tau_s, at_s[:2])
        - where.conditions.lags.at(signal, at_s[:2])
        for name in ("spindle", "y-front", "x-middle")
        for signal in [Signal("temperature", name)]
    }
    late_k, at_once_k = (np.array(driver.in_maps_c)[:, 1] for driver in (late, at_once))
    by_k = (late_k - at_once_k).tolist()
    assert by_k[:2] == pytest.approx((behind["spindle"] - behind["y-front"]).tolist())
    # The third map is older than the record: what it states had settled.
    assert by_k[2] == 0.0
    assert late.time_constant_s == tau_s
    assert where.late_beyond_maps("EXX", at_once, tau_s) == replace(at_once, time_constant_s=tau_s)
    # What follows its own sensor late was as late.
    lag = next(
        h for h in kind_of("thermal-lag").candidates(within).hypotheses if h.components == ("EXX",)
    )
    ((term,),) = lag.unit_terms(tau_s)
    labels = [m.label for m in where.maps]
    assert [label for label, _ in term.shape.in_maps_k] == labels[:2]
    assert [k for _, k in term.shape.in_maps_k] == pytest.approx(behind["x-middle"].tolist())


def test_differences_of_many_sensors_are_not_tried_late():
    where = example_view()
    known = where.conditions.temperatures_c
    more = {f"s{n}": known["spindle"] + 0.1 * n * known["y-front"] for n in range(5)}
    conditions = replace(where.conditions, temperatures_c={**known, **more})
    many = CampaignView(where.model, where.maps, where.rows, conditions)
    assert (
        refused("sensor-gradient", many)["9 sensors, late"]
        == "differences that act late are left out: there are too many"
    )
    assert not any(h.nonlinear for h in KINDS["sensor-gradient"].candidates(many).hypotheses)
    assert any(h.nonlinear for h in KINDS["additional-sensor"].candidates(many).hypotheses)


def test_a_short_history_cuts_the_time_constants():
    where = example_view()
    (longest,) = {h.nonlinear.grid[-1] for h in KINDS["thermal-lag"].candidates(where).hypotheses}
    # 24 h of readings before the first observation are 288 min five times.
    assert longest == 160.0 * 60.0
    # 75 min are 15 min five times.
    early = observations()
    shifted = [
        Verification(v.label, [o_at(o, -86400.0 + 4500.0) for o in v.observations])
        for v in early[:2]
    ]
    cut = example_view(verifications=shifted)
    grids = {h.nonlinear.grid[-1] for h in KINDS["thermal-lag"].candidates(cut).hypotheses}
    assert grids == {10.0 * 60.0}


def o_at(observation, seconds):
    return replace(observation, time_s=observation.time_s + seconds)


def test_a_sensor_that_stood_still_drives_nothing():
    where = example_view()
    still = {**where.conditions.temperatures_c, "spindle": np.full(len(where.rows), 40.0)}
    calm = CampaignView(
        where.model,
        where.maps,
        where.rows,
        Conditions(where.conditions.times_s, still, where.conditions.states, where.conditions.lags),
    )
    assert "spindle did not change" in refused("additional-sensor", calm)["spindle"]
    sensors = {s for h in repertoire(calm).hypotheses.values() for s in h.sensors}
    assert "spindle" not in sensors


def test_a_sensor_that_maps_do_not_state_cannot_replace_another():
    where = example_view()
    bare = [
        replace(m, temperatures_c={k: t for k, t in m.temperatures_c.items() if k != "spindle"})
        for m in where.maps
    ]
    lacking = CampaignView(where.model, bare, where.rows, where.conditions)
    assert "'Run #1' does not state" in refused("other-sensor", lacking)["x-middle by spindle"]


def test_rotations_that_maps_have_are_not_lacking():
    codes = {
        c for h in KINDS["angular"].candidates(example_view()).hypotheses for c in h.components
    }
    assert "EBX" in codes
    with_ebx = example_view(with_rotations=True)
    codes = {c for h in KINDS["angular"].candidates(with_ebx).hypotheses for c in h.components}
    assert "EBX" not in codes
    assert "EBX" in with_ebx.components


def test_fingerprints_hold_all_components_of_a_sensor():
    found = {h.components for h in KINDS["thermal-lag"].candidates(example_view()).hypotheses}
    assert ("EXX", "EYX", "EYY", "SXY") in found
    assert ("EZZ",) in found
    (bias,) = [
        h
        for h in KINDS["sensor-fault"].candidates(example_view()).hypotheses
        if h.sensors == ("x-middle",)
    ]
    assert bias.components == ("EXX", "EYX", "EYY", "SXY")


def test_a_bias_of_a_sensor_that_one_component_follows_may_be_an_instrument_that_walks():
    found = KINDS["sensor-fault"].candidates(example_view()).hypotheses
    assert {len(h.components) > 1 for h in found} == {True, False}
    assert all(h.keeps_zero == (len(h.components) > 1) for h in found)
    walking = [
        h for kind in ("drift", "step") for h in KINDS[kind].candidates(example_view()).hypotheses
    ]
    assert walking
    assert not any(h.keeps_zero for h in walking)


def test_a_constant_bias_is_said_to_be_an_outdated_map():
    assert "outdated map" in refused("sensor-fault", example_view())["constant bias"]


def test_even_positions_cannot_show_a_pitch():
    told = why_no_pitch(np.arange(0.0, 501.0, 25.0))
    assert "multiples of one step of 25 mm" in told
    assert "75 mm looks the same as 37.5, 18.8, 15, 10.7 mm" in told
    rng = np.random.default_rng(1)
    assert why_no_pitch(rng.uniform(0.0, 500.0, 60)) == ""
    assert "at least 12" in why_no_pitch(rng.uniform(0.0, 500.0, 5))


def test_aliases_are_alike_at_the_positions():
    at = 25.0 * np.arange(40)
    for pitch in (75.0, 61.7, 13.0):
        seen = np.cos(2 * np.pi * at / pitch)
        for other in aliases(pitch, 25.0, 6):
            np.testing.assert_allclose(np.cos(2 * np.pi * at / other), seen, atol=1e-9)


def test_common_step_of_random_positions_is_their_resolution():
    rng = np.random.default_rng(2)
    assert common_step(rng.uniform(0.0, 500.0, 50)) == 0.001


def test_steps_are_sought_at_the_beginnings_of_visits():
    where = example_view()
    grid = KINDS["step"].candidates(where).hypotheses[0].nonlinear.grid
    begins = [v.observations[0].time_s for v in observations()][1:]
    np.testing.assert_allclose(grid, begins)


def without(code, verifications):
    return [
        replace(v, observations=[o for o in v.observations if o.component != code])
        for v in verifications
    ]


def test_nothing_begins_before_what_it_changes_was_observed():
    """A beginning before all of its rows is a constant: a map that no longer holds, or none."""
    visits = observations(with_points=False)
    where = example_view(verifications=without("EZZ", visits[:5]) + visits[5:])
    grids = {h.components: h.nonlinear.grid for h in KINDS["step"].candidates(where).hypotheses}
    begins = [v.observations[0].time_s for v in visits]
    np.testing.assert_allclose(grids["EXX",], begins[1:])
    np.testing.assert_allclose(grids["EZZ",], begins[6:])


def test_what_the_last_visit_alone_observed_shows_no_beginning():
    visits = observations(with_points=False)
    only_exx = [
        replace(v, observations=[o for o in v.observations if o.component == "EXX"])
        for v in visits[:-1]
    ]
    where = example_view(verifications=[*only_exx, *without("EXX", visits[-1:])])
    found = KINDS["step"].candidates(where)
    assert {h.components for h in found.hypotheses} == {("EXX",)}
    assert "last visit" in refused("step", where)["EZZ"]


def test_a_sensor_reads_wrong_from_after_its_components_were_first_observed():
    visits = observations(with_points=False)
    only_ezz = [
        replace(v, observations=[o for o in v.observations if o.component == "EZZ"])
        for v in visits[:3]
    ]
    where = example_view(verifications=only_ezz + visits[3:])
    found = KINDS["sensor-fault"].candidates(where).hypotheses
    grids = {h.sensors: h.nonlinear.grid for h in found}
    begins = [v.observations[0].time_s for v in only_ezz + visits[3:]]
    np.testing.assert_allclose(grids["z-column",], begins[1:])
    np.testing.assert_allclose(grids["x-middle",], begins[4:])


def test_many_visits_are_thinned_and_refined():
    many = observations(with_points=False, visits_a_day=12)
    nonlinear = KINDS["step"].candidates(example_view(verifications=many)).hypotheses[0].nonlinear
    assert len(nonlinear.grid) == 40
    assert nonlinear.bounds == (nonlinear.grid[0], nonlinear.grid[-1])


def test_unknown_kinds_and_parts_are_refused():
    with pytest.raises(InvalidContent, match="thermal-lag"):
        kind_of("hysteresis")
    with pytest.raises(InvalidContent, match="expected a driver among always"):
        read_back(
            Term,
            {
                "component": "EXX",
                "coefficient": 1.0,
                "reversing": False,
                "driver": {"name": "moon"},
                "shape": {"name": "everywhere"},
            },
        )


def with_datum(datum, verifications):
    return [replace(v, datum=datum) for v in verifications]


def test_what_lasts_is_hidden_where_each_visit_has_a_zero_of_its_own():
    """At one position nothing is left of a drift; along a line its slope is."""
    at_one_place = [
        replace(
            v,
            datum=Datum.FIRST,
            observations=[o for o in v.observations if o.component == "EXX"][:1] * 3,
        )
        for v in observations(with_points=False)
    ]
    where = example_view(verifications=at_one_place)
    for kind, subject in (("drift", "EXX"), ("step", "EXX"), ("sensor-fault", "x-middle")):
        proposals = KINDS[kind].candidates(where)
        assert not [h for h in proposals.hypotheses if "EXX" in h.components]
        assert "each visit has its own zero" in refused(kind, where)[subject]


@pytest.mark.parametrize(("kind", "stem"), [("drift", "drift"), ("step", "step")])
def test_along_a_line_the_slope_of_what_lasts_is_left(kind, stem):
    lines = with_datum(Datum.FREE, observations(with_points=False))
    where = example_view(verifications=lines)
    (one, *_) = [h for h in KINDS[kind].candidates(where).hypotheses if h.components == ("EXX",)]
    assert [a.name.startswith(f"{stem}_rise") for a in one.amplitudes] == [True]
    # Where two visits share a zero, the shift shows as well.
    shared = with_datum(Datum.FREE, lines[:1]) + with_datum(Datum.ABSOLUTE, lines[1:])
    where = example_view(verifications=shared)
    (one, *_) = [h for h in KINDS[kind].candidates(where).hypotheses if h.components == ("EXX",)]
    assert len(one.amplitudes) == 2


def test_a_fault_shows_in_the_slopes_of_lines_with_free_zeros():
    lines = with_datum(Datum.FREE, observations(with_points=False))
    found = KINDS["sensor-fault"].candidates(example_view(verifications=lines)).hypotheses
    assert "x-middle" in [h.sensors[0] for h in found]


@pytest.mark.parametrize(
    ("kind", "one", "other", "same"),
    [
        ("additional-sensor", "at once", "late", True),
        ("outdated-map", "shift", "slope", True),
        ("wrong-map", "cold: shift", "cold: slope", True),
        ("wrong-map", "cold: shift", "warm: shift", False),
        ("map-temperature", "cold", "warm", False),
    ],
)
def test_forms_of_one_thing_do_the_same_but_not_in_two_maps(kind, one, other, same):
    effects = [Effect(kind, ("EXX",), ("bed",), (), variant) for variant in (one, other)]
    assert do_the_same(*effects) is same
    assert not do_the_same(effects[0], replace(effects[0], sensors=("spindle",)))
    assert claim_of(effects[0]) != claim_of(effects[1])
    assert claim_of(effects[0]) == claim_of(replace(effects[0], parameters={"slope": 2.0}))
