"""The tree of errors: what each carries, and how fields are named from further out."""

import pytest

from app import errors
from app.errors import FieldError, InvalidContent, ThermapError, UnknownComponent, list_names


def test_one_blamed_field_stands_in_the_sentence_and_beside_it():
    error = InvalidContent.of_field("positions_mm", "expected mm")
    assert str(error) == error.detail == "positions_mm: expected mm"
    assert list(error.errors) == [FieldError("positions_mm", "expected mm")]


def test_from_further_out_the_path_grows_and_the_kind_stays():
    inner = UnknownComponent("expected a component, got 'EXQ'")
    outer = inner.inside("components.3").inside("maps.0")
    assert isinstance(outer, UnknownComponent)
    assert outer.detail == f"maps.0.components.3: {inner.detail}"
    assert outer.errors == (FieldError("maps.0.components.3", inner.detail),)
    of_field = InvalidContent.of_field("errors_um", "expected 3").inside("components.3")
    assert of_field.errors == (FieldError("components.3.errors_um", "expected 3"),)


@pytest.mark.parametrize(
    ("child", "parent"),
    [
        (errors.NoReading, errors.Conflict),
        (errors.UnknownComponent, errors.InvalidContent),
        (errors.NotEnoughMaps, errors.InvalidContent),
        (errors.SensorUnavailable, errors.InvalidContent),
        (errors.OutsideMaps, errors.InvalidContent),
    ],
)
def test_the_tree_is_the_one_that_is_drawn(child, parent):
    """Statuses of HTTP follow the parent."""
    assert issubclass(child, parent)
    assert issubclass(parent, ThermapError)


@pytest.mark.parametrize(
    ("names", "limit", "text"),
    [
        ([], 20, "none"),
        (["a", "b"], 2, "a, b"),
        (["a", "b", "c"], 2, "a, b and 1 more"),
        ((n for n in "abcd"), 1, "a and 3 more"),
    ],
)
def test_long_lists_are_cut_and_counted(names, limit, text):
    assert list_names(names, limit) == text
