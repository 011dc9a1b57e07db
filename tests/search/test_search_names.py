"""Names that are only about right: flexible versions beside a found term, rivals with an offset."""

from dataclasses import replace

import numpy as np
import pytest

from app.search.candidate import OFFSET, Flexible, Form, Part
from app.search.findings import Status
from app.search.search import search
from tests.search.search_campaigns import CHANNELS, fingerprint, make_campaign, single

SIZE, VISITS = "its size changes from visit to visit", 24


def library_of(campaign):
    """A bow and a speed, each with flexible versions, and a twin sensor that needs an offset."""
    found = []
    for n in range(CHANNELS):
        bow = single(campaign, f"bow-{n}", "bow", n, lambda _: campaign.position**2 - 0.4)
        speed = single(campaign, f"speed-{n}", "speed", n, lambda _: campaign.speed)
        twin = single(campaign, f"twin-{n}", "twin", n, lambda _: campaign.twin + 4.0)
        found += [
            replace(bow, flexible=lambda _, n=n: [by_visit(campaign, n)]),
            replace(speed, flexible=lambda _, n=n: [constant(campaign, n)]),
            replace(twin, flexible=lambda _, n=n: [constant(campaign, n)]),
        ]
    return found


def by_visit(campaign, channel):
    here = np.flatnonzero(campaign.on(channel))
    visit = campaign.rows.visit[here]
    bow = campaign.position[here] ** 2 - 0.4
    return Flexible(SIZE, [Part(channel, here, bow[:, None] * (visit[:, None] == range(VISITS)))])


def constant(campaign, channel):
    here = np.flatnonzero(campaign.on(channel))
    return Flexible(OFFSET, [Part(channel, here, np.ones((len(here), 1)))])


def found_in(campaign, nuisance=()):
    library = library_of(campaign)
    return search(campaign.rows, nuisance, library, holdout_fraction=0.3, seed=1).terms


@pytest.mark.slow
def test_what_comes_and_goes_is_not_what_is_always_there():
    campaign = make_campaign(3, visits=VISITS)
    bow = 6.0 * (campaign.position**2 - 0.4) * campaign.on(1)
    is_open = np.random.default_rng(4).integers(0, 2, VISITS)[campaign.rows.visit]
    (always,) = found_in(campaign.plus(bow))
    assert (always.key, always.status, always.doubts) == ("bow-1", Status.CONFIRMED, ())
    (valve,) = found_in(campaign.plus(2.0 * bow * is_open))
    assert valve.key == "bow-1"
    assert valve.doubts == (SIZE,)
    assert valve.status is Status.SUSPECTED


@pytest.mark.slow
def test_a_rival_that_counts_from_another_zero_is_a_tie():
    """What follows the twin from another zero resembles a speed that the twin follows."""
    campaign = make_campaign(5, visits=VISITS)
    campaign = replace(campaign, speed=campaign.twin + 0.05 * np.sin(campaign.rows.visit))
    (term,) = found_in(campaign.plus(2.0 * campaign.twin * campaign.on(0)), campaign.nuisance)
    assert term.key == "speed-0"
    (rival,) = [r for r in term.rivals if r.key == "twin-0"]
    assert rival.tied
    assert rival.with_offset


@pytest.mark.parametrize("beside", [0.0, 0.6])
def test_a_version_that_nearly_is_the_term_shows_though_several_channels_share_it(beside):
    """As a second time constant is nearly the first: only what differs is to be weighed."""
    campaign = make_campaign(6, visits=VISITS)
    visit = campaign.rows.visit
    odd = np.random.default_rng(7).choice([-1.0, 1.0], VISITS)
    shape = np.where(campaign.on(0), 1.0, -2.0) * campaign.position

    def nearly(_):
        columns = (shape * (campaign.speed + 0.05 * odd[visit]))[:, None]
        here = [np.flatnonzero(campaign.on(n)) for n in range(CHANNELS)]
        return [Flexible(SIZE, [Part(n, rows, columns[rows]) for n, rows in enumerate(here)])]

    candidate = replace(fingerprint(campaign), flexible=nearly)
    found = campaign.plus(shape * (6.0 * campaign.speed + beside * odd[visit]))
    (term,) = search(found.rows, (), [candidate], holdout_fraction=0.3, seed=1).terms
    assert term.key == "fingerprint"
    assert term.doubts == ((SIZE,) if beside else ())


@pytest.mark.parametrize(
    ("bend", "share", "tied", "prefers"), [(0.15, 0.0, 0, 0), (0.02, 0.0, 1, 0), (0.15, 1.0, 1, 1)]
)
def test_another_form_of_the_same_cause_is_a_tie_until_the_values_tell(bend, share, tied, prefers):
    """Nearly the same columns: what is known is the cause, and not always its course."""
    campaign = make_campaign(6, visits=VISITS)
    bent = bend * np.random.default_rng(8).choice([-1.0, 1.0], VISITS)[campaign.rows.visit]

    def late(more):
        return (campaign.speed + more * bent) * campaign.position

    itself = single(campaign, "late", "late", 0, lambda _: late(0.0))
    other = single(campaign, "late in turn", "late", 0, lambda _: late(1.0))
    candidate = replace(itself, forms=lambda: [Form("it is late in turn", other)])
    found = campaign.plus(6.0 * late(share) * campaign.on(0))
    (term,) = search(found.rows, (), [candidate], holdout_fraction=0.3, seed=1).terms
    assert term.key == "late"
    assert [rival.key for rival in term.rivals if rival.tied] == ["late in turn"] * tied
    assert term.doubts == ("it is late in turn",) * prefers
    assert term.status is (Status.SUSPECTED if prefers else Status.CONFIRMED)


@pytest.mark.parametrize(
    ("bend", "keeps_zero", "stated", "tied"),
    [
        (0.0, False, "step", ["bias"]),  # nothing but its fewer numbers spoke for the sensor
        (0.0, True, "bias", ["step"]),  # it is the sensor's by other components
        (0.8, False, "bias", []),  # its course over temperature tells
    ],
)
def test_a_bias_that_one_component_shows_as_a_step_would_is_stated_as_the_step(
    bend, keeps_zero, stated, tied
):
    campaign = make_campaign(5, visits=30, targets=20)
    times = tuple(float(t) for t in np.unique(campaign.time)[2:-2] - 1e-9)
    course = (0.8 + 0.6 * campaign.position) * (1.0 + bend * campaign.temperature)
    both = np.column_stack([np.ones(len(course)), campaign.position])

    def moved(begins):
        return course * (campaign.time > begins)

    def stepped(begins):
        return both * (campaign.time > begins)[:, None]

    begins = {"grid": times, "trending": True}
    bias = single(campaign, "bias", "bias", 0, moved, **begins, keeps_zero=keeps_zero)
    bias = replace(bias, about=lambda begins, _: bias.columns(begins))
    step = single(campaign, "step", "step", 0, stepped, **begins)
    changed = campaign.plus(5.0 * moved(times[14]) * campaign.on(0))
    found = search(changed.rows, changed.nuisance, [bias, step], holdout_fraction=0.3)
    (term,) = found.terms
    assert term.key == stated
    assert [rival.key for rival in term.rivals if rival.tied] == tied
    assert term.inclusion == 1.0
    # What is foretold of held-out visits is what is stated.
    left = changed.rows.values - found.adopted
    assert np.std(left[changed.on(0)]) < 1.2 * np.std(left[changed.on(1)])
