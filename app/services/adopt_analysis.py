"""Adopt what an analysis found: the next model version contains it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import orjson

from app.errors import Conflict, InvalidContent
from app.identification.effects.effect import Effect, effect_from_json
from app.services.adopt_effects import add_effects
from app.services.change_model import MachineChange, changing_machine
from app.services.context import Context
from app.storage.analyses import find_analysis
from app.storage.records import AnalysisStatus, ModelVersion
from app.storage.tables import AnalysisRow


def adopt_analysis(
    context: Context,
    machine_id: str,
    analysis_id: int,
    places: Sequence[int] | None = None,
    *,
    onto_active: bool = False,
) -> ModelVersion:
    """Make the next model version with the effects that an analysis found, once.

    Parameters
    ----------
    context, machine_id, analysis_id
        The service, and which analysis.
    places
        Places in the result's list of effects; None: all.
    onto_active
        Whether to add them to the active version where another one was analysed.

    Raises
    ------
    UnknownThing
        If there is no such analysis.
    InvalidContent
        If the result has no effect at a place, or a place is named twice.
    Conflict
        If the analysis is not done, found nothing or was adopted before, or another version
        than the analysed one is active; also as `add_effects`.
    """
    with changing_machine(context, machine_id) as change:
        row = find_analysis(change.session, machine_id, analysis_id, result=True)
        effects = _effects(row, places)
        if not onto_active:
            _check_active(change, row)
        what = ", ".join(f"{e.kind} on {' '.join(e.components)}" for e in effects)
        version = add_effects(context, change, effects, f"analysis {analysis_id} adopted: {what}")
        row.adopted_version = version.version
    return version


def _effects(row: AnalysisRow, places: Sequence[int] | None) -> list[Effect]:
    """Read the chosen effects of a result that may be adopted."""
    if row.status != AnalysisStatus.DONE or row.result is None:
        raise Conflict(f"analysis {row.id} has nothing to adopt: it is {row.status}")
    if row.adopted_version is not None:
        raise Conflict(
            f"analysis {row.id} was adopted before, as model version {row.adopted_version}: "
            "activate that version to compute with it again"
        )
    found: list[Any] = orjson.loads(row.result)["effects"]
    if not found:
        raise Conflict(f"analysis {row.id} found no effect to adopt")
    chosen = range(len(found)) if places is None else places
    if len(set(chosen)) < len(chosen) or not set(chosen) <= set(range(len(found))):
        raise InvalidContent.of_field(
            "effects",
            f"expected places from 0 to {len(found) - 1}, each once, came {list(chosen)}",
        )
    return [effect_from_json(found[place]["effect"]) for place in chosen]


def _check_active(change: MachineChange, row: AnalysisRow) -> None:
    active = change.row.active_version
    if active != row.model_version:
        raise Conflict(
            f"analysis {row.id} was made of model version {row.model_version}, but {active} is "
            f"active: activate {row.model_version} again, analyse {active}, or state onto_active "
            f"to add the effects to version {active}, on which nobody has tested them"
        )
