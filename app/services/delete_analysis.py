"""Delete an analysis."""

from __future__ import annotations

from app.services.context import Context
from app.services.repeating import repeated
from app.storage.analyses import find_analysis
from app.storage.machines import find_machine


@repeated
def delete_analysis(context: Context, machine_id: str, analysis_id: int) -> None:
    """Delete an analysis; where it runs, its process is ended.

    A model version that was made of it stays.

    Raises
    ------
    UnknownThing
        If there is no such analysis.
    """
    with context.database.writing() as session:
        find_machine(session, machine_id)
        session.delete(find_analysis(session, machine_id, analysis_id))
