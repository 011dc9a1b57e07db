"""What is known of an analysis, and of each effect: names with what they say."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC
from typing import Final

from app.errors import counted, list_names
from app.identification.analysis.analysis import Analysis
from app.identification.analysis.found_effect import Evidence, FoundEffect
from app.pages.report_parts.certificate import machine_facts, measured_facts, written_by
from app.pages.report_parts.component_names import component_name
from app.pages.report_parts.effect_names import kind_name, learnt_text
from app.pages.report_parts.words import chance_text, figure_text, sentence
from app.pages.wording import _, listed, said
from app.services.analyses import ReportHead

MOST_LABELS: Final = 12


def head_facts(head: ReportHead, result: Analysis) -> Mapping[str, str]:
    """Say of which machine and which measurements it is, as a certificate does."""
    return {
        **machine_facts(head.machine_id, head.chain, head.serial_number),
        **measured_facts(head.instruments, head.operators, head.measured, result.temperatures_c),
        _("model"): said(sentence(_model(head))),
        _("verifications"): listed(head.verifications, MOST_LABELS),
        _("observations"): said(
            f"{counted(result.values, 'value')} of {counted(result.visits, 'visit')}"
        ),
        _("analysed"): said(
            f"{head.analysed_at.astimezone(UTC):%Y-%m-%d %H:%M} UTC, seed {head.seed}, "
            f"{written_by()}"
        ),
        _("adopted"): said(sentence(_adopted(head))),
    }


def _model(head: ReportHead) -> str:
    """Name the version with the effects that it had before."""
    had = counted(len(head.had), "adopted effect")
    version = f"version {head.model_version}"
    return f"{version}, with {had}: {'; '.join(head.had)}" if head.had else version


def _adopted(head: ReportHead) -> str:
    """Say what of this analysis went into which version."""
    if head.adopted_version is None:
        return "nothing of this analysis"
    version = f"as model version {head.adopted_version}"
    return f"{version}: {'; '.join(head.adopted)}" if head.adopted else version


def effect_facts(effect: FoundEffect, decimals: int) -> Mapping[str, str]:
    """Say what an effect is and how sure it is.

    Returns
    -------
    dict
        Names to plain text, empty where there is nothing to say.
    """
    sizes = [figure_text(rms, decimals) for rms in (effect.before_rms, effect.after_rms)]
    evidence = effect.evidence
    drivers = [*effect.sensors, *effect.states]
    variant = f", {effect.variant}" if effect.variant else ""
    return {
        _("kind"): said(f"{kind_name(effect.kind)}{variant}"),
        _("acts on"): said(list_names(map(component_name, effect.components))),
        _("driven by"): listed(drivers) if drivers else "",
        _("residual there"): said(f"{sizes[0]} → {sizes[1]} {effect.unit} RMS, with all effects"),
        **_sureness(evidence),
        _("learnt in"): said(learnt_text(effect)),
        _("use"): said(effect.measure_again or ""),
    }


def _sureness(evidence: Evidence) -> dict[str, str]:
    """Say how sure it is: by its readings, or by visits that took no part and by chance."""
    if evidence.seen_in_readings:
        return {_("in the readings"): said(evidence.seen_in_readings)}
    return {
        _("held-out visits"): said(_held_out(evidence)),
        _("by chance"): said(_by_chance(evidence.p_global)),
    }


def _by_chance(probability: float | None) -> str:
    if probability is None:
        return ""
    return f"{chance_text(probability)} for noise to give as strong a candidate in the library"


def _held_out(evidence: Evidence) -> str:
    """Say what visits say that took no part in finding it."""
    slope, error = evidence.calibration_slope, evidence.calibration_slope_error
    words = "say nothing about it"
    if slope is not None:
        size = figure_text(slope, 2) + (f" ± {figure_text(error, 2)}" if error else "")
        words = f"show {size} of what it predicts (1 is right, 0 is nothing)"
    forward, again = evidence.forward_slope, evidence.found_again_share
    if forward is not None:
        words += f"; foretold from the earlier visits, the last ones show {figure_text(forward, 2)}"
    if again is not None:
        words += f"; found again in {100.0 * again:.0f} % of the splits"
    return words
