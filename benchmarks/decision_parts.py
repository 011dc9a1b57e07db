"""What each part of the decision on adopting is worth, and what counting harm more costs.

Every campaign of `loop_counts` is analysed once, in this process. Then the decision is made again
without one of its parts, and with other weights of harm, and what each would adopt is held against
the true error at later times and places.

    python -m benchmarks.decision_parts parts.jsonl [--sections harm few] [--first-seed 31]
        [--minutes 60] [--table]
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, Final
from unittest.mock import patch

import numpy as np

from app.arrays import one_blas_thread
from app.identification.analysis import analyse as analyse_module
from app.identification.analysis import decide as decide_module
from app.identification.analysis.analyse import analyse
from app.identification.campaign import Campaign, residuals_of
from benchmarks.loop_counts import SECTIONS, _sent, tasks_of
from scripts.campaign_of_bodies import campaign_of_bodies

MARKED: Final = 1.1
"""Times as large, from which an error counts as larger or smaller."""

PARTS: Final = {
    "one set-up alone": decide_module.OF_EITHER,
    "a walking zero": decide_module.OF_A_WALK,
    "a constant beside a walking zero": decide_module.BESIDE_A_WALK,
    "something unexplained beside it": decide_module.BESIDE_WHAT_NOBODY_KNOWS,
    "set-ups alike": decide_module.OF_ALIKE_SET_UPS,
    "one hour of the day": decide_module.OF_ONE_HOUR,
    "what zeros hide": decide_module.BY_ITS_NAME_ALONE,
    "a short time": decide_module.OF_A_SHORT_TIME,
    "a mistake": decide_module.BESIDE_A_MISTAKE,
}
"""What may be true instead of an effect, to the words of that world."""

WEIGHTS: Final = (0.0, 0.5, 2.0, 4.0)
"""How much harm counts beside the squared error; 1 as it is."""


@contextmanager
def variant(name: str) -> Iterator[None]:
    """Decide otherwise for a while."""
    if name in PARTS:
        worlds = decide_module._worlds

        def others(*arguments: Any) -> Iterator[decide_module.World]:
            return (w for w in worlds(*arguments) if not w.words.startswith(PARTS[name]))

        with patch.object(decide_module, "_worlds", others):
            yield
    elif name == "ties":
        with patch.object(decide_module, "_ties", lambda *_: iter(())):
            yield
    elif name == "no held-out set-up markedly worse":
        with patch.object(decide_module, "_worse", lambda *_: iter(())):
            yield
    elif name.startswith("harm counts "):
        with patch.object(decide_module, "HARM", float(name.rpartition(" ")[2])):
            yield
    else:
        yield


VARIANTS: Final = (
    "as it is",
    *PARTS,
    "ties",
    "no held-out set-up markedly worse",
    *(f"harm counts {weight:g}" for weight in WEIGHTS),
)


def outcome(task: Any) -> dict[str, Any]:
    """Analyse one campaign, and say what each variant would leave of the later truth."""
    sent, _, _ = _sent(task)
    campaign = campaign_of_bodies(sent.machine, sent.error_maps, sent.readings, sent.verifications)
    later = campaign_of_bodies(sent.machine, sent.error_maps, sent.readings, [sent.later])
    decided: list[tuple[Any, Any]] = []

    def noted(finished: Any, effects: Any) -> Any:
        decided.append((finished, effects))
        return decide_module.decide(finished, effects)

    with patch.object(analyse_module, "decide", noted):
        analyse(campaign)
    left = {(): _left(later, ())}
    answer: dict[str, float] = {}
    for name in VARIANTS if decided else ():
        finished, effects = decided[-1]
        with variant(name):
            helps = decide_module.decide(finished, effects).helps
        chosen = tuple(i for i, one in enumerate(helps) if one.helps)
        if chosen not in left:
            left[chosen] = _left(later, [effects[i] for i in chosen])
        answer[name] = left[chosen]
    floor = None if sent.perfect_left is None else _rms(sent.perfect_left)
    is_found = bool(decided and decided[-1][1])
    return {
        "key": task.key,
        "before": left[()],
        "floor": floor,
        "after": answer if is_found else {},
    }


def _left(later: Campaign, effects: Any) -> float:
    residuals = residuals_of(replace(later, effects=effects))
    return _rms(residuals.rows.measured - residuals.predicted)


def _rms(values: Any) -> float:
    values = np.asarray(values)
    return float(np.sqrt(np.mean(np.square(values[np.isfinite(values)]))))


def show(outcomes: list[Mapping[str, Any]]) -> None:
    """Print the table."""
    told = [one for one in outcomes if one["after"]]
    print(f"{len(outcomes)} campaigns, something found in {len(told)}")
    print(f"{'without':36} {'harmed':>7} {'better':>7} {'share of squares removed':>26}")
    for name in VARIANTS:
        pairs = [(one["before"], one["after"][name], one["floor"] or 0.0) for one in told]
        harmed = sum(after > MARKED * before for before, after, _ in pairs)
        better = sum(after < before / MARKED for before, after, _ in pairs)
        removed = [(b**2 - a**2) / (b**2 - f**2) for b, a, f in pairs if b > MARKED * f]
        share = f"{np.mean(removed):.3f}" if removed else "-"
        print(f"{name:36} {harmed:7d} {better:7d} {share:>26}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", type=Path)
    parser.add_argument("--sections", nargs="*", default=["harm", "few"], choices=list(SECTIONS))
    parser.add_argument("--campaigns", type=int, default=1)
    parser.add_argument("--first-seed", type=int, default=31)
    parser.add_argument("--hours", type=float, default=12.0)
    parser.add_argument("--minutes", type=float, default=1e6)
    parser.add_argument("--table", action="store_true")
    asked = parser.parse_args()
    one_blas_thread()
    done = [json.loads(line) for line in asked.file.open()] if asked.file.exists() else []
    begun = time.monotonic()
    for task in () if asked.table else tasks_of(asked):
        if time.monotonic() - begun > 60.0 * asked.minutes:
            break
        if task.key not in {one["key"] for one in done}:
            done.append(outcome(task))
            with asked.file.open("a") as file:
                file.write(json.dumps(done[-1]) + "\n")
    show(done)


if __name__ == "__main__":
    main()
