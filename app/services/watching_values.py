"""What those who watch a shop want to know of all machines at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from time import sleep
from typing import Final

from app.errors import StorageUnavailable
from app.services.context import Context
from app.services.status import Stored, read_stored, status_of
from app.status.machine_status import MachineStatus
from app.storage.analyses import count_analyses
from app.storage.limits import QUESTION
from app.storage.watches import Watched

MOST_MACHINES: Final = 1000
"""Machines whose values are given: each one is some twenty time series to whoever stores them."""


@dataclass(frozen=True, slots=True)
class ShopValues:
    """Every machine's verdict, and what the database says of all.

    Parameters
    ----------
    machines
        By id, at most `MOST_MACHINES`.
    left_out
        Machines in memory beyond those.
    analyses
        Number of analyses by status; None while the database does not say. The machines' watches
        are not known then either.
    watches
        Machine to where its watch stands, as far as verifications were judged.
    """

    machines: Sequence[MachineStatus]
    left_out: int
    analyses: Mapping[str, int] | None
    watches: Mapping[str, Watched]


def shop_values(context: Context, most: int = MOST_MACHINES) -> ShopValues:
    """Judge the machines in memory, for somebody who asks every some seconds."""
    stored, analyses = _stored(context)
    live = context.live.machines()
    statuses = []
    for machine in live[:most]:
        statuses.append(status_of(context, machine, stored))
        sleep(0)  # a live table, which others wait for, comes between any two machines
    return ShopValues(statuses, max(len(live) - most, 0), analyses, stored.watches)


def _stored(
    context: Context,
) -> tuple[Stored, Mapping[str, int] | None]:
    """Ask the database, unless it is known to be away."""
    if context.live.database.trouble is not None:
        return Stored(), None
    try:
        with context.database.reading(QUESTION) as session:
            return read_stored(session), count_analyses(session)
    except StorageUnavailable:
        return Stored(), None
