"""The printers' report: stretches of some minutes, predicted from those around them."""

from __future__ import annotations

from pathlib import Path

from app.arrays import FloatArray
from examples.measured.loop import (
    adopt_what_helps,
    by_component,
    close_the_loop,
    effects_of,
    measured_and_left,
    without_ranges,
)
from examples.measured.printers import PARTS, PRINTERS, campaign, read_homings
from examples.measured.printers_by_hand import print_by_hand
from examples.measured.printing import pooled, print_figures, print_rounds

STEPS = (
    "measured, about its mean",
    "maps over the frame",
    "after the loop",
    "nothing held",
    "as the service adopts unasked",
    "nothing held of that",
)


def print_report(data: Path) -> None:
    """Print for each printer what was found, and what is left of the stretches left out."""
    for name, printer in PRINTERS.items():
        homings = read_homings(data, printer)
        print_by_hand(name, printer, homings)
        steps: dict[str, list[dict[str, FloatArray]]] = {step: [] for step in STEPS}
        for part in range(PARTS):
            print(f"  {name}, part {part + 1} left out")
            known, asked = campaign(printer, homings, part)
            rounds = close_the_loop(known)
            print_rounds(rounds)
            rows, measured, before = measured_and_left(known, asked)
            found = [measured - homings.z_um.mean(), before]
            for effects in (effects_of(known, rounds), adopt_what_helps(known)):
                stored = (effects, without_ranges(effects))
                found.extend(measured_and_left(known, asked, one)[2] for one in stored)
            for step, values in zip(STEPS, found, strict=True):
                steps[step].append(by_component(rows, values))
        print_figures(
            f"{name}, stretches left out [µm]",
            {step: pooled(parts) for step, parts in steps.items()},
        )
