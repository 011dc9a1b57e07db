"""The lathe's report: whole runs left out in turn, beside an ordinary look at the same runs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from app.arrays import FloatArray
from app.identification.campaign import residuals_of
from app.thermal.doubtful_sensors import doubtful_sensors
from examples.measured.lathe import Lathe, make_lathe
from examples.measured.lathe_runs import read_runs
from examples.measured.loop import (
    Round,
    by_component,
    close_the_loop,
    effects_of,
    measured_and_left,
    without_means,
    without_ranges,
)
from examples.measured.ordinary_look import ordinary_look
from examples.measured.printing import pooled, print_figures, print_rounds

STEPS = ("measured", "first maps", "after the loop", "nothing held", "ordinary look")


@dataclass(frozen=True, eq=False)
class Fold:
    """Some runs left out: what the loop found on the others, and these runs step by step."""

    dates: Sequence[str]
    rounds: Sequence[Round]
    from_zero: dict[str, dict[str, FloatArray]]
    without_means: dict[str, dict[str, FloatArray]]


def print_report(data: Path, folds: int) -> None:
    """Leave each part of the runs out once, and print what was found and what is left."""
    runs = read_runs(data)
    lathe = make_lathe(runs)
    _print_cleaning(lathe, make_lathe(runs, every_s=0.0))
    done = [run_fold(lathe, lathe.dates[i::folds]) for i in range(folds)]
    for fold in done:
        print(f"  left out: {', '.join(fold.dates)}")
        print_rounds(fold.rounds)
    print_figures(
        "runs left out, zero at their start [µm]",
        {step: pooled(fold.from_zero[step] for fold in done) for step in STEPS},
    )
    print_figures(
        "runs left out, each run's mean taken off [µm]",
        {step: pooled(fold.without_means[step] for fold in done) for step in STEPS},
    )
    _print_kinds(done)


def run_fold(lathe: Lathe, left_out: Sequence[str]) -> Fold:
    """Close the loop on all runs but some, and predict these."""
    learn = lathe.campaign([d for d in lathe.dates if d not in left_out])
    asked = lathe.verifications(left_out)
    rounds = close_the_loop(learn)
    rows, measured, before = measured_and_left(learn, asked)
    effects = effects_of(learn, rounds)
    _, _, after = measured_and_left(learn, asked, effects)
    _, _, free = measured_and_left(learn, asked, without_ranges(effects))
    known, known_measured, _ = measured_and_left(learn, learn.verifications)
    ordinary = ordinary_look(lathe.runs, known, rows, (known_measured, measured))
    steps = dict(zip(STEPS, (measured, before, after, free, ordinary), strict=True))
    return Fold(
        left_out,
        rounds,
        {step: by_component(rows, values) for step, values in steps.items()},
        {step: by_component(rows, without_means(rows, v)) for step, v in steps.items()},
    )


def _print_cleaning(lathe: Lathe, every_row: Lathe) -> None:
    for one in doubtful_sensors(lathe.readings):
        since = datetime.fromtimestamp(one.since_s, UTC)
        print(
            f"  {one.sensor} departed from its neighbours by {one.off_by_k:+.1f} K on "
            f"{since:%Y-%m-%d}, "
            f"having stayed within {one.usual_k:.1f} K of them before"
        )
    for name, each in (("all rows", every_row), ("thinned", lathe)):
        residuals = residuals_of(each.campaign([run.date for run in each.runs]))
        counts = ", ".join(f"{one.reason}: {one.count}" for one in residuals.left_out)
        print(f"  {name}: {residuals.kept.size} values, left out: {counts}")
    sensors = {code: group.sensor for group in lathe.model.groups for code in group.codes}
    print(f"  sensors proposed from six states of one run: {sensors}")


def _print_kinds(folds: Sequence[Fold]) -> None:
    """Count in how many parts each kind was adopted on each component, driven by what."""
    found: Counter[tuple[str, str]] = Counter()
    drivers: dict[tuple[str, str], list[str]] = {}
    for fold in folds:
        effects = [one.effect for each in fold.rounds for one in each.adopted]
        found.update({(e.components[0], e.kind) for e in effects})
        for e in effects:
            names = drivers.setdefault((e.components[0], e.kind), [])
            names.append(" ".join((*e.sensors, *e.states)))
    print(f"  adopted in so many of {len(folds)} parts, driven by")
    for (code, kind), count in sorted(found.items()):
        print(f"    {code} {kind}: {count}, {', '.join(sorted(set(drivers[code, kind])))}")
