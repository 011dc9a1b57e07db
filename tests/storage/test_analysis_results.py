"""Results of analyses as they are stored: what is written is read, and so is what was."""

import json
from pathlib import Path

import pytest
from pydantic import TypeAdapter

from app.errors import InvalidContent
from app.identification.analysis.analysis import Analysis
from app.pages.analysis_report import analysis_report
from app.storage.analysis_results import RESULTS
from tests.pages.example_analyses import ALL, HEAD

STORED = {file.stem: file.read_text("utf-8") for file in Path(__file__).parent.glob("stored/*")}
"""What versions before this one wrote: a reversal value that was planted, found."""


@pytest.mark.parametrize("name", ALL)
def test_what_is_written_is_read_again(name):
    text = RESULTS.text(RESULTS.read_text(json.dumps(ALL[name])))
    assert text.startswith(f'{{"shape":{RESULTS.version},')
    assert RESULTS.text(RESULTS.read_text(text)) == text
    written = json.loads(text)
    schema = TypeAdapter(Analysis).json_schema(mode="serialization")
    assert set(written) == {"shape", *schema["properties"]}
    assert written["plots"] == ALL[name]["plots"]


@pytest.mark.parametrize("name", STORED)
def test_results_of_older_versions_are_read(name):
    old = json.loads(STORED[name])
    assert "shape" not in old
    result = RESULTS.read_text(STORED[name])
    (effect,) = result.effects
    assert (effect.kind, list(effect.components)) == ("backlash", ["EZX"])
    assert effect.valid is None or effect.valid.positions_mm == {"EZX": (40.556, 768.805)}
    # Nothing of what was stored is lost, nor changed.
    written = json.loads(RESULTS.text(result))
    assert_holds(written, old)
    assert "EZX has a reversal value" in analysis_report(HEAD, result, plotly_js="/p.js")


def assert_holds(found, old, place=""):
    """Hold that everything of an older form is in the newer one."""
    if isinstance(old, dict):
        for name, value in old.items():
            assert_holds(found[name], value, f"{place}.{name}")
    elif isinstance(old, list):
        assert len(found) == len(old), place
        for i, value in enumerate(old):
            assert_holds(found[i], value, f"{place}.{i}")
    else:
        assert found == old, place


def test_both_older_versions_are_here():
    assert set(STORED) == {"analysis_0_1_0", "analysis_before_shapes"}


def test_what_the_first_results_lack_is_added():
    first = json.loads(STORED["analysis_0_1_0"])
    del first["kinds"], first["unit"]
    for visit in first["plots"]["visits"]:
        del visit["direction"]
    result = RESULTS.read_text(json.dumps(first))
    assert (result.kinds, result.unit) == (None, "µm")
    assert result.effects[0].measure_again is None
    assert all(set(v.direction) == {0.0} for v in result.plots.visits)
    angles = [c | {"unit": "µrad"} for c in first["components"]]
    assert RESULTS.read_text(json.dumps(first | {"components": angles})).unit == "µrad"


def test_older_floors_say_how_set_ups_scatter():
    """They were of repeatability and set-ups; later ones are of what was repeated."""
    first = json.loads(STORED["analysis_0_1_0"])
    third = json.loads(RESULTS.text(RESULTS.read(first)))

    def setup_scatter(stored, **figures):
        (one, *_) = stored["components"]
        return RESULTS.read(stored | {"components": [one | figures]}).components[0].setup_scatter

    assert setup_scatter(first, noise=0.4, floor=0.5) == pytest.approx(0.3)
    assert setup_scatter(first, noise=0.4, floor=0.4) == 0.0
    assert setup_scatter(first, noise=0.4, floor=None) is None
    assert setup_scatter(third, noise=0.4, floor=0.5) is None


def test_a_result_of_a_newer_version_is_refused_with_the_reason():
    newer = json.dumps(json.loads(STORED["analysis_0_1_0"]) | {"shape": RESULTS.version + 1})
    with pytest.raises(
        InvalidContent, match=f"shape {RESULTS.version} or older, got {RESULTS.version + 1}"
    ):
        RESULTS.read_text(newer)


def test_what_is_no_result_is_refused_with_the_field():
    wrong = json.loads(STORED["analysis_0_1_0"]) | {"p_global": "often"}
    with pytest.raises(InvalidContent, match="p_global"):
        RESULTS.read_text(json.dumps(wrong))
