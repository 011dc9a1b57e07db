"""Time and memory that the largest analysis takes: a simulated campaign, in a process of its own.

python -m benchmarks.largest_analysis [--visits 250] [--observations 400] [--seed 3]
    [--one-verification]
"""

from __future__ import annotations

import argparse
import resource
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Final

from app.identification.analysis.analyse import analyse
from app.simulation.undeclared import make_campaign
from scripts.campaign_of_bodies import campaign_of_bodies

PLANTED: Final = ("thermal-lag",)
AMPLITUDE: Final = 2.0


def measure(seed: int, visits: int, observations: int, is_one: bool) -> list[str]:
    """Analyse in this process, and say what came of it.

    Parameters
    ----------
    seed, visits
        Of the campaign.
    observations
        Of each visit.
    is_one
        Whether all visits are one verification with one set-up, not each its own.

    Returns
    -------
    list of str
        Lines to print. Memory is the process' largest, with all that it has loaded.
    """
    made = make_campaign(
        *(seed, PLANTED, AMPLITUDE),
        visits=visits,
        observations_per_visit=observations,
        one_verification=is_one,
    )
    campaign = campaign_of_bodies(made.machine, made.error_maps, made.readings, made.verifications)
    del made
    read_mb = _peak_mb()
    begun_s, begun_cpu_s = time.perf_counter(), time.process_time()
    found = analyse(campaign)
    took_s, cpu_s = time.perf_counter() - begun_s, time.process_time() - begun_cpu_s
    return [
        f"observations        {visits * observations:,} in {visits:,} visits",
        f"values              {found.values:,}",
        f"answer              {found.verdict}: {', '.join(e.kind for e in found.effects)}",
        f"took                {took_s:.0f} s, {cpu_s:.0f} s of processor time",
        f"memory as read      {read_mb:,.0f} MB",
        f"largest memory      {_peak_mb():,.0f} MB",
    ]


def _peak_mb() -> float:
    """Give the largest resident memory until now; Linux counts it in kB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seed", type=int, default=3)
    parser.add_argument("--visits", type=int, default=250)
    parser.add_argument("--observations", type=int, default=400, help="of each visit")
    parser.add_argument(
        "--one-verification", action="store_true", help="all visits have one set-up in common"
    )
    asked = parser.parse_args()
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as processes:
        lines = processes.submit(
            measure, asked.seed, asked.visits, asked.observations, asked.one_verification
        )
        print("\n".join(lines.result()))


if __name__ == "__main__":
    main()
