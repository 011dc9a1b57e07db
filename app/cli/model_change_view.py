"""What a new model version does to the tables, in lines for a terminal."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Final, Protocol

from app.errors import list_names

if TYPE_CHECKING:
    from thermap.answers import (
        ComponentChangeAnswer,
        CoverageAnswer,
        PreviewAnswer,
        WaitedBeforeAnswer,
    )


class ModelChange(Protocol):
    """What every answer says that may have made a model version."""

    @property
    def model_version(self) -> int | None:
        """The version that was made."""

    @property
    def activated(self) -> bool | None:
        """Whether tables follow it already."""

    @property
    def loses(self) -> Sequence[CoverageAnswer]:
        """What tables lose by it."""

    @property
    def gains(self) -> Sequence[CoverageAnswer]:
        """What they gain."""

    @property
    def waited_before(self) -> WaitedBeforeAnswer | None:
        """The version that waited already."""

    @property
    def stays_active(self) -> int | None:
        """The version that stays active while this one waits."""


MOST_CHANGES: Final = 4
"""Components whose change is named; the others change by less."""


def preview_lines(preview: PreviewAnswer) -> Iterator[str]:
    """Say what tables would lose and gain, and by how much they would change now."""
    before = preview.waited_before
    yield from (f"would lose {text}" for text in _together(_new(preview.loses, before)))
    if before is not None and before.loses:
        yield f"{_waited(before)}, and would lose {'; '.join(_together(before.loses))}"
    yield from (f"would gain {text}" for text in _together(preview.gains))
    changes = [change for change in preview.changes if change.change]
    if changes:
        named = list_names(map(_change_text, changes), MOST_CHANGES)
        yield f"would change the errors at the latest reading: {named}"


def difference_lines(change: ModelChange) -> Iterator[str]:
    """Say what tables have lost and gained."""
    yield from (f"tables lose {text}" for text in _together(change.loses))
    yield from (f"tables gain {text}" for text in _together(change.gains))


def waiting_lines(change: ModelChange, machine: str, stored: int | None = None) -> Iterator[str]:
    """Say that a version waits, and what can be done about it; nothing where none does.

    Parameters
    ----------
    change
        The service's answer.
    machine
        The machine's id.
    stored
        Number of the map that was stored, where one was.
    """
    if change.activated is not False or change.model_version is None:
        return
    before = change.waited_before
    new = _together(_new(change.loses, before))
    reasons = [f"they would lose {'; '.join(new)}"] if new else []
    if before is not None and before.loses:
        reasons.append(f"{_waited(before)}, and would lose {'; '.join(_together(before.loses))}")
    yield (
        f"model version {change.model_version} waits and tables stay as they are, because "
        f"{'; and '.join(reasons)}"
    )
    culprits = {m.id: f"map {m.label!r}" for m in before.maps} if before and before.loses else {}
    if new and stored is not None:
        culprits[stored] = "the new map"
    ways = [f"`thermap models activate {change.model_version} --machine {machine}` activates it "]
    ways[0] += "all the same"
    ways += [
        f"`thermap maps delete {number} --machine {machine}` takes {what} out of it"
        for number, what in culprits.items()
    ]
    if change.stays_active is not None:
        again = f"`thermap models activate {change.stays_active} --machine {machine}`"
        ways.append(f"{again} gives up all that waits")
    yield f"{'; '.join(ways)}; what is stored meanwhile is added to it"


def _waited(before: WaitedBeforeAnswer) -> str:
    """Say which version waits already, and by which maps it differs."""
    maps = f", with {list_names(f'map {m.label!r}' for m in before.maps)}" if before.maps else ""
    return f"version {before.model_version} waits already{maps}"


def _new(
    loses: Iterable[CoverageAnswer], before: WaitedBeforeAnswer | None
) -> list[CoverageAnswer]:
    """Pick the losses that are not the doing of what waited already."""
    inherited = () if before is None else before.loses
    return [part for part in loses if part not in inherited]


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
