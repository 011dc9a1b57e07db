"""Readings that wait for the database: found, taken out and dropped in no time, however many."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Hashable, Iterator
from itertools import islice
from typing import Generic, Protocol, TypeVar


class OfMachine(Hashable, Protocol):
    """What belongs to a machine."""

    @property
    def machine(self) -> str:
        """The machine's id."""


One = TypeVar("One", bound=OfMachine)


class Waiting(Generic[One]):
    """Things in the order in which they came, and each machine's own."""

    # A dict from whose front much was taken looks for its first entry among all that were there.
    def __init__(self) -> None:
        self._all: OrderedDict[One, None] = OrderedDict()
        self._of_machine: dict[str, OrderedDict[One, None]] = {}

    def __len__(self) -> int:
        return len(self._all)

    def __contains__(self, one: One) -> bool:
        return one in self._all

    def __iter__(self) -> Iterator[One]:
        return iter(self._all)

    def add(self, one: One) -> None:
        """Put one behind all others."""
        self._all[one] = None
        self._of_machine.setdefault(one.machine, OrderedDict())[one] = None

    def remove(self, one: One) -> None:
        """Take one out; KeyError if it is not there."""
        del self._all[one]
        own = self._of_machine[one.machine]
        del own[one]
        if not own:
            del self._of_machine[one.machine]

    def next_batch(self, most: int) -> list[One]:
        """Give the first of all and the next of its machine, at most so many."""
        first = next(iter(self._all))
        return list(islice(self._of_machine[first.machine], most))

    def one_too_many(self, machine: str) -> One:
        """Choose what gives way to what a machine has just sent.

        It is the machine's own oldest where that has more than its share: who floods loses its
        own. Otherwise it is the oldest of the machine that has most.
        """
        own = self._of_machine[machine]
        if len(own) * len(self._of_machine) <= len(self._all):
            own = max(self._of_machine.values(), key=len)
        return next(iter(own))
