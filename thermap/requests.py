"""What the service is asked with, as far as no answer has it too.

Written by `scripts/write_client.py` from the service's OpenAPI document.
"""

from typing import Any, Literal

from pydantic import AwareDatetime, Field

from thermap.answers import (
    MeasuredObservation,
    MeasuringLineSchema,
    PlannedVerification,
    SensorSchema,
    TravelSchema,
)
from thermap.shape import Shape


class AdoptionRequest(Shape):
    """Which of the effects that an analysis found go into the model."""

    effects: list[int] | None = None
    """Places in the result's list of effects, from 0, whatever is known of them; where it is left
    out, those that help (`helps`)
    """

    onto_active: bool = False
    """Whether to add them to the active version where that is no longer the one that was analysed:
    they were found on another model, so look at its residuals after
    """


class AnalysisRequest(Shape):
    """What the active model is compared with, and which effects are looked for."""

    verifications: list[int] | None = None
    """Numbers of the verifications; all that are stored where it is left out"""

    holdout_fraction: float = 0.3
    """Share of the visits that take no part in the search, below 0.9"""

    effects: list[str] | None = None
    """Kinds of effects to look for; all of them where it is left out"""

    seed: int = 0
    """Seed of all random draws: the same data and seed give the same answer"""


class BallSchema(Shape):
    """The ball of an R-test at one angle."""

    angle_deg: float
    """Angle of the rotary axis [°]"""

    position_mm: list[float]
    """The ball's x, y, z [mm]"""


class BandsRequest(Shape):
    """A range of temperatures over which a set of tables is wanted."""

    from_c: dict[str, float]
    """Temperatures at one end [°C]"""

    to_c: dict[str, float]
    """Temperatures of the same sensors at the other end [°C]"""

    largest_step_um: float
    """So much a component may change from one table to the next [µm; angles µrad]"""


class ComparisonRequest(Shape):
    """Versions to be compared with the same verifications."""

    verifications: list[int] | None = None
    """Numbers of the verifications; all that are stored where it is left out"""

    versions: list[int]
    """Numbers of the versions"""


class CompensationRequest(Shape):
    """The live temperatures for which the table is asked."""

    temperatures_c: dict[str, float]
    """Live temperatures by sensor [°C]"""

    state: dict[str, float] = {}
    """Any numbers that the shop knows of the machine's state"""


class ComponentSchema(Shape):
    """
    One component of a map: a table over positions, or one value.

    Which field carries the numbers follows from the component: linear errors
    `errors_um`, angular errors `errors_urad`, nonrigid slopes `slopes_um_per_m` or
    `slopes_urad_per_m`, squareness `value_um_per_m`, rotary-axis locations
    `value_um` or `value_urad`; a single value may also be called `error_…`, as tables
    have it. What is known of their uncertainty stands beside them
    as standard errors in the same unit, or as a covariance where the errors at different
    positions are not independent of each other.
    """

    component: str
    """ISO 230-1 code (EXX, SXY, EYY^x) or the chapter's notation (D_x(x), S_xy)"""

    positions_mm: list[float] | None = None
    """Positions on the component's axis [mm], strictly increasing"""

    errors_um: list[float] | None = None
    """Linear errors, actual minus nominal [µm]"""

    errors_urad: list[float] | None = None
    """Angular errors [µrad]"""

    slopes_um_per_m: list[float] | None = None
    """Slopes of a linear error [µm/m]"""

    slopes_urad_per_m: list[float] | None = None
    """Slopes of an angular error [µrad/m]"""

    backward_errors_um: list[float] | None = None
    """The errors when approached in the negative direction [µm]"""

    backward_errors_urad: list[float] | None = None
    """The same [µrad]"""

    backward_slopes_um_per_m: list[float] | None = None
    """The same [µm/m]"""

    backward_slopes_urad_per_m: list[float] | None = None
    """The same [µrad/m]"""

    value_um_per_m: float | None = None
    """Squareness [µm/m], E_x = SXY·y"""

    value_um: float | None = None
    """Rotary-axis position error [µm]"""

    value_urad: float | None = None
    """Rotary-axis direction error [µrad]"""

    standard_errors_um: list[float] | None = None
    """Standard error of each error, one standard deviation [µm]"""

    standard_errors_urad: list[float] | None = None
    """The same [µrad]"""

    standard_errors_um_per_m: list[float] | None = None
    """Standard errors of slopes [µm/m]"""

    standard_errors_urad_per_m: list[float] | None = None
    """The same [µrad/m]"""

    backward_standard_errors_um: list[float] | None = None
    """Standard errors of the backward errors [µm]"""

    backward_standard_errors_urad: list[float] | None = None
    """The same [µrad]"""

    backward_standard_errors_um_per_m: list[float] | None = None
    """The same [µm/m]"""

    backward_standard_errors_urad_per_m: list[float] | None = None
    """The same [µrad/m]"""

    standard_error_um_per_m: float | None = None
    """Standard error of a squareness [µm/m]"""

    standard_error_um: float | None = None
    """Standard error of a rotary axis' position [µm]"""

    standard_error_urad: float | None = None
    """Standard error of a rotary axis' direction [µrad]"""

    covariance: list[list[float]] | None = None
    """Covariance of the errors [square of the errors' unit]: instead of standard errors or beside
    them, where the errors are not independent of each other
    """

    backward_covariance: list[list[float]] | None = None
    """Covariance of the backward errors [square of the errors' unit]"""


class ControllerFileSchema(Shape):
    """One file of a controller."""

    name: str
    """Its name"""

    content: str
    """Its text"""


class DiagonalRunsSchema(Shape):
    """Readings along one body diagonal."""

    positions_mm: list[float]
    """Positions along the diagonal [mm]"""

    forward_um: list[float] | list[list[float]]
    """Displacement along the diagonal less its nominal, one run or several [µm]"""

    backward_um: list[float] | list[list[float]] | None = None
    """The same on the way back [µm]"""


class ExportRequest(Shape):
    """What is to be exported: at which temperatures, with which options, over which bands."""

    temperatures_c: dict[str, float] | None = None
    """Temperatures by sensor [°C]; those of the latest reading if left out"""

    state: dict[str, float] = {}
    """Any numbers that the shop knows of the machine's state"""

    tool_offset_mm: list[float] = [0.0, 0.0, 0.0]
    """Tool offset X, Y, Z [mm] at which angular errors are sized"""

    options: dict[str, Any] = {}
    """Options of the format, as `GET /v1/controllers` lists them"""

    bands: BandsRequest | None = None
    """A set of tables over a range of temperatures, for a controller that cannot ask a service;
    other sensors keep `temperatures_c`
    """


class FleetRequest(Shape):
    """What the analysis of every machine is asked."""

    effects: list[str] | None = None
    """Kinds of effects to look for; all of them where it is left out"""

    holdout_fraction: float = 0.3
    """Share of the visits that take no part in the search, below 0.9"""


class HoleSchema(Shape):
    """One hole of a plate."""

    nominal_mm: list[float]
    """Nominal x, y on the plate [mm]"""

    measured_mm: list[float]
    """Measured x, y [mm]"""


class KeyRequest(Shape):
    """A key that is to be made."""

    name: str
    """Whose it is: 1 to 64 letters, digits, dots, hyphens and underscores"""

    role: Literal["sensor", "viewer", "metrologist", "admin"]
    """`sensor` sends readings, `viewer` reads and computes, `metrologist` does both and changes
    models, `admin` makes machines and keys too
    """

    machines: list[str] | None = None
    """Ids of the machines that it is for, one or more; null for all, also those that are made
    later. An admin is for all
    """


class LinesRequest(Shape):
    """Maximal deviations on lines along the axes."""

    linear_um: dict[str, list[float]]
    """Axis to the maximal deviation of positioning on each line along it [µm]"""

    straightness_um: dict[str, float]
    """The maximal deviation of each of the six straightness errors, squareness included [µm]"""


class MachinedPartRequest(Shape):
    """Points along an edge that one axis machined, measured on a coordinate machine."""

    label: str | None = None
    """The map's name"""

    measured_at: AwareDatetime | None = None
    """When it was measured, with a zone"""

    temperatures_c: dict[str, float] | None = None
    """Every sensor's temperature at that time [°C]"""

    instrument: str | None = None
    """What measured"""

    repeatability_um: float | None = None
    """Standard deviation of one reading, where the readings do not show it [µm]"""

    component: str
    """Straightness component: EXY is an edge along y with deviations in x"""

    positions_mm: list[float]
    """Positions along the edge's axis [mm]"""

    measured_um: list[float] | list[list[float]]
    """Actual minus nominal position of the edge, one pass or several [µm]"""

    line: Literal["least-squares", "end-points"] = "least-squares"
    """The line from which straightness counts"""

    measuring_line_mm: list[float] | None = None
    """A point of the machine's path along the edge [mm]"""

    tool_offset_mm: list[float] = [0.0, 0.0, 0.0]
    """Tool offset with which it was cut [mm]"""


class NestReading(Shape):
    """What the nest, the temperature sensors and the control said at one time."""

    time: AwareDatetime
    """When, with a zone"""

    temperatures_c: dict[str, float] = {}
    """Temperatures by sensor at that time [°C]; leave a failed sensor out"""

    state: dict[str, float] = {}
    """Any numbers that the shop knows of the machine's state"""

    position_mm: float | None = None
    """Where the moving axis stood [mm]; of the test linear-axis alone"""

    x_um: float | None = None
    """Displacement of the tool against the workpiece along X, from any zero [µm]"""

    y_um: float | None = None
    """The same along Y [µm]"""

    z_um: float | None = None
    """The same along Z [µm]"""

    x2_um: float | None = None
    """Along X, read sensor_distance_mm further along Z than x_um [µm]"""

    y2_um: float | None = None
    """Along Y, as far from y_um [µm]"""


class ObservationSchema(Shape):
    """Where and when: one component at a position, or a point of the work volume."""

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


class ParseRequest(Shape):
    """Files that are to be read."""

    files: list[ControllerFileSchema]
    """All files of one controller"""

    options: dict[str, Any] = {}
    """Options of the format, as `GET /v1/controllers` lists them"""


class PositioningRequest(Shape):
    """Runs over target positions in both directions."""

    label: str | None = None
    """The map's name"""

    measured_at: AwareDatetime | None = None
    """When it was measured, with a zone"""

    temperatures_c: dict[str, float] | None = None
    """Every sensor's temperature at that time [°C]"""

    instrument: str | None = None
    """What measured"""

    repeatability_um: float | None = None
    """Standard deviation of one reading, where the readings do not show it [µm]"""

    axis: Literal["x", "y", "z"]
    """The axis that was measured"""

    targets_mm: list[float]
    """Target positions [mm]"""

    forward_um: list[float] | list[list[float]]
    """Runs in the positive direction, each with measured minus target position at every target [µm]
    """

    backward_um: list[float] | list[list[float]] | None = None
    """The same in the negative direction [µm]"""


class PredictionRequest(Shape):
    """What is to be predicted, and with which version."""

    observations: list[ObservationSchema]
    """Where and when"""

    model_version: int | None = None
    """Version; the active one if not stated"""

    missing_components: Literal["refuse", "zero"] = "refuse"
    """What happens where the answer needs a component that no two maps have: `refuse` names it,
    `zero` lets it count as zero
    """


class ResidualsRequest(Shape):
    """Which verifications are compared with which version."""

    verifications: list[int] | None = None
    """Numbers of the verifications; all that are stored where it is left out"""

    model_version: int | None = None
    """Version; the active one if not stated"""

    rows: int = 0
    """How many single residuals are shown too; `Accept: text/csv` gives all"""


class RotaryAxisRequest(Shape):
    """Places of a ball that a rotary axis carries."""

    label: str | None = None
    """The map's name"""

    measured_at: AwareDatetime | None = None
    """When it was measured, with a zone"""

    temperatures_c: dict[str, float] | None = None
    """Every sensor's temperature at that time [°C]"""

    instrument: str | None = None
    """What measured"""

    repeatability_um: float | None = None
    """Standard deviation of one reading, where the readings do not show it [µm]"""

    axis: str
    """The rotary axis, A, B or C"""

    points: list[BallSchema]
    """The ball at each angle"""

    pivot_mm: list[float] = [0.0, 0.0, 0.0]
    """A point of the nominal axis [mm]"""


class RotaryErrorRequest(Shape):
    """Points that rotary axes carry, and the axes' angles."""

    temperatures_c: dict[str, float] | None = None
    """Temperatures by sensor [°C]; those of the latest reading if left out"""

    state: dict[str, float] = {}
    """Any numbers that the shop knows of the machine's state"""

    tool_offset_mm: list[float] = [0.0, 0.0, 0.0]
    """Tool offset X, Y, Z [mm]"""

    direction: Literal["+", "-"] | dict[Literal["x", "y", "z"], Literal["+", "-"]] | None = None
    """Direction of approach, of all axes or of each; the mean of both where it is not stated"""

    missing_components: Literal["refuse", "zero"] = "refuse"
    """What happens where the answer needs a component that no two maps have: `refuse` names it,
    `zero` lets it count as zero
    """

    order: str = "AC"
    """Rotary axes from the base outward: in AC the A axis carries the C axis"""

    angles_deg: dict[Literal["A", "B", "C"], list[float]]
    """Rotary axis to its angle, or to a list of one for each point [°]; axes left out stand at 0
    """

    points_mm: list[list[float]]
    """The carried points with all rotary axes at 0, in the machine's directions where the rotary
    axes' base stands still [mm]; one point serves for many angles
    """

    pivots_mm: dict[Literal["A", "B", "C"], list[float]] = {}
    """Rotary axis to a point of its nominal line [mm]; the origin if left out"""

    compensated: dict[str, float] = {}
    """Location errors that the control already knows and follows [µm; µrad]: the answer says what
    is left of the path errors
    """


class SixDofRequest(Shape):
    """Up to six errors of one axis, read together."""

    label: str | None = None
    """The map's name"""

    measured_at: AwareDatetime | None = None
    """When it was measured, with a zone"""

    temperatures_c: dict[str, float] | None = None
    """Every sensor's temperature at that time [°C]"""

    instrument: str | None = None
    """What measured"""

    repeatability_um: float | None = None
    """Standard deviation of one reading, where the readings do not show it [µm]"""

    axis: Literal["x", "y", "z"]
    """The axis that was measured"""

    positions_mm: list[float]
    """Positions on the axis [mm]"""

    linear_um: list[float] | list[list[float]] | None = None
    """Displacement error, one run or several [µm]"""

    straightness_um: dict[str, list[float] | list[list[float]]] = {}
    """Straightness errors in the other directions [µm]"""

    angular_urad: dict[str, list[float] | list[list[float]]] = {}
    """Angular errors about X (a), Y (b), Z (c) [µrad]"""

    backward_linear_um: list[float] | list[list[float]] | None = None
    """The same, approached in the negative direction [µm]"""

    backward_straightness_um: dict[str, list[float] | list[list[float]]] = {}
    """The same of straightness [µm]"""

    backward_angular_urad: dict[str, list[float] | list[list[float]]] = {}
    """The same of angles [µrad]"""

    measuring_line_mm: list[float] | None = None
    """A point of the line on which the reflector moved [mm]"""

    tool_offset_mm: list[float] = [0.0, 0.0, 0.0]
    """Offset of the reflector as a tool [mm]"""

    straightness_line: Literal["as-read", "end-points", "least-squares"] = "as-read"
    """The line that is taken out of the straightness readings"""

    repeatability_urad: float | None = None
    """Standard deviation of one angular reading, if read once [µrad]"""


class StatedReading(Shape):
    """A reading as it is sent: of a sensor that has no value it says so, or nothing."""

    time: AwareDatetime
    """When, with a zone, from the year 1900 on; what lies in the future is not used before its
    time, and refused if it is more than a day ahead
    """

    temperatures_c: dict[str, float | None]
    """Temperatures by sensor [°C]; null for a sensor that has no value: it is named in the status
    at once, until it has one again. A sensor that is left out is missed when its next reading
    should have come
    """

    state: dict[str, float] = {}
    """Any numbers that the shop knows of the machine's state"""


class StepDiagonalRequest(Shape):
    """Readings of a laser along body diagonals, after each single step of x, y and z."""

    label: str | None = None
    """The map's name"""

    measured_at: AwareDatetime | None = None
    """When it was measured, with a zone"""

    temperatures_c: dict[str, float] | None = None
    """Every sensor's temperature at that time [°C]"""

    instrument: str | None = None
    """What measured"""

    repeatability_um: float | None = None
    """Standard deviation of one reading, where the readings do not show it [µm]"""

    origin_mm: list[float]
    """Lowest corner x, y, z of the volume [mm]"""

    step_mm: list[float]
    """Length of a step of x, y and z [mm]"""

    diagonals: dict[str, list[list[float]]]
    """Diagonal (ppp, npp, pnp, ppn) to a row for each step: displacement along the diagonal since
    its start less its nominal, after x, after y, after z [µm]
    """

    line: Literal["end-points", "least-squares"] = "end-points"
    """The line from which straightness counts"""

    tool_offset_mm: list[float] = [0.0, 0.0, 0.0]
    """Tool offset of the target's middle [mm]"""

    target: Literal["point", "flat-mirror"] = "point"
    """What reflects; it decides what known angular errors do"""

    mirror_angle_urad: float | None = None
    """Standard uncertainty of each of the mirror's two tilts [µrad]; what the closures show if left
    out
    """

    angular: list[ComponentSchema] = Field([], validate_default=True)
    """Known angular errors, whose effect is taken out of the readings [µrad]"""


class StepDiagonalSimulation(Shape):
    """A step diagonal that is planned, at stated temperatures or at the latest reading."""

    temperatures_c: dict[str, float] | None = None
    """Temperatures by sensor [°C]; those of the latest reading if left out"""

    state: dict[str, float] = {}
    """Any numbers that the shop knows of the machine's state"""

    tool_offset_mm: list[float] = [0.0, 0.0, 0.0]
    """Tool offset X, Y, Z [mm]"""

    direction: Literal["+", "-"] | dict[Literal["x", "y", "z"], Literal["+", "-"]] | None = None
    """Direction of approach, of all axes or of each; the mean of both where it is not stated"""

    missing_components: Literal["refuse", "zero"] = "refuse"
    """What happens where the answer needs a component that no two maps have: `refuse` names it,
    `zero` lets it count as zero
    """

    steps: int
    """Number of steps of each axis"""

    origin_mm: list[float] | None = None
    """Lowest corner of the volume; the travel's if left out [mm]"""

    step_mm: list[float] | None = None
    """Length of a step of x, y, z; over the whole travel if left out [mm]"""

    target: Literal["point", "flat-mirror"] = "point"
    """What reflects"""

    mirror_tilts_urad: dict[str, list[float]] = {}
    """Diagonal to its mirror's two tilts: about the horizontal and the other direction beside the
    diagonal [µrad]
    """

    noise_um: float = 0.0
    """Standard deviation of one reading [µm]"""

    resolution_um: float | None = None
    """Readings are rounded to multiples of this [µm]"""

    seed: int = 0
    """Of the noise: the same seed gives the same readings"""


class ThermalDriftRequest(Shape):
    """
    A nest of displacement sensors over hours, with the machine's temperatures.

    `measured_at` and `temperatures_c` of the whole are not used: each reading states its own.
    """

    label: str | None = None
    """The map's name"""

    measured_at: AwareDatetime | None = None
    """When it was measured, with a zone"""

    temperatures_c: dict[str, float] | None = None
    """Every sensor's temperature at that time [°C]"""

    instrument: str | None = None
    """What measured"""

    repeatability_um: float | None = None
    """Standard deviation of one reading, where the readings do not show it [µm]"""

    test: Literal["environment", "spindle", "linear-axis"]
    """`environment` (nothing moves: ETVE), `spindle` (it turns), `linear-axis` (an axis runs
    between targets)
    """

    readings: list[NestReading]
    """Two or more, in order of time; all with the same displacements"""

    axis: Literal["x", "y", "z"] | None = None
    """The moving axis, of the test linear-axis"""

    sensor_distance_mm: float | None = None
    """How far along Z x2_um and y2_um are read from x_um and y_um, with its sign [mm]; with them
    come the tilts A and B
    """

    running_from: AwareDatetime | None = None
    """Since when the spindle turned or the axis moved; from the state spindle_rpm where left out,
    else from the first reading
    """

    running_to: AwareDatetime | None = None
    """Until when; as running_from"""

    point_mm: list[float] | None = None
    """Where the machine stood while the nest was read [mm]; tables and verifications of
    displacements need it
    """

    tool_offset_mm: list[float] = [0.0, 0.0, 0.0]
    """Offset, as a tool, of the place that x, y and z read [mm]"""

    components: dict[str, str] = {}
    """Displacement (x, y, z) or tilt (a, b) to the component as which it counts in maps and in the
    verification; those of the moving axis, or of the axis that carries the spindle, where left out
    """

    states_min: list[float] | None = None
    """Thermal states of which maps are made, after the first reading [min]; the first reading and
    the end of running where left out
    """


class TriedEffectRequest(Shape):
    """An effect that an analysis found, and the machine on which it is tried."""

    machine: str
    """The machine on which it was found"""

    analysis: int
    """Number of the analysis that found it"""

    effect: int
    """Which of its effects, from 0"""

    on: str
    """The machine on which it is tried, with its active model"""

    verifications: list[int]
    """Numbers of that machine's verifications"""

    tried_together: int = 1
    """Number of machines on which effects are tried in all: thresholds rise with it"""


class VolumetricErrorRequest(Shape):
    """Points at which the volumetric error is asked."""

    temperatures_c: dict[str, float] | list[dict[str, float]] | None = None
    """Temperatures by sensor [°C], or a list of them for several thermal states; those of the
    latest reading if left out
    """

    state: dict[str, float] = {}
    """Any numbers that the shop knows of the machine's state"""

    tool_offset_mm: list[float] = [0.0, 0.0, 0.0]
    """Tool offset X, Y, Z [mm]"""

    direction: Literal["+", "-"] | dict[Literal["x", "y", "z"], Literal["+", "-"]] | None = None
    """Direction of approach, of all axes or of each; the mean of both where it is not stated"""

    missing_components: Literal["refuse", "zero"] = "refuse"
    """What happens where the answer needs a component that no two maps have: `refuse` names it,
    `zero` lets it count as zero
    """

    points_mm: list[list[float]]
    """Nominal points x, y, z [mm]"""

    outside_travel: Literal["refuse", "allow"] = "refuse"
    """What happens to points outside the axes' travel: `refuse` names the first, `allow` answers
    and flags them
    """


class AccuracyRequest(Shape):
    """At which temperatures, with which tool, in which volume."""

    temperatures_c: dict[str, float] | None = None
    """Temperatures by sensor [°C]; those of the latest reading if left out"""

    state: dict[str, float] = {}
    """Any numbers that the shop knows of the machine's state"""

    tool_offset_mm: list[float] = [0.0, 0.0, 0.0]
    """Tool offset X, Y, Z [mm]"""

    direction: Literal["+", "-"] | dict[Literal["x", "y", "z"], Literal["+", "-"]] | None = None
    """Direction of approach, of all axes or of each; the mean of both where it is not stated"""

    missing_components: Literal["refuse", "zero"] = "refuse"
    """What happens where the answer needs a component that no two maps have: `refuse` names it,
    `zero` lets it count as zero
    """

    volume: dict[str, TravelSchema] = Field({}, validate_default=True)
    """Range of each axis [mm]; its travel where it is left out"""


class BodyDiagonalRequest(Shape):
    """Readings along the four body diagonals (ISO 230-6)."""

    label: str | None = None
    """The map's name"""

    measured_at: AwareDatetime | None = None
    """When it was measured, with a zone"""

    temperatures_c: dict[str, float] | None = None
    """Every sensor's temperature at that time [°C]"""

    instrument: str | None = None
    """What measured"""

    repeatability_um: float | None = None
    """Standard deviation of one reading, where the readings do not show it [µm]"""

    diagonals: dict[str, DiagonalRunsSchema]
    """Readings of each diagonal: ppp, npp, pnp, ppn"""

    volume: dict[str, TravelSchema] = Field({}, validate_default=True)
    """Range of each axis [mm]; its travel where it is left out"""


class CompareRequest(Shape):
    """Files that are compared with what they should hold, at which temperatures."""

    temperatures_c: dict[str, float] | None = None
    """Temperatures by sensor [°C]; those of the latest reading if left out"""

    state: dict[str, float] = {}
    """Any numbers that the shop knows of the machine's state"""

    tool_offset_mm: list[float] = [0.0, 0.0, 0.0]
    """Tool offset X, Y, Z [mm] at which angular errors are sized"""

    options: dict[str, Any] = {}
    """Options of the format, as `GET /v1/controllers` lists them"""

    files: list[ControllerFileSchema]
    """All files of one controller"""


class DrilledPlateRequest(Shape):
    """The holes of a plate, measured on a coordinate machine."""

    label: str | None = None
    """The map's name"""

    measured_at: AwareDatetime | None = None
    """When it was measured, with a zone"""

    temperatures_c: dict[str, float] | None = None
    """Every sensor's temperature at that time [°C]"""

    instrument: str | None = None
    """What measured"""

    repeatability_um: float | None = None
    """Standard deviation of one reading, where the readings do not show it [µm]"""

    holes: list[HoleSchema]
    """Nominal and measured places of the holes"""

    origin_mm: list[float] | None = None
    """Machine position at the plate's nominal zero [mm]"""

    tool_offset_mm: list[float] = [0.0, 0.0, 0.0]
    """Tool offset with which it was drilled [mm]"""

    expansion_um_per_m_k: float = 0.0
    """The plate's coefficient of expansion, per K [µm/m]"""

    drilled_minus_measured_c: float = 0.0
    """The plate's temperature when drilled minus when measured [°C]"""


class ErrorMapSchema(Shape):
    """All components measured in one thermal state."""

    label: str
    """The map's name on its machine"""

    measured_at: AwareDatetime
    """When it was measured, with a zone"""

    temperatures_c: dict[str, float]
    """Every sensor's temperature at that time [°C]"""

    components: list[ComponentSchema]
    """The measured components"""

    measuring_lines_mm: dict[str, list[float] | MeasuringLineSchema] = Field(
        {}, validate_default=True
    )
    """Axis to the line along which its translations were measured: a point (x, y, z) of it [mm], or
    that point with the tool offset
    """

    repeatability_um: float | None = None
    """Repeatability of the measurement, one standard deviation [µm]"""

    instrument: str | None = None
    """What measured"""


class GridRequest(Shape):
    """The nodes of a grid, or the tolerance that an evenly spaced grid is to keep."""

    temperatures_c: dict[str, float] | None = None
    """Temperatures by sensor [°C]; those of the latest reading if left out"""

    state: dict[str, float] = {}
    """Any numbers that the shop knows of the machine's state"""

    tool_offset_mm: list[float] = [0.0, 0.0, 0.0]
    """Tool offset X, Y, Z [mm]"""

    direction: Literal["+", "-"] | dict[Literal["x", "y", "z"], Literal["+", "-"]] | None = None
    """Direction of approach, of all axes or of each; the mean of both where it is not stated"""

    missing_components: Literal["refuse", "zero"] = "refuse"
    """What happens where the answer needs a component that no two maps have: `refuse` names it,
    `zero` lets it count as zero
    """

    volume: dict[str, TravelSchema] = Field({}, validate_default=True)
    """Range of each axis [mm]; its travel where it is left out"""

    x_mm: list[float] | None = None
    """Coordinates of the nodes along x [mm]"""

    y_mm: list[float] | None = None
    """Coordinates of the nodes along y [mm]"""

    z_mm: list[float] | None = None
    """Coordinates of the nodes along z [mm]"""

    tolerance_um: float | None = None
    """Instead of nodes: largest length of the difference between trilinear interpolation and model,
    for which the coarsest even grid is found [µm]
    """


class LevelsRequest(Shape):
    """The same, with the size of the lattice of points that is looked at."""

    temperatures_c: dict[str, float] | None = None
    """Temperatures by sensor [°C]; those of the latest reading if left out"""

    state: dict[str, float] = {}
    """Any numbers that the shop knows of the machine's state"""

    tool_offset_mm: list[float] = [0.0, 0.0, 0.0]
    """Tool offset X, Y, Z [mm]"""

    direction: Literal["+", "-"] | dict[Literal["x", "y", "z"], Literal["+", "-"]] | None = None
    """Direction of approach, of all axes or of each; the mean of both where it is not stated"""

    missing_components: Literal["refuse", "zero"] = "refuse"
    """What happens where the answer needs a component that no two maps have: `refuse` names it,
    `zero` lets it count as zero
    """

    volume: dict[str, TravelSchema] = Field({}, validate_default=True)
    """Range of each axis [mm]; its travel where it is left out"""

    points_per_axis: int = 11
    """Number of points along each axis of an even lattice over the volume"""


class MachinePatch(Shape):
    """The settings to change; lists are replaced whole, axes one by one (RFC 7396)."""

    name: str | None = None
    """Name for people"""

    serial_number: str | None = None
    """Serial number; null removes it"""

    configuration: str | None = None
    """Kinematic chain"""

    axes: dict[str, TravelSchema | None] | None = None
    """Travels to change [mm]; null removes one"""

    sensors: list[SensorSchema] | None = None
    """All sensors, replacing the old"""

    out_of_range: Literal["clamp", "extrapolate", "reject"] | None = None
    """Policy outside the maps"""

    extrapolation_margin_c: float | None = None
    """How far `extrapolate` may go [°C]"""

    extrapolation_error_ratio: float | None = None
    """How uncertain `extrapolate` may become, in times of the maps' own"""

    same_temperature: Literal["refuse", "mean"] | None = None
    """Policy for maps at one temperature"""


class MachineSettings(Shape):
    """A machine's description as a user states it."""

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


class PictureRequest(Shape):
    """At which temperatures the work volume is drawn, and how."""

    temperatures_c: dict[str, float] | None = None
    """Temperatures by sensor [°C]; those of the latest reading if left out"""

    state: dict[str, float] = {}
    """Any numbers that the shop knows of the machine's state"""

    tool_offset_mm: list[float] = [0.0, 0.0, 0.0]
    """Tool offset X, Y, Z [mm]"""

    direction: Literal["+", "-"] | dict[Literal["x", "y", "z"], Literal["+", "-"]] | None = None
    """Direction of approach, of all axes or of each; the mean of both where it is not stated"""

    missing_components: Literal["refuse", "zero"] = "refuse"
    """What happens where the answer needs a component that no two maps have: `refuse` names it,
    `zero` lets it count as zero
    """

    volume: dict[str, TravelSchema] = Field({}, validate_default=True)
    """Range of each axis [mm]; its travel where it is left out"""

    exaggeration: float | None = None
    """How many times larger than they are errors are drawn; chosen if left out (without a unit)
    """

    arrows_per_axis: int = 5
    """Number of error vectors along each axis"""


class PlanRequest(Shape):
    """What is to be measured, and which stored verifications would be analysed beside it."""

    planned: list[PlannedVerification] = Field([], validate_default=True)
    """What is to be measured, visit by visit"""

    verifications: list[int] = []
    """Numbers of stored verifications"""


class VerificationRequest(Shape):
    """Up to 100,000 observations of one machine, with one set-up or several."""

    label: str
    """The verification's name on its machine"""

    datum: Literal["absolute", "first", "free"] = "absolute"
    """`absolute`; `first`: the instrument was zeroed at the first observation of each component;
    `free`: an unknown constant per component
    """

    repeatability_um: float | None = None
    """Standard deviation of one length [µm], where it is known; of angles and squareness it says
    nothing
    """

    instrument: str | None = None
    """What measured, for the certificate"""

    operator: str | None = None
    """Who measured, for the certificate"""

    observations: list[MeasuredObservation]
    """What was measured"""
