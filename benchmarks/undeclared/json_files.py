"""A campaign as JSON files: the bodies, and the truth apart from them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.undeclared.campaign import Campaign
from benchmarks.undeclared.truth import Truth


def write_campaign(campaign: Campaign, folder: Path) -> list[Path]:
    """Write a campaign into a folder.

    Parameters
    ----------
    campaign
        The campaign.
    folder
        Made if it does not exist; files of the same names are replaced.

    Returns
    -------
    list of Path
        `machine.json`, `error-map-….json`, `readings-….json`, `verification-….json`: each the
        body of one request, in the order in which they are sent; last `truth.json`.
    """
    folder.mkdir(parents=True, exist_ok=True)
    bodies: dict[str, Any] = {"machine.json": campaign.machine}
    parts: dict[str, Sequence[Any]] = {
        "error-map": campaign.error_maps,
        "readings": campaign.reading_bodies,
        "verification": campaign.verifications,
    }
    for stem, several in parts.items():
        for number, body in enumerate(several, start=1):
            bodies[f"{stem}-{number:03d}.json"] = body
    bodies["truth.json"] = truth_body(campaign)
    for name, body in bodies.items():
        text = json.dumps(body, allow_nan=False)
        (folder / name).write_text(text + "\n", encoding="utf-8")
    return [folder / name for name in bodies]


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
        "residual_rms": _residuals(truth),
        "oracle": _oracle(campaign),
    }


def _residuals(truth: Truth) -> dict[str, float]:
    return {name: round(rms, 6) for name, rms in truth.rms_by_group_um().items()}


def _oracle(campaign: Campaign) -> dict[str, Any]:
    """What the oracle reaches when every fourth visit is held out."""
    held_out = campaign.every_nth_visit()
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
