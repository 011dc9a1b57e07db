"""Every planted effect changes what it should, as much as it was asked to, and nothing else."""

import itertools

import numpy as np
import pytest

from app.simulation.undeclared import ALL, FAMILIES, UNKNOWN
from app.simulation.undeclared.base_machine import TRAVELS_MM
from app.simulation.undeclared.components import CODES, COMPONENTS, following
from app.simulation.undeclared.effect import rows_of
from app.simulation.undeclared.history import low_pass
from app.simulation.undeclared.unknown import preisach, relay_weights, stored_strain

EVERY = [
    f"{name}:{variant}"
    for name, family in ALL.items()
    for variant in (*family.variants, *family.only_asked_for)
]

CHANGES_THE_MACHINE = {
    *("thermal-lag", "other-sensor", "second-time-constant", "sensor-fault"),
    *("exchanged-sensors", "map-temperature", "clock-offset", "late-sensor", "ageing-sensor"),
    "detached-sensor",
}
"""Its components are made more sensitive, so that the effect is whole and as large as asked."""


OF_ITS_OWN_SIZE = {"map-factor", "mirrored-axis", "tool-length"}
"""As large as what it spoils."""

IN_WHAT_IS_KNOWN = {"map-factor", "mirrored-axis", "tool-length", "wrong-map"}
"""People's mistakes in what is stored beside the measured values."""


ROTATION_MOVES = {
    **{"EAX": "y", "EBX": "xz", "ECX": "y"},
    **{"EAY": "yz", "EBY": "xz", "ECY": "xy"},
    **{"EAZ": "y", "EBZ": "x", "ECZ": ""},
}
"""Which coordinates a rotation moves: X carries x and z, Y all, Z the tool, which lies along Z."""


def coordinates_reached(code):
    """Coordinates of a point that a component can move."""
    if code in ROTATION_MOVES:
        return set(ROTATION_MOVES[code])
    return {"xyz"[COMPONENTS[code].row]}


def test_the_families_mistakes_included_and_at_least_eight_unknown_effects():
    assert list(FAMILIES) == [
        *("thermal-lag", "other-sensor", "additional-sensor", "sensor-gradient"),
        *("temperature-curvature", "state-variable", "backlash", "periodic", "angular"),
        *("nonrigid-slope", "drift", "step", "sensor-fault", "outdated-map"),
        *("exchanged-sensors", "map-factor", "map-temperature", "clock-offset", "mirrored-axis"),
        *("late-sensor", "ageing-sensor", "detached-sensor", "tool-length", "wrong-map"),
    ]
    assert len(UNKNOWN) >= 8
    assert not set(UNKNOWN) & set(FAMILIES)


@pytest.mark.slow
@pytest.mark.parametrize("name", EVERY)
def test_amplitude_reach_and_everything_else(campaign_of, name):
    campaign, plain = campaign_of(4, name, 1.5), campaign_of(4)
    truth, kind = campaign.truth, name.split(":")[0]
    (effect,) = truth.effects
    for array in (truth.true_um, truth.contribution_um, truth.measured_um, truth.predicted_um):
        assert np.isfinite(array).all()
    assert effect["kind"] == kind
    assert effect["in_library"] == (kind in FAMILIES) == truth.is_known
    _check_amplitude(truth, effect)
    _check_reach(truth, effect)
    np.testing.assert_allclose(truth.true_um - truth.model_um, truth.contribution_um, atol=1e-9)
    if kind == "angular":
        assert not truth.observations.of(effect["components"][0]).any()
    elif kind in IN_WHAT_IS_KNOWN:
        # The machine and what was measured are the same; what the maps say is not.
        np.testing.assert_array_equal(truth.measured_um, plain.truth.measured_um)
        left = truth.residual_um - plain.truth.residual_um
        # But for the maps' own errors of 0.45, at one place less those at another.
        atol = max(0.5 * np.abs(left).max(), 4.0 * 0.45)
        np.testing.assert_allclose(left, truth.contribution_um, atol=atol)
    elif kind not in CHANGES_THE_MACHINE:
        # The two campaigns differ by the effect alone.
        np.testing.assert_array_equal(truth.predicted_um, plain.truth.predicted_um)
        added = truth.measured_um - plain.truth.measured_um
        np.testing.assert_allclose(added, truth.contribution_um, atol=1.1e-4)


def _check_amplitude(truth, effect):
    rows = rows_of(truth.contribution_um, truth.observations)
    if effect["kind"] in OF_ITS_OWN_SIZE:
        assert effect["amplitude_um"] == pytest.approx(np.std(truth.contribution_um[rows]))
        assert effect["amplitude_um"] > 0.1
        return
    measure = np.std if effect["amplitude_is"] == "standard deviation" else _rms
    # Noted late, the last visit is told of minutes that the plan did not need.
    rel = 0.05 if effect["kind"] == "clock-offset" else 1e-9
    assert measure(truth.contribution_um[rows]) == pytest.approx(1.5, rel=rel)
    assert effect["amplitude_um"] == pytest.approx(1.5, rel=rel)


def _rms(values):
    return np.sqrt(np.mean(values**2))


def _check_reach(truth, effect):
    reached = set(truth.group[rows_of(truth.contribution_um, truth.observations)])
    points = set().union(*(coordinates_reached(code) for code in effect["components"]))
    if effect["kind"] in {"angular", "nonrigid-slope"}:
        assert reached == points
    elif effect["kind"] == "tool-length":
        assert reached
        assert reached <= {"x", "y", "z"}
    elif effect["variant"] == "one-line":
        assert reached == set(effect["components"])
    else:
        lines = {code for code in effect["components"] if truth.observations.of(code).any()}
        assert points <= reached <= points | lines
        # Few visits: not every component has its line after a step, or between two maps.
        if effect["kind"] not in {
            *("step", "sensor-fault", "map-factor", "map-temperature", "wrong-map"),
        }:
            assert reached == points | lines


@pytest.mark.parametrize("name", ["thermal-lag:sensor", "second-time-constant:sensor"])
def test_a_fingerprint_is_of_all_components_of_one_sensor(campaign_of, name):
    (effect,) = campaign_of(4, name, 1.5).truth.effects
    assert tuple(effect["components"]) == following(effect["sensors"][0])


@pytest.mark.slow
@pytest.mark.parametrize("amplitude", [0.5, 4.0])
def test_amplitude_counts_in_repeatabilities(campaign_of, amplitude):
    truth = campaign_of(3, "drift", amplitude, repeatability_um=0.5).truth
    rows = rows_of(truth.contribution_um, truth.observations)
    assert np.std(truth.contribution_um[rows]) == pytest.approx(0.5 * amplitude)


def one_line(campaign):
    """The contribution on the lines of the effect's first component, and their observations."""
    truth = campaign.truth
    code = truth.effects[0]["components"][0]
    here = truth.observations.of(code)
    return code, truth.observations[here], truth.contribution_um[here[truth.observations.of_value]]


def test_a_lagging_component_follows_its_sensor_late(exact_of):
    campaign = exact_of(4, "thermal-lag:component", 1.5)
    code, line, contribution = one_line(campaign)
    history, tau = (
        campaign.history,
        campaign.truth.effects[0]["parameters"]["time_constant_min"],
    )
    sensor = COMPONENTS[code].sensor
    late = history.at(low_pass(history.temperatures_c[sensor], tau), line.time_min)
    along = line.point_mm[:, COMPONENTS[code].axis or 0]
    # The exact maps at the late temperature are the true error.
    true = campaign.maps.tables[code].at(along, late)
    in_step = campaign.maps.tables[code].at(along, history.temperature(sensor, line.time_min))
    np.testing.assert_allclose(contribution, true - in_step, atol=1e-9)


def test_an_exchanged_sensor_is_followed_through_the_maps(exact_of):
    campaign = exact_of(4, "other-sensor", 1.5)
    code, line, contribution = one_line(campaign)
    (other,) = campaign.truth.effects[0]["sensors"]
    table = campaign.maps.tables[code]
    by_other = table.with_temperatures(campaign.maps.temperatures_c[other])
    along = line.point_mm[:, COMPONENTS[code].axis or 0]
    now = campaign.history.temperature(COMPONENTS[code].sensor, line.time_min)
    follows = by_other.at(along, campaign.history.temperature(other, line.time_min))
    np.testing.assert_allclose(contribution, follows - table.at(along, now), atol=1e-9)


@pytest.mark.parametrize("maps_contain_effect", [True, False])
def test_what_the_maps_contain_is_not_undeclared(exact_of, maps_contain_effect):
    campaign = exact_of(6, "additional-sensor", 1.5, maps_contain_effect=maps_contain_effect)
    code, line, contribution = one_line(campaign)
    effect = campaign.truth.effects[0]
    (second,) = effect["sensors"]
    states = campaign.maps.temperatures_c
    level, slope = (v for k, v in effect["parameters"].items() if k.endswith("_per_k"))
    axis = COMPONENTS[code].axis
    u = 2 * line.point_mm[:, axis] / TRAVELS_MM[axis] - 1
    warmth = campaign.history.temperature(second, line.time_min)
    if maps_contain_effect:
        assigned = COMPONENTS[code].sensor
        now = campaign.history.temperature(assigned, line.time_min)
        warmth = warmth - np.interp(now, states[assigned], states[second])
    else:
        warmth = warmth - states[second][1]
    np.testing.assert_allclose(contribution, (level + slope * u) * warmth, atol=1e-9)


@pytest.mark.parametrize("kind", ["additional-sensor", "sensor-gradient"])
def test_what_is_late_counts_from_balance_in_the_maps(exact_of, kind):
    campaign = exact_of(6, f"{kind}:late", 1.5)
    code, line, contribution = one_line(campaign)
    effect, history = campaign.truth.effects[0], campaign.history
    tau, states = effect["parameters"]["time_constant_min"], campaign.maps.temperatures_c
    assert 20.0 <= tau <= 160.0
    late, there = (
        read(effect["sensors"][0]) - sum(read(minus) for minus in effect["sensors"][1:])
        for read in (
            lambda s: history.at(low_pass(history.temperatures_c[s], tau), line.time_min),
            lambda s: states[s],
        )
    )
    assigned = COMPONENTS[code].sensor
    now = history.temperature(assigned, line.time_min)
    warmth = late - np.interp(now, states[assigned], there)
    level, slope = (v for k, v in effect["parameters"].items() if k.endswith("_per_k"))
    axis = COMPONENTS[code].axis
    u = 2 * line.point_mm[:, axis] / TRAVELS_MM[axis] - 1 if axis is not None else 0.0
    np.testing.assert_allclose(contribution, (level + slope * u) * warmth, atol=1e-9)


def test_curvature_vanishes_at_the_maps(exact_of):
    campaign = exact_of(4, "temperature-curvature", 1.5)
    code, line, contribution = one_line(campaign)
    nodes = campaign.maps.tables[code].temperatures_c
    now = campaign.history.temperature(COMPONENTS[code].sensor, line.time_min)
    upper = np.clip(np.searchsorted(nodes, now), 1, nodes.size - 1)
    bubble = (now - nodes[upper - 1]) * (nodes[upper] - now)
    parameters = campaign.truth.effects[0]["parameters"]
    level, slope = (v for k, v in parameters.items() if k.endswith("_per_k2"))
    axis = COMPONENTS[code].axis
    u = 2 * line.point_mm[:, axis] / TRAVELS_MM[axis] - 1 if axis is not None else 0.0
    # T² minus its chord between two maps is −(T − T_n)(T_m − T).
    np.testing.assert_allclose(contribution, -(level + slope * u) * bubble, atol=1e-9)


@pytest.mark.parametrize(
    ("variant", "power"), [("speed", 1), ("speed-squared", 2), ("payload", 1), ("feed", 1)]
)
def test_a_state_acts_at_once(campaign_of, variant, power):
    campaign = campaign_of(4, f"state-variable:{variant}", 1.5)
    code, line, contribution = one_line(campaign)
    parameters = campaign.truth.effects[0]["parameters"]
    state = campaign.history.hold(campaign.history.state[parameters["state"]], line.time_min)
    full_scale = {"spindle_rpm": 12_000.0, "payload_kg": 300.0, "feed_mm_per_min": 15_000.0}
    share = (state / full_scale[parameters["state"]]) ** power
    level, slope = (v for k, v in parameters.items() if k.endswith("_at_full_scale"))
    u = 2 * line.point_mm[:, COMPONENTS[code].axis] / TRAVELS_MM[COMPONENTS[code].axis] - 1
    np.testing.assert_allclose(contribution, (level + slope * u) * share, atol=1e-9)


def test_backlash_is_half_its_value_with_the_sign_of_the_approach(campaign_of):
    campaign = campaign_of(4, "backlash:constant", 1.5)
    code, line, contribution = one_line(campaign)
    half = campaign.truth.effects[0]["parameters"]["half_level_um"]
    direction = line.direction[:, COMPONENTS[code].axis]
    np.testing.assert_allclose(contribution, half * direction, atol=1e-12)
    # As many from either side: the standard deviation is the half value.
    assert abs(half) == pytest.approx(1.5, rel=0.05)
    assert half < 0


def test_backlash_along_the_axis_changes_with_position(campaign_of):
    *_, contribution = one_line(campaign_of(4, "backlash:along-axis", 1.5))
    assert np.ptp(np.abs(contribution)) > 0.3


@pytest.mark.parametrize("variant", ["single", "harmonic"])
def test_a_periodic_error_repeats_after_a_pitch_that_the_maps_cannot_see(campaign_of, variant):
    campaign = campaign_of(4, f"periodic:{variant}", 1.5)
    code, line, contribution = one_line(campaign)
    parameters = campaign.truth.effects[0]["parameters"]
    pitch, axis = parameters["pitch_mm"], COMPONENTS[code].axis
    turns = TRAVELS_MM[axis] / 10 / pitch
    assert abs(turns - round(turns)) > 0.1
    angle = 2 * np.pi * line.point_mm[:, axis] / pitch
    harmonics = (1,) if variant == "single" else (1, 2)
    columns = np.column_stack([f(k * angle) for k in harmonics for f in (np.sin, np.cos)])
    found, *_ = np.linalg.lstsq(columns, contribution, rcond=None)
    np.testing.assert_allclose(columns @ found, contribution, atol=1e-9)
    assert np.hypot(*found[:2]) == pytest.approx(parameters["first_um"])


@pytest.mark.parametrize("variant", ["roll", "pitch", "yaw"])
def test_a_rotation_that_the_maps_lack(campaign_of, variant):
    campaign = campaign_of(4, f"angular:{variant}", 1.5)
    (code,) = campaign.truth.effects[0]["components"]
    for body in campaign.error_maps:
        stated = {c["component"] for c in body["components"]}
        assert stated == set(CODES) - {code}
    assert not campaign.truth.contribution_um[campaign.truth.observations.coordinate < 0].any()
    assert sum(len(v["observations"]) for v in campaign.verifications) < 800


def test_a_tool_that_is_longer_shows_more_of_a_pitch(campaign_of):
    truth = campaign_of(4, "angular:pitch", 1.5).truth
    points = truth.observations[truth.observations.is_point]
    by_point = truth.contribution_um[truth.observations.coordinate >= 0].reshape(-1, 3)
    (code,) = truth.effects[0]["components"]
    column = {"A": 1, "B": 0}[code[1]]
    arm_m = points.tool_mm[:, 2] / 1000.0
    if code[2] != "Z":
        arm_m = arm_m + points.point_mm[:, 2] / 1000.0
    omega = by_point[:, column] / arm_m
    axis = "XYZ".index(code[2])
    fit = np.polynomial.Polynomial.fit(points.point_mm[:, axis], omega, 1)
    # µm over m of lever are µrad: linear along the axis, as it was planted.
    np.testing.assert_allclose(fit(points.point_mm[:, axis]), omega, atol=1e-9)


def test_a_nonrigid_slope_grows_with_another_axis_and_is_silent_on_lines(campaign_of):
    truth = campaign_of(4, "nonrigid-slope:linear", 1.5).truth
    effect = truth.effects[0]
    (code,) = effect["components"]
    assert not truth.contribution_um[truth.observations.coordinate < 0].any()
    points = truth.observations[truth.observations.is_point]
    own, other = "XYZ".index(code[2]), "xyz".index(effect["parameters"]["coordinate"])
    level, slope = (v for k, v in effect["parameters"].items() if k.endswith("_um_per_m"))
    u = 2 * points.point_mm[:, own] / TRAVELS_MM[own] - 1
    expected = (level + slope * u) * points.point_mm[:, other] / 1000.0
    found = truth.contribution_um[truth.observations.coordinate == "XYZ".index(code[1])]
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_a_drift_is_linear_in_time_and_a_step_is_not(campaign_of):
    truth = campaign_of(4, "drift", 1.5).truth
    code, line, contribution = one_line(campaign_of(4, "drift", 1.5))
    parameters = truth.effects[0]["parameters"]
    days = (line.time_min - truth.observations.time_min[0]) / 1440.0
    level, slope = (v for k, v in parameters.items() if k.endswith("_per_day"))
    axis = COMPONENTS[code].axis
    u = 2 * line.point_mm[:, axis] / TRAVELS_MM[axis] - 1 if axis is not None else 0.0
    np.testing.assert_allclose(contribution, (level + slope * u) * days, atol=1e-9)


def test_a_step_happens_between_two_visits(campaign_of):
    truth = campaign_of(4, "step:component", 1.5).truth
    at_min = truth.effects[0]["parameters"]["at_min"]
    time = truth.observations.time_min[truth.observations.of_value]
    assert not truth.contribution_um[time < at_min].any()
    rows = rows_of(truth.contribution_um, truth.observations)
    after = np.unique(truth.visit[rows & (time >= at_min)])
    before = np.unique(truth.visit[rows & (time < at_min)])
    assert before.max() < after.min()
    assert len(before) >= 3
    assert len(after) >= 3


@pytest.mark.slow
@pytest.mark.parametrize("variant", FAMILIES["sensor-fault"].variants)
def test_a_sensors_fault_is_in_the_readings_alone(exact_of, variant):
    campaign = exact_of(4, f"sensor-fault:{variant}", 1.5)
    truth, history = campaign.truth, campaign.history
    (sensor,) = truth.effects[0]["sensors"]
    for name, said in campaign.record.temperatures_c.items():
        true = history.since_first_reading(history.temperatures_c[name])
        assert np.array_equal(said, true) == (name != sensor)
    # What the maps say at the faulty readings differs from the truth by the effect.
    np.testing.assert_allclose(
        truth.measured_um - truth.predicted_um, truth.contribution_um, atol=1e-4
    )
    parameters = truth.effects[0]["parameters"]
    wrong = campaign.record.temperatures_c[sensor] - history.since_first_reading(
        history.temperatures_c[sensor]
    )
    from_then_on = campaign.record.minutes >= parameters["from_min"]
    assert not wrong[~from_then_on].any()
    if variant == "bias":
        np.testing.assert_allclose(wrong[from_then_on], parameters["bias_c"])
    elif variant == "stuck":
        held = from_then_on & (campaign.record.minutes < parameters["to_min"])
        assert np.ptp(campaign.record.temperatures_c[sensor][held]) == 0.0
        assert np.array_equal(wrong != 0.0, held & (wrong != 0.0))
    else:
        share = np.mean(np.abs(wrong[from_then_on]) > 1.0)
        assert share == pytest.approx(parameters["share_of_readings"], rel=0.15)


@pytest.mark.slow
@pytest.mark.parametrize("variant", ["bias", "stuck"])
def test_a_faulty_sensor_keeps_its_noise_only_where_it_is_not_stuck(campaign_of, variant):
    campaign = campaign_of(4, f"sensor-fault:{variant}", 1.5)
    effect = campaign.truth.effects[0]
    said = campaign.record.temperatures_c[effect["sensors"][0]]
    after = campaign.record.minutes >= effect["parameters"]["from_min"]
    until = effect["parameters"].get("to_min", np.inf)
    still = np.diff(said[after & (campaign.record.minutes < until)]) == 0.0
    assert still.all() if variant == "stuck" else still.mean() < 0.5


@pytest.mark.slow
def test_an_outdated_map_is_wrong_in_the_same_way_at_all_times(campaign_of):
    for variant, degree in (("shift", 0), ("slope", 1), ("profile", 4)):
        code, line, contribution = one_line(campaign_of(4, f"outdated-map:{variant}", 1.5))
        axis = COMPONENTS[code].axis or 0
        fit = np.polynomial.Polynomial.fit(line.point_mm[:, axis], contribution, degree)
        np.testing.assert_allclose(fit(line.point_mm[:, axis]), contribution, atol=1e-6)


def test_several_effects_have_components_of_their_own_and_add(exact_of):
    names = ["backlash", "sensor-fault:bias", "thermal-lag:component", "drift"]
    campaign = exact_of(4, names, 1.0)
    truth = campaign.truth
    assert truth.names == tuple(names)
    assert [e["kind"] for e in truth.effects] == [n.split(":")[0] for n in names]
    own = [e["components"] for e in truth.effects if e["kind"] != "sensor-fault"]
    assert len({code for codes in own for code in codes}) == sum(len(codes) for codes in own)
    residual = truth.measured_um - truth.predicted_um
    np.testing.assert_allclose(residual, truth.contributions_um.sum(axis=0), atol=1e-4)


def test_too_many_effects_of_whole_sensors_are_refused(campaign_of):
    with pytest.raises(ValueError, match="expected a sensor none of whose components"):
        campaign_of(4, ["thermal-lag:sensor"] * 3)


def test_a_preisach_loop_closes_and_remembers_its_extremes():
    weights = relay_weights(60, 0.2)

    def run(*turns):
        way = [np.linspace(a, b, 200) for a, b in itertools.pairwise(turns)]
        return preisach(np.concatenate([*way, [0.0, 1.0]]), weights)[:-2]

    # The same temperature from below and from above: two errors.
    up, down = run(0.0, 0.5), run(0.0, 1.0, 0.5)
    assert down[-1] - up[-1] > 0.2
    # A small loop closes where it began, and is then forgotten (wiping out).
    assert run(0.0, 0.7, 0.5, 0.7)[-1] == pytest.approx(run(0.0, 0.7)[-1])
    # How fast it goes does not matter.
    slow = preisach(np.concatenate([np.linspace(0, 1, 5000), np.linspace(1, 0.4, 3000)]), weights)
    fast = preisach(np.concatenate([np.linspace(0, 1, 50), np.linspace(1, 0.4, 30)]), weights)
    assert slow[-1] == pytest.approx(fast[-1])


def test_a_joint_sticks_and_then_slips():
    strain = stored_strain(np.random.default_rng(0), np.linspace(20.0, 40.0, 2000), 1.0)
    steps = np.diff(strain)
    slips = steps < 0
    assert steps[~slips] == pytest.approx(20.0 / 1999)
    assert 12 < slips.sum() < 40
    assert 0.5 < strain.max() < 1.41


def test_a_warp_is_new_in_every_visit_and_neither_shift_nor_tilt(campaign_of):
    code, line, contribution = one_line(campaign_of(4, "setup-warp:component", 1.5))
    axis = COMPONENTS[code].axis
    u = 2 * line.point_mm[:, axis] / TRAVELS_MM[axis] - 1
    shapes = np.column_stack([(3 * u**2 - 1) / 2, (5 * u**3 - 3 * u) / 2])
    found = []
    for visit in np.unique(line.visit):
        here = line.visit == visit
        fit, *_ = np.linalg.lstsq(shapes[here], contribution[here], rcond=None)
        np.testing.assert_allclose(shapes[here] @ fit, contribution[here], atol=1e-9)
        found.append(fit)
    assert np.std(found, axis=0).min() > 0.3
