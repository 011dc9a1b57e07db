"""Store a verification, judged on arrival against the active model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from sqlalchemy.orm import Session

from app.effects.adopted.model_difference import ModelWithEffects
from app.effects.observations import Observation, Verification
from app.errors import Conflict, InvalidContent, list_names
from app.geometry.components import COMPONENTS
from app.services.context import FUTURE_TOLERANCE, Context
from app.services.judge_verification import judge_verification
from app.services.load_machine import adopted_effects, compile_version
from app.services.repeating import repeated
from app.storage.machines import Held, find_machine, stored_machine
from app.storage.model_versions import active_version
from app.storage.records import StoredVerification
from app.storage.verifications import (
    find_label,
    insert_verification,
    same_content,
    stored_verification,
)
from app.thermal.machine import Machine
from app.units import iso_time


@dataclass(frozen=True, slots=True)
class VerificationStoredOnce:
    """A stored verification, and whether it is new."""

    stored: StoredVerification
    is_new: bool


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
    with context.database.reading() as session:
        machine = stored_machine(find_machine(session, machine_id)).machine
        known = _known(session, machine_id, verification)
    if known is not None:
        return VerificationStoredOnce(known, False)
    _check_times(context, verification)
    check_places(machine, verification.observations)
    while True:
        judged = judge_verification(context, machine_id, verification)
        with context.database.writing() as session:
            # Under the machine's lock: two of one label, and the watch's sequence, need an order.
            find_machine(session, machine_id, Held.CHANGED)
            known = _known(session, machine_id, verification)
            if known is not None:
                return VerificationStoredOnce(known, False)
            if judged.still_holds(session, machine_id):
                judged.write(context, session, machine_id)
                stored = insert_verification(
                    session, machine_id, verification, judged.answer, context.now()
                )
                return VerificationStoredOnce(stored, True)
        # Another verification, or another version, came first: it is judged after that one.


def not_compared(context: Context, machine_id: str, components: Sequence[str]) -> list[str]:
    """Say what of a verification the active model has nothing to be compared with, and why.

    Parameters
    ----------
    context, machine_id
        Whose verification.
    components
        What was observed: codes, and `points`.

    Raises
    ------
    UnknownThing
        If there is no such machine.
    """
    with context.database.reading() as session:
        row = find_machine(session, machine_id)
        version, machine = active_version(session, row), stored_machine(row).machine
    if version is None:
        return [f"machine {machine_id!r} has no model yet: there is nothing to compare this with"]
    found = ModelWithEffects(compile_version(machine, version), adopted_effects(version))
    lacking = [code for code in components if code in COMPONENTS and code not in found.codes]
    omitted = found.model.omitted
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


def _known(
    session: Session, machine_id: str, verification: Verification
) -> StoredVerification | None:
    """Find the stored verification that says the same; Conflict for another of its label."""
    row = find_label(session, machine_id, verification.label)
    if row is None or same_content(row, verification):
        return None if row is None else stored_verification(row)
    raise Conflict(
        f"machine {machine_id!r} has another verification {verification.label!r} "
        f"(number {row.id}); choose another label, or delete that one first"
    )


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
                f"came {iso_time(observation.time_s)}",
            )


def _check_place(machine: Machine, o: Observation, field: str) -> None:
    """Refuse what this machine cannot have: another machine's axis, a place beyond its travel."""
    if o.point_mm is not None:
        places = dict(zip("xyz", o.point_mm, strict=True))
        field = f"{field}.point_mm"
    else:
        axis = COMPONENTS[str(o.component)].axis
        if axis is None:
            return
        if axis not in machine.chain.axes:
            raise InvalidContent.of_field(
                f"{field}.component",
                f"{o.component} is an error of an axis that {machine.chain.text} lacks",
            )
        places = {axis: o.position_mm or 0.0}
        field = f"{field}.position_mm"
    for axis, place in places.items():
        travel = machine.axes.get(axis)
        if travel and not travel.min_mm <= place <= travel.max_mm:
            raise InvalidContent.of_field(
                field,
                f"expected {axis} within the axis' travel of {travel.min_mm:.12g} to "
                f"{travel.max_mm:.12g} mm, came {place:.12g} mm",
            )
