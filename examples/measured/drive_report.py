"""The drive's report: each later cycle left out in turn."""

from __future__ import annotations

from pathlib import Path

from examples.measured.drive import TESTS, campaign, close_both_ways, read_points, verifications
from examples.measured.loop import by_component, effects_of, measured_and_left, without_ranges
from examples.measured.printing import pooled, print_figures, print_rounds

CYCLES = (2, 3, 4, 5)


def print_report(data: Path) -> None:
    """Print both axes: what all cycles show, and how each cycle is predicted by the others."""
    for axis in TESTS:
        print(f"  axis {axis.upper()}, all cycles")
        points = read_points(data, axis)
        print_rounds(close_both_ways(axis, points, points))
        before, after, free, raw = [], [], [], []
        for cycle in CYCLES:
            learn = [p for p in points if p.cycle != cycle]
            asked = verifications(axis, [p for p in points if p.cycle == cycle], by_run=False)
            known = campaign(axis, points, learn, by_run=False)
            effects = effects_of(known, close_both_ways(axis, points, learn))
            rows, measured, left = measured_and_left(known, asked)
            raw.append(by_component(rows, measured))
            before.append(by_component(rows, left))
            after.append(by_component(rows, measured_and_left(known, asked, effects)[2]))
            free.append(
                by_component(rows, measured_and_left(known, asked, without_ranges(effects))[2])
            )
        print_figures(
            "cycles left out [µm]",
            {
                "measured": pooled(raw),
                "first cycle's table": pooled(before),
                "after the loop": pooled(after),
                "nothing held": pooled(free),
            },
        )
