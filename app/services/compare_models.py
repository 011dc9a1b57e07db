"""Hold several versions of a model against the same verifications."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from app.arrays import BoolArray
from app.effects.projection import Projection
from app.errors import InvalidContent, expect_each_once
from app.identification.analysis.residual_report import ResidualReport, residual_report
from app.identification.residuals.residuals import Residuals
from app.services.choose_version import choose_version
from app.services.context import Context
from app.services.load_campaign import load_campaign, read_verifications
from app.services.show_residuals import residuals_of_version


@dataclass(frozen=True, slots=True, eq=False)
class ComparedVersion:
    """One version: its residuals on what all versions can be held against.

    `reason` says what made the version, and `active` whether tables are computed with it.
    """

    version: int
    reason: str
    active: bool
    report: ResidualReport


def compare_models(
    context: Context, machine_id: str, verification_ids: Sequence[int], versions: Sequence[int]
) -> list[ComparedVersion]:
    """Compare versions on the observations that every one of them can be held against.

    Raises
    ------
    UnknownThing
        If there is no such machine, version or verification.
    InvalidContent
        If a version or a verification is named twice, or nothing is common to all versions.
    """
    for field, numbers in (("verifications", verification_ids), ("versions", versions)):
        expect_each_once(field, numbers)
    with context.database.reading() as session:
        machine, active = choose_version(session, machine_id)
        verifications = read_verifications(session, machine_id, verification_ids)
        stored = [choose_version(session, machine_id, number)[1] for number in versions]
        until = context.usable_until()
        campaigns = [load_campaign(session, machine, v, verifications, until) for v in stored]
    residuals = [residuals_of_version(n, c) for n, c in zip(versions, campaigns, strict=True)]
    common = np.logical_and.reduce([r.kept for r in residuals])
    if not common.any():
        raise InvalidContent.of_field(
            "versions", "expected observations that all versions can be held against, came none"
        )
    return [
        ComparedVersion(
            version.version,
            version.reason,
            version.version == active.version,
            residual_report(_restricted(own, common)),
        )
        for version, own in zip(stored, residuals, strict=True)
    ]


def _restricted(residuals: Residuals, common: BoolArray) -> Residuals:
    """Keep the rows, numbered among all, that are common to all versions."""
    own: BoolArray = common[residuals.kept]
    before = residuals.projection
    at = np.flatnonzero(own)
    return replace(
        residuals,
        projection=Projection(before.model, before.rows.take(own), before.conditions.take(at)),
        predicted=residuals.predicted[own],
        kept=common,
    )
