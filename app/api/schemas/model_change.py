"""What becomes of the tables when a model version is made: lost, gained, changed, activated."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from pydantic import Field

from app.effects.adopted.model_difference import Part
from app.services.change_model import MadeVersion, WaitedBefore
from app.stated import Schema


class ModelChange(Schema):
    """Which version was made, and whether tables are computed with it."""

    model_version: int | None = Field(None, description="The version that was made", examples=[4])
    activated: bool | None = Field(
        None,
        description="Whether it is active; a version that loses something waits until somebody "
        "activates it, and the next ones are made of it",
    )
    loses: Sequence[Part] = Field(
        default_factory=list,
        description="What its tables lack against those of the version active before",
    )
    gains: Sequence[Part] = Field(
        default_factory=list, description="What its tables have beyond those"
    )
    next_step: str | None = Field(
        None, description="How to activate it all the same; null where it is active"
    )
    waited_before: WaitedBefore | None = Field(
        None, description="What waited already; null where nothing did"
    )
    stays_active: int | None = Field(
        None, description="The version that stays active while this one waits; null where it is"
    )


def change_fields(machine: str, new_version: MadeVersion | None) -> dict[str, Any]:
    """Write the fields of `ModelChange`; none where no version was made."""
    if new_version is None:
        return {}
    return {
        "model_version": new_version.version.version,
        "activated": new_version.is_active,
        "loses": new_version.difference.loses,
        "gains": new_version.difference.gains,
        "next_step": None if new_version.is_active else _how_to_activate(machine, new_version),
        "waited_before": new_version.waited_before,
        "stays_active": None if new_version.is_active else new_version.active_version,
    }


def _how_to_activate(machine: str, new_version: MadeVersion) -> str:
    number = new_version.version.version
    return (
        f"Version {number} is stored and waits, because its tables would lose something; version "
        f"{new_version.active_version} of machine {machine!r} stays active. Activating {number} "
        "lets "
        f"tables follow it all the same; activating {new_version.active_version} again gives it "
        "up, and "
        "deleting the map that would lose something takes that out. Versions made meanwhile "
        "contain what it contains."
    )
