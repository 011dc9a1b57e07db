"""A simulated three-axis machine on the installed LinuxCNC, without a screen.

Ordinary threads, motors that follow at once, homing on the spot. One controller at a time runs on
a computer, as a second one would end the first: who comes later waits, in whatever process.
"""

from __future__ import annotations

import fcntl
import json
import os
import shutil
import signal
import socket
import subprocess
import tempfile
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, TextIO, TypeAlias

LINUXCNC: Final = shutil.which("linuxcnc")
INSTALL: Final = "apt-get install --no-install-recommends linuxcnc-uspace"

PATIENCE_S: Final = 180.0
"""How long a start is waited for: a busy computer is slow.

Answers have no limit here, since a program that is run again takes minutes. The drive gives up
where nothing moves any more (`drive.run_once`), and its end is the end of the answer.
"""

END_S: Final = 60.0
"""How long it may take to end."""

ONE_AT_A_TIME: Final = Path(tempfile.gettempdir()) / "thermap-tests-linuxcnc.lock"

DRIVE: Final = Path(__file__).with_name("drive.py")

Point: TypeAlias = Sequence[float]

UNITS: Final = {"mm": 1.0, "inch": 25.4}
"""LINEAR_UNITS to mm."""

MACHINE_INI: Final = """[EMC]
VERSION = 1.1
MACHINE = thermap
[DISPLAY]
DISPLAY = ./drive.py
[TASK]
TASK = milltask
CYCLE_TIME = 0.01
[EMCMOT]
EMCMOT = motmod
COMM_TIMEOUT = 4.0
SERVO_PERIOD = 1000000
[EMCIO]
EMCIO = io
CYCLE_TIME = 0.1
TOOL_TABLE = tool.tbl
[RS274NGC]
PARAMETER_FILE = parameters.var
[HAL]
HALFILE = machine.hal
[KINS]
KINEMATICS = trivkins coordinates=XYZ
JOINTS = 3
[TRAJ]
COORDINATES = XYZ
LINEAR_UNITS = {units}
ANGULAR_UNITS = degree
DEFAULT_LINEAR_VELOCITY = {half_velocity}
MAX_LINEAR_VELOCITY = {velocity}
"""

# A joint accelerates so gently that every step of the correction is applied.
LIMITS: Final = """MIN_LIMIT = -{limit}
MAX_LIMIT = {limit}
MAX_VELOCITY = {velocity}
MAX_ACCELERATION = {acceleration}
"""

JOINT: Final = """TYPE = LINEAR
HOME = 0
HOME_OFFSET = 0
HOME_SEARCH_VEL = 0
HOME_LATCH_VEL = 0
HOME_SEQUENCE = 0
FERROR = 10
MIN_FERROR = 10
"""

MOTION: Final = """loadrt trivkins coordinates=XYZ
loadrt motmod servo_period_nsec=1000000 num_joints=3
addf motion-command-handler servo-thread
addf motion-controller servo-thread
net enable iocontrol.0.user-enable-out => iocontrol.0.emc-enable-in
net prepare iocontrol.0.tool-prepare => iocontrol.0.tool-prepared
net change iocontrol.0.tool-change => iocontrol.0.tool-changed
"""

MOTORS: Final = "".join(
    f"net {axis}-nominal joint.{joint}.pos-cmd\n"
    f"net {axis}-motor joint.{joint}.motor-pos-cmd => joint.{joint}.motor-pos-fb\n"
    for joint, axis in enumerate("xyz")
)

COMPENSATED_MOTORS: Final = "".join(
    f"net {axis}-motor thermap-{axis}.out => thermap-{axis}.fb-in\n" for axis in "xyz"
)

KEPT: Final = 60_000
"""Cycles that the sampler keeps for a reader that is late."""


class NotRunning(RuntimeError):
    """LinuxCNC is not installed, did not start, or ended."""


@dataclass(frozen=True, slots=True)
class Rest:
    """Where the motors stood while the axes stood still [mm], and whence they had come (1, -1)."""

    motors_mm: Point
    ways: Sequence[int]


@dataclass(frozen=True, slots=True)
class Ran:
    """How a program went.

    Parameters
    ----------
    ended, stops
        Where the motors stood at its end, and the axes at each of its stops [mm].
    rests
        Each rest, in order: at the stops and while it dwelt.
    low, high
        How far the axes went [mm].
    said
        The controller's messages.
    """

    ended: Point
    stops: Sequence[Point]
    rests: Sequence[Rest]
    low: Point
    high: Point
    said: Sequence[str]


class Controller:
    """A running controller: programs and moves made, pins set, values read."""

    def __init__(self, lines: TextIO, said: Path) -> None:
        self._lines, self._said = lines, said

    def ask(self, **what: Any) -> dict[str, Any]:
        """Let the drive do something (`drive.answer`).

        With the live compensation the answer has for each axis how far its offset has `moved`,
        back and forth [µm], the largest of its `steps` from one cycle of the controller to the
        next [µm], and the highest of its `speeds` over 400 such cycles of 1 ms [µm/s].

        Raises
        ------
        NotRunning
            If there is no answer, with what the controller said.
        """
        try:
            self._lines.write(json.dumps(what) + "\n")
            self._lines.flush()
            line = self._lines.readline()
        except OSError:
            line = ""
        if not line:
            raise NotRunning(f"no answer to {', '.join(what)}: {_end_of(self._said)}")
        answer: dict[str, Any] = json.loads(line)
        return answer

    def get(self, *names: str) -> list[Any]:
        """Read pins and parameters."""
        found: list[Any] = self.ask(get=names)["values"]
        return found

    def set(self, values: Mapping[str, float]) -> None:
        """Set pins and parameters."""
        self.ask(set=values)

    def move(self, words: str) -> list[tuple[float, float]]:
        """Make one move; give each joint's commanded position and its motor's [machine units]."""
        return [(commanded, motor) for commanded, motor in self.ask(mdi=words)["settled"]]

    def run(self, program: str) -> Ran:
        """Run an NC program; an operator presses start at its stops."""
        ran = self.ask(program=program)["ran"]
        rests = [Rest(motors, ways) for motors, ways in ran.pop("rests")]
        return Ran(rests=rests, **ran)

    def wait_for(self, within_s: float, **pins: Any) -> None:
        """Wait until pins of the component have these values; `_` stands for `-`.

        Raises
        ------
        NotRunning
            If they do not come to.
        """
        names = [f"thermap.{name.replace('_', '-')}" for name in pins]
        until = time.monotonic() + within_s
        while (found := self.get(*names)) != list(pins.values()):
            if time.monotonic() > until:
                raise NotRunning(f"expected {pins} within {within_s:g} s, got {found}")
            time.sleep(0.02)


def expect_installed() -> None:
    """Say what is missing where LinuxCNC is not installed.

    Raises
    ------
    NotRunning
        With the command that installs it.
    """
    if LINUXCNC is None:
        raise NotRunning(
            f"LinuxCNC is not installed: expected the command linuxcnc, got none (Debian 12: "
            f"{INSTALL})"
        )


@contextmanager
def running(
    files: Mapping[str, str] | None = None,
    wiring: str = "",
    units: str = "mm",
) -> Iterator[Controller]:
    """Start LinuxCNC, and end it again.

    Parameters
    ----------
    files
        Name to content of exported compensation files; the lines of `thermap.ini` go into the
        sections of the joints.
    wiring
        The HAL file of the live compensation; without it the motors follow the commands.
    units
        LINEAR_UNITS of the machine: mm or inch.

    Raises
    ------
    NotRunning
        If it is not installed or does not start, with what it said.
    """
    expect_installed()
    exported = files or {}
    tables = {name: text for name, text in exported.items() if name.endswith(".comp")}
    hal = MOTION + (wiring + COMPENSATED_MOTORS if wiring else MOTORS) + _sampler(bool(wiring))
    ini = _ini(_sections(exported.get("thermap.ini", "")), units, bool(wiring))
    with tempfile.TemporaryDirectory(prefix="linuxcnc-") as name:
        folder = Path(name)
        folder.chmod(0o777)
        _furnish(folder, tables | {"machine.ini": ini, "machine.hal": hal})
        with ONE_AT_A_TIME.open("w") as one:
            fcntl.flock(one, fcntl.LOCK_EX)
            with _started(folder) as process, socket.socket(socket.AF_UNIX) as peer:
                _wait_until_ready(folder, process)
                peer.connect(str(folder / "asked"))
                with peer.makefile("rw") as lines:
                    yield Controller(lines, folder / "said.txt")
                peer.shutdown(socket.SHUT_RDWR)


def run_program(text: str, files: Mapping[str, str] | None = None) -> Ran:
    """Start LinuxCNC, with compensation files or without, run an NC program, and end it."""
    with running(files) as controller:
        return controller.run(text)


def run_moves(
    files: Mapping[str, str], moves: Iterable[tuple[str, float]]
) -> list[tuple[str, float, float]]:
    """Start LinuxCNC with compensation files, move at rapid, and end it.

    Parameters
    ----------
    moves
        Axis and position [mm], in order.

    Returns
    -------
    list of tuple
        Axis, commanded position and the motor's position [mm] after each.
    """
    found = []
    with running(files) as controller:
        for axis, position in moves:
            stood = controller.move(f"G53 G0 {axis.upper()}{position:.6f}")
            found.append((axis, *stood["xyz".index(axis)]))
    return found


def _sampler(compensated: bool) -> str:
    """Write down each cycle in the controller's own thread, as `drive.Recorder` reads it."""
    stem = "thermap-" if compensated else ""
    signals = [f"{stem}{axis}-nominal" for axis in "xyz"] + [f"{axis}-motor" for axis in "xyz"]
    signals += ["line", *(f"thermap-{axis}-offset" for axis in "xyz" if compensated)]
    kinds = "".join("s" if signal == "line" else "f" for signal in signals)
    joined = (f"net {name} => sampler.0.pin.{pin}\n" for pin, name in enumerate(signals))
    return (
        f"loadrt sampler depth={KEPT} cfg={kinds}\n"
        "net line motion.program-line\n"
        f"{''.join(joined)}"
        "addf sampler.0 servo-thread\n"
    )


def _ini(settings: Mapping[str, str], units: str, compensated: bool) -> str:
    per_unit = UNITS[units]
    limits = LIMITS.format(
        limit=1000 / per_unit, velocity=400 / per_unit, acceleration=1000 / per_unit
    )
    content = MACHINE_INI.format(
        units=units,
        velocity=400 / per_unit,
        half_velocity=200 / per_unit,
    )
    if compensated:
        content += "[THERMAP]\nLIVE = 1\n"
    for number, axis in enumerate("XYZ"):
        content += f"[AXIS_{axis}]\n{limits}"
        content += f"[JOINT_{number}]\n{JOINT}{limits}{settings.get(f'JOINT_{number}', '')}"
    return content


def _sections(ini: str) -> dict[str, str]:
    found: dict[str, str] = {}
    name = ""
    for line in ini.splitlines():
        if line.startswith("["):
            name = line.strip("[]")
        elif line and not line.startswith("#"):
            found[name] = found.get(name, "") + line + "\n"
    return found


def _furnish(folder: Path, files: Mapping[str, str]) -> None:
    """Write what LinuxCNC needs; for all, because it may run as somebody else."""
    own = {"drive.py": DRIVE.read_text(), "tool.tbl": "", "parameters.var": ""}
    for name, text in {**own, **files}.items():
        path = folder / name
        path.write_text(text)
        path.chmod(0o777)


@contextmanager
def _started(folder: Path) -> Iterator[subprocess.Popen[bytes]]:
    """Run LinuxCNC until its drive ends, as it does when nobody asks any more."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "VIRTUAL"))}
    environment |= {"HOME": str(folder), "RTAPI_FIFO_PATH": str(folder / "fifo")}
    environment |= {"RTAPI_UID": "65534"} if os.getuid() == 0 else {}
    environment["PATH"] = "/usr/bin:/bin:/usr/sbin:/sbin"
    with (folder / "said.txt").open("w") as said:
        process = subprocess.Popen(
            [str(LINUXCNC), "-r", "machine.ini"],
            cwd=folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=said,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
    try:
        yield process
    finally:
        _end(process)


def _end(process: subprocess.Popen[bytes]) -> None:
    """Let it end in order: what is killed leaves its real-time part, which the next one meets."""
    for told in (None, signal.SIGTERM, signal.SIGKILL):
        if told is not None:
            os.killpg(process.pid, told)
        try:
            process.wait(END_S)
        except subprocess.TimeoutExpired:
            continue
        return


def _wait_until_ready(folder: Path, process: subprocess.Popen[bytes]) -> None:
    until = time.monotonic() + PATIENCE_S
    while not (folder / "ready").exists():
        if process.poll() is not None or time.monotonic() > until:
            raise NotRunning(f"LinuxCNC did not start: {_end_of(folder / 'said.txt')}")
        time.sleep(0.05)


def _end_of(said: Path) -> str:
    return said.read_text(errors="replace")[-4000:]
