"""What holds for every kind of effect: training and live agree, storing loses nothing."""

import json
from functools import cache

import numpy as np
import pytest

from app.effects.adopted.contributions import contributions
from app.effects.adopted.learnt_ranges import with_ranges
from app.effects.adopted.live_effects import LiveEffects, corrected_tables
from app.effects.conditions import Conditions
from app.effects.effect import effect_from_json
from app.effects.hypothesis import Estimate
from app.effects.observations import POINT_CHANNELS
from app.effects.projection import sum_of_terms
from app.effects.registry import KINDS, explain, repertoire, separating_measurement
from app.effects.shape import Rising
from app.geometry.components import COMPONENTS
from app.geometry.error_field import ErrorField
from app.geometry.error_table import Table
from app.identification.residuals.residuals import compute_residuals
from tests.effects.example_campaign_view import all_rows, example_view


@cache
def example():
    return example_view()


@cache
def hypotheses():
    return repertoire(example()).hypotheses


def one_of_each():
    """One hypothesis of every kind and variant, the last that is proposed."""
    return {(h.kind, h.variant): h for h in hypotheses().values()}


EVERY = [f"{kind}|{variant}" for kind, variant in one_of_each()]
EACH = [each for each in EVERY if not KINDS[each.partition("|")[0]].not_adopted]
"""What corrects the model: people's mistakes that are put right where they were made do not."""


MOVED = (
    *("sensor-fault|bias", "ageing-sensor|since the maps", "ageing-sensor|since the first visit"),
    "detached-sensor|",
)
"""Their columns are the linear part of what is adopted."""


def fitted(each, seed=5):
    """An effect with amplitudes of about one."""
    hypothesis = one_of_each()[tuple(each.split("|"))]
    rng = np.random.default_rng(seed)
    k = len(hypothesis.amplitudes)
    theta = (
        hypothesis.nonlinear.grid[len(hypothesis.nonlinear.grid) // 2]
        if hypothesis.nonlinear
        else None
    )
    spread = rng.normal(size=(k, k))
    return hypothesis.fitted(
        Estimate(
            theta,
            None if theta is None else 0.05 * abs(theta),
            rng.uniform(0.5, 1.5, k),
            0.01 * spread @ spread.T,
        )
    )


def moment_of(row):
    conditions = example().conditions
    return Conditions.of_moment(
        float(conditions.times_s[row]),
        {name: float(t[row]) for name, t in conditions.temperatures_c.items()},
        {name: float(x[row]) for name, x in conditions.states.items()},
        conditions.lags,
    )


def live_value(effect, row):
    """What live tables make of an effect at one row, by the rule of the volumetric error."""
    own, rows = example(), example().rows
    moment = moment_of(row)
    temperatures = {name: float(t[0]) for name, t in moment.temperatures_c.items()}
    states = own.model.errors_at(temperatures)
    found = corrected_tables(own.model, [effect], moment, states)
    assert not found.missing
    channel = rows.channels[rows.channel[row]]

    def value(effects_then):
        tables = {}
        for table in all_rows(states, effects_then).values():
            axis = table.component.axis
            side = rows.directions[row]["xyz".index(axis)] if axis else 0
            errors = table.errors
            if table.backward_errors is not None and side < 0:
                errors = table.backward_errors
            elif table.backward_errors is not None and side == 0:
                errors = (errors + table.backward_errors) / 2
            tables[table.component.code] = (table.positions_mm, errors)
        if channel in POINT_CHANNELS:
            field = ErrorField.make(
                own.machine.chain,
                {c: Table(*t) for c, t in tables.items()},
                own.model.measuring_lines,
            )
            errors, _ = field.at(rows.points_mm[row], rows.tool_offsets_mm[row])
            return errors[0, POINT_CHANNELS.index(channel)]
        positions, errors = tables[channel]
        axis = COMPONENTS[channel].axis
        at = rows.points_mm[row]["xyz".index(axis)] if axis else 0.0
        return np.interp(at, positions, errors) if len(positions) > 1 else errors[0]

    return value(found) - value(LiveEffects((), ()))


@pytest.mark.parametrize("each", EACH)
def test_training_columns_equal_live_corrections(each):
    effect = fitted(each)
    trained = sum_of_terms(example().projection, effect.terms)
    assert np.isfinite(trained).all()
    moved = np.flatnonzero(trained)
    assert moved.size, "the effect must show somewhere"
    rng = np.random.default_rng(7)
    largest = np.abs(trained).max()
    # A live table is a polygon: of a sine 2 % may be lost, of all others nothing.
    lost = 0.02 if effect.kind == "periodic" else 1e-9
    for row in rng.choice(moved, size=min(12, moved.size), replace=False):
        assert live_value(effect, row) == pytest.approx(trained[row], abs=lost * largest)


@pytest.mark.parametrize("each", EVERY)
def test_storing_loses_nothing(each):
    effect = fitted(each)
    stored = json.loads(json.dumps(effect.to_json(), allow_nan=False))
    again = effect_from_json(stored)
    assert again == effect
    np.testing.assert_array_equal(
        sum_of_terms(example().projection, again.terms),
        sum_of_terms(example().projection, effect.terms),
    )
    assert explain(again) == explain(effect)


@pytest.mark.parametrize("each", [e for e in EACH if e not in MOVED])
def test_columns_are_linear_in_the_terms(each):
    """The candidate's columns times the amplitudes are what the fitted effect adds."""
    hypothesis = one_of_each()[tuple(each.split("|"))]
    effect = fitted(each)
    theta = (
        hypothesis.nonlinear.grid[len(hypothesis.nonlinear.grid) // 2]
        if hypothesis.nonlinear
        else None
    )
    k = len(hypothesis.amplitudes)
    coefficients = np.random.default_rng(5)
    coefficients.normal(size=(k, k))
    coefficients = coefficients.uniform(0.5, 1.5, k)
    total = np.zeros(len(example().rows))
    for part in hypothesis.candidate(example().projection).columns(theta):
        assert set(example().rows.channel[part.rows].tolist()) == {part.channel}
        total[part.rows] += part.columns @ coefficients
    found = contributions(example().projection, [effect])
    np.testing.assert_allclose(total, found.errors, atol=1e-12)


def as_adopted(each):
    """As an analysis would store it: with the ranges in which these rows show it."""
    effect = with_ranges(fitted(each), example().projection, np.ones(len(example().rows), bool))
    return effect_from_json(json.loads(json.dumps(effect.to_json(), allow_nan=False)))


@pytest.mark.parametrize("each", [e for e in EACH if e not in MOVED])
def test_what_is_stored_gives_out_what_was_validated(each):
    """On the rows that taught it no range holds it, and predictions say what columns said."""
    projection = example().projection
    found = contributions(projection, [as_adopted(each)])
    validated = sum_of_terms(projection, fitted(each).terms)
    np.testing.assert_allclose(found.errors, validated, atol=1e-9 * np.abs(validated).max())
    assert not found.is_lacking.any()
    assert not found.is_held.any()


def test_what_is_adopted_together_is_the_sum_that_was_validated():
    projection = example().projection
    stored = [as_adopted(each) for each in EACH]
    together = sum(sum_of_terms(projection, fitted(each).terms) for each in EACH)
    found = contributions(projection, stored)
    np.testing.assert_allclose(found.errors, together, atol=1e-9 * np.abs(together).max())
    np.testing.assert_allclose(
        compute_residuals(projection.model, example().rows, example().conditions, stored).predicted
        - compute_residuals(projection.model, example().rows, example().conditions).predicted,
        together[compute_residuals(projection.model, example().rows, example().conditions).kept],
        atol=1e-9 * np.abs(together).max(),
    )


def test_a_small_bias_is_what_the_search_took_for_it():
    """Its column is the linear part: for a hundredth of a kelvin, all there is but at a map."""
    (hypothesis, *_) = (h for h in hypotheses().values() if h.kind == "sensor-fault")
    theta = hypothesis.nonlinear.grid[0]
    effect = hypothesis.fitted(Estimate(theta, None, np.array([-0.01]), np.eye(1)))
    projection = example().projection
    expected = -0.01 * projection.columns(hypothesis.unit_terms(theta))[:, 0]
    added = contributions(projection, [effect]).errors
    assert effect.parameters["bias_k"] == 0.01
    assert np.isclose(added, expected, rtol=1e-9).mean() > 0.98
    np.testing.assert_allclose(added, expected, atol=0.05)


@pytest.mark.parametrize("each", EVERY)
def test_parameters_have_names_with_units_and_errors_and_are_explained(each):
    effect = fitted(each)
    assert effect.parameters
    units = ("_um", "_urad", "_per_m", "_per_k", "_per_k2", "_per_day", "_min", "_mm", "_deg", "_k")
    units = (*units, "_c")
    others = ("share", "changed_at_unix_s", "to_multiply_by", "apart_min")
    for name in effect.parameters:
        assert name.endswith(units) or name in others or "_per_spindle_rpm" in name, name
    assert all(error >= 0 for error in effect.standard_errors.values())
    assert set(effect.standard_errors) <= set(effect.parameters)
    told = explain(effect)
    assert any(
        thing in told for thing in (*effect.components, effect.components[0].partition("^")[0])
    )
    assert all(sensor in told for sensor in effect.sensors)
    assert "{" not in told
    assert "nan" not in told
    assert "\n" not in told
    # It says where its number holds if the effect changes along the axis.
    if any(isinstance(term.shape, Rising) for term in effect.terms):
        assert " mm, " in told or "at the upper end of travel" in told
    else:
        assert " mm, " not in told


def test_every_pair_of_kinds_has_a_separating_measurement():
    effects = [fitted(each) for each in EVERY]
    for one in effects:
        for rival in effects:
            told = separating_measurement(one, rival)
            assert len(told) > 20
            assert "{" not in told


def test_all_kinds_are_listed():
    assert list(KINDS) == [
        *("thermal-lag", "other-sensor", "additional-sensor", "sensor-gradient"),
        *("temperature-curvature", "state-variable", "backlash", "periodic", "angular"),
        *("nonrigid-slope", "drift", "step", "sensor-fault", "outdated-map"),
        "response",
        *("exchanged-sensors", "map-factor", "map-temperature", "wrong-map"),
        *("instrument-warm-up", "instrument-compensation"),
        *("clock-offset", "mirrored-axis"),
        *("late-sensor", "ageing-sensor", "detached-sensor", "tool-length"),
    ]
    # A response is learnt beside the search.
    assert {h.kind for h in hypotheses().values()} == set(KINDS) - {"response", "tool-length"}
    assert all(kind.text and kind.shown_by for kind in KINDS.values())


def test_keys_are_unique_and_flags_follow_the_kind():
    proposals = [h for kind in KINDS.values() for h in kind.candidates(example()).hypotheses]
    assert len({h.key for h in proposals}) == len(proposals)
    for h in proposals:
        assert h.trending == KINDS[h.kind].trending


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
def test_what_a_kind_says_in_reports_is_complete(kind):
    assert kind.drawn_over in ("driver", "time", "position")
    for text in (kind.remedy.format(components="EXX"), kind.driver_note):
        assert text == "" or (text[0].isupper() and text.endswith("."))


def test_a_kind_with_a_remedy_names_the_components():
    assert "EXX" in KINDS["outdated-map"].remedy.format(components="EXX")


def test_what_tilts_all_set_ups_alike_is_known_to_stand_still():
    """Set-ups that resemble each other tilt alike: so does a component that no map has."""
    constant = [
        h
        for h in hypotheses().values()
        if h.kind in ("outdated-map", "nonrigid-slope", "angular") and not h.sensors
    ]
    assert {h.kind for h in constant} == {"outdated-map", "nonrigid-slope", "angular"}
    assert all(h.standing for h in constant)
    warm = [h for h in hypotheses().values() if h.kind == "nonrigid-slope" and h.sensors]
    assert warm
    assert not any(h.standing for h in warm)
