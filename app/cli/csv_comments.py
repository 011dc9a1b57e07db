"""The comment lines above an error map or a measurement: whose, when, at which temperatures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any, Final

from app.cli.delimited_text import DelimitedText, Problems
from app.cli.options import read_number

_KEYS: Final = "label, measured_at, machine, temperature SENSOR, instrument, repeatability_um"


@dataclass(frozen=True, slots=True)
class Stated:
    """What the command line says of a map; it goes before what the file says."""

    label: str | None = None
    measured_at: str | None = None
    temperatures_c: Mapping[str, float] = field(default_factory=dict)


def read_comments(
    text: DelimitedText, stated: Stated, remarks: list[str], complete: bool = True
) -> dict[str, Any]:
    """Read `# key: value` lines into an error map's fields, and complain of what is missing.

    Parameters
    ----------
    text
        The file; what is wrong or missing is noted in its problems.
    stated
        What goes before the file's lines.
    remarks
        Takes up which lines are not read.
    complete
        Whether label, time and temperatures are needed.
    """
    problems = text.problems
    facts: dict[str, Any] = {}
    temperatures_c: dict[str, float] = {}
    for line, comment in text.comments:
        name, colon, value = (part.strip() for part in comment.partition(":"))
        key, _, subject = name.partition(" ")
        key, subject = key.lower(), subject.strip()
        if not colon:
            continue
        if key in ("label", "machine", "instrument", "measured_at") and not subject:
            facts[key] = value
        elif key in ("temperature", "temperature_c") and subject:
            number = read_number(value.removesuffix("C").removesuffix("°"))
            if number is None:
                problems.add(f"expected the temperature of {subject} in °C, came {value!r}", line)
            else:
                temperatures_c[subject] = number
        elif key == "repeatability_um" and not subject:
            facts[key] = read_number(value)
            if facts[key] is None:
                problems.add(f"expected a repeatability in µm, came {value!r}", line)
        else:
            remarks.append(f"line {line}: {name!r} is not read; what is: {_KEYS}")
    facts |= {k: v for k in ("label", "measured_at") if (v := getattr(stated, k)) is not None}
    if temperatures_c or stated.temperatures_c:
        facts["temperatures_c"] = temperatures_c | dict(stated.temperatures_c)
    if complete:
        _complain_of_missing(facts, problems)
    if facts.get("measured_at") and not _has_zone(facts["measured_at"]):
        problems.add(
            "expected measured_at with its zone such as 2026-03-01T06:00:00Z, "
            f"came {facts['measured_at']!r}"
        )
    return facts


def _complain_of_missing(facts: Mapping[str, Any], problems: Problems) -> None:
    wanted = {
        "label": ("a label", "# label: Run #1", "--label"),
        "measured_at": (
            "a time with its zone",
            "# measured_at: 2026-03-01T06:00:00Z",
            "--measured-at",
        ),
        "temperatures_c": (
            "every sensor's temperature in °C",
            "# temperature x-middle: 20.1",
            "--temperature",
        ),
    }
    for key, (what, comment, option) in wanted.items():
        if not facts.get(key):
            problems.add(f"expected {what}, came none: write `{comment}` or give {option}")


def _has_zone(text: str) -> bool:
    try:
        return datetime.fromisoformat(text).tzinfo is not None
    except ValueError:
        return False
