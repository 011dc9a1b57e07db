"""Judge a verification against the active model, after those that came before."""

from __future__ import annotations

import logging
from dataclasses import dataclass

from sqlalchemy.orm import Session

from app.effects.observations import Verification
from app.errors import InvalidContent, StorageUnavailable
from app.identification.residuals.residuals import WrongUnit
from app.identification.watch.watching import Judgement, WatchState, not_judged, watch
from app.services.context import Context
from app.services.load_campaign import load_campaign
from app.storage.machines import find_machine, stored_machine
from app.storage.model_versions import active_version
from app.storage.watches import StoredWatch, find_watch, write_watch

log = logging.getLogger("thermap")


@dataclass(frozen=True, slots=True)
class Judged:
    """A judgement, and what it rests on: which version, and the watch before and after it."""

    model_version: int | None
    answer: Judgement
    before: StoredWatch | None = None
    after: WatchState | None = None

    def still_holds(self, session: Session, machine_id: str) -> bool:
        """Whether version and watch are still those that it rests on; the machine is locked."""
        if find_machine(session, machine_id).active_version != self.model_version:
            return False
        if self.model_version is None:
            return True
        return find_watch(session, machine_id, self.model_version) == self.before

    def write(self, context: Context, session: Session, machine_id: str) -> None:
        """Carry the watch on; the machine is locked."""
        if self.model_version is not None and self.after is not None:
            write_watch(session, machine_id, self.model_version, self.after, context.now())


def judge_verification(context: Context, machine_id: str, verification: Verification) -> Judged:
    """Hold a verification against the active model, without storing anything.

    Raises
    ------
    UnknownThing
        If there is no such machine.
    InvalidContent
        If its values are evidently in another unit. What cannot be judged for another reason
        is no error: the judgement says so.
    """
    with context.database.reading() as session:
        row = find_machine(session, machine_id)
        version = active_version(session, row)
        if version is None:
            return Judged(None, not_judged(None, "the machine has no model yet"))
        number = version.version
        before = find_watch(session, machine_id, number)
        try:
            state = WatchState() if before is None else before.state
            machine = stored_machine(row).machine
            campaign = load_campaign(
                session, machine, version, [verification], context.usable_until()
            )
            judgement, after = watch(campaign, state, number)
        except (WrongUnit, StorageUnavailable):
            raise
        except InvalidContent as error:
            return Judged(number, not_judged(number, error.detail), before)
        except Exception as error:
            # What was measured must not be lost because it could not be judged.
            log.exception("verification %r could not be judged", verification.label)
            reason = f"unexpected error: {type(error).__name__}"
            return Judged(number, not_judged(number, reason), before)
    return Judged(number, judgement, before, after)
