"""What senders that tell changes only have said last: it holds until they say otherwise."""

from __future__ import annotations

import asyncio
from collections.abc import Collection, Iterable, Mapping
from datetime import datetime
from typing import Final

from app.connections.intake import Fate, TakesValues

REPEATED_S: Final = 10.0
"""What has not changed is stored again after so long [s]; a temperature that nobody tells of any
more grows stale."""


class KnownValues:
    """The sensors and states of one machine that have a value now.

    Parameters
    ----------
    sensors, states
        Names of both; other values are passed over.
    """

    def __init__(
        self,
        intake: TakesValues,
        machine: str,
        sensors: Collection[str],
        states: Collection[str] = (),
    ) -> None:
        self._intake = intake
        self._machine = machine
        self._sensors = frozenset(sensors)
        self._states = frozenset(states)
        self._known: dict[str, float] = {}
        self._absent: set[str] = set()

    def __len__(self) -> int:
        return len(self._known)

    def take(
        self, values: Mapping[str, float | None], time: datetime | None = None
    ) -> asyncio.Future[Fate] | None:
        """Remember what holds from now on, and hand it over.

        Parameters
        ----------
        values
            Name to [°C] or the state's unit; None takes a value away.
        time
            When it was measured, with its zone; without one, now.

        Returns
        -------
        Future of Fate or None
            What becomes of the values; None where there are none to be stored.
        """
        for name, value in values.items():
            if value is None:
                self._known.pop(name, None)
            else:
                self._known[name] = value
        reported = self._sensors & values.keys()
        present = reported & self._known.keys()
        self._absent = (self._absent | reported) - present
        self._intake.tell_values(self._machine, present, reported - present)
        return self._offer(values, time)

    def forget(self) -> None:
        """Know nothing any more, as without contact."""
        self._known.clear()
        self._absent.clear()

    def keep(self, names: Collection[str]) -> None:
        """Forget all others."""
        self._known = {name: value for name, value in self._known.items() if name in names}

    def repeat(self) -> None:
        """Tell again all that holds."""
        if self._absent:
            self._intake.tell_values(self._machine, (), self._absent)
        self._offer(self._known)

    def _offer(
        self, names: Iterable[str], time: datetime | None = None
    ) -> asyncio.Future[Fate] | None:
        """Hand over what is known of these, with the state that holds with it."""
        reported = set(names)
        state = {k: v for k, v in self._known.items() if k in self._states}
        changed = {k: v for k, v in self._known.items() if k in self._sensors & reported}
        if not changed and not (state and reported & state.keys()):
            return None
        # The rest is told again after `REPEATED_S`, so that a reading has what changed.
        return self._intake.offer(self._machine, changed, time, state)
