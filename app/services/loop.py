"""What the page of the loop shows: checks, an analysis of them, and what later visits say of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from sqlalchemy.orm import Session

from app.errors import Conflict, InvalidContent, ThermapError
from app.identification.analysis.analysis import Analysis
from app.identification.analysis.residual_report import Size
from app.services.context import Context
from app.services.judge_verifications import judge_before_showing
from app.services.residuals import compare_models, show_residuals
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
