"""How well effects that the model lacks are found: on simulated campaigns with known truth.

Every family is planted alone at several amplitudes, in pairs, and not at all; so are effects
that are in no family. Printed are, for each family and amplitude: found alone, found in a
stated tie, wrong, missed; the share of the missing effect that the answer removes; the
held-out error against an oracle's that knows the effect; the time.

    python -m benchmarks.closing_the_loop [--families thermal-lag …] [--amplitudes 1 2 4]
        [--seeds 2] [--nothing 200] [--unknown 3] [--pairs 12] [--processes 2]
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from app.effects.effect import effect_from_json
from app.effects.projection import sum_of_terms
from app.identification.analysis.analyse import analyse
from app.identification.campaign import Campaign, residuals_of
from app.simulation.undeclared import FAMILIES, UNKNOWN, make_campaign
from app.simulation.undeclared.campaign import Campaign as Simulated
from app.storage.analysis_results import RESULTS
from benchmarks.closing_the_loop_judge import judge
from scripts.campaign_of_bodies import campaign_of_bodies

HELD_OUT = 0.3
FOLDS = 3


@dataclass(frozen=True)
class Task:
    """One campaign: what is planted how strongly, and under which conditions."""

    seed: int
    planted: tuple[str, ...]
    amplitude: float
    visits: int = 100
    conditions: Mapping[str, Any] = field(default_factory=dict)

    @property
    def row(self) -> tuple[str, float]:
        """Where the table counts it."""
        names = [name.partition(":")[0] for name in self.planted]
        return (" + ".join(names) if len(names) < 2 else "pairs") or "nothing", self.amplitude


@dataclass(frozen=True)
class Outcome:
    """What came of one campaign."""

    task: Task
    judgement: str
    verdict: str
    found: list[str]
    truth: list[str]
    removed: float | None
    holdout_um: float
    refitted_um: float
    oracle_um: float
    seconds: float


def run(task: Task) -> Outcome:
    """Simulate, analyse, judge."""
    made = make_campaign(
        task.seed, task.planted, task.amplitude, visits=task.visits, **task.conditions
    )
    campaign = campaign_of_bodies(made.machine, made.error_maps, made.readings, made.verifications)
    begun = time.perf_counter()
    answer = RESULTS.fields(analyse(campaign, holdout_fraction=HELD_OUT))
    seconds = time.perf_counter() - begun
    return Outcome(
        task,
        judge(answer, made.truth.effects),
        answer["verdict"],
        [_named(effect) for effect in answer["effects"]],
        [_told(effect) for effect in made.truth.effects],
        _removed(campaign, answer, made),
        answer["after"]["holdout_rms_um"],
        answer["after_with_maps_refitted"]["holdout_rms_um"],
        _oracle_um(made),
        seconds,
    )


def _named(effect: Mapping[str, Any]) -> str:
    ties = [a for a in effect["alternatives"] if a["tied"]]
    tied = " ~ ".join(f"{a['kind']} {a['components']} {a['sensors']}" for a in ties)
    where = [*effect["components"], *effect["sensors"], *effect["states"]]
    sure = effect["evidence"]["two_ln_bayes_factor"] or 0.0
    return f"{effect['kind']}/{effect['variant']} {where} {effect['status']} {sure:.0f}" + (
        f" ~ {tied}" if tied else ""
    )


def _told(effect: Mapping[str, Any]) -> str:
    parameters = {
        k: round(v, 3) if isinstance(v, float) else v for k, v in effect["parameters"].items()
    }
    return (
        f"{effect['kind']}:{effect['variant']} {effect['components']} {effect['sensors']} "
        f"{parameters}"
    )


def _removed(campaign: Campaign, answer: Mapping[str, Any], made: Simulated) -> float | None:
    """Give the share of the true, noise-free effect that adopting the answer takes away."""
    truth = made.truth.contribution_um
    if not made.truth.effects or not np.any(truth):
        return None
    residuals = residuals_of(campaign)
    terms = [t for e in answer["effects"] for t in effect_from_json(e["effect"]).terms]
    found = np.nan_to_num(sum_of_terms(residuals.projection, terms)) if terms else 0.0
    true = truth[residuals.kept]
    size = float(np.sqrt(np.mean(true**2)))
    return 1.0 - float(np.sqrt(np.mean((true - found) ** 2))) / size if size else None


def _oracle_um(made: Simulated) -> float:
    """Pool the oracle over the same folds of visits."""
    visits = np.arange(made.conditions.visits)
    errors = [made.oracle(visits[visits % FOLDS == fold]).holdout_rms_um for fold in range(FOLDS)]
    return float(np.sqrt(np.mean(np.square(errors))))


def tasks_of(asked: argparse.Namespace) -> Iterator[Task]:
    """List the campaigns that were asked for."""
    conditions = json.loads(asked.conditions)
    first = asked.first_seed

    def task(seed: int, names: Sequence[str], amplitude: float) -> Task:
        return Task(seed, tuple(names), amplitude, asked.visits, conditions)

    for number in range(asked.seeds):
        for name in asked.families:
            variants = {**FAMILIES, **UNKNOWN}[name].variants
            variant = variants[(first + number) % len(variants)]
            for amplitude in asked.amplitudes:
                yield task(first + number, [f"{name}:{variant}"], amplitude)
    for number in range(asked.unknown):
        for name in UNKNOWN:
            for amplitude in asked.amplitudes:
                yield task(first + 100 + number, [name], amplitude)
    families = list(FAMILIES)
    for number in range(asked.pairs):
        chosen = np.random.default_rng(first + number).choice(len(families), 2, replace=False)
        yield task(first + 200 + number, [families[i] for i in chosen], 2.0)
    for number in range(asked.nothing):
        yield task(first + 300 + number, [], 0.0)


def show(outcomes: Iterable[Outcome], loud: bool) -> None:
    """Print one line for each family and amplitude."""
    rows = defaultdict(list)
    for outcome in outcomes:
        rows[outcome.task.row].append(outcome)
        if loud:
            _tell(outcome)
    print(f"\n{'planted':24} {'×':>4} {'n':>4}  judgements; removed; after / oracle; refitted; s")
    for (name, amplitude), group in rows.items():
        counts = Counter(one.judgement for one in group)
        told = ", ".join(f"{word} {n}" for word, n in sorted(counts.items()))
        removed = [o.removed for o in group if o.removed is not None]
        share = f"{np.median(removed):.0%}" if removed else "–"
        ratio = np.median([o.holdout_um / o.oracle_um for o in group])
        refitted = np.median([o.refitted_um / o.oracle_um for o in group])
        seconds = np.median([o.seconds for o in group])
        print(
            f"{name:24} {amplitude:4g} {len(group):4}  {told}; {share}; {ratio:.2f}; "
            f"{refitted:.2f}; {seconds:.1f}"
        )


def _tell(outcome: Outcome) -> None:
    print(
        f"{outcome.task.seed} {outcome.task.planted} ×{outcome.task.amplitude:g}: "
        f"{outcome.judgement} ({outcome.verdict}) {outcome.seconds:.1f} s "
        f"{outcome.holdout_um:.3f} / {outcome.oracle_um:.3f}\n    truth {outcome.truth}\n    "
        + "\n    ".join(outcome.found),
        flush=True,
    )


def main() -> None:
    """Run what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--families", nargs="*", default=list(FAMILIES))
    parser.add_argument("--amplitudes", nargs="*", type=float, default=[1.0, 2.0, 4.0])
    parser.add_argument("--seeds", type=int, default=2, help="campaigns of each family")
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--nothing", type=int, default=0, help="campaigns without any effect")
    parser.add_argument("--unknown", type=int, default=0, help="campaigns of each unknown")
    parser.add_argument("--pairs", type=int, default=0)
    parser.add_argument("--visits", type=int, default=100)
    parser.add_argument("--conditions", default="{}", help="JSON: fields of the simulator's")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--quiet", action="store_true", help="the table alone")
    asked = parser.parse_args()
    if asked.processes == 1:
        show(map(run, tasks_of(asked)), not asked.quiet)
    else:
        with ProcessPoolExecutor(asked.processes) as pool:
            show(pool.map(run, tasks_of(asked)), not asked.quiet)
    sys.stdout.flush()


if __name__ == "__main__":
    main()
