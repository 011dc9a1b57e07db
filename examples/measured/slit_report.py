"""The slit's report: the end of the sweep, predicted from its beginning."""

from __future__ import annotations

from pathlib import Path

from examples.measured.loop import (
    by_component,
    close_the_loop,
    effects_of,
    measured_and_left,
    without_means,
    without_ranges,
)
from examples.measured.printing import pooled, print_figures, print_rounds
from examples.measured.slit import campaign, read_sweep


def print_report(data: Path) -> None:
    """Print what the first stretches show, and what is left of the last ones."""
    known, asked = campaign(read_sweep(data))
    rounds = close_the_loop(known)
    print_rounds(rounds)
    steps = {}
    found = effects_of(known, rounds)
    models = {
        "table at each mm": [],
        "after the loop": found,
        "nothing held": without_ranges(found),
    }
    for name, effects in models.items():
        rows, _, left = measured_and_left(known, asked, effects)
        steps[name] = pooled([by_component(rows, without_means(rows, left))])
    print_figures("stretches left out, each without its mean [µm]", steps)
