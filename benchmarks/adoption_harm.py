"""What adoption does to the truth: campaigns whose noise, instruments and causes are unkind.

Every campaign is analysed as the service does it, the effects that help are adopted unasked, and
the model with them is held against later truth, free of measurement, beside the model without.
Counted are adoptions that make it worse by more than a tenth, confirmed effects that are
strictly wrong (neither the planted one nor in a stated tie with it), and campaigns without any
effect in which one is named or something is called unexplained. Where something was adopted, later
truth is set against an oracle's, which knows each effect's shape and fits its size alone.

    python -m benchmarks.adoption_harm [--seeds 1] [--only quantised outliers …] [--processes 2]
"""

from __future__ import annotations

import argparse
import time
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from app.api.schemas.campaigns import campaign_of_bodies
from app.effects.effect import effect_from_json
from app.identification.analysis.analyse import analyse
from app.identification.campaign import residuals_of
from app.simulation.undeclared import FAMILIES, UNKNOWN, make_campaign, make_record
from app.simulation.undeclared.campaign import Campaign as Simulated
from app.storage.analysis_results import RESULTS
from benchmarks.closing_the_loop_judge import judge

HARM: Final = 1.1
"""An adoption does harm that makes later truth worse by more than a tenth."""

LATER: Final = {"later_visits": 40}

CONDITIONS: Final[Mapping[str, Mapping[str, Any]]] = {
    "honest": {},
    "8 visits": {"visits": 8},
    "15 visits": {"visits": 15},
    "heavy tails": {"heavy_tails": True},
    "quantised": {"measured_quantum_um": 2.0},
    "wander 8 min": {"wander_um": 1.0, "wander_tilt_um": 0.5, "wander_min": 8.0},
    "wander 90 min": {"wander_um": 1.0, "wander_tilt_um": 0.5, "wander_min": 90.0},
    "set-ups of 2 µm": {"setup_shift_um": 2.0, "setup_tilt_um": 1.0},
    "set-ups correlated": {"setup_shift_um": 1.0, "setup_tilt_um": 0.5, "setup_correlation": 0.85},
    "laser warms up": {"warm_up_um": 2.0, "warm_up_min": 5.0},
    "datum declared wrongly": {"datum": "first"},
    "outliers": {"outliers": 0.02, "state_repeatability": False},
    "quantised to 1 µm": {"measured_quantum_um": 1.0},
    "quantised, nothing stated": {"measured_quantum_um": 2.0, "state_repeatability": False},
    "noise that lingers": {"ar1_um": 1.0},
    "instrument drifts": {"instrument_drift_um_per_h": 1.0},
    "no air compensation": {"length_um_per_m_per_k": -0.93},
    "no material temperature": {"length_um_per_m_per_k": 11.7, "length_sensor": "bed"},
}
"""Under which campaigns are made. `datum declared wrongly` is handed out as absolute."""

OF_INSTRUMENT: Final[Mapping[str, frozenset[str]]] = {
    "laser warms up": frozenset({"instrument-warm-up"}),
    "instrument drifts": frozenset({"instrument-warm-up", "drift"}),
    "no air compensation": frozenset({"instrument-compensation"}),
    "no material temperature": frozenset({"instrument-compensation"}),
}
"""What is rightly named where the instrument does it, though nothing is planted."""


@dataclass(frozen=True)
class Task:
    """One campaign."""

    seed: int
    condition: str
    planted: tuple[str, ...]
    hours: float | None = None

    def made(self) -> Simulated:
        """Simulate it."""
        stated = {**LATER, **CONDITIONS[self.condition]}
        if self.hours is not None:
            stated.pop("visits", None)
            return make_record(self.seed, self.planted, 2.0, hours=self.hours, **stated)
        return make_campaign(self.seed, self.planted, 2.0, **{"visits": 60, **stated})


@dataclass(frozen=True)
class Outcome:
    """What came of it; errors of later truth as root mean square [µm]."""

    task: Task
    judgement: str
    verdict: str
    named: tuple[str, ...]
    truth: str
    adopted: int
    before_um: float
    after_um: float
    floor_um: float
    oracle_um: float
    confirmed_wrong: int
    seconds: float

    @property
    def is_false(self) -> bool:
        """Whether something is named, or called unexplained, where nothing is."""
        return not self.task.planted and self.judgement != "nothing"

    @property
    def harms(self) -> bool:
        """Whether adoption made the truth worse by more than a tenth."""
        return self.after_um > HARM * self.before_um


def run(task: Task) -> Outcome:
    """Simulate, analyse, adopt what helps, look at later truth."""
    made = task.made()
    verifications = made.verifications
    if task.condition == "datum declared wrongly":
        verifications = [body | {"datum": "absolute"} for body in verifications]
    campaign = campaign_of_bodies(made.machine, made.error_maps, made.readings, verifications)
    begun = time.perf_counter()
    answer = RESULTS.fields(analyse(campaign))
    seconds = time.perf_counter() - begun
    adopted = [effect_from_json(e["effect"]) for e in answer["effects"] if e["helps"]]
    asked = [place | {"measured_um": _nothing(place)} for place in made.later.asked]
    later = {"label": "later", "datum": "absolute", "observations": asked}
    unseen = campaign_of_bodies(made.machine, made.error_maps, made.readings, [later])
    errors = []
    for effects in ((), adopted):
        residuals = residuals_of(replace(unseen, effects=effects))
        true = made.later.true_um[residuals.kept]
        errors.append(float(np.sqrt(np.mean((true + residuals.values) ** 2))))
    floor = made.later.error_um(made.later.contribution_um)
    right = made.truth.effects
    named = tuple(_named(e) for e in answer["effects"])
    lies = OF_INSTRUMENT.get(task.condition, frozenset()) - {e["kind"] for e in right}
    answer = {**answer, "effects": [e for e in answer["effects"] if e["kind"] not in lies]}
    confirmed = [e for e in answer["effects"] if e["status"] == "confirmed"]
    wrong = sum(
        judge({"effects": [e], "verdict": "effects-found"}, right)
        in ("wrong", "false", "wrong name", "missed")
        for e in confirmed
    )
    return Outcome(
        task,
        judge(answer, right),
        answer["verdict"],
        named,
        "; ".join(f"{e['kind']}:{e['variant']} {e['components']} {e['parameters']}" for e in right),
        len(adopted),
        *errors,
        floor,
        _oracle_um(made),
        wrong,
        seconds,
    )


def _oracle_um(made: Simulated) -> float:
    """Give an oracle's error of later truth; of a record, which it does not fit, the floor."""
    effects = made.truth.effects
    # One record has no visits with a set-up each.
    known = not made.conditions.is_record and len(effects) == 1
    share = float(made.oracle([]).amplitudes[0]) if known else 1.0
    return made.later.error_um(share * made.later.contribution_um)


def _nothing(place: Mapping[str, Any]) -> Any:
    return 0.0 if "component" in place else [0.0, 0.0, 0.0]


def _named(effect: Mapping[str, Any]) -> str:
    where = [*effect["components"], *effect["sensors"], *effect["states"]]
    helps = "adopted" if effect["helps"] else f"not adopted: {effect['why_not']}"
    tied = [
        f"{a['kind']} {a['components']} {a['sensors']}" for a in effect["alternatives"] if a["tied"]
    ]
    return f"{effect['kind']}/{effect['variant']} {where} {effect['status']}, {helps}" + (
        f" ~ {tied}" if tied else ""
    )


def tasks_of(asked: argparse.Namespace) -> Iterator[Task]:
    """List the campaigns: under every condition nothing, some families, some unknown causes."""
    for n, condition in enumerate(CONDITIONS):
        if asked.only and condition not in asked.only:
            continue
        for number in range(asked.seeds):
            seed = asked.first_seed + 10 * n + number
            yield Task(seed, condition, ())
            families, unknown = list(FAMILIES), list(UNKNOWN)
            for name in (families[(seed * 5) % len(families)], unknown[seed % len(unknown)]):
                yield Task(seed, condition, (name,))
            if "visits" not in condition and condition != "set-ups correlated":
                # One set-up of hours, as one verification.
                yield Task(seed, condition, (), asked.hours)
                yield Task(
                    seed, condition, (families[(seed * 5 + 3) % len(families)],), asked.hours
                )


def show(outcomes: Iterable[Outcome]) -> None:
    """Print each campaign, and a line for each condition."""
    rows = defaultdict(list)
    for one in outcomes:
        rows[one.task.condition].append(one)
        kind = "visits" if one.task.hours is None else f"{one.task.hours:g} h"
        flag = " HARM" * one.harms + " WRONG" * one.confirmed_wrong
        print(
            f"{one.task.condition}, seed {one.task.seed}, {kind}: {one.judgement} ({one.verdict}) "
            f"later {one.before_um:.2f} -> {one.after_um:.2f} (floor {one.floor_um:.2f}, "
            f"oracle {one.oracle_um:.2f}) {one.seconds:.0f} s{flag}\n"
            f"    truth {one.truth or 'nothing'}\n    " + "\n    ".join(one.named),
            flush=True,
        )
    print(
        f"\n{'condition':24} {'n':>4} harm, confirmed and wrong, false; median after / before;"
        " after / oracle where adopted"
    )
    for name, group in rows.items():
        planted = [o.after_um / o.before_um for o in group if o.task.planted]
        adopted = [o.after_um / o.oracle_um for o in group if o.adopted]
        print(
            f"{name:24} {len(group):4} {sum(o.harms for o in group):4} "
            f"{sum(o.confirmed_wrong > 0 for o in group):4} "
            f"{sum(o.is_false for o in group):4}"
            f"   {np.median(planted or [1.0]):.2f}  "
            + (f"{np.median(adopted):.2f} of {len(adopted)}" if adopted else "–")
        )


def main() -> None:
    """Run what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--seeds", type=int, default=1, help="of each condition")
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--only", nargs="*", help="conditions")
    parser.add_argument("--hours", type=float, default=12.0, help="of records")
    parser.add_argument("--processes", type=int, default=2)
    asked = parser.parse_args()
    if asked.processes == 1:
        show(map(run, tasks_of(asked)))
    else:
        with ProcessPoolExecutor(asked.processes) as pool:
            show(pool.map(run, tasks_of(asked)))


if __name__ == "__main__":
    main()
