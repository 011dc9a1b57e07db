"""A load for HTTP servers on this machine: a fixed number of requests over some connections.

Answers are counted by their content-length; nothing is parsed, so that the load is
lighter than the server. Prints requests per second.
"""

from __future__ import annotations

import argparse
import asyncio
import statistics
import time
from collections.abc import Iterator, Sequence
from itertools import cycle
from pathlib import Path

SUCCEEDED = (b"HTTP/1.1 200", b"HTTP/1.1 201")


class Connection(asyncio.Protocol):
    """One keep-alive connection that asks again as soon as it has its answer."""

    def __init__(self, load: Load) -> None:
        self.load = load
        self.buffer = b""
        self.missing = 0

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.transport = transport
        self.ask()

    def ask(self) -> None:
        self.asked_at = time.perf_counter()
        self.transport.write(self.load.next_request())

    def data_received(self, data: bytes) -> None:
        if self.missing:
            self.missing -= len(data)
        else:
            self.buffer += data
            head, end, body = self.buffer.partition(b"\r\n\r\n")
            if not end:
                return
            if not head.startswith(SUCCEEDED):
                self.load.fail(head)
                return
            length = int(head.lower().split(b"content-length:")[1].split(b"\r\n")[0])
            self.missing = length - len(body)
            self.buffer = b""
        if self.missing <= 0:
            self.missing = 0
            if self.load.answered(time.perf_counter() - self.asked_at):
                self.ask()
            else:
                self.transport.close()


class Load:
    """Counts answers until there are enough."""

    def __init__(self, requests: Iterator[bytes], wanted: int) -> None:
        self.next_request = requests.__next__
        self.wanted = wanted
        self.seconds: list[float] = []
        self.done = asyncio.get_running_loop().create_future()

    def answered(self, seconds: float) -> bool:
        self.seconds.append(seconds)
        if len(self.seconds) >= self.wanted and not self.done.done():
            self.done.set_result(None)
        return len(self.seconds) < self.wanted

    def fail(self, head: bytes) -> None:
        if not self.done.done():
            self.done.set_exception(RuntimeError(head.decode(errors="replace")))


def request_of(host: str, port: int, path: str, body: bytes) -> bytes:
    """Write a request as it goes over the wire."""
    return (
        f"POST {path} HTTP/1.1\r\nHost: {host}:{port}\r\n"
        f"Content-Type: application/json\r\nContent-Length: {len(body)}\r\n\r\n"
    ).encode() + body


async def run_load(
    host: str,
    port: int,
    path: str,
    bodies: Sequence[bytes] | Iterator[bytes],
    wanted: int,
    connections: int,
) -> tuple[float, float, float]:
    """Return requests/s and the median and 99th percentile of the answer's time [s].

    Bodies that come one after another are sent once each, of a list each again and again.
    """
    if isinstance(bodies, Iterator):
        requests = (request_of(host, port, path, body) for body in bodies)
    else:
        requests = cycle([request_of(host, port, path, body) for body in bodies])
    loop = asyncio.get_running_loop()
    load = Load(requests, wanted)
    started = time.perf_counter()
    for _ in range(connections):
        await loop.create_connection(lambda: Connection(load), host, port)
    await load.done
    elapsed = time.perf_counter() - started
    return (
        wanted / elapsed,
        statistics.median(load.seconds),
        statistics.quantiles(load.seconds, n=100)[98],
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--host", default="127.0.0.1")
    parser.add_argument("--port", type=int, required=True)
    parser.add_argument("--path", required=True)
    parser.add_argument("--bodies", type=Path, required=True, help="a file, one body a line")
    parser.add_argument("--requests", type=int, default=20_000)
    parser.add_argument("--connections", type=int, default=16)
    asked = parser.parse_args()
    try:
        import uvloop as loops
    except ImportError:
        loops = asyncio
    rate, median_s, p99_s = loops.run(
        run_load(
            asked.host,
            asked.port,
            asked.path,
            asked.bodies.read_bytes().splitlines(),
            asked.requests,
            asked.connections,
        )
    )
    print(f"{rate:.1f} {median_s:.6f} {p99_s:.6f}")


if __name__ == "__main__":
    main()
