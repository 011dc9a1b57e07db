"""Adopt effects that an analysis found: the next model version contains them."""

from __future__ import annotations

from collections.abc import Sequence

from app.errors import Conflict, InvalidContent, list_names
from app.identification.effects.effect import Effect, effect_from_json
from app.identification.effects.registry import explain
from app.identification.past import sensors_of
from app.services.change_model import MachineChange, changing_machine, next_version
from app.services.context import Context
from app.services.load_machine import adopted_effects
from app.storage.records import ModelVersion
from app.thermal.machine import Machine


def adopt_effects(
    context: Context, machine_id: str, effects: Sequence[Effect], reason: str
) -> ModelVersion:
    """Make the model version that has these effects beside those of the active one.

    From its commit on tables, predictions and everything made of them contain the effects;
    activating the version before takes them back.

    Parameters
    ----------
    context, machine_id
        Which machine.
    effects
        At least one.
    reason
        What the version's reason says.

    Returns
    -------
    ModelVersion
        The new, active one.

    Raises
    ------
    UnknownThing
        If there is no such machine.
    InvalidContent
        If there is no effect, or one names a sensor that the machine lacks.
    Conflict
        If the machine has no model yet, or the active version has one of the effects.
    """
    with changing_machine(context, machine_id) as change:
        return add_effects(context, change, effects, reason)


def add_effects(
    context: Context, change: MachineChange, effects: Sequence[Effect], reason: str
) -> ModelVersion:
    """Do the same inside a change of the machine that has more to write.

    Raises
    ------
    InvalidContent, Conflict
        As `adopt_effects`.
    """
    if not effects:
        raise InvalidContent.of_field("effects", "expected at least one effect, came none")
    before = change.version
    if before is None:
        raise Conflict(f"machine {change.row.id!r} has no model yet: store error maps first")
    known = adopted_effects(before)
    for effect in effects:
        _check_effect(change.machine, effect)
        if effect in known:
            raise Conflict(
                f"model version {before.version} has this effect already: {explain(effect)}"
            )
    return next_version(context, change, before.maps, reason, effects=[*known, *effects])


def _check_effect(machine: Machine, effect: Effect) -> None:
    """Refuse an effect that could not be read or told of again, or never be evaluated."""
    explain(effect_from_json(effect.to_json()))
    unknown = sorted(sensors_of([effect]) - set(machine.sensors))
    if unknown:
        raise InvalidContent.of_field(
            "effects",
            f"expected sensors of machine {machine.id!r} ({list_names(machine.sensors)}), came "
            f"{list_names(unknown)} in {effect.kind}",
        )
