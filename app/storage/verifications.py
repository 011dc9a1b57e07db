"""Verifications in the database: what they are in columns, their observations as arrays."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Final

import numpy as np
from sqlalchemy import func, select
from sqlalchemy.orm import Session, undefer_group

from app.arrays import FloatArray
from app.effects.observations import Observation, Triple, Verification, refuse_many_states
from app.errors import UnknownThing, existing_names
from app.geometry.components import ORDER
from app.identification.watch.watching import Judgement
from app.search.rows import Datum
from app.storage.records import LARGEST_INTEGER, StoredVerification
from app.storage.tables import VerificationRow
from app.storage.watch_shapes import JUDGEMENTS

POINTS: Final = "points"
"""Name among a verification's components of what was measured at points."""

_ARRAYS: Final = (
    *("times_s", "component", "measured", "points_mm", "tool_offsets_mm", "directions"),
    "states",
)
_COMPARED: Final = ("measured", "points_mm", "directions")
_FACTS: Final = (
    *("label", "datum", "repeatability_um", "components", "state_names"),
    "setup_names",
)


NAMES: Final = ("instrument", "operator")
"""What may be named later than the observations are stored."""


def insert_verification(
    session: Session,
    machine_id: str,
    verification: Verification,
    judgement: Judgement | None,
    now: datetime,
) -> StoredVerification:
    """Add a verification and give it its number."""
    row = _row(machine_id, verification)
    if judgement is not None:
        write_judgement(row, judgement)
    row.stored_at = now
    session.add(row)
    session.flush()
    return stored_verification(row)


def find_verification(
    session: Session, machine_id: str, verification_id: int, *, observations: bool = False
) -> VerificationRow:
    """Find a verification by its number, with its observations if they are needed."""
    options = [undefer_group("arrays")] if observations else []
    can_be = 0 < verification_id <= LARGEST_INTEGER
    row = session.get(VerificationRow, verification_id, options=options) if can_be else None
    if row is None or row.machine_id != machine_id:
        stored = list_verifications(session, machine_id)
        existing = existing_names(f"{v.id} ({v.label})" for v in stored)
        raise UnknownThing(
            f"machine {machine_id!r} has no verification {verification_id}; {existing}"
        )
    return row


def find_verification_by_label(
    session: Session, machine_id: str, label: str
) -> VerificationRow | None:
    """Find a verification by its label, with its observations."""
    query = select(VerificationRow).where(
        VerificationRow.machine_id == machine_id, VerificationRow.label == label
    )
    return session.scalar(query.options(undefer_group("arrays")))


def list_verifications(session: Session, machine_id: str) -> list[StoredVerification]:
    """List a machine's verifications in the order in which they were stored."""
    query = (
        select(VerificationRow)
        .where(VerificationRow.machine_id == machine_id)
        .order_by(VerificationRow.id)
    )
    return [stored_verification(row) for row in session.scalars(query)]


def awaiting_readings(
    session: Session, machine_id: str | None = None
) -> list[tuple[str, StoredVerification]]:
    """List the verifications that wait for readings to be judged, with their machines.

    Parameters
    ----------
    machine_id
        Whose; None for those of all machines.
    """
    query = select(VerificationRow).where(VerificationRow.judgement["awaits_readings"].as_boolean())
    if machine_id is not None:
        query = query.where(VerificationRow.machine_id == machine_id)
    rows = session.scalars(query.order_by(VerificationRow.id))
    return [(row.machine_id, stored_verification(row)) for row in rows]


def write_judgement(row: VerificationRow, judgement: Judgement) -> None:
    """Store what was said of a verification; its machine is locked."""
    row.judgement = JUDGEMENTS.fields(judgement)


def first_observation(session: Session, machine_id: str) -> datetime | None:
    """Give the time of a machine's oldest observation, None without a verification."""
    query = select(func.min(VerificationRow.first_at))
    return session.scalar(query.where(VerificationRow.machine_id == machine_id))


def observed_spans(session: Session, machine_id: str) -> list[tuple[datetime, datetime]]:
    """Give the first and the last time of each of a machine's verifications."""
    query = select(VerificationRow.first_at, VerificationRow.last_at)
    spans = session.execute(query.where(VerificationRow.machine_id == machine_id))
    return [(first, last) for first, last in spans]


def stored_verification(row: VerificationRow) -> StoredVerification:
    """Read what a row says beside the observations."""
    return StoredVerification(
        id=row.id,
        label=row.label,
        datum=Datum(row.datum),
        repeatability_um=row.repeatability_um,
        stored_at=row.stored_at,
        first_at=row.first_at,
        last_at=row.last_at,
        count=row.observations,
        components=row.components,
        judgement=None if row.judgement is None else JUDGEMENTS.read(row.judgement),
        instrument=row.instrument,
        operator=row.operator,
    )


def read_verification(row: VerificationRow) -> Verification:
    """Read a row with its observations."""
    setups = _setups(row)
    observations = [
        Observation(
            time_s=time_s,
            measured=(measured[0],) if name != POINTS else _triple(measured),
            component=None if name == POINTS else name,
            position_mm=None if name == POINTS else _only(point),
            point_mm=_triple(point) if name == POINTS else None,
            tool_offset_mm=_triple(tool),
            directions=(int(direction[0]), int(direction[1]), int(direction[2])),
            state={n: x for n, x in zip(row.state_names, state, strict=True) if x == x},
            setup=setup,
        )
        for time_s, name, measured, point, tool, direction, state, setup in zip(
            row.times_s.tolist(),
            [row.components[int(i)] for i in row.component],
            *(_in_threes(getattr(row, name)) for name in _ARRAYS[2:6]),
            row.states.reshape(row.observations, -1).tolist(),
            setups,
            strict=True,
        )
    ]
    return Verification(
        row.label,
        observations,
        Datum(row.datum),
        row.repeatability_um,
        instrument=row.instrument,
        operator=row.operator,
    )


def _setups(row: VerificationRow) -> list[str | None]:
    """Name the set-up of each observation; None where it states none."""
    if row.setup is None:
        return [None] * row.observations
    return [None if np.isnan(i) else row.setup_names[int(i)] for i in row.setup]


def same_content(row: VerificationRow, verification: Verification) -> bool:
    """Whether a row says the same as a verification, bit for bit and in the same order.

    Where only one of them names an instrument or an operator, nothing is said otherwise.
    """
    other = _row(row.machine_id, verification)
    return (
        all(getattr(row, name) == getattr(other, name) for name in _FACTS)
        and all(len({getattr(row, n), getattr(other, n)} - {None}) < 2 for n in NAMES)
        and all(
            np.ravel(getattr(row, name)).tobytes() == np.ravel(getattr(other, name)).tobytes()
            for name in _ARRAYS
        )
        and _setups(row) == _setups(other)
    )


def shared_observations(row: VerificationRow, verification: Verification) -> int:
    """Count the observations of a verification that a row has too: time, place, direction, value.

    What they state of the machine and in which set-up they were made does not matter: whoever
    copies a file may name it anew.
    """
    stored = _row(row.machine_id, verification)
    if not np.isin(stored.times_s, row.times_s).any():
        return 0
    there = set(_compared(row))
    return sum(observation in there for observation in _compared(stored))


def _compared(row: VerificationRow) -> list[tuple[str, bytes]]:
    """Give of each observation what is compared: the component, and its numbers."""
    numbers = [row.times_s.reshape(-1, 1)]
    numbers += [getattr(row, name).reshape(-1, 3) for name in _COMPARED]
    # 0 and −0 are one number; all NaN are one.
    together = np.nan_to_num(np.hstack(numbers), nan=np.inf, posinf=np.inf) + 0.0
    names = [row.components[int(i)] for i in row.component]
    return [(name, array.tobytes()) for name, array in zip(names, together, strict=True)]


def _row(machine_id: str, verification: Verification) -> VerificationRow:
    observations = verification.observations
    names = {o.component or POINTS for o in observations}
    components = sorted(names, key=lambda name: ORDER.get(name, len(ORDER)))
    number = {name: i for i, name in enumerate(components)}
    state_names = sorted({name for o in observations for name in o.state})
    refuse_many_states(len(state_names), len(observations))
    setup_names = sorted({o.setup for o in observations if o.setup is not None})
    setups: dict[str | None, float] = {name: float(i) for i, name in enumerate(setup_names)}
    times_s = np.array([o.time_s for o in observations])
    return VerificationRow(
        machine_id=machine_id,
        label=verification.label,
        datum=verification.datum.value,
        repeatability_um=verification.repeatability_um,
        instrument=verification.instrument,
        operator=verification.operator,
        first_at=datetime.fromtimestamp(times_s.min(), UTC),
        last_at=datetime.fromtimestamp(times_s.max(), UTC),
        observations=len(observations),
        components=components,
        state_names=state_names,
        times_s=times_s,
        component=np.array([number[o.component or POINTS] for o in observations], dtype=float),
        measured=np.array([(*o.measured, np.nan, np.nan)[:3] for o in observations]),
        points_mm=np.array([o.point_mm or _single(o.position_mm) for o in observations]),
        tool_offsets_mm=np.array([o.tool_offset_mm for o in observations], dtype=float),
        directions=np.array([o.directions for o in observations], dtype=float),
        states=np.array([[o.state.get(n, np.nan) for n in state_names] for o in observations]),
        setup_names=setup_names,
        setup=np.array([setups.get(o.setup, np.nan) for o in observations])
        if setup_names
        else None,
    )


def _single(position_mm: float | None) -> Triple:
    """Put a position, or that there is none, where a point has three numbers."""
    return (np.nan if position_mm is None else position_mm, np.nan, np.nan)


def _only(point: Sequence[float]) -> float | None:
    return None if np.isnan(point[0]) else point[0]


def _triple(numbers: Sequence[float]) -> Triple:
    x, y, z = numbers
    return (x, y, z)


def _in_threes(flat: FloatArray) -> list[list[float]]:
    points: list[list[float]] = flat.reshape(-1, 3).tolist()
    return points
