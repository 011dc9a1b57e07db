"""Adopt what an analysis found: the next model version contains it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, NamedTuple

from pydantic import Field

from app.effects.adopted.carry_over import without_replaced
from app.effects.effect import Effect, Provenance, effect_from_json
from app.effects.past import sensors_of
from app.effects.registry import do_the_same, explain, kind_of
from app.errors import Conflict, InvalidContent, list_names
from app.identification.analysis.analysis import Analysis
from app.identification.analysis.found_effect import RefittedEffect
from app.identification.analysis.refits import effects_after
from app.services.change_model import (
    Draft,
    MachineChange,
    MadeVersion,
    changing_machine,
    difference_to_active,
    draft_version,
    make_version,
    no_model_yet,
    reading_machine,
    remake_waiting,
)
from app.services.context import Context, repeated
from app.services.load_machine import adopted_effects
from app.services.models import ChangedModelAnswer, Preview, changed_model, preview_draft
from app.stated import Integer, Schema, YesOrNo
from app.storage.analyses import find_analysis
from app.storage.analysis_results import RESULTS
from app.storage.model_versions import find_version
from app.storage.records import AnalysisStatus
from app.storage.tables import AnalysisRow
from app.thermal.machine import Machine


class AdoptionRequest(Schema):
    """Which of the effects that an analysis found go into the model."""

    effects: Annotated[list[Integer], Field(min_length=1, max_length=100)] | None = Field(
        None,
        description="Places in the result's list of effects, from 0, whatever is known of them; "
        "where it is left out, those that help (`helps`)",
        examples=[[0, 1]],
    )
    onto_active: YesOrNo = Field(
        False,
        description="Whether to add them to the active version where that is no longer the one "
        "that was analysed: they were found on another model, so look at its residuals after",
    )


@repeated
def adopt_analysis(
    context: Context,
    machine_id: str,
    analysis_id: int,
    adoption: AdoptionRequest,
    *,
    accept_losses: bool = False,
) -> ChangedModelAnswer:
    """Make the next model version with the effects that an analysis found, once.

    Where no place is named, effects that the version has are replaced by what they are refitted to
    beside those that help; beside others they stay.

    Raises
    ------
    InvalidContent
        If the result has no effect at a place, or a place is named twice.
    Conflict
        If the analysis is not done, found nothing, or nothing that helps where no place is
        named, or was adopted before, or another version
        than the analysed one is active; also as `version_with_effects`.
    """
    with changing_machine(context, machine_id) as change:
        row = find_analysis(change.session, machine_id, analysis_id, result=True)
        chosen = _chosen(change, row, adoption)
        new_version = version_with_effects(
            *(context, change, chosen.effects, chosen.reason),
            refitted=chosen.refitted,
            accept_losses=accept_losses,
        )
        row.adopted_version = new_version.version.version
        row.confirmed = chosen.left_out
    return changed_model(new_version)


def preview_adoption(
    context: Context, machine_id: str, analysis_id: int, adoption: AdoptionRequest
) -> Preview:
    """Say what adopting effects would do to the tables, and change nothing.

    Raises
    ------
    UnknownThing, InvalidContent, Conflict
        As `adopt_analysis`.
    """
    with reading_machine(context, machine_id) as change:
        row = find_analysis(change.session, machine_id, analysis_id, result=True)
        chosen = _chosen(change, row, adoption)
        draft = _draft(change, chosen.effects, chosen.reason, chosen.refitted)
        return preview_draft(context, change, draft)


class _Chosen(NamedTuple):
    """What an analysis adds to a model, what it makes of the effects there, and why.

    `left_out` are the sentences of effects that it confirmed, too, and that nobody chose.
    """

    left_out: list[str]
    effects: list[Effect]
    refitted: list[RefittedEffect]
    reason: str


def _chosen(change: MachineChange, row: AnalysisRow, adoption: AdoptionRequest) -> _Chosen:
    result, places = _result(row), adoption.effects
    chosen = _helping(row, result) if places is None else places
    effects = _effects(row, result, chosen)
    if not adoption.onto_active:
        _check_active(change, row)
    _check_unlike(change, row, effects)
    left_out = [
        candidate.explanation
        for place, candidate in enumerate(result.effects)
        if place not in chosen and candidate.helps and candidate.status == "confirmed"
    ]
    return _Chosen(left_out, effects, *_refitted(change, row, result, chosen))


def _refitted(
    change: MachineChange, row: AnalysisRow, result: Analysis, chosen: Sequence[int]
) -> tuple[list[RefittedEffect], str]:
    """Say what becomes of the active version's effects, and write the reason of the next one."""
    effects = [result.effects[place] for place in chosen]
    what = ", ".join(f"{effect.kind} on {' '.join(effect.components)}" for effect in effects)
    reason = f"analysis {row.id} adopted: {what}" if what else f"analysis {row.id} adopted"
    in_model = adopted_effects(change.version)
    refits = [
        refit for refit in result.refitted if refit.outcome != "left" and refit.effect in in_model
    ]
    if not refits:
        return [], reason
    if set(chosen) != {place for place, candidate in enumerate(result.effects) if candidate.helps}:
        stay = (
            "the effects adopted before stay as they are, because they were refitted together "
            "with other effects"
        )
        return [], f"{reason}; {stay}"
    analysed = [int(number) for number in row.verification_ids]
    with_provenance = [
        refit
        if refit.becomes is None or refit.effect.provenance is None
        else replace(
            refit,
            becomes=replace(
                refit.becomes, provenance=refit.effect.provenance.refitted(row.id, analysed)
            ),
        )
        for refit in refits
    ]
    return with_provenance, "; ".join([reason, *(refit.explanation for refit in with_provenance)])


def version_with_effects(
    context: Context,
    change: MachineChange,
    effects: Sequence[Effect],
    reason: str,
    *,
    refitted: Sequence[RefittedEffect] = (),
    accept_losses: bool = False,
) -> MadeVersion:
    """Make the model version that has these effects beside those of the active one.

    From the commit of the change on tables, predictions and everything made of them contain
    the effects, if the version loses nothing; activating the version before takes them back.

    A version that waits is made anew with the effects. Where these lose something themselves,
    they wait with it.

    Parameters
    ----------
    refitted
        What becomes of effects that the active version has.

    Raises
    ------
    InvalidContent
        If there is no effect and nothing is refitted, or one names a sensor that the machine lacks.
    Conflict
        If the machine has no model yet, or the active version has one of the effects.
    """
    waiting = change.waiting
    draft = _draft(change, effects, reason, refitted)
    waits = not accept_losses and difference_to_active(context, change, draft.effective).loses
    if waiting is not None and waits:
        in_waiting = without_replaced(adopted_effects(waiting), effects)
        together = effects_after(in_waiting, refitted, effects)
        draft = draft_version(change, waiting, waiting.maps, reason, effects=together)
        return make_version(context, change, draft)
    new_version = make_version(context, change, draft, accept_losses=accept_losses)
    remake_waiting(context, change, waiting)
    return new_version


def _draft(
    change: MachineChange,
    effects: Sequence[Effect],
    reason: str,
    refitted: Sequence[RefittedEffect],
) -> Draft:
    """Put the version together that has effects beside those of the active one."""
    if not effects and not refitted:
        raise InvalidContent.of_field("effects", "expected at least one effect, got none")
    active = change.version
    if active is None:
        raise no_model_yet(change.row.id)
    in_active = adopted_effects(active)
    for effect in [*effects, *(refit.becomes for refit in refitted if refit.becomes is not None)]:
        _check_effect(change.machine, effect)
    for effect in effects:
        if effect in in_active:
            raise Conflict(
                f"model version {active.version} already has this effect: {explain(effect)}"
            )
    remaining = without_replaced(in_active, effects)
    together = effects_after(remaining, refitted, effects)
    return draft_version(change, active, active.maps, reason, effects=together)


def _check_effect(machine: Machine, effect: Effect) -> None:
    """Refuse an effect that could not be read or described again, or never be evaluated."""
    explain(effect_from_json(effect.to_json()))
    unknown = sorted(sensors_of([effect]) - set(machine.sensors))
    if unknown:
        raise InvalidContent.of_field(
            "effects",
            f"expected sensors of machine {machine.id!r} ({list_names(machine.sensors)}), got "
            f"{list_names(unknown)} in {effect.kind}",
        )


def _result(row: AnalysisRow) -> Analysis:
    """Read a result that may be adopted."""
    if row.status != AnalysisStatus.DONE or row.result is None:
        raise Conflict(f"analysis {row.id} has nothing to adopt: it is {row.status}")
    if row.adopted_version is not None:
        raise Conflict(
            f"analysis {row.id} was already adopted as model version {row.adopted_version}: "
            "activate that version to compute with it again"
        )
    result = RESULTS.read_text(row.result)
    if not result.effects and not result.is_refit_due:
        raise Conflict(f"analysis {row.id} found no effect to adopt")
    return result


def _effects(row: AnalysisRow, result: Analysis, chosen: Sequence[int]) -> list[Effect]:
    """Choose effects, and note where they come from."""
    effects = result.effects
    if len(set(chosen)) < len(chosen) or not set(chosen) <= set(range(len(effects))):
        raise InvalidContent.of_field(
            "effects",
            (
                f"expected numbers of effects from 0 to {len(effects) - 1}, each once, got "
                f"{list(chosen)}"
            ),
        )
    for place in chosen:
        if why := kind_of(effects[place].kind).not_adopted:
            raise Conflict(
                f"effect {place} of analysis {row.id}, {effects[place].kind}, cannot be adopted: "
                f"{why}"
            )
    origin = Provenance(row.id, (), tuple(int(number) for number in row.verification_ids))
    return [replace(effects[place].effect, provenance=origin) for place in chosen]


def _helping(row: AnalysisRow, result: Analysis) -> list[int]:
    """List the places of the effects that help; none where the model's own are to be moved."""
    effects = result.effects
    places = [place for place, effect in enumerate(effects) if effect.helps]
    if not places and not result.is_refit_due:
        why = "; ".join(
            f"effect {place}, {effect.kind} of {list_names(effect.components, 3)}: {effect.why_not}"
            for place, effect in enumerate(effects)
        )
        adoptable = [p for p, effect in enumerate(effects) if not kind_of(effect.kind).not_adopted]
        all_the_same = (
            f"; state effects, such as {adoptable[:1]}, to adopt one all the same"
            if adoptable
            else ""
        )
        raise Conflict(
            f"analysis {row.id} found no effect that is known to help ({why}){all_the_same}"
        )
    return places


def _check_unlike(change: MachineChange, row: AnalysisRow, effects: Sequence[Effect]) -> None:
    """Refuse what the active version has learnt since in other figures: it would count twice."""
    active = change.version
    if active is None or active.version == row.model_version:
        return
    analysed = adopted_effects(find_version(change.session, change.row.id, row.model_version))
    since = [
        adopted_effect
        for adopted_effect in adopted_effects(active)
        if adopted_effect not in analysed
    ]
    for effect in effects:
        for adopted_since in since:
            if do_the_same(adopted_since, effect) and adopted_since != effect:
                raise Conflict(
                    f"model version {active.version} has been given a similar effect since: "
                    f"{explain(adopted_since)}; adding this one would count it twice: "
                    f"{explain(effect)}"
                )


def _check_active(change: MachineChange, row: AnalysisRow) -> None:
    active = change.row.active_version
    if active != row.model_version:
        raise Conflict(
            f"analysis {row.id} was made with model version {row.model_version}, but version "
            f"{active} is active: activate {row.model_version} again, analyse {active}, or state "
            f"onto_active to add the effects to version {active}, on which nobody has tested them"
        )
