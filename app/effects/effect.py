"""An effect that was found: what a model version stores and a live table contains."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Annotated, Any, Final, TypeAlias

from pydantic import (
    PlainSerializer,
    PlainValidator,
    TypeAdapter,
    ValidationError,
    WithJsonSchema,
)

from app.effects.driver import Driver, Quantity
from app.effects.term import StoredTerm, Term
from app.effects.valid import LearntIn, Range, StoredValid, complete
from app.errors import InvalidContent, list_names

LEARNT: Final[TypeAdapter[LearntIn | None]] = TypeAdapter(LearntIn | None)


@dataclass(frozen=True)
class Provenance:
    """Which analyses an adopted effect comes from.

    Parameters
    ----------
    refitted_by
        Those that fitted it anew since, in their order.
    verifications
        Numbers of the verifications that it was last estimated from.
    """

    found_by: int
    refitted_by: tuple[int, ...]
    verifications: tuple[int, ...]

    def refitted(self, analysis: int, verifications: Iterable[int]) -> Provenance:
        """Say that an analysis has fitted it anew."""
        return Provenance(self.found_by, (*self.refitted_by, analysis), tuple(verifications))


@dataclass(frozen=True)
class Effect:
    """One effect with its parameters and the terms that it adds.

    Parameters
    ----------
    variant
        Which of the kind's forms, empty where it has one only.
    parameters, standard_errors
        By name with unit, such as `time_constant_min`; one standard deviation of each. A
        parameter that was not estimated has no standard error.
    valid
        The ranges in which it was learnt; None where an older version of this software adopted
        it, which did not keep them.
    provenance
        Which analyses it comes from; None before it is adopted, and where an older version of
        this software adopted it. Effects that differ in it alone are equal.
    """

    kind: str
    components: tuple[str, ...]
    sensors: tuple[str, ...] = ()
    states: tuple[str, ...] = ()
    variant: str = ""
    parameters: Mapping[str, float] = field(default_factory=dict)
    standard_errors: Mapping[str, float] = field(default_factory=dict)
    terms: tuple[StoredTerm, ...] = ()
    valid: StoredValid | None = None
    provenance: Provenance | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        """Give equal drivers one range: what any of its components has shown, holds for all."""
        object.__setattr__(self, "terms", _pooled(self.terms))

    @property
    def adds_nothing(self) -> bool:
        """Whether it only tells of a sensor, and corrects no error."""
        return all(term.coefficient == 0.0 for term in self.terms)

    @cached_property
    def learnt_in(self) -> LearntIn | None:
        """The ranges in which it was learnt, as answers show them."""
        if self.valid is None:
            return None
        made_of: dict[str, Range] = {}
        for _, q, learnt, terms in ranges_of_quantities(self.terms):
            name = f"{q.name} [{q.unit}]" if q.unit else q.name
            if name in made_of:  # of maps at other temperatures: another range
                name = f"{name} of {list_names(sorted({t.component for t in terms}))}"
            made_of[name] = (q.zero + learnt[0], q.zero + learnt[1])
        return self.valid.shown(made_of)

    @cached_property
    def learnt_fields(self) -> Mapping[str, Any] | None:
        """The same as JSON's own types: live tables write it at each reading."""
        written: dict[str, Any] | None = LEARNT.dump_python(self.learnt_in, mode="json")
        return written

    def to_json(self) -> dict[str, Any]:
        """Write it down as a model version stores it."""
        written: dict[str, Any] = EFFECT.dump_python(self, mode="json", by_alias=True)
        return written


EFFECT: Final[TypeAdapter[Effect]] = TypeAdapter(
    Annotated[
        Effect,
        complete("kind", "components", "sensors", "parameters", "standard_errors", "terms"),
    ]
)
"""Effects of older versions have no variant, states, ranges or provenance."""


def _stored_or_effect(stored: Any) -> Effect:
    return stored if isinstance(stored, Effect) else effect_from_json(stored)


StoredEffect: TypeAlias = Annotated[
    Effect,
    PlainValidator(_stored_or_effect),
    PlainSerializer(Effect.to_json, return_type=dict),
    WithJsonSchema({"type": "object", "additionalProperties": True}),
]
"""An effect that is written and read as a model version stores it."""


def ranges_of_quantities(
    terms: Iterable[Term],
) -> Iterator[tuple[Driver, Quantity, Range, list[Term]]]:
    """List the drivers of an effect that have a range of their own, with all terms of each."""
    grouped: dict[tuple[Driver, Range | None], list[Term]] = defaultdict(list)
    for term in terms:
        grouped[term.driver, term.learnt].append(term)
    for (driver, learnt), of_driver in grouped.items():
        if driver.quantity is not None and learnt is not None and not driver.is_signal:
            yield driver, driver.quantity, learnt, of_driver


def _pooled(terms: Sequence[Term]) -> tuple[Term, ...]:
    ranges: dict[Driver, Range] = {}
    for term in terms:
        if term.learnt is not None:
            low, high = ranges.get(term.driver, term.learnt)
            ranges[term.driver] = (min(low, term.learnt[0]), max(high, term.learnt[1]))
    return tuple(replace(term, learnt=ranges.get(term.driver)) for term in terms)


def acting_on(effects: Iterable[Effect]) -> set[str]:
    """List the components to which effects add something."""
    return {term.component for effect in effects for term in effect.terms}


def effect_from_json(stored: Mapping[str, Any]) -> Effect:
    """Read an effect as `Effect.to_json` wrote it.

    Raises
    ------
    InvalidContent
        If something is missing, or names what does not exist.
    """
    try:
        return EFFECT.validate_python(stored)
    except (TypeError, ValidationError) as error:
        wrong = str(error)
        if isinstance(error, ValidationError):
            first = error.errors()[0]
            wrong = f"{'.'.join(map(str, first['loc']))} ({first['msg']})"
        raise InvalidContent.of_field(
            "effects", f"expected a stored effect, got one that lacks or mistakes {wrong}"
        ) from None
