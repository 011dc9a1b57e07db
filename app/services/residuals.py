"""What model versions leave of stored verifications, with the readings around them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from typing import Annotated, Final

import numpy as np
from pydantic import Field, InstanceOf
from sqlalchemy.orm import Session

from app.answer import Answer
from app.arrays import BoolArray
from app.effects.observations import Verification
from app.effects.past import needed_past
from app.effects.projection import Projection
from app.errors import InvalidContent, expect_each_once
from app.identification.analysis.residual_report import (
    ResidualFigures,
    ResidualReport,
    Size,
    residual_report,
)
from app.identification.campaign import Campaign, residuals_of
from app.identification.observed_scatter import observed_scatter
from app.identification.residuals.residuals import Residuals
from app.rounding import Micro
from app.services.change_model import choose_version
from app.services.context import Context
from app.services.load_machine import adopted_effects, compile_version
from app.stated import Integer, Schema
from app.storage.readings import list_readings, newest_time
from app.storage.records import ModelVersion
from app.storage.verifications import find_verification, list_verifications, read_verification
from app.thermal.machine import Machine
from app.thermal.sensor_health import record_needed_s
from app.thermal.temperature_history import TemperatureHistory

SEARCHED_BACK: Final = timedelta(days=3)
"""Readings before the first observation that a search takes in: an effect with a time constant
needs five of them."""


VerificationIds = Annotated[list[Integer], Field(min_length=1, max_length=10_000)]
"""Numbers of verifications."""

ChosenVerifications = Annotated[
    VerificationIds | None,
    Field(description="Numbers of the verifications; all that are stored where it is left out"),
]


MOST_ROWS: Final = 10_000


class ResidualsRequest(Schema, example={"verifications": [1, 2], "rows": 100}):
    """Which verifications are compared with which version."""

    verifications: ChosenVerifications = None
    model_version: Integer | None = Field(None, description="Version; the active one if not stated")
    rows: Annotated[Integer, Field(ge=0, le=MOST_ROWS)] = Field(
        0, description="How many single residuals are shown too; `Accept: text/csv` gives all"
    )


class ComparisonRequest(Schema, example={"verifications": [1, 2], "versions": [3, 4]}):
    """Versions to be compared with the same verifications."""

    verifications: ChosenVerifications = None
    versions: Annotated[list[Integer], Field(min_length=1, max_length=20)] = Field(
        description="Numbers of the versions"
    )


def chosen_verifications(
    session: Session, machine_id: str, verification_ids: Sequence[int] | None
) -> Sequence[int]:
    """Give the numbers of the verifications that are meant; None: of all that are stored.

    Raises
    ------
    InvalidContent
        If one is named twice, or all are meant and there is none.
    """
    if verification_ids is not None:
        expect_each_once("verifications", verification_ids)
        return verification_ids
    stored = [verification.id for verification in list_verifications(session, machine_id)]
    if not stored:
        raise InvalidContent.of_field(
            "verifications",
            f"expected numbers of verifications, or that machine {machine_id!r} has some: "
            "left out, they are all that are stored, and there is none yet",
        )
    return stored


def read_verifications(
    session: Session, machine_id: str, verification_ids: Sequence[int]
) -> list[Verification]:
    """Read verifications with their observations; UnknownThing if one is not there."""
    rows = (find_verification(session, machine_id, i, observations=True) for i in verification_ids)
    return [read_verification(row) for row in rows]


def load_campaign(
    session: Session,
    machine: Machine,
    version: ModelVersion,
    verifications: Sequence[Verification],
    until: datetime,
    *,
    searching: bool = False,
    recorded: tuple[datetime, datetime] | None = None,
) -> Campaign:
    """Set verifications beside a model version and what was recorded.

    Parameters
    ----------
    until
        The latest time at which a reading can have been measured: later ones do not count yet.
    searching
        Whether effects are looked for: that takes more of the past than the effects that
        the version has adopted.
    recorded
        From when to when readings are needed; around the observations where nothing is stated.

    Raises
    ------
    InvalidContent, Conflict
        As `compile_version`.
    """
    effects = adopted_effects(version)
    around = timedelta(seconds=record_needed_s(machine.sensors.values()))
    past = max(around, timedelta(seconds=needed_past(effects).record_s))
    if searching:
        past = max(past, SEARCHED_BACK)
    first, last = recorded or first_and_last(verifications)
    readings = [
        (r.time.timestamp(), r)
        for r in list_readings(session, machine.id, first - past, min(last + around, until))
    ]
    return Campaign(
        model=compile_version(machine, version),
        maps=[stored.error_map for stored in version.maps],
        verifications=verifications,
        readings=TemperatureHistory.of_readings(
            machine.sensors, [(time_s, r.temperatures_c) for time_s, r in readings]
        ),
        state_readings=[(time_s, r.state) for time_s, r in readings],
        older_readings=newest_time(session, machine.id, first - past) is not None,
        effects=effects,
    )


def first_and_last(verifications: Sequence[Verification]) -> tuple[datetime, datetime]:
    """Give the times of the first and the last observation."""
    times_s = [o.time_s for v in verifications for o in v.observations]
    return datetime.fromtimestamp(min(times_s), UTC), datetime.fromtimestamp(max(times_s), UTC)


@dataclass(frozen=True, slots=True, eq=False)
class ShownResiduals:
    """The residuals, of which version and which verifications."""

    model_version: int
    verification_ids: Sequence[int]
    verifications: Sequence[Verification]
    report: ResidualReport


@dataclass(frozen=True, slots=True)
class ResidualRow(Answer):
    """One measured number, compared with the model."""

    verification: int
    """Number of the verification"""
    observation: int
    """Place of the observation in it, from 0"""
    time: datetime
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
    direction: Annotated[str, Field(examples=["+", "+0-"])]
    """Approach: `+`, `-`, or `0` where not stated; at points of x, y and z"""
    measured: float
    """Measured [µm; angular components µrad, squareness µm/m]"""
    predicted: Micro
    """Predicted, adopted effects included [µm; angular components µrad, squareness µm/m]"""
    residual: Micro
    """Measured minus predicted. Where the instrument was zeroed, less the residual of its set-up's
    first observation; where the zero is not known, less the mean [µm; angular components µrad,
    squareness µm/m]"""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ResidualsAnswer(ResidualFigures):
    """What a model version leaves of verifications."""

    model_version: int
    """Version that they were compared with"""
    verifications: Sequence[int]
    """Numbers of the verifications"""
    counted_as_zero: Annotated[Sequence[str], Field(examples=[["ECZ"]])]
    """Components that residuals at points need, that no two maps have and that count as zero: these
    residuals contain them whole"""
    rows: Sequence[ResidualRow]
    """Single residuals, as many as were asked for"""


def show_residuals(
    context: Context,
    machine_id: str,
    verification_ids: Sequence[int] | None,
    version_number: int | None = None,
) -> ShownResiduals:
    """Subtract what a version says, the active one if none is stated, from what was measured.

    With None in place of numbers it is subtracted from all verifications that are stored.

    Raises
    ------
    InvalidContent
        If nothing can be compared with the model, or values are evidently in another unit.
    Conflict
        If the machine has no model yet.
    """
    with context.database.reading() as session:
        machine, stored = choose_version(session, machine_id, version_number)
        chosen = chosen_verifications(session, machine_id, verification_ids)
        verifications = read_verifications(session, machine_id, chosen)
        until = context.usable_until()
        campaign = load_campaign(session, machine, stored, verifications, until)
    residuals = residuals_of_version(stored.version, campaign)
    report = residual_report(residuals, observed_scatter(campaign, residuals))
    return ShownResiduals(stored.version, chosen, verifications, report)


def residuals_of_version(version: int, campaign: Campaign) -> Residuals:
    """Subtract what a version says; a refusal names the version."""
    try:
        return residuals_of(campaign)
    except InvalidContent as error:
        raise type(error)(f"model version {version}: {error.detail}", error.errors) from None


@dataclass(frozen=True, slots=True, eq=False)
class ComparedVersion(Answer, published_as="ComparedVersionAnswer"):
    """One version, on the values that can be compared with all of them."""

    version: int
    """Number of the version"""
    reason: str
    """What made it"""
    active: bool
    """Whether tables are computed with it now"""
    overall: Size | None
    """All lengths; null where nothing is one"""
    components: Sequence[Size]
    """Each component in its own unit"""
    contradiction: str | None
    """What is said of a stated repeatability that nearly all lengths contradict, as in an analysis:
    the figures rest on what they show; null where nothing is contradicted"""
    report: Annotated[InstanceOf[ResidualReport], Field(exclude=True)]


@dataclass(frozen=True, slots=True, eq=False)
class ModelComparison(Answer, published_as="ModelComparisonAnswer"):
    """Versions side by side, in the order in which they were named."""

    verifications: Sequence[int]
    """Numbers of the verifications"""
    values: int
    """Values that can be compared with all versions"""
    versions: Sequence[ComparedVersion]
    """The versions"""


def compare_models(
    context: Context,
    machine_id: str,
    verification_ids: Sequence[int] | None,
    versions: Sequence[int],
) -> ModelComparison:
    """Compare versions on the observations that every one of them can be held against.

    Where None is stated these are those of all verifications that are stored.

    Raises
    ------
    InvalidContent
        If a version or a verification is named twice, or nothing is common to all versions.
    """
    expect_each_once("versions", versions)
    with context.database.reading() as session:
        machine, active = choose_version(session, machine_id)
        chosen = chosen_verifications(session, machine_id, verification_ids)
        verifications = read_verifications(session, machine_id, chosen)
        stored = [choose_version(session, machine_id, number)[1] for number in versions]
        until = context.usable_until()
        campaigns = [load_campaign(session, machine, v, verifications, until) for v in stored]
    residuals = [residuals_of_version(n, c) for n, c in zip(versions, campaigns, strict=True)]
    common = np.logical_and.reduce([r.kept for r in residuals])
    if not common.any():
        raise InvalidContent.of_field(
            "versions", "expected observations that all versions can be held against, got none"
        )
    reports = [
        residual_report(_restricted(own, common), observed_scatter(campaign, own))
        for own, campaign in zip(residuals, campaigns, strict=True)
    ]
    compared = [
        ComparedVersion(
            version.version,
            version.reason,
            version.version == active.version,
            report.overall,
            report.components,
            report.contradiction,
            report,
        )
        for version, report in zip(stored, reports, strict=True)
    ]
    return ModelComparison(chosen, reports[0].count, compared)


def _restricted(residuals: Residuals, common: BoolArray) -> Residuals:
    """Keep the rows, numbered among all, that are common to all versions."""
    is_common: BoolArray = common[residuals.kept]
    before = residuals.projection
    at = np.flatnonzero(is_common)
    return replace(
        residuals,
        projection=Projection(
            before.model, before.rows.take(is_common), before.conditions.take(at)
        ),
        predicted=residuals.predicted[is_common],
        kept=common,
    )
