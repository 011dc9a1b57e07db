"""Verifications: store them, judged as soon as they can be, show and delete them, and the watch."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Annotated, Any, Final, Literal

from pydantic import Field
from sqlalchemy.orm import Session

from app.answer import Answer
from app.effects.observations import Observation, Verification
from app.errors import Conflict, InvalidContent, counted, list_names
from app.events.event import EventKind
from app.geometry.components import COMPONENTS, ORDER
from app.identification.watch.watching import FALSE_ALARM, LIMIT, Followed, WatchState, watch
from app.services.change_model import choose_version, no_model_yet
from app.services.context import FUTURE_TOLERANCE, Context, repeated
from app.services.judge_verifications import (
    judge_awaiting,
    judge_before_showing,
    judge_verification,
)
from app.services.load_machine import effective_model
from app.services.note_watch import noting_watch
from app.services.observations import MeasuredObservation
from app.services.residuals import load_campaign, read_verifications
from app.storage.events import write_event
from app.storage.machines import RowLock, find_machine, stored_machine
from app.storage.model_versions import active_version
from app.storage.readings import newest_time
from app.storage.records import ModelVersion, StoredVerification, VerificationExtent
from app.storage.verifications import (
    NAMES,
    find_verification,
    find_verification_by_label,
    insert_verification,
    list_verifications,
    read_verification,
    same_content,
    shared_observations,
    stored_verification,
)
from app.storage.watches import find_watch, write_watch
from app.thermal.machine import Machine
from app.units import iso_time

log = logging.getLogger("thermap")


FEWEST_SHARED: Final = 2
"""Observations that two verifications have in common before anybody is asked: files of a log may
overlap by one."""


@dataclass(frozen=True, slots=True)
class VerificationStoredOnce:
    """A stored verification, and whether it is new."""

    stored: StoredVerification
    is_new: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class StoredVerificationAnswer(StoredVerification):
    """A verification that was stored just now, or was there already."""

    warnings: Sequence[str]
    """What may be a mistake in it, and what the active model cannot be compared with, and why"""


@dataclass(frozen=True, slots=True, kw_only=True)
class WholeVerificationAnswer(StoredVerification):
    """A stored verification with its observations, in the order in which they came."""

    observations: Sequence[MeasuredObservation]
    """What was measured"""


@dataclass(frozen=True, slots=True, kw_only=True)
class VerificationPreview(VerificationExtent):
    """What was read as a verification; nothing is stored."""

    preview: Literal[True] = True
    """That nothing is stored"""
    warnings: Sequence[str]
    """What of it was not read, or may be a mistake"""
    read: Sequence[str]
    """What was read of the file, in lines of text"""


def extent_of(verification: Verification) -> dict[str, Any]:
    """Give the fields of `VerificationExtent`."""
    times = [datetime.fromtimestamp(o.time_s, UTC) for o in verification.observations]
    observed = {o.component or "points" for o in verification.observations}
    stated = ("label", "datum", "repeatability_um", "instrument", "operator")
    return {
        **{name: getattr(verification, name) for name in stated},
        "first_at": min(times),
        "last_at": max(times),
        "count": len(times),
        "components": sorted(observed, key=lambda name: ORDER.get(name, len(ORDER))),
    }


@repeated
def store_verification(
    context: Context, machine_id: str, verification: Verification
) -> VerificationStoredOnce:
    """Store a verification, once.

    Returns
    -------
    VerificationStoredOnce
        The same content under the same label again is the verification that is there.

    Raises
    ------
    InvalidContent
        If a position is outside the axis' travel, a time in the future, or the values are
        evidently in another unit.
    Conflict
        If the label names another verification.
    """
    stored_before = check_verification(context, machine_id, verification)
    if stored_before is not None and not _names_lacking(stored_before, verification):
        return VerificationStoredOnce(stored_before, False)
    if stored_before is None:
        judge_awaiting(context, machine_id)  # what was stored before is judged before
    while True:
        judged = None
        if stored_before is None:
            judged = judge_verification(context, machine_id, verification)
        with context.database.writing() as session:
            # Under the machine's lock: two of one label, and the watch's sequence, need an order.
            find_machine(session, machine_id, RowLock.CHANGED)
            stored_before = _stored_before(session, machine_id, verification)
            if stored_before is not None:
                named = _with_names(session, machine_id, stored_before, verification)
                return VerificationStoredOnce(named, False)
            if judged is not None and judged.still_holds(session, machine_id):
                judged.write(context, session, machine_id)
                stored = insert_verification(
                    session, machine_id, verification, judged.answer, context.now()
                )
                words = f"verification {stored.label!r} stored"
                details = {"verification": stored.id}
                write_event(
                    session, machine_id, EventKind.VERIFICATION, words, context.now(), details
                )
                return VerificationStoredOnce(stored, True)
        # Another verification, or another version, came first: it is judged after that one. Or
        # the one that was there has been deleted meanwhile.


def check_verification(
    context: Context, machine_id: str, verification: Verification
) -> StoredVerification | None:
    """Check all of a verification that is known before it is compared, without storing it.

    Returns
    -------
    StoredVerification or None
        The one that is there with the same content.

    Raises
    ------
    InvalidContent, Conflict
        As `store_verification`.
    """
    with context.database.reading() as session:
        machine = stored_machine(find_machine(session, machine_id)).machine
        stored_before = _stored_before(session, machine_id, verification)
    if stored_before is None:
        _check_times(context, verification)
        check_places(machine, verification.observations)
    return stored_before


def remarks_on_verification(
    context: Context, machine_id: str, verification: Verification
) -> list[str]:
    """Say what is taken as it came although it may be a mistake, and what is not compared."""
    with context.database.reading() as session:
        row = find_machine(session, machine_id)
        version, machine = active_version(session, row), stored_machine(row).machine
        copies = _copies(session, machine_id, verification)
    return [
        *verification.remarks,
        *copies,
        *_maybe_in_metres(machine, verification.observations),
        *_not_compared(machine, version, verification),
    ]


def without_readings(context: Context, machine_id: str, verification: Verification) -> list[str]:
    """Say before a verification is stored that it cannot be judged yet: its judgement does then."""
    times_s = [o.time_s for o in verification.observations]
    first_s, last_s = min(times_s), max(times_s)
    with context.database.reading() as session:
        row = find_machine(session, machine_id)
        sensors = stored_machine(row).machine.sensors.values()
        newest = newest_time(session, machine_id, datetime.fromtimestamp(last_s, UTC))
    oldest_s = first_s - max((sensor.max_age_s for sensor in sensors), default=0.0)
    if row.active_version is None or (newest is not None and newest.timestamp() >= oldest_s):
        return []
    return [
        f"no reading is stored of {iso_time(first_s)} to {iso_time(last_s)}: until readings of "
        "that time come, it is compared with nothing"
    ]


def _copies(session: Session, machine_id: str, verification: Verification) -> list[str]:
    """Ask about observations that are stored under another label too: they would count twice."""
    times_s = [o.time_s for o in verification.observations]
    first_s, last_s = min(times_s), max(times_s)
    remarks = []
    for stored in list_verifications(session, machine_id):
        is_apart = stored.last_at.timestamp() < first_s or stored.first_at.timestamp() > last_s
        if stored.label == verification.label or is_apart:
            continue
        row = find_verification(session, machine_id, stored.id, observations=True)
        shared = shared_observations(row, verification)
        if shared < min(FEWEST_SHARED, len(times_s)):
            continue
        is_whole = shared == len(times_s) == stored.count
        which = f"verification {stored.label!r} (number {stored.id}) has "
        remarks.append(
            f"{which}the same observations: one that is stored twice counts as two visits; delete "
            "one of them"
            if is_whole
            else f"{which}{shared:,} of these {counted(len(times_s), 'observation')} too, at the "
            "same time and to the last digit: what is stored twice counts as two visits; is one a "
            "copy of the other?"
        )
    return remarks


def _maybe_in_metres(machine: Machine, observations: Sequence[Observation]) -> list[str]:
    """Ask about positions that are all where they would be if metres were sent as millimetres."""
    places: dict[str, set[float]] = {axis: set() for axis in machine.axes}
    for o in observations:
        for axis, place in _places(o).items():
            places.setdefault(axis, set()).add(place)
    remarks = []
    for axis, coordinates in places.items():
        travel = machine.axes.get(axis)
        if travel is not None and coordinates and travel.unit_meant(coordinates) == "m":
            remarks.append(
                f"all positions of {axis} are from {min(coordinates):g} to {max(coordinates):g} "
                "mm, on an axis of "
                f"{travel.min_mm:g} to {travel.max_mm:g} mm: are they in mm?"
            )
    return remarks


def _not_compared(
    machine: Machine, version: ModelVersion | None, verification: Verification
) -> list[str]:
    """Say what of a verification a version has nothing to be compared with, and why."""
    if version is None:
        return [f"machine {machine.id!r} has no model yet: there is nothing to compare this with"]
    effective = effective_model(machine, version)
    observed = {o.component for o in verification.observations}
    lacking = [code for code in COMPONENTS if code in observed and code not in effective.codes]
    omitted = effective.model.omitted
    reasons = [f"{code}: {omitted[code]}" for code in lacking if code in omitted]
    unmeasured = [code for code in lacking if code not in omitted]
    if unmeasured:
        reasons.append(f"no error map of it has {list_names(unmeasured)}")
    if not lacking:
        return []
    return [
        f"no table of model version {version.version} has {list_names(lacking)}, and nothing is "
        f"compared with them ({'; '.join(reasons)})"
    ]


def _stored_before(
    session: Session, machine_id: str, verification: Verification
) -> StoredVerification | None:
    """Find the stored verification that says the same; Conflict for another of its label."""
    row = find_verification_by_label(session, machine_id, verification.label)
    if row is None or same_content(row, verification):
        return None if row is None else stored_verification(row)
    raise Conflict(
        f"machine {machine_id!r} has another verification {verification.label!r} "
        f"(number {row.id}); choose another label, or delete that one first"
    )


def _names_lacking(stored: StoredVerification, verification: Verification) -> list[str]:
    """List which of instrument and operator a verification names and the stored one does not."""
    return [n for n in NAMES if getattr(verification, n) and not getattr(stored, n)]


def _with_names(
    session: Session, machine_id: str, stored: StoredVerification, verification: Verification
) -> StoredVerification:
    """Write instrument and operator to a stored verification that lacks them."""
    row = find_verification(session, machine_id, stored.id)
    for name in _names_lacking(stored, verification):
        setattr(row, name, getattr(verification, name))
    return stored_verification(row)


def check_places(machine: Machine, observations: Sequence[Observation]) -> None:
    """Refuse observations of another machine's axis, or beyond an axis' travel."""
    for i, observation in enumerate(observations):
        _check_place(machine, observation, f"observations.{i}")


def _check_times(context: Context, verification: Verification) -> None:
    latest_s = (context.now() + FUTURE_TOLERANCE).timestamp()
    for i, observation in enumerate(verification.observations):
        if observation.time_s > latest_s:
            raise InvalidContent.of_field(
                f"observations.{i}.time",
                f"expected a time not in the future (it is {context.now():%Y-%m-%dT%H:%M:%SZ}), "
                f"got {iso_time(observation.time_s)}",
            )


def _check_place(machine: Machine, o: Observation, field: str) -> None:
    """Refuse what this machine cannot have: another machine's axis, a place beyond its travel."""
    places = _places(o)
    if o.point_mm is None and not places.keys() <= set(machine.chain.axes):
        raise InvalidContent.of_field(
            f"{field}.component",
            f"{o.component} is an error of an axis that {machine.chain.text} lacks",
        )
    field = f"{field}.{'position_mm' if o.point_mm is None else 'point_mm'}"
    for axis, place in places.items():
        travel = machine.axes.get(axis)
        if travel and not travel.holds(place):
            raise InvalidContent.of_field(
                field,
                f"expected {axis} within the axis' travel of {travel.min_mm:.12g} to "
                f"{travel.max_mm:.12g} mm, got {place:.12g} mm",
            )


def _places(o: Observation) -> dict[str, float]:
    """Say where the axes stood, as far as it is stated."""
    if o.point_mm is not None:
        return dict(zip("xyz", o.point_mm, strict=True))
    axis = COMPONENTS[str(o.component)].axis
    return {} if axis is None else {axis: o.position_mm or 0.0}


def show_verifications(context: Context, machine_id: str) -> list[StoredVerification]:
    """List a machine's verifications, oldest first."""
    judge_before_showing(context, machine_id)
    with context.database.reading() as session:
        find_machine(session, machine_id)
        return list_verifications(session, machine_id)


def show_verification(
    context: Context, machine_id: str, verification_id: int
) -> tuple[StoredVerification, Verification]:
    """Read one verification with its observations; UnknownThing if there is none."""
    judge_before_showing(context, machine_id)
    with context.database.reading() as session:
        find_machine(session, machine_id)
        row = find_verification(session, machine_id, verification_id, observations=True)
        return stored_verification(row), read_verification(row)


@repeated
def delete_verification(context: Context, machine_id: str, verification_id: int) -> None:
    """Delete a verification; analyses of it keep their results.

    The watch that had judged it is computed anew from those that it judged beside it.
    """
    with context.database.writing() as session:
        machine = find_machine(session, machine_id, RowLock.CHANGED)
        row = find_verification(session, machine_id, verification_id)
        stored = stored_verification(row)
        version = _judged_by(stored)
        words = f"verification {stored.label!r} deleted"
        details = {"verification": stored.id}
        write_event(session, machine_id, EventKind.VERIFICATION, words, context.now(), details)
        session.delete(row)
        session.flush()
        if version is not None:
            state = _watched(session, machine_id, version, context.usable_until())
            with noting_watch(session, machine, context.now()):
                write_watch(session, machine_id, version, state, context.now())


def _watched(session: Session, machine_id: str, version_number: int, until: datetime) -> WatchState:
    """Judge again all verifications that a version has judged, in their order."""
    judged = [
        v.id for v in list_verifications(session, machine_id) if _judged_by(v) == version_number
    ]
    if not judged:
        return WatchState()
    machine, version = choose_version(session, machine_id, version_number)
    verifications = read_verifications(session, machine_id, judged)
    try:
        campaign = load_campaign(session, machine, version, verifications, until)
        return watch(campaign, WatchState(), version_number)[1]
    except InvalidContent:
        # Nothing of them can be compared any more, as when readings were deleted.
        return WatchState()


def _judged_by(verification: StoredVerification) -> int | None:
    """Say which version has judged a verification; None where none could, or has yet."""
    judgement = verification.judgement
    return None if judgement is None or judgement.awaits_readings else judgement.model_version


@dataclass(frozen=True, slots=True)
class JudgedVerification(Answer):
    """One verification of the sequence."""

    verification: int
    """Number of the verification"""
    label: Annotated[str, Field(examples=["night shift"])]
    """Its name"""
    last_at: datetime
    """Time of its last observation, UTC"""
    status: str
    """`within`, `beyond` or `not-judged`"""
    evidence: float | None
    """Evidence from all verifications up to it, as an e-value"""


@dataclass(frozen=True, slots=True)
class Watch(Answer, published_as="WatchAnswer"):
    """Where the sequential test of the active version stands."""

    model_version: int
    """The active version"""
    status: Literal["within", "beyond", "no-verification"]
    """`no-verification` before the first one was judged"""
    beyond_since: datetime | None
    """Time of the visit that first exceeded the limit, UTC; null: none did"""
    evidence: float
    """Evidence from all verifications so far, as an e-value; 1 without any"""
    limit: float
    """Evidence that an unchanged machine ever reaches only with probability `false_alarm`"""
    false_alarm: float
    """Probability that an unchanged machine is ever called changed"""
    updated_at: datetime | None
    """When the last verification was judged, UTC"""
    contradiction: str | None
    """What is said where nearly all lengths contradict the repeatability that is stated, and what
    that does to the watch; null where they do not"""
    numbers: Sequence[Followed]
    """What is followed, strongest evidence first"""
    verifications: Sequence[JudgedVerification]
    """What was judged, oldest first"""


def show_watch(context: Context, machine_id: str) -> Watch:
    """Read where the watch of the active version stands.

    Raises
    ------
    Conflict
        If it has no model yet.
    """
    judge_before_showing(context, machine_id)
    with context.database.reading() as session:
        version = find_machine(session, machine_id).active_version
        if version is None:
            raise no_model_yet(machine_id)
        stored_watch = find_watch(session, machine_id, version)
        judged = [
            JudgedVerification(v.id, v.label, v.last_at, v.judgement.status, v.judgement.evidence)
            for v in list_verifications(session, machine_id)
            if v.judgement is not None and v.judgement.model_version == version
        ]
    state = WatchState() if stored_watch is None else stored_watch.state
    since_s = state.beyond_since_s
    status: Literal["within", "beyond"] = "within" if since_s is None else "beyond"
    return Watch(
        model_version=version,
        status=status if state.streams else "no-verification",
        beyond_since=None if since_s is None else datetime.fromtimestamp(since_s, UTC),
        evidence=state.evidence(),
        limit=LIMIT,
        false_alarm=FALSE_ALARM,
        updated_at=None if stored_watch is None else stored_watch.updated_at,
        contradiction=state.contradiction(),
        numbers=state.all_followed(),
        verifications=judged,
    )
