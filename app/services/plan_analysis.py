"""Say what planned observations could see, before anyone measures them."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime, timedelta
from typing import Final

from sqlalchemy.orm import Session

from app.effects.observations import Verification
from app.errors import InvalidContent
from app.identification.plan.plan import Plan
from app.identification.plan.planning import plan
from app.services.choose_version import choose_version
from app.services.context import Context
from app.services.load_campaign import (
    SEARCHED_BACK,
    first_and_last,
    load_campaign,
    read_verifications,
)
from app.services.store_verification import check_places
from app.storage.readings import newest_time

MOST_PLANNED: Final = 20_000
"""Observations in one plan."""

STANDING_IN: Final = timedelta(days=14)
"""Recorded days that stand for days to come, back from the newest reading."""


def plan_analysis(
    context: Context,
    machine_id: str,
    planned: Sequence[Verification],
    verification_ids: Sequence[int] = (),
) -> Plan:
    """Plan an analysis of the active version.

    Parameters
    ----------
    context, machine_id
        The service, and which machine.
    planned
        What is to be measured; values are not looked at. Times to come are planned on
        recorded days.
    verification_ids
        Stored verifications that would be analysed beside them.

    Raises
    ------
    UnknownThing
        If there is no such machine or verification.
    InvalidContent
        If nothing is planned or too much, a position is outside the axis' travel, or nothing
        recorded can be planned on.
    Conflict
        If the machine has no model yet.
    """
    with context.database.reading() as session:
        machine, version = choose_version(session, machine_id)
        for i, verification in enumerate(planned):
            try:
                check_places(machine, verification.observations)
            except InvalidContent as error:
                raise error.inside(f"planned.{i}") from None
        every = [*read_verifications(session, machine_id, verification_ids), *planned]
        count = sum(len(v.observations) for v in every)
        if not 0 < count <= MOST_PLANNED:
            raise InvalidContent.of_field(
                "planned", f"expected 1 to {MOST_PLANNED} observations in all, came {count}"
            )
        until = context.usable_until()
        recorded = _recorded_days(session, machine_id, every, until)
        campaign = load_campaign(
            session, machine, version, every, until, searching=True, recorded=recorded
        )
    return plan(campaign, version.version)


def _recorded_days(
    session: Session, machine_id: str, planned: Sequence[Verification], until: datetime
) -> tuple[datetime, datetime] | None:
    """Choose the days that stand for days to come; None where all is in the past."""
    newest = newest_time(session, machine_id, until)
    first, last = first_and_last(planned)
    if newest is None or last <= newest:
        return None
    return min(first, newest - STANDING_IN + SEARCHED_BACK), newest
