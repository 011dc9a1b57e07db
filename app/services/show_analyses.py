"""Read analyses as they are stored."""

from __future__ import annotations

from app.identification.analysis.analysis import Analysis
from app.services.context import Context
from app.storage.analyses import find_analysis, list_analyses, stored_analysis
from app.storage.analysis_results import RESULTS
from app.storage.machines import find_machine
from app.storage.records import StoredAnalysis


def show_analyses(context: Context, machine_id: str) -> list[StoredAnalysis]:
    """List a machine's analyses without their results, oldest first."""
    with context.database.reading() as session:
        find_machine(session, machine_id)
        return list_analyses(session, machine_id)


def show_analysis(
    context: Context, machine_id: str, analysis_id: int
) -> tuple[StoredAnalysis, Analysis | None]:
    """Read one analysis, and its result where it is done."""
    with context.database.reading() as session:
        find_machine(session, machine_id)
        row = find_analysis(session, machine_id, analysis_id, result=True)
        return stored_analysis(row), None if row.result is None else RESULTS.read_text(row.result)
