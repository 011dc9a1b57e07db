"""Verifications that are called absolute although their instrument was zeroed at the first reading.

Zeroed there, it reads exactly 0: in every set-up and component the first value. Taken for
absolute, what the machine's error was at that moment looks like a table that no longer holds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from app.arrays import BoolArray
from app.effects.kind import NotTested
from app.effects.kinds.outdated_map import OutdatedMap
from app.effects.observations import ObservationRows, Verification
from app.errors import counted
from app.search.rows import Datum

ZEROS_BY_CHANCE: Final = 0.01
"""Probability by which so many first values are 0 though the zero is absolute."""


def with_true_zeros(rows: ObservationRows) -> ObservationRows:
    """Call the zero of verifications `first` where their values show that it is.

    Only where all of a verification's first values are exactly 0, and zeros are so rare among
    its others that this is no chance: an instrument that reads whole micrometres reads 0 often.

    Returns
    -------
    ObservationRows
        The same rows of the same verifications, some with another datum.
    """
    undeclared = [
        number
        for number, v in enumerate(rows.verifications)
        if v.datum is Datum.ABSOLUTE and not v.is_planned
    ]
    is_zero, is_first = rows.measured == 0.0, _first_rows(rows)
    # Of a verification without any other first value the first values are all 0.
    others = set(rows.verification[is_first & ~is_zero].tolist())
    zeroed_at_first = [number for number in undeclared if number not in others]
    here = np.isin(rows.verification, zeroed_at_first)
    firsts, later = np.count_nonzero(here & is_first), here & ~is_first
    # Laplace's rule of succession: where none of n others is 0, the next one may be with 1/(n + 2).
    chance = (np.count_nonzero(is_zero[later]) + 1.0) / (np.count_nonzero(later) + 2.0)
    if not 0 < firsts <= np.count_nonzero(later) or chance**firsts > ZEROS_BY_CHANCE:
        return rows
    verifications = list(rows.verifications)
    for number in zeroed_at_first:
        verifications[number] = replace(verifications[number], datum=Datum.FIRST)
    return replace(rows, verifications=tuple(verifications))


def zeroed(before: Sequence[Verification], after: Sequence[Verification]) -> tuple[NotTested, ...]:
    """Say which verifications were taken for zeroed at their first reading."""
    labels = [b.label for b, a in zip(before, after, strict=True) if a.datum is not b.datum]
    if not labels:
        return ()
    named = repr(labels[0]) if len(labels) == 1 else counted(len(labels), "verification")
    reason = (
        "the first value of every component is exactly 0, so the instrument was zeroed there "
        "although the datum is stated as `absolute`; it is treated as `first`, which cannot show "
        "a constant error"
    )
    return (NotTested(OutdatedMap.kind, named, reason),)


def to_state(not_tested: Sequence[NotTested]) -> tuple[str, ...]:
    """Say what to do about them."""
    return tuple(
        (
            f"Store {item.on} again with the datum `first` if the instrument was zeroed at the "
            "first reading."
        )
        for item in not_tested
    )


def _first_rows(rows: ObservationRows) -> BoolArray:
    """Find the first row of every channel in every set-up, shape (n,)."""
    order = np.lexsort((rows.times_s, rows.channel, rows.visit))
    key = np.column_stack([rows.visit, rows.channel])[order]
    begins = np.append(True, (key[1:] != key[:-1]).any(axis=1))
    first_rows = np.zeros(len(rows), dtype=np.bool_)
    first_rows[order[begins]] = True
    return first_rows
