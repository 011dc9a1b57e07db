"""What a planned campaign could see and tell apart, and which visit would help most.

No measured value is needed: what an effect would do to the planned rows is known from where and
when they are to be measured. Days to come have no readings yet, so they are planned on days of
the record, which stand for them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from app.arrays import one_blas_thread
from app.effects.campaign_view import CampaignView
from app.effects.claim import claim_of
from app.effects.hypothesis import Hypothesis
from app.effects.kind import NotTested
from app.effects.observations import Verification
from app.effects.registry import Repertoire, kind_of, repertoire, separating_measurement
from app.errors import InvalidContent, counted, list_names
from app.identification.analysis.analysis import by_reason
from app.identification.campaign import Campaign, residuals_of
from app.identification.doubted_sensors import trusted_readings
from app.identification.observed_scatter import observed_scatter
from app.identification.plan.added_visits import AddedVisit, choose_added_visits
from app.identification.plan.described_visit import visit_at
from app.identification.plan.machine_state import SensorRange, sensor_ranges, state_at
from app.identification.plan.plan import (
    ImprovedEffect,
    Plan,
    PlannedEffect,
    PlannedRival,
    Suggestion,
)
from app.identification.residuals.inexact_sensors import error_columns, inexact_sensors
from app.identification.residuals.map_uncertainty import map_uncertainty
from app.identification.residuals.residuals import Residuals, channel_unit
from app.search.candidate import Candidate
from app.search.detectability import Chances, smallest_effects
from app.search.draws import Draws
from app.search.findings import Detectable
from app.search.library import Library, read_library
from app.search.problem import Problem, make_problem
from app.search.rows import DeclaredNoise, Nuisance, Rows
from app.search.search import DRAWS, FALSE_ALARM
from app.units import SECONDS_PER_DAY, duration_text

ASSUMED_REPEATABILITY_UM: Final = 1.0
"""Where nobody states one; in the other units the same number."""

MOST_HELPED: Final = 4
"""So many effects are named behind a suggested visit."""

MOST_SUGGESTIONS: Final = 3

IMITATED: Final = 0.5
"""From this overlap on it is said what separates an effect from its rival."""

NOT_SEEN: Final = "these observations would not show it, or there are too few visits"

WORTH_SAYING: Final = 0.95
"""A visit helps where it lowers the smallest effect to this share or below."""


def plan(campaign: Campaign, model_version: int, false_alarm: float = FALSE_ALARM) -> Plan:
    """Tell what planned observations could see and tell apart, and which visit to add.

    Parameters
    ----------
    campaign
        Its verifications are the plan; those that are yet to be measured say so. Times outside
        the record are planned on recorded days.

    Raises
    ------
    InvalidContent
        If there are no readings, or no planned observation can be compared with the model.
    """
    planned, notes = _on_recorded_days(campaign)
    added = choose_added_visits(planned)
    every = replace(planned, verifications=[*planned.verifications, *(a.visit for a in added)])
    residuals = residuals_of(every)
    view = CampaignView(every.model, every.maps, residuals.rows, residuals.projection.conditions)
    library = repertoire(view)
    rows, assumed = _with_declared_noise(residuals, planned)
    count = len(planned.verifications)
    with one_blas_thread():
        maps = _map_uncertainty(residuals, every)
        cell_of = _cells(residuals, rows, count)
        alone = _of_plan(rows, maps, cell_of)
        chances = Chances.before_measuring(alone, library.candidates, Draws(0, DRAWS), false_alarm)
        everything = np.ones(len(rows.values), dtype=np.bool_)
        problem = make_problem(rows, maps, everything, cell_of, 1 + max(cell_of.values()))
        entries = _read_middles(problem, library.candidates)
        limits = _DetectionLimits(entries, library.hypotheses, residuals, chances)
        seen = limits.smallest(0, rivals=True)
    effects = _best_forms([limits.described(detectable) for detectable in seen.values()])
    suggestions = _suggestions(limits, planned, added, seen)
    are_planned = residuals.rows.verification < len(planned.verifications)
    visits = int(np.unique(residuals.rows.visit[are_planned]).size)
    return Plan(
        model_version=model_version,
        summary=_summary(visits, int(are_planned.sum()), effects, suggestions),
        visits=visits,
        values=int(are_planned.sum()),
        notes=(*notes, *assumed),
        effects=tuple(sorted(effects, key=_distinguishability)),
        not_testable=_not_testable(library, seen),
        excluded=residuals.left_out,
        suggestions=tuple(suggestions),
    )


def _on_recorded_days(campaign: Campaign) -> tuple[Campaign, list[str]]:
    """Move planned visits that lie outside the record onto its days, each at its hour."""
    times_s = campaign.readings.times_s
    if times_s.size == 0:
        raise InvalidContent.of_field(
            "verifications", "expected readings to plan with, got none: record some days first"
        )
    first_s, last_s = float(times_s[0]), float(times_s[-1])
    moved, shifted, unplaced, longest_s = [], 0, 0, 0.0
    for v in campaign.verifications:
        begin_s = min((o.time_s for o in v.observations), default=first_s)
        end_s = max((o.time_s for o in v.observations), default=first_s)
        inside = begin_s >= first_s and end_s <= last_s
        shift_s = 0.0 if inside else _shift_s(begin_s, end_s, first_s, last_s)
        moved.append(_shifted(v, shift_s) if shift_s else v)
        if begin_s + shift_s < first_s or end_s + shift_s > last_s:
            unplaced += 1
            longest_s = max(longest_s, end_s - begin_s)
        else:
            shifted += not inside
    notes = []
    if shifted:
        notes.append(
            f"{shifted} of {len(moved)} planned visits lie outside the recorded period; they were "
            "placed on recorded days at the same hour, as if the machine were used in the same "
            "way"
        )
    if unplaced:
        short = (
            f"the record is too short: expected {duration_text(longest_s + SECONDS_PER_DAY)} of "
            "readings or more, a day more than the visit lasts, for its hours to be among them, "
            f"got {duration_text(last_s - first_s)}"
        )
        if not _any_within(moved, first_s, last_s):
            raise InvalidContent.of_field("verifications", short)
        notes.append(f"{short}; what lies outside the record is left out")
    # What was moved lies not before the first reading, but where no hour of the record is its own.
    older = campaign.older_readings or bool(unplaced)
    return replace(campaign, verifications=moved, older_readings=older), notes


def _shift_s(begin_s: float, end_s: float, first_s: float, last_s: float) -> float:
    """Choose whole days back (or forward) into the record; later days of a plan go round.

    In a record that is longer than the visit by a day there is always such a place.
    """
    days = max(int((last_s - first_s) // SECONDS_PER_DAY), 1)
    away = int(np.floor((begin_s - first_s) / SECONDS_PER_DAY))
    shift_s = (away % days - away) * SECONDS_PER_DAY
    beyond_s = max(end_s + shift_s - last_s, 0.0)
    back_s = float(np.ceil(beyond_s / SECONDS_PER_DAY)) * SECONDS_PER_DAY
    return shift_s - back_s if begin_s + shift_s - back_s >= first_s else shift_s


def _any_within(verifications: Sequence[Verification], first_s: float, last_s: float) -> bool:
    return any(first_s <= o.time_s <= last_s for v in verifications for o in v.observations)


def _shifted(verification: Verification, shift_s: float) -> Verification:
    moved = [replace(o, time_s=o.time_s + shift_s) for o in verification.observations]
    return replace(verification, observations=moved)


def _with_declared_noise(residuals: Residuals, planned: Campaign) -> tuple[Rows, list[str]]:
    """Declare a repeatability for every channel: what is stated, or shown in its place, or one."""
    rows, notes = residuals.as_rows(), []
    declared = {c: n for c, n in rows.noise.items() if n.repeatability}
    measured = [v for v in planned.verifications if not v.is_planned]
    if declared and measured:
        alone = replace(planned, verifications=measured)
        denied = observed_scatter(alone, residuals_of(alone)).contradiction
        if denied is not None:
            declared = {c: replace(n, repeatability=denied.shown_um) for c, n in declared.items()}
            notes.append(denied.sentence)
    elif declared:
        notes.append(
            "the stated repeatability was taken as it is: name stored verifications of the same "
            "instrument to have it held against what they show"
        )
    of_stated = [n.repeatability for n in declared.values() if n.repeatability]
    assumed = float(np.median(of_stated)) if of_stated else ASSUMED_REPEATABILITY_UM
    lacking = [c for c in np.unique(rows.channel).tolist() if c not in declared]
    noise = {**declared, **{c: DeclaredNoise(repeatability=assumed) for c in lacking}}
    if lacking:
        names = list_names([residuals.rows.channels[c] for c in lacking], 6)
        notes.append(
            f"a repeatability of {assumed:.3g} (in each component's own unit) was assumed for "
            f"{names}"
        )
    return replace(rows, noise=noise), notes


def _map_uncertainty(residuals: Residuals, campaign: Campaign) -> list[Nuisance]:
    trusted = trusted_readings(campaign.model, campaign.readings)
    inexact = inexact_sensors(campaign.model.machine, trusted)
    steps = error_columns(residuals.projection, trusted, inexact)
    return map_uncertainty(residuals.projection, campaign.maps, steps)


def _cells(residuals: Residuals, rows: Rows, planned: int) -> dict[int, int]:
    """Put the plan into cell 0 and each visit that may be added into a cell of its own."""
    which = residuals.rows.verification
    cell = np.where(which < planned, 0, which - planned + 1)
    return dict(zip(rows.block.tolist(), cell.tolist(), strict=True))


def _of_plan(rows: Rows, maps: Sequence[Nuisance], cell_of: Mapping[int, int]) -> Problem:
    """Make the plan alone ready."""
    use = np.array([cell_of[block] == 0 for block in rows.block.tolist()])
    return make_problem(rows, maps, use, dict.fromkeys(cell_of, 0), 1)


def _read_middles(problem: Problem, candidates: Sequence[Candidate]) -> Library:
    """Read each candidate at the middle of its grid, the one that is looked at.

    Its other values keep their places in the library, for they count as chances to find.
    """
    middles = [replace(c, grid=c.grid[len(c.grid) // 2 :][:1]) for c in candidates]
    read = read_library(problem, middles, None)
    sizes = [len(c.thetas) for c in candidates]
    entries = [e for e, size in zip(read.entries, sizes, strict=True) for _ in range(size)]
    at = np.cumsum([0, *sizes[:-1]]) + np.array(sizes) // 2
    batches = [replace(b, entries=at[b.entries].tolist()) for b in read.batches]
    return Library(problem, middles, entries, batches)


@dataclass(frozen=True, eq=False)
class _DetectionLimits:
    """What visits see, whichever of them take part."""

    library: Library
    hypotheses: Mapping[str, Hypothesis]
    residuals: Residuals
    chances: Chances

    def smallest(self, *cells: int, rivals: bool = False) -> dict[str, Detectable]:
        """Give the smallest effects that the visits of some cells would show, by key."""
        problem = self.library.problem
        states = problem.states(np.isin(np.arange(problem.cells), cells))
        detectables = smallest_effects(self.library, states, self.chances, rivals)
        return {detectable.key: detectable for detectable in detectables}

    def described(self, detectable: Detectable) -> PlannedEffect:
        """Put an effect into words and its component's unit."""
        hypothesis = self.hypotheses[detectable.key]
        size, unit = self._size(hypothesis)
        distinguishable_rms = (
            detectable.distinguishable * size if np.isfinite(detectable.distinguishable) else None
        )
        return PlannedEffect(
            *claim_of(hypothesis),
            unit,
            detectable.smallest * size,
            distinguishable_rms,
            self._rival(hypothesis, detectable),
        )

    def improved(self, key: str, before: Detectable, after: Detectable) -> ImprovedEffect:
        """Say what more visits do for one effect."""
        hypothesis = self.hypotheses[key]
        size, unit = self._size(hypothesis)
        sizes = (before.smallest * size, after.smallest * size)
        return ImprovedEffect(*claim_of(hypothesis), unit, *sizes)

    def _size(self, hypothesis: Hypothesis) -> tuple[float, str]:
        """Give the repeatability of the component's own channel, or of points, and its unit."""
        names = self.residuals.rows.channels
        fixed = self.library.problem.fixed
        channels = [c for c in fixed if names[c] in hypothesis.components] or list(fixed)[-1:]
        return fixed[channels[0]].channel.scale, channel_unit(names[channels[0]]).symbol

    def _rival(self, hypothesis: Hypothesis, detectable: Detectable) -> PlannedRival | None:
        if detectable.rival is None:
            return None
        rival = self.hypotheses[detectable.rival]
        return PlannedRival(
            *claim_of(rival),
            detectable.overlap or 0.0,
            separating_measurement(hypothesis, rival)
            if (detectable.overlap or 0.0) > IMITATED
            else None,
        )


def _suggestions(
    limits: _DetectionLimits,
    campaign: Campaign,
    added: Sequence[AddedVisit],
    seen: Mapping[str, Detectable],
) -> list[Suggestion]:
    """Try each visit beside the plan; the one that lowers the smallest effects most goes first."""
    ranked, ranges = [], sensor_ranges(campaign)
    for number, visit in enumerate(added):
        after = limits.smallest(0, number + 1)
        shares = {
            k: after[k].smallest / seen[k].smallest
            for k in seen
            # When a visit is added in the record says nothing about when it will be made.
            if k in after and not limits.hypotheses[k].trending
        }
        best = _different(limits, sorted(shares, key=shares.__getitem__))
        helped = [
            limits.improved(key, seen[key], after[key])
            for key in best
            if shares[key] <= WORTH_SAYING
        ][:MOST_HELPED]
        gain = float(np.mean(np.log(list(shares.values())))) if shares else 0.0
        if helped:
            ranked.append((gain, _suggestion(campaign, ranges, visit, helped)))
    return [s for _, s in sorted(ranked, key=lambda f: f[0])[:MOST_SUGGESTIONS]]


def _different(limits: _DetectionLimits, keys: Sequence[str]) -> list[str]:
    """Keep the first of each kind on the same components."""
    first: dict[tuple[str, tuple[str, ...]], str] = {}
    for key in keys:
        hypothesis = limits.hypotheses[key]
        first.setdefault((hypothesis.kind, hypothesis.components), key)
    return list(first.values())


def _suggestion(
    campaign: Campaign,
    ranges: Mapping[str, SensorRange],
    added: AddedVisit,
    helped: Sequence[ImprovedEffect],
) -> Suggestion:
    best = helped[0]
    driven = list_names((*best.sensors, *best.states), 2)
    by = f" by {driven}" if best.sensors or best.states else ""
    decides = (
        f"lowers the smallest {best.kind} of {list_names(best.components, 3)}{by} that can be seen "
        f"from {best.before_rms:.2g} to {best.after_rms:.2g} {best.unit}"
    )
    state = state_at(campaign, ranges, added.time_s, added.leading)
    names = list(dict.fromkeys(o.component or "points" for o in added.visit.observations))
    visit = visit_at(campaign, added.visit, added.time_s, state, names, decides)
    return Suggestion(visit, tuple(helped))


def _best_forms(effects: Sequence[PlannedEffect]) -> list[PlannedEffect]:
    """Of the forms that one kind has with the same drivers keep the one that is seen best."""
    best: dict[tuple[object, ...], PlannedEffect] = {}
    for effect in effects:
        key = (effect.kind, effect.components, effect.sensors, effect.states)
        if key not in best or effect.smallest_rms < best[key].smallest_rms:
            best[key] = effect
    return list(best.values())


def _distinguishability(effect: PlannedEffect) -> float:
    distinguishable_rms = effect.distinguishable_rms
    return -(np.inf if distinguishable_rms is None else distinguishable_rms)


def _not_testable(library: Repertoire, seen: Mapping[str, Detectable]) -> tuple[NotTested, ...]:
    """List what the plan cannot show: what the kinds say, and what it does not excite."""
    unseen = [hypothesis for key, hypothesis in library.hypotheses.items() if key not in seen]
    return by_reason(
        [
            *library.not_testable,
            *(NotTested(hypothesis.kind, _subject(hypothesis), NOT_SEEN) for hypothesis in unseen),
        ]
    )


def _subject(hypothesis: Hypothesis) -> str:
    """Name the components of an effect, and the only map that it is about."""
    label = kind_of(hypothesis.kind).which_map(hypothesis.variant)
    return list_names(hypothesis.components, 3) + (f" of map {label!r}" if label else "")


def _summary(
    visits: int, values: int, effects: Sequence[PlannedEffect], suggestions: Sequence[Suggestion]
) -> str:
    tied = sum(e.distinguishable_rms is None for e in effects)
    seen = (
        f"{counted(visits, 'visit')} with {counted(values, 'value')} would show "
        f"{counted(len(effects), 'effect')}; {len(effects) - tied} of them could be told from "
        "every rival."
    )
    return f"{seen} {suggestions[0].visit.sentence}" if suggestions else seen
