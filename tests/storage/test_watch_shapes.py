"""Judgements and states of watches as they are stored: what older versions wrote is read."""

import json
from pathlib import Path

import pytest

from app.errors import InvalidContent
from app.search.priors import WATCH_CORRELATIONS
from app.storage.watch_shapes import JUDGEMENTS, WATCH_STATES

OLD = json.loads((Path(__file__).parent / "stored_watch_before_shapes.json").read_text("utf-8"))
"""Of a simulated machine that changed by 40 µm, as versions wrote it that stored no shape."""


def test_a_judgement_that_older_versions_wrote_is_read_and_nothing_of_it_is_lost():
    assert "shape" not in OLD["judgement"]
    read = JUDGEMENTS.read(OLD["judgement"])
    written = JUDGEMENTS.fields(read)
    # What older versions judged waits for nothing.
    assert written == {"shape": 1, **OLD["judgement"], "awaits_readings": False}
    assert JUDGEMENTS.read(written) == read


def test_a_state_that_took_set_ups_as_independent_goes_on():
    """Evidence, latest numbers and what is known of the constant and of the scatter are kept."""
    read = WATCH_STATES.read(OLD["state"])
    assert WATCH_STATES.read(WATCH_STATES.fields(read)) == read
    for key, old in OLD["state"]["streams"].items():
        stream = read.streams[key]
        assert (stream.value, stream.expected) == (old["value"], old["expected"])
        assert stream.process.begun == old["process"]["begun"]
        assert set(stream.unchanged.constants) == {old["mean"]}
        assert set(stream.unchanged.of_constants) == {old["variance"]}
        assert [*stream.likelihoods[:: len(WATCH_CORRELATIONS)]] == old["setups"]


def test_what_an_older_state_left_contradicts_nothing_that_was_stated():
    """It did not keep what was stated."""
    read = WATCH_STATES.read(OLD["state"])
    assert {one.ratio for one in read.noise.values() if one.squares > 0.0} == {1.0}
    assert read.contradiction() is None


def test_numbers_are_read_as_they_were():
    judgement, state = JUDGEMENTS.read(OLD["judgement"]), WATCH_STATES.read(OLD["state"])
    assert (judgement.status, judgement.model_version) == ("beyond", 3)
    assert judgement.beyond[0].deviation == OLD["judgement"]["beyond"][0]["deviation"]
    assert state.beyond_since_s == OLD["state"]["beyond_since_s"]
    key, stream = next(iter(state.streams.items()))
    assert stream.process.begun == OLD["state"]["streams"][key]["process"]["begun"]


@pytest.mark.parametrize("shape", [JUDGEMENTS, WATCH_STATES])
def test_a_newer_version_is_refused(shape):
    newer = shape.version + 1
    with pytest.raises(InvalidContent, match=f"shape {newer - 1} or older, got {newer}"):
        shape.read({"shape": newer})
