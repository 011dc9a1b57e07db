"""The answer of an analysis: what a campaign says of the model, in plain numbers and sentences.

The OpenAPI document, stored results, the report and the terminal read these definitions.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Final, Literal, TypeAlias

from pydantic import Field

from app.answer import IN_ITS_UNIT, Answer, Sensors, UnitSymbol, shown
from app.effects.kind import NotTested
from app.errors import list_names
from app.identification.analysis.far_values import FarValue
from app.identification.analysis.figures import ComponentFigures, Figures
from app.identification.analysis.found_effect import FoundEffect, RefittedEffect
from app.identification.analysis.plots import Plots
from app.identification.plan.visit import NextVisit
from app.identification.residuals.residuals import LeftOut
from app.units import Unit

Verdict: TypeAlias = Literal["effects-found", "nothing-found", "unexplained", "not-judged"]

MOST_SUBJECTS: Final = 12
"""So many subjects are named with one reason."""


@dataclass(frozen=True, slots=True)
class TriedAssignment(Answer, published_as="TriedAssignmentAnswer"):
    """One component that is found to follow a sensor other than the assigned one."""

    component: Annotated[str, Field(examples=["EZZ"])]
    """Component code"""

    present_sensor: Annotated[str, Field(examples=["z-column"])]
    """Sensor that it follows now"""

    other_sensor: str | None
    """The other sensor; null in older results where nothing could be judged"""

    as_good: Sensors
    """Other sensors that the set-ups cannot tell from it"""

    unit: UnitSymbol
    """Unit of its numbers"""

    before_rms: Annotated[float, Field(alias="before_rms_um")]
    """Root mean square of the residuals with the present sensor, on held-out set-ups from their
    zeros [µm]; see `unit`"""

    after_rms: Annotated[float | None, Field(alias="after_rms_um")]
    """The same with the other sensor, as set-ups that were not held out say [µm]; see `unit`"""

    why_not: str | None
    """Why the other sensor is not proposed; null where it is"""

    sentence: str
    """One plain sentence"""

    @shown
    def proposed_sensor(self) -> str | None:
        """Sensor that it should follow instead; null where none is proposed."""
        return self.other_sensor if self.why_not is None else None


@dataclass(frozen=True, slots=True)
class UnexplainedPart(Answer, published_as="UnexplainedAnswer"):
    """Structure that no effect explains."""

    component: Annotated[str, Field(examples=["EYZ"])]
    """Where"""

    rms: Annotated[float, Field(alias="rms_um")]
    """Root mean square of what is left [µm]; see `unit`"""

    noise: Annotated[float, Field(alias="noise_um")]
    """Standard deviation of one observation [µm]; see `unit`"""

    unit: UnitSymbol
    """The unit of its numbers"""

    moves_with: Annotated[tuple[str, ...], Field(alias="leads")]
    """What it moves with"""

    tests: tuple[str, ...]
    """Which tests found it"""


@dataclass(frozen=True, slots=True)
class SmallestSeen(Answer, published_as="SmallestSeenAnswer"):
    """The smallest effect of one kind on one component that would have been seen nine times in ten.

    A time constant, pitch or time of change is taken from the middle of those that are searched.
    """

    kind: str
    """Kind of effect"""

    component: str
    """On which component"""

    unit: UnitSymbol
    """Unit of its numbers"""

    smallest_rms: Annotated[
        float, Field(description=f"Root mean square over the rows that it acts on {IN_ITS_UNIT}")
    ]


@dataclass(frozen=True, eq=False, slots=True)
class Analysis(Answer, published_as="AnalysisResult"):
    """What an analysis found; `plots` are the arrays of its report."""

    verdict: Verdict
    """`effects-found`; `nothing-found`; `unexplained`: structure remains that no effect fits;
    `not-judged`: residuals are larger than the noise, but there are too few set-ups to say why"""

    summary: str
    """The answer in plain sentences"""

    kinds: tuple[str, ...] | None
    """Kinds of effects that were looked for; null for all"""

    unit: UnitSymbol
    """Unit of the overall figures: µm, or that of the angles where no length was measured"""

    noise: Annotated[float | None, Field(alias="noise_um")]
    """Standard deviation of one observation [µm]; null where nothing is known of it; see `unit`"""

    floor: Annotated[float | None, Field(alias="floor_um")]
    """What noise alone would leave, judged by repeats and the scatter of set-ups [µm]; null where a
    component has too few repeats; see `unit`"""

    before: Figures
    """Residuals of the model as it was"""

    after: Figures
    """Residuals with all effects that were found, those that do not help included"""

    after_with_maps_refitted: Figures | None
    """The same with the maps also corrected within their own uncertainty"""

    p_global: float
    """Probability that noise alone gives as strong a candidate as the strongest one here"""

    visits: int
    """Visits that took part"""

    values: int
    """Values that took part"""

    components: tuple[ComponentFigures, ...]
    """Figures by component, largest first"""

    effects: tuple[FoundEffect, ...]
    """Effects that the model lacks; numbered from 0, as adoption, report and terminal do"""

    refitted: tuple[RefittedEffect, ...]
    """Effects that the model already has, and what adopting those that help does to them"""

    unexplained: tuple[UnexplainedPart, ...]
    """What no effect explains"""

    excluded: tuple[LeftOut, ...]
    """Values that took no part"""

    not_testable: tuple[NotTested, ...]
    """What could not be tested"""

    detectable: tuple[SmallestSeen, ...]
    """The smallest effects that would have been seen"""

    what_next: tuple[str, ...]
    """What to measure or to do next, the most useful first"""

    plots: Plots
    """Arrays of the report's plots"""

    floor_unknown: str | None = None
    """Why there is no floor; null where there is one"""

    next_visits: tuple[NextVisit, ...] = ()
    """Visits that would settle what is open, in the order of a working day; empty where none can be
    proposed, and in older results"""

    far_values: tuple[FarValue, ...] = ()
    """Values left out because they are far from the others, the furthest first, 200 at most; empty
    in older results"""

    assignments: tuple[TriedAssignment, ...] = ()
    """Components that are found to follow another sensor than theirs, proposals first"""

    temperatures_c: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """The lowest and the highest temperature of each sensor at the times of the values [°C]; empty
    in older results"""

    @property
    def proposals(self) -> tuple[TriedAssignment, ...]:
        """The components that should follow another sensor."""
        return tuple(
            assignment for assignment in self.assignments if assignment.proposed_sensor is not None
        )

    @property
    def is_refit_due(self) -> bool:
        """Whether adopting changes effects that the model has already."""
        return any(refit.is_changed for refit in self.refitted)

    @property
    def overall_count(self) -> int:
        """How many values the figures over all components are of: lengths, or all without any."""
        lengths = [
            component.count for component in self.components if component.unit == Unit.UM.symbol
        ]
        return sum(lengths or [component.count for component in self.components])


def by_reason(not_tested: Iterable[NotTested]) -> tuple[NotTested, ...]:
    """Name what one kind cannot show for the same reason together.

    Examples
    --------
    >>> by_reason([NotTested("drift", "EXX", "few"), NotTested("drift", "EXY", "few")])
    (NotTested(kind='drift', on='EXX, EXY', reason='few'),)
    """
    together: dict[tuple[str, str], dict[str, None]] = defaultdict(dict)
    for refusal in not_tested:
        together[refusal.kind, refusal.reason] |= {refusal.on: None} if refusal.on else {}
    return tuple(
        NotTested(kind, list_names(names, MOST_SUBJECTS) if names else "", reason)
        for (kind, reason), names in together.items()
    )
