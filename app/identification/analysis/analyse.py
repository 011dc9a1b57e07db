"""From a campaign to an answer: residuals, the repertoire of effects, the search, the sentences."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from app.arrays import FloatArray, one_blas_thread
from app.effects.kind import NotTested
from app.effects.kinds.sensor_fault import SPIKES
from app.effects.observations import POINT_CHANNELS
from app.effects.registry import KINDS, Repertoire, kind_of, repertoire
from app.effects.site import Site
from app.errors import list_names
from app.identification.analysis import analysis
from app.identification.analysis.advice import summary, what_next
from app.identification.analysis.analysis import (
    Analysis,
    FoundEffect,
    SmallestSeen,
    UnexplainedPart,
    by_reason,
)
from app.identification.analysis.before_after import (
    component_figures,
    figures_unit,
    lengths,
    pooled,
    pooled_figures,
    used_rows,
    without_zeros,
)
from app.identification.analysis.curves import plots
from app.identification.analysis.found_effects import Found, faults_of_readings, found_effects
from app.identification.analysis.leads import leads, words_of
from app.identification.analysis.reading_faults import ReadingFaults, reading_faults
from app.identification.campaign import Campaign, residuals_of
from app.identification.doubted_sensors import comparisons, doubts
from app.identification.residuals.map_uncertainty import map_uncertainty
from app.identification.residuals.residuals import LeftOut, Residuals, channel_unit, zero_columns
from app.search.figures import rms
from app.search.findings import Findings, Untested, Verdict
from app.search.search import Progress, search

VERDICTS: Final[dict[Verdict, analysis.Verdict]] = {
    Verdict.FOUND: "effects-found",
    Verdict.NOTHING: "nothing-found",
    Verdict.UNEXPLAINED: "unexplained",
}

OUTLIERS: Final = {"outlier": "outlier", "visit-apart": "a visit far from all others"}

PREPARED: Final = 0.05
"""Share of the work before the search begins."""


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
    campaign
        Verifications, model and record.
    holdout_fraction
        Share of the visits that is held out in turn.
    kinds
        Kinds of effects to look for; all without it.
    seed
        Of all draws: the same campaign and seed give the same answer.
    progress
        Told the share done, 0 to 1, never falling, and what is being done.

    Returns
    -------
    Analysis

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
    residuals = residuals_of(campaign)
    projection = residuals.projection
    site = Site(campaign.model, campaign.maps, residuals.rows, projection.conditions)
    known = None if kinds is None else tuple(_known(kinds))
    library = repertoire(site, known)
    rows = residuals.as_rows()
    with one_blas_thread():
        findings = search(
            rows,
            [*map_uncertainty(projection, campaign.maps), *zero_columns(residuals.rows)],
            [*library.candidates, *leads(site)],
            holdout_fraction=holdout_fraction,
            seed=seed,
            progress=_later(progress),
        )
    use = used_rows(findings, len(rows.values))
    found = Found(residuals, rows, findings, use, library.hypotheses)
    faulty = faults_of_readings(found, faults, _believed(as_given, residuals, faults))
    answer = _answer(found, library, faulty, seed, known)
    doubted = doubts(campaign.model, campaign.readings)
    return replace(
        answer,
        not_testable=(*doubted, *answer.not_testable),
        what_next=(*comparisons(doubted), *answer.what_next),
    )


def _known(kinds: Collection[str]) -> list[str]:
    """Order kinds as the registry does, so that the order of asking decides nothing."""
    for name in kinds:
        kind_of(name)
    return [name for name in KINDS if name in kinds]


def _later(progress: Progress | None) -> Progress | None:
    if progress is None:
        return None
    return lambda share, words: progress(PREPARED + (1.0 - PREPARED) * share, words)


def _believed(as_given: Campaign, residuals: Residuals, faults: ReadingFaults) -> FloatArray:
    """Give the residuals with faulty readings believed; NaN where they were not believed."""
    found = np.full(len(residuals.rows), np.nan)
    if any(effect.variant == SPIKES for effect in faults.effects):
        given = residuals_of(as_given)
        values = np.full(len(given.kept), np.nan)
        values[given.kept] = given.values
        found = values[residuals.kept]
    return found


def _answer(
    found: Found,
    library: Repertoire,
    faulty: Sequence[FoundEffect],
    seed: int,
    kinds: tuple[str, ...] | None,
) -> Analysis:
    findings = found.findings
    effects = found.effects()
    explained = sum((found.explained(e) for e in effects), np.zeros(len(found.use)))
    chosen = found.use & lengths(found.residuals)
    seen = np.where(np.isfinite(findings.adopted), 0.0, np.nan)
    left = found.rows.values - explained
    before = pooled_figures(found.rows, found.zeros, found.rows.values, seen, chosen, seed)
    after = pooled_figures(found.rows, found.zeros, left, findings.adopted, chosen, seed)
    described = [*found_effects(found, effects), *faulty]
    components = component_figures(found.residuals, found.rows, explained, findings, found.use)
    unexplained = _unexplained(found, left)
    not_testable = _not_testable(library, findings)
    verdict = VERDICTS[findings.verdict]
    if faulty and findings.verdict is Verdict.NOTHING:
        verdict = VERDICTS[Verdict.FOUND]
    noise_um, floor_um = _noise(found)
    unit = figures_unit(found.residuals)
    return Analysis(
        verdict=verdict,
        summary=summary(verdict, described, unexplained, before, after, noise_um, unit, kinds),
        kinds=kinds,
        unit=unit,
        noise_um=noise_um,
        floor_um=floor_um,
        before=before,
        after=after,
        after_with_maps_refitted=pooled_figures(
            found.rows, found.zeros, left, findings.predicted, chosen, seed
        ),
        p_global=findings.global_p,
        visits=int(np.unique(found.rows.visit[found.use]).size),
        values=int(found.use.sum()),
        components=tuple(components),
        effects=tuple(described),
        unexplained=tuple(unexplained),
        excluded=tuple(_excluded(found.residuals, findings)),
        not_testable=not_testable,
        detectable=tuple(_detectable(found)),
        what_next=what_next(
            described, unexplained, not_testable, found.residuals.rows.visits, _apart(found)
        ),
        plots=plots(found, effects),
    )


def _noise(found: Found) -> tuple[float | None, float | None]:
    """Pool repeatability and floor over the channels in µm, or over all where there is none."""
    chosen = lengths(found.residuals)
    numbers = [n for n in found.findings.noise if chosen[found.rows.channel == n].any()]
    noise, held = found.findings.noise, found.findings.held_out
    floors = [n for n in numbers if n in held]
    return (
        pooled([noise[n].fitted for n in numbers], [noise[n].rows for n in numbers]),
        pooled([held[n].floor for n in floors], [held[n].rows for n in floors]),
    )


def _unexplained(found: Found, left: FloatArray) -> list[UnexplainedPart]:
    """Gather what is left by channel, with what it moves with."""
    by_channel = defaultdict(list)
    for one in found.findings.unexplained:
        by_channel[one.channel].append(one)
    names = found.residuals.rows.channels
    parts = []
    for channel, ones in by_channel.items():
        own = found.use if channel is None else found.use & (found.rows.channel == channel)
        noise = [n.fitted for c, n in found.findings.noise.items() if channel in (None, c)]
        leads_here = [words_of(o.lead) for o in ones if o.test == "generic" and o.lead]
        parts.append(
            UnexplainedPart(
                component="all components" if channel is None else names[channel],
                rms_um=rms(without_zeros(found.zeros, np.where(own, left, np.nan))[own]),
                noise_um=float(np.mean(noise)),
                unit=channel_unit(names[channel or 0]).symbol,
                leads=tuple(dict.fromkeys(leads_here)),
                tests=tuple(dict.fromkeys(o.test for o in ones)),
            )
        )
    return sorted(parts, key=lambda p: -p.rms_um / max(p.noise_um, 1e-12))


def _excluded(residuals: Residuals, findings: Findings) -> list[LeftOut]:
    counts = Counter({one.reason: one.count for one in residuals.left_out})
    for one in findings.excluded:
        counts[OUTLIERS[one.reason]] += len(one.rows)
    return [LeftOut(reason, count) for reason, count in counts.most_common()]


def _apart(found: Found) -> list[str]:
    """Name the visits that were left out as slips, with their components."""
    rows = found.residuals.rows
    return [
        f"{rows.channels[one.channel]} in {rows.verifications[int(rows.verification[at])].label!r}"
        for one in found.findings.excluded
        if one.visit is not None
        for at in one.rows[:1]
    ]


def _not_testable(library: Repertoire, findings: Findings) -> tuple[NotTested, ...]:
    """List what could not be tested: what the kinds say, and what the search says."""
    hypotheses = [(library.hypotheses[one.key], _why(one)) for one in findings.untested]
    return by_reason(
        [
            *library.not_testable,
            *(NotTested(h.kind, list_names(h.components, 3), why) for h, why in hypotheses),
        ]
    )


def _why(untested: Untested) -> str:
    if untested.reason == "few-visits":
        return f"needs {untested.visits_needed} visits, came {untested.visits}"
    return "these observations do not show it: what drives it never changed where it would act"


def _detectable(found: Found) -> list[SmallestSeen]:
    """Give the smallest effect of each kind on each component that would have been seen."""
    best: dict[tuple[str, str], SmallestSeen] = {}
    noise = found.findings.noise
    numbers = {name: i for i, name in enumerate(found.residuals.rows.channels)}
    points = [numbers[name] for name in POINT_CHANNELS if name in numbers]
    for least in found.findings.detectable:
        hypothesis = found.hypotheses[least.key]
        component = list_names(hypothesis.components, 3)
        channel = numbers.get(hypothesis.components[0])
        own = [c for c in noise if c == channel] or [c for c in noise if c in points]
        size = float(np.median([noise[c].repeatability for c in own or noise]))
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
