"""Cancel an analysis."""

from __future__ import annotations

from app.errors import Conflict
from app.services.context import Context
from app.services.repeating import repeated
from app.storage.analyses import cancel_analysis as cancel_stored
from app.storage.analyses import find_analysis, stored_analysis
from app.storage.machines import find_machine
from app.storage.records import AnalysisStatus, StoredAnalysis


@repeated
def cancel_analysis(context: Context, machine_id: str, analysis_id: int) -> StoredAnalysis:
    """Cancel an analysis that waits or runs; whoever runs it ends its process.

    Raises
    ------
    UnknownThing
        If there is no such analysis.
    Conflict
        If it has an answer already, or failed.
    """
    with context.database.writing() as session:
        find_machine(session, machine_id)
        row = find_analysis(session, machine_id, analysis_id)
        cancelled = cancel_stored(session, analysis_id, context.now())
        session.refresh(row)
        found = stored_analysis(row)
        if not cancelled and found.status is not AnalysisStatus.CANCELLED:
            raise Conflict(
                f"analysis {analysis_id} cannot be cancelled any more: it is {found.status}"
            )
    return found
