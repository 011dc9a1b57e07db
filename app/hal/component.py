"""The userspace component: temperatures from HAL's pins to the service, its table to the curves.

The servo thread evaluates the curves at the commanded position; this program only moves their
points, a little at each tick. What it moved stays where it is when it ends, and is where it goes
on from when it starts again.
"""

from __future__ import annotations

import argparse
import base64
import json
import math
import os
import re
import signal
import sys
import time
from collections.abc import Iterable, Sequence
from datetime import datetime, timezone
from importlib import import_module
from threading import Event, Lock, Thread
from typing import Any
from urllib.error import HTTPError
from urllib.parse import quote, urlsplit, urlunsplit
from urllib.request import HTTPRedirectHandler, ProxyHandler, Request, build_opener

from app.hal.curves import (
    AXES,
    Curves,
    Following,
    Nodes,
    NotFollowed,
    Table,
    curves_between,
    table_of,
)
from app.hal.wiring import CLOCK, COMPONENT, curve_name, sensor_pin

UM_PER_MM = 1000.0
MM_PER_INCH = 25.4

KEY_VARIABLE = "THERMAP_KEY"
"""The variable of the environment that has the key, where the service asks for one."""

HTTP_NOT_MODIFIED = 304
TIMEOUT_S = 5.0

LATE_S = 0.5
"""How long a tick waits for the controller's thread; the heartbeat goes on when it stands still."""

LARGEST_ANSWER = 8 * 1024 * 1024
"""That the service may give [bytes]."""

_NUMBER = re.compile(r"\b\d+(?:[.,]\d+)*\b")
"""A number in a sentence, such as an age that grows; not the digits of a name."""


class Service:
    """The service, as far as the component needs it.

    The client of the package needs libraries that LinuxCNC's Python does not have.
    """

    def __init__(self, url: str, machine: str, timeout_s: float) -> None:
        parts = urlsplit(url.rstrip("/"))
        if parts.scheme not in ("http", "https") or not parts.hostname:
            raise ValueError(f"expected a URL such as http://127.0.0.1:8000, got {url!r}")
        self._headers = {"Content-Type": "application/json"}
        if parts.username is not None:
            credentials = f"{parts.username}:{parts.password or ''}".encode()
            self._headers["Authorization"] = f"Basic {base64.b64encode(credentials).decode()}"
        if key := os.environ.get(KEY_VARIABLE):
            self._headers["Authorization"] = f"Bearer {key}"
        place = parts.netloc.rpartition("@")[2]
        self._room = urlunsplit(
            parts._replace(netloc=place, path=f"{parts.path}/v1/machines/{quote(machine)}")
        )
        self._timeout_s = timeout_s
        self._tag: str | None = None
        # A proxy for the world outside is no way to a service in the shop, and what the service
        # redirects to is not who the key is for.
        self._opener = build_opener(ProxyHandler({}), _NoRedirects())

    def store_reading(self, temperatures_c: dict[str, float], state: dict[str, float]) -> None:
        """Send what the sensors say now."""
        now = datetime.now(timezone.utc).isoformat().replace("+00:00", "Z")
        reading = {"time": now, "temperatures_c": temperatures_c, "state": state}
        self._send("readings", json.dumps(reading).encode())

    def table(self) -> dict[str, Any] | None:
        """Ask for the table at the latest reading; None where it is the one before."""
        answer = self._send("compensation", None)
        return None if answer is None else json.loads(answer)

    def forget(self) -> None:
        """Ask for the whole table again, because the last one was not taken."""
        self._tag = None

    def _send(self, what: str, body: bytes | None) -> bytes | None:
        headers = dict(self._headers)
        if body is None and self._tag:
            headers["If-None-Match"] = self._tag
        request = Request(f"{self._room}/{what}", body, headers)
        try:
            with self._opener.open(request, timeout=self._timeout_s) as answer:
                if body is None:
                    self._tag = answer.headers.get("ETag")
                content: bytes = answer.read(LARGEST_ANSWER + 1)
                if len(content) > LARGEST_ANSWER:
                    raise ValueError(f"expected an answer of at most {LARGEST_ANSWER >> 20} MB")
                return content
        except HTTPError as error:
            with error:
                if error.code == HTTP_NOT_MODIFIED:
                    return None
                raise ValueError(_sentence_of(error)) from None


class _NoRedirects(HTTPRedirectHandler):
    """Takes a redirection for the failure that it is here."""

    def redirect_request(self, *_refused: Any) -> None:
        """Ask nobody else."""


def _sentence_of(error: HTTPError) -> str:
    """Give the sentence of a refusal."""
    if 300 <= error.code < 400:
        return f"the service answered with {error.code}: what it redirects to is not asked"
    try:
        answer = json.loads(error.read(LARGEST_ANSWER))
        return "; ".join(
            [problem["message"] for problem in answer.get("errors", [])] or [answer["detail"]]
        )
    except (ValueError, KeyError, TypeError, AttributeError):
        return f"the service answered with {error.code}"


class Exchange(Thread):
    """Readings to the service and tables from it, beside the ticks: no answer holds them up."""

    def __init__(self, service: Service, nodes: Nodes, every_s: float, limit_um: float) -> None:
        super().__init__(name="exchange", daemon=True)
        self._service, self._nodes, self._every_s = service, nodes, every_s
        self._limit_um = limit_um
        self._lock, self._first = Lock(), Event()
        self._temperatures_c: dict[str, float] = {}
        self._state: dict[str, float] = {}
        self._answers: list[tuple[Table | None, float]] = []
        self._said = ""
        self._not_held: tuple[str, ...] = ()
        self.connected = False

    def tell(self, temperatures_c: dict[str, float], state: dict[str, float]) -> None:
        """Say what the pins have now."""
        with self._lock:
            self._temperatures_c, self._state = temperatures_c, state
        self._first.set()

    def answers(self) -> list[tuple[Table | None, float]]:
        """Take the answers that have come, each with its time."""
        with self._lock:
            taken, self._answers = self._answers, []
        return taken

    def run(self) -> None:
        """Exchange again and again; a failure is said once, and tried again."""
        self._first.wait()
        while True:
            began = time.monotonic()
            try:
                self._exchange()
                self.connected = True
                self._say("connected")
            except Exception as error:  # without this thread the table would stand still, unsaid
                self.connected = False
                self._service.forget()
                self._say(f"not connected, the last compensation is held: {_words_of(error)}")
            time.sleep(max(0.0, began + self._every_s - time.monotonic()))

    def _exchange(self) -> None:
        with self._lock:
            temperatures_c, state = self._temperatures_c, self._state
        if temperatures_c:
            self._service.store_reading(temperatures_c, state)
        answer = self._service.table()
        table = None if answer is None else table_of(answer, self._nodes, self._limit_um)
        if table is not None and table.not_held != self._not_held:
            self._not_held = table.not_held
            _print(f"not in HAL's curves: {', '.join(table.not_held) or 'nothing'}")
        with self._lock:
            self._answers.append((table, time.monotonic()))

    def _say(self, sentence: str) -> None:
        """Print a sentence, unless it is the last one again, be it with other numbers."""
        if _NUMBER.sub("", sentence) != _NUMBER.sub("", self._said):
            _print(sentence)
        self._said = sentence


def _words_of(error: Exception) -> str:
    if isinstance(error, (OSError, ValueError, NotFollowed)) and str(error):
        return str(error)
    return f"the answer is no compensation table ({error!r:.200})"


def _print(sentence: str) -> None:
    # What the service says may say what others wrote.
    printable = "".join(
        character if character.isprintable() else repr(character)[1:-1]
        for character in sentence[:1000]
    )
    print(f"thermap: {printable}", file=sys.stderr, flush=True)


class Pins:
    """The component in HAL: its own pins, and the points of the curves."""

    def __init__(self, hal: Any, sensors: Sequence[str], units_per_mm: float) -> None:
        self._hal, self._units_per_um = hal, units_per_mm / UM_PER_MM
        self._units_per_mm = units_per_mm
        self._written: dict[str, float] = {}
        self._sensors = {sensor: sensor_pin(sensor) for sensor in sensors}
        self._own = hal.component(COMPONENT)
        # A sensor that nothing is joined to says nothing; 0 °C would be a reading.
        for pin in [*self._sensors.values(), "spindle-rpm"]:
            self._own.newpin(pin, hal.HAL_FLOAT, hal.HAL_IN)
            self._own[pin] = math.nan
        self._own.newpin("enable", hal.HAL_BIT, hal.HAL_IN)
        self._own["enable"] = True
        for pin in ("connected", "stale", "complete", "active", "settled"):
            self._own.newpin(pin, hal.HAL_BIT, hal.HAL_OUT)
        for pin in ("to-go-um", "deviation-um"):
            self._own.newpin(pin, hal.HAL_FLOAT, hal.HAL_OUT)
        self._own.newpin("heartbeat", hal.HAL_U32, hal.HAL_OUT)
        self._own["stale"] = True

    def ready(self) -> None:
        """Let HAL go on."""
        self._own.ready()

    def nodes(self) -> Nodes:
        """Read the positions of the curves' points [mm], of the axes that have curves."""
        nodes = {}
        for axis in AXES:
            points = self._points(_positions_of(axis))
            if points:
                nodes[axis] = tuple(value / self._units_per_mm for value in points)
        if not nodes:
            raise _not_wired(f"{_positions_of(AXES[0])}00")
        return nodes

    def clock_s(self) -> float:
        """Read how long the controller's thread has run [s]."""
        name = f"{CLOCK}.out"
        try:
            return float(self._hal.get_value(name))
        except RuntimeError:
            raise _not_wired(name) from None

    def held(self, axes: Iterable[str]) -> Curves:
        """Read what the curves of these axes hold [µm]: 0 at the start, else another run's."""
        curves = {}
        for code in curves_between(axes):
            stem = f"{curve_name(code)}.y-val-"
            curves[code] = tuple(v / self._units_per_um for v in self._points(stem))
            if not curves[code]:
                raise _not_wired(f"{stem}00")
        return curves

    def write(self, curves: Curves) -> None:
        """Move the curves' points, those that are elsewhere."""
        for code, values in curves.items():
            for number, value in enumerate(values):
                name = f"{curve_name(code)}.y-val-{number:02d}"
                if self._written.get(name) != value:
                    self._hal.set_p(name, repr(value * self._units_per_um))
                    self._written[name] = value

    def temperatures_c(self) -> dict[str, float]:
        """Read the sensors that say something [°C]."""
        values = {sensor: float(self._own[pin]) for sensor, pin in self._sensors.items()}
        return {sensor: t for sensor, t in values.items() if math.isfinite(t)}

    def state(self) -> dict[str, float]:
        """Read what else the machine says of itself."""
        rpm = float(self._own["spindle-rpm"])
        return {"spindle_rpm": abs(rpm)} if math.isfinite(rpm) else {}

    def is_active(self, joints: Sequence[int]) -> bool:
        """Say whether the compensation may act: switched on, and the machine homed.

        An offset that acts while a joint is homed would become part of its zero.
        """
        homed = all(self._hal.get_value(f"joint.{joint}.homed") for joint in joints)
        return bool(self._own["enable"]) and homed

    def show(self, **pins: float) -> None:
        """Set pins of ours, named with `_` for `-`."""
        for name, value in pins.items():
            self._own[name.replace("_", "-")] = value

    def _points(self, stem: str) -> list[float]:
        names = {info_param["NAME"] for info_param in self._hal.get_info_params()}
        wanted = [f"{stem}{number:02d}" for number in range(len(names))]
        return [float(self._hal.get_value(name)) for name in wanted if name in names]


def _positions_of(axis: str) -> str:
    return f"{curve_name(f'E{axis}{axis}')}.x-val-"


def _not_wired(name: str) -> SystemExit:
    return SystemExit(
        f"thermap: expected the HAL file that this version's `thermap hal wiring` writes, got no "
        f"{name}: write it anew"
    )


def follow(hal: Any, options: argparse.Namespace) -> None:
    """Run the component until it is told to end."""
    units_per_mm = 1.0 if options.units == "mm" else 1.0 / MM_PER_INCH
    pins = Pins(hal, options.sensor, units_per_mm)
    nodes = pins.nodes()
    if len(nodes) > len(options.joint):
        raise SystemExit(
            f"thermap: expected a joint or more for each of the axes that HAL has curves for "
            f"({', '.join(nodes).upper()}), got {len(options.joint)} joints"
        )
    most_um = options.rate_um_per_s * options.period_s
    # From what the curves hold, which after a restart is what the run before left: zero would be a
    # step.
    following = Following(nodes, pins.held(nodes), most_um, 3.0 * options.every_s)
    service = Service(options.url, options.machine, TIMEOUT_S)
    exchange = Exchange(service, nodes, options.every_s, options.limit_um)
    due_s = pins.clock_s()
    pins.ready()
    exchange.start()
    beats = 0
    try:
        while True:
            exchange.tell(pins.temperatures_c(), pins.state())
            for table, at in exchange.answers():
                following.answered(table, at)
            active = pins.is_active(options.joint)
            # A step by both clocks: by the thread's the last one has been taken, by ours (the sleep
            # below) a period has gone by. The heartbeat beats at every tick, whatever the thread
            # does.
            if pins.clock_s() >= due_s:
                pins.write(following.step(active))
                due_s = pins.clock_s() + options.period_s
            written = time.monotonic()
            beats = (beats + 1) % 2**32
            _show(pins, following, active, connected=exchange.connected, beats=beats)
            time.sleep(max(0.0, written + options.period_s - time.monotonic()))
            _wait_for_thread(pins, due_s, options.period_s)
    finally:
        pins.show(connected=False, stale=True)


def _wait_for_thread(pins: Pins, due_s: float, period_s: float) -> None:
    """Wait until the controller's thread has taken the last step, and gone on by a period.

    A step is a period after the last one by both clocks, and no late one is made up for: where the
    thread runs late, steps that it has not taken yet would otherwise come to the motors as one.
    """
    until = time.monotonic() + LATE_S
    while pins.clock_s() < due_s and time.monotonic() < until:
        time.sleep(period_s / 20.0)


def _show(pins: Pins, following: Following, active: bool, *, connected: bool, beats: int) -> None:
    table = following.table
    to_go = following.to_go_um(active)
    pins.show(
        connected=connected,
        stale=following.is_stale(time.monotonic()),
        complete=table is not None and table.complete,
        active=active,
        settled=to_go == 0.0,
        to_go_um=to_go,
        deviation_um=table.deviation_um if table else 0.0,
        heartbeat=beats,
    )


def parser() -> argparse.ArgumentParser:
    """Make the reader of the component's own command line."""
    argument_parser = argparse.ArgumentParser(prog="thermap hal follow", allow_abbrev=False)
    argument_parser.add_argument("machine")
    argument_parser.add_argument("--url", required=True)
    argument_parser.add_argument("--sensor", action="append", default=[])
    argument_parser.add_argument("--joint", action="append", type=int, default=[])
    argument_parser.add_argument("--units", choices=["mm", "inch"], default="mm")
    for name in ("every-s", "period-s", "rate-um-per-s", "limit-um"):
        argument_parser.add_argument(f"--{name}", type=float, required=True)
    return argument_parser


def main(arguments: Sequence[str]) -> None:
    """Run the component in LinuxCNC's Python."""
    options = parser().parse_args(arguments)
    try:
        # The module is LinuxCNC's own; nobody else's Python has it.
        hal = import_module("hal")
    except ImportError:
        raise SystemExit(
            f"thermap: {sys.executable} has no module hal: expected LinuxCNC's own Python, which "
            "`--python` states"
        ) from None
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    try:
        follow(hal, options)
    except KeyboardInterrupt:  # HAL unloads a component so
        sys.exit(0)
