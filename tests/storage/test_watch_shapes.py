"""Judgements and states of watches as they are stored: what older versions wrote is read."""

import json
from pathlib import Path

import pytest

from app.errors import InvalidContent
from app.storage.watch_shapes import JUDGEMENTS, WATCH_STATES

OLD = json.loads((Path(__file__).parent / "stored_watch_before_shapes.json").read_text("utf-8"))
"""Of a simulated machine that changed by 40 µm, as versions wrote it that stored no shape."""


@pytest.mark.parametrize(
    ("shape", "old"), [(JUDGEMENTS, OLD["judgement"]), (WATCH_STATES, OLD["state"])]
)
def test_what_older_versions_wrote_is_read_and_nothing_of_it_is_lost(shape, old):
    assert "shape" not in old
    read = shape.read(old)
    written = shape.fields(read)
    assert written == {"shape": 1, **old}
    assert shape.read(written) == read


def test_numbers_are_read_as_they_were():
    judgement, state = JUDGEMENTS.read(OLD["judgement"]), WATCH_STATES.read(OLD["state"])
    assert (judgement.status, judgement.model_version) == ("beyond", 3)
    assert judgement.beyond[0].deviation == OLD["judgement"]["beyond"][0]["deviation"]
    assert state.beyond_since_s == OLD["state"]["beyond_since_s"]
    key, stream = next(iter(state.streams.items()))
    assert stream.process.begun == OLD["state"]["streams"][key]["process"]["begun"]


@pytest.mark.parametrize("shape", [JUDGEMENTS, WATCH_STATES])
def test_a_newer_version_is_refused(shape):
    with pytest.raises(InvalidContent, match="shape 1 or older, came 2"):
        shape.read({"shape": 2})
