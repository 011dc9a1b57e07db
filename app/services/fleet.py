"""A fleet: how far its analyses are, and what they say together.

Nothing of a fleet is stored. It is read off the machines' own analyses: one that asked the same of
the same model version and the same verifications serves, whoever asked for it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from time import monotonic
from typing import Annotated, Final, Self

from pydantic import Field, model_validator
from sqlalchemy.orm import Session

from app.answer import Answer, shown
from app.effects.registry import kind_of
from app.errors import QueueFull, ThermapError, expect_each_once
from app.identification.analysis.tried_effect import TriedEffect
from app.identification.fleet import FleetJudgement, Likeness, Member, Trial, judge_fleet, trials
from app.services.analyses import (
    TriedEffectRequest,
    cancel_analysis,
    queue_analysis,
    try_found_effect,
)
from app.services.context import Context, repeated
from app.stated import Number, Schema
from app.storage.analyses import find_analysis, list_analyses
from app.storage.analysis_results import RESULTS
from app.storage.machines import RowLock, find_machine, list_machines, stored_machine
from app.storage.records import AnalysisStatus, AnalysisTask, StoredAnalysis, StoredMachine
from app.storage.verifications import list_verifications
from app.storage.watches import watch_statuses
from app.thermal.machine import Machine

HOLDOUT: Final = 0.3
"""Share of the visits that takes no part in the search, as where nothing is stated."""

SEED: Final = 0
"""Of all that an analysis draws, as where nothing is stated."""

TRYING_S: Final = 2.0
"""So long one question tries effects on sisters; the next one goes on [s]."""

MOST_TRIED: Final = 5000
"""Answers of trials that are remembered."""

GOING_ON: Final = (AnalysisStatus.QUEUED, AnalysisStatus.RUNNING)


class FleetRequest(Schema, example={"effects": ["thermal-lag"]}):
    """What the analysis of every machine is asked."""

    effects: Annotated[list[str], Field(min_length=1, max_length=100)] | None = Field(
        None,
        description="Kinds of effects to look for; all of them where it is left out. Without "
        "`other-sensor` no sensor is proposed for a component",
        examples=[["thermal-lag", "backlash"]],
    )
    holdout_fraction: Annotated[Number, Field(gt=0.0, lt=0.9)] = Field(
        HOLDOUT, description="Share of the visits that take no part in the search, below 0.9"
    )

    @model_validator(mode="after")
    def _know_the_kinds(self) -> Self:
        """Refuse kinds that there are not, or twice."""
        for kind in self.effects or ():
            kind_of(kind)
        expect_each_once("effects", self.effects or ())
        return self


@dataclass(frozen=True, slots=True)
class FleetMember(Answer, published_as="FleetMemberAnswer"):
    """How far one machine's analysis is."""

    machine: str
    """Its id"""
    name: str
    """Its name for people"""
    verifications: Annotated[Sequence[int], Field(exclude=True)] = ()
    analysis: StoredAnalysis | None = None
    """The analysis that asked this of the active model and all stored verifications; null where
    there is none"""
    why_not: str | None = None
    """Why none can be asked for; null where one can"""

    @shown
    def to_be_asked(self) -> bool:
        """Whether none was asked for, or the last one failed or was cancelled."""
        ended = (AnalysisStatus.FAILED, AnalysisStatus.CANCELLED)
        return not self.why_not and (self.analysis is None or self.analysis.status in ended)

    @property
    def is_going_on(self) -> bool:
        """Whether its analysis waits or runs."""
        return self.analysis is not None and self.analysis.status in GOING_ON


@dataclass(frozen=True, slots=True)
class FleetView(Answer, published_as="FleetAnswer"):
    """How far the analyses of all machines are, and what they say together."""

    machines: Sequence[FleetMember]
    """Every machine"""
    tried: int = 0
    """Effects that were tried on sisters so far"""
    wanted: int = 0
    """How many are to be tried; 0 until every analysis has ended"""
    judgement: FleetJudgement | None = None
    """What the analyses say together; null as long as something goes on"""
    done: Sequence[str] = ()
    """Machines whose analysis was asked for, or cancelled, by this request"""
    refused: Mapping[str, str] = field(default_factory=dict)
    """By machine, why that was not done"""
    queue_full: bool = False
    """Whether some were refused because too many analyses wait: ask again later"""

    @shown
    def going_on(self) -> bool:
        """Whether more will be said unasked: an analysis waits or runs, or trials are left."""
        return any(member.is_going_on for member in self.machines) or self.tried < self.wanted


def likeness_of(machine: Machine) -> Likeness:
    """Say what sisters have in common."""
    travels = sorted((axis, t.min_mm, t.max_mm) for axis, t in machine.axes.items())
    return machine.chain.text, tuple(travels), tuple(sorted(machine.sensors))


def analyse_fleet(context: Context, question: FleetRequest) -> FleetView:
    """Ask for the analyses that are missing, and for those again that failed or were cancelled."""
    to_ask = [member for member in _members(context, question) if member.to_be_asked]
    return _after(context, question, to_ask, _ask)


def cancel_fleet(context: Context, question: FleetRequest) -> FleetView:
    """Cancel those of its analyses that wait or run, whoever asked for them."""
    going_on = [member for member in _members(context, question) if member.is_going_on]
    # What waits first: else each that is cancelled would let another one begin.
    going_on.sort(
        key=lambda item: (
            item.analysis is not None and item.analysis.status is AnalysisStatus.RUNNING
        )
    )
    return _after(context, question, going_on, _cancel)


def _members(context: Context, question: FleetRequest) -> list[FleetMember]:
    with context.database.reading() as session:
        return [_member(session, machine, question) for machine in list_machines(session)]


@repeated
def _ask(context: Context, machine_id: str, question: FleetRequest) -> bool:
    """Ask for a machine's analysis, unless somebody else did meanwhile."""
    with context.database.writing() as session:
        stored = stored_machine(find_machine(session, machine_id, RowLock.CHANGED))
        member = _member(session, stored, question)
        if stored.active_version is None or not member.to_be_asked:
            return False
        task = _task(stored.active_version, member.verifications, question)
        queue_analysis(context, session, machine_id, task)
        return True


def _cancel(context: Context, machine_id: str, question: FleetRequest) -> bool:
    """Cancel a machine's analysis, unless it ended meanwhile."""
    with context.database.reading() as session:
        member = _member(session, stored_machine(find_machine(session, machine_id)), question)
    if member.analysis is None or not member.is_going_on:
        return False
    cancel_analysis(context, machine_id, member.analysis.id)
    return True


def _after(
    context: Context,
    question: FleetRequest,
    members: Sequence[FleetMember],
    act: Callable[[Context, str, FleetRequest], bool],
) -> FleetView:
    """Do it to one machine after the other, and gather what was refused of it."""
    done: list[str] = []
    refused: dict[str, str] = {}
    is_full = False
    for member in members:
        try:
            if act(context, member.machine, question):
                done.append(member.machine)
        except ThermapError as error:
            refused[member.machine] = error.detail
            is_full = is_full or isinstance(error, QueueFull)
    return replace(show_fleet(context, question), done=done, refused=refused, queue_full=is_full)


def show_fleet(context: Context, question: FleetRequest) -> FleetView:
    """Gather how far the machines' analyses are, and what they say together.

    An effect is tried on a sister as it stands; a question tries for `TRYING_S` at most, and
    what was tried is remembered, so that the next one goes on.
    """
    with context.database.reading() as session:
        stored = list_machines(session)
        watched = watch_statuses(session)
        members = [_member(session, member, question) for member in stored]
        if any(member.is_going_on for member in members):
            return FleetView(members)
        judged = [
            _judged(session, own, member, watched.get(member.machine))
            for member, own in zip(members, stored, strict=True)
        ]
    wanted = trials(judged)
    by_id = {member.machine: member for member in members}
    models = {machine.machine.id: machine.active_version for machine in stored}
    until = monotonic() + TRYING_S
    tried: dict[Trial, TriedEffect | None] = {}
    for trial in wanted:
        job = by_id[trial.machine].analysis
        key = (
            trial,
            None if job is None else job.created_at,
            models[trial.on],
            tuple(by_id[trial.on].verifications),
            len(wanted),
        )
        if key not in context.tried and monotonic() > until:
            return FleetView(members, len(tried), len(wanted))
        if key not in context.tried:
            if len(context.tried) >= MOST_TRIED:
                context.tried.clear()
            context.tried[key] = _try(context, trial, by_id[trial.on], len(wanted))
        tried[trial] = context.tried[key]
    answers = {trial: result for trial, result in tried.items() if result is not None}
    return FleetView(members, len(wanted), len(wanted), judge_fleet(judged, answers))


def _member(session: Session, stored: StoredMachine, question: FleetRequest) -> FleetMember:
    machine = stored.machine
    if stored.active_version is None:
        return FleetMember(machine.id, machine.name, why_not="it has no model yet")
    numbers = [v.id for v in list_verifications(session, machine.id)]
    if not numbers:
        return FleetMember(machine.id, machine.name, why_not="no check of it is stored")
    task = _task(stored.active_version, numbers, question)
    same = [job for job in list_analyses(session, machine.id) if _is_same(job.task, task)]
    serving = [job for job in same if job.status in (*GOING_ON, AnalysisStatus.DONE)]
    job = next(iter(reversed(serving)), next(iter(reversed(same)), None))
    return FleetMember(machine.id, machine.name, numbers, job)


def _task(version: int, verifications: Sequence[int], question: FleetRequest) -> AnalysisTask:
    return AnalysisTask(version, verifications, question.holdout_fraction, question.effects, SEED)


def _is_same(first: AnalysisTask, other: AnalysisTask) -> bool:
    """Say whether two ask the same, in whatever order."""
    kinds = [None if task.kinds is None else set(task.kinds) for task in (first, other)]
    verifications = [set(task.verification_ids) for task in (first, other)]
    return (
        (first.model_version, first.holdout_fraction, first.seed)
        == (other.model_version, other.holdout_fraction, other.seed)
        and kinds[0] == kinds[1]
        and verifications[0] == verifications[1]
    )


def _judged(session: Session, stored: StoredMachine, one: FleetMember, watch: str | None) -> Member:
    """Read what a machine's analysis found."""
    member = Member(
        one.machine,
        one.name,
        likeness_of(stored.machine),
        watch,
        has_verifications=bool(one.verifications),
        why_not=one.why_not,
    )
    if one.analysis is None:
        return member if one.why_not else replace(member, why_not="not analysed yet")
    row = find_analysis(session, one.machine, one.analysis.id, result=True)
    result = None if row.result is None else RESULTS.read_text(row.result)
    why_not = (
        None
        if result
        else f"analysis {one.analysis.id} {one.analysis.status}: {one.analysis.message}"
    )
    return replace(member, analysis=one.analysis.id, result=result, why_not=why_not)


def _try(context: Context, trial: Trial, on: FleetMember, together: int) -> TriedEffect | None:
    """Try an effect; None where the sister or the analysis was changed meanwhile."""
    try:
        request = TriedEffectRequest(
            machine=trial.machine,
            analysis=trial.analysis,
            effect=trial.effect,
            on=trial.on,
            verifications=list(on.verifications),
            tried_together=together,
        )
        return try_found_effect(context, request)
    except ThermapError:
        return None
