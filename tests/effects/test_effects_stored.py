"""An effect that is stored in part is refused: none of its defaults is what was adopted."""

import json
from dataclasses import replace

import pytest

from app.effects.driver import Always
from app.effects.effect import Effect, Provenance, effect_from_json
from app.effects.shape import Rising
from app.effects.term import Term
from app.effects.valid import Valid
from app.errors import InvalidContent

TERM = Term("EXX", Always(), Rising(250.0, 250.0), 2.0, is_reversing=True, learnt=(0.0, 1.0))
VALID = Valid(0.0, 3600.0, {"x-middle": (20.0, 25.0)}, {}, {}, 7200.0, 9000.0)
EFFECT = Effect(
    *("backlash", ("EXX",), ("x-middle",), ("spindle_rpm",), "constant"),
    *({"size_um": 2.0}, {"size_um": 0.1}, (TERM,), VALID, Provenance(1, (2,), (3,))),
)
YOUNGER = {
    "": {
        "variant": "",
        "states": (),
        "valid": None,
        "provenance": EFFECT.provenance,  # effects that differ in it alone are equal
    },
    "terms.0": {"learnt": None},
    "valid": {"continued_until": None},
    "provenance": {},
}
"""Fields that former versions did not write, and what they stand for where they are missing."""


def written():
    return json.loads(json.dumps(EFFECT.to_json()))


def part_of(stored, place):
    for name in place.split(".") if place else ():
        stored = stored[int(name) if name.isdigit() else name]
    return stored


FIELDS = [(place, name) for place in YOUNGER for name in part_of(written(), place)]


@pytest.mark.parametrize(("place", "name"), FIELDS)
def test_only_what_former_versions_did_not_write_may_be_missing(place, name):
    stored = written()
    del part_of(stored, place)[name]
    if name not in YOUNGER[place]:
        with pytest.raises(InvalidContent, match=f"lacks or mistakes {place}.*{name}"):
            effect_from_json(stored)
        return
    value = YOUNGER[place][name]
    read = {
        "": lambda: replace(EFFECT, **{name: value}),
        "terms.0": lambda: replace(EFFECT, terms=(replace(TERM, learnt=value),)),
        "valid": lambda: replace(EFFECT, valid=replace(VALID, continued_until_s=value)),
    }
    assert effect_from_json(stored) == read[place]()


def test_the_effect_as_it_stands_is_read():
    assert effect_from_json(written()) == EFFECT
    assert effect_from_json(written()).provenance == EFFECT.provenance
