"""Analyses: plan and request them, read, report, cancel and delete them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Annotated, Final

from pydantic import Field
from sqlalchemy.orm import Session

from app.answer import fields_of
from app.effects.effect import Effect
from app.effects.observations import Verification
from app.effects.registry import explain, kind_of
from app.errors import (
    Conflict,
    InvalidContent,
    MachineQueueFull,
    QueueFull,
    UnknownThing,
    existing_names,
    expect_each_once,
)
from app.identification.analysis.analysis import Analysis
from app.identification.analysis.found_effect import FoundEffect
from app.identification.analysis.tried_effect import TriedEffect, try_effect
from app.identification.plan.plan import Plan
from app.identification.plan.planning import plan
from app.services.change_model import choose_version
from app.services.context import Context, QueueLimits, repeated
from app.services.events import note_analysis
from app.services.load_machine import adopted_effects
from app.services.observations import Planned
from app.services.residuals import (
    SEARCHED_BACK,
    ChosenVerifications,
    VerificationIds,
    chosen_verifications,
    first_and_last,
    load_campaign,
    read_verifications,
)
from app.services.verifications import check_places
from app.stated import Integer, Name, Number, Schema
from app.storage.analyses import cancel_analysis as cancel_stored
from app.storage.analyses import (
    count_waiting,
    find_analysis,
    insert_analysis,
    list_analyses,
    stored_analysis,
)
from app.storage.analysis_results import RESULTS, AnalysisWithResult
from app.storage.job_queue import hand_out
from app.storage.machines import RowLock, find_machine, stored_machine
from app.storage.model_versions import find_version
from app.storage.readings import newest_time
from app.storage.records import (
    LARGEST_INTEGER,
    AnalysisStatus,
    AnalysisTask,
    StoredAnalysis,
)
from app.storage.verifications import find_verification, list_verifications

MOST_PLANNED: Final = 20_000
"""Observations in one plan."""

STANDING_IN: Final = timedelta(days=14)
"""Recorded days that stand for days to come, back from the newest reading."""


class AnalysisRequest(Schema, example={"verifications": [1, 2, 3], "holdout_fraction": 0.3}):
    """What the active model is compared with, and which effects are looked for."""

    verifications: ChosenVerifications = None
    holdout_fraction: Annotated[Number, Field(gt=0.0, lt=0.9)] = Field(
        0.3, description="Share of the visits that take no part in the search, below 0.9"
    )
    effects: Annotated[list[str], Field(min_length=1, max_length=100)] | None = Field(
        None,
        description="Kinds of effects to look for; all of them where it is left out. Without "
        "`other-sensor` no sensor is proposed for a component",
        examples=[["thermal-lag", "backlash"]],
    )
    seed: Annotated[Integer, Field(ge=0, le=LARGEST_INTEGER)] = Field(
        0, description="Seed of all random draws: the same data and seed give the same answer"
    )


class PlanRequest(
    Schema,
    example={
        "planned": [
            {
                "observations": [
                    {"time": "2026-03-09T06:00:00Z", "component": "EXX", "position_mm": 250}
                ]
            }
        ]
    },
):
    """What is to be measured, and which stored verifications would be analysed beside it."""

    planned: Annotated[Planned, Field(max_length=1000)] = Field(
        default_factory=list, description="What is to be measured, visit by visit"
    )
    verifications: Annotated[list[Integer], Field(max_length=10_000)] = Field(
        default_factory=list, description="Numbers of stored verifications"
    )


class TriedEffectRequest(
    Schema,
    example={
        "machine": "vmc-1",
        "analysis": 3,
        "effect": 0,
        "on": "vmc-2",
        "verifications": [1, 2, 3],
        "tried_together": 4,
    },
):
    """An effect that an analysis found, and the machine on which it is tried."""

    machine: Name = Field(description="The machine on which it was found")
    analysis: Integer = Field(description="Number of the analysis that found it")
    effect: Annotated[Integer, Field(ge=0, le=LARGEST_INTEGER)] = Field(
        description="Which of its effects, from 0"
    )
    on: Name = Field(description="The machine on which it is tried, with its active model")
    verifications: VerificationIds = Field(description="Numbers of that machine's verifications")
    tried_together: Annotated[Integer, Field(ge=1, le=LARGEST_INTEGER)] = Field(
        1,
        description="Number of machines on which effects are tried in all: thresholds rise with it",
    )


def plan_analysis(context: Context, machine_id: str, request: PlanRequest) -> Plan:
    """Plan an analysis of the active version; times to come are planned on recorded days.

    Raises
    ------
    InvalidContent
        If nothing is planned or too much, a position is outside the axis' travel, or nothing
        recorded can be planned on.
    Conflict
        If the machine has no model yet.
    """
    with context.database.reading() as session:
        machine, version = choose_version(session, machine_id)
        for i, verification in enumerate(request.planned):
            try:
                check_places(machine, verification.observations)
            except InvalidContent as error:
                raise error.inside(f"planned.{i}") from None
        stored = read_verifications(session, machine_id, request.verifications)
        every = [*stored, *request.planned]
        count = sum(len(v.observations) for v in every)
        if not 0 < count <= MOST_PLANNED:
            raise InvalidContent.of_field(
                "planned", f"expected 1 to {MOST_PLANNED} observations in all, got {count}"
            )
        until = context.usable_until()
        recorded = _recorded_days(session, machine_id, every, until)
        campaign = load_campaign(
            session, machine, version, every, until, searching=True, recorded=recorded
        )
    return plan(campaign, version.version)


def _recorded_days(
    session: Session, machine_id: str, planned: Sequence[Verification], until: datetime
) -> tuple[datetime, datetime] | None:
    """Choose the days that stand for days to come; None where all is in the past."""
    newest = newest_time(session, machine_id, until)
    first, last = first_and_last(planned)
    if newest is None or last <= newest:
        return None
    return min(first, newest - STANDING_IN + SEARCHED_BACK), newest


@repeated
def request_analysis(context: Context, machine_id: str, request: AnalysisRequest) -> StoredAnalysis:
    """Put an analysis of the active model version at the end of the queue.

    Raises
    ------
    InvalidContent
        If there is no such kind of effect, a kind or a verification is named twice, or all
        verifications are meant and there is none.
    Conflict
        If the machine has no model yet.
    MachineQueueFull, QueueFull
        If as many analyses wait as may, of the machine or in all.
    """
    kinds = request.effects
    for kind in kinds or ():
        kind_of(kind)
    expect_each_once("effects", kinds or ())
    with context.database.writing() as session:
        find_machine(session, machine_id, RowLock.CHANGED)
        _, version = choose_version(session, machine_id)
        chosen = chosen_verifications(session, machine_id, request.verifications)
        for verification_id in chosen:
            find_verification(session, machine_id, verification_id)
        task = AnalysisTask(version.version, chosen, request.holdout_fraction, kinds, request.seed)
        return queue_analysis(context, session, machine_id, task)


def queue_analysis(
    context: Context, session: Session, machine_id: str, task: AnalysisTask
) -> StoredAnalysis:
    """Put what was checked at the end of the queue, in a transaction that locks the machine.

    Raises
    ------
    MachineQueueFull, QueueFull
        If as many analyses wait as may, of the machine or in all.
    """
    _expect_room(session, machine_id, context.queue_limits)
    queued = insert_analysis(session, machine_id, task, context.now())
    hand_out(session, queued.id, machine_id)
    note_analysis(session, machine_id, queued.id, queued.status, context.now())
    return queued


def try_found_effect(context: Context, request: TriedEffectRequest) -> TriedEffect:
    """Hold an effect that was found on one machine, as it stands, against another one.

    Raises
    ------
    InvalidContent
        If a verification is named twice, or the machine is the one on which it was found.
    Conflict
        If the analysis has no result, or the machine no model yet.
    """
    found_on, analysis_id, place = request.machine, request.analysis, request.effect
    expect_each_once("verifications", request.verifications)
    if request.on == found_on:
        raise InvalidContent.of_field(
            "on", f"expected a machine other than {found_on!r}, on which it was found, got the same"
        )
    with context.database.reading() as session:
        find_machine(session, found_on)
        row = find_analysis(session, found_on, analysis_id, result=True)
        if row.result is None:
            raise Conflict(f"analysis {analysis_id} has found nothing yet: it is {row.status}")
        effects = RESULTS.read_text(row.result).effects
        if place >= len(effects):
            existing = existing_names(str(i) for i in range(len(effects)))
            raise UnknownThing(f"analysis {analysis_id} has no effect {place}; {existing}")
        machine, version = choose_version(session, request.on)
        verifications = read_verifications(session, request.on, request.verifications)
        campaign = load_campaign(
            session, machine, version, verifications, context.usable_until(), searching=True
        )
    return try_effect(campaign, effects[place].effect, request.tried_together)


def _expect_room(session: Session, machine_id: str, limits: QueueLimits) -> None:
    """Refuse what would wait behind more than may wait."""
    here, in_all = count_waiting(session, machine_id)
    if here >= limits.machine:
        raise MachineQueueFull(
            f"expected at most {limits.machine} waiting analyses of machine {machine_id!r}, and "
            "that many are waiting: try again when one is done, or cancel one"
        )
    if in_all >= limits.all:
        raise QueueFull(
            f"expected at most {limits.all} waiting analyses, and {in_all} are waiting: try "
            "again later"
        )


def show_analyses(context: Context, machine_id: str) -> list[StoredAnalysis]:
    """List a machine's analyses without their results, oldest first."""
    with context.database.reading() as session:
        find_machine(session, machine_id)
        return list_analyses(session, machine_id)


def show_analysis(context: Context, machine_id: str, analysis_id: int) -> AnalysisWithResult:
    """Read one analysis, and its result where it is done."""
    with context.database.reading() as session:
        find_machine(session, machine_id)
        row = find_analysis(session, machine_id, analysis_id, result=True)
        head = stored_analysis(row)
        result = None if row.result is None else RESULTS.read_text(row.result)
        return AnalysisWithResult(**fields_of(head), result=result)


@dataclass(frozen=True, slots=True)
class ReportHead:
    """Which machine was analysed, with what, and when.

    Parameters
    ----------
    chain
        Order of its axes, such as `XYFZ`.
    model_version
        The version that the observations were held against.
    analysed_at
        When the analysis was done, with its zone.
    seed
        Of its draws: the same seed gives the same answer.
    adopted_version
        The model version that its effects made; None where none was adopted.
    instruments, operators
        That the verifications name.
    measured
        When their first and their last value were; None where all are deleted.
    had, adopted
        The effects that the analysed version had already, and those of this analysis that
        were adopted: a sentence each.
    """

    machine_id: str
    machine_name: str
    chain: str
    model_version: int
    verifications: Sequence[str]
    analysed_at: datetime
    seed: int
    adopted_version: int | None = None
    analysis_id: int = 0
    serial_number: str | None = None
    instruments: Sequence[str] = ()
    operators: Sequence[str] = ()
    measured: tuple[datetime, datetime] | None = None
    had: Sequence[str] = ()
    adopted: Sequence[str] = ()


def report_analysis(
    context: Context, machine_id: str, analysis_id: int
) -> tuple[ReportHead, Analysis]:
    """Read an analysis that is done, with what its report says beside the result.

    Raises
    ------
    Conflict
        If it has no result.
    """
    with context.database.reading() as session:
        machine = stored_machine(find_machine(session, machine_id)).machine
        row = find_analysis(session, machine_id, analysis_id, result=True)
        if row.result is None or row.finished_at is None:
            raise Conflict(f"analysis {analysis_id} has nothing to report: it is {row.status}")
        stored = {v.id: v for v in list_verifications(session, machine_id)}
        there = [stored[i] for i in row.verification_ids if i in stored]
        result = RESULTS.read_text(row.result)
        head = ReportHead(
            machine_id=machine.id,
            machine_name=machine.name,
            chain=machine.chain.text,
            model_version=row.model_version,
            verifications=[
                stored[i].label if i in stored else f"number {i}, deleted"
                for i in row.verification_ids
            ],
            analysed_at=row.finished_at,
            seed=row.seed,
            adopted_version=row.adopted_version,
            analysis_id=row.id,
            serial_number=machine.serial_number,
            instruments=list(dict.fromkeys(v.instrument for v in there if v.instrument)),
            operators=list(dict.fromkeys(v.operator for v in there if v.operator)),
            measured=(
                (min(v.first_at for v in there), max(v.last_at for v in there)) if there else None
            ),
            had=[explain(e) for e in _effects_of(session, machine_id, row.model_version)],
            adopted=_adopted(session, machine_id, row.adopted_version, result.effects),
        )
    return head, result


def _effects_of(session: Session, machine_id: str, version: int | None) -> Sequence[Effect]:
    """List the effects that a model version has adopted."""
    if version is None:
        return ()
    return adopted_effects(find_version(session, machine_id, version))


def _adopted(
    session: Session, machine_id: str, version: int | None, candidates: Sequence[FoundEffect]
) -> list[str]:
    """Say which of the effects found are in the version that was made of them."""
    adopted = _effects_of(session, machine_id, version)
    return [explain(effect.effect) for effect in candidates if effect.effect in adopted]


@repeated
def cancel_analysis(context: Context, machine_id: str, analysis_id: int) -> StoredAnalysis:
    """Cancel an analysis that waits or runs; whoever runs it ends its process.

    Raises
    ------
    Conflict
        If it has an answer already, or failed.
    """
    with context.database.writing() as session:
        find_machine(session, machine_id)
        row = find_analysis(session, machine_id, analysis_id)
        cancelled = cancel_stored(session, analysis_id, context.now())
        session.refresh(row)
        analysis = stored_analysis(row)
        if cancelled:
            note_analysis(session, machine_id, analysis_id, analysis.status, context.now())
        if not cancelled and analysis.status is not AnalysisStatus.CANCELLED:
            raise Conflict(
                f"analysis {analysis_id} cannot be cancelled any more: it is {analysis.status}"
            )
    return analysis


@repeated
def delete_analysis(context: Context, machine_id: str, analysis_id: int) -> None:
    """Delete an analysis; where it runs, its process is ended.

    A model version that was made of it stays.
    """
    with context.database.writing() as session:
        find_machine(session, machine_id)
        session.delete(find_analysis(session, machine_id, analysis_id))
        note_analysis(session, machine_id, analysis_id, "deleted", context.now())
