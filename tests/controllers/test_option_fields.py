"""What a form is told of an option is what the option is held to."""

import pytest

from app.controllers.option_fields import option_fields
from app.controllers.registry import FORMATS, options_of
from app.errors import InvalidContent

OPTIONS = [(name, option) for name, one in FORMATS.items() for option in option_fields(one)]
NEEDED = {"sign": "error", "counts_per_mm": 1000.0}
VALUES = {"text": "AX_1", "components": ["EXX"]}


def stated(name, option, value):
    """What the format makes of one value, beside what has to be stated."""
    needed = {n: v for n, v in NEEDED.items() if n in FORMATS[name].options.model_fields}
    content = dict.fromkeys(option.axes, value) if option.axes else value
    options = options_of(FORMATS[name], needed | {option.name: content})
    return getattr(options, option.name), content


def edges(option):
    if option.takes in VALUES:
        return [VALUES[option.takes]]
    if option.takes == "choice":
        return list(option.choices)
    low = option.minimum if option.above is None else option.above + 1e-3
    return [low, option.maximum]


def beyond(option):
    if option.takes == "text":
        return ["two words"]
    if option.takes == "components":
        return []
    if option.takes == "choice":
        return ["another"]
    low = option.minimum - 1 if option.above is None else option.above
    return [low, option.maximum + 1, "many", *([1.5] if option.takes == "whole-number" else [])]


@pytest.mark.parametrize(("name", "option"), OPTIONS, ids=lambda one: getattr(one, "name", one))
def test_an_option_takes_what_its_field_says_and_nothing_beyond(name, option):
    for value in edges(option):
        kept, given = stated(name, option, value)
        assert kept == given
    for value in beyond(option):
        with pytest.raises(InvalidContent) as refused:
            stated(name, option, value)
        assert all(e.field.startswith(f"options.{option.name}") for e in refused.value.errors)


@pytest.mark.parametrize("name", FORMATS)
def test_what_has_a_default_need_not_be_stated(name):
    fields = list(option_fields(FORMATS[name]))
    needed = {one.name: NEEDED[one.name] for one in fields if one.required}
    options = options_of(FORMATS[name], needed)
    defaults = {one.name: one.default for one in fields if not one.required}
    assert {one: getattr(options, one) for one in defaults} == defaults
    for one in fields:
        is_mm = one.name.endswith("_mm") and not one.name.endswith("_per_mm")
        assert (one.unit == "mm") == is_mm


def test_a_name_that_is_none_says_what_one_is():
    with pytest.raises(InvalidContent, match=r"options\.axes\.x: expected 1 to 32 letters"):
        options_of(FORMATS["siemens-enc-comp"], {"axes": {"x": "X 1"}})
    with pytest.raises(InvalidContent, match=r"expected an axis x, y or z, got 'u'"):
        options_of(FORMATS["siemens-enc-comp"], {"axes": {"u": "X1"}})
