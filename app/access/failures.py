"""How often an address may come with a wrong key."""

from __future__ import annotations

from collections import OrderedDict, deque
from ipaddress import IPv6Address, ip_address
from typing import Final

AT_MOST: Final = 10
"""Wrong keys from one address within `WITHIN_S`."""

WITHIN_S: Final = 60.0

MOST_ADDRESSES: Final = 10_000
"""Addresses that are remembered: who comes from very many cannot fill the memory."""

_NETWORK_BITS: Final = 64
"""Of an IPv6 address: whoever has one has all that begin like it."""


class Failures:
    """Wrong keys, by the address that they came from.

    They are no protection against guessing, which 256 bits by chance do not need: a right key is
    always taken, so that who sends wrong ones from behind the same proxy locks nobody out. They
    keep a program that states an old key from asking without a pause.
    """

    def __init__(self) -> None:
        self._times_s: OrderedDict[str, deque[float]] = OrderedDict()

    def count(self, address: str, now_s: float) -> float:
        """Count one, and say how long the address has to wait [s]: 0 while it need not.

        Parameters
        ----------
        now_s
            Of a clock that only goes forward [s].
        """
        source = source_of(address)
        times_s = self._times_s.setdefault(source, deque(maxlen=AT_MOST))
        self._times_s.move_to_end(source)
        if len(self._times_s) > MOST_ADDRESSES:
            self._times_s.popitem(last=False)
        if len(times_s) == AT_MOST and now_s - times_s[0] < WITHIN_S:
            return times_s[0] + WITHIN_S - now_s
        times_s.append(now_s)
        return 0.0


def source_of(address: str) -> str:
    """Give what is counted as one address: of IPv6 the network that one subscriber has.

    >>> source_of("2001:db8:1:2:3:4:5:6"), source_of("192.0.2.7"), source_of("")
    ('2001:db8:1:2::', '192.0.2.7', '')
    """
    try:
        ip = ip_address(address)
    except ValueError:
        return address
    if not isinstance(ip, IPv6Address):
        return address
    if ip.ipv4_mapped is not None:
        return str(ip.ipv4_mapped)
    host_bits = ip.max_prefixlen - _NETWORK_BITS
    return str(IPv6Address(int(ip) >> host_bits << host_bits))
