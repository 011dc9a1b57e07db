"""The OpenAPI document says of every field what it is and in which unit."""

import gc
import json
import re
import weakref
from inspect import iscoroutinefunction

import pytest

from app.api.openapi import DOCUMENT
from app.units import unit_of_field
from scripts.openapi_document import openapi_document
from tests.service_examples import running

NO_UNIT = {
    *("weight", "r", "confidence_95", "ratio", "ratios", "exaggeration"),
    *("progress", "holdout_fraction", "share_above_repeatability", "share_above"),
    *("likelihood_ratio", "two_ln_bayes_factor", "p_global", "calibration_slope"),
    *("calibration_slope_error", "forward_slope", "found_again_share"),
    *("evidence", "behind", "alias_share", "leverage", "overlap", "limit", "false_alarm"),
    *("parameters", "standard_errors", "made_of", "change"),
    *("share", "share_interval", "factor", "extrapolation_error_ratio", "direction"),
}
"""Numbers without a unit: shares, correlations, probabilities and ratios; or with their unit
in each one's own name."""

UNITS = re.compile(
    r"\[(mm|µm|µrad|µm/m|µrad/m|°C|°C/min|°|K|K/h|s|min|1/min|square of the errors' unit)[\];]"
)


@pytest.fixture(scope="module")
def document():
    return json.loads(json.dumps(openapi_document()))


def fields(document):
    """Every schema's fields: (schema, field, its description of itself)."""
    return [
        (name, field, content)
        for name, schema in document["components"]["schemas"].items()
        for field, content in schema.get("properties", {}).items()
    ]


def operations(document):
    return [
        (f"{method.upper()} {path}", operation)
        for path, item in document["paths"].items()
        for method, operation in item.items()
    ]


def has_floats(document, content):
    """Whether a field holds numbers other than counts, at any depth but in other schemas."""
    if isinstance(content, dict):
        return content.get("type") == "number" or any(
            has_floats(document, v) for k, v in content.items() if k != "$ref"
        )
    return isinstance(content, list) and any(has_floats(document, v) for v in content)


@pytest.mark.slow
def test_there_is_something_to_look_at(document):
    assert len(fields(document)) > 100
    assert len(operations(document)) > 20


def test_every_field_says_what_it_is(document):
    silent = [f"{s}.{f}" for s, f, content in fields(document) if not content.get("description")]
    assert silent == []


def test_every_number_says_its_unit(document):
    silent = [
        f"{schema}.{field}"
        for schema, field, content in fields(document)
        if has_floats(document, content)
        and field not in NO_UNIT
        and unit_of_field(field) is None
        and not UNITS.search(content.get("description", ""))
        and "in `unit`" not in content.get("description", "")  # the field beside it says which
        and "state" not in field  # any numbers that the shop knows
    ]
    assert silent == []


def test_a_unit_in_a_description_is_that_of_the_name(document):
    wrong = []
    for schema, field, content in fields(document):
        promised = unit_of_field(field)
        stated = UNITS.search(content.get("description", ""))
        if promised and stated and stated[1] != promised:
            wrong.append(f"{schema}.{field}: {stated[0]}")
    # Predictions of angles and squareness have one field with those of lengths.
    assert wrong == []


def test_every_schema_says_what_it_is(document):
    silent = [n for n, s in document["components"]["schemas"].items() if not s.get("description")]
    assert silent == []


def test_every_operation_has_a_summary_a_description_and_a_tag(document):
    for name, operation in operations(document):
        assert operation.get("summary"), name
        assert operation.get("description"), name
        assert operation.get("tags"), name


def test_every_parameter_says_what_it_is(document):
    silent = [
        f"{name}: {parameter['name']}"
        for name, operation in operations(document)
        for parameter in operation.get("parameters", [])
        if not parameter.get("description")
    ]
    assert silent == []


def test_errors_are_documented_as_they_are_answered(document):
    wrong = [
        f"{name} {status}"
        for name, operation in operations(document)
        for status, response in operation["responses"].items()
        if int(status) >= 400
        and list(response.get("content", {})) != ["application/problem+json"]
        and "readyz" not in name
    ]
    assert wrong == []


def test_every_route_of_the_contract_is_there(document):
    room = "/v1/machines/{machine}"
    contract = {
        "/v1/machines": {"get", "post"},
        room: {"get", "patch", "delete"},
        f"{room}/error-maps": {"get", "post"},
        f"{room}/error-maps/{{map_id}}": {"get", "delete"},
        f"{room}/sensor-assignment": {"get", "put"},
        f"{room}/sensor-assignment/correlate": {"post"},
        f"{room}/models": {"get"},
        f"{room}/models/{{version}}": {"get"},
        f"{room}/models/{{version}}/activate": {"post"},
        f"{room}/compensation": {"get", "post"},
        f"{room}/readings": {"get", "post", "delete"},
        f"{room}/predictions": {"post"},
        f"{room}/verifications": {"get", "post"},
        f"{room}/verifications/{{verification_id}}": {"get", "delete"},
        f"{room}/analyses": {"get", "post"},
        f"{room}/analyses/{{analysis_id}}": {"get", "delete"},
        f"{room}/analyses/{{analysis_id}}/cancel": {"post"},
        f"{room}/analyses/{{analysis_id}}/adopt": {"post"},
        f"{room}/analyses/{{analysis_id}}/report": {"get"},
        f"{room}/analyses/plan": {"post"},
        "/healthz": {"get"},
        "/readyz": {"get"},
        "/metrics": {"get"},
    }
    there = {path: set(item) for path, item in document["paths"].items()}
    assert contract.items() <= there.items()


def test_it_is_written_in_a_thread(app):
    """It takes seconds the first time, in which tables go on."""
    (route,) = [r for r in app.routes if getattr(r, "path", "") == DOCUMENT]
    assert not iscoroutinefunction(route.endpoint)


def test_nothing_holds_a_service_that_has_ended(sqlite_url):
    """FastAPI remembers the functions of routes, and all that these close over."""
    with running(sqlite_url) as service:
        ended = weakref.ref(service)
    del service
    gc.collect()
    assert ended() is None
