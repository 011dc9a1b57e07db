"""Read what a stored analysis asks for, and carry it out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from app.errors import Conflict
from app.identification.analysis.analyse import analyse
from app.services.change_model import choose_version
from app.services.context import CLOCKS_DIFFER
from app.services.residuals import load_campaign, read_verifications
from app.storage.analyses import read_analysis
from app.storage.analysis_results import RESULTS
from app.storage.database import Database
from app.storage.limits import LONG


def analyse_stored(
    database_url: str, analysis_id: int, progress: Callable[[float, str], None]
) -> str:
    """Carry out an analysis as it was asked for, and give its result as JSON.

    Parameters
    ----------
    database_url
        Where verifications, readings and the model are; nothing is written there.
    progress
        Called with how far it is, from 0 to 1, and what is being done, in words.

    Raises
    ------
    ThermapError
        If it cannot be analysed: it was deleted meanwhile, say.
    """
    database = Database(database_url, LONG, may_be_new=False)
    try:
        with database.reading() as session:
            stored = read_analysis(session, analysis_id)
            if stored is None:
                raise Conflict("it was deleted")
            machine, version = choose_version(session, stored.machine_id, stored.task.model_version)
            ids = stored.task.verification_ids
            verifications = read_verifications(session, stored.machine_id, ids)
            until = stored.created_at + CLOCKS_DIFFER
            campaign = load_campaign(
                session, machine, version, verifications, until, searching=True
            )
            campaign = replace(campaign, verification_ids=tuple(ids))
    finally:
        database.close()
    analysis = analyse(
        campaign,
        holdout_fraction=stored.task.holdout_fraction,
        kinds=stored.task.kinds,
        seed=stored.task.seed,
        progress=progress,
    )
    return RESULTS.text(analysis)
