"""What becomes of the tables when a model version is made: lost, gained, changed, activated."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, Literal, Self

from pydantic import Field

from app.api.schemas.base import Number, Schema, UtcTime

if TYPE_CHECKING:
    from app.compensation.table_difference import ComponentChange
    from app.effects.adopted.model_difference import ModelDifference, Part
    from app.services.change_model import MadeVersion, WaitedBefore
    from app.services.models import Preview
    from app.services.recorded_change import ChangeThen, RecordedChanges


class CoverageAnswer(Schema):
    """One thing that one version's table has and another's lacks."""

    component: str | None = Field(
        None, description="Component code; null where it concerns no single one", examples=["EXX"]
    )
    what: str = Field(
        description="`component`, `positions`, `temperatures` (between maps), `direction` (the "
        "two directions of approach) or `completeness`",
        examples=["positions"],
    )
    from_mm: Number | None = Field(
        None,
        description="Lowest position [mm]; null for an open end, and without positions",
        examples=[100.0],
    )
    to_mm: Number | None = Field(None, description="Highest position [mm]", examples=[500.0])
    sensor: str | None = Field(
        None,
        description="Sensor whose temperatures bound it; null where it holds at all of them",
        examples=["x-middle"],
    )
    from_c: Number | None = Field(
        None,
        description="Lowest temperature of that sensor [°C]; null for an open end",
        examples=[20.0],
    )
    to_c: Number | None = Field(None, description="Highest temperature [°C]", examples=[24.0])
    text: str = Field(description="The same in words", examples=["EXX from 100 to 500 mm"])

    @classmethod
    def each(cls, parts: Iterable[Part]) -> list[Self]:
        """Show what is lost, or gained."""
        return [
            cls(
                component=part.component,
                what=part.what,
                from_mm=part.from_mm,
                to_mm=part.to_mm,
                sensor=part.sensor,
                from_c=part.from_c,
                to_c=part.to_c,
                text=part.text,
            )
            for part in parts
        ]


class ComponentChangeAnswer(Schema):
    """The largest change of one component's error."""

    component: str = Field(description="Component code", examples=["EXX"])
    chapter: str = Field(description="The chapter's notation", examples=["D_x(x)"])
    change: Number = Field(description="Error afterwards minus error before, in `unit`")
    unit: str = Field(description="Unit of the change", examples=["µm"])
    position_mm: Number | None = Field(None, description="Where [mm]; null without positions")
    direction: Literal["+", "-"] = Field(description="Direction of approach in which it is so")
    status_before: str = Field(description="How it comes about now", examples=["clamped"])
    status_after: str = Field(description="How it would come about", examples=["at-map"])

    @classmethod
    def of(cls, change: ComponentChange) -> Self:
        """Show a change."""
        return cls(
            component=change.component.code,
            chapter=change.component.chapter,
            change=change.change,
            unit=change.component.unit.symbol,
            position_mm=change.position_mm,
            direction="-" if change.is_backward else "+",
            status_before=change.status_before,
            status_after=change.status_after,
        )


class ChangeThenAnswer(ComponentChangeAnswer):
    """The largest change of one component's error over what was recorded, and when that was."""

    time: UtcTime = Field(description="Time of that reading, UTC")
    temperatures_c: dict[str, Number] = Field(description="The temperatures then [°C]")

    @classmethod
    def then(cls, change_then: ChangeThen) -> Self:
        """Show a change and its moment."""
        change = ComponentChangeAnswer.of(change_then.change).model_dump()
        return cls(**change, time=change_then.time, temperatures_c=dict(change_then.temperatures_c))


class RecordedChangesAnswer(Schema):
    """By how much tables would have differed at what was recorded, up to the latest reading."""

    count: int = Field(
        description="At how many recorded moments tables were compared: a few dozen of them, as "
        "far apart in temperature as can be; 0 where there are none",
        examples=[24],
    )
    first_at: UtcTime | None = Field(None, description="The first of them, UTC; null without any")
    last_at: UtcTime | None = Field(None, description="The last of them, UTC; null without any")
    changes: list[ChangeThenAnswer] = Field(
        description="The largest change over them of each component that changes more there than "
        "at the latest reading, the largest number first (1 µrad counts as 1 µm); what adopted "
        "effects make of the past (lags) is not in it"
    )

    @classmethod
    def of(cls, changes: RecordedChanges) -> Self:
        """Show what was compared."""
        return cls(
            count=changes.count,
            first_at=changes.first_at,
            last_at=changes.last_at,
            changes=[ChangeThenAnswer.then(change) for change in changes.changes],
        )


class WaitingMapAnswer(Schema):
    """A map that the version that waits has, and the active one has not."""

    id: int = Field(description="The map's number", examples=[4])
    label: str = Field(description="The map's name", examples=["short"])


class WaitedBeforeAnswer(Schema):
    """What waited already when this version was made: this version contains it."""

    model_version: int = Field(description="The version that waited", examples=[4])
    maps: list[WaitingMapAnswer] = Field(
        description="Its maps that the active version has not: without them nothing waits, or "
        "something else"
    )
    loses: list[CoverageAnswer] = Field(
        description="Which of the version's `loses` are its doing; the others are new"
    )

    @classmethod
    def of(cls, before: WaitedBefore | None, difference: ModelDifference) -> Self | None:
        """Show it, given what the new version loses; None where nothing waited."""
        if before is None:
            return None
        return cls(
            model_version=before.version,
            maps=[WaitingMapAnswer(id=m.id, label=m.error_map.label) for m in before.maps],
            loses=CoverageAnswer.each(before.of_these(difference.loses)),
        )


WAITED_BEFORE = Field(None, description="What waited already; null where nothing did")
LOSES = Field(description="What its tables lack against those of the version active before")
GAINS = Field(description="What its tables have beyond those")


class ModelChange(Schema):
    """Which version was made, and whether tables are computed with it."""

    model_version: int | None = Field(None, description="The version that was made", examples=[4])
    activated: bool | None = Field(
        None,
        description="Whether it is active; a version that loses something waits until somebody "
        "activates it, and the next ones are made of it",
    )
    loses: list[CoverageAnswer] = Field(default_factory=list, description=LOSES.description)
    gains: list[CoverageAnswer] = Field(default_factory=list, description=GAINS.description)
    next_step: str | None = Field(
        None, description="How to activate it all the same; null where it is active"
    )
    waited_before: WaitedBeforeAnswer | None = WAITED_BEFORE
    stays_active: int | None = Field(
        None, description="The version that stays active while this one waits; null where it is"
    )


def change_fields(machine: str, new_version: MadeVersion | None) -> dict[str, Any]:
    """Write the fields of `ModelChange`; none where no version was made."""
    if new_version is None:
        return {}
    return {
        "model_version": new_version.version.version,
        "activated": new_version.is_active,
        **difference_fields(new_version.difference),
        "next_step": None if new_version.is_active else _how_to_activate(machine, new_version),
        "waited_before": WaitedBeforeAnswer.of(new_version.waited_before, new_version.difference),
        "stays_active": None if new_version.is_active else new_version.active_version,
    }


def difference_fields(difference: ModelDifference) -> dict[str, Any]:
    """Write what is lost and gained."""
    return {
        "loses": CoverageAnswer.each(difference.loses),
        "gains": CoverageAnswer.each(difference.gains),
    }


def _how_to_activate(machine: str, new_version: MadeVersion) -> str:
    number = new_version.version.version
    return (
        f"Version {number} is stored and waits, because its tables would lose something; version "
        f"{new_version.active_version} of machine {machine!r} stays active. Activating {number} "
        "lets "
        f"tables follow it all the same; activating {new_version.active_version} again gives it "
        "up, and "
        "deleting the map that would lose something takes that out. Versions made meanwhile "
        "contain what it contains."
    )


class PreviewAnswer(Schema):
    """What a change would do to the tables; nothing is stored."""

    preview: Literal[True] = Field(True, description="That nothing is stored")
    reason: str = Field(
        description="What would make the version, and which effects it would not keep",
        examples=["map 'Run #7' stored"],
    )
    active_version: int | None = Field(
        None,
        description="The version that it is compared with; null before the first",
        examples=[3],
    )
    activated: bool = Field(description="Whether it would be activated without more ado")
    loses: list[CoverageAnswer] = LOSES
    gains: list[CoverageAnswer] = GAINS
    waited_before: WaitedBeforeAnswer | None = WAITED_BEFORE
    reading_time: UtcTime | None = Field(
        None, description="Time of the latest reading, at which `changes` hold; null without, UTC"
    )
    temperatures_c: dict[str, Number] = Field(description="Its temperatures [°C]")
    changes: list[ComponentChangeAnswer] = Field(
        description="By how much each component that stays would change then, largest number "
        "first (1 µrad counts as 1 µm)"
    )
    not_compared: str = Field(
        description="Why nothing is known of changes, such as that there is no reading; else empty"
    )
    recorded: RecordedChangesAnswer = Field(
        description="The same at what was recorded before: a map whose temperatures are wrong may "
        "change nothing at the latest reading"
    )
    warnings: list[str] = Field(
        default_factory=list,
        description="What is unusual about what would be stored, such as numbers that may be in "
        "another unit",
    )

    @classmethod
    def of(cls, preview: Preview) -> Self:
        """Show a preview."""
        return cls(**preview_fields(preview))


def preview_fields(preview: Preview) -> dict[str, Any]:
    """Write the fields of `PreviewAnswer`."""
    present = preview.present
    return {
        "preview": True,
        "reason": preview.reason,
        "active_version": preview.active_version,
        "activated": preview.activates,
        **difference_fields(preview.difference),
        "waited_before": WaitedBeforeAnswer.of(preview.waited_before, preview.difference),
        "reading_time": present.reading_time,
        "temperatures_c": dict(present.temperatures_c),
        "changes": [ComponentChangeAnswer.of(change) for change in present.changes],
        "not_compared": present.why_not,
        "recorded": RecordedChangesAnswer.of(preview.recorded),
        "warnings": list(preview.remarks),
    }
