"""What tables would lose, gain and change by another model version: a look ahead."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime

from app.compensation.table_difference import ComponentChange, component_changes
from app.effects.adopted.model_difference import ModelDifference, ModelWithEffects
from app.effects.effect import Effect
from app.errors import ThermapError
from app.live.registry import LiveMachine, LiveModel
from app.services.change_model import (
    Draft,
    MachineChange,
    WaitedBefore,
    difference_to_active,
    waited_before,
)
from app.services.context import Context
from app.services.live_table import CurrentTable, current_state, current_table
from app.services.load_machine import adopted_effects, compile_version, load_machine
from app.services.restore_past import restore_past
from app.storage.records import ModelVersion
from app.thermal.compiled_model import CompiledModel


@dataclass(frozen=True, slots=True, eq=False)
class PresentChange:
    """By how much tables would change at the latest reading.

    `why_not` says why that is not known; the others are empty then.
    """

    why_not: str = ""
    reading_time: datetime | None = None
    temperatures_c: Mapping[str, float] = field(default_factory=dict)
    changes: Sequence[ComponentChange] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Preview:
    """What another version would do to the tables.

    `activates` says whether it would be activated without more ado, and `reason` what would
    make it; `active_version` is the one that it is held against, None before the first, and
    `waited_before` what waits already, which may be why something is lost.
    """

    reason: str
    active_version: int | None
    activates: bool
    difference: ModelDifference
    present: PresentChange
    waited_before: WaitedBefore | None


def preview_draft(
    context: Context, change: MachineChange, draft: Draft, *, activates: bool = False
) -> Preview:
    """Say what a version that is not written yet would do.

    It is activated if it loses nothing, with `activates` whatever it loses.
    """
    return _preview(context, change, draft.reason, draft.model, draft.effects, activates=activates)


def preview_latest(context: Context, change: MachineChange, reason: str) -> Preview:
    """Say what becomes of what is stored already: nothing new, but something may wait."""
    latest = change.latest
    model, effects = compile_version(change.machine, latest), adopted_effects(latest)
    return _preview(context, change, reason, model, effects)


def preview_unchanged(context: Context, change: MachineChange, reason: str) -> Preview:
    """Say that tables stay as they are."""
    active = change.version
    model, effects = compile_version(change.machine, active), adopted_effects(active)
    return _preview(context, change, reason, model, effects)


def preview_activation(context: Context, change: MachineChange, version: ModelVersion) -> Preview:
    """Say what activating a version would do: it is active whatever it loses."""
    model, effects = compile_version(change.machine, version), adopted_effects(version)
    reason = f"version {version.version} activated"
    return _preview(context, change, reason, model, effects, activates=True)


def _preview(
    context: Context,
    change: MachineChange,
    reason: str,
    model: CompiledModel,
    effects: Sequence[Effect],
    *,
    activates: bool = False,
) -> Preview:
    difference = difference_to_active(context, change, ModelWithEffects(model, effects))
    return Preview(
        reason=reason,
        active_version=change.row.active_version,
        activates=activates or not difference.loses,
        difference=difference,
        present=_present_change(context, change, model, effects),
        waited_before=waited_before(context, change),
    )


def _present_change(
    context: Context, change: MachineChange, model: CompiledModel, effects: Sequence[Effect]
) -> PresentChange:
    """Compute the table at the latest reading with the active model, and with another."""
    if change.row.active_version is None:
        return PresentChange("there is no active model yet")
    live = context.live.get(change.row.id)
    if live is None or live.current.version != change.row.active_version:
        live = load_machine(context, change.row.id)
    other = _with_model(context, live, model, effects)
    tables = []
    for whose, machine in (("", live), ("with the new version ", other)):
        try:
            state = current_state(context, change.row.id, machine)
            tables.append(current_table(context, state))
        except ThermapError as error:
            return PresentChange(f"{whose}there is no table now: {error.detail}")
    before, after = tables
    return PresentChange(
        reading_time=before.state.reading.time,
        temperatures_c=_used_temperatures(before),
        changes=component_changes(before.table, after.table),
    )


def _used_temperatures(current: CurrentTable) -> dict[str, float]:
    sensors = current.state.sensors
    return {s.sensor: s.temperature_c for s in sensors if s.temperature_c is not None}


def _with_model(
    context: Context, live: LiveMachine, model: CompiledModel, effects: Sequence[Effect]
) -> LiveMachine:
    """Set another model beside a machine's readings, with the past that its effects need."""
    now = live.current
    other = LiveMachine(
        LiveModel(model, now.version, now.created_at, now.revision, now.loaded_at, tuple(effects))
    )
    held = live.readings.held
    # A window of its own: what becomes usable meanwhile is the live machine's to take in.
    other.readings.replace(model.machine, [*held.used, *held.ahead], context.usable_until())
    other.is_behind = False
    if live.past.serves(model.machine, other.current.needed):
        other.past = live.past
    else:
        restore_past(context, other)
    return other
