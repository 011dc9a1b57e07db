"""The shop: thermap's service, its command line, and the files that a laser's readings fill in."""

from __future__ import annotations

import csv
import io
import os
import subprocess
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from app.cli.listening import listening, serving, url_of
from app.main import create_app
from app.settings import Settings
from thermap import ThermapClient


@dataclass(frozen=True)
class Shop:
    """A running service, and its command line as somebody uses it in a terminal."""

    url: str
    client: ThermapClient
    folder: Path

    def thermap(self, *words: object) -> str:
        """Run `thermap` with these words; give what it wrote.

        Raises
        ------
        RuntimeError
            If it failed, with what it said.
        """
        ran = subprocess.run(
            [sys.executable, "-m", "app", *(str(word) for word in words)],
            env=os.environ | {"THERMAP_URL": self.url},
            capture_output=True,
            text=True,
            check=False,
        )
        if ran.returncode:
            raise RuntimeError(f"thermap {' '.join(map(str, words))}: {ran.stderr or ran.stdout}")
        return ran.stdout

    def program(self, kind: str, *words: object, into: str) -> tuple[str, str]:
        """Let `thermap program` write for LinuxCNC; give the program and the file to fill in."""
        folder = self.folder / into
        self.thermap("program", kind, *words, "-c", "linuxcnc", "--output", folder)
        (program,) = (path.read_text() for path in folder.glob("*.ngc"))
        (form,) = (path.read_text() for path in folder.glob("*.csv"))
        return program, form


@contextmanager
def open_shop(folder: Path) -> Iterator[Shop]:
    """Start the service on a database in a folder, and end it again."""
    service = create_app(Settings(database_url=f"sqlite:///{folder / 'shop.db'}"))
    with listening("127.0.0.1", 0, "serve") as opened, serving(service, opened, "warning"):
        url = url_of(opened)
        with ThermapClient(url, timeout_s=600.0) as client:
            yield Shop(url, client, folder)


def rows_of(form: str) -> list[dict[str, str]]:
    """Read the lines that are to be filled in, each column by its name."""
    return list(csv.DictReader(line for line in form.splitlines() if not line.startswith("#")))


def filled(
    form: str, column: str, values: Iterable[float], head: Mapping[str, str] | None = None
) -> str:
    """Fill in a column of a file that came with a program, and its comment lines.

    Parameters
    ----------
    values
        One for each line, in order.
    head
        A comment line's name to what is to stand there.
    """
    comments = [line for line in form.splitlines() if line.startswith("#")]
    for name, said in (head or {}).items():
        comments[comments.index(f"# {name}: ")] += said
    rows = rows_of(form)
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    for row, value in zip(rows, values, strict=True):
        writer.writerow(row | {column: f"{value:.4f}"})
    return "\n".join([*comments, text.getvalue()])


def zeroed(stood_mm: Sequence[float], nominal_mm: Sequence[float]) -> list[float]:
    """Give the deviations at the nominal positions [µm], from the laser's zero.

    Parameters
    ----------
    stood_mm
        First where the laser was zeroed, at the first of the nominal positions; then at each.
    """
    zero, *read = stood_mm
    return [
        1000.0 * (at - zero - (to - nominal_mm[0])) for at, to in zip(read, nominal_mm, strict=True)
    ]


def iso(time_s: float) -> str:
    """Write a time [s since 1970-01-01 UTC] as ISO 8601."""
    return datetime.fromtimestamp(time_s, UTC).isoformat().replace("+00:00", "Z")
