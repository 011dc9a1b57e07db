"""What a report says of an analysis beside its result."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime


@dataclass(frozen=True, slots=True)
class ReportHead:
    """Which machine was analysed, with what, and when.

    Parameters
    ----------
    chain
        Order of its axes, such as `XYFZ`.
    model_version
        The version that the observations were held against.
    analysed_at
        When the analysis was done, with its zone.
    seed
        Of its draws: the same seed gives the same answer.
    adopted_version
        The model version that its effects made; None where none was adopted.
    instruments, operators
        That the verifications name.
    measured
        When their first and their last value were; None where all are deleted.
    had, adopted
        The effects that the analysed version had already, and those of this analysis that
        were adopted: a sentence each.
    """

    machine_id: str
    machine_name: str
    chain: str
    model_version: int
    verifications: Sequence[str]
    analysed_at: datetime
    seed: int
    adopted_version: int | None = None
    analysis_id: int = 0
    serial_number: str | None = None
    instruments: Sequence[str] = ()
    operators: Sequence[str] = ()
    measured: tuple[datetime, datetime] | None = None
    had: Sequence[str] = ()
    adopted: Sequence[str] = ()
