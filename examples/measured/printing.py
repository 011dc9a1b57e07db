"""What the loop found, printed: effects by round, figures before and after."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from app.arrays import FloatArray
from app.identification.analysis.found_effect import FoundEffect
from examples.measured.loop import Figures, Round

MOST_TIES = 3
MOST_NAMED = 3


def print_rounds(rounds: Iterable[Round]) -> None:
    """Print each analysis: what was found, what of it was adopted, what is left."""
    for number, each in enumerate(rounds, 1):
        print(f"  round {number}: {each.analysis.verdict}")
        for found in each.analysis.effects:
            print(f"    {'adopted' if found in each.adopted else 'left   '} {_line(found)}")
        for part in each.analysis.unexplained:
            moving = ", ".join(part.moves_with[:MOST_NAMED]) or "nothing recorded"
            print(
                f"    unexplained on {part.component}: {part.rms:.1f} {part.unit} against "
                f"{part.noise:.1f} of scatter; {moving}"
            )
        for one in each.analysis.excluded:
            print(f"    excluded, {one.reason}: {one.count}")


def print_figures(title: str, steps: Mapping[str, Mapping[str, Figures]]) -> None:
    """Print a table: a row for each step, RMS, 95th percentile and largest by component."""
    print(f"  {title}: RMS, 95th percentile, largest")
    for step, by_component in steps.items():
        cells = "   ".join(
            f"{name} {f.rms:6.2f} {f.p95:6.2f} {f.largest:6.2f}" for name, f in by_component.items()
        )
        print(f"    {step:42} {cells}")


def pooled(parts: Iterable[Mapping[str, FloatArray]]) -> dict[str, Figures]:
    """Put the values of several parts together by component."""
    gathered: dict[str, list[FloatArray]] = {}
    for part in parts:
        for name, values in part.items():
            gathered.setdefault(name, []).append(values)
    return {name: Figures.of(np.concatenate(values)) for name, values in gathered.items()}


def _line(found: FoundEffect) -> str:
    ties = [f"{t.kind} {' '.join((*t.sensors, *t.states))}".strip() for t in found.ties]
    tied = f"; tied with {', '.join(ties[:MOST_TIES])}" if ties else ""
    evidence = found.evidence.two_ln_bayes_factor
    # A response is judged by set-ups held out alone, a sensor's fault by its readings.
    sure = "" if evidence is None else f", 2 ln B {evidence:.0f}"
    return f"{found.explanation} ({found.status}{sure}{tied})"
