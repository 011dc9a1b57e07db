"""Every machine's compiled model and latest readings, in memory.

The live table is answered from here alone, so it goes on when the database is
away. Models are replaced whole and only by newer ones, so a reader never sees
half of one.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from datetime import datetime
from threading import Lock

from app.live.reading_window import ReadingWindow
from app.thermal.compiled_model import CompiledModel
from app.thermal.reading import Reading


@dataclass(frozen=True, slots=True, eq=False)
class LiveModel:
    """A machine's active model as of one revision of the machine."""

    model: CompiledModel
    version: int | None
    created_at: datetime
    revision: int
    loaded_at: datetime

    @property
    def stamp(self) -> tuple[datetime, int]:
        """Birth and revision of the machine: newer shapes have larger stamps."""
        return (self.created_at, self.revision)


@dataclass(slots=True)
class LiveMachine:
    """What is known of one machine now."""

    current: LiveModel
    readings: ReadingWindow = field(default_factory=ReadingWindow)


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
                known.current = live
            known.readings.add(machine, readings)
            return known

    def forget(self, machine_id: str) -> None:
        """Take a deleted machine out of memory."""
        with self._lock:
            self._machines.pop(machine_id, None)

    def add_readings(self, machine_id: str, readings: Iterable[Reading]) -> None:
        """Take readings in for a machine that is in memory; others load theirs later."""
        known = self._machines.get(machine_id)
        if known is not None:
            known.readings.add(known.current.model.machine, readings)

    def __len__(self) -> int:
        return len(self._machines)
