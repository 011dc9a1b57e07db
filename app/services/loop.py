"""What the loop shows: checks, an analysis of them, later visits, two versions compared."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from sqlalchemy.orm import Session

from app.arrays import BoolArray, rms
from app.errors import Conflict, InvalidContent, ThermapError
from app.identification.analysis.analysis import Analysis
from app.identification.analysis.before_after import lengths
from app.identification.analysis.residual_report import Size
from app.services.context import Context
from app.services.judge_verifications import judge_before_showing
from app.services.residuals import ComparedVersion, compare_models, show_residuals
from app.storage.analyses import find_analysis, list_analyses, stored_analysis
from app.storage.analysis_results import RESULTS
from app.storage.machines import find_machine, stored_machine
from app.storage.model_versions import newest_number
from app.storage.records import AnalysisStatus, StoredAnalysis, StoredVerification
from app.storage.verifications import list_verifications

UNFINISHED = (AnalysisStatus.QUEUED, AnalysisStatus.RUNNING)


@dataclass(frozen=True, slots=True)
class LaterVisits:
    """What was measured after the checks of an analysis, held against both versions.

    `before` and `after` are the lengths that the analysed and the adopted version leave; None
    where that is not known, and `why_not` says why.
    """

    verification_ids: Sequence[int]
    visits: int = 0
    before: Size | None = None
    after: Size | None = None
    why_not: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class LoopView:
    """A machine's checks and analyses, one of them with its result.

    `later` is None as long as nothing of the analysis was adopted.
    """

    machine_id: str
    machine_name: str
    sensors: Sequence[str]
    active_version: int | None
    next_version: int
    verifications: Sequence[StoredVerification]
    analyses: Sequence[StoredAnalysis]
    chosen: StoredAnalysis | None = None
    result: Analysis | None = None
    later: LaterVisits | None = None


def show_loop(context: Context, machine_id: str, analysis_id: int | None = None) -> LoopView:
    """Gather what the page of the loop shows.

    Parameters
    ----------
    analysis_id
        Which analysis; None: the one that waits or runs, else the newest.
    """
    judge_before_showing(context, machine_id)
    with context.database.reading() as session:
        row = find_machine(session, machine_id)
        analyses = list_analyses(session, machine_id)
        chosen, result = _chosen(session, machine_id, analyses, analysis_id)
        verifications = list_verifications(session, machine_id)
        machine = stored_machine(row).machine
        view = LoopView(
            machine_id=machine_id,
            machine_name=machine.name,
            sensors=tuple(machine.sensors),
            active_version=row.active_version,
            next_version=(newest_number(session, machine_id) or 0) + 1,
            verifications=verifications,
            analyses=analyses,
            chosen=chosen,
            result=result,
        )
    if chosen is None or chosen.adopted_version is None:
        return view
    later = _later_visits(context, machine_id, chosen, chosen.adopted_version, verifications)
    return replace(view, later=later)


@dataclass(frozen=True, slots=True)
class LeftOfCheck:
    """What the active version leaves of one check.

    `lengths` is None where none was measured, or where nothing could be held against the model;
    `why_not` then says why, and is empty otherwise.
    """

    lengths: Size | None
    why_not: str = ""


def show_left_of_check(context: Context, machine_id: str, verification_id: int) -> LeftOfCheck:
    """Hold one check against the active version, where that can be done."""
    try:
        residuals = show_residuals(context, machine_id, [verification_id])
    except (InvalidContent, Conflict) as error:
        return LeftOfCheck(None, error.detail)
    return LeftOfCheck(residuals.report.overall)


def _chosen(
    session: Session, machine_id: str, analyses: Sequence[StoredAnalysis], number: int | None
) -> tuple[StoredAnalysis | None, Analysis | None]:
    if number is None:
        unfinished = [analysis.id for analysis in analyses if analysis.status in UNFINISHED]
        number = next(iter(unfinished), analyses[-1].id if analyses else None)
    if number is None:
        return None, None
    row = find_analysis(session, machine_id, number, result=True)
    return stored_analysis(row), None if row.result is None else RESULTS.read_text(row.result)


def _later_visits(
    context: Context,
    machine_id: str,
    analysis: StoredAnalysis,
    adopted_version: int,
    verifications: Sequence[StoredVerification],
) -> LaterVisits:
    """Hold what was measured after the analysed checks against the version before and after."""
    analysed = set(analysis.task.verification_ids)
    last = max((v.last_at for v in verifications if v.id in analysed), default=analysis.created_at)
    later = [v.id for v in verifications if v.id not in analysed and v.first_at > last]
    if not later:
        return LaterVisits(later)
    versions = [analysis.task.model_version, adopted_version]
    try:
        compared = compare_models(context, machine_id, later, versions).versions
        before, after = (v.report for v in compared)
    except ThermapError as error:
        return LaterVisits(later, why_not=error.detail)
    visits = int(np.unique(before.residuals.rows.visit).size)
    why_not = "" if before.overall else "none of what they measured is a length"
    return LaterVisits(later, visits, before.overall, after.overall, why_not)


MOST_CHECKS: Final = 50
"""The newest so many are compared: each is read with the readings around it."""


@dataclass(frozen=True, slots=True)
class Pair:
    """What two versions leave of the same lengths, root mean square [µm]."""

    count: int
    a_um: float
    b_um: float


@dataclass(frozen=True, slots=True)
class ComparedCheck:
    """One check under both versions.

    Parameters
    ----------
    lengths
        None where it has no length that both versions can be held against.
    learned_from
        Whether an effect was adopted, up to the later version, by an analysis of it: that a
        version with that effect leaves less there proves nothing.
    """

    check: StoredVerification
    lengths: Pair | None
    learned_from: bool


@dataclass(frozen=True, slots=True, eq=False)
class ComparedChecks:
    """Two versions on the same observations of the same checks, relative to the same zeros.

    Parameters
    ----------
    together, independent
        All lengths; those of checks that nothing was learned from. None where there are none.
    components
        Each component under A and B, relative to the zero that each names.
    why_not
        Why nothing could be compared; empty otherwise.
    """

    a: int
    b: int
    checks: Sequence[ComparedCheck] = ()
    left_out: int = 0
    together: Pair | None = None
    independent: Pair | None = None
    components: Sequence[tuple[Size, Size]] = ()
    why_not: str = ""


def show_compared_checks(context: Context, machine_id: str, a: int, b: int) -> ComparedChecks:
    """Hold two versions against a machine's newest checks."""
    with context.database.reading() as session:
        find_machine(session, machine_id)
        stored = list_verifications(session, machine_id)
        adopted = [
            analysis.task.verification_ids
            for analysis in list_analyses(session, machine_id)
            if analysis.adopted_version is not None and analysis.adopted_version <= max(a, b)
        ]
    checks = sorted(stored, key=lambda check: (check.first_at, check.id))[-MOST_CHECKS:]
    left_out = len(stored) - len(checks)
    if not checks:
        return ComparedChecks(a, b, why_not="no check is stored")
    try:
        numbers = [check.id for check in checks]
        first, second = compare_models(context, machine_id, numbers, [a, b]).versions
    except ThermapError as error:
        return ComparedChecks(a, b, left_out=left_out, why_not=error.detail)
    learned = {number for numbers in adopted for number in numbers}
    return _compared(first, second, checks, left_out, learned)


def _compared(
    first: ComparedVersion,
    second: ComparedVersion,
    checks: Sequence[StoredVerification],
    left_out: int,
    learned: set[int],
) -> ComparedChecks:
    rows = first.report.residuals.rows
    are_lengths = lengths(first.report.residuals) & (first.report.overall is not None)
    of_check = [are_lengths & (rows.verification == i) for i in range(len(checks))]
    is_new = np.array([check.id not in learned for check in checks], dtype=np.bool_)
    return ComparedChecks(
        first.version,
        second.version,
        [
            ComparedCheck(check, _pair(first, second, of_this_check), check.id in learned)
            for check, of_this_check in zip(checks, of_check, strict=True)
        ],
        left_out,
        _pair(first, second, are_lengths),
        _pair(first, second, are_lengths & is_new[rows.verification]),
        list(zip(first.report.components, second.report.components, strict=True)),
    )


def _pair(first: ComparedVersion, second: ComparedVersion, chosen: BoolArray) -> Pair | None:
    if not chosen.any():
        return None
    after_rms = (rms(version.report.values[chosen]) for version in (first, second))
    return Pair(int(chosen.sum()), *after_rms)
