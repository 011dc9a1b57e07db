"""Proposed visits as files: verifications without values, for planning and measuring."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from app.cli.options import write_file
from app.cli.terminal import echo
from app.files.csv_writing import csv_of_visit
from app.identification.plan.visit import NextVisit


def write_visits(folder: Path, machine: str, visits: Sequence[NextVisit]) -> None:
    """Write the visits that an analysis proposes, or say that it proposes none."""
    if not visits:
        echo(f"{folder}: nothing written: the analysis proposes no visit", err=True)
        return
    folder.mkdir(parents=True, exist_ok=True)
    for number, visit in enumerate(visits, start=1):
        file = folder / f"visit-{number}.csv"
        write_file(file, csv_of_visit(machine, visit))
        echo(f"{file}: {visit.sentence}", err=True)
    echo(f"`thermap program visit {machine} {file} -c CONTROLLER` writes its NC program", err=True)
