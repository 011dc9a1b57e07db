"""What is computed is written to 0.1 nm; what is stored as it came; npy in full."""

import io
import json
import math
import re
from datetime import timedelta

import numpy as np
import pytest
from pydantic import TypeAdapter

from app.effects.adopted.described import AdoptedEffect, adopted_effect
from app.effects.driver import StepAfter
from app.effects.effect import Effect
from app.effects.term import Term
from app.geometry.line_accuracy import LineAccuracy
from app.measurement.positioning import TargetAnswer
from app.services.predictions import Predictions
from tests.service_examples import ROOM, START, error_map, iso, reading, temperatures

on_sqlite = pytest.mark.parametrize("furnished_url", ["sqlite"], indirect=True)
pytestmark = pytest.mark.anyio

# Thirds, so that whatever is not rounded has sixteen digits.
ASKED = {"temperatures_c": temperatures(24.0 + 1 / 3), "missing_components": "zero"}
POINTS = (np.arange(30).reshape(10, 3) * 7 / 3).tolist()
MICRO = re.compile(r"_(um|urad|um_per_m|urad_per_m)$")
QUESTIONS = {
    "volumetric-error": {"points_mm": POINTS},
    "volumetric-accuracy": {},
    "compensation/levels": {},
    "compensation/grid": {"x_mm": [0, 100 / 3], "y_mm": [0, 77], "z_mm": [1 / 7, 99]},
    "rotary-axis-error": {"order": "C", "angles_deg": {"C": 33.3}, "points_mm": [[1 / 3, 1, 2]]},
}


def micro_numbers(value, name=""):
    """Every number under a field of µm or µrad, by the field's name."""
    if isinstance(value, dict):
        for key, inner in value.items():
            of = name if MICRO.search(name) and not MICRO.search(key) else key
            yield from micro_numbers(inner, of)
    elif isinstance(value, list):
        for inner in value:
            yield from micro_numbers(inner, name)
    elif isinstance(value, float) and MICRO.search(name) and name != "within_um":
        yield name, value


@on_sqlite
@pytest.mark.parametrize("route", QUESTIONS)
async def test_computed_numbers_have_no_more_than_a_tenth_of_a_nanometre(client, route):
    answer = await client.post(f"{ROOM}/{route}", json=ASKED | QUESTIONS[route])
    assert answer.status_code == 200, answer.text
    numbers = list(micro_numbers(answer.json()))
    assert numbers
    for name, number in numbers:
        assert number == round(number, 4), name
        assert math.copysign(1.0, number) == 1.0 or number < 0.0, name


@on_sqlite
async def test_json_is_the_npy_rounded_and_npy_has_all_digits(client):
    asked = ASKED | {"points_mm": POINTS}
    answer = await client.post(f"{ROOM}/volumetric-error", json=asked)
    headers = {"Accept": "application/x-npy"}
    exact = await client.post(f"{ROOM}/volumetric-error", json=asked, headers=headers)
    array = np.load(io.BytesIO(exact.content))[:, :3]
    np.testing.assert_allclose(answer.json()["errors_um"], array, atol=5.0001e-5, rtol=0)
    assert (array != np.round(array, 4)).any()


@on_sqlite
async def test_what_is_stored_comes_back_as_it_was_stated(client):
    stated = [1 / 3, 2 / 3e7]
    components = [{"component": "EZZ", "positions_mm": [0, 1e3 / 7], "errors_um": stated}]
    sent = error_map("Thirds", 41.0, components=components)
    stored = await client.post(f"{ROOM}/error-maps", json=sent)
    assert stored.status_code == 201, stored.text
    (kept,) = stored.json()["components"]
    assert kept["errors_um"] == stated


def test_small_deviations_are_rounded_to_digits_and_never_to_nothing():
    target = TargetAnswer(*10 * [1e-9 / 3])
    written = json.loads(TypeAdapter(TargetAnswer).dump_json(target))
    assert written["standard_deviation_forward_um"] == 3.33333333e-10
    assert written["mean_um"] == 0.0


def test_ratios_have_nine_digits_and_predictions_may_be_of_several_shapes():
    lines = TypeAdapter(LineAccuracy).dump_json(LineAccuracy(1 / 3, 5 / 9))
    assert json.loads(lines) == {"ELv_um": 0.3333, "ELSv_um": 0.5556, "ratio": 1.66666667}
    kept = TypeAdapter(Predictions).dump_json(Predictions(1, [1 / 3, [2 / 3, -1e-9], None], []))
    assert json.loads(kept)["predicted_um"] == [0.3333, [0.6667, 0.0], None]


def figures(value):
    """Every number that is not whole, with its significant digits."""
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, list):
        for inner in value:
            yield from figures(inner)
    elif isinstance(value, float):
        yield value, len(f"{value!r}".partition("e")[0].replace(".", "").strip("-0"))


@on_sqlite
async def test_residuals_and_correlations_have_no_more_digits_than_they_know(client):
    observed = [
        {
            "time": iso(START - timedelta(seconds=100 - i)),
            "component": "EXX",
            "position_mm": 100.0 * i,
            "measured_um": 1.5 * i * i,
        }
        for i in range(5)
    ]
    readings = [reading(START - timedelta(seconds=s), 24.0 + s / 300) for s in (200, 100, 0)]
    assert (await client.post(f"{ROOM}/readings", json=readings)).status_code == 201
    body = {"label": "thirds", "observations": observed}
    number = (await client.post(f"{ROOM}/verifications", json=body)).json()["id"]
    residuals = (await client.get(f"{ROOM}/verifications/{number}/residuals?rows=9")).json()
    for row in residuals["rows"]:
        assert row["predicted"] == round(row["predicted"], 4)
        assert row["residual"] == round(row["residual"], 4)
    # Ends that are times since 1970 need more digits before the point.
    found = [digits for value, digits in figures(residuals) if abs(value) < 1e6]
    assert max(found) <= 9
    assert len(found) > 20
    correlation = (await client.post(f"{ROOM}/sensor-assignment/correlate")).json()
    assert max(digits for _, digits in figures(correlation)) <= 9


def test_parameters_and_ranges_are_rounded_where_they_are_shown():
    third = 1.0 / 3.0
    effect = Effect(
        "step",
        ("EXX",),
        parameters={"step_um": third, "changed_at_unix_s": 1772323200.1234567},
        standard_errors={"step_um": third / 10.0},
        terms=(Term("EXX", StepAfter(1772323200.1234567), coefficient=third),),
    )
    shown = TypeAdapter(AdoptedEffect).dump_python(adopted_effect(effect), mode="json")
    assert shown["parameters"] == {"step_um": 0.333333333, "changed_at_unix_s": 1772323200.123}
    assert shown["standard_errors"] == {"step_um": 0.0333333333}
