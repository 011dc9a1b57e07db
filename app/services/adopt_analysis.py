"""Adopt what an analysis found: the next model version contains it."""

from __future__ import annotations

from collections.abc import Sequence

from app.effects.adopted.model_difference import ModelWithEffects
from app.effects.effect import Effect, effect_from_json
from app.effects.past import sensors_of
from app.effects.registry import explain
from app.errors import Conflict, InvalidContent, list_names
from app.services.change_model import (
    Draft,
    MachineChange,
    MadeVersion,
    changing_machine,
    difference_to_active,
    draft_version,
    looking_at_machine,
    make_version,
    remake_waiting,
)
from app.services.choose_version import no_model_yet
from app.services.context import Context
from app.services.load_machine import adopted_effects
from app.services.preview_model import Preview, preview_draft
from app.services.repeating import repeated
from app.storage.analyses import find_analysis
from app.storage.analysis_results import RESULTS
from app.storage.model_versions import find_version
from app.storage.records import AnalysisStatus
from app.storage.tables import AnalysisRow
from app.thermal.machine import Machine


@repeated
def adopt_analysis(
    context: Context,
    machine_id: str,
    analysis_id: int,
    places: Sequence[int] | None = None,
    *,
    onto_active: bool = False,
    accept_losses: bool = False,
) -> MadeVersion:
    """Make the next model version with the effects that an analysis found, once.

    Parameters
    ----------
    context, machine_id, analysis_id
        The service, and which analysis.
    places
        Places in the result's list of effects; None: all.
    onto_active
        Whether to add them to the active version where another one was analysed.
    accept_losses
        Whether the version is activated although it loses something against the active one.

    Raises
    ------
    UnknownThing
        If there is no such analysis.
    InvalidContent
        If the result has no effect at a place, or a place is named twice.
    Conflict
        If the analysis is not done, found nothing or was adopted before, or another version
        than the analysed one is active; also as `version_with_effects`.
    """
    with changing_machine(context, machine_id) as change:
        row = find_analysis(change.session, machine_id, analysis_id, result=True)
        effects = _chosen(change, row, places, onto_active=onto_active)
        made = version_with_effects(
            context, change, effects, _reason(row, effects), accept_losses=accept_losses
        )
        row.adopted_version = made.version.version
    return made


def preview_adoption(
    context: Context,
    machine_id: str,
    analysis_id: int,
    places: Sequence[int] | None = None,
    *,
    onto_active: bool = False,
) -> Preview:
    """Say what adopting effects would do to the tables, and change nothing.

    Raises
    ------
    UnknownThing, InvalidContent, Conflict
        As `adopt_analysis`.
    """
    with looking_at_machine(context, machine_id) as change:
        row = find_analysis(change.session, machine_id, analysis_id, result=True)
        effects = _chosen(change, row, places, onto_active=onto_active)
        return preview_draft(context, change, _draft(change, effects, _reason(row, effects)))


def _chosen(
    change: MachineChange, row: AnalysisRow, places: Sequence[int] | None, *, onto_active: bool
) -> list[Effect]:
    effects = _effects(row, places)
    if not onto_active:
        _check_active(change, row)
    _check_unlike(change, row, effects)
    return effects


def _reason(row: AnalysisRow, effects: Sequence[Effect]) -> str:
    what = ", ".join(f"{e.kind} on {' '.join(e.components)}" for e in effects)
    return f"analysis {row.id} adopted: {what}"


def version_with_effects(
    context: Context,
    change: MachineChange,
    effects: Sequence[Effect],
    reason: str,
    *,
    accept_losses: bool = False,
) -> MadeVersion:
    """Make the model version that has these effects beside those of the active one.

    From the commit of the change on tables, predictions and everything made of them contain
    the effects, if the version loses nothing; activating the version before takes them back.

    A version that waits is made anew with the effects. Where these lose something themselves,
    they wait with it.

    Parameters
    ----------
    context, change
        The service, and the machine under its lock.
    effects
        At least one.
    reason
        What the version's reason says.
    accept_losses
        Whether the version is activated although it loses something against the active one.

    Raises
    ------
    InvalidContent
        If there is no effect, or one names a sensor that the machine lacks.
    Conflict
        If the machine has no model yet, or the active version has one of the effects.
    """
    waiting = change.waiting
    draft = _draft(change, effects, reason)
    after = ModelWithEffects(draft.model, draft.effects)
    waits = not accept_losses and difference_to_active(context, change, after).loses
    if waiting is not None and waits:
        together = [*adopted_effects(waiting), *effects]
        draft = draft_version(change, waiting, waiting.maps, reason, effects=together)
        return make_version(context, change, draft)
    made = make_version(context, change, draft, accept_losses=accept_losses)
    remake_waiting(context, change, waiting)
    return made


def _draft(change: MachineChange, effects: Sequence[Effect], reason: str) -> Draft:
    """Put the version together that has effects beside those of the active one."""
    if not effects:
        raise InvalidContent.of_field("effects", "expected at least one effect, came none")
    active = change.version
    if active is None:
        raise no_model_yet(change.row.id)
    known = adopted_effects(active)
    for effect in effects:
        _check_effect(change.machine, effect)
        if effect in known:
            raise Conflict(
                f"model version {active.version} has this effect already: {explain(effect)}"
            )
    return draft_version(change, active, active.maps, reason, effects=[*known, *effects])


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


def _effects(row: AnalysisRow, places: Sequence[int] | None) -> list[Effect]:
    """Read the chosen effects of a result that may be adopted."""
    if row.status != AnalysisStatus.DONE or row.result is None:
        raise Conflict(f"analysis {row.id} has nothing to adopt: it is {row.status}")
    if row.adopted_version is not None:
        raise Conflict(
            f"analysis {row.id} was adopted before, as model version {row.adopted_version}: "
            "activate that version to compute with it again"
        )
    found = RESULTS.read_text(row.result).effects
    if not found:
        raise Conflict(f"analysis {row.id} found no effect to adopt")
    chosen = range(len(found)) if places is None else places
    if len(set(chosen)) < len(chosen) or not set(chosen) <= set(range(len(found))):
        raise InvalidContent.of_field(
            "effects",
            f"expected places from 0 to {len(found) - 1}, each once, came {list(chosen)}",
        )
    return [found[place].effect for place in chosen]


def _check_unlike(change: MachineChange, row: AnalysisRow, effects: Sequence[Effect]) -> None:
    """Refuse what the active version has learnt since in other figures: it would count twice."""
    active = change.version
    if active is None or active.version == row.model_version:
        return
    analysed = adopted_effects(find_version(change.session, change.row.id, row.model_version))
    since = [one for one in adopted_effects(active) if one not in analysed]
    for effect in effects:
        for one in since:
            if _what(one) == _what(effect) and one != effect:
                raise Conflict(
                    f"model version {active.version} has learnt of a like effect since: "
                    f"{explain(one)}; adding this one would count it twice: {explain(effect)}"
                )


def _what(effect: Effect) -> tuple[object, ...]:
    return effect.kind, effect.components, effect.sensors, effect.states


def _check_active(change: MachineChange, row: AnalysisRow) -> None:
    active = change.row.active_version
    if active != row.model_version:
        raise Conflict(
            f"analysis {row.id} was made of model version {row.model_version}, but {active} is "
            f"active: activate {row.model_version} again, analyse {active}, or state onto_active "
            f"to add the effects to version {active}, on which nobody has tested them"
        )
