"""Tables with adopted effects as JSON, in the client's answer, and as a person reads them."""

import json
from io import StringIO

import numpy as np
import pytest
from rich.console import Console

from app.api.table_json import table_json
from app.cli.compensate import table_view
from app.effects.registry import explain
from app.geometry.components import COMPONENTS
from app.pages.report_parts.words import sentence
from tests.effects.test_effects_all_kinds import EACH, example, fitted, moment_of
from tests.effects.test_effects_given_out import table_of
from thermap.answers import CompensationAnswer, SurenessAnswer


def seen(answer, width=100):
    terminal = StringIO()
    Console(width=width, file=terminal, highlight=False).print(table_view(answer, width))
    return terminal.getvalue()


@pytest.mark.parametrize("each", EACH)
def test_the_json_is_the_table_and_what_the_answer_documents(each):
    table = table_of(example().model, [fitted(each)], moment_of(100))
    written = table_json(table)
    answer = CompensationAnswer.model_validate_json(written)
    assert [entry.component for entry in answer.components] == [
        entry.component.code for entry in table.components
    ]
    for shown, entry in zip(answer.components, table.components, strict=True):
        component = COMPONENTS[shown.component]
        assert shown.effects == list(entry.effects)
        errors = np.round(_as_shown(entry), 4)
        np.testing.assert_array_equal(getattr(shown, component.error_field), errors)
        np.testing.assert_array_equal(shown.compensation, 0.0 - errors)
        if entry.backward_errors is not None:
            backward = getattr(shown, f"backward_{component.error_field}")
            np.testing.assert_array_equal(backward, np.round(entry.backward_errors, 4))
        assert shown.standard_errors is None
        assert (shown.sensor is None) == (shown.status == "effects-only")
    raw = json.loads(written)
    # Beside the numbers, components with effects and without have the same fields.
    without = {name for c in raw["components"] if not c["effects"] for name in c}
    origin = {"sensor", "temperature_c", "lower_map", "upper_map", "weight", "status"}
    assert all(origin <= set(c) for c in raw["components"])
    assert origin <= without


def _as_shown(entry):
    return entry.errors if entry.component.is_table else float(entry.errors[0])


@pytest.mark.parametrize("each", EACH)
def test_a_person_reads_what_the_effect_is(each):
    effect = fitted(each)
    table = table_of(example().model, [effect], moment_of(100))
    text = " ".join(seen(CompensationAnswer.model_validate_json(table_json(table))).split())
    assert f"+ {effect.kind}: {sentence(explain(effect))}" in text
    assert effect.components[0] in text


def test_a_component_of_effects_alone_is_shown_as_such():
    table = table_of(example().model, [fitted("angular|constant")], moment_of(100))
    text = seen(CompensationAnswer.model_validate_json(table_json(table)))
    assert "adopted effects alone, no two maps have it" in text


def test_a_person_reads_how_sure_a_response_is_now_and_how_much_of_it_is_corrected():
    table = table_of(example().model, [fitted("angular|constant")], moment_of(100))
    answer = CompensationAnswer.model_validate_json(table_json(table))
    sure = SurenessAnswer(
        component="EAX", expected=-12.0, learnt_error=3.0, wander_error=4.0, corrected=-10.2
    )
    answer.effects[0].sureness.append(sure)
    assert "EAX: −12.0 ± 5.0 µrad expected now, −10.2 µrad of it in the table" in seen(answer)
