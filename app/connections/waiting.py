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


Item = TypeVar("Item", bound=OfMachine)


class Waiting(Generic[Item]):
    """Things in the order in which they came, and each machine's own."""

    # A dict from whose front much was taken looks for its first entry among all that were there.
    def __init__(self) -> None:
        self._all: OrderedDict[Item, None] = OrderedDict()
        self._of_machine: dict[str, OrderedDict[Item, None]] = {}

    def __len__(self) -> int:
        return len(self._all)

    def __contains__(self, item: Item) -> bool:
        return item in self._all

    def __iter__(self) -> Iterator[Item]:
        return iter(self._all)

    def add(self, item: Item) -> None:
        """Put one behind all others."""
        self._all[item] = None
        self._of_machine.setdefault(item.machine, OrderedDict())[item] = None

    def remove(self, item: Item) -> None:
        """Take one out; KeyError if it is not there."""
        del self._all[item]
        of_machine = self._of_machine[item.machine]
        del of_machine[item]
        if not of_machine:
            del self._of_machine[item.machine]

    def next_batch(self, most: int) -> list[Item]:
        """Give the first of all and the next of its machine, at most so many."""
        first = next(iter(self._all))
        return list(islice(self._of_machine[first.machine], most))

    def one_too_many(self, machine: str) -> Item:
        """Choose what gives way to what a machine has just sent.

        It is the machine's own oldest where that has more than its share: who floods loses its
        own. Otherwise it is the oldest of the machine that has most.
        """
        of_machine = self._of_machine[machine]
        # An equal share for each machine that has something waiting.
        if len(of_machine) * len(self._of_machine) <= len(self._all):
            of_machine = max(self._of_machine.values(), key=len)
        return next(iter(of_machine))
