"""Two model versions on the same checks: what each leaves, together and check by check."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from app.arrays import BoolArray, rms
from app.errors import ThermapError
from app.identification.analysis.before_after import lengths
from app.identification.analysis.residual_report import Size
from app.services.context import Context
from app.services.residuals import ComparedVersion, compare_models
from app.storage.analyses import list_analyses
from app.storage.machines import find_machine
from app.storage.records import StoredVerification
from app.storage.verifications import list_verifications

MOST_CHECKS: Final = 50
"""The newest so many are compared: each is read with the readings around it."""


@dataclass(frozen=True, slots=True)
class Pair:
    """What two versions leave of the same lengths, root mean square [µm]."""

    count: int
    a_um: float
    b_um: float


@dataclass(frozen=True, slots=True)
class ComparedCheck:
    """One check under both versions.

    Parameters
    ----------
    lengths
        None where it has no length that both versions can be held against.
    learned_from
        Whether an effect was adopted, up to the later version, by an analysis of it: that a
        version with that effect leaves less there proves nothing.
    """

    check: StoredVerification
    lengths: Pair | None
    learned_from: bool


@dataclass(frozen=True, slots=True, eq=False)
class ComparedChecks:
    """Two versions on the same observations of the same checks, relative to the same zeros.

    Parameters
    ----------
    together, independent
        All lengths; those of checks that nothing was learned from. None where there are none.
    components
        Each component under A and B, relative to the zero that each names.
    why_not
        Why nothing could be compared; empty otherwise.
    """

    a: int
    b: int
    checks: Sequence[ComparedCheck] = ()
    left_out: int = 0
    together: Pair | None = None
    independent: Pair | None = None
    components: Sequence[tuple[Size, Size]] = ()
    why_not: str = ""


def show_compared_checks(context: Context, machine_id: str, a: int, b: int) -> ComparedChecks:
    """Hold two versions against a machine's newest checks."""
    with context.database.reading() as session:
        find_machine(session, machine_id)
        stored = list_verifications(session, machine_id)
        adopted = [
            analysis.task.verification_ids
            for analysis in list_analyses(session, machine_id)
            if analysis.adopted_version is not None and analysis.adopted_version <= max(a, b)
        ]
    checks = sorted(stored, key=lambda check: (check.first_at, check.id))[-MOST_CHECKS:]
    left_out = len(stored) - len(checks)
    if not checks:
        return ComparedChecks(a, b, why_not="no check is stored")
    try:
        numbers = [check.id for check in checks]
        first, second = compare_models(context, machine_id, numbers, [a, b]).versions
    except ThermapError as error:
        return ComparedChecks(a, b, left_out=left_out, why_not=error.detail)
    learned = {number for numbers in adopted for number in numbers}
    return _compared(first, second, checks, left_out, learned)


def _compared(
    first: ComparedVersion,
    second: ComparedVersion,
    checks: Sequence[StoredVerification],
    left_out: int,
    learned: set[int],
) -> ComparedChecks:
    rows = first.report.residuals.rows
    are_lengths = lengths(first.report.residuals) & (first.report.overall is not None)
    of_check = [are_lengths & (rows.verification == i) for i in range(len(checks))]
    is_new = np.array([check.id not in learned for check in checks], dtype=np.bool_)
    return ComparedChecks(
        first.version,
        second.version,
        [
            ComparedCheck(check, _pair(first, second, of_this_check), check.id in learned)
            for check, of_this_check in zip(checks, of_check, strict=True)
        ],
        left_out,
        _pair(first, second, are_lengths),
        _pair(first, second, are_lengths & is_new[rows.verification]),
        list(zip(first.report.components, second.report.components, strict=True)),
    )


def _pair(first: ComparedVersion, second: ComparedVersion, chosen: BoolArray) -> Pair | None:
    if not chosen.any():
        return None
    after_rms = (rms(version.report.values[chosen]) for version in (first, second))
    return Pair(int(chosen.sum()), *after_rms)
