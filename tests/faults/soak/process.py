"""What a process holds: memory, handles, threads; and how its memory grew."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

MOST = 4000
"""Samples that are kept: of more every other one is let go, and half as many are taken."""

BLOCKS = 12
"""A growth is fitted to the means of so many stretches: single samples hang together."""


@dataclass(frozen=True)
class Sample:
    """A process at one moment: resident memory [MiB], open handles, threads."""

    at_s: float
    pid: int
    resident_mib: float
    handles: int
    threads: int
    database_mib: float


def look_at(pid: int, at_s: float, database_mib: float) -> Sample | None:
    """Read what a process holds; None where it has ended."""
    folder = Path(f"/proc/{pid}")
    try:
        fields = dict(line.split(":", 1) for line in (folder / "status").read_text().splitlines())
        handles = len(list((folder / "fd").iterdir()))
        memory = int(fields["VmRSS"].split()[0]) / 1024.0
    except (OSError, KeyError):
        return None
    return Sample(at_s, pid, memory, handles, int(fields["Threads"]), database_mib)


class Watch(threading.Thread):
    """Looks at the service's process from time to time, in bounded memory."""

    def __init__(self, look: Callable[[], Sample | None], every_s: float) -> None:
        super().__init__(name="watch", daemon=True)
        self._look, self._every_s = look, every_s
        self._ended = threading.Event()
        self.samples: list[Sample] = []

    def run(self) -> None:
        while not self._ended.wait(self._every_s):
            sample = self._look()
            if sample is not None:
                self.samples.append(sample)
            if len(self.samples) >= MOST:
                del self.samples[::2]
                self._every_s *= 2.0

    def end(self) -> None:
        self._ended.set()
        self.join()


@dataclass(frozen=True)
class Growth:
    """A rate and its standard error [MiB/h], over so many hours."""

    rate: float
    standard_error: float
    hours: float


def growth_of(samples: Sequence[Sample]) -> Growth | None:
    """Fit a line to the memory of one process, over the means of equal stretches of time.

    Returns
    -------
    Growth or None
        None where there are too few samples for an uncertainty.
    """
    if len(samples) < 3 * BLOCKS:
        return None
    hours = np.array([s.at_s for s in samples]) / 3600.0
    memory = np.array([s.resident_mib for s in samples])
    parts = np.array_split(np.arange(len(samples)), BLOCKS)
    x = np.array([hours[part].mean() for part in parts])
    y = np.array([memory[part].mean() for part in parts])
    design = np.column_stack([np.ones(BLOCKS), x - x.mean()])
    fitted, *_ = np.linalg.lstsq(design, y, rcond=None)
    scatter = y - design @ fitted
    variance = scatter @ scatter / (BLOCKS - 2) / ((x - x.mean()) ** 2).sum()
    return Growth(float(fitted[1]), float(np.sqrt(variance)), float(hours[-1] - hours[0]))
