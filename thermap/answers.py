"""What the service answers with.

Written by `scripts/write_client.py` from the service's OpenAPI document.
"""

from typing import Any, Literal

from pydantic import AwareDatetime, Field

from thermap.shape import Shape
from thermap.table import CompensationTable, Components, TableEntry


class AccessKey(Shape):
    """One key as it is listed; the key itself is known to nobody but its holder."""

    id: int
    """Number of the key"""

    name: str
    """Whose it is: a person, a computer, a sensor"""

    role: Literal["sensor", "viewer", "metrologist", "admin"]
    """What it may do"""

    machines: list[str] | None
    """Ids of the machines that it is for; null for all, also those that are made later"""

    created_at: AwareDatetime
    """When it was made"""

    last_used_at: AwareDatetime | None
    """When it was used last, to the minute; null before its first use"""


class AnalysisHead(Shape):
    """An analysis as a job, without its result."""

    id: int
    """The analysis' number"""

    status: Literal["queued", "running", "done", "failed", "cancelled"]
    """`queued`, `running`, `done`, `failed` or `cancelled`"""

    progress: float
    """Share of the work that is done, from 0 to 1"""

    message: str
    """What is being done, or why it failed"""

    model_version: int
    """Version that is compared with the verifications"""

    verifications: list[int]
    """Numbers of the verifications"""

    holdout_fraction: float
    """Share of the visits held out"""

    effects: list[str] | None
    """Kinds that are looked for; null for all"""

    seed: int
    """Seed of all random draws"""

    created_at: AwareDatetime
    """When it was asked for, UTC"""

    started_at: AwareDatetime | None
    """When it began, UTC"""

    finished_at: AwareDatetime | None
    """When it ended, UTC"""

    adopted_version: int | None
    """Model version that was made from it; null as long as there is none"""


class AngularSpreadAnswer(Shape):
    """The same of angles."""

    ranges_urad: list[float]
    """Largest less smallest value about x, y, z (8.122–8.127) [µrad]"""

    definition_1_urad: float
    """Largest root of the sum of squares (8.119, 8.121) [µrad]"""

    definition_2_urad: float
    """Root of the sum of squares of the ranges (8.129) [µrad]"""

    worst_point_mm: list[float]
    """Where definition 1 has its largest [mm]"""


class BinAnswer(Shape):
    """Residuals that have something in common."""

    label: str
    """What they have in common"""

    low: float | None
    """Its lower end; null for a name [mm; °C, s …]"""

    high: float | None
    """Its upper end; null for a name [mm; °C, s …]"""

    count: int
    """How many values"""

    mean: float
    """Mean [µm; angular components µrad, squareness µm/m]"""

    rms: float
    """Root mean square [µm; angular components µrad, squareness µm/m]"""

    p95: float
    """95th percentile of the size [µm; angular components µrad, squareness µm/m]"""

    share_above_repeatability: float | None
    """Share that exceeds the repeatability in size, and that of a zero that was measured too; noise
    alone: 0.32
    """


class CauseAnswer(Shape):
    """How much a kind of drivers moves a component, of many that drive it together."""

    names: list[str]
    """Sensors and states that it is about; empty where it is about all or none"""

    sentence: str
    """One plain sentence"""


class CheckAnswer(Shape):
    """One move that shows whether the sign is right."""

    component: str
    """ISO 230-1 code"""

    axis: str
    """Axis that is moved"""

    position_mm: float
    """Where to [mm]"""

    direction: str
    """Coming in which direction, `+` or `-`"""

    moved_axis: str
    """Axis that then stands elsewhere than before"""

    expected_movement_um: float
    """By how much, + in that axis' direction [µm]"""


class CheckMark(Shape):
    """A verification over time."""

    verification: int
    """Number of the verification"""

    label: str
    """Its label"""

    time: AwareDatetime
    """When its last observation was made"""

    status: str
    """`within`, `beyond` or `not-judged`: what the watch said of it"""

    summary: str
    """The same in words"""

    left_um: float | None
    """What the active version leaves of its lengths, root mean square [µm]; null where it was not
    asked for, or `why_not`
    """

    why_not: str
    """Why nothing can be said of that"""


class ComparedComponentAnswer(Shape):
    """How far a component in the files is from what should be there."""

    component: str
    """ISO 230-1 code"""

    state: Literal["both", "missing", "unknown"]
    """`both`; `missing`: the files lack it, which counts as 0; `unknown`: the files hold it, and
    the model has nothing of it
    """

    largest: float
    """Largest difference of the errors: in the files minus as they should be, in `unit`"""

    rms: float
    """Root mean square of the difference along the axis, in `unit`"""

    unit: str
    """Unit of both"""

    position_mm: float | None
    """Where it is largest [mm]"""

    direction: str
    """In which direction of approach, `+` or `-`"""


class ComparisonAnswer(Shape):
    """What the part says against what the model says."""

    predicted_um: list[float]
    """The model's error at each position [µm]"""

    bias_um: float
    """Mean of measured minus predicted [µm]"""

    slope_difference_um_per_m: float
    """Slope of measured minus predicted [µm/m]"""

    rms_difference_um: float
    """Root mean square of measured minus predicted, as both came [µm]"""

    rms_without_line_um: float
    """The same without the reference line of both [µm]"""

    r: float | None
    """Correlation of both without their lines"""

    confidence_95: list[float] | None
    """Its 95 % confidence interval"""

    model_version: int
    """Version of the model"""


class CompensationCourse(Shape):
    """The compensation at one place over time, as one model version has it."""

    component: str
    """Code of the component"""

    position_mm: float | None
    """Position along its axis [mm], null for a component without positions"""

    unit: str
    """Unit of the values"""

    model_version: int | None
    """The version by which all of it is computed: the active one; null where there is none"""

    after_s: list[float]
    """Times after `since`: the middles of bins, whose mean temperatures it is computed of [s]"""

    values: list[float | None]
    """Minus the error, in `unit`; null where it cannot be computed"""

    warnings: list[str]
    """What is not in it, and why"""


class ComponentAnswer(TableEntry):
    """One component of a stored map: the fields that it has, and no others."""

    component: str
    """ISO 230-1 code (EXX, SXY, EYY^x) or the chapter's notation (D_x(x), S_xy)"""

    positions_mm: list[float] | None = None
    """Positions on the component's axis [mm], strictly increasing"""

    errors_um: list[float] | None = None
    """Actual minus nominal: linear displacement, straightness [µm]"""

    errors_urad: list[float] | None = None
    """Actual minus nominal: angular [µrad]"""

    value_um_per_m: float | None = None
    """Actual minus nominal: squareness [µm/m]"""

    slopes_um_per_m: list[float] | None = None
    """Actual minus nominal: nonrigid slope [µm/m]"""

    slopes_urad_per_m: list[float] | None = None
    """Actual minus nominal: nonrigid slope [µrad/m]"""

    value_um: float | None = None
    """Actual minus nominal: rotary-axis location [µm]"""

    value_urad: float | None = None
    """Actual minus nominal: rotary-axis location [µrad]"""

    backward_errors_um: list[float] | None = None
    """Approached in the negative direction: linear displacement, straightness [µm]"""

    backward_errors_urad: list[float] | None = None
    """Approached in the negative direction: angular [µrad]"""

    backward_slopes_um_per_m: list[float] | None = None
    """Approached in the negative direction: nonrigid slope [µm/m]"""

    backward_slopes_urad_per_m: list[float] | None = None
    """Approached in the negative direction: nonrigid slope [µrad/m]"""

    standard_errors_um: list[float] | None = None
    """One standard deviation: linear displacement, straightness [µm]"""

    standard_errors_urad: list[float] | None = None
    """One standard deviation: angular [µrad]"""

    standard_error_um_per_m: float | None = None
    """One standard deviation: squareness [µm/m]"""

    standard_errors_um_per_m: list[float] | None = None
    """One standard deviation: nonrigid slope [µm/m]"""

    standard_errors_urad_per_m: list[float] | None = None
    """One standard deviation: nonrigid slope [µrad/m]"""

    standard_error_um: float | None = None
    """One standard deviation: rotary-axis location [µm]"""

    standard_error_urad: float | None = None
    """One standard deviation: rotary-axis location [µrad]"""

    backward_standard_errors_um: list[float] | None = None
    """Of the backward errors: linear displacement, straightness [µm]"""

    backward_standard_errors_urad: list[float] | None = None
    """Of the backward errors: angular [µrad]"""

    backward_standard_errors_um_per_m: list[float] | None = None
    """Of the backward errors: nonrigid slope [µm/m]"""

    backward_standard_errors_urad_per_m: list[float] | None = None
    """Of the backward errors: nonrigid slope [µrad/m]"""

    covariance: list[list[float]] | None = None
    """Covariance of the errors [square of the errors' unit]: instead of standard errors or beside
    them, where the errors are not independent of each other
    """

    backward_covariance: list[list[float]] | None = None
    """Covariance of the backward errors [square of the errors' unit]"""

    chapter: str | None = None
    """The chapter's notation"""

    iso: str | None = None
    """ISO 230-1 name of a squareness"""

    iso_value_urad: float | None = None
    """Its value in ISO's sign [µrad]"""


class ComponentChangeAnswer(Shape):
    """The largest change of one component's error."""

    component: str
    """Component code"""

    chapter: str
    """The chapter's notation"""

    change: float
    """Error afterwards minus error before, in `unit`"""

    unit: str
    """Unit of the change"""

    position_mm: float | None = None
    """Where [mm]; null without positions"""

    direction: Literal["+", "-"]
    """Direction of approach in which it is so"""

    status_before: str
    """How it comes about now"""

    status_after: str
    """How it would come about"""


class ComponentFiguresAnswer(Shape):
    """One component, or one direction at points, before and after, in its own unit."""

    component: str
    """Component code, or `points x`"""

    unit: str
    """Its unit"""

    count: int
    """Values that took part"""

    before_rms: float
    """Root mean square before [µm; angular components µrad, squareness µm/m]"""

    after_rms: float
    """Root mean square after [µm; angular components µrad, squareness µm/m]"""

    before_p95: float
    """95th percentile of the size before [µm; angular components µrad, squareness µm/m]"""

    after_p95: float
    """95th percentile of the size after [µm; angular components µrad, squareness µm/m]"""

    holdout_before_rms: float | None
    """Root mean square before, on held-out visits [µm; angular components µrad, squareness µm/m]
    """

    holdout_after_rms: float | None
    """Root mean square after, on held-out visits [µm; angular components µrad, squareness µm/m]
    """

    noise: float
    """Standard deviation of one observation [µm; angular components µrad, squareness µm/m]"""

    noise_origin: str
    """`declared`, `common` (what nearly all lengths show, where that contradicts what is declared),
    `replicates`, `residuals` or `rounding`
    """

    floor: float | None
    """What noise alone would leave, judged by repeats within two minutes and the scatter of set-ups
    [µm; angular components µrad, squareness µm/m]; null where too little was repeated
    """

    floor_unknown: str | None
    """Why there is no floor; null where there is one"""

    setup_scatter: float | None
    """Standard deviation between set-ups, as fitted to these residuals [µm; angular components
    µrad, squareness µm/m]; null where nothing could be held out
    """

    zero: Literal["absolute", "first", "removed"] | None
    """What its figures are relative to; see the overall figures"""

    before_max: float | None
    """Largest size before, on held-out visits where there are any [µm; angular components µrad,
    squareness µm/m]; null in older results
    """

    after_max: float | None
    """Largest size after, on held-out visits where there are any [µm; angular components µrad,
    squareness µm/m]; null in older results
    """


class Connection(Shape):
    """A connection and how it fares."""

    name: str
    """Its name in the file"""

    kind: str
    """`mtconnect`, `opcua` or `mqtt`"""

    machines: list[str]
    """Ids of the machines whose sensors it reads; where topics name them, of those heard so far
    """

    endpoint: str
    """Where it reads"""

    connected: bool
    """Whether there is contact now"""

    last_value_at: AwareDatetime | None
    """When the last value came, null before the first"""

    known: int
    """How many of its sensors and states have a value now"""

    trouble: str
    """What is the matter, empty where nothing"""

    lost: int
    """Observations that were gone before they could be read, as far as the sender tells"""

    taken: int
    """Messages whose values were stored since the service began; one may say of several sensors
    """

    dropped: int
    """Messages whose values were dropped, as too many waited for the database"""

    refused: int
    """Messages or values that were refused"""


class ConnectionsNow(Shape):
    """All connections, and what became of what they read."""

    connections: list[Connection]
    """The connections, kind by kind in the order of the file"""

    stored: int
    """Readings that were stored since the service began"""

    dropped: int
    """Readings that were dropped, the oldest first, as too many waited for the database"""

    refused: int
    """Values or readings that were refused"""

    last_refusal: str
    """The last of these, and why; empty without any"""

    wrong_clocks: int
    """Values with a time of their sender that was more than 5 s off the service's clock"""

    machines_with_wrong_clocks: list[str]
    """Machines of whose senders one stated such a time within the last minute"""


class CoverageAnswer(Shape):
    """One thing that one version's table has and another's lacks."""

    what: Literal["component", "positions", "temperatures", "direction", "completeness"]
    """`component`, `positions`, `temperatures` (between maps), `direction` (the two directions of
    approach) or `completeness`
    """

    text: str
    """The same in words"""

    component: str | None = None
    """Component code; null where it concerns no single one"""

    from_mm: float | None = None
    """Lowest position [mm]; null for an open end, and without positions"""

    to_mm: float | None = None
    """Highest position [mm]"""

    sensor: str | None = None
    """Sensor whose temperatures bound it; null where it holds at all of them"""

    from_c: float | None = None
    """Lowest temperature of that sensor [°C]; null for an open end"""

    to_c: float | None = None
    """Highest temperature [°C]"""


class DriftStateAnswer(Components):
    """One thermal state of the test: changes since its first reading, at their temperatures."""

    label: str | None
    """The map's name"""

    after_min: float
    """Time after the first reading [min]"""

    time: AwareDatetime
    """When it was, UTC"""

    temperatures_c: dict[str, float]
    """The sensors at that time, interpolated between readings [°C]"""

    components: list[ComponentAnswer]
    """Changes of the components since the first reading"""

    map_id: int | None
    """The number of the map that was made of it"""


class DriftVerificationAnswer(Shape):
    """The course of the test as a verification."""

    id: int
    """The verification's number"""

    observations: int
    """How many observations it has"""

    components: list[str]
    """What was observed: component codes, and `points`"""

    is_new: bool
    """False where the same verification was there already"""

    stored_readings: int
    """Readings of temperatures that are new"""


class EffectCurve(Shape):
    """
    An effect's residuals over what drives it: arrays of equal length, for some of the values.

    Where it acts on components of several units, only those of one unit are drawn: the one in which
    it explains most.
    """

    over: str
    """What drives it; `time` in seconds since 1970-01-01 UTC"""

    over_unit: str
    """Its unit"""

    unit: str
    """Unit of the residuals"""

    components: list[str]
    """The component of each residual"""

    driver: list[float]
    """What drives it [mm; K, s …], in `over_unit`"""

    before: list[float]
    """Residuals with all other effects, but without this one [µm; …], in `unit`"""

    after: list[float]
    """Residuals with all effects [µm; …], in `unit`"""

    explained: list[float]
    """What this effect predicts [µm; …], in `unit`"""

    direction: list[float]
    """Approach of its own axis: 1, -1, or 0 where it is not known"""


class Event(Shape):
    """One event."""

    id: int
    """Number of the event"""

    time: AwareDatetime
    """When it happened; of an alarm, when it came first"""

    kind: Literal[
        "machine",
        "model",
        "readings",
        "verification",
        "watch",
        "analysis",
        "alarm",
        "sensor",
        "key",
    ]
    """`machine`, `model`, `readings`, `verification`, `watch`, `analysis` and `key` are changes;
    `alarm` is a verdict other than trusted, `sensor` a sensor that has failed
    """

    who: str
    """Who asked for it: the name of a key, or an address and its program; `service` where nobody
    did
    """

    machine: str | None
    """Id of the machine, null where it is about none"""

    text: str
    """What happened, in words"""

    details: dict[str, Any]
    """The same in fields: `version`, `from` and `to`, `state`, `sensor` with `health`, …"""

    until: AwareDatetime | None
    """When an alarm or a sensor's failure went, null while it lasts, and for changes"""

    count: int
    """How often it came within ten minutes of going; 1 for changes"""

    text_now: str | None
    """What an alarm or a sensor's failure says now, where it began in other words: figures change
    while it lasts. Null once it went, for changes, and in streams
    """


class Events(Shape):
    """Events, the newest first."""

    events: list[Event]
    """The events"""

    next: str | None
    """What to state as `before` for those before them, null where there are none"""


class EvidenceAnswer(Shape):
    """How sure an effect is; numbers without a unit, null where the readings alone show it."""

    likelihood_ratio: float | None
    """Twice the rise of the log likelihood"""

    degrees_of_freedom: int | None
    """Numbers that were fitted for it"""

    two_ln_bayes_factor: float | None
    """Evidence for it against no effect, 2 ln of the Bayes factor, with the prior spread evenly
    within its kind; above 10 it is very strong
    """

    p_global: float | None
    """Probability that noise alone gives as strong a candidate anywhere in the library"""

    calibration_slope: float | None
    """Slope of measured against predicted contribution on held-out visits: 1 if they show all of
    it, 0 if nothing; null where it was never found without them
    """

    calibration_slope_error: float | None
    """Standard error of that slope"""

    forward_slope: float | None
    """The same slope on the last visits, predicted from the earlier ones, for trends"""

    found_again_share: float | None
    """Share of the hold-out splits in which it, or what it is tied with, is found again"""

    seen_in_readings: str | None
    """What the readings alone show of it; null where they do not show it"""


class ExcludedAnswer(Shape):
    """Values that took no part, with the reason."""

    reason: str
    """Why"""

    count: int
    """How many values"""


class ExportedFileAnswer(Shape):
    """One file of an export."""

    name: str
    """Name, with its band's folder"""

    content: str
    """Its text"""

    role: Literal["table", "settings", "check"]
    """`table`, `settings` that go into the controller's own, or `check`: what to look at after
    loading
    """

    axis: str | None
    """Axis whose own file it is"""


class FarValueAnswer(Shape):
    """A value, or a component's values of one visit, left out because far from the others."""

    component: str
    """Component code, or direction at points"""

    label: str
    """Label of the verification"""

    time: AwareDatetime
    """When it was measured; of a visit, when that began, UTC"""

    position_mm: float | None
    """Position on its axis [mm]; null at points, of squareness and of a visit"""

    point_mm: list[Any] | None
    """Nominal point x, y, z [mm]; null elsewhere"""

    count: int
    """How many values: 1, or all of the component in a visit that is far from all other visits
    """

    off_um: float
    """How far from what the others say [µm; angular components µrad, squareness µm/m]"""

    unit: str
    """The unit of that number"""

    is_alike: bool
    """Whether others of the component are off by the same, in several visits, as slips hardly are:
    something comes and goes that nobody logs
    """


class FiguresAnswer(Shape):
    """Size of residuals over all lengths, or over all values where none is a length."""

    rms_um: float
    """Root mean square of all visits together [µm]"""

    p95_um: float
    """95th percentile of the size [µm]"""

    holdout_rms_um: float | None
    """Root mean square on held-out visits: each is predicted by what was learnt without it [µm];
    null where nothing could be held out
    """

    holdout_rms_ci95_um: list[float] | None
    """Its 95 % confidence interval, over visits [µm]; null where fewer than two were held out"""

    zero: Literal["absolute", "first", "removed"] | None
    """What they are relative to. `absolute`: the model's zero. `first`: the first observation of
    each set-up, at which the instrument was zeroed. `removed`: the zero is not known, and the mean
    of the values that share it is taken off. Null in older results
    """


class FleetMachine(Shape):
    """One machine of the fleet."""

    machine: str
    """Its id"""

    name: str
    """Its name for people"""

    sisters: list[str]
    """Machines that state the same configuration, travels and sensors"""

    watch: str | None
    """`within` or `beyond` its limits, by the latest verifications; null where none was judged
    """

    drifts: str | None
    """Why it no longer agrees with its model; null where there is no sign of that"""

    analysis: int | None
    """Number of its analysis; null where there is none"""

    verdict: Literal["effects-found", "nothing-found", "unexplained", "not-judged"] | None
    """Its verdict; null where there is no result"""

    why_not: str | None
    """Why it was not judged; null where it was"""

    unit: str | None
    """Unit of the figures"""

    before_rms_um: float | None
    """Root mean square of residuals, on held-out visits where there are any [µm]; see `unit`"""

    after_rms_um: float | None
    """The same with the effects that were found [µm]; see `unit`"""

    found: list[str]
    """What was found, one sentence each"""


class FleetMemberAnswer(Shape):
    """How far one machine's analysis is."""

    machine: str
    """Its id"""

    name: str
    """Its name for people"""

    analysis: AnalysisHead | None
    """The analysis that asked this of the active model and all stored verifications; null where
    there is none
    """

    why_not: str | None
    """Why none can be asked for; null where one can"""

    to_be_asked: bool
    """Whether none was asked for, or the last one failed or was cancelled"""


class FollowedNumber(Shape):
    """One number that is followed from visit to visit."""

    component: str
    """Component code, or `points x`"""

    what: str
    """`level`, or a slope along an axis"""

    unit: str
    """Unit of its deviation"""

    deviation: float
    """Latest measured minus predicted [µm; angular components µrad, squareness µm/m]"""

    expected_sd: float
    """Standard deviation that was expected of it [µm; angular components µrad, squareness µm/m]
    """

    evidence: float
    """Evidence that it has changed, as an e-value"""


class FollowsAnswer(Shape):
    """A sensor by whose temperature a component's maps are read."""

    sensor: str
    """Sensor"""

    temperature_c: float
    """Its temperature [°C], at the edge of where the effect was learnt if beyond"""

    share: float
    """Share of that in the numbers; all sum to 1. Beyond where the effect was learnt, what it makes
    of the maps is held at the edge and the assigned sensor goes on: of a share of 0.9975 there are
    then 0.9975 of the other sensor at the edge, 1 of the assigned one now, and -0.9975 of the
    assigned one at the edge
    """


class FoundOn(Shape):
    """One machine on which an effect was found by its own analysis."""

    machine: str
    """The machine"""

    analysis: int
    """The analysis that found it"""

    effect: int
    """Which of its effects, from 0"""

    status: str
    """How sure its name is there: `confirmed`, `suspected` or `not-confirmable`"""

    helps: bool
    """Whether held-out visits of that machine show that it helps"""

    parameters: dict[str, float]
    """Its parameters there; the unit ends each name"""

    standard_errors: dict[str, float]
    """One standard deviation of each"""


class HealthAnswer(Shape):
    """The process lives."""

    status: str
    """`ok`"""

    version: str
    """Version of thermap"""


class JudgedVerification(Shape):
    """One verification of the sequence."""

    verification: int
    """Number of the verification"""

    label: str
    """Its name"""

    last_at: AwareDatetime
    """Time of its last observation, UTC"""

    status: str
    """`within`, `beyond` or `not-judged`"""

    evidence: float | None
    """Evidence from all verifications up to it, as an e-value"""


class JudgementAnswer(Shape):
    """
    What a verification says of the model that was active when it was judged.

    That is when it came; or, where it had no readings then, once these are there.
    """

    model_version: int | None
    """That version; null where there was none"""

    status: Literal["within", "beyond", "not-judged"]
    """`within` or `beyond` the limits of a sequential test over this and all earlier verifications;
    `not-judged`, with the reason in `summary`
    """

    evidence: float | None
    """Evidence from all verifications so far, as an e-value"""

    limit: float | None
    """Evidence that an unchanged machine ever reaches only with probability `false_alarm`"""

    false_alarm: float | None
    """Probability that an unchanged machine is ever called changed"""

    summary: str
    """In plain sentences"""

    beyond: list[FollowedNumber]
    """What has changed since the model was made, the clearest first"""

    visits: int
    """Number of visits in the verification that were looked at"""

    awaits_readings: bool
    """Whether it was stored before its readings, and is judged once they are there"""


class LargestValue(Shape):
    """The largest of a component's values, with its sign and its place."""

    component: str
    """Code of the component"""

    value: float
    """Value with its sign, in `unit`"""

    unit: str
    """Unit of the value"""

    axis: str | None
    """Axis of the position, null for a component without positions"""

    position_mm: float | None
    """Where it is [mm], null for a component without positions"""

    is_backward: bool
    """Whether it is that of the backward approach, where both directions have maps"""


class LastCheck(Shape):
    """
    By how much verifications of the active model were off, and what was expected.

    Of each component its latest visit counts; this is the one that was furthest from what was
    expected. What is null is not known: nothing tells the scatter of these measurements, or an
    earlier version of the service judged them.
    """

    time: AwareDatetime
    """When it was measured: its last observation"""

    text: str
    """The same in words"""

    component: str | None
    """Code of the component, or `points x`"""

    count: int | None
    """How many values of it"""

    off: float | None
    """Their root mean square, measured minus predicted; of one value its size, in `unit`"""

    scatter: float | None
    """Standard deviation of one observation, the maps' uncertainty included, in `unit`"""

    setup_scatter: float | None
    """Standard deviation that set-ups add, as earlier visits show it, in `unit`; 0 while there are
    too few
    """

    at_most: float | None
    """What `off` was expected not to exceed, in `unit`: twice the scatter of a value, and more
    where few values of many components are looked at
    """

    unit: str | None
    """Unit of these"""

    as_expected: bool | None
    """Whether it was off by no more than that"""


class LevelTable(Shape):
    """One table of a controller."""

    component: str
    """ISO 230-1 code"""

    chapter: str
    """The chapter's notation"""

    axis: str
    """Axis of the positions"""

    positions_mm: list[float]
    """Positions on the axis [mm]"""

    errors_um: list[float] | None = None
    """Errors, squareness folded in where the level says so [µm]"""

    errors_urad: list[float] | None = None
    """Angular errors [µrad]"""

    slopes_um_per_m: list[float] | None = None
    """Nonrigid slopes [µm/m]"""

    slopes_urad_per_m: list[float] | None = None
    """Nonrigid slopes [µrad/m]"""

    compensation_um: list[float] | None = None
    """Minus the error [µm]"""

    compensation_urad: list[float] | None = None
    """Minus the error [µrad]"""

    compensation_um_per_m: list[float] | None = None
    """Minus the slope [µm/m]"""

    compensation_urad_per_m: list[float] | None = None
    """Minus the slope [µrad/m]"""


class LinesAnswer(Shape):
    """Volumetric accuracy from lines (Table 8.2)."""

    ELv_um: float
    """From displacements alone [µm]"""

    ELSv_um: float
    """From displacements and straightness [µm]"""

    ratio: float | None
    """ELSv/ELv, the chapter's M1; null where ELv is 0"""


class MachineStateAnswer(Shape):
    """A thermal state, as it is reached and recognised in the shop."""

    name: Literal["cold", "part-warm", "warm", "while-warming", "while-cooling"]
    """`cold`, `part-warm` or `warm`: the temperatures hardly change; `while-warming`, `while-
    cooling`: measured again and again while they do
    """

    conditions: str
    """Temperatures and states by which it is recognised, rounded to what can be set"""

    target_c: dict[str, float]
    """The temperatures in it, of the sensors that matter, in whole or half kelvins [°C]"""

    reached: str
    """How to reach it"""

    wait: str
    """How long to wait before the first reading"""

    wait_min: float | None
    """The same [min]; null where it is not known"""

    rounds: int
    """How often the points are measured"""

    every_min: float | None
    """From the beginning of a round to the next [min]; null for one round"""


class MeasuringLineSchema(Shape):
    """A measuring line on which a tool offset stood."""

    point_mm: list[float]
    """A point x, y, z of the line [mm]"""

    tool_offset_mm: list[float]
    """Tool offset with which it was measured [mm]"""


class ModelCoverageAnswer(Shape):
    """Which components the tables of a version have."""

    model_version: int
    """Number of the version"""

    components: list[str]
    """Components of its tables"""

    omitted: dict[str, str]
    """Component of its maps that no table has, to the reason"""


class ModelMap(Shape):
    """One of the maps that a version is made of."""

    id: int
    """The map's number"""

    label: str
    """The map's name"""

    temperatures_c: dict[str, float]
    """Its sensors' temperatures [°C]"""


class NeededComponent(Shape):
    """One error that the volumetric error of the machine consists of."""

    component: str
    """ISO 230-1 code"""

    chapter: str
    """The chapter's notation"""

    kind: str
    """Its group"""

    unit: str
    """Unit of its values"""

    in_model: bool
    """Whether the active model's maps have it"""


class NewAccessKey(Shape):
    """A key that was just made, with the key itself: it is shown this once."""

    key: AccessKey
    """The key as it is listed from now on"""

    secret: str
    """What its holder states as `Authorization: Bearer …`; it is stored nowhere"""


class NotAdopted(Shape):
    """Effects that the latest analysis of the active model confirmed, and that nobody adopted."""

    analysis: int
    """Number of the analysis"""

    effects: list[str]
    """Each in one sentence"""

    needs_analysis: bool
    """Whether the active version has other effects of the analysis: then a new one is needed to
    adopt these
    """


class NotHeldAnswer(Shape):
    """What the controller does not hold."""

    component: str
    """ISO 230-1 code"""

    largest: float
    """Largest displacement that it makes in the work volume at these temperatures, in `unit`; of a
    tilt of a rotary axis the angle
    """

    why: str
    """Why not"""

    unit: str
    """Its unit"""


class NotTestedAnswer(Shape):
    """Something that these observations cannot show."""

    kind: str
    """Kind of effect"""

    on: str
    """What it would act on or be driven by; empty for the kind as a whole"""

    reason: str
    """Why"""


class OptionAnswer(Shape):
    """One option of a format."""

    name: str
    """Name"""

    description: str
    """What it says"""

    required: bool
    """Whether it has to be stated"""

    default: Any
    """What holds where it is not stated; null where nothing does"""

    takes: Literal["choice", "number", "whole-number", "text", "components"]
    """What its value is; with `axes` what each axis' value is"""

    axes: list[str]
    """Axes of which it has one value each, as an object; empty where it has one"""

    unit: str | None
    """Unit of its value; null where it has none"""

    choices: list[Any]
    """What it may be; of `components` any number of them, empty where it is free"""

    minimum: float | None
    """Least value that it may have, in `unit`"""

    above: float | None
    """Its value is larger than this, in `unit`"""

    maximum: float | None
    """Greatest value that it may have, in `unit`"""


class ParsedComponentAnswer(Shape):
    """What files hold of one component."""

    component: str
    """ISO 230-1 code"""

    axis: str | None
    """Axis of the positions, null for a single value"""

    unit: str
    """Unit of the values"""

    positions_mm: list[float] | None
    """Positions [mm]; null for a single value"""

    errors: list[float]
    """Errors, actual minus nominal, in `unit`"""

    compensation: list[float]
    """Minus the errors, in `unit`"""

    backward_errors: list[float] | None
    """Errors in the negative direction where they differ, in `unit`"""

    backward_compensation: list[float] | None
    """Minus these, in `unit`"""

    endless: bool
    """Whether the values are a straight line that goes on beyond the positions; else the end values
    hold
    """


class PathErrorsAnswer(Shape):
    """How far the ball was beside the spindle that follows it, point by point."""

    before_um: list[list[float]]
    """Following the nominal axis: x, y, z, measured minus followed place [µm]"""

    after_position_um: list[list[float]]
    """Following an axis of nominal direction through the actual axis' place at the ball: its two
    position errors compensated [µm]
    """

    after_all_um: list[list[float]]
    """Following the axis that was found: all its errors compensated [µm]. At the points that showed
    them; at others it may be more
    """


class PlannedObservation(Shape):
    """What is to be measured: of one component, or at a point of the work volume."""

    time: AwareDatetime
    """When, with a zone"""

    component: str | None = None
    """Component"""

    position_mm: float | None = None
    """Position on its axis [mm]"""

    direction: Literal["+", "-"] | dict[Literal["x", "y", "z"], Literal["+", "-"]] | None = None
    """Direction of approach, or of each axis at a point; the mean of both where it is not stated
    """

    point_mm: list[float] | None = None
    """Nominal point x, y, z [mm]"""

    tool_offset_mm: list[float] = [0.0, 0.0, 0.0]
    """Tool offset X, Y, Z [mm]"""

    state: dict[str, float] = {}
    """Any numbers that the shop knows of the machine's state"""

    setup: str | None = None
    """Set-up within the verification, any text: observations with one share its zero and its tilt;
    without any the verification is one set-up
    """


class PlannedPlaceAnswer(Shape):
    """One observation to be made, in the form that planning takes."""

    time: str
    """Time, at a recorded moment with the wanted conditions, UTC"""

    component: str | None
    """Component code; null at a point"""

    position_mm: float | None
    """Position on its axis [mm]"""

    point_mm: list[Any] | None
    """Nominal point x, y, z [mm]; null of a component"""

    tool_offset_mm: list[Any]
    """Tool offset X, Y, Z [mm]"""

    direction: dict[str, Literal["+", "-"]] | None
    """Direction of approach of each axis"""


class PlannedVerification(Shape):
    """Observations that are to be taken with one set-up."""

    label: str = "planned"
    """Its name in the answer"""

    datum: Literal["absolute", "first", "free"] = "absolute"
    """`absolute`, `first` or `free`"""

    repeatability_um: float | None = None
    """Standard deviation of one length [µm], where it is known; it does not apply to angles and
    squareness
    """

    observations: list[PlannedObservation]
    """What is to be measured"""


class PlannedVisitAnswer(Shape):
    """A visit to be made, as one of the `planned` visits of a plan."""

    label: str
    """Its name in the plan"""

    datum: str
    """`absolute`, `first` or `free`, as in the visits before"""

    repeatability_um: float | None
    """Standard deviation of one length, where it is known [µm]"""

    observations: list[PlannedPlaceAnswer]
    """In the order of measurement"""


class PredictionAnswer(Shape):
    """What the model says."""

    model_version: int
    """Version that was asked"""

    predicted_um: list[float | list[float] | None]
    """For each observation its error [µm; angular errors µrad, squareness µm/m], three numbers x,
    y, z for a point, null where its status says why there is none
    """

    status: list[str]
    """For each observation `interpolated`, `at-map`, `clamped`, `extrapolated`, `stand-in`, or `no-
    reading`, `outside-maps`; `effects-only` where no two maps have the component; `held` where an
    adopted effect lies outside where it was learnt and is held at the edge of that; `effect-
    missing` where one lacks what drives it and is not in the value (the warnings say which and why)
    """

    counted_as_zero: list[str]
    """Components that points need, that no two maps have and that count as zero"""

    warnings: list[str]
    """What is not as it should be, in sentences"""


class PresetAnswer(Shape):
    """A kind of machine that is not rigid (C. Wang, 8.19–8.54)."""

    name: str
    """How it is asked for"""

    configuration: str
    """The chain that the source gives it"""

    equations: str
    """Where it is printed"""

    reason: str
    """What bends it"""

    slopes: list[str]
    """The nonrigid slopes that are not negligible on it"""


class ReadingSchema(Shape):
    """Live temperatures and the machine's state at one time."""

    time: AwareDatetime
    """When, UTC"""

    temperatures_c: dict[str, float]
    """Temperatures by sensor [°C]"""

    state: dict[str, float] = {}
    """Any numbers that the shop knows of the machine's state"""


class ReadyAnswer(Shape):
    """Whether the database is there and the models are in memory."""

    database: str
    """`ok`, or what is the matter"""

    machines: int
    """Machines in the database"""

    machines_in_memory: int
    """Machines whose model is in memory"""

    disk_free_bytes: int | None = None
    """Free on the disk of the database's file [bytes]; null where that is not known, as on
    PostgreSQL
    """

    status: str
    """`ready` or `not-ready`"""


class Receiver(Shape):
    """Somebody who is told of alarms, and how that went."""

    name: str
    """Its name in the file"""

    service: str
    """What carries the messages, such as E-Mail"""

    machines: list[str]
    """Ids of the machines that it is told of; empty for all"""

    trouble: str
    """Why it is not told what it should be told, empty where nothing is the matter"""

    trouble_since: AwareDatetime | None
    """Since when, null without trouble"""

    waiting: list[str]
    """Ids of machines of which the next message will tell"""

    sent_at: AwareDatetime | None
    """When the last message was sent, null before the first"""

    sent: str
    """Its title"""

    test_asked_at: AwareDatetime | None
    """When somebody last asked for a test message, null where nobody did"""

    tested_at: AwareDatetime | None
    """When the last test message was tried"""

    test_failure: str
    """Why that could not be sent, empty where it was"""


class Receivers(Shape):
    """Everybody who is told of alarms."""

    receivers: list[Receiver]
    """By name"""


class RefittedEffectAnswer(Shape):
    """What adopting the effects that help does to an effect that the model already has."""

    effect: dict[str, Any]
    """The effect as the model has it"""

    becomes: dict[str, Any] | None
    """What adoption stores in its place; null where it is dropped or left as it is"""

    outcome: Literal["refitted", "dropped", "left"]
    """`refitted`: together with the found effects that help; `dropped`: no longer worth its place
    beside them; `left`: as it is
    """

    is_changed: bool
    """Whether it is dropped, or its parameters change by more than their uncertainty"""

    explanation: str
    """What it was and what it becomes, or why it stays, in one plain sentence"""

    kind: str
    """Kind of effect"""

    components: list[str]
    """Components that it acts on"""

    parameters: dict[str, float]
    """Parameters as the model has them; the unit ends each name [µm; …]"""

    refitted_parameters: dict[str, float] | None
    """Parameters after refitting [µm; …]; null where it is dropped or left"""

    refitted_standard_errors: dict[str, float] | None
    """One standard deviation of each [µm; …]; null where it is dropped or left"""


class ResamplingAnswer(Shape):
    """What spacing and rounding add to a component."""

    component: str
    """ISO 230-1 code"""

    largest_deviation: float
    """Largest difference of the controller's curve from the table anywhere, in `unit`"""

    position_mm: float | None
    """Where [mm]; null for a single value"""

    unit: str
    """Its unit"""


class ResidualRow(Shape):
    """One measured number, compared with the model."""

    verification: int
    """Number of the verification"""

    observation: int
    """Place of the observation in it, from 0"""

    time: AwareDatetime
    """When, UTC"""

    component: str
    """Component code, or `points x`"""

    unit: str
    """Unit of its numbers"""

    x_mm: float | None
    """Where, as far as it is known [mm]"""

    y_mm: float | None
    """The same [mm]"""

    z_mm: float | None
    """The same [mm]"""

    direction: str
    """Approach: `+`, `-`, or `0` where not stated; at points of x, y and z"""

    measured: float
    """Measured [µm; angular components µrad, squareness µm/m]"""

    predicted: float
    """Predicted, adopted effects included [µm; angular components µrad, squareness µm/m]"""

    residual: float
    """Measured minus predicted. Where the instrument was zeroed, less the residual of its set-up's
    first observation; where the zero is not known, less the mean [µm; angular components µrad,
    squareness µm/m]
    """


class RunningAnalysis(Shape):
    """An analysis that waits or runs."""

    id: int
    """Number of the analysis"""

    progress: float
    """Share that is done, 0 to 1"""


class SensorCorrelationAnswer(Shape):
    """How one component's change goes with one sensor's temperature over the maps."""

    sensor: str
    """Sensor"""

    r: float | None
    """Pearson's correlation, positive where the error at the position that changes most grows with
    the temperature; null where there is none
    """

    maps: int
    """Number of maps that it rests on"""

    ties_with_best: bool
    """Whether these maps cannot tell it from the best sensor"""

    reason: str
    """Why there is no r, or why it cannot be proposed; else empty"""

    confidence_95: list[float] | None
    """Its 95 % confidence interval; null for fewer than four maps"""


class SensorNow(Shape):
    """A sensor now."""

    sensor: str
    """Sensor"""

    temperature_c: float | None
    """Its latest temperature [°C], null without any"""

    age_s: float | None
    """How old that is [s]"""

    interval_s: float | None
    """How far apart its readings usually are [s]; null where they do not come by the clock, or too
    few have come
    """

    is_late: bool
    """Whether the next one should have come: after five usual intervals, not before 15 s, twice the
    longest of the latest intervals, or five of those at which its sender sends
    """

    no_value_since: AwareDatetime | None
    """Since when its sender says that it has no value (null, UNAVAILABLE, a status that is not
    good); null where it does not, and from the next value on
    """

    rate_k_per_h: float | None
    """How fast it changes now [K/h], over the last half hour or, where its course bends, the last
    minutes; null where that is not known
    """

    health: Literal["ok", "missing", "stale", "out-of-range", "stuck", "jump", "faulty"]
    """`ok`, `missing`, `stale`, `out-of-range`, `stuck`, `jump`, or `faulty`: an adopted effect
    says that it is
    """

    detail: str
    """What is the matter, empty where nothing"""

    outside_maps_k: float | None
    """By how much it is outside the maps of the components that follow it [K]: 0 inside, negative
    below the coldest; null where none follows it
    """

    maps_c: list[Any] | None
    """Temperatures of the coldest and the hottest map between which all of these components are
    known [°C]
    """

    assigned_to: list[str]
    """Codes of the components that are assigned to it"""


class SensorSchema(Shape):
    """A temperature sensor and what is physically believable of it."""

    name: str
    """Name of the sensor"""

    stand_in: str | None = None
    """Sensor whose own temperatures serve when this one fails; x-middle has y-front where nothing
    is stated
    """

    min_c: float = -50.0
    """Lowest believable temperature [°C]"""

    max_c: float = 150.0
    """Highest believable temperature [°C]"""

    max_age_s: float = 600.0
    """Age above which a value is stale; longest gap bridged in time [s]"""

    resolution_c: float = 0.1
    """Temperatures closer than this are the same; ten times this is a movement that sensors must
    show [°C]
    """

    stuck_after_s: float | None = 3600.0
    """Without any change for this long after its neighbours moved clearly, it is stuck [s]; null
    for a sensor that may stand still
    """

    max_rate_c_per_min: float = 5.0
    """A change faster than this is no temperature [°C/min]"""


class SensorStateAnswer(Shape):
    """One sensor now."""

    sensor: str
    """Sensor"""

    health: str
    """`ok`, `missing`, `stale`, `out-of-range`, `stuck`, `jump`, or `faulty`: an adopted effect
    says that it reads wrong, and another sensor stands in
    """

    temperature_c: float | None
    """Its last value [°C]"""

    age_s: float | None
    """Age of that value [s]"""

    detail: str
    """What is the matter, empty when all is well"""


class SizeAnswer(Shape):
    """Size of the residuals of one component, or of all lengths together."""

    component: str
    """Component code, `points x`, or `all`"""

    unit: str
    """Unit of its numbers"""

    count: int
    """How many values"""

    mean: float
    """Mean [µm; angular components µrad, squareness µm/m]"""

    rms: float
    """Root mean square [µm; angular components µrad, squareness µm/m]"""

    p95: float
    """95th percentile of the size [µm; angular components µrad, squareness µm/m]"""

    repeatability: float | None
    """Standard deviation of one observation [µm; angular components µrad, squareness µm/m]"""

    repeatability_origin: str
    """`declared`, what nearly all lengths have in `common` where they contradict that, from
    `replicates`, or guessed from the `residuals` within visits
    """

    share_above_repeatability: float | None
    """Share that exceeds it in size, with that of a zero that was measured too; noise alone: 0.32
    """

    zero: Literal["absolute", "first", "removed"]
    """What its figures are relative to, as in an analysis"""


class SmallestSeenAnswer(Shape):
    """
    The smallest effect of one kind on one component that would have been seen nine times in ten.

    A time constant, pitch or time of change is taken from the middle of those that are searched.
    """

    kind: str
    """Kind of effect"""

    component: str
    """On which component"""

    unit: str
    """Unit of its numbers"""

    smallest_rms: float
    """Root mean square over the rows that it acts on [µm; angular components µrad, squareness µm/m]
    """


class SpreadAnswer(Shape):
    """How far three sums of errors spread over the volume."""

    ranges_um: list[float]
    """Largest less smallest value in x, y, z (8.122–8.127) [µm]"""

    definition_1_um: float
    """Largest root of the sum of squares of x, y, z (8.118–8.121) [µm]"""

    definition_2_um: float
    """Root of the sum of squares of the ranges (8.128) [µm]"""

    worst_point_mm: list[float]
    """Where definition 1 has its largest [mm]"""

    within_um: float
    """What the true ranges and definitions may be beyond these: they are extremes of the model over
    the whole volume, not of samples [µm]
    """


class StoredReadings(Shape):
    """What became of the readings."""

    stored: int
    """Readings that are new"""

    duplicates: int
    """Readings that were there already, with the same content"""

    ahead: int = 0
    """How many of them lie in the future and are not used before their time; left out where none
    does
    """

    warnings: list[str] = []
    """What is to be said of them, in sentences; left out where nothing is"""


class StrongVisitAnswer(Shape):
    """A visit that carries much of the evidence."""

    label: str
    """Label of the verification"""

    time: AwareDatetime
    """When it began, UTC"""


class SummaryAnswer(Shape):
    """Residuals along one quantity."""

    over: str
    """Component, position, time, temperature, rate, state or direction"""

    bins: list[BinAnswer]
    """In the order of the quantity"""


class SurenessAnswer(Shape):
    """How sure a learnt effect is of one component at this moment, in the component's unit."""

    component: str
    """Component code"""

    expected: float
    """What was learnt beside the maps [µm; angular components µrad, squareness µm/m]"""

    learnt_error: float
    """Standard deviation of what was learnt [µm; angular components µrad, squareness µm/m]"""

    wander_error: float
    """Standard deviation of what no driver explains [µm; angular components µrad, squareness µm/m]
    """

    corrected: float
    """What of it is in the table [µm; angular components µrad, squareness µm/m]"""


class TargetAnswer(Shape):
    """ISO 230-2's values at one target position."""

    target_mm: float
    """Target position [mm]"""

    mean_forward_um: float
    """Mean deviation x̄↑ [µm]"""

    mean_backward_um: float | None
    """Mean deviation x̄↓ [µm]"""

    mean_um: float
    """Mean of both, x̄; of the forward one alone without the other [µm]"""

    reversal_um: float | None
    """Reversal value B, x̄↑ less x̄↓ [µm]"""

    standard_deviation_forward_um: float | None
    """s↑ [µm]"""

    standard_deviation_backward_um: float | None
    """s↓ [µm]"""

    repeatability_forward_um: float | None
    """R↑ = 4 s↑ [µm]"""

    repeatability_backward_um: float | None
    """R↓ = 4 s↓ [µm]"""

    repeatability_um: float | None
    """Bidirectional repeatability R [µm]"""


class TemperatureCourse(Shape):
    """A sensor's temperatures in bins; bins without a reading are left out."""

    sensor: str
    """Sensor"""

    max_age_s: float
    """What is further apart is not joined: the sensor's `max_age_s` [s]"""

    after_s: list[float]
    """Where each bin begins, after `since` [s]; the first may begin before it"""

    low_c: list[float]
    """Lowest temperature of each bin [°C]"""

    high_c: list[float]
    """Highest temperature [°C]"""

    mean_c: list[float]
    """Mean of the readings [°C]"""

    count: list[int]
    """Number of readings"""

    gap_s: list[float]
    """Longest time without a reading in the bin or before it, up to the bin before [s]"""


class TravelSchema(Shape):
    """The travel of an axis."""

    min_mm: float
    """Lower end of the travel [mm]"""

    max_mm: float
    """Upper end of the travel [mm]"""


class TriedAssignmentAnswer(Shape):
    """One component that is found to follow a sensor other than the assigned one."""

    component: str
    """Component code"""

    present_sensor: str
    """Sensor that it follows now"""

    other_sensor: str | None
    """The other sensor; null in older results where nothing could be judged"""

    as_good: list[str]
    """Other sensors that the set-ups cannot tell from it"""

    unit: str
    """Unit of its numbers"""

    before_rms_um: float
    """Root mean square of the residuals with the present sensor, on held-out set-ups from their
    zeros [µm]; see `unit`
    """

    after_rms_um: float | None
    """The same with the other sensor, as set-ups that were not held out say [µm]; see `unit`"""

    why_not: str | None
    """Why the other sensor is not proposed; null where it is"""

    sentence: str
    """One plain sentence"""

    proposed_sensor: str | None
    """Sensor that it should follow instead; null where none is proposed"""


class TriedEffectAnswer(Shape):
    """Whether a machine shows an effect that was found on another one."""

    verdict: Literal["yes", "no", "cannot-be-told", "adopted"]
    """`yes`: it certainly reduces this machine's residuals too; `no`: the machine certainly shows
    less than half of it; `cannot-be-told`; `adopted`: this machine's model already has such an
    effect
    """

    reason: str
    """One plain sentence"""

    setups: int
    """Set-ups that took part; none of them was used in finding it"""

    unit: str | None
    """Unit of the figures: the one in which the effect shows best; null where there are none"""

    before_rms_um: float | None
    """Root mean square of residuals where it acts [µm]; see `unit`"""

    after_rms_um: float | None
    """The same with the effect as it was found [µm]; see `unit`"""

    gain_ci95_um: list[float] | None
    """95 % interval of the reduction, over set-ups [µm]; see `unit`"""

    share: float | None
    """How much of the effect this machine shows: 1 is all of it, 0 nothing"""

    share_interval: list[float] | None
    """Interval of `share`; it widens with the number of machines tried together"""


class TriedOn(Shape):
    """One sister on which the effect was tried as it stands."""

    machine: str
    """The sister"""

    result: TriedEffectAnswer
    """The outcome"""


class UnexplainedAnswer(Shape):
    """Structure that no effect explains."""

    component: str
    """Where"""

    rms_um: float
    """Root mean square of what is left [µm]; see `unit`"""

    noise_um: float
    """Standard deviation of one observation [µm]; see `unit`"""

    unit: str
    """The unit of its numbers"""

    leads: list[str]
    """What it moves with"""

    tests: list[str]
    """Which tests found it"""


class ValidAnswer(Shape):
    """The ranges in which an effect was learnt; beyond them it is held at the edge."""

    from_: AwareDatetime = Field(..., alias="from")
    """Time of the first observation that it rests on, UTC"""

    to: AwareDatetime
    """Time of the last one, UTC"""

    temperatures_c: dict[str, list[float]]
    """Temperatures of the sensors that it uses [°C]"""

    state: dict[str, list[float]]
    """Values of the states that drive it at once"""

    positions_mm: dict[str, list[float]]
    """Positions on the axis of each of its components [mm]"""

    made_of: dict[str, list[float]]
    """Quantities that it forms from several signals or from the past, such as how far a sensor
    lags; each name ends in the unit
    """

    use_until: AwareDatetime | None
    """Until when an effect that grows with time may be used, UTC. After that, its growth since
    `to`, or its error where it is continued beyond that, may exceed the scatter of one observation.
    Null for other effects
    """


class VisitMeans(Shape):
    """Means by visit of one component: arrays of equal length."""

    component: str
    """Component code, or `points x`"""

    unit: str
    """Unit of the means"""

    at_points: bool
    """Whether the values are of points of the work volume"""

    time_s: list[float]
    """Mean time of each [s], since 1970-01-01 UTC"""

    direction: list[float]
    """Approach, 1 or -1, where an effect's error reverses with it: each visit then has two means;
    else 0
    """

    count: list[int]
    """Number of values in each mean"""

    before: list[float]
    """Means before [µm; …], in `unit`"""

    after: list[float]
    """Means with all effects [µm; …], in `unit`"""

    expected: list[float]
    """Expected standard deviation of each mean, from repeatability, set-up scatter and the maps'
    own uncertainty [µm; …], in `unit`; empty in older results
    """


class VisitPreview(Shape):
    """A visit that is yet to be made, read from a file."""

    planned: PlannedVerification
    """As it may be planned with"""

    warnings: list[str]
    """What of the file was not read, or may be a mistake"""


class WaitingMapAnswer(Shape):
    """A map that the version that waits has, and the active one has not."""

    id: int
    """The map's number"""

    label: str
    """The map's name"""


class WatchAnswer(Shape):
    """Where the sequential test of the active version stands."""

    model_version: int
    """The active version"""

    status: Literal["within", "beyond", "no-verification"]
    """`no-verification` before the first one was judged"""

    beyond_since: AwareDatetime | None
    """Time of the visit that first exceeded the limit, UTC; null: none did"""

    evidence: float
    """Evidence from all verifications so far, as an e-value; 1 without any"""

    limit: float
    """Evidence that an unchanged machine ever reaches only with probability `false_alarm`"""

    false_alarm: float
    """Probability that an unchanged machine is ever called changed"""

    updated_at: AwareDatetime | None
    """When the last verification was judged, UTC"""

    contradiction: str | None
    """What is said where nearly all lengths contradict the repeatability that is stated, and what
    that does to the watch; null where they do not
    """

    numbers: list[FollowedNumber]
    """What is followed, strongest evidence first"""

    verifications: list[JudgedVerification]
    """What was judged, oldest first"""


class WithdrawnReadingAnswer(ReadingSchema):
    """A reading that was withdrawn: it counts nowhere."""

    withdrawn_at: AwareDatetime
    """When it was withdrawn, UTC"""


class WithdrawnReadings(Shape):
    """How many readings were taken out of use."""

    withdrawn: int
    """Readings that count nowhere from now on"""


class WatchChange(Shape):
    """The watch of a machine says something else than before."""

    machine: str
    """Id of the machine"""

    time: AwareDatetime
    """When it was judged, or another version became active"""

    watch: Literal["within", "beyond", "not-judged"]
    """What it says of the active version now; `beyond`: the machine drifts from its model"""

    before: Literal["within", "beyond", "not-judged"]
    """What it said before"""

    model_version: int | None
    """The active version, null where there is none"""

    drifting_since: AwareDatetime | None
    """Since when it drifts, null where it does not"""

    who: str
    """Who stored or deleted a verification, or activated a version"""


class AnalysisNews(Shape):
    """How far an analysis is."""

    machine: str
    """Id of the machine"""

    analysis: int
    """Number of the analysis"""

    status: Literal["queued", "running", "done", "failed", "cancelled", "deleted"]
    """How far it is; `queued` comes again where the process that ran it is gone"""

    progress: float
    """Share that is done, 0 to 1"""

    message: str
    """What is being done, or why it failed"""

    time: AwareDatetime
    """When it was so"""

    who: str
    """Who asked for it, cancelled or deleted it; `service` for the rest"""


class MissedEntries(Shape):
    """Entries of the log that a stream can tell no more: there were too many."""

    count: int | None
    """How many that it would have told, null where that is not known"""

    detail: str
    """The same in words, and where to find them"""


class AnswerHead(Shape):
    """What every answer about the machine in three dimensions says of itself."""

    machine: str
    """The machine's id"""

    model_version: int
    """Version of the model"""

    computed_at: AwareDatetime
    """When it was computed, UTC"""

    complete: bool
    """Whether no component and no adopted effect is missing, none rests on an old temperature or on
    a reading that arrived before its time, or ends where other maps of it go on
    """

    warnings: list[str]
    """All that is not as it should be, in sentences"""

    counted_as_zero: list[str]
    """Components that no two maps have and that count as zero"""


class VerificationExtent(Shape):
    """What a verification says beside its observations, and how far these go."""

    label: str
    """The verification's name on its machine"""

    datum: Literal["absolute", "first", "free"]
    """`absolute`; `first`: the instrument was zeroed at the first observation of each component;
    `free`: an unknown constant per component
    """

    repeatability_um: float | None
    """Standard deviation of one length [µm], where it is known; of angles and squareness it says
    nothing
    """

    instrument: str | None
    """What measured, for the certificate"""

    operator: str | None
    """Who measured, for the certificate"""

    first_at: AwareDatetime
    """Time of its first observation, UTC"""

    last_at: AwareDatetime
    """Time of its last observation, UTC"""

    count: int
    """How many observations it has"""

    components: list[str]
    """What was observed: component codes, and `points`"""


class AnsweredClaim(Shape):
    """What names an effect in answers."""

    kind: str
    """Kind of effect"""

    variant: str
    """Which form of the kind; empty where it has one only"""

    components: list[str]
    """On which components"""

    sensors: list[str]
    """Driven by which sensors"""

    states: list[str]
    """Driven by which states"""


class ControllerHead(Shape):
    """What an answer about a controller's files rests on."""

    machine: str
    """The machine's id"""

    model_version: int
    """Version of the model"""

    computed_at: AwareDatetime
    """When it was computed, UTC"""

    temperatures_c: dict[str, float]
    """Temperatures that were used [°C]"""

    controller: str
    """Format"""

    complete: bool
    """Whether the compensation table is complete"""

    warnings: list[str]
    """All that is to be known, in sentences"""


class AccuracyAnswer(AnswerHead):
    """Every definition of volumetric accuracy (C. Wang, 8.112–8.133, Table 8.2)."""

    volume: dict[str, TravelSchema]
    """The work volume [mm]"""

    linear: SpreadAnswer
    """Of the sums 8.112–8.114: translations with squareness, no lever arms [µm]"""

    angular: AngularSpreadAnswer
    """Of the sums 8.115–8.117 [µrad]"""

    with_arms: SpreadAnswer
    """Of the volumetric error at the tool, lever arms included [µm]"""

    diagonals_um: dict[str, float]
    """True range of the displacement along each body diagonal [µm]"""

    Ed_um: float
    """ISO 230-6 Ed: largest of the diagonals' ranges [µm]"""

    ESd_um: float
    """ESd: range over all diagonals together [µm]"""

    ELv_um: float
    """ELv from the volume's edges (Table 8.2) [µm]"""

    ELSv_um: float
    """ELSv, with straightness and squareness (Table 8.2) [µm]"""

    ratios: dict[str, float | None]
    """Multiple factors M1 = ELSv/ELv, M2 = ELSv/Ed, M3 = ELSv/ESd; null where a measure is 0"""


class AdoptedEffectAnswer(AnsweredClaim):
    """An effect that the version has adopted."""

    parameters: dict[str, float]
    """Parameters; their names say the unit"""

    standard_errors: dict[str, float]
    """One standard deviation of those that were estimated"""

    explanation: str
    """What it is, in a sentence"""

    valid: ValidAnswer | None
    """Where it was learnt; null where an older version of this software adopted it"""

    found_by: int | None
    """Number of the analysis that found it; null where an older version of this software adopted it
    """

    refitted_by: list[int]
    """Numbers of the analyses that have fitted it anew since, in their order"""

    measure_again: str
    """Until when one that grows with time may be used, and what to measure then"""


class AlternativeAnswer(AnsweredClaim):
    """Another explanation of the same residuals."""

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

    separating_measurement: str | None
    """What would tell them apart"""


class BandAnswer(Shape):
    """One band of temperatures."""

    folder: str
    """Folder of its files"""

    from_c: dict[str, float]
    """Where it begins [°C]"""

    to_c: dict[str, float]
    """Where it ends [°C]"""

    at_c: dict[str, float]
    """Temperatures of its tables [°C]"""

    check: list[CheckAnswer]
    """Moves that show whether the sign is right"""


class BeyondMaps(Shape):
    """Components that lie outside their maps."""

    sensor: str
    """Sensor whose temperature lies outside"""

    outside_k: float
    """By how much [K]: positive above the hottest map, negative below the coldest"""

    components: list[str]
    """Codes of the components that follow it"""

    held_at: str | None
    """Label of the map at which they are held, null where they are extrapolated"""

    lacks: LargestValue | None
    """The largest that going on in a straight line through the two nearest maps would add to the
    compensation; null where they are extrapolated
    """


class ChangeThenAnswer(ComponentChangeAnswer):
    """The largest change of one component's error over what was recorded, and when that was."""

    time: AwareDatetime
    """Time of that reading, UTC"""

    temperatures_c: dict[str, float]
    """The temperatures then [°C]"""


class CompareAnswer(ControllerHead):
    """What a controller holds against what it should hold."""

    components: list[ComparedComponentAnswer]
    """The largest difference first"""

    not_held: list[NotHeldAnswer]
    """What the format cannot hold, and is not compared"""


class ComparedVersionAnswer(Shape):
    """One version, on the values that can be compared with all of them."""

    version: int
    """Number of the version"""

    reason: str
    """What made it"""

    active: bool
    """Whether tables are computed with it now"""

    overall: SizeAnswer | None
    """All lengths; null where nothing is one"""

    components: list[SizeAnswer]
    """Each component in its own unit"""

    contradiction: str | None
    """What is said of a stated repeatability that nearly all lengths contradict, as in an analysis:
    the figures rest on what they show; null where nothing is contradicted
    """


class ComponentCompensationAnswer(TableEntry):
    """
    One component's error and compensation at the live temperatures.

    Tables have `positions_mm` and lists; squareness and rotary-axis locations have
    single numbers. The compensation is minus the error: what is to be added to the
    command.
    """

    component: str
    """ISO 230-1 code"""

    chapter: str
    """The chapter's notation"""

    axis: str | None
    """Axis of the positions, null for a single value"""

    positions_mm: list[float] | None = None
    """Positions on the axis [mm]"""

    errors_um: list[float] | None = None
    """Actual minus nominal: linear displacement, straightness [µm]"""

    errors_urad: list[float] | None = None
    """Actual minus nominal: angular [µrad]"""

    error_um_per_m: float | None = None
    """Actual minus nominal: squareness [µm/m]"""

    slopes_um_per_m: list[float] | None = None
    """Actual minus nominal: nonrigid slope [µm/m]"""

    slopes_urad_per_m: list[float] | None = None
    """Actual minus nominal: nonrigid slope [µrad/m]"""

    error_um: float | None = None
    """Actual minus nominal: rotary-axis location [µm]"""

    error_urad: float | None = None
    """Actual minus nominal: rotary-axis location [µrad]"""

    standard_errors_um: list[float] | None = None
    """Standard error of each error and its compensation, as far as the measurement of the maps
    goes: temperatures count as exact at the maps and between them, beyond the maps what their
    resolution adds over the edge is in it; absent where a map that enters states none: linear
    displacement, straightness [µm]
    """

    standard_errors_urad: list[float] | None = None
    """Standard error of each error and its compensation, as far as the measurement of the maps
    goes: temperatures count as exact at the maps and between them, beyond the maps what their
    resolution adds over the edge is in it; absent where a map that enters states none: angular
    [µrad]
    """

    standard_error_um_per_m: float | None = None
    """Standard error of each error and its compensation, as far as the measurement of the maps
    goes: temperatures count as exact at the maps and between them, beyond the maps what their
    resolution adds over the edge is in it; absent where a map that enters states none: squareness
    [µm/m]
    """

    standard_errors_um_per_m: list[float] | None = None
    """Standard error of each error and its compensation, as far as the measurement of the maps
    goes: temperatures count as exact at the maps and between them, beyond the maps what their
    resolution adds over the edge is in it; absent where a map that enters states none: nonrigid
    slope [µm/m]
    """

    standard_errors_urad_per_m: list[float] | None = None
    """Standard error of each error and its compensation, as far as the measurement of the maps
    goes: temperatures count as exact at the maps and between them, beyond the maps what their
    resolution adds over the edge is in it; absent where a map that enters states none: nonrigid
    slope [µrad/m]
    """

    standard_error_um: float | None = None
    """Standard error of each error and its compensation, as far as the measurement of the maps
    goes: temperatures count as exact at the maps and between them, beyond the maps what their
    resolution adds over the edge is in it; absent where a map that enters states none: rotary-axis
    location [µm]
    """

    standard_error_urad: float | None = None
    """Standard error of each error and its compensation, as far as the measurement of the maps
    goes: temperatures count as exact at the maps and between them, beyond the maps what their
    resolution adds over the edge is in it; absent where a map that enters states none: rotary-axis
    location [µrad]
    """

    compensation_um: list[float] | float | None = None
    """Minus the error: linear displacement, straightness, rotary-axis location [µm]"""

    compensation_urad: list[float] | float | None = None
    """Minus the error: angular, rotary-axis location [µrad]"""

    compensation_um_per_m: list[float] | float | None = None
    """Minus the error: squareness, nonrigid slope [µm/m]"""

    compensation_urad_per_m: list[float] | float | None = None
    """Minus the error: nonrigid slope [µrad/m]"""

    backward_errors_um: list[float] | None = None
    """Approached in the negative direction: linear displacement, straightness [µm]"""

    backward_errors_urad: list[float] | None = None
    """Approached in the negative direction: angular [µrad]"""

    backward_slopes_um_per_m: list[float] | None = None
    """Approached in the negative direction: nonrigid slope [µm/m]"""

    backward_slopes_urad_per_m: list[float] | None = None
    """Approached in the negative direction: nonrigid slope [µrad/m]"""

    backward_standard_errors_um: list[float] | None = None
    """Of the backward errors: linear displacement, straightness [µm]"""

    backward_standard_errors_urad: list[float] | None = None
    """Of the backward errors: angular [µrad]"""

    backward_standard_errors_um_per_m: list[float] | None = None
    """Of the backward errors: nonrigid slope [µm/m]"""

    backward_standard_errors_urad_per_m: list[float] | None = None
    """Of the backward errors: nonrigid slope [µrad/m]"""

    backward_compensation_um: list[float] | None = None
    """Minus the backward error: linear displacement, straightness [µm]"""

    backward_compensation_urad: list[float] | None = None
    """Minus the backward error: angular [µrad]"""

    backward_compensation_um_per_m: list[float] | None = None
    """Minus the backward error: nonrigid slope [µm/m]"""

    backward_compensation_urad_per_m: list[float] | None = None
    """Minus the backward error: nonrigid slope [µrad/m]"""

    iso: str | None = None
    """ISO 230-1 name of a squareness"""

    iso_error_urad: float | None = None
    """Its error in ISO's sign [µrad]"""

    sensor: str | None
    """Sensor that was used, by an adopted effect too; null, as are the next four, where no two maps
    have the component and adopted effects alone give it an error
    """

    stand_in_for: str | None = None
    """Assigned sensor, where another one stands in for it"""

    follows: list[FollowsAnswer] | None = None
    """Where an adopted effect says that the component follows another sensor than the assigned one:
    every sensor by whose temperature its maps are read, the largest share first; `sensor` is the
    first of them
    """

    temperature_c: float | None
    """That sensor's temperature T_u [°C]"""

    lower_map: str | None
    """Label of the lower map (T_n); null, as are the next two, where several sensors are followed
    and the numbers are not on one line between two maps
    """

    upper_map: str | None
    """Label of the upper map (T_m)"""

    weight: float | None
    """The upper map's share, (T_u − T_n)/(T_m − T_n)"""

    status: str
    """`interpolated`, `at-map`, `clamped`, `extrapolated`, `stand-in`, `effects-only`, or `held`:
    an adopted effect lies outside where it was learnt, and is held at the edge of that. `clamped`
    and `extrapolated` go before `held`; the warnings say both
    """

    effects: list[str]
    """Kinds of the adopted effects that are in these numbers; a component with effects has no
    standard errors, because the maps do not say how sure an effect is
    """


class ControllerAnswer(Shape):
    """One controller's file format."""

    name: str
    """Name by which it is asked for"""

    title: str
    """What it is"""

    sign: Literal["error", "compensation"] | None
    """What its values are, `error` (actual minus nominal) or `compensation` (minus that); null
    where no source says: then the option `sign` has to be stated
    """

    units: str
    """Units of positions and values"""

    spacing: str
    """What it wants of positions"""

    limits: str
    """What limits it"""

    status: str
    """How surely all this is known: `verified on the running controller`, `source-verified`,
    `manual-verified`, `seed example` or `ours`
    """

    holds: list[str]
    """Components that it can hold"""

    squareness_in_straightness: bool
    """Whether squareness is folded into straightness, because it has no table for it"""

    both_directions: bool
    """Whether it holds both directions of approach"""

    options: list[OptionAnswer]
    """What it can be told"""


class ControllersAnswer(Shape):
    """Every format."""

    controllers: list[ControllerAnswer]
    """Formats"""


class EffectInTableAnswer(Shape):
    """An adopted effect of the model, and whether it is in the table."""

    kind: str
    """Kind of the effect"""

    components: list[str]
    """Components that it acts on"""

    sensors: list[str]
    """Sensors that drive it"""

    explanation: str
    """What it is, in a sentence"""

    in_table: bool
    """Whether it could be evaluated and is in the numbers"""

    missing: str
    """What it lacks, empty where nothing"""

    held: list[str] = []
    """Why it is held at the edge of where it was learnt: which quantity, its value, and the range;
    empty where it is not
    """

    valid: ValidAnswer | None = None
    """Where it was learnt; null where an older version of this software adopted it"""

    measure_again: str = ""
    """Until when one that grows with time may be used, and what to measure then"""

    sureness: list[SurenessAnswer] = Field([], validate_default=True)
    """Of one that is corrected only as far as it is sure: how sure it is now, for each component;
    empty for others
    """


class ExportAnswer(ControllerHead):
    """A controller's files, and everything that is to be said of them."""

    sign: Literal["error", "compensation"]
    """What the values in the files are"""

    files: list[ExportedFileAnswer]
    """Files"""

    not_held: list[NotHeldAnswer]
    """What the controller does not hold, largest first"""

    resampling: list[ResamplingAnswer]
    """What spacing and rounding add"""

    check: list[CheckAnswer]
    """Moves that show whether the sign is right; with bands each has its own"""

    bands: list[BandAnswer] | None
    """Bands of temperatures, where they were asked for"""


class FoundEffectAnswer(Shape):
    """One effect that the model lacks."""

    effect: dict[str, Any]
    """What adoption stores"""

    before_rms_um: float
    """Root mean square of the residuals where it acts, before any found effect, on held-out visits
    where there are any [µm]; see `unit`
    """

    after_rms_um: float
    """The same with all found effects [µm]; see `unit`"""

    unit: str
    """Unit of these two: µm where the effect acts on any length"""

    status: str
    """How sure its name is: `confirmed`, `suspected` or `not-confirmable`"""

    helps: bool
    """Whether held-out visits show that it helps, and none gets markedly worse; such effects are
    adopted unless the request names effects
    """

    why_not: str | None
    """Why it is not known to help; null where it helps"""

    is_proxy: bool
    """Whether unexplained structure remains beside it"""

    doubts: list[str]
    """How the measured values depart from it, beyond noise: its name is then not `confirmed`. Empty
    where they fit it
    """

    evidence: EvidenceAnswer
    """How strong the evidence for it is"""

    alternatives: list[AlternativeAnswer]
    """What else it could be, ties first"""

    explanation: str
    """One plain sentence"""

    strongest_visits: list[StrongVisitAnswer]
    """The two visits that carry most of the evidence"""

    leverage: float
    """Their share of the evidence"""

    leverage_warning: str | None
    """A warning where two visits carry most of the evidence; else null"""

    measure_again: str | None
    """For an effect that grows with time: until when it may be used, and what to measure by then
    """

    causes: list[CauseAnswer]
    """What can be said of its causes where many drive it together; empty for other effects"""

    kind: str
    """Kind of effect"""

    variant: str
    """Which form of the kind; empty where it has one only"""

    components: list[str]
    """Components that it acts on"""

    sensors: list[str]
    """Sensors that drive it"""

    states: list[str]
    """States that drive it"""

    parameters: dict[str, float]
    """Parameters; the unit ends each name [µm; …]"""

    standard_errors: dict[str, float]
    """One standard deviation of each parameter that was estimated [µm; …]"""

    valid: ValidAnswer | None
    """The ranges in which it was learnt; beyond them it is held at the edge"""


class GridAnswer(AnswerHead):
    """
    The corner values of a grid (8.101–8.104), and how far interpolation is from the model.

    Corner values have the indices of x, y, z in this order, then the direction; cells
    have the index of their lower corner. A cell's corners 1 to 8 of the chapter are
    (0,0,0), (1,0,0), (1,1,0), (0,1,0), and the same at z = 1.
    """

    x_mm: list[float]
    """Coordinates of the nodes along x [mm]"""

    y_mm: list[float]
    """Coordinates of the nodes along y [mm]"""

    z_mm: list[float]
    """Coordinates of the nodes along z [mm]"""

    errors_um: list[list[list[list[float]]]]
    """Error x, y, z at each node [µm]"""

    compensation_um: list[list[list[list[float]]]]
    """Minus the error [µm]"""

    largest_difference_um: list[list[list[float]]]
    """Length that the difference between trilinear interpolation and model exceeds nowhere in each
    cell [µm]
    """

    attained_difference_um: list[list[list[float]]]
    """The largest such difference that was found in each cell [µm]"""

    largest_um: float
    """Length that this difference exceeds nowhere in the grid [µm]"""


class HelpedAnswer(AnsweredClaim):
    """What an added visit does for one effect."""

    unit: str
    """Unit of its numbers"""

    before_rms: float
    """Smallest size that is seen without the added visit [µm; angular components µrad, squareness
    µm/m]
    """

    after_rms: float
    """Smallest size that is seen with it [µm; angular components µrad, squareness µm/m]"""


class History(Shape):
    """What happened to a machine between two times."""

    machine: str
    """Id of the machine"""

    since: AwareDatetime
    """The first time, UTC"""

    until: AwareDatetime
    """The last one"""

    bin_s: float
    """Width of the bins [s]"""

    sensors: list[TemperatureCourse]
    """Temperatures"""

    compensation: CompensationCourse | None
    """The compensation at the place that was asked for, null where none was"""

    checks: list[CheckMark]
    """Verifications, in order of time"""

    events: list[Event]
    """Alarms, versions and other changes, the newest first"""

    notes: list[str]
    """What is not shown, and why"""


class LevelAnswer(Shape):
    """What a controller of one ability takes away, and what it leaves."""

    level: Literal["nothing", "displacement", "straightness", "angular", "nonrigid"]
    """`nothing`, `displacement` (8.89–8.91), `straightness` with squareness folded in (8.92–8.94),
    `angular` (8.95–8.97) or `nonrigid` (8.98–8.100)
    """

    mean_um: float
    """Mean length of the volumetric error that is left at the lattice's points [µm]"""

    rms_um: float
    """Its root mean square at these points [µm]"""

    max_um: float
    """Its largest anywhere in the volume [µm]"""

    within_um: float | None
    """What the true largest may be beyond `max_um` [µm]; null where the tables have too many nodes
    for that: `max_um` is then sampled, the largest at the lattice's points
    """

    tables: list[LevelTable]
    """The tables that such a controller needs"""


class LevelsAnswer(AnswerHead):
    """What each kind of controller would leave over the volume."""

    volume: dict[str, TravelSchema]
    """The work volume [mm]"""

    levels: list[LevelAnswer]
    """From nothing to everything"""


class MachineAnswer(Shape):
    """A machine as it is stored."""

    id: str
    """Short name used in URLs"""

    name: str
    """Name for people"""

    configuration: str
    """Kinematic chain: axes before F move the workpiece, those after it the tool"""

    axes: dict[str, TravelSchema] = Field({}, validate_default=True)
    """Travel of each axis [mm]"""

    sensors: list[SensorSchema] = Field([], validate_default=True)
    """The machine's temperature sensors"""

    out_of_range: Literal["clamp", "extrapolate", "reject"] = "clamp"
    """What happens at temperatures outside the maps"""

    extrapolation_margin_c: float = 5.0
    """How far `extrapolate` may go beyond the maps [°C]"""

    extrapolation_error_ratio: float = 3.0
    """How many times as large as at the edge of the maps the standard error of an extrapolated
    value may be; further out the value there is held
    """

    same_temperature: Literal["refuse", "mean"] = "refuse"
    """What happens to maps closer in temperature than a sensor resolves"""

    serial_number: str | None = None
    """The manufacturer's, as on the type plate"""

    active_model: int | None
    """Active model version, null before the first map"""

    waiting_model: int | None = None
    """Version that has all that was stored and waits for its activation, because tables would lose
    something; null where none waits
    """

    created_at: AwareDatetime
    """When it was created, UTC"""

    watch: str | None = None
    """What the last verifications say of the active model: `within` or `beyond` its limits (…/watch
    says more); null where none was judged
    """


class MachineStatus(Shape):
    """Whether a machine can be trusted now, and why not."""

    machine: str
    """The machine's id"""

    name: str
    """The machine's name"""

    configuration: str
    """Order of its axes"""

    verdict: Literal["trusted", "limited", "not-trusted"]
    """`trusted`: the table is what the maps and effects say, on fresh temperatures. `limited`:
    there is a table, and the sentences say where it is not. `not-trusted`: there is none, or it
    stands still
    """

    state: Literal[
        "no-model",
        "no-reading",
        "sensor-fault",
        "outside-maps",
        "stale",
        "extrapolated",
        "clamped",
        "held",
        "effect-missing",
        "incomplete",
        "late",
        "drifting",
        "check-off",
        "effect-not-adopted",
        "stand-in",
        "fresh",
    ]
    """The worst of what is the matter, `fresh` where nothing is. It goes 30 s after its cause"""

    about: list[str]
    """Sensors, components or effects that the state is about; empty where it is about all"""

    since: AwareDatetime | None
    """Since when it is in this state: by the readings in memory, and where those do not reach back
    so far, by the alarms of the event log, for which what it found before and after the service was
    away is one; null where that is not known
    """

    sentences: list[str]
    """What is the matter, the worst first; then what can be trusted all the same"""

    computed_at: AwareDatetime
    """When this was judged, UTC"""

    reading_time: AwareDatetime | None
    """Time of the latest reading that is in use"""

    reading_age_s: float | None
    """How old it is [s]"""

    model_version: int | None
    """Version of the active model"""

    components: int
    """How many components the table has; 0 without a table"""

    complete: bool
    """`complete` of `GET …/compensation`; false where there is no table"""

    largest: LargestValue | None
    """The largest compensation of the table: of a displacement where there is one"""

    change_per_h: LargestValue | None
    """The largest change of the compensation in an hour, of a displacement where there is one, if
    the sensors went on at their present rates; of components without adopted effects, as those may
    have a memory. Null where that is not known
    """

    beyond: list[BeyondMaps]
    """Components outside their maps, the furthest first"""

    watch: str
    """Whether verifications prove a lasting change: `within` the limits of the sequential test (no
    change is proved, which says nothing of the last check), `beyond` them, or `not-judged`
    """

    last_check: LastCheck | None
    """By how much the latest verification of the active model was off; null before the first"""

    not_adopted: NotAdopted | None
    """What the latest analysis of the active model confirmed and is not in the table, be it that
    other effects of it were adopted; null where there is none
    """

    analysis: RunningAnalysis | None
    """The analysis that waits or runs"""

    sensors: list[SensorNow]
    """Every sensor now, those that components are assigned to first"""


class MeasuredObservation(PlannedObservation):
    """
    What an instrument read once: of one component, or at a point of the work volume.

    `measured_um`, which may also be called `measured` as residuals have it, takes the value in
    the component's own unit, as predictions give it; the fields that name another unit say the
    same more exactly.
    """

    measured_um: float | list[float] | None = None
    """Measured error, actual minus nominal [µm; angular errors µrad, squareness µm/m]; three
    numbers x, y, z at a point
    """

    measured_urad: float | None = None
    """Measured angular error [µrad]"""

    measured_um_per_m: float | None = None
    """Measured squareness or slope [µm/m]"""

    measured_urad_per_m: float | None = None
    """Measured slope of an angular error [µrad/m]"""


class ModelAnswer(Shape):
    """
    One immutable version of a machine's model: its maps, its assignment and its effects.

    Tables are computed with it under the machine's settings (`out_of_range`, `same_temperature`,
    the sensors' `resolution_c` …) as they are now: changing these changes tables at once.
    """

    version: int
    """Number of the version"""

    active: bool
    """Whether tables are computed with it now"""

    waiting: bool
    """Whether it waits for its activation because its tables would lose something"""

    created_at: AwareDatetime
    """When it was made, UTC"""

    reason: str
    """What made it"""

    maps: list[ModelMap]
    """The error maps that it is made of"""

    assignment: dict[str, str]
    """Component to sensor"""

    effects: list[AdoptedEffectAnswer]
    """Adopted effects"""


class ModelComparisonAnswer(Shape):
    """Versions side by side, in the order in which they were named."""

    verifications: list[int]
    """Numbers of the verifications"""

    values: int
    """Values that can be compared with all versions"""

    versions: list[ComparedVersionAnswer]
    """The versions"""


class NeededAnswer(Shape):
    """Which errors have to be measured, and which of them the active model lacks."""

    machine: str
    """Machine"""

    configuration: str
    """Its kinematic chain"""

    preset: PresetAnswer | None
    """The kind of machine that was asked for; null for a rigid one"""

    components: list[NeededComponent]
    """What has to be measured, in order"""

    missing: list[str]
    """Of these, what no map of the active model has"""

    warnings: list[str]
    """What to know beside it"""


class NextVisitAnswer(Shape):
    """A visit to make next."""

    sentence: str
    """All of it: state, how to reach it, how long to wait, which points, and what it decides"""

    state: MachineStateAnswer
    """The state of the machine"""

    points: str
    """Which points, in words"""

    decides: str
    """What it decides"""

    like_time: AwareDatetime
    """When the machine was last recorded in such conditions, UTC"""

    temperatures_c: dict[str, float]
    """The sensors' temperatures at that time [°C]"""

    states: dict[str, float]
    """The machine's state at that time"""

    planned: PlannedVisitAnswer
    """What to send to planning"""


class ParseAnswer(Shape):
    """What files hold."""

    controller: str
    """Format"""

    sign: Literal["error", "compensation"]
    """As what the values were read"""

    machine: str | None
    """Machine that the files name, null where they do not"""

    components: list[ParsedComponentAnswer]
    """One for each component"""

    warnings: list[str]
    """All that is to be known, in sentences"""


class PlannedRivalAnswer(AnsweredClaim):
    """The effect that imitates another one best."""

    overlap: float
    """Share of the effect that it can reproduce"""

    separating_measurement: str | None
    """What would tell them apart"""


class Plots(Shape):
    """Arrays for the report's plots, at most some hundred points each."""

    effects: list[EffectCurve]
    """One for each effect that residuals show, in the order of the effects"""

    visits: list[VisitMeans]
    """One for each component"""


class ProposalAnswer(Shape):
    """What the maps say about the sensor of one component."""

    component: str
    """Component code"""

    current: str | None
    """Sensor assigned now"""

    proposed: str | None
    """Sensor that the maps speak for"""

    maps: int
    """Number of maps that have the component"""

    correlations: list[SensorCorrelationAnswer]
    """One for each sensor"""

    reason: str
    """Why"""

    chapter: str
    """The chapter's notation"""


class RecordedChangesAnswer(Shape):
    """By how much tables would have differed at what was recorded, up to the latest reading."""

    count: int
    """At how many recorded moments tables were compared: a few dozen of them, as far apart in
    temperature as can be; 0 where there are none
    """

    changes: list[ChangeThenAnswer]
    """The largest change over them of each component that changes more there than at the latest
    reading, the largest number first (1 µrad counts as 1 µm); what adopted effects make of the past
    (lags) is not in it
    """

    first_at: AwareDatetime | None = None
    """The first of the moments, UTC; null without any"""

    last_at: AwareDatetime | None = None
    """The last of them, UTC; null without any"""


class ResidualsAnswer(Shape):
    """What a model version leaves of verifications."""

    overall: SizeAnswer | None
    """All lengths; null where nothing is one"""

    components: list[SizeAnswer]
    """Each component in its own unit"""

    contradiction: str | None
    """What is said of a stated repeatability that nearly all lengths contradict, as in an analysis:
    the figures rest on what they show; null where nothing is contradicted
    """

    summaries: list[SummaryAnswer]
    """Components, and lengths along everything that they may depend on"""

    excluded: list[ExcludedAnswer]
    """What cannot be compared with the model"""

    model_version: int
    """Version that they were compared with"""

    verifications: list[int]
    """Numbers of the verifications"""

    counted_as_zero: list[str]
    """Components that residuals at points need, that no two maps have and that count as zero: these
    residuals contain them whole
    """

    rows: list[ResidualRow]
    """Single residuals, as many as were asked for"""


class RotaryErrorAnswer(AnswerHead):
    """The errors of the carried points, in their order."""

    errors_um: list[list[float]]
    """Actual minus nominal position x, y, z of each carried point [µm]; where the axes carry the
    workpiece, the tool's error relative to it is minus this
    """

    rms_um: float
    """Root mean square of their lengths [µm]"""

    max_um: float
    """The largest of their lengths [µm]"""

    left_um: list[list[float]]
    """What `compensated` leaves of each, x, y, z [µm]: the errors themselves where nothing is
    compensated
    """

    left_rms_um: float
    """Root mean square of the lengths that are left [µm]"""

    left_max_um: float
    """The largest of the lengths that are left [µm]"""

    locations: dict[str, float]
    """The location errors at these temperatures: positions (XOC, YOC, YOA, ZOA, XOB, ZOB) in µm,
    directions (AOC, BOC, BOA, COA, AOB, COB) in µrad [µm]
    """


class SharedEffect(AnsweredClaim):
    """An effect, the machines on which it was found, and how it did on their sisters."""

    explanation: str
    """The effect as found on the machine from which it was tried on the others"""

    found_on: list[FoundOn]
    """Machines whose own analysis found it; the first is the one from which it was tried"""

    tried_on: list[TriedOn]
    """Sisters on which it was tried"""

    not_tried_on: dict[str, str]
    """Sisters on which it was not tried, with the reason"""

    summary: str
    """On how many machines it was found and tried, with the outcomes"""


class SimulatedStepDiagonal(AnswerHead):
    """What a laser would read: the body of `…/measurements/step-diagonal`, and what it is of."""

    origin_mm: list[float]
    """Lowest corner of the volume [mm]"""

    step_mm: list[float]
    """Length of a step of x, y, z [mm]"""

    tool_offset_mm: list[float]
    """Tool offset of the target's middle [mm]"""

    target: str
    """What reflects"""

    temperatures_c: dict[str, float]
    """Temperatures that were used [°C]"""

    diagonals: dict[str, list[list[float]]]
    """Diagonal to a row for each step: after x, after y, after z [µm]"""


class SuggestionAnswer(Shape):
    """A visit to add."""

    visit: NextVisitAnswer
    """What to do, and what it improves"""

    helped: list[HelpedAnswer]
    """The effects whose smallest visible size falls most"""


class VerificationAnswer(VerificationExtent):
    """A stored verification without its observations."""

    id: int
    """The verification's number"""

    stored_at: AwareDatetime
    """When it was stored, UTC"""

    judgement: JudgementAnswer | None
    """What it said of the active model when it came, or once its readings had"""


class VerificationPreview(VerificationExtent):
    """What was read as a verification; nothing is stored."""

    preview: Literal[True]
    """That nothing is stored"""

    warnings: list[str]
    """What of it was not read, or may be a mistake"""

    read: list[str]
    """What was read of the file, in lines of text"""


class VolumetricErrorAnswer(AnswerHead):
    """The errors at the points, in their order."""

    errors_um: list[list[float]] | list[list[list[float]]]
    """Actual minus nominal position x, y, z of the tool at each point [µm]; one such list for each
    thermal state where a list of temperatures was sent
    """

    orientation_urad: list[list[float]] | list[list[list[float]]]
    """Error of the tool's direction, (ΣEB, −ΣEA, 0), at each point [µrad]"""

    outside_travel: list[int]
    """Indices of the points outside the axes' travel, from 0"""


class WaitedBeforeAnswer(Shape):
    """What waited already when this version was made: this version contains it."""

    model_version: int
    """The version that waited"""

    maps: list[WaitingMapAnswer]
    """Its maps that the active version has not: without them nothing waits, or something else"""

    loses: list[CoverageAnswer]
    """Which of the version's `loses` are its doing; the others are new"""


class WholeVerificationAnswer(VerificationAnswer):
    """A stored verification with its observations, in the order in which they came."""

    observations: list[MeasuredObservation]
    """What was measured"""


class ModelChange(Shape):
    """Which version was made, and whether tables are computed with it."""

    model_version: int | None
    """The version that was made"""

    activated: bool | None
    """Whether it is active; a version that loses something waits until somebody activates it, and
    the next ones are made of it
    """

    loses: list[CoverageAnswer]
    """What its tables lack against those of the version active before"""

    gains: list[CoverageAnswer]
    """What its tables have beyond those"""

    next_step: str | None
    """How to activate it all the same; null where it is active"""

    waited_before: WaitedBeforeAnswer | None
    """What waited already; null where nothing did"""

    stays_active: int | None
    """The version that stays active while this one waits; null where it is"""


class AnalysisResult(Shape):
    """What an analysis found; `plots` are the arrays of its report."""

    verdict: Literal["effects-found", "nothing-found", "unexplained", "not-judged"]
    """`effects-found`; `nothing-found`; `unexplained`: structure remains that no effect fits; `not-
    judged`: residuals are larger than the noise, but there are too few set-ups to say why
    """

    summary: str
    """The answer in plain sentences"""

    kinds: list[str] | None
    """Kinds of effects that were looked for; null for all"""

    unit: str
    """Unit of the overall figures: µm, or that of the angles where no length was measured"""

    noise_um: float | None
    """Standard deviation of one observation [µm]; null where nothing is known of it; see `unit`
    """

    floor_um: float | None
    """What noise alone would leave, judged by repeats and the scatter of set-ups [µm]; null where a
    component has too few repeats; see `unit`
    """

    before: FiguresAnswer
    """Residuals of the model as it was"""

    after: FiguresAnswer
    """Residuals with all effects that were found, those that do not help included"""

    after_with_maps_refitted: FiguresAnswer | None
    """The same with the maps also corrected within their own uncertainty"""

    p_global: float
    """Probability that noise alone gives as strong a candidate as the strongest one here"""

    visits: int
    """Visits that took part"""

    values: int
    """Values that took part"""

    components: list[ComponentFiguresAnswer]
    """Figures by component, largest first"""

    effects: list[FoundEffectAnswer]
    """Effects that the model lacks; numbered from 0, as adoption, report and terminal do"""

    refitted: list[RefittedEffectAnswer]
    """Effects that the model already has, and what adopting those that help does to them"""

    unexplained: list[UnexplainedAnswer]
    """What no effect explains"""

    excluded: list[ExcludedAnswer]
    """Values that took no part"""

    not_testable: list[NotTestedAnswer]
    """What could not be tested"""

    detectable: list[SmallestSeenAnswer]
    """The smallest effects that would have been seen"""

    what_next: list[str]
    """What to measure or to do next, the most useful first"""

    plots: Plots
    """Arrays of the report's plots"""

    floor_unknown: str | None
    """Why there is no floor; null where there is one"""

    next_visits: list[NextVisitAnswer]
    """Visits that would settle what is open, in the order of a working day; empty where none can be
    proposed, and in older results
    """

    far_values: list[FarValueAnswer]
    """Values left out because they are far from the others, the furthest first, 200 at most; empty
    in older results
    """

    assignments: list[TriedAssignmentAnswer]
    """Components that are found to follow another sensor than theirs, proposals first"""

    temperatures_c: dict[str, list[Any]]
    """The lowest and the highest temperature of each sensor at the times of the values [°C]; empty
    in older results
    """


class ChangedModelAnswer(ModelAnswer, ModelChange):
    """A version that was made or activated, and what its tables lose and gain by it."""


class CompensationAnswer(CompensationTable):
    """
    The compensation table at stated temperatures.

    Adopted effects act as far as the request carries what they need: temperatures, the
    machine's `state`, and the present time. Those that need the past, such as a thermal lag,
    are in the table at the latest reading only.
    """

    machine: str
    """The machine's id"""

    model_version: int
    """Version of the model"""

    computed_at: AwareDatetime
    """When it was computed, UTC"""

    complete: bool
    """Whether every component of the maps and every adopted effect is in the table, none on an old
    temperature or ending where other maps of it go on, no effect outside where it was learnt, and
    no value in use from a reading that arrived before its time
    """

    warnings: list[str]
    """All that is not as it should be, in sentences"""

    effects: list[EffectInTableAnswer] = Field([], validate_default=True)
    """The model's adopted effects, in the table or not"""

    components: list[ComponentCompensationAnswer]
    """One for each component"""


class CorrelationAnswer(Shape):
    """The proposal; nothing has changed."""

    components: list[ProposalAnswer]
    """One for each component of the maps"""

    proposal: dict[str, str]
    """The assignment that the maps speak for, ready to be PUT"""


class CurrentCompensationAnswer(CompensationAnswer):
    """The compensation table at the latest reading."""

    reading_time: AwareDatetime
    """Time of the latest reading, UTC"""

    reading_age_s: float
    """Its age [s]"""

    stale: bool
    """Whether any sensor's value is older than it may be"""

    sensors: list[SensorStateAnswer]
    """Every sensor's state"""


class ErrorMapAnswer(Components):
    """A stored error map."""

    label: str
    """The map's name on its machine"""

    measured_at: AwareDatetime
    """When it was measured, with a zone"""

    temperatures_c: dict[str, float]
    """Every sensor's temperature at that time [°C]"""

    components: list[ComponentAnswer]
    """The measured components"""

    measuring_lines_mm: dict[str, list[float] | MeasuringLineSchema] = Field(
        {}, validate_default=True
    )
    """Axis to the line along which its translations were measured: a point (x, y, z) of it [mm], or
    that point with the tool offset; absent where they are free of the rotations' effect
    """

    repeatability_um: float | None = None
    """Repeatability of the measurement, one standard deviation [µm]"""

    instrument: str | None = None
    """What measured"""

    model_version: int | None = None
    """The version that was made"""

    activated: bool | None = None
    """Whether it is active; a version that loses something waits until somebody activates it, and
    the next ones are made of it
    """

    loses: list[CoverageAnswer] = Field([], validate_default=True)
    """What its tables lack against those of the version active before"""

    gains: list[CoverageAnswer] = Field([], validate_default=True)
    """What its tables have beyond those"""

    next_step: str | None = None
    """How to activate it all the same; null where it is active"""

    waited_before: WaitedBeforeAnswer | None = None
    """What waited already; null where nothing did"""

    stays_active: int | None = None
    """The version that stays active while this one waits; null where it is"""

    id: int
    """The map's number"""

    stored_at: AwareDatetime
    """When it was stored, UTC"""

    in_active_model: bool
    """Whether the active model version contains it"""

    warnings: list[str] = []
    """What is unusual about it"""


class FleetJudgement(Shape):
    """What the analyses of a fleet say together."""

    summary: str
    """Two plain sentences"""

    machines: list[FleetMachine]
    """Every machine; those that drift come first"""

    effects: list[SharedEffect]
    """Effects, those found on most machines first"""

    tried_together: int
    """Number of trials; the thresholds rise with it"""


class PlannedEffectAnswer(AnsweredClaim):
    """
    The smallest effect of one kind that the plan would find nine times in ten.

    A time constant, pitch or time of change is taken from the middle of those that are searched.
    """

    unit: str
    """Unit of its numbers"""

    smallest_rms: float
    """Its root mean square over the values on which it acts [µm; angular components µrad,
    squareness µm/m]
    """

    distinguishable_rms: float | None
    """The size from which it can be told from its closest rival; null where nothing in this plan
    tells them apart [µm; angular components µrad, squareness µm/m]
    """

    rival: PlannedRivalAnswer | None
    """Its closest rival of another kind"""


class PreviewAnswer(Shape):
    """What a change would do to the tables; nothing is stored."""

    preview: Literal[True] = True
    """That nothing is stored"""

    reason: str
    """What would make the version, and which effects it would not keep"""

    active_version: int | None = None
    """The version that it is compared with; null before the first"""

    activated: bool
    """Whether it would be activated without more ado"""

    loses: list[CoverageAnswer]
    """What its tables lack against those of the version active before"""

    gains: list[CoverageAnswer]
    """What its tables have beyond those"""

    waited_before: WaitedBeforeAnswer | None = None
    """What waited already; null where nothing did"""

    reading_time: AwareDatetime | None = None
    """Time of the latest reading, at which `changes` hold; null without, UTC"""

    temperatures_c: dict[str, float]
    """Its temperatures [°C]"""

    changes: list[ComponentChangeAnswer]
    """By how much each component that stays would change then, largest number first (1 µrad counts
    as 1 µm)
    """

    not_compared: str
    """Why nothing is known of changes, such as that there is no reading; else empty"""

    recorded: RecordedChangesAnswer
    """The same at what was recorded before: a map whose temperatures are wrong may change nothing
    at the latest reading
    """

    warnings: list[str] = []
    """What is unusual about what would be stored, such as numbers that may be in another unit"""


class StoredVerificationAnswer(VerificationAnswer):
    """A verification that was stored just now, or was there already."""

    warnings: list[str]
    """What may be a mistake in it, and what the active model cannot be compared with, and why"""


class WaitingAssignmentAnswer(ModelChange):
    """An assignment whose version waits, because its tables would lose something."""

    assignment: dict[str, str]
    """Component to sensor, in the waiting version"""


class AnalysisAnswer(AnalysisHead):
    """An analysis with its result, once it is done."""

    result: AnalysisResult | None
    """What was found; null before that"""


class FleetAnswer(Shape):
    """How far the analyses of all machines are, and what they say together."""

    machines: list[FleetMemberAnswer]
    """Every machine"""

    tried: int
    """Effects that were tried on sisters so far"""

    wanted: int
    """How many are to be tried; 0 until every analysis has ended"""

    judgement: FleetJudgement | None
    """What the analyses say together; null as long as something goes on"""

    done: list[str]
    """Machines whose analysis was asked for, or cancelled, by this request"""

    refused: dict[str, str]
    """By machine, why that was not done"""

    queue_full: bool
    """Whether some were refused because too many analyses wait: ask again later"""

    going_on: bool
    """Whether more will be said unasked: an analysis waits or runs, or trials are left"""


class MapPreview(PreviewAnswer):
    """What was read as a map, and what storing it would do to the tables; nothing is stored."""

    label: str
    """The map's name"""

    components: list[str]
    """Codes of its components"""

    read: list[str]
    """What was read of the file, in lines of text"""


class MeasurementAnswer(ModelChange, Components):
    """What a measurement yields."""

    machine: str
    """The machine's id"""

    method: str
    """How it was measured"""

    label: str | None
    """The name of its map, where one was stated"""

    stored: bool
    """Whether an error map was made of it"""

    map_id: int | None
    """That map's number"""

    is_new: bool
    """False where the same map was there already, or none"""

    components: list[ComponentAnswer]
    """The components with their standard errors"""

    figures: dict[str, float]
    """Figures of quality and of the method's standard, by names that end in the unit, such as
    closure_rms_um [µm]
    """

    notes: list[str]
    """What the method cannot see, what was left out, what looks wrong"""

    measuring_lines_mm: dict[str, list[float] | MeasuringLineSchema]
    """Axis to the line along which its translations count as measured [mm]"""

    warnings: list[str]
    """What of its file was not read"""

    preview: PreviewAnswer | None
    """What storing it would do to the tables, where a preview was asked for"""


class PlanAnswer(Shape):
    """What a plan of measurements could see and tell apart, and which visit to add."""

    model_version: int
    """Version that would be analysed"""

    summary: str
    """The answer in plain sentences"""

    visits: int
    """Planned visits"""

    values: int
    """Planned values"""

    notes: list[str]
    """Assumptions that were made"""

    effects: list[PlannedEffectAnswer]
    """The hardest to tell apart first"""

    not_testable: list[NotTestedAnswer]
    """Effects that the plan could not show, with the reasons"""

    excluded: list[ExcludedAnswer]
    """Values that cannot be compared with the model"""

    suggestions: list[SuggestionAnswer]
    """Visits to add, most useful first"""


class PositioningAnswer(MeasurementAnswer):
    """ISO 230-2's figures of the axis (A, E, M, B, R in `figures`) and its displacement error."""

    targets: list[TargetAnswer]
    """The values at each target position"""


class RotaryAxisAnswer(MeasurementAnswer):
    """The axis' location errors, with run-out in `figures`."""

    residuals_um: list[list[float]]
    """Measured minus fitted place of the ball: radial (outward), tangential (in the sense of
    positive rotation), axial [µm]
    """

    noise_um: float | None
    """Standard deviation of one coordinate, from the residuals or as stated [µm]"""

    degrees_of_freedom: int
    """Of that noise; 0 where it was stated or nobody knows"""

    path: PathErrorsAnswer
    """The path errors before and after compensation; rms and largest length are in `figures` [µm]
    """


class StepDiagonalAnswer(MeasurementAnswer):
    """Nine translations and three squareness errors."""

    closure_um: list[list[float]] | None
    """For x, y, z and each interval: what the four diagonals contradict each other by, the
    measurement's own noise [µm]; null with three diagonals
    """


class ThermalDriftAnswer(MeasurementAnswer):
    """The figures of ISO 230-3's tests in `figures`; `components` are those of the last state."""

    states: list[DriftStateAnswer]
    """Thermal states, in order of time"""

    verification: DriftVerificationAnswer | None
    """The stored verification, where one was asked for"""


class BodyDiagonalAnswer(MeasurementAnswer):
    """Ed, ESd, and the squareness that the diagonals' ends show."""

    Ed_um: float
    """Largest range on a diagonal, of the means in both directions [µm]"""

    ESd_um: float
    """Range over all diagonals together [µm]"""

    diagonals_um: dict[str, float]
    """Range on each diagonal [µm]"""

    reversal_um: dict[str, float]
    """Largest reversal value on each diagonal, forward less backward mean [µm]; empty where nothing
    was measured backwards
    """


class DrilledPlateAnswer(MeasurementAnswer):
    """Scale, squareness and axis errors, up to a rigid motion."""

    rotation_urad: float
    """How the plate lay on the coordinate machine, about Z [µrad]"""

    shift_mm: list[float]
    """Where its nominal zero lay [mm]"""

    scale_um_per_m: list[float]
    """Scale of x and y [µm/m]"""

    scale_standard_errors_um_per_m: list[float | None]
    """Their standard errors [µm/m]"""

    squareness_um_per_m: float
    """SXY [µm/m]"""

    residuals_um: list[list[float]]
    """What rigid motion, scale and squareness leave of each hole's x, y [µm]"""

    suspicious: list[int]
    """Indices of holes far from the rest, from 0; they are kept"""


class MachinedPartAnswer(MeasurementAnswer):
    """The straightness of the edge, and how it compares with the model."""

    straightness_um: float
    """Range of the deviations from the line [µm]"""

    slope_um_per_m: float
    """Slope that was taken out [µm/m]: alignment on the coordinate machine, and whatever squareness
    the edge has
    """

    suspicious: list[int]
    """Indices of measured points far from the rest, from 0; they are kept"""

    comparison: ComparisonAnswer | None
    """With the active model at `temperatures_c`; null where there is no model"""
