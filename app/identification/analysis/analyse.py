"""From a campaign to an answer: residuals, the repertoire of effects, the search, the sentences."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from app.arrays import FloatArray, one_blas_thread, rms
from app.effects.adopted.contributions import contributions
from app.effects.campaign_view import CampaignView
from app.effects.effect import Effect
from app.effects.kind import NotTested
from app.effects.kinds.response import Response
from app.effects.kinds.sensor_fault import SPIKES
from app.effects.observations import POINT_CHANNELS
from app.effects.registry import KINDS, Repertoire, kind_of, repertoire
from app.errors import list_names
from app.identification.analysis import analysis
from app.identification.analysis.advice import mistakes_first, not_compared, summary, what_next
from app.identification.analysis.analysis import Analysis, SmallestSeen, UnexplainedPart, by_reason
from app.identification.analysis.assignments import found_assignments, said_first
from app.identification.analysis.before_after import (
    NO_REPEATS,
    component_figures,
    figures_unit,
    lengths,
    pooled,
    pooled_figures,
    used_rows,
)
from app.identification.analysis.curves import plots
from app.identification.analysis.decide import Decision, decide, shakes
from app.identification.analysis.far_values import MOST_LISTED, far_values, left_out_words
from app.identification.analysis.figures import ComponentFigures
from app.identification.analysis.finished_search import FinishedSearch
from app.identification.analysis.found_effect import FoundEffect, RefittedEffect
from app.identification.analysis.found_effects import (
    faults_of_readings,
    found_effects,
)
from app.identification.analysis.generic_candidates import generic_candidates, words_of
from app.identification.analysis.held_out_visits import is_refit_better, maps_that_harm
from app.identification.analysis.next_visits import propose_visits
from app.identification.analysis.not_judged import (
    judged_channels,
    not_judged,
    stays_large,
    tells_scatter,
    with_what_stays_large,
    withhold,
)
from app.identification.analysis.reading_faults import ReadingFaults, reading_faults
from app.identification.analysis.refits import (
    BESIDE_A_MISTAKE,
    NOT_BETTER,
    AdoptedBefore,
    adopted_before,
    effects_after,
    refitted_effects,
)
from app.identification.analysis.responses import (
    Responses,
    beside_search,
    explained_by,
    find_responses,
    not_beside,
)
from app.identification.campaign import Campaign, residuals_of
from app.identification.doubted_sensors import comparisons, doubts, trusted_readings
from app.identification.observed_scatter import Contradiction, contradiction
from app.identification.residuals.inexact_sensors import (
    Inexact,
    error_columns,
    inexact_sensors,
    read_inexactly,
)
from app.identification.residuals.map_uncertainty import between_positions, map_uncertainty
from app.identification.residuals.residuals import LeftOut, Residuals, channel_unit
from app.identification.zeroed import to_state, zeroed
from app.search.candidate import Candidate, Known
from app.search.findings import FEW_VISITS, Findings, Untested, Verdict
from app.search.noise import COMMON
from app.search.search import Progress, search
from app.units import Unit

VERDICTS: Final[dict[Verdict, analysis.Verdict]] = {
    Verdict.FOUND: "effects-found",
    Verdict.NOTHING: "nothing-found",
    Verdict.UNEXPLAINED: "unexplained",
}

OUTLIERS: Final = {"outlier": "outlier", "visit-apart": "a visit far from all others"}

PREPARED: Final = 0.05
"""Share of the work before the search begins."""

SEARCHED: Final = 0.6
"""Share of the work after the search, when responses are learnt."""


def analyse(
    campaign: Campaign,
    *,
    holdout_fraction: float = 0.3,
    kinds: Collection[str] | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> Analysis:
    """Find what a model lacks, or say that nothing can be found.

    Parameters
    ----------
    holdout_fraction
        Share of the visits that is held out in turn.
    kinds
        Kinds of effects to look for; all without it.
    seed
        Of all draws: the same campaign and seed give the same answer.
    progress
        Called with the share done, 0 to 1, never falling, and what is being done.

    Raises
    ------
    InvalidContent
        If there is no such kind, no observation can be compared with the model, or measured
        values are evidently in another unit.
    """
    if progress is not None:
        progress(0.0, "subtracting the model")
    faults = reading_faults(campaign)
    campaign, as_given = faults.campaign, campaign
    trusted = trusted_readings(campaign.model, campaign.readings)
    inexact = inexact_sensors(campaign.model.machine, trusted)
    residuals = residuals_of(campaign, inexact)
    projection = residuals.projection
    view = CampaignView(campaign.model, campaign.maps, residuals.rows, projection.conditions)
    chosen_kinds = None if kinds is None else tuple(_checked_kinds(kinds))
    library = repertoire(view, chosen_kinds)
    rows = residuals.as_rows()
    before = adopted_before(campaign, projection, library.hypotheses)
    learns = chosen_kinds is None or Response.kind in chosen_kinds
    searched = SEARCHED if learns else 1.0
    with one_blas_thread():
        of_maps = map_uncertainty(
            projection, campaign.maps, error_columns(projection, trusted, inexact)
        )
        between = between_positions(projection, campaign.maps)
        generic = generic_candidates(view)

        def look(
            candidates: Sequence[Candidate], fixed: Known | None, progress: Progress | None
        ) -> FinishedSearch:
            findings = search(
                rows,
                of_maps,
                [*candidates, *generic],
                holdout_fraction=holdout_fraction,
                adopted=fixed,
                unsaid=between,
                seed=seed,
                progress=progress,
            )
            use = used_rows(findings, len(rows.values))
            of_rows = (residuals, rows, findings, use)
            return FinishedSearch(*of_rows, library.with_forms, of_maps, campaign.maps)

        finished = look(
            library.candidates,
            before.known(library.candidates),
            _part(progress, PREPARED, searched),
        )
        finished, before = _with_refits_that_hold(
            finished,
            before,
            lambda: look(
                before.beside(library.candidates), None, _part(progress, searched, searched)
            ),
        )
        responses = Responses()
        if learns:
            as_read = None if inexact else residuals
            responses = find_responses(campaign, _part(progress, searched, 1.0), as_read)
    finished = with_what_stays_large(finished)
    faulty = faults_of_readings(finished, faults, _believed(as_given, residuals, faults))
    finished, responses = beside_search(finished, responses, campaign.effects)
    answer = _answer(
        finished, library, faulty, responses, campaign.effects, before, seed, chosen_kinds
    )
    answer = withhold(
        answer,
        not_judged(finished),
        stays_large(finished),
        judged_channels(finished),
    )
    answer = _with_next_steps(answer, campaign, residuals, inexact)
    return said_first(answer, campaign.model.machine.id)


def _checked_kinds(kinds: Collection[str]) -> list[str]:
    """Order kinds as the registry does, so that the order of asking decides nothing."""
    for name in kinds:
        kind_of(name)
    return [name for name in KINDS if name in kinds]


def _part(progress: Progress | None, begin: float, end: float) -> Progress | None:
    """Tell the share of a part of the work as one of the whole."""
    if progress is None:
        return None
    return lambda share, words: progress(begin + (end - begin) * share, words)


def _believed(as_given: Campaign, residuals: Residuals, faults: ReadingFaults) -> FloatArray:
    """Give the residuals with faulty readings believed; NaN where they were not believed."""
    believed = np.full(len(residuals.rows), np.nan)
    if any(effect.variant == SPIKES for effect in faults.effects):
        as_declared = residuals_of(as_given)
        values = np.full(len(as_declared.kept), np.nan)
        values[as_declared.kept] = as_declared.values
        believed = values[residuals.kept]
    return believed


def _with_refits_that_hold(
    finished: FinishedSearch, before: AdoptedBefore, staying: Callable[[], FinishedSearch]
) -> tuple[FinishedSearch, AdoptedBefore]:
    """Fit what the model has anew only where held-out set-ups agree; else search beside it."""
    if finished.findings.known is None:
        return finished, before
    again = refitted_effects(finished, before, finished.findings.refitted, is_refused=False)
    is_changed = any(refit_.is_changed for refit_ in again)
    effects = finished.effects()
    if any(
        finished.is_name_sure(effect, term) and shakes(effect, refit_.effect, term.channels)
        for effect, term in zip(effects, finished.findings.terms, strict=True)
        for refit_ in before.anew
    ):
        return staying(), before.staying(BESIDE_A_MISTAKE)
    acts = (before.explained != 0.0) | (np.nan_to_num(finished.findings.known) != 0.0)
    channels = np.unique(finished.rows.channel[acts & finished.use]).tolist()
    is_shared = any(set(channels).intersection(term.channels) for term in finished.findings.terms)
    beside = staying() if is_shared else finished.without_refits()
    if is_refit_better(finished, channels, beside.findings.adopted):
        return finished, before
    # What stays although it would have moved leaves something that is to be judged.
    beside = staying() if is_changed and not is_shared else beside
    return beside, before.staying(NOT_BETTER)


def _answer(
    finished: FinishedSearch,
    library: Repertoire,
    faulty: Sequence[FoundEffect],
    responses: Responses,
    adopted: Sequence[Effect],
    before: AdoptedBefore,
    seed: int,
    kinds: tuple[str, ...] | None,
) -> Analysis:
    effects = finished.effects()
    decision = decide(finished, effects)
    if not decision.refits_hold:
        finished = finished.without_refits()
        decision = decide(finished, effects)
    effects, refitted = _together(finished, before, effects, decision)
    findings = finished.findings
    explained = _by_live_path(finished, adopted, effects_after(adopted, refitted, effects))
    for mistake in (effect for effect in effects if not effect.terms):
        explained = explained + finished.explained(mistake)
    for offered in responses.offered:
        explained = explained + explained_by(finished, offered, adopted)
    chosen = finished.use & lengths(finished.residuals)
    seen = np.where(np.isfinite(findings.adopted), 0.0, np.nan)
    residuals_after = finished.rows.values - explained
    size = pooled_figures(finished.rows, finished.zeros, finished.rows.values, seen, chosen, seed)
    after = pooled_figures(
        finished.rows, finished.zeros, residuals_after, findings.adopted, chosen, seed
    )
    of_search = not_beside(found_effects(finished, effects, decision), adopted)
    described = [
        *of_search,
        *(offered.found for offered in responses.offered),
        *faulty,
    ]
    components = component_figures(
        finished.residuals, finished.rows, explained, findings, finished.use
    )
    unexplained = _unexplained(finished, residuals_after)
    not_testable = (*_not_testable(library, findings), *by_reason(responses.not_testable))
    verdict = VERDICTS[findings.verdict]
    is_due = any(refit_.is_changed for refit_ in refitted)
    if (faulty or responses.offered or is_due) and findings.verdict is Verdict.NOTHING:
        verdict = VERDICTS[Verdict.FOUND]
    noise = _noise(finished)
    floor = _floor(components)
    unit = figures_unit(finished.residuals)
    far = far_values(finished)
    denied = _contradiction(finished)
    not_seen, to_see = not_compared(finished.residuals.left_out, len(finished.residuals.rows))
    sentence = summary(
        *(verdict, described, refitted, unexplained, size, after, noise, unit, kinds, components)
    )
    return Analysis(
        verdict=verdict,
        summary=(
            maps_that_harm(finished)
            + sentence
            + (f" {denied.sentence}" if denied else "")
            + not_seen
            + left_out_words(far)
        ),
        kinds=kinds,
        unit=unit,
        noise=noise,
        floor=floor,
        floor_unknown=None if floor is not None else NO_REPEATS,
        before=size,
        after=after,
        after_with_maps_refitted=pooled_figures(
            finished.rows, finished.zeros, residuals_after, findings.predicted, chosen, seed
        ),
        p_global=findings.global_p,
        visits=int(np.unique(finished.rows.visit[finished.use]).size),
        values=int(finished.use.sum()),
        components=tuple(components),
        effects=tuple(described),
        refitted=refitted,
        unexplained=tuple(unexplained),
        excluded=tuple(_excluded(finished.residuals, findings)),
        far_values=far[:MOST_LISTED],
        not_testable=not_testable,
        detectable=tuple(_detectable(finished)),
        what_next=what_next(
            *(described, unexplained, finished.residuals.rows.visits, far),
            [*filter(None, (to_see, denied.to_state if denied else ""))],
            components=components,
            is_short_of_visits=any(
                untested_.reason == FEW_VISITS for untested_ in findings.untested
            ),
            is_cut=findings.is_cut,
            times_s=finished.residuals.rows.times_s[finished.use],
        ),
        assignments=found_assignments(finished, of_search, adopted),
        plots=plots(finished, [*effects, *(offered.effect for offered in responses.offered)]),
    )


def _with_next_steps(
    answer: Analysis, campaign: Campaign, residuals: Residuals, inexact: Mapping[str, Inexact]
) -> Analysis:
    """Add what sensors and zeros leave in doubt, and what to measure next."""
    doubted = doubts(campaign.model, campaign.readings)
    misstated = zeroed(campaign.verifications, residuals.rows.verifications)
    proposed = propose_visits(campaign, answer.effects, answer.unexplained)
    steps = [
        *mistakes_first(answer.effects),
        *to_state(misstated),
        *comparisons(doubted),
        *(visit.sentence for visit in proposed.visits),
        *proposed.untellable,
        *(step for step in answer.what_next if step not in proposed.replaced),
    ]
    return replace(
        answer,
        not_testable=(*misstated, *doubted, *read_inexactly(inexact), *answer.not_testable),
        next_visits=proposed.visits,
        temperatures_c=residuals.temperature_ranges,
        what_next=tuple(dict.fromkeys(steps)),
    )


def _together(
    finished: FinishedSearch, before: AdoptedBefore, effects: list[Effect], decision: Decision
) -> tuple[list[Effect], tuple[RefittedEffect, ...]]:
    """Fit what the model has and what helps together: this is what adoption stores.

    Returns
    -------
    effects, refitted
        The found effects, those that help as they are without the others; and what becomes of
        the model's own.
    """
    findings = finished.findings
    if findings.beside is None or not decision.refits_hold:
        return effects, refitted_effects(finished, before, (), is_refused=not decision.refits_hold)
    # A mistake in the data is in these rows, whatever is adopted.
    helping = [
        i for i, verdict in enumerate(decision.helps) if verdict.helps or not effects[i].terms
    ]
    terms, refitted = findings.beside({findings.terms[i].place for i in helping})
    if findings.refitted and len(helping) < len(effects):
        anew = {term.place: finished.effect_of(term) for term in terms}
        pairs = zip(effects, findings.terms, strict=True)
        effects = [anew.get(term.place, effect) for effect, term in pairs]
    return effects, refitted_effects(finished, before, refitted, is_refused=False)


def _by_live_path(
    finished: FinishedSearch, before: Sequence[Effect], after: Sequence[Effect]
) -> FloatArray:
    """Say what other effects add to each row, as predictions and tables add them, shape (n,)."""
    projection = finished.residuals.projection
    was, becomes = (contributions(projection, effects).errors for effects in (before, after))
    return becomes - was


def _contradiction(finished: FinishedSearch) -> Contradiction | None:
    noise = finished.findings.noise
    common = {
        c: channel_noise.repeatability
        for c, channel_noise in noise.items()
        if channel_noise.origin == COMMON
    }
    return contradiction(finished.residuals, finished.rows, common)


def _noise(finished: FinishedSearch) -> float | None:
    """Pool the repeatability over the channels in µm, or over all where there is none.

    None where nothing is known of it.
    """
    chosen = lengths(finished.residuals)
    numbers = [
        n
        for n in finished.findings.noise
        if chosen[finished.rows.channel == n].any() and tells_scatter(finished, n)
    ]
    noise = finished.findings.noise
    return pooled([noise[n].fitted for n in numbers], [noise[n].rows for n in numbers])


def _floor(components: Sequence[ComponentFigures]) -> float | None:
    """Pool the floor as the figures are pooled; None where one of their components has none."""
    in_um = [component for component in components if component.unit == Unit.UM.symbol] or list(
        components
    )
    floors = [component.floor for component in in_um if component.floor is not None]
    return (
        pooled(floors, [component.count for component in in_um])
        if len(floors) == len(in_um)
        else None
    )


def _unexplained(finished: FinishedSearch, residuals_after: FloatArray) -> list[UnexplainedPart]:
    """Gather what is left by channel, with what it moves with."""
    by_channel = defaultdict(list)
    for part in finished.findings.unexplained:
        by_channel[part.channel].append(part)
    names = finished.residuals.rows.channels
    parts = []
    for channel, ones in by_channel.items():
        of_channel = finished.use & (finished.rows.channel == channel)
        moves_with = [words_of(o.moves_with) for o in ones if o.test == "generic" and o.moves_with]
        parts.append(
            UnexplainedPart(
                component=names[channel],
                rms=rms(finished.from_zero(residuals_after, of_channel)),
                noise=finished.findings.noise[channel].fitted,
                unit=channel_unit(names[channel]).symbol,
                moves_with=tuple(dict.fromkeys(moves_with)),
                tests=tuple(dict.fromkeys(o.test for o in ones)),
            )
        )
    return sorted(parts, key=lambda p: -p.rms / max(p.noise, 1e-12))


def _excluded(residuals: Residuals, findings: Findings) -> list[LeftOut]:
    counts = Counter({one.reason: one.count for one in residuals.left_out})
    for group in findings.excluded:
        counts[OUTLIERS[group.reason]] += len(group.rows)
    return [LeftOut(reason, count) for reason, count in counts.most_common()]


def _not_testable(library: Repertoire, findings: Findings) -> tuple[NotTested, ...]:
    """List what could not be tested: what the kinds say, and what the search says."""
    hypotheses = [
        (library.hypotheses[untested.key], _why(untested)) for untested in findings.untested
    ]
    return by_reason(
        [
            *library.not_testable,
            *(NotTested(h.kind, list_names(h.components, 3), why) for h, why in hypotheses),
        ]
    )


def _why(untested: Untested) -> str:
    if untested.reason == FEW_VISITS:
        return f"needs {untested.needed} visits or moments of long ones, got {untested.got}"
    return "these observations do not show it: what drives it never changed where it would act"


def _detectable(finished: FinishedSearch) -> list[SmallestSeen]:
    """Give the smallest effect of each kind on each component that would have been seen."""
    best: dict[tuple[str, str], SmallestSeen] = {}
    noise = finished.findings.noise
    numbers = {name: i for i, name in enumerate(finished.residuals.rows.channels)}
    points = [numbers[name] for name in POINT_CHANNELS if name in numbers]
    for least in finished.findings.detectable:
        hypothesis = finished.hypotheses[least.key]
        component = list_names(hypothesis.components, 3)
        channel = numbers.get(hypothesis.components[0])
        channels = [c for c in noise if c == channel] or [c for c in noise if c in points]
        size = float(np.median([noise[c].repeatability for c in channels or noise]))
        seen = SmallestSeen(
            hypothesis.kind,
            component,
            channel_unit(hypothesis.components[0]).symbol if channel in noise else "µm",
            least.smallest * size,
        )
        key = (hypothesis.kind, component)
        if key not in best or seen.smallest_rms < best[key].smallest_rms:
            best[key] = seen
    return list(best.values())
