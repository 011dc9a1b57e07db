"""Which errors of a machine have to be measured, and whether its model has them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from app.geometry.components import COMPONENTS, ORDER, Component
from app.geometry.needed_components import needed_components
from app.geometry.nonrigid_presets import NonrigidPreset, find_preset
from app.services.ask_field import Triple
from app.services.context import Context
from app.services.load_machine import load_machine
from app.thermal.machine import Machine


@dataclass(frozen=True, slots=True)
class NeededComponents:
    """The components that a machine's volumetric error consists of.

    `in_model` are those that the active model's maps have: with at least one map, which
    is not yet enough to follow a temperature.
    """

    machine: Machine
    preset: NonrigidPreset | None
    needed: Sequence[Component]
    in_model: frozenset[str]
    warnings: Sequence[str]

    @property
    def missing(self) -> list[str]:
        """Those that have to be measured still."""
        return [one.code for one in self.needed if one.code not in self.in_model]


def check_components(
    context: Context, machine_id: str, tool_offset_mm: Triple, preset: str | None = None
) -> NeededComponents:
    """List what has to be measured of a machine, rigid or of one of the chapter's presets.

    Parameters
    ----------
    context, machine_id
        Whose components.
    tool_offset_mm
        Tool offset T [mm]: a lever arm of every rotation.
    preset
        Name of a kind of machine that is not rigid; None for a rigid one.

    Raises
    ------
    UnknownThing
        If there is no such machine or preset.
    """
    kind = find_preset(preset) if preset is not None else None
    live = context.live.get(machine_id) or load_machine(context, machine_id)
    model = live.current.model
    chain = model.machine.chain
    codes = set(needed_components(chain, tool_offset_mm, model.measuring_lines))
    warnings = []
    if kind is not None:
        codes |= {code for code in kind.slopes if COMPONENTS[code].axis in chain.axes}
        if kind.configuration != chain.text:
            warnings.append(
                f"the preset {kind.name} is given for {kind.configuration} ({kind.equations}); "
                f"this machine is {chain.text}: judge whether its axes bend in the same way"
            )
    return NeededComponents(
        machine=model.machine,
        preset=kind,
        needed=[COMPONENTS[code] for code in sorted(codes, key=ORDER.__getitem__)],
        in_model=frozenset(code for group in model.groups for code in group.codes),
        warnings=warnings,
    )
