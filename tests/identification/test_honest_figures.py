"""What figures are relative to, what the floor rests on, and that two pages say the same."""

import json
from dataclasses import replace
from functools import partial
from math import erf, sqrt
from types import SimpleNamespace

import numpy as np
import pytest

from app.identification.analysis.advice import summary
from app.identification.analysis.analyse import analyse
from app.identification.analysis.before_after import (
    pooled_figures,
    scatter_in_repeatabilities,
    zero_of,
)
from app.identification.analysis.curves import mean_variances, of_one_unit, seen_apart
from app.identification.analysis.figures import ComponentFigures, Figures
from app.identification.analysis.residual_report import (
    ResidualFigures,
    Size,
    residual_report,
)
from app.identification.campaign import residuals_of
from app.identification.observed_scatter import observed_scatter
from app.identification.residuals.summary import share_above
from app.pages.residuals_page.head import size_sentence
from app.search.findings import ChannelNoise, Figure, Floor, HeldOut
from app.search.rows import Nuisance
from app.search.zeros import UnknownZero, without_zeros
from app.simulation.undeclared import make_campaign
from app.storage.analysis_results import RESULTS
from scripts.campaign_of_bodies import campaign_of_bodies


def campaign_with(datum, planted=None, repeatability=None, seed=7, **conditions):
    made = make_campaign(
        seed, planted, 3.0, **{"visits": 10, "days": 3, "datum": datum, **conditions}
    )
    campaign = campaign_of_bodies(made.machine, made.error_maps, made.readings, made.verifications)
    stated = [replace(v, repeatability_um=repeatability) for v in campaign.verifications]
    return replace(campaign, verifications=stated)


def report_of(campaign):
    residuals = residuals_of(campaign)
    return residual_report(residuals, observed_scatter(campaign, residuals))


def answer_of(campaign):
    return json.loads(RESULTS.text(analyse(campaign, kinds=["backlash"])))


@pytest.mark.parametrize("datum", ["absolute", "first", "free"])
def test_what_an_effect_explains_counts_from_the_zero_of_the_points(datum):
    """A reversal of 6 µm, zeroed where one direction was read: at 0 and −6, and not at ±3."""
    campaign = campaign_with(datum, "backlash")
    (curve,) = answer_of(campaign)["plots"]["effects"]
    before, after, explained = (np.array(curve[n]) for n in ("before", "after", "explained"))
    np.testing.assert_allclose(before - after, explained, atol=2e-3)
    assert set(curve["direction"]) == {1.0, -1.0}


def test_points_that_are_drawn_stand_for_both_directions_and_for_every_extreme():
    """There and back over 20 places, in 50 runs: no stride may leave one direction out."""
    way = np.concatenate([np.arange(20), np.arange(20)[::-1]])
    place, side = np.tile(50.0 * way, 50), np.tile(np.repeat([1.0, -1.0], 20), 50)
    values = 3.0 * side + np.random.default_rng(1).normal(0.0, 0.2, side.size)
    values[777] = 30.0
    chosen = seen_apart(400, place, values, side)
    assert len(chosen) <= 400
    assert 777 in chosen
    assert values.argmin() in chosen
    seen = set(zip(place[chosen], side[chosen], strict=True))
    assert seen == set(zip(place, side, strict=True))


def test_what_counts_from_the_first_observation_and_what_from_the_mean():
    values = np.array([2.0, 5.0, np.nan, 4.0, 8.0, 1.0])
    # In order of time the second of the first set-up came before the first.
    zeros = [UnknownZero(np.array([1, 0, 2]), True), UnknownZero(np.array([3, 4]), False)]
    found = without_zeros(zeros, values)
    np.testing.assert_array_equal(found, [-3.0, 0.0, np.nan, -2.0, 2.0, 1.0])
    # Where the first observation took no part the next one that did is the zero.
    late = without_zeros(zeros[:1], np.array([np.nan, np.nan, 6.0, 4.0, 8.0, 1.0]))
    assert late[2] == 0.0
    chosen = {"first": [0, 5], "removed": [0, 3], "absolute": [5]}
    for zero, rows in chosen.items():
        assert zero_of(zeros, np.isin(np.arange(6), rows)) == zero


@pytest.mark.parametrize(("visits", "has_interval"), [([0, 0, 0, 0], False), ([0, 0, 1, 1], True)])
def test_one_held_out_visit_has_no_interval_over_visits(visits, has_interval):
    values, everything = np.array([1.0, -2.0, 3.0, -1.0]), np.ones(4, dtype=bool)
    rows = SimpleNamespace(values=values, visit=np.array(visits))
    found = pooled_figures(rows, [], values, np.zeros(4), everything, 0)
    assert found.holdout_rms == pytest.approx(np.sqrt(15 / 4))
    assert (found.holdout_rms_ci95 is not None) == has_interval


@pytest.mark.parametrize(("noise_urad", "kept"), [(10.0, [0, 1]), (2.0, [2, 3])])
def test_a_curve_is_of_the_unit_in_which_an_effect_explains_most(noise_urad, kept):
    """1 µm for a noise of 1 µm, and 5 µrad for one of 10 or 2 µrad: no chart shows both."""
    noise = [SimpleNamespace(fitted=1.0), SimpleNamespace(fitted=noise_urad)]
    found = SimpleNamespace(
        residuals=SimpleNamespace(
            rows=SimpleNamespace(channels=("EXX", "EBX"), channel=np.array([0, 0, 1, 1]))
        ),
        findings=SimpleNamespace(noise=noise),
        explained=lambda _: np.array([1.0, -1.0, 5.0, -5.0]),
    )
    assert of_one_unit(found, None, np.arange(4)).tolist() == kept
    assert of_one_unit(found, None, np.array([2])).tolist() == [2]


@pytest.mark.parametrize("is_first", [None, True, False])
@pytest.mark.parametrize("count", [2, 5, 60])
def test_noise_alone_exceeds_its_own_scatter_as_often_as_a_normal_distribution(is_first, count):
    """P(|z| > 1) = 1 − erf(1/√2) = 0.3173 whatever the zero is."""
    setups = 40_000 // count
    noise = np.random.default_rng(2).normal(0.0, 0.5, count * setups)
    blocks = np.arange(count * setups).reshape(setups, count)
    zeros = [] if is_first is None else [UnknownZero(rows, is_first) for rows in blocks]
    scatter = 0.5 * scatter_in_repeatabilities(zeros, noise.size)
    found = share_above(without_zeros(zeros, noise), scatter)
    assert found == pytest.approx(1.0 - erf(1.0 / sqrt(2.0)), abs=0.012)


def test_what_an_instrument_was_zeroed_at_is_said_to_scatter_too():
    size = Size("EXX", "µm", 9, 0.0, 1.4, 2.0, 1.0, "declared", 0.32, "first")
    assert size.ratio == pytest.approx(1.4 / sqrt(2.0))
    assert replace(size, zero="absolute").ratio == pytest.approx(1.4)
    assert "1.00 µm, √2 of it from a first observation, as 32\u00a0% would" in size_sentence(
        ResidualFigures(overall=size, components=[size], summaries=[], excluded=[])
    )
    alone = share_above(np.array([0.0]), np.array([0.0]))
    assert alone is None


@pytest.mark.slow
@pytest.mark.parametrize(
    ("datum", "zero"), [("absolute", "absolute"), ("first", "first"), ("free", "removed")]
)
def test_residuals_say_from_where_they_count(datum, zero):
    campaign = campaign_with(datum)
    report = report_of(campaign)
    assert {size.zero for size in (report.overall, *report.components)} == {zero}
    rows = report.residuals.rows
    for visit in np.unique(rows.visit):
        own = np.flatnonzero((rows.visit == visit) & (rows.channel == rows.channel[0]))
        if not own.size:
            continue
        first = own[np.argmin(rows.times_s[own])]
        raw = report.residuals.values[own]
        expected = {
            "absolute": raw,
            "first": raw - report.residuals.values[first],
            "removed": raw - raw.mean(),
        }[zero]
        np.testing.assert_allclose(report.values[own], expected, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("datum", ["absolute", "first", "free"])
def test_report_and_residuals_page_say_the_same_of_the_same_data(datum):
    """What the search leaves out as a slip would be the only difference: here there is none."""
    campaign = campaign_with(datum, seed=1)
    found = answer_of(campaign)
    report = report_of(campaign)
    assert found["values"] == report.count
    sizes = {size.component: size for size in report.components}
    assert {one["component"] for one in found["components"]} == set(sizes)
    for one in found["components"]:
        size = sizes[one["component"]]
        assert (one["count"], one["zero"], one["unit"]) == (size.count, size.zero, size.unit)
        assert one["before_rms"] == pytest.approx(size.rms, rel=1e-9)
        assert one["before_p95"] == pytest.approx(size.p95, rel=1e-9)
        channel = report.residuals.rows.channels.index(one["component"])
        of_channel = report.values[report.residuals.rows.channel == channel]
        assert one["before_max"] == pytest.approx(np.abs(of_channel).max(), rel=1e-9)
    assert found["before"]["rms_um"] == pytest.approx(report.overall.rms, rel=1e-9)
    assert found["before"]["zero"] == report.overall.zero


@pytest.mark.slow
def test_a_floor_needs_repeats_and_a_declared_noise_is_none():
    """The simulated visits repeat some places at once; without these nothing shows the noise."""
    campaign = campaign_with("absolute", repeatability=0.5)
    once = [
        replace(v, observations=tuple({_place(o): o for o in v.observations}.values()))
        for v in campaign.verifications
    ]
    found = answer_of(replace(campaign, verifications=once))
    assert found["floor_um"] is None
    assert "were repeated at one place within two minutes" in found["floor_unknown"]
    assert all(one["floor"] is None and one["floor_unknown"] for one in found["components"])
    twice = [
        replace(v, observations=tuple(n for o in v.observations for n in (o, _again(o, i))))
        for i, v in enumerate(once)
    ]
    found = answer_of(replace(campaign, verifications=twice))
    known = [one for one in found["components"] if one["unit"] == "µm"]
    assert known
    assert found["floor_unknown"] is None
    for one in known:
        assert one["floor_unknown"] is None
        # Repeats differ by 0.2 √2 or more; what is declared, 0.5, is not looked at.
        assert one["floor"] == pytest.approx(np.hypot(0.2, one["setup_scatter"] or 0.0), rel=0.25)


def _place(o):
    return (o.component, o.position_mm, o.point_mm, o.tool_offset_mm, o.directions)


def _again(o, seed):
    noise = np.random.default_rng([seed, int(o.time_s)]).normal(0.0, 0.2 * 2**0.5, len(o.measured))
    return replace(o, time_s=o.time_s + 5.0, measured=tuple(np.add(o.measured, noise).tolist()))


def finished(noise=0.4, setups=0.3, of_maps=()):
    held = HeldOut(6, 3, Figure(1.0, 0.9, 1.1), Floor(noise, setups))
    return SimpleNamespace(
        findings=SimpleNamespace(
            noise={0: ChannelNoise(noise, "residuals", noise, 3, 6)}, held_out={0: held}
        ),
        of_maps=of_maps,
    )


def test_the_band_of_a_visits_mean_by_hand():
    """Repeatability 0.4, set-ups 0.3; two of the visits' rows lie at an entry known to 0.2."""
    rows, which = np.arange(6), np.array([0, 0, 1, 1, 2, 2])
    of_maps = [Nuisance(0, np.array([2, 3, 4]), np.array([[0.2], [0.2], [0.1]]))]
    own = np.full(6, -1)
    plain = mean_variances(finished(), 0, rows, which, own)
    np.testing.assert_allclose(plain, 0.4**2 / 2 + 0.3**2)
    found = mean_variances(finished(of_maps=of_maps), 0, rows, which, own)
    np.testing.assert_allclose(found - plain, [0.0, 0.2**2, (0.2 * 0.5 / 2) ** 2], atol=1e-15)
    # From a first observation: its noise in all, no shift, and of an entry the difference.
    first = np.array([0, 0, 2, 2, 4, 4])
    found = mean_variances(finished(of_maps=of_maps), 0, rows, which, first)
    expected = 0.4**2 * 1.5 + np.array([0.0, 0.0, (0.2 * 0.5 / 2) ** 2])
    np.testing.assert_allclose(found, expected, atol=1e-15)


@pytest.mark.slow
def test_the_band_holds_the_means_of_a_machine_that_is_as_its_model_says():
    found = answer_of(campaign_with("absolute", visits=20, days=4))
    off = np.concatenate([np.divide(c["before"], c["expected"]) for c in found["plots"]["visits"]])
    assert np.mean(np.abs(off) < 2.0) > 0.9
    assert 0.6 < np.sqrt(np.mean(off**2)) < 1.25


def test_residuals_that_rise_are_not_said_to_fall():
    before, after = (Figures(size, 2 * size, size, (size, size)) for size in (0.9, 4.0))
    effect = SimpleNamespace(
        explanation="EZX has been drifting",
        is_proxy=False,
        status="confirmed",
        sensors=(),
        helps=True,
    )
    told = summary("effects-found", [effect], [], [], before, after, 0.3, "µm", None)
    assert "The residuals do not fall but rise from 0.9 to 4 µm on held-out visits" in told


def test_figures_of_all_effects_are_said_to_be_so_where_not_all_would_be_adopted():
    before, after = (Figures(size, 2 * size, size, (size, size)) for size in (1.8, 6.0))
    effects = [
        SimpleNamespace(
            explanation=f"{code} has been drifting",
            is_proxy=False,
            status="confirmed",
            sensors=(),
            helps=helps,
        )
        for code, helps in (("EZZ", True), ("EYY", False))
    ]
    told = summary("effects-found", effects, [], [], before, after, 0.3, "µm", None)
    assert "With all effects the residuals do not fall but rise from 1.8 to 6 µm" in told


def test_residuals_do_not_fall_by_what_is_not_adopted():
    before, after = (Figures(size, 2 * size, size, (size, size)) for size in (14.3, 5.67))
    effect = SimpleNamespace(
        explanation="EXX follows another sensor",
        is_proxy=True,
        status="suspected",
        sensors=(),
        helps=False,
        why_not="one held-out set-up would get worse",
    )
    told = summary("effects-found", [effect], [], [], before, after, None, "µm", None)
    assert (
        "With it the residuals would go from 14.3 to 5.67 µm on held-out visits. It is not "
        "adopted: one held-out set-up would get worse."
    ) in told


def test_what_shows_in_an_angle_alone_is_said_in_its_unit():
    size = Figures(0.484, 0.9, 0.484, (0.4, 0.6))
    effect = SimpleNamespace(
        explanation="the table of EBZ in map 'warm' has the wrong sign",
        is_proxy=False,
        status="confirmed",
        sensors=(),
        helps=True,
    )
    told_of = partial(ComponentFigures, noise_origin="declared", floor=None, setup_scatter=None)
    components = [
        told_of(code, unit, 20, before, after, 9.0, 9.0, before, after, noise=0.5, zero="absolute")
        for code, unit, before, after in (
            ("EXX", "µm", 0.484, 0.484),
            ("EAX", "µrad", 0.6, 0.59),
            ("EBZ", "µrad", 7.43, 0.6),
        )
    ]
    told = summary("effects-found", [effect], [], [], size, size, 0.3, "µm", None, components)
    assert (
        "The residuals stay at 0.484 µm, and those of EBZ fall from 7.43 to 0.6 µrad on held-out "
        "visits"
    ) in told


def test_the_answer_begins_as_a_sentence_does():
    size = Figures(2.0, 4.0, 2.0, (2.0, 2.0))
    effect = SimpleNamespace(
        explanation="the clocks are 60 ± 1 min apart",
        is_proxy=False,
        status="confirmed",
        sensors=(),
        helps=True,
    )
    told = summary("effects-found", [effect], [], [], size, size, 0.3, "µm", None)
    assert told.startswith("The clocks are 60 ± 1 min apart. The residuals stay")


@pytest.mark.slow
def test_the_summary_says_which_visit_the_answer_is_not_about():
    """One visit 30 µm off, all others as the model says: it is left out, and not without a word."""
    made = make_campaign(5, visits=20, days=4)
    visit = made.verifications[9]
    moved = [
        place
        if "component" in place
        else place | {"measured_um": [place["measured_um"][0] + 30.0, *place["measured_um"][1:]]}
        for place in visit["observations"]
    ]
    bodies = [b if b is not visit else b | {"observations": moved} for b in made.verifications]
    told = {}
    for name, own in (("as it was", made.verifications), ("one off", bodies)):
        campaign = campaign_of_bodies(made.machine, made.error_maps, made.readings, own)
        told[name] = json.loads(RESULTS.text(analyse(campaign, kinds=["backlash"])))
    assert {answer["verdict"] for answer in told.values()} == {"nothing-found"}
    assert "Left out" not in told["as it was"]["summary"]
    (next_step,) = (step for step in told["one off"]["what_next"] if "left out as a slip" in step)
    assert visit["label"] in next_step
    summary = told["one off"]["summary"]
    _, _, left_out = summary.partition("Left out because it lies far from all other visits:")
    assert visit["label"] in left_out
