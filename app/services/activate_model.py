"""Make any version of a machine's model the active one."""

from __future__ import annotations

from app.effects.adopted.model_difference import ModelWithEffects
from app.services.change_model import (
    MadeVersion,
    changing_machine,
    difference_to_active,
    looking_at_machine,
)
from app.services.context import Context
from app.services.load_machine import adopted_effects, compile_version
from app.services.preview_model import Preview, preview_activation
from app.services.repeating import repeated
from app.storage.model_versions import activate_version, find_version, let_wait


@repeated
def activate_model(context: Context, machine_id: str, version: int) -> MadeVersion:
    """Activate a version, whatever its tables lose: the answer says what.

    Another version that waited waits no more, for the next one is made of the active one.

    Raises
    ------
    UnknownThing
        If there is no such version.
    InvalidContent, Conflict
        If the machine's present sensors no longer fit it.
    """
    with changing_machine(context, machine_id) as change:
        found = find_version(change.session, machine_id, version)
        model = compile_version(change.machine, found)
        after = ModelWithEffects(model, adopted_effects(found))
        difference = difference_to_active(context, change, after)
        if change.row.active_version != version:
            activate_version(change.row, version)
        let_wait(change.row, None)
    return MadeVersion(found, True, version, difference)


def look_at_activation(context: Context, machine_id: str, version: int) -> Preview:
    """Say what activating a version would do, and leave everything as it is.

    Raises
    ------
    UnknownThing, InvalidContent, Conflict
        As `activate_model`.
    """
    with looking_at_machine(context, machine_id) as change:
        found = find_version(change.session, machine_id, version)
        return preview_activation(context, change, found)
