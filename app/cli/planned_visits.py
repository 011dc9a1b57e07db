"""Proposed visits as files: verifications without values, for planning and measuring."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from app.cli.options import write_file
from app.cli.terminal import echo
from app.identification.plan.visit import NextVisit
from thermap import ThermapClient


def write_visits(
    thermap: ThermapClient, folder: Path, machine: str, analysis: int, visits: Sequence[NextVisit]
) -> None:
    """Write the visits that an analysis proposes, or say that it proposes none."""
    if not visits:
        echo(f"{folder}: nothing written: the analysis proposes no visit", err=True)
        return
    folder.mkdir(parents=True, exist_ok=True)
    for number, visit in enumerate(visits, start=1):
        file = folder / f"visit-{number}.csv"
        write_file(file, thermap.visit_file(machine, analysis, number))
        echo(f"{file}: {visit.sentence}", err=True)
    echo(f"`thermap program visit {machine} {file} -c CONTROLLER` writes its NC program", err=True)
