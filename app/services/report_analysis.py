"""What the report of an analysis shows."""

from __future__ import annotations

from collections.abc import Sequence

from sqlalchemy.orm import Session

from app.effects.effect import Effect
from app.effects.registry import explain
from app.errors import Conflict
from app.identification.analysis.analysis import Analysis, FoundEffect
from app.services.context import Context
from app.services.load_machine import adopted_effects
from app.services.report_head import ReportHead
from app.storage.analyses import find_analysis
from app.storage.analysis_results import RESULTS
from app.storage.machines import find_machine, stored_machine
from app.storage.model_versions import find_version
from app.storage.verifications import list_verifications


def report_analysis(
    context: Context, machine_id: str, analysis_id: int
) -> tuple[ReportHead, Analysis]:
    """Read an analysis that is done, with what its report says beside the result.

    Raises
    ------
    UnknownThing
        If there is no such analysis.
    Conflict
        If it has no result.
    """
    with context.database.reading() as session:
        machine = stored_machine(find_machine(session, machine_id)).machine
        row = find_analysis(session, machine_id, analysis_id, result=True)
        if row.result is None or row.finished_at is None:
            raise Conflict(f"analysis {analysis_id} has nothing to report: it is {row.status}")
        labels = {v.id: v.label for v in list_verifications(session, machine_id)}
        result = RESULTS.read_text(row.result)
        head = ReportHead(
            machine_id=machine.id,
            machine_name=machine.name,
            chain=machine.chain.text,
            model_version=row.model_version,
            verifications=[labels.get(i, f"number {i}, deleted") for i in row.verification_ids],
            analysed_at=row.finished_at,
            seed=row.seed,
            adopted_version=row.adopted_version,
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
    session: Session, machine_id: str, version: int | None, found: Sequence[FoundEffect]
) -> list[str]:
    """Say which of the effects found are in the version that was made of them."""
    known = _effects_of(session, machine_id, version)
    return [explain(one.effect) for one in found if one.effect in known]
