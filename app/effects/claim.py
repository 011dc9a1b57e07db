"""What an effect claims: its kind and form, on what it acts, and by what it is driven.

Two effects of one claim are the same whatever their sizes. In what else they may differ and still
do the same, their kind knows: `do_the_same` in `registry.py`.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol


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
