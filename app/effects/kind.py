"""The one shape of all kinds of effects."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import ClassVar, Protocol

from app.answer import Answer
from app.effects.effect import Effect
from app.effects.hypothesis import Amplitude, Hypothesis
from app.effects.shape import Rising, Shape
from app.effects.site import OWN_ZEROS, Site


class Need(StrEnum):
    """What a kind needs before it can be tested."""

    STATE = "the machine's state"
    DIRECTION = "directions of approach"
    POINTS = "observations at points"
    VISITS = "several visits"


class Named(Protocol):
    """What names an effect or a hypothesis."""

    @property
    def kind(self) -> str:
        """The kind."""

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
class NotTested(Answer, published_as="NotTestedAnswer"):
    """What these observations cannot show."""

    kind: str
    """Kind of effect"""

    on: str
    """Of what"""

    reason: str
    """Why"""


@dataclass(frozen=True, slots=True)
class Proposals:
    """What a kind makes of a site."""

    hypotheses: list[Hypothesis] = field(default_factory=list)
    not_testable: list[NotTested] = field(default_factory=list)


class EffectKind(ABC):
    """One kind of effect: what it is, what it needs, how it is tested, and how it is told.

    `kind` names it; `text` says in a line what it is; `needs` what must be known. `trending`
    kinds must also hold forward in time; of an `only_once` kind one component can have one
    only. `shown_by` is the measurement that shows it best; `against` names for a rival kind
    the one that separates both. In both, {component}, {sensor} and {state} stand for the
    effect's own.
    """

    kind: ClassVar[str]
    text: ClassVar[str]
    needs: ClassVar[frozenset[Need]] = frozenset()
    trending: ClassVar[bool] = False
    only_once: ClassVar[bool] = False
    shown_by: ClassVar[str]
    against: ClassVar[Mapping[str, str]] = {}

    @abstractmethod
    def propose(self, site: Site) -> Proposals:
        """List what can be tested at a site whose `needs` are met."""

    @abstractmethod
    def explain(self, effect: Effect) -> str:
        """Say in one plain sentence what was found."""

    def candidates(self, site: Site) -> Proposals:
        """List what can be tested at a site, and what cannot, with the reason.

        Parameters
        ----------
        site
            The machine and the campaign.
        """
        lacking = [reason for need in sorted(self.needs) if (reason := _lacks(site, need))]
        if lacking:
            return Proposals(not_testable=[NotTested(self.kind, "", lacking[0])])
        found = self.propose(site)
        hypotheses = [
            replace(h, is_only_once=self.only_once, is_trending=self.trending)
            for h in found.hypotheses
        ]
        return Proposals(hypotheses, found.not_testable)

    def separating_measurement(self, effect: Named, rival: Named) -> str:
        """Name what to measure to tell an effect from a rival.

        Parameters
        ----------
        effect
            The effect or hypothesis of this kind.
        rival
            Its rival, of any kind.
        """
        text = self.against.get(rival.kind, self.shown_by)
        return text.format(
            component=effect.components[0] if effect.components else "the component",
            sensor=effect.sensors[-1] if effect.sensors else "the sensor",
            state=effect.states[0] if effect.states else "the state",
            rival=rival.sensors[-1] if rival.sensors else "the other sensor",
        )

    def refuse(self, subject: str, reason: str) -> NotTested:
        """Say that something cannot be tested."""
        return NotTested(self.kind, subject, reason)


def amplitudes_of(shapes: Sequence[Shape], name: str) -> tuple[Amplitude, ...]:
    """Name the amplitudes of the smooth shapes: in mid-travel, and from there to its end.

    Parameters
    ----------
    shapes
        As `Site.shapes` lists them.
    name
        Name with unit in mid-travel.

    Examples
    --------
    >>> from app.effects.shape import Everywhere, Rising
    >>> [a.name for a in amplitudes_of([Everywhere(), Rising(0.0, 1.0)], "slope_um_per_k")]
    ['slope_um_per_k', 'slope_rise_um_per_k']
    """
    stem, _, unit = name.partition("_")
    rise = f"{stem}_rise_{unit}"
    return tuple(Amplitude(rise if isinstance(shape, Rising) else name) for shape in shapes)


def by_lasting_shapes(
    kind: EffectKind, site: Site, propose: Callable[[str, list[Shape]], Iterable[Hypothesis]]
) -> Proposals:
    """Propose what changes from visit to visit, in the shapes in which it would show.

    Parameters
    ----------
    kind
        The kind.
    site
        The campaign.
    propose
        Makes hypotheses of a component and its shapes.
    """
    found = Proposals()
    for code in site.components:
        shapes = site.lasting(code, site.shapes(code))
        found.hypotheses.extend(propose(code, shapes) if shapes else ())
        if not shapes:
            found.not_testable.append(kind.refuse(code, OWN_ZEROS))
    return found


def constant_sensors(kind: EffectKind, site: Site) -> list[NotTested]:
    """Name the sensors that cannot drive anything, because they are not known or stood still."""
    return [
        kind.refuse(name, stood_still(name))
        for name in site.conditions.temperatures_c
        if name not in site.varying_sensors
    ]


def stood_still(sensor: str) -> str:
    """Say why a sensor cannot drive anything."""
    return f"{sensor} did not change, or was not known, in this campaign"


def _lacks(site: Site, need: Need) -> str:
    if need is Need.POINTS and not site.rows.has_points:
        return "needs observations at points of the work volume, best with tools of two lengths"
    if need is Need.DIRECTION and not _both_directions(site):
        return "needs observations approached from both directions"
    if need is Need.VISITS and site.rows.visits < 2:
        return "needs several visits, came one"
    if need is Need.STATE and not site.conditions.states:
        return "needs the machine's state beside readings or observations, came none"
    return ""


def _both_directions(site: Site) -> bool:
    directions = site.rows.directions
    return bool((directions > 0).any() and (directions < 0).any())
