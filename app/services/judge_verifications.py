"""Judge verifications: on arrival, or, where their readings came after them, once these are there.

What a judgement said once stays, whatever readings come later: the watch went on from it, and
somebody may have acted on it. Only where nothing could be said for want of readings is it made
later.
"""

from __future__ import annotations

import logging
from contextlib import suppress
from dataclasses import dataclass
from datetime import timedelta
from time import monotonic
from typing import Final

from sqlalchemy.orm import Session

from app.effects.observations import Verification
from app.errors import InvalidContent, StorageUnavailable, UnknownThing
from app.events.event import EventKind
from app.identification.residuals.residuals import NoReadingsThen, WrongUnit
from app.identification.watch.watching import Judgement, WatchState, not_judged, watch
from app.services.background import Background
from app.services.context import Context, repeated
from app.services.note_watch import noting_watch
from app.services.residuals import load_campaign
from app.storage.events import write_event
from app.storage.machines import RowLock, find_machine, stored_machine
from app.storage.model_versions import active_version
from app.storage.readings import newest_time
from app.storage.records import StoredVerification
from app.storage.verifications import (
    awaiting_readings,
    find_verification,
    read_verification,
    stored_verification,
    write_judgement,
)
from app.storage.watches import StoredWatch, find_watch, write_watch

log = logging.getLogger("thermap")

LOOK_EVERY_S: Final = 5.0
"""How often it is looked whether readings have come that verifications wait for [s]."""

AT_MOST_S: Final = 2.0
"""How long those are judged at a time that waited: somebody waits for an answer [s]."""

JUDGING_DUTY: Final = 7_483_624
"""PostgreSQL advisory lock: of several services one looks."""


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
            now = context.now()
            with noting_watch(session, find_machine(session, machine_id), now):
                write_watch(session, machine_id, self.model_version, self.after, now)


def judge_verification(context: Context, machine_id: str, verification: Verification) -> Judged:
    """Hold a verification against the active model, without storing anything.

    Raises
    ------
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
        except NoReadingsThen as error:
            return Judged(number, not_judged(number, error.detail, awaits_readings=True), before)
        except InvalidContent as error:
            return Judged(number, not_judged(number, error.detail), before)
        except Exception as error:
            # What was measured must not be lost because it could not be judged.
            log.exception("verification %r could not be judged", verification.label)
            reason = f"unexpected error: {type(error).__name__}"
            return Judged(number, not_judged(number, reason), before)
    return Judged(number, judgement, before, after)


def judge_awaiting(context: Context, machine_id: str | None = None) -> None:
    """Judge the verifications that waited for readings which are there now, for `AT_MOST_S`.

    Those that are left have their turn at the next call. Readings have to reach the last
    observation: what is uploaded in pieces is judged whole.

    Parameters
    ----------
    machine_id
        Whose; None for all machines.
    """
    with context.database.reading() as session:
        waiting = [
            (of, stored.id)
            for of, stored in awaiting_readings(session, machine_id)
            if _has_readings(context, session, of, stored)
        ]
    began_s = monotonic()
    for of, number in waiting:
        with suppress(UnknownThing):  # deleted meanwhile
            _judge_late(context, of, number)
        if monotonic() - began_s > AT_MOST_S:
            return


def judge_before_showing(context: Context, machine_id: str) -> None:
    """Judge what can be judged by now; where nothing can be stored, it is shown as it is."""
    with suppress(StorageUnavailable):
        judge_awaiting(context, machine_id)


def _has_readings(
    context: Context, session: Session, machine_id: str, stored: StoredVerification
) -> bool:
    machine = stored_machine(find_machine(session, machine_id)).machine
    # So far from an observation a reading may be that counts for it.
    near = timedelta(seconds=max((s.max_age_s for s in machine.sensors.values()), default=0.0))
    newest = newest_time(session, machine_id, min(stored.last_at + near, context.usable_until()))
    return newest is not None and newest >= stored.last_at - near


def _judge_late(context: Context, machine_id: str, verification_id: int) -> None:
    """Judge one verification with the readings that are there now, this once."""
    with context.database.reading() as session:
        row = find_verification(session, machine_id, verification_id, observations=True)
        verification = read_verification(row)
    while not _judged_now(context, machine_id, verification_id, verification):
        pass  # another verification, or another version, came first: it is judged after that one


@repeated
def _judged_now(
    context: Context, machine_id: str, verification_id: int, verification: Verification
) -> bool:
    """Judge it and store the judgement; False where what it rests on changed meanwhile."""
    try:
        judged = judge_verification(context, machine_id, verification)
    except WrongUnit as error:
        # It would have been refused; now it is stored, and analyses say the same of it.
        with context.database.reading() as session:
            number = find_machine(session, machine_id).active_version
            judged = Judged(number, not_judged(number, error.detail))
    # Judging takes seconds, and nothing is locked meanwhile. So it is looked now, with the machine
    # held, whether all that it rests on is as it was; if not, it is judged once more.
    with context.database.writing() as session:
        find_machine(session, machine_id, RowLock.CHANGED)
        row = find_verification(session, machine_id, verification_id)
        judgement = stored_verification(row).judgement
        if judgement is None or not judgement.awaits_readings:
            return True
        if not judged.still_holds(session, machine_id):
            return False
        judged.write(context, session, machine_id)
        # There are readings up to its end: whatever lacks now, nobody waits for any more.
        answer = judged.answer
        if answer.awaits_readings:
            reason = "the readings of its time do not have what the model needs"
            answer = not_judged(judged.model_version, reason)
        write_judgement(row, answer)
        words = f"verification {row.label!r} judged with readings that came after it"
        details = {"verification": row.id}
        write_event(session, machine_id, EventKind.VERIFICATION, words, context.now(), details)
    return True


class LateJudge(Background):
    """Looks whether readings have come that verifications waited for, and judges these."""

    def __init__(self, context: Context) -> None:
        super().__init__("late-judge", context.database.duty(JUDGING_DUTY))
        self._context = context

    def _run(self) -> None:
        trouble = "could not judge verifications whose readings came later"
        self._repeat(lambda: judge_awaiting(self._context), LOOK_EVERY_S, trouble)
