"""How often an effect of one machine is said to be on a sister that has none: the false yes.

Effects are found on simulated machines, each by an analysis of its own kind, and tried as they are
on sisters in which nothing was planted, as `thermap analyse --fleet` tries them: with the
threshold of so many trials together. Sisters differ in everything that is drawn: heat, duty, maps'
errors, scatter; half of them have zeros that wander within a visit.

    python -m benchmarks.fleet_trials [--sisters 40] [--visits 20] [--processes 2]
"""

from __future__ import annotations

import argparse
from collections import Counter, defaultdict
from concurrent.futures import ProcessPoolExecutor
from itertools import repeat

from app.effects.effect import Effect
from app.identification.analysis.analyse import analyse
from app.identification.analysis.tried_effect import try_effect
from app.identification.campaign import Campaign
from app.identification.fleet import is_tried
from app.simulation.undeclared import make_campaign
from scripts.campaign_of_bodies import campaign_of_bodies

PLANTED = ("thermal-lag", "backlash", "other-sensor", "state-variable", "temperature-curvature")
AMPLITUDE = 3.0
FIRST_SISTER = 1000
CONDITIONS = {
    "plain": {},
    "zeros wander": {"wander_um": 1.0, "wander_tilt_um": 0.5, "wander_min": 90.0},
}


def campaign_of(seed: int, visits: int, planted: str | None = None, **conditions) -> Campaign:
    """Simulate a machine and what was measured on it."""
    made = make_campaign(seed, planted, AMPLITUDE, visits=visits, **conditions)
    return campaign_of_bodies(made.machine, made.error_maps, made.readings, made.verifications)


def found_on(seed: int, kind: str, visits: int) -> list[Effect]:
    """Plant an effect and look for its kind; what helps there is tried on sisters."""
    answer = analyse(campaign_of(seed, visits, kind), kinds=[kind])
    return [e.effect for e in answer.effects if is_tried(e)]


def tried_on(
    seed: int, effects: list[Effect], visits: int, together: int
) -> list[tuple[str, str, str]]:
    """Try effects on a sister without any.

    Returns
    -------
    list
        For each effect the sister's conditions, the verdict among so many trials together, and
        what it would be of that trial alone.
    """
    name = list(CONDITIONS)[seed % len(CONDITIONS)]
    sister = campaign_of(seed, visits, **CONDITIONS[name])
    return [
        (name, try_effect(sister, effect, together).verdict, try_effect(sister, effect).verdict)
        for effect in effects
    ]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sisters", type=int, default=40)
    parser.add_argument("--visits", type=int, default=20)
    parser.add_argument("--processes", type=int, default=2)
    stated = parser.parse_args()
    with ProcessPoolExecutor(stated.processes) as pool:
        sources = range(1, 1 + len(PLANTED))
        found = pool.map(found_on, sources, PLANTED, repeat(stated.visits))
        effects = [effect for of_one in found for effect in of_one]
        for effect in effects:
            print(f"found: {effect.kind} on {', '.join(effect.components)}", flush=True)
        sisters = range(FIRST_SISTER, FIRST_SISTER + stated.sisters)
        together = len(effects) * stated.sisters
        answers = pool.map(
            tried_on, sisters, repeat(effects), repeat(stated.visits), repeat(together)
        )
        counts: dict[tuple[str, str], Counter[str]] = defaultdict(Counter)
        for of_one in answers:
            for effect, (name, verdict, alone) in zip(effects, of_one, strict=True):
                counts[effect.kind, name][verdict] += 1
                counts[effect.kind, name]["alone: yes"] += alone == "yes"
    show(counts, together)


def show(counts: dict[tuple[str, str], Counter[str]], together: int) -> None:
    """Print a line for each kind and condition, and the sum."""
    verdicts = ("yes", "no", "cannot-be-told", "alone: yes")
    print("\n| effect | sisters' scatter | yes | no | cannot be told | yes, each trial alone |")
    print("| --- | --- | --- | --- | --- | --- |")
    for (kind, name), counted in sorted(counts.items()):
        print(f"| {kind} | {name} | " + " | ".join(str(counted[v]) for v in verdicts) + " |")
    total = sum(counts.values(), Counter())
    print(f"| all {together} | | " + " | ".join(str(total[v]) for v in verdicts) + " |")


if __name__ == "__main__":
    main()
