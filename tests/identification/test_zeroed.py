"""A zero that is stated as absolute, though the instrument was zeroed at its first reading."""

import numpy as np
import pytest

from app.effects.observations import Observation, Verification, observation_rows
from app.identification.zeroed import to_state, with_true_zeros, zeroed
from app.search.rows import Datum


def record(label, first=0.0, setups=("a", "b"), quantum=0.0, rows=12, **stated):
    """EXX and EYY in some set-ups, all values but the first of each drawn."""
    random = np.random.default_rng(3)
    found = []
    for s, setup in enumerate(setups):
        for c, code in enumerate(("EXX", "EYY")):
            drawn = random.normal(0.0, 2.0, rows)
            drawn[0] = first
            values = np.round(drawn / quantum) * quantum if quantum else drawn
            found += [
                Observation(1e5 * s + 60.0 * i + c, (float(v),), code, 10.0, setup=setup)
                for i, v in enumerate(values)
            ]
    return Verification(label, found[::-1], **stated)  # the order in which they come says nothing


def told(given):
    """The verifications as they are taken."""
    return with_true_zeros(observation_rows(given)).verifications


def test_first_values_that_are_all_exactly_zero_are_the_instruments_zero():
    given = [record("zeroed"), record("absolute", first=0.3), record("stated", datum=Datum.FREE)]
    found = told(given)
    assert [v.datum for v in found] == [Datum.FIRST, Datum.ABSOLUTE, Datum.FREE]
    assert all(a.observations == b.observations for a, b in zip(given, found, strict=True))
    (said,) = zeroed(given, found)
    assert said.on == "'zeroed'"
    assert "first value of every component is exactly 0" in said.reason
    assert to_state([said]) == (
        "Store 'zeroed' again with the datum `first` if the instrument was zeroed at the first "
        "reading.",
    )


@pytest.mark.parametrize(
    "given",
    [
        record("whole micrometres", quantum=4.0, setups=("a",)),  # reads 0 in every second row
        record("one value each", rows=1),
        Verification("planned", record("planned").observations, is_planned=True),
    ],
    ids=lambda v: v.label,
)
def test_zeros_that_may_be_chance_prove_nothing(given):
    (found,) = told([given])
    assert found is given
    assert zeroed([given], [found]) == ()


def test_one_component_that_does_not_begin_at_zero_speaks_against_it():
    given = record("zeroed")
    last = given.observations[-1]  # the first reading of EXX
    moved = [*given.observations[:-1], Observation(last.time_s, (0.1,), "EXX", 10.0, setup="a")]
    (found,) = told([Verification("v", moved)])
    assert found.datum is Datum.ABSOLUTE
