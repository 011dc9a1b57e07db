"""Write an analysis as a page that a person reads."""

from __future__ import annotations

import orjson

from app.errors import Conflict
from app.pictures.analysis_report import ReportHead, analysis_report
from app.services.context import Context
from app.storage.analyses import find_analysis
from app.storage.machines import find_machine, stored_machine
from app.storage.verifications import list_verifications


def report_analysis(context: Context, machine_id: str, analysis_id: int) -> str:
    """Write the report of an analysis that is done: HTML that needs no other file.

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
        head = ReportHead(
            machine_id=machine.id,
            machine_name=machine.name,
            chain=machine.chain.text,
            model_version=row.model_version,
            verifications=[labels.get(i, f"number {i}, deleted") for i in row.verification_ids],
            analysed_at=row.finished_at,
            seed=row.seed,
            adopted_version=row.adopted_version,
        )
        result = row.result
    return analysis_report(head, orjson.loads(result))
