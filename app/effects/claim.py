"""What an effect claims: its kind and form, on what it acts, and by what it is driven.

Two effects of one claim are the same whatever their sizes. In what else they may differ and still
do the same, their kind knows: `do_the_same` in `registry.py`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, NamedTuple, Protocol

from pydantic import Field

from app.answer import Answer


class Named(Protocol):
    """What names an effect or a hypothesis."""

    @property
    def kind(self) -> str:
        """The kind."""

    @property
    def variant(self) -> str:
        """Which form of the kind."""

    @property
    def components(self) -> tuple[str, ...]:
        """What it acts on."""

    @property
    def sensors(self) -> tuple[str, ...]:
        """Which sensors drive it."""

    @property
    def states(self) -> tuple[str, ...]:
        """Which states drive it."""


@dataclass(frozen=True, slots=True)
class AnsweredClaim(Answer):
    """What names an effect in answers."""

    # Text under a field describes it in the class itself alone, and not where it is inherited.
    kind: Annotated[str, Field(description="Kind of effect", examples=["thermal-lag"])]
    variant: Annotated[
        str, Field(description="Which form of the kind; empty where it has one only")
    ]
    components: Annotated[tuple[str, ...], Field(description="On which components")]
    sensors: Annotated[tuple[str, ...], Field(description="Driven by which sensors")]
    states: Annotated[tuple[str, ...], Field(description="Driven by which states")]


class Claim(NamedTuple):
    """All that tells an effect from others but its sizes.

    Examples
    --------
    >>> Claim("backlash", "constant", ("EXX",), (), ()).key
    'backlash constant EXX'
    """

    kind: str
    variant: str
    components: tuple[str, ...]
    sensors: tuple[str, ...]
    states: tuple[str, ...]

    @property
    def key(self) -> str:
        """Name it among all hypotheses."""
        parts = (self.variant, *self.components, *self.sensors, *self.states)
        return " ".join([self.kind, *filter(None, parts)])


def claim_of(named: Named) -> Claim:
    """Give what an effect, or a hypothesis, claims."""
    return Claim(named.kind, named.variant, named.components, named.sensors, named.states)
