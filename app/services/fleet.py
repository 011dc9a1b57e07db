"""A fleet: how far its analyses are, and what they say together.

Nothing of a fleet is stored. It is read off the machines' own analyses: one that asked the same of
the same model version and the same verifications serves, whoever asked for it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from time import monotonic
from typing import Final

from sqlalchemy.orm import Session

from app.effects.registry import kind_of
from app.errors import QueueFull, ThermapError, expect_each_once
from app.identification.analysis.tried_effect import TriedEffect
from app.identification.fleet import FleetJudgement, Likeness, Member, Trial, judge_fleet, trials
from app.services.analyses import cancel_analysis, queue_analysis, try_found_effect
from app.services.context import Context, repeated
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


@dataclass(frozen=True, slots=True)
class FleetQuestion:
    """What every machine's analysis is asked; `kinds` of effects None for all of them.

    Raises
    ------
    InvalidContent
        If there is no such kind, or one is named twice.
    """

    kinds: Sequence[str] | None = None
    holdout_fraction: float = HOLDOUT

    def __post_init__(self) -> None:
        for kind in self.kinds or ():
            kind_of(kind)
        expect_each_once("effects", self.kinds or ())


@dataclass(frozen=True, slots=True)
class FleetMember:
    """One machine: its analysis of all that was measured, as far as there is one.

    `why_not` says why none can be asked for; empty where one can be, or was.
    """

    id: str
    name: str
    verifications: Sequence[int]
    job: StoredAnalysis | None
    why_not: str = ""

    @property
    def is_to_be_asked(self) -> bool:
        """Whether its analysis has not been asked for, or came to nothing."""
        ended = (AnalysisStatus.FAILED, AnalysisStatus.CANCELLED)
        return not self.why_not and (self.job is None or self.job.status in ended)

    @property
    def is_going_on(self) -> bool:
        """Whether its analysis waits or runs."""
        return self.job is not None and self.job.status in GOING_ON


@dataclass(frozen=True, slots=True)
class FleetView:
    """The machines, and what they say together once none of their analyses goes on.

    `judgement` is None before that, and as long as fewer effects are tried on sisters than wanted.
    `done` lists the machines where what was asked now was done, `refused` says of the others why it
    was not, and `queue_full` that some may be asked again as soon as fewer analyses wait.
    """

    members: Sequence[FleetMember]
    tried: int = 0
    wanted: int = 0
    judgement: FleetJudgement | None = None
    done: Sequence[str] = ()
    refused: Mapping[str, str] = field(default_factory=dict)
    queue_full: bool = False

    @property
    def is_going_on(self) -> bool:
        """Whether it will say more without anybody asking for more."""
        return any(one.is_going_on for one in self.members) or self.tried < self.wanted


def likeness_of(machine: Machine) -> Likeness:
    """Say what sisters have in common."""
    travels = sorted((axis, t.min_mm, t.max_mm) for axis, t in machine.axes.items())
    return machine.chain.text, tuple(travels), tuple(sorted(machine.sensors))


def analyse_fleet(context: Context, question: FleetQuestion) -> FleetView:
    """Ask for the analyses that are missing, and for those again that failed or were cancelled."""
    asked = [one for one in _members(context, question) if one.is_to_be_asked]
    return _after(context, question, asked, _ask)


def cancel_fleet(context: Context, question: FleetQuestion) -> FleetView:
    """Cancel those of its analyses that wait or run, whoever asked for them."""
    going_on = [one for one in _members(context, question) if one.is_going_on]
    # What waits first: else each that is cancelled would let another one begin.
    going_on.sort(key=lambda one: one.job is not None and one.job.status is AnalysisStatus.RUNNING)
    return _after(context, question, going_on, _cancel)


def _members(context: Context, question: FleetQuestion) -> list[FleetMember]:
    with context.database.reading() as session:
        return [_member(session, one, question) for one in list_machines(session)]


@repeated
def _ask(context: Context, machine_id: str, question: FleetQuestion) -> bool:
    """Ask for a machine's analysis, unless somebody else did meanwhile."""
    with context.database.writing() as session:
        stored = stored_machine(find_machine(session, machine_id, RowLock.CHANGED))
        one = _member(session, stored, question)
        if stored.active_version is None or not one.is_to_be_asked:
            return False
        task = _task(stored.active_version, one.verifications, question)
        queue_analysis(context, session, machine_id, task)
        return True


def _cancel(context: Context, machine_id: str, question: FleetQuestion) -> bool:
    """Cancel a machine's analysis, unless it ended meanwhile."""
    with context.database.reading() as session:
        one = _member(session, stored_machine(find_machine(session, machine_id)), question)
    if one.job is None or not one.is_going_on:
        return False
    cancel_analysis(context, machine_id, one.job.id)
    return True


def _after(
    context: Context,
    question: FleetQuestion,
    members: Sequence[FleetMember],
    act: Callable[[Context, str, FleetQuestion], bool],
) -> FleetView:
    """Do it to one machine after the other, and gather what was refused of it."""
    done: list[str] = []
    refused: dict[str, str] = {}
    is_full = False
    for one in members:
        try:
            if act(context, one.id, question):
                done.append(one.id)
        except ThermapError as error:
            refused[one.id] = error.detail
            is_full = is_full or isinstance(error, QueueFull)
    return replace(show_fleet(context, question), done=done, refused=refused, queue_full=is_full)


def show_fleet(context: Context, question: FleetQuestion) -> FleetView:
    """Gather how far the machines' analyses are, and what they say together.

    An effect is tried on a sister as it stands; a question tries for `TRYING_S` at most, and
    what was tried is remembered, so that the next one goes on.
    """
    with context.database.reading() as session:
        stored = list_machines(session)
        watched = watch_statuses(session)
        members = [_member(session, one, question) for one in stored]
        if any(one.is_going_on for one in members):
            return FleetView(members)
        judged = [
            _judged(session, own, one, watched.get(one.id))
            for one, own in zip(members, stored, strict=True)
        ]
    wanted = trials(judged)
    by_id = {one.id: one for one in members}
    models = {one.machine.id: one.active_version for one in stored}
    until = monotonic() + TRYING_S
    tried: dict[Trial, TriedEffect | None] = {}
    for trial in wanted:
        job = by_id[trial.machine].job
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
    found = {trial: result for trial, result in tried.items() if result is not None}
    return FleetView(members, len(wanted), len(wanted), judge_fleet(judged, found))


def _member(session: Session, one: StoredMachine, question: FleetQuestion) -> FleetMember:
    machine = one.machine
    if one.active_version is None:
        return FleetMember(machine.id, machine.name, (), None, "it has no model yet")
    numbers = [v.id for v in list_verifications(session, machine.id)]
    if not numbers:
        why_not = "no check of it is stored"
        return FleetMember(machine.id, machine.name, (), None, why_not)
    asked = _task(one.active_version, numbers, question)
    same = [job for job in list_analyses(session, machine.id) if _is_same(job.task, asked)]
    serving = [job for job in same if job.status in (*GOING_ON, AnalysisStatus.DONE)]
    job = next(iter(reversed(serving)), next(iter(reversed(same)), None))
    return FleetMember(machine.id, machine.name, numbers, job)


def _task(version: int, verifications: Sequence[int], question: FleetQuestion) -> AnalysisTask:
    return AnalysisTask(version, verifications, question.holdout_fraction, question.kinds, SEED)


def _is_same(one: AnalysisTask, other: AnalysisTask) -> bool:
    """Say whether two ask the same, in whatever order."""
    kinds = [None if task.kinds is None else set(task.kinds) for task in (one, other)]
    verifications = [set(task.verification_ids) for task in (one, other)]
    return (
        (one.model_version, one.holdout_fraction, one.seed)
        == (other.model_version, other.holdout_fraction, other.seed)
        and kinds[0] == kinds[1]
        and verifications[0] == verifications[1]
    )


def _judged(session: Session, stored: StoredMachine, one: FleetMember, watch: str | None) -> Member:
    """Read what a machine's analysis found."""
    member = Member(
        one.id,
        one.name,
        likeness_of(stored.machine),
        watch,
        has_verifications=bool(one.verifications),
        why_not=one.why_not or None,
    )
    if one.job is None:
        return member if one.why_not else replace(member, why_not="not analysed yet")
    row = find_analysis(session, one.id, one.job.id, result=True)
    result = None if row.result is None else RESULTS.read_text(row.result)
    why_not = None if result else f"analysis {one.job.id} {one.job.status}: {one.job.message}"
    return replace(member, analysis=one.job.id, result=result, why_not=why_not)


def _try(context: Context, trial: Trial, on: FleetMember, together: int) -> TriedEffect | None:
    """Try an effect; None where the sister or the analysis was changed meanwhile."""
    try:
        return try_found_effect(
            context,
            trial.machine,
            trial.analysis,
            trial.effect,
            trial.on,
            on.verifications,
            together,
        )
    except ThermapError:
        return None
