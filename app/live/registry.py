"""Every machine's compiled model and latest readings, in memory.

The live table is answered from here alone, so it goes on when the database is
away. Models are replaced whole and only by newer ones, so a reader never sees
half of one.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from datetime import datetime
from functools import cached_property
from threading import Lock

from app.identification.effects.effect import Effect
from app.identification.past import Needed, needed_past
from app.live.carried_past import CarriedPast
from app.live.reading_window import ReadingWindow
from app.thermal.compiled_model import CompiledModel
from app.thermal.reading import Reading


@dataclass(frozen=True, eq=False)
class LiveModel:
    """A machine's active model with its adopted effects, as of one revision of the machine."""

    model: CompiledModel
    version: int | None
    created_at: datetime
    revision: int
    loaded_at: datetime
    effects: tuple[Effect, ...] = ()

    @property
    def stamp(self) -> tuple[datetime, int]:
        """Birth and revision of the machine: newer shapes have larger stamps."""
        return (self.created_at, self.revision)

    @cached_property
    def needed(self) -> Needed:
        """What its effects need of the past."""
        return needed_past(self.effects)


@dataclass(slots=True)
class LiveMachine:
    """What is known of one machine now: its model, its latest readings, and their past."""

    current: LiveModel
    readings: ReadingWindow = field(default_factory=ReadingWindow)
    past: CarriedPast = field(init=False)

    def __post_init__(self) -> None:
        self.past = CarriedPast(self.current.model.machine, self.current.needed)

    def replace(self, current: LiveModel) -> None:
        """Put another model in place; a past that it cannot use has to be restored."""
        machine = current.model.machine
        if not self.past.serves(machine, current.needed):
            self.past = CarriedPast(machine, current.needed)
        self.current = current

    def add(self, readings: Iterable[Reading]) -> None:
        """Take readings in, in any order; those already there are passed over."""
        arrived = list(readings)
        before = self.readings.kept
        self.readings.add(self.current.model.machine, arrived)
        self.past.add(before, arrived)


class LiveRegistry:
    """The machines in memory, by id."""

    def __init__(self) -> None:
        self._machines: dict[str, LiveMachine] = {}
        self._lock = Lock()
        self.database_away_since: datetime | None = None

    def get(self, machine_id: str) -> LiveMachine | None:
        """Find a machine that is in memory."""
        return self._machines.get(machine_id)

    def stamps(self) -> dict[str, tuple[datetime, int]]:
        """Say in which shape each machine is in memory."""
        return {machine_id: m.current.stamp for machine_id, m in list(self._machines.items())}

    def publish(self, live: LiveModel, readings: Iterable[Reading] = ()) -> LiveMachine:
        """Put a machine's model in place, unless a newer one is there already.

        Readings are taken in beside those that are known.
        """
        machine = live.model.machine
        with self._lock:
            known = self._machines.get(machine.id)
            if known is None or known.current.created_at != live.created_at:
                if known is not None and known.current.stamp > live.stamp:
                    return known
                known = LiveMachine(live)
                self._machines[machine.id] = known
            elif live.stamp >= known.current.stamp:
                known.replace(live)
            known.add(readings)
            return known

    def forget(self, machine_id: str) -> None:
        """Take a deleted machine out of memory."""
        with self._lock:
            self._machines.pop(machine_id, None)

    def add_readings(self, machine_id: str, readings: Iterable[Reading]) -> None:
        """Take readings in for a machine that is in memory; others load theirs later."""
        known = self._machines.get(machine_id)
        if known is not None:
            known.add(readings)

    def behind(self) -> list[LiveMachine]:
        """List the machines whose past has to be restored from stored readings."""
        return [machine for machine in list(self._machines.values()) if machine.past.is_behind]

    def __len__(self) -> int:
        return len(self._machines)
