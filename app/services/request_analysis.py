"""Ask for an analysis: put it at the end of the queue."""

from __future__ import annotations

from collections.abc import Sequence

from app.effects.registry import kind_of
from app.errors import expect_each_once
from app.services.choose_version import choose_version
from app.services.context import Context
from app.services.repeating import repeated
from app.storage.analyses import insert_analysis
from app.storage.machines import Held, find_machine
from app.storage.records import AnalysisTask, StoredAnalysis
from app.storage.verifications import find_verification


@repeated
def request_analysis(
    context: Context,
    machine_id: str,
    verification_ids: Sequence[int],
    *,
    holdout_fraction: float,
    kinds: Sequence[str] | None,
    seed: int,
) -> StoredAnalysis:
    """Put an analysis of the active model version at the end of the queue.

    Parameters
    ----------
    context, machine_id
        The service, and which machine.
    verification_ids
        What the model is held against.
    holdout_fraction
        Share of the visits that take no part in the search, between 0 and 1.
    kinds
        Kinds of effects that are tested; None: all.
    seed
        Of everything that is drawn: the same again gives the same answer.

    Raises
    ------
    UnknownThing
        If there is no such machine or verification.
    InvalidContent
        If there is no such kind of effect, or a kind or a verification is named twice.
    Conflict
        If the machine has no model yet.
    """
    for kind in kinds or ():
        kind_of(kind)
    expect_each_once("effects", kinds or ())
    expect_each_once("verifications", verification_ids)
    with context.database.writing() as session:
        find_machine(session, machine_id, Held.CHANGED)
        _, version = choose_version(session, machine_id)
        for verification_id in verification_ids:
            find_verification(session, machine_id, verification_id)
        task = AnalysisTask(version.version, verification_ids, holdout_fraction, kinds, seed)
        return insert_analysis(session, machine_id, task, context.now())
