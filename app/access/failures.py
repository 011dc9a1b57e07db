"""How often an address may come with a wrong key."""

from __future__ import annotations

from collections import OrderedDict
from typing import Final

AT_MOST: Final = 10
"""Wrong keys from one address within `WITHIN_S`."""

WITHIN_S: Final = 60.0

_ADDRESSES: Final = 10_000
"""Addresses that are remembered: who comes from very many cannot fill the memory."""


class Failures:
    """Wrong keys, by the address that they came from.

    A right key is always taken: who guesses behind the same proxy locks nobody out.

    Parameters
    ----------
    sharers
        So many processes of one host count for themselves, and whoever asks is answered by any of
        them: each allows its share, and one at least.
    """

    def __init__(self, sharers: int = 1) -> None:
        self._at_most = max(1, AT_MOST // sharers)
        self._found: OrderedDict[str, tuple[float, int]] = OrderedDict()

    def count(self, address: str, now_s: float) -> float:
        """Count one, and say how long the address has to wait [s]: 0 while it need not.

        Parameters
        ----------
        now_s
            Of a clock that only goes forward [s].
        """
        began_s, number = self._found.get(address, (now_s, 0))
        if now_s - began_s >= WITHIN_S:
            began_s, number = now_s, 0
        self._found[address] = (began_s, number + 1)
        self._found.move_to_end(address)
        if len(self._found) > _ADDRESSES:
            self._found.popitem(last=False)
        return began_s + WITHIN_S - now_s if number >= self._at_most else 0.0
