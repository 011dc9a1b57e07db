"""What a model version leaves of stored verifications."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from app.effects.observations import Verification
from app.errors import InvalidContent, expect_each_once
from app.identification.analysis.residual_report import ResidualReport, residual_report
from app.identification.campaign import Campaign, residuals_of
from app.identification.residuals.residuals import Residuals
from app.services.choose_version import choose_version
from app.services.context import Context
from app.services.load_campaign import load_campaign, read_verifications


@dataclass(frozen=True, slots=True, eq=False)
class ShownResiduals:
    """The residuals, of which version and which verifications."""

    model_version: int
    verification_ids: Sequence[int]
    verifications: Sequence[Verification]
    report: ResidualReport


def show_residuals(
    context: Context,
    machine_id: str,
    verification_ids: Sequence[int],
    version_number: int | None = None,
) -> ShownResiduals:
    """Subtract what a version says, the active one if none is stated, from what was measured.

    Raises
    ------
    UnknownThing
        If there is no such machine, version or verification.
    InvalidContent
        If nothing can be compared with the model, or values are evidently in another unit.
    Conflict
        If the machine has no model yet.
    """
    version, campaign = _read_campaign(context, machine_id, verification_ids, version_number)
    report = residual_report(residuals_of_version(version, campaign))
    return ShownResiduals(version, verification_ids, campaign.verifications, report)


def residuals_of_version(version: int, campaign: Campaign) -> Residuals:
    """Subtract what a version says; a refusal names the version."""
    try:
        return residuals_of(campaign)
    except InvalidContent as error:
        raise type(error)(f"model version {version}: {error.detail}", error.errors) from None


def _read_campaign(
    context: Context, machine_id: str, verification_ids: Sequence[int], version_number: int | None
) -> tuple[int, Campaign]:
    expect_each_once("verifications", verification_ids)
    with context.database.reading() as session:
        machine, version = choose_version(session, machine_id, version_number)
        verifications = read_verifications(session, machine_id, verification_ids)
        until = context.usable_until()
        return version.version, load_campaign(session, machine, version, verifications, until)
