"""What a new model version does to the tables, in lines for a terminal."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Final

from app.errors import list_names

if TYPE_CHECKING:
    from app.api.schemas.model_change import (
        ComponentChangeAnswer,
        CoverageAnswer,
        ModelChange,
        PreviewAnswer,
    )

MOST_CHANGES: Final = 4
"""Components whose change is named; the others change by less."""


def preview_lines(preview: PreviewAnswer) -> Iterator[str]:
    """Say what tables would lose and gain, and by how much they would change now."""
    yield from (f"would lose {text}" for text in _together(preview.loses))
    yield from (f"would gain {text}" for text in _together(preview.gains))
    changes = [change for change in preview.changes if change.change]
    if changes:
        named = list_names(map(_change_text, changes), MOST_CHANGES)
        yield f"would change the errors at the latest reading: {named}"


def difference_lines(change: ModelChange) -> Iterator[str]:
    """Say what tables have lost and gained."""
    yield from (f"tables lose {text}" for text in _together(change.loses or ()))
    yield from (f"tables gain {text}" for text in _together(change.gains or ()))


def waiting_lines(change: ModelChange, machine: str) -> Iterator[str]:
    """Say that a version waits, and how to activate it all the same; nothing where none does."""
    if change.activated is False and change.model_version is not None:
        lost = "; ".join(_together(change.loses or ()))
        yield (
            f"model version {change.model_version} waits and tables stay as they are, because "
            f"they would lose {lost}"
        )
        yield (
            f"`thermap models activate {change.model_version} --machine {machine}` activates it "
            "all the same; what is stored meanwhile is added to it"
        )


def _together(parts: Iterable[CoverageAnswer]) -> list[str]:
    """Write each part once for all components of which the same is true."""
    codes: dict[str, list[str]] = {}
    for part in parts:
        pattern = part.text.replace(part.component, "{}") if part.component else part.text
        codes.setdefault(pattern, []).append(part.component or "")
    return [pattern.replace("{}", _names(codes[pattern])) for pattern in codes]


def _names(codes: Sequence[str]) -> str:
    return list_names(codes, 30)


def _change_text(change: ComponentChangeAnswer) -> str:
    where = "" if change.position_mm is None else f" at {change.position_mm:g} mm"
    return f"{change.component} by {change.change:+.2f} {change.unit}{where}"
