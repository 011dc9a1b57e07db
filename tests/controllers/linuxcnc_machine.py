"""A simulated three-axis machine on the installed LinuxCNC, without a screen.

Ordinary threads, motors that follow at once, homing on the spot. One controller at a time runs on
a computer, as a second one would end the first: who comes later waits, in whatever process.
"""

import fcntl
import json
import os
import shutil
import signal
import socket
import subprocess
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

LINUXCNC = shutil.which("linuxcnc")
SYSTEM_PYTHON = "/usr/bin/python3"
"""LinuxCNC's modules belong to the system's Python."""

LIMIT_S = 90

ONE_AT_A_TIME = Path(tempfile.gettempdir()) / "thermap-tests-linuxcnc.lock"

MACHINE_INI = """[EMC]
VERSION = 1.1
MACHINE = thermap-test
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
LINEAR_UNITS = mm
ANGULAR_UNITS = degree
DEFAULT_LINEAR_VELOCITY = 200
MAX_LINEAR_VELOCITY = 400
"""

MACHINE_HAL = """loadrt trivkins coordinates=XYZ
loadrt motmod servo_period_nsec=1000000 num_joints=3
addf motion-command-handler servo-thread
addf motion-controller servo-thread
net x joint.0.motor-pos-cmd => joint.0.motor-pos-fb
net y joint.1.motor-pos-cmd => joint.1.motor-pos-fb
net z joint.2.motor-pos-cmd => joint.2.motor-pos-fb
net enable iocontrol.0.user-enable-out => iocontrol.0.emc-enable-in
net prepare iocontrol.0.tool-prepare => iocontrol.0.tool-prepared
net change iocontrol.0.tool-change => iocontrol.0.tool-changed
"""

# A joint accelerates so gently that every step of the correction is applied.
JOINT = """TYPE = LINEAR
HOME = 0
HOME_OFFSET = 0
HOME_SEARCH_VEL = 0
HOME_LATCH_VEL = 0
HOME_SEQUENCE = 0
MIN_LIMIT = -1000
MAX_LIMIT = 1000
MAX_VELOCITY = 400
MAX_ACCELERATION = 1000
FERROR = 10
MIN_FERROR = 10
"""

DRIVE = """#!/usr/bin/python3
import faulthandler, json, sys, time
import linuxcnc, hal

faulthandler.enable()

def wait(what, until):
    for _ in range(2000):
        stat.poll()
        if until():
            return
        time.sleep(0.01)
    sys.exit("never came: " + what)

def settled(joint):
    last, same = None, 0
    while same < 10:
        now = (hal.get_value("joint.%d.motor-pos-cmd" % joint),
               hal.get_value("joint.%d.pos-cmd" % joint))
        same = same + 1 if now == last else 0
        last = now
        time.sleep(0.01)
    return now

stat, command, found = linuxcnc.stat(), linuxcnc.command(), []
kept = hal.component("drive-test")  # it lives as long as it is named
kept.ready()
command.state(linuxcnc.STATE_ESTOP_RESET)
command.wait_complete()
command.state(linuxcnc.STATE_ON)
wait("power", lambda: stat.task_state == linuxcnc.STATE_ON)
command.mode(linuxcnc.MODE_MANUAL)
command.wait_complete()
command.home(-1)
wait("home", lambda: all(stat.homed[:3]))
"""

MAKE_MOVES = """command.mode(linuxcnc.MODE_MDI)
command.wait_complete()
for axis, position in json.load(open("moves.json")):
    command.mdi("G53 G0 %s%.6f" % (axis.upper(), position))
    if command.wait_complete(30) != linuxcnc.RCS_DONE:
        sys.exit("the move to %s%g failed" % (axis, position))
    motor, commanded = settled("xyz".index(axis))
    found.append([axis, commanded, motor])
json.dump(found, open("found.json", "w"))
"""

# The operator presses start at every stop; where the axes were is looked at all the time.
# A work offset is active, as on a machine that was used before. The motors are looked at as well,
# for an instrument that triggers itself at rest.
RUN_PROGRAM = """AT_REST_S = 0.06
errors = linuxcnc.error_channel()
command.mode(linuxcnc.MODE_MDI)
command.wait_complete()
command.mdi("G10 L2 P1 X7 Y8 Z9")
command.wait_complete()
command.mode(linuxcnc.MODE_AUTO)
command.wait_complete()
command.program_open("program.ngc")
command.auto(linuxcnc.AUTO_RUN, 0)
wait("start", lambda: stat.interp_state != linuxcnc.INTERP_IDLE)
stops, said, low, high = [], [], [1e9] * 3, [-1e9] * 3
rests, last, since, ways = [], [0.0] * 3, 0.0, [1] * 3

def look():
    global last, since
    motors = [hal.get_value("joint.%d.motor-pos-cmd" % joint) for joint in range(3)]
    for joint, (now, before) in enumerate(zip(motors, last)):
        if now != before:
            ways[joint] = 1 if now > before else -1
    if motors != last:
        last, since = motors, time.monotonic()
    elif since and time.monotonic() - since > AT_REST_S:
        rests.append([motors, list(ways)])
        since = 0.0  # one reading a rest

while stat.interp_state != linuxcnc.INTERP_IDLE:
    now = stat.joint_actual_position[:3]
    low, high = list(map(min, low, now)), list(map(max, high, now))
    look()
    if stat.interp_state == linuxcnc.INTERP_PAUSED:
        stops.append(now)
        until = time.monotonic() + 2 * AT_REST_S
        while time.monotonic() < until:
            look()
            time.sleep(0.002)
        command.auto(linuxcnc.AUTO_RESUME)
        wait("resume", lambda: stat.interp_state != linuxcnc.INTERP_PAUSED)
    told = errors.poll()
    if told:
        said.append(told[1])
    time.sleep(0.002)
    stat.poll()
wait("rest", lambda: stat.inpos)
ended = [settled(joint)[1] for joint in range(3)]
answer = dict(ended=ended, stops=stops, rests=rests, low=low, high=high, said=said)
json.dump(answer, open("found.json", "w"))
"""

# A test outside asks: set pins, read values, move, run a command. What the offsets did meanwhile
# is looked at all the time.
OBEY = """import socket, subprocess, threading

AXES = "xyz"
lock, done = threading.Lock(), False
moved = dict.fromkeys(AXES, 0.0)
beyond = dict.fromkeys(AXES, 0.0)
speeds = dict.fromkeys(AXES, 0.0)

def watch():
    trace = {axis: [] for axis in AXES}
    while not done:
        for axis in AXES:
            begun = time.monotonic()
            now = 1000.0 * hal.get_value("thermap-%s.offset" % axis)
            at = time.monotonic()
            trace[axis] = [one for one in trace[axis] if at - one[0] < 0.5] + [(begun, now)]
            first, last = trace[axis][0], trace[axis][-2:][0]
            with lock:
                step = abs(now - last[1])
                moved[axis] += step
                # However late the look was: what the rate does not allow for in that time.
                beyond[axis] = max(beyond[axis], step - RATE_UM_PER_S * (at - last[0]))
                if at - first[0] > 0.4:
                    speeds[axis] = max(speeds[axis], abs(now - first[1]) / (at - first[0]))
        time.sleep(0.002)

def answer(asked):
    if "set" in asked:
        for name, value in asked["set"].items():
            hal.set_p(name, str(value))
    if "mdi" in asked:
        command.mdi(asked["mdi"])
        command.wait_complete(30)
    if "shell" in asked:
        subprocess.run(asked["shell"], shell=True, check=True, timeout=30)
    if "forget" in asked:
        with lock:
            for figures in (moved, beyond, speeds):
                figures.update(dict.fromkeys(AXES, 0.0))
    with lock:
        return dict(values=[hal.get_value(name) for name in asked.get("get", [])],
                    moved=dict(moved), beyond=dict(beyond), speeds=dict(speeds))

command.mode(linuxcnc.MODE_MDI)
command.wait_complete()
watching = threading.Thread(target=watch)
watching.start()
server = socket.socket(socket.AF_UNIX)
server.bind("asked")
server.listen(1)
open("found.json", "w").write("{}")
with server.accept()[0] as peer, peer.makefile("rw") as lines:
    for line in lines:
        lines.write(json.dumps(answer(json.loads(line))) + chr(10))
        lines.flush()
done = True
watching.join()
"""


class Asked:
    """A running controller: pins set, values read, moves made, and what the offsets did."""

    def __init__(self, lines, said):
        self._lines, self._said = lines, said

    def __call__(self, **what):
        self._lines.write(json.dumps(what) + "\n")
        self._lines.flush()
        answer = self._lines.readline()
        assert answer, f"no answer to {what}; the controller said: {self._said.read_text()[-4000:]}"
        return json.loads(answer)

    def get(self, *names):
        """Read pins and parameters."""
        return self(get=names)["values"]


@contextmanager
def live_controller(wiring, rate_um_per_s):
    """Start LinuxCNC with a HAL file of the live compensation behind its motion.

    Every answer has for each axis how far the offset has `moved`, back and forth [µm], the largest
    step `beyond` what the rate allows [µm], and the highest of its `speeds` over 0.4 s [µm/s].
    """
    loops = "".join(f"net {a}-loop thermap-{a}.out => thermap-{a}.fb-in\n" for a in "xyz")
    kept = [line for line in MACHINE_HAL.splitlines() if "motor-pos-cmd" not in line]
    content = "\n".join([*kept, wiring]) + loops
    with tempfile.TemporaryDirectory(prefix="linuxcnc-") as name:
        folder = Path(name)
        folder.chmod(0o777)
        _furnish(
            folder, {"drive.py": DRIVE + f"RATE_UM_PER_S = {rate_um_per_s}\n" + OBEY}, {}, content
        )
        with ThreadPoolExecutor(1) as aside, socket.socket(socket.AF_UNIX) as peer:
            running = aside.submit(_run, folder)
            while not (folder / "found.json").exists():
                time.sleep(0.05)
                if running.done():
                    running.result()
            peer.connect(str(folder / "asked"))
            with peer.makefile("rw") as lines:
                yield Asked(lines, folder / "said.txt")
            peer.shutdown(socket.SHUT_RDWR)
            running.result()


def run_moves(files, moves):
    """Start LinuxCNC with compensation files, move, and end it.

    `files` are name to content, among them `thermap.ini`, whose lines go into the sections of the
    joints; `moves` are axis and position [mm] in order. Gives axis, commanded position and the
    motor's position [mm] after each.
    """
    tables = {name: text for name, text in files.items() if name.endswith(".comp")}
    driven = tables | {"drive.py": DRIVE + MAKE_MOVES, "moves.json": json.dumps(moves)}
    return _started(driven, _sections(files["thermap.ini"]))


def run_program(text, files=None):
    """Start LinuxCNC, with compensation files or without, run an NC program, and end it.

    Gives where the axes `ended` and stood at the `stops` [mm], how `low` and `high` they were,
    what the controller `said`, and the `rests`: where the motors stood still [mm], and whence they
    had come (1, -1).
    """
    files = files or {}
    tables = {name: content for name, content in files.items() if name.endswith(".comp")}
    driven = tables | {"drive.py": DRIVE + RUN_PROGRAM, "program.ngc": text}
    return _started(driven, _sections(files.get("thermap.ini", "")))


def _started(files, settings):
    with tempfile.TemporaryDirectory(prefix="linuxcnc-") as name:
        folder = Path(name)
        folder.chmod(0o777)
        _furnish(folder, files, settings)
        _run(folder)
        return json.loads((folder / "found.json").read_text())


def _furnish(folder, files, settings, hal=MACHINE_HAL):
    content = MACHINE_INI
    for number, axis in enumerate("XYZ"):
        content += f"[AXIS_{axis}]\nMIN_LIMIT = -1000\nMAX_LIMIT = 1000\n"
        content += "MAX_VELOCITY = 400\nMAX_ACCELERATION = 1000\n"
        content += f"[JOINT_{number}]\n{JOINT}{settings.get(f'JOINT_{number}', '')}"
    written = {
        **files,
        "machine.ini": content,
        "machine.hal": hal,
        "tool.tbl": "",
        "parameters.var": "",
    }
    for name, text in written.items():
        path = folder / name
        path.write_text(text)
        path.chmod(0o777)


def _sections(ini):
    found, name = {}, ""
    for line in ini.splitlines():
        if line.startswith("["):
            name = line.strip("[]")
        elif line and not line.startswith("#"):
            found[name] = found.get(name, "") + line + "\n"
    return found


def _run(folder):
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "VIRTUAL"))}
    environment |= {"HOME": str(folder), "RTAPI_FIFO_PATH": str(folder / "fifo")}
    environment |= {"RTAPI_UID": "65534"} if os.getuid() == 0 else {}
    environment["PATH"] = "/usr/bin:/bin:/usr/sbin:/sbin"
    with ONE_AT_A_TIME.open("w") as one, (folder / "said.txt").open("w+") as said:
        fcntl.flock(one, fcntl.LOCK_EX)
        started = subprocess.Popen(
            [LINUXCNC, "-r", "machine.ini"],
            cwd=folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=said,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        try:
            started.wait(LIMIT_S)
        except subprocess.TimeoutExpired:
            os.killpg(started.pid, signal.SIGTERM)
            started.wait(30)
        said.seek(0)
        assert (folder / "found.json").exists(), said.read()[-4000:]
