"""The answer of an analysis: what a campaign says of the model, in plain numbers and sentences.

The OpenAPI document, stored results, the report and the terminal read these definitions.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Annotated, Final, Literal, TypeAlias

from pydantic import Field

from app.answer import IN_ITS_UNIT, Answer, Codes, Range, Sensors, UnitSymbol, shown
from app.effects.effect import StoredEffect
from app.effects.kind import NotTested
from app.effects.valid import LearntIn
from app.errors import list_names
from app.identification.residuals.residuals import LeftOut
from app.units import Unit

Parameters: TypeAlias = Annotated[
    Mapping[str, float], Field(examples=[{"time_constant_min": 41.2}])
]

Verdict: TypeAlias = Literal["effects-found", "nothing-found", "unexplained", "not-judged"]

Zero: TypeAlias = Literal["absolute", "first", "removed"]
"""What figures are relative to."""

ROUNDING: Final = 1e-9
"""Share of a size: less is rounding."""

MOST_SUBJECTS: Final = 12
"""So many subjects are named with one reason."""


@dataclass(frozen=True, slots=True)
class Figures(Answer, published_as="FiguresAnswer"):
    """Size of residuals over all lengths, or over all values where none is a length."""

    rms: Annotated[float, Field(alias="rms_um")]
    """Root mean square of all visits together [µm]"""

    p95: Annotated[float, Field(alias="p95_um")]
    """95th percentile of the size [µm]"""

    holdout_rms: Annotated[float | None, Field(alias="holdout_rms_um")]
    """Root mean square on held-out visits: each is predicted by what was learnt without it [µm];
    null where nothing could be held out"""

    holdout_rms_ci95: Annotated[Range | None, Field(alias="holdout_rms_ci95_um")]
    """Its 95 % confidence interval, over visits [µm]"""

    zero: Zero | None = None
    """What they are relative to. `absolute`: the model's zero. `first`: the first observation of
    each set-up, at which the instrument was zeroed. `removed`: the zero is not known, and the mean
    of the values that share it is taken off. Null in older results"""

    @property
    def shown_rms(self) -> float:
        """The root mean square that is shown: on held-out visits where there are any."""
        return self.rms if self.holdout_rms is None else self.holdout_rms


@dataclass(frozen=True, slots=True)
class ComponentFigures(Answer, published_as="ComponentFiguresAnswer"):
    """One component, or one direction at points, before and after, in its own unit."""

    component: Annotated[str, Field(examples=["EZZ"])]
    """Component code, or `points x`"""

    unit: UnitSymbol
    """Its unit"""

    count: int
    """Values that took part"""

    before_rms: Annotated[float, Field(description=f"Root mean square before {IN_ITS_UNIT}")]
    after_rms: Annotated[float, Field(description=f"Root mean square after {IN_ITS_UNIT}")]
    before_p95: Annotated[
        float, Field(description=f"95th percentile of the size before {IN_ITS_UNIT}")
    ]
    after_p95: Annotated[
        float, Field(description=f"95th percentile of the size after {IN_ITS_UNIT}")
    ]
    holdout_before_rms: Annotated[
        float | None,
        Field(description=f"Root mean square before, on held-out visits {IN_ITS_UNIT}"),
    ]
    holdout_after_rms: Annotated[
        float | None,
        Field(description=f"Root mean square after, on held-out visits {IN_ITS_UNIT}"),
    ]
    noise: Annotated[
        float, Field(description=f"Standard deviation of one observation {IN_ITS_UNIT}")
    ]
    noise_origin: str
    """`declared`, `replicates`, `residuals` or `rounding`"""

    floor: Annotated[
        float | None,
        Field(
            description="What noise alone would leave, judged by repeats within two minutes and "
            f"the scatter of set-ups {IN_ITS_UNIT}; null where too little was repeated"
        ),
    ]
    floor_unknown: str | None = None
    """Why there is no floor; null where there is one"""

    setup_scatter: Annotated[
        float | None,
        Field(
            description="Standard deviation between set-ups, as fitted to these residuals "
            f"{IN_ITS_UNIT}; null where nothing could be held out"
        ),
    ] = None
    zero: Zero | None = None
    """What its figures are relative to; see the overall figures"""

    @property
    def is_held_out(self) -> bool:
        """Whether there are figures of held-out visits."""
        return self.holdout_before_rms is not None

    @property
    def shown_rms(self) -> tuple[float, float]:
        """Root mean square before and after that are shown: held out where that is possible."""
        if self.holdout_before_rms is None or self.holdout_after_rms is None:
            return self.before_rms, self.after_rms
        return self.holdout_before_rms, self.holdout_after_rms

    @property
    def is_changed(self) -> bool:
        """Whether effects change it by more than rounding does."""
        return abs(self.after_rms - self.before_rms) > ROUNDING * self.before_rms


@dataclass(frozen=True, slots=True)
class Evidence(Answer, published_as="EvidenceAnswer"):
    """How sure an effect is; numbers without a unit, null where the readings alone show it."""

    likelihood_ratio: float | None = None
    """Twice the rise of the log likelihood"""

    degrees_of_freedom: int | None = None
    """Numbers that were fitted for it"""

    two_ln_bayes_factor: float | None = None
    """Evidence for it against no effect, 2 ln of the Bayes factor, with the prior spread evenly
    within its kind; above 10 it is very strong"""

    p_global: float | None = None
    """Probability that noise alone gives as strong a candidate anywhere in the library"""

    calibration_slope: float | None = None
    """Slope of measured against predicted contribution on held-out visits: 1 if they show all of
    it, 0 if nothing; null where it was never found without them"""

    calibration_slope_error: float | None = None
    """Standard error of that slope"""

    forward_slope: float | None = None
    """The same slope on the last visits, predicted from the earlier ones, for trends"""

    found_again_share: float | None = None
    """Share of the hold-out splits in which it, or what it is tied with, is found again"""

    seen_in_readings: str | None = None
    """What the readings alone show of it; null where they do not show it"""


@dataclass(frozen=True, slots=True)
class Alternative(Answer, published_as="AlternativeAnswer"):
    """Another explanation of the same residuals."""

    kind: Annotated[str, Field(examples=["additional-sensor"])]
    """Kind of effect"""

    variant: str
    """Which form of the kind; empty where it has one only"""

    components: tuple[str, ...]
    """On which components"""

    sensors: tuple[str, ...]
    """Driven by which sensors"""

    states: tuple[str, ...]
    """Driven by which states"""

    evidence: float
    """Its evidence against no effect, 2 ln of the Bayes factor"""

    behind: float
    """How much weaker that is than the effect's own evidence"""

    alias_share: float
    """Share of the effect that it can imitate"""

    tied: bool
    """Whether these observations cannot tell the two apart"""

    with_offset: bool
    """Whether it comes this close only with a constant added to it"""

    separating_measurement: str | None = None
    """What would tell them apart"""


@dataclass(frozen=True, slots=True)
class StrongVisit(Answer, published_as="StrongVisitAnswer"):
    """A visit that carries much of the evidence."""

    label: str
    """Label of the verification"""

    time: datetime
    """When it began, UTC"""


@dataclass(frozen=True, slots=True)
class Cause(Answer, published_as="CauseAnswer"):
    """What the observations say of one cause among many that drive an effect together."""

    claim: Annotated[Literal["kind", "driver", "tie", "amount"], Field(examples=["amount"])]
    """`kind`: whether a kind of cause takes part; `driver`: a cause that nothing else can stand in
    for; `tie`: causes that can stand in for one another; `amount`: by how much the component
    moves"""

    names: tuple[str, ...]
    """Sensors and states that it is about; empty where it is about all or none"""

    sentence: str
    """One plain sentence"""

    two_ln_bayes_factor: float | None = None
    """Evidence that is lost without it, 2 ln of the Bayes factor: above 6 is strong, above 10 very
    strong"""

    value: Annotated[
        float | None,
        Field(description=f"The amount after the longest time that is stated {IN_ITS_UNIT}"),
    ] = None
    error: Annotated[
        float | None,
        Field(
            description="Its standard deviation, the larger of those by posterior and by "
            f"jackknife {IN_ITS_UNIT}"
        ),
    ] = None


@dataclass(frozen=True, eq=False, slots=True)
class FoundEffect(Answer, published_as="FoundEffectAnswer"):
    """One effect that the model lacks."""

    effect: StoredEffect
    """What adoption stores"""

    before_rms: Annotated[float, Field(alias="before_rms_um")]
    """Root mean square of the residuals where it acts, before any found effect, on held-out visits
    where there are any [µm]; see `unit`"""

    after_rms: Annotated[float, Field(alias="after_rms_um")]
    """The same with all found effects [µm]; see `unit`"""

    unit: UnitSymbol
    """Unit of these two: µm where the effect acts on any length"""

    status: str
    """How sure its name is: `confirmed`, `suspected` or `not-confirmable`"""

    helps: bool
    """Whether held-out visits show that it helps, and none gets markedly worse; such effects are
    adopted unless the request names effects"""

    why_not: str | None
    """Why it is not known to help; null where it helps"""

    is_proxy: bool
    """Whether unexplained structure remains beside it"""

    doubts: tuple[str, ...]
    """How the measured values depart from it, beyond noise: its name is then not `confirmed`. Empty
    where they fit it"""

    evidence: Evidence
    """How strong the evidence for it is"""

    alternatives: tuple[Alternative, ...]
    """What else it could be, ties first"""

    explanation: str
    """One plain sentence"""

    strongest_visits: tuple[StrongVisit, ...]
    """The two visits that carry most of the evidence"""

    leverage: float
    """Their share of the evidence"""

    leverage_warning: str | None
    """A warning where two visits carry most of the evidence; else null"""

    measure_again: str | None
    """For an effect that grows with time: until when it may be used, and what to measure by then"""

    causes: tuple[Cause, ...] = ()
    """What can be said of its causes where many drive it together; empty for other effects"""

    @shown
    def kind(self) -> Annotated[str, Field(examples=["thermal-lag"])]:
        """Kind of effect."""
        return self.effect.kind

    @shown
    def variant(self) -> str:
        """Which form of the kind; empty where it has one only."""
        return self.effect.variant

    @shown
    def components(self) -> Codes:
        """Components that it acts on."""
        return self.effect.components

    @shown
    def sensors(self) -> Sensors:
        """Sensors that drive it."""
        return self.effect.sensors

    @shown
    def states(self) -> tuple[str, ...]:
        """States that drive it."""
        return self.effect.states

    @shown
    def parameters(self) -> Parameters:
        """Parameters; the unit ends each name [µm; …]."""
        return self.effect.parameters

    @shown
    def standard_errors(self) -> Mapping[str, float]:
        """One standard deviation of each parameter that was estimated [µm; …]."""
        return self.effect.standard_errors

    @shown
    def valid(self) -> LearntIn | None:
        """The ranges in which it was learnt; beyond them it is held at the edge."""
        return self.effect.learnt_in

    @property
    def doubt(self) -> str | None:
        """Why its name is not sure, in one sentence; None where nothing speaks against it."""
        if not self.doubts:
            return None
        return (
            f"the measured values do not quite fit this effect: {list_names(self.doubts)}; the "
            "cause may be another one that resembles it"
        )

    @property
    def ties(self) -> tuple[Alternative, ...]:
        """The alternatives that these observations cannot tell from it."""
        return tuple(a for a in self.alternatives if a.tied)


@dataclass(frozen=True, eq=False, slots=True)
class RefittedEffect(Answer, published_as="RefittedEffectAnswer"):
    """What adopting the effects that help does to an effect that the model already has."""

    effect: StoredEffect
    """The effect as the model has it"""

    becomes: StoredEffect | None
    """What adoption stores in its place; null where it is dropped or left as it is"""

    outcome: Literal["refitted", "dropped", "left"]
    """`refitted`: together with the found effects that help; `dropped`: no longer worth its place
    beside them; `left`: as it is"""

    is_changed: bool
    """Whether it is dropped, or its parameters change by more than their uncertainty"""

    explanation: str
    """What it was and what it becomes, or why it stays, in one plain sentence"""

    @shown
    def kind(self) -> Annotated[str, Field(examples=["thermal-lag"])]:
        """Kind of effect."""
        return self.effect.kind

    @shown
    def components(self) -> Codes:
        """Components that it acts on."""
        return self.effect.components

    @shown
    def parameters(self) -> Parameters:
        """Parameters as the model has them; the unit ends each name [µm; …]."""
        return self.effect.parameters

    @shown
    def refitted_parameters(self) -> Parameters | None:
        """Parameters after refitting [µm; …]; null where it is dropped or left."""
        return None if self.becomes is None else self.becomes.parameters

    @shown
    def refitted_standard_errors(self) -> Parameters | None:
        """One standard deviation of each [µm; …]; null where it is dropped or left."""
        return None if self.becomes is None else self.becomes.standard_errors


@dataclass(frozen=True, slots=True)
class TriedAssignment(Answer, published_as="TriedAssignmentAnswer"):
    """One component's maps read by a sensor other than the assigned one, on held-out set-ups."""

    component: Annotated[str, Field(examples=["EZZ"])]
    """Component code"""

    present_sensor: Annotated[str, Field(examples=["z-column"])]
    """Sensor that it follows now"""

    other_sensor: str | None
    """The other sensor that leaves least; null where nothing could be judged"""

    as_good: Sensors
    """Other sensors that leave nearly as little, within 5 %: the set-ups cannot tell them apart"""

    unit: UnitSymbol
    """Unit of its numbers"""

    at_points: bool
    """Whether figures are of points of the work volume, because it was not observed by itself"""

    setups: int
    """Number of set-ups in which it shows"""

    before_rms: Annotated[float, Field(alias="before_rms_um")]
    """Root mean square of the residuals with the present sensor, from each set-up's zero [µm]; see
    `unit`"""

    after_rms: Annotated[float | None, Field(alias="after_rms_um")]
    """The same with the other sensor; in each set-up the one that all other set-ups choose [µm];
    see `unit`"""

    worst_setup: str | None
    """Label of the set-up that gets most worse, or gains least"""

    worst_before_rms: Annotated[float | None, Field(alias="worst_before_rms_um")]
    """Its root mean square with the present sensor [µm]; see `unit`"""

    worst_after_rms: Annotated[float | None, Field(alias="worst_after_rms_um")]
    """Its root mean square with the other sensor [µm]; see `unit`"""

    p_global: float | None
    """Probability that some sensor on some component gains as evenly by chance"""

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
    """The smallest effect of one kind on one component that would have been seen."""

    kind: str
    """Kind of effect"""

    component: str
    """On which component"""

    unit: UnitSymbol
    """Unit of its numbers"""

    smallest_rms: Annotated[
        float, Field(description=f"Root mean square over the rows that it acts on {IN_ITS_UNIT}")
    ]


@dataclass(frozen=True, slots=True)
class EffectCurve(Answer):
    """An effect's residuals over what drives it: arrays of equal length, for some of the values.

    Where it acts on components of several units, only those of one unit are drawn: the one in which
    it explains most.
    """

    over: str
    """What drives it; `time` in seconds since 1970-01-01 UTC"""

    over_unit: str
    """Its unit"""

    unit: UnitSymbol
    """Unit of the residuals"""

    components: tuple[str, ...]
    """The component of each residual"""

    driver: tuple[float, ...]
    """What drives it [mm; K, s …], in `over_unit`"""

    before: tuple[float, ...]
    """Residuals with all other effects, but without this one [µm; …], in `unit`"""

    after: tuple[float, ...]
    """Residuals with all effects [µm; …], in `unit`"""

    explained: tuple[float, ...]
    """What this effect predicts [µm; …], in `unit`"""

    direction: tuple[float, ...]
    """Approach of its own axis: 1, -1, or 0 where it is not known"""


@dataclass(frozen=True, slots=True)
class VisitMeans(Answer):
    """Means by visit of one component: arrays of equal length."""

    component: str
    """Component code, or `points x`"""

    unit: UnitSymbol
    """Unit of the means"""

    at_points: bool
    """Whether the values are of points of the work volume"""

    time_s: tuple[float, ...]
    """Mean time of each [s], since 1970-01-01 UTC"""

    direction: tuple[float, ...]
    """Approach, 1 or -1, where an effect's error reverses with it: each visit then has two means;
    else 0"""

    count: tuple[int, ...]
    """Number of values in each mean"""

    before: tuple[float, ...]
    """Means before [µm; …], in `unit`"""

    after: tuple[float, ...]
    """Means with all effects [µm; …], in `unit`"""

    expected: tuple[float, ...] = ()
    """Expected standard deviation of each mean, from repeatability, set-up scatter and the maps'
    own uncertainty [µm; …], in `unit`; empty in older results"""


@dataclass(frozen=True, slots=True)
class Plots(Answer):
    """Arrays for the report's plots, at most some hundred points each."""

    effects: tuple[EffectCurve, ...]
    """One for each effect that residuals show, in the order of the effects"""

    visits: tuple[VisitMeans, ...]
    """One for each component"""


@dataclass(frozen=True, slots=True)
class PlannedPlace(Answer, published_as="PlannedPlaceAnswer"):
    """One observation to be made, in the form that planning takes."""

    time: str
    """Time, at a recorded moment with the wanted conditions, UTC"""

    component: str | None
    """Component code; null at a point"""

    position_mm: float | None
    """Position on its axis [mm]"""

    point_mm: tuple[float, float, float] | None
    """Nominal point x, y, z [mm]; null of a component"""

    tool_offset_mm: tuple[float, float, float]
    """Tool offset X, Y, Z [mm]"""

    direction: Mapping[str, Literal["+", "-"]] | None
    """Direction of approach of each axis"""


@dataclass(frozen=True, slots=True)
class PlannedVisit(Answer, published_as="PlannedVisitAnswer"):
    """A visit to be made, as one of the `planned` visits of a plan."""

    label: str
    """Its name in the plan"""

    datum: str
    """`absolute`, `first` or `free`, as in the visits before"""

    repeatability_um: float | None
    """Standard deviation of one length, where it is known [µm]"""

    observations: tuple[PlannedPlace, ...]
    """In the order of measurement"""


@dataclass(frozen=True, slots=True)
class NextVisit(Answer, published_as="NextVisitAnswer"):
    """The most informative visit to make next."""

    sentence: str
    """What to measure, when, and what for"""

    like_time: datetime
    """When the machine was last recorded in such conditions, UTC"""

    temperatures_c: Mapping[str, float]
    """The sensors' temperatures at that time [°C]"""

    states: Mapping[str, float]
    """The machine's state at that time"""

    planned: PlannedVisit
    """What to send to planning"""


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
    """Residuals with the effects as they would be adopted"""

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

    next_visit: NextVisit | None = None
    """The most informative visit to make next; null where none can be proposed"""

    assignments: tuple[TriedAssignment, ...] = ()
    """Whether each component should follow another sensor, proposals first; empty in older
    results"""

    @property
    def proposals(self) -> tuple[TriedAssignment, ...]:
        """The components that should follow another sensor."""
        return tuple(one for one in self.assignments if one.proposed_sensor is not None)

    @property
    def is_refit_due(self) -> bool:
        """Whether adopting changes effects that the model has already."""
        return any(one.is_changed for one in self.refitted)

    @property
    def overall_count(self) -> int:
        """How many values the figures over all components are of: lengths, or all without any."""
        lengths = [one.count for one in self.components if one.unit == Unit.UM.symbol]
        return sum(lengths or [one.count for one in self.components])


def by_reason(not_tested: Iterable[NotTested]) -> tuple[NotTested, ...]:
    """Name what one kind cannot show for the same reason together.

    Parameters
    ----------
    not_tested
        One by one, repeated or not.

    Examples
    --------
    >>> by_reason([NotTested("drift", "EXX", "few"), NotTested("drift", "EXY", "few")])
    (NotTested(kind='drift', on='EXX, EXY', reason='few'),)
    """
    together: dict[tuple[str, str], dict[str, None]] = defaultdict(dict)
    for one in not_tested:
        together[one.kind, one.reason] |= {one.on: None} if one.on else {}
    return tuple(
        NotTested(kind, list_names(names, MOST_SUBJECTS) if names else "", reason)
        for (kind, reason), names in together.items()
    )
