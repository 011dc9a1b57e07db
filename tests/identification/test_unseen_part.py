"""What zeros of set-ups hide of an effect is expected to be about as large as what they show."""

import numpy as np
import pytest

from app.arrays import rms
from app.effects.projection import sum_of_terms
from app.identification.analysis.analyse import analyse
from app.identification.analysis.found_effects import HARDLY_SEEN
from app.identification.analysis.unseen_part import with_expected
from app.identification.campaign import residuals_of
from app.search.candidate import Part
from app.search.priors import HIDDEN_SIZE
from app.search.rows import Datum, Rows
from app.simulation.undeclared import make_campaign
from scripts.campaign_of_bodies import campaign_of_bodies

VISITS, EACH = 12, 5
ALONG = np.linspace(-1.0, 1.0, EACH)


def expected(amplitudes, errors, datum=Datum.FREE, absolute=(), kept=(0, 1)):
    """Weigh a level and a rise that follow one driver, which changes from visit to visit."""
    visit = np.repeat(np.arange(VISITS), EACH)
    driver = np.linspace(-2.0, 3.0, VISITS)[visit]
    columns = np.column_stack([driver, driver * np.tile(ALONG, VISITS)])[:, kept]
    n = visit.size
    rows = Rows(
        values=np.zeros(n),
        visit=visit,
        channel=np.zeros(n, dtype=int),
        tilt=np.zeros((n, 0)),
        replicate=np.full(n, -1),
        minutes=1440.0 * visit,
        datum={(v, 0): datum for v in range(VISITS) if v not in absolute},
    )
    return with_expected(
        np.array(amplitudes, dtype=float),
        np.diag(np.square(np.array(errors, dtype=float))),
        [Part(0, np.arange(n), columns)],
        rows,
        np.ones(n, dtype=bool),
        {0: 0.7},
    )


@pytest.mark.parametrize("datum", [Datum.FREE, Datum.FIRST])
def test_a_hidden_level_that_nobody_knows_is_no_larger_than_expected(datum):
    found = expected([-9.0, 1.0], [4.0, 0.02], datum)
    # What is seen are the deviations from each visit's mean, what is hidden are the means.
    prior = HIDDEN_SIZE * np.sqrt(np.mean(ALONG**2))
    share = prior**2 / (prior**2 + 4.0**2)
    np.testing.assert_allclose(found.amplitudes, [-9.0 * share, 1.0])
    np.testing.assert_allclose(np.sqrt(np.diag(found.covariance)), [4.0 * np.sqrt(share), 0.02])
    assert found.is_hardly_known


def test_what_the_set_ups_determine_stays_as_it_is():
    found = expected([-9.0, 1.0], [0.01, 0.02])
    np.testing.assert_allclose(found.amplitudes, [-9.0, 1.0], rtol=1e-3)
    assert not found.is_hardly_known


@pytest.mark.parametrize(
    ("datum", "kept"), [(Datum.ABSOLUTE, (0, 1)), (Datum.FREE, (0,)), (Datum.FREE, (1,))]
)
def test_nothing_is_expected_where_no_zero_hides_a_part(datum, kept):
    amplitudes, errors = np.array([-9.0, 1.0])[list(kept)], np.array([4.0, 0.2])[list(kept)]
    found = expected(amplitudes, errors, datum, kept=kept)
    np.testing.assert_array_equal(found.amplitudes, amplitudes)
    assert not found.is_hardly_known


def test_absolute_visits_show_the_level_to_be_large():
    free, some = (
        expected([-9.0, 1.0], [1.0, 0.02], absolute=absolute) for absolute in ((), (0, 11))
    )
    assert abs(free.amplitudes[0]) < 5.0 < 8.0 < abs(some.amplitudes[0])


def test_amplitudes_that_go_together_move_together():
    amplitudes, covariance = np.array([5.0, 2.0]), np.array([[4.0, 0.3], [0.3, 0.1]])
    hidden, seen = np.diag([3.0, 0.0]), np.diag([0.0, 1.0])
    rows = Rows(
        values=np.zeros(4),
        visit=np.zeros(4, dtype=int),
        channel=np.zeros(4, dtype=int),
        tilt=np.zeros((4, 0)),
        replicate=np.full(4, -1),
        minutes=np.zeros(4),
        datum={(0, 0): Datum.FREE},
    )
    level, rise = np.full(4, np.sqrt(3.0 / 4.0)), np.array([0.5, -0.5, 0.5, -0.5])
    parts = [Part(0, np.arange(4), np.column_stack([level, rise]))]
    found = with_expected(amplitudes, covariance, parts, rows, np.ones(4, dtype=bool), {0: 1.0})
    precision = hidden / (HIDDEN_SIZE**2 * amplitudes @ seen @ amplitudes)
    wanted = np.linalg.inv(np.linalg.inv(covariance) + precision)
    np.testing.assert_allclose(found.covariance, wanted)
    np.testing.assert_allclose(found.amplitudes, wanted @ np.linalg.inv(covariance) @ amplitudes)


@pytest.mark.slow
def test_no_level_that_visits_with_zeros_of_their_own_hardly_show_makes_later_truth_worse():
    made = make_campaign(31126, "temperature-curvature", visits=24, later_visits=20, datum="first")
    machine, maps, readings = made.machine, made.error_maps, made.readings
    answer = analyse(campaign_of_bodies(machine, maps, readings, made.verifications))
    (found,) = answer.effects
    assert found.helps
    assert HARDLY_SEEN in found.explanation
    later = campaign_of_bodies(
        machine,
        maps,
        readings,
        [{"label": "later", "datum": "absolute", "observations": _with_truth(made.later)}],
    )
    residuals = residuals_of(later)
    added = np.nan_to_num(sum_of_terms(residuals.projection, found.effect.terms))
    left = rms(residuals.values - added)
    assert left < 0.5 * rms(residuals.values)


def _with_truth(later):
    """Write the later places with their true errors."""
    told, at = [], 0
    for place in later.asked:
        size = 1 if "component" in place else 3
        values = later.true_um[at : at + size].tolist()
        told.append(place | {"measured_um": values[0] if size == 1 else values})
        at += size
    return told
