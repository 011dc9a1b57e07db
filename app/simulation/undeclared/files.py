"""A campaign as files: the bodies of requests, and the truth apart from them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from app.simulation.undeclared.campaign import Campaign


def campaign_files(campaign: Campaign) -> dict[str, Any]:
    """Give a campaign's files by name.

    Returns
    -------
    dict of name to body
        `machine.json`, `error-map-….json`, `readings-….json`, `verification-….json`: each the
        body of one request, in the order in which they are sent; last `truth.json`.
    """
    bodies: dict[str, Any] = {"machine.json": campaign.machine}
    parts: dict[str, Sequence[Any]] = {
        "error-map": campaign.error_maps,
        "readings": campaign.reading_bodies,
        "verification": campaign.verifications,
    }
    for stem, several in parts.items():
        for number, body in enumerate(several, start=1):
            bodies[f"{stem}-{number:03d}.json"] = body
    return bodies | {"truth.json": truth_body(campaign)}


def truth_body(campaign: Campaign) -> dict[str, Any]:
    """Write the truth: effects, values as the observations have them, and what an oracle reaches.

    Returns
    -------
    dict
        Lists run over the observations of all verifications in their order.
    """
    truth = campaign.truth
    return {
        "seed": truth.seed,
        "planted": list(truth.names),
        "effects": list(truth.effects),
        "is_known": truth.is_known,
        "visit": truth.observations.visit.tolist(),
        "true_um": truth.by_observation(truth.true_um.round(6)),
        "contribution_um": truth.by_observation(truth.contribution_um.round(6)),
        "contributions_um": [truth.by_observation(c.round(6)) for c in truth.contributions_um],
        "is_outlier": truth.by_observation(truth.scatter.is_blunder),
        "is_frozen": truth.by_observation(truth.is_frozen),
        "standstills": [
            {"sensor": s.sensor, "from_min": s.from_min, "to_min": s.to_min}
            for s in campaign.record.standstills
        ],
        "residual_rms": {name: round(rms, 6) for name, rms in truth.rms_by_group_um().items()},
        # A record has no visits to hold out; it is judged by what is true later.
        "oracle": None if campaign.conditions.is_record else _oracle(campaign),
        "later": _later(campaign),
    }


def _later(campaign: Campaign) -> dict[str, Any]:
    """What is true later, beside where it is asked for: `POST …/predictions` takes `asked`."""
    later = campaign.later
    return {
        "asked": later.asked,
        "true_um": later.observations.shaped(later.true_um.round(6)),
        "contribution_um": later.observations.shaped(later.contribution_um.round(6)),
        "error_um": later.error_um(),
        "left_um": later.left_um(),
    }


def _oracle(campaign: Campaign) -> dict[str, Any]:
    """What the oracle reaches when every fourth visit is held out."""
    held_out = campaign.every_fourth_visit()
    fit = campaign.oracle(held_out)
    return {
        "held_out_visits": held_out,
        "amplitudes": fit.amplitudes.tolist(),
        "standard_errors": fit.standard_errors.tolist(),
        "train_rms_um": fit.train_rms_um,
        "holdout_rms_um": fit.holdout_rms_um,
        "holdout_rms_without_um": fit.holdout_rms_without_um,
        "floor_um": fit.floor_um,
    }
