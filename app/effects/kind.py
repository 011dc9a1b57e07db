"""The one shape of all kinds of effects."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any, ClassVar, Literal, TypeAlias

from app.answer import Answer
from app.effects.campaign_view import CampaignView
from app.effects.claim import Named
from app.effects.conditions import Signal
from app.effects.driver import Driver
from app.effects.effect import Effect
from app.effects.hypothesis import Amplitude, Amplitudes, Hypothesis
from app.effects.shape import Rising, Shape
from app.effects.term import Term
from app.errors import list_names
from app.geometry.components import COMPONENTS
from app.thermal.error_map import ErrorMap

DrawnOver: TypeAlias = Literal["driver", "time", "position"]


class Need(StrEnum):
    """What a kind needs before it can be tested, as it is said where that is lacking."""

    STATE = "needs the machine's state with the readings or the observations, got none"
    DIRECTION = "needs observations approached from both directions"
    POINTS = "needs observations at points of the work volume, ideally with tools of two lengths"
    MOMENTS = "needs several visits, or one that lasts hours, got one short visit"

    def is_met(self, view: CampaignView) -> bool:
        """Whether a campaign has it."""
        match self:
            case Need.STATE:
                return bool(view.conditions.states)
            case Need.DIRECTION:
                directions = view.rows.directions
                return bool((directions > 0).any() and (directions < 0).any())
            case Need.POINTS:
                return view.rows.has_points
            case Need.MOMENTS:
                return len(view.moments_s) > 1


class Shakes(StrEnum):
    """What a mistake in the data takes the ground from, until it is corrected."""

    TEMPERATURES = "temperatures"
    """What is seen at temperatures or states: they are not those of the observations."""

    VALUES = "values"
    """All that is seen in the same channels: the values, or their places, are not what they say."""


class OverTime(StrEnum):
    """How something comes with time, as the zero of an instrument may too."""

    GROWS = "it grows evenly"
    BEGINS = "it begins at one time, and stays"


@dataclass(frozen=True, slots=True)
class NotTested(Answer, published_as="NotTestedAnswer"):
    """Something that these observations cannot show."""

    kind: str
    """Kind of effect"""

    on: str
    """What it would act on or be driven by; empty for the kind as a whole"""

    reason: str
    """Why"""


Proposed: TypeAlias = Iterator[Hypothesis | NotTested]
"""What can be tested, and what cannot with the reason, as a kind goes through a campaign."""


@dataclass(frozen=True, slots=True)
class Proposals:
    """What a kind makes of a campaign."""

    hypotheses: list[Hypothesis] = field(default_factory=list)
    not_testable: list[NotTested] = field(default_factory=list)


class EffectKind(ABC):
    """One kind of effect: what it is, what it needs, how it is tested, and how it is described.

    `kind` names it; `text` says in a line what it is, and `needs` what must be known. `trending`
    kinds must also hold forward in time; a component can have an `only_once` kind once at most.
    One `of_the_type` comes with a machine's design, so that its sisters may have it too; a drift,
    a step, a fault of a sensor, a map or an instrument is one machine's own history.
    `shown_by` is the measurement that shows it best; `against` names, for each rival kind, the
    measurement that separates the two. In both, {component}, {sensor} and {state} stand for the
    effect's own.

    What reports say of it: residuals are `drawn_over` its driver, time or position, and
    `driver_note` explains the driver there; `share_of` says what a parameter `share` is a
    share of; `remedy` what to do about it, where {components} stands for the effect's own.

    A mistake in the data or the wiring is `not_adopted`, for the stated reason: the model lacks
    nothing, and the mistake is to be corrected at its source. `spoils` names the kinds, with the
    reasons, that are not adopted beside it either; `shakes` says what has to wait until the
    mistake is corrected. Only what `alternates`, with direction or from place to place, is the
    same at whatever temperature it was seen. A kind is `never_sure`, for the stated reason,
    where the machine may do just the same: it is suspected at most, and what cannot be told from
    it is not adopted by default.

    What comes `over_time` an instrument may do as well. What is `of_time_alone` does not come
    again with temperatures or states: the machine is no longer what it was. What is `constant` is
    the same at all times and temperatures, as an instrument's zero is.

    When a component is measured again, an adopted effect may no longer hold. One `lacked_by_maps`
    is of components that no two maps had, and goes once they have them. One that is `zero_in_maps`,
    in each map's own thermal state, goes where it does not know that state. What is
    `measured_along` is in any new map. `gone` says why it is left out where the maps no longer
    state what it needs.
    """

    kind: ClassVar[str]
    text: ClassVar[str]
    needs: ClassVar[Need | None] = None
    trending: ClassVar[bool] = False
    only_once: ClassVar[bool] = False
    of_the_type: ClassVar[bool] = False
    shown_by: ClassVar[str]
    against: ClassVar[Mapping[str, str]] = {}
    drawn_over: ClassVar[DrawnOver] = "driver"
    driver_note: ClassVar[str] = ""
    share_of: ClassVar[str] = ""
    remedy: ClassVar[str] = ""
    not_adopted: ClassVar[str] = ""
    never_sure: ClassVar[str] = ""
    spoils: ClassVar[Mapping[str, str]] = {}
    shakes: ClassVar[Shakes | None] = None
    alternates: ClassVar[bool] = False
    over_time: ClassVar[OverTime | None] = None
    of_time_alone: ClassVar[bool] = False
    constant: ClassVar[bool] = False
    lacked_by_maps: ClassVar[bool] = False
    zero_in_maps: ClassVar[bool] = False
    measured_along: ClassVar[bool] = False
    gone: ClassVar[str] = "a map does not state the temperatures that it needs"

    @abstractmethod
    def propose(self, view: CampaignView) -> Proposed:
        """List what can be tested in a campaign that has what it `needs`, and what cannot."""

    @abstractmethod
    def explain(self, effect: Effect) -> str:
        """Say in one plain sentence what was found."""

    def candidates(self, view: CampaignView) -> Proposals:
        """List what can be tested in a campaign, and what cannot, with the reason."""
        if self.needs is not None and not self.needs.is_met(view):
            return Proposals(not_testable=[self.refuse("", self.needs)])
        proposals = Proposals()
        for proposed in self.propose(view):
            if isinstance(proposed, NotTested):
                proposals.not_testable.append(proposed)
            else:
                proposals.hypotheses.append(
                    replace(proposed, only_once=self.only_once, trending=self.trending)
                )
        return proposals

    def which_map(self, variant: str) -> str:
        """Give the label of the one map that a variant is about; empty where it is about none."""
        del variant
        return ""

    def what_to_do(self, effect: Effect) -> str:
        """Say what to do about what was found, in a sentence; empty where nothing need be done."""
        return self.remedy.format(components=list_names(effect.components, 3))

    def doubt(self, effect: Effect) -> str:
        """Say what in an effect's own size speaks against its name; empty where nothing does."""
        del effect
        return ""

    def may_be_instruments(self, effect: Effect) -> bool:
        """Whether an instrument's zero may do just what an effect does, as time goes on."""
        del effect
        return self.over_time is not None

    def is_measured_along(self, new_map: ErrorMap, effect: Effect) -> bool:
        """Whether a new map of an effect's component contains what the effect corrects."""
        del new_map, effect
        return self.measured_along

    def separating_measurement(self, effect: Named, rival: Named) -> str:
        """Name what to measure to tell an effect from a rival.

        A sensor cannot be brought apart from itself. Where both follow the same one, the
        measurement is of the components in which they differ, or else what shows the effect best.
        """
        text = self.against.get(rival.kind, self.shown_by)
        if "{rival}" in text and (not rival.sensors or rival.sensors[-1:] == effect.sensors[-1:]):
            both = {*effect.components} & {*rival.components}
            differing = [c for c in (*effect.components, *rival.components) if c not in both]
            text = self.shown_by
            if differing:
                text = (
                    f"measure {list_names(differing, 3)} in each visit, at temperatures of "
                    f"{{sensor}} as different as possible: only one of the two explanations moves "
                    "it"
                )
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
        As `CampaignView.shapes` lists them.
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


def additive(
    kind: str,
    code: str,
    driver: Driver | Callable[[float | None], Driver],
    shapes: Sequence[Shape],
    sizes: str | tuple[Amplitude, ...],
    **traits: Any,
) -> Hypothesis:
    """Make the hypothesis that one component errs by a driver along smooth shapes.

    Parameters
    ----------
    driver
        What it follows, or what gives that for a value of the nonlinear parameter.
    sizes
        The amplitudes, or what they are called in mid-travel, `{unit}` for the component's.
    """

    def terms(theta: float | None) -> Amplitudes:
        follows = driver if isinstance(driver, Driver) else driver(theta)
        return [[Term(code, follows, shape)] for shape in shapes]

    if isinstance(sizes, str):
        sizes = amplitudes_of(shapes, sizes.format(unit=COMPONENTS[code].unit))
    return Hypothesis(kind, (code,), unit_terms=terms, amplitudes=sizes, **traits)


def together_and_each(codes: tuple[str, ...]) -> list[tuple[str, ...]]:
    """List the components of a sensor as one group, and each by itself.

    >>> together_and_each(("EXX", "EYX")), together_and_each(("EXX",))
    ([('EXX', 'EYX'), ('EXX',), ('EYX',)], [('EXX',)])
    """
    return [codes, *((code,) for code in codes if len(codes) > 1)]


def not_late(
    kind: EffectKind, view: CampaignView, grids_s: Mapping[Signal, Sequence[float]], late: str
) -> Iterator[NotTested]:
    """Say of signals without a time constant that can be tested why there is none.

    Parameters
    ----------
    late
        Which form of the kind needs one.
    """
    for signal, grid_s in grids_s.items():
        if not grid_s:
            yield kind.refuse(f"{signal.name}, {late}", view.why_no_lag(signal))


def constant_sensors(kind: EffectKind, view: CampaignView) -> Iterator[NotTested]:
    """Name the sensors that cannot drive anything, because they are not known or stood still."""
    for name in view.conditions.temperatures_c:
        if name not in view.varying_sensors:
            yield kind.refuse(name, constant_sensor_reason(name))


def constant_sensor_reason(sensor: str) -> str:
    """Say why a sensor cannot drive anything."""
    return f"{sensor} did not change during this campaign, or its readings are missing"
