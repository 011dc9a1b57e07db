#!/usr/bin/python3
"""What LinuxCNC starts as its display: it homes the machine, then does what it is asked to.

It runs in LinuxCNC's own Python, in the controller's folder, and is asked over a socket there:
a JSON object a line, and one in answer. `examples.linuxcnc.controller` starts it and asks.
"""

import faulthandler
import json
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import hal
import linuxcnc

AXES = "xyz"

INI = linuxcnc.ini("machine.ini")

RATE = INI.find("THERMAP", "RATE_UM_PER_S")
"""Stated where the live compensation stands between motion and motors."""

UM_PER_UNIT = 1000.0 if INI.find("TRAJ", "LINEAR_UNITS") == "mm" else 25400.0

MOTORS = [
    f"joint.{joint}.motor-pos-cmd" if RATE is None else f"thermap-{axis}.out"
    for joint, axis in enumerate(AXES)
]

stat, command, errors = linuxcnc.stat(), linuxcnc.command(), linuxcnc.error_channel()


def main():
    """Home, and obey until nobody asks any more."""
    faulthandler.enable()
    kept = hal.component("drive")  # it lives as long as it is named
    kept.ready()
    home()
    watched = None if RATE is None else Watched(float(RATE))
    server = socket.socket(socket.AF_UNIX)
    server.bind("asked")
    server.listen(1)
    Path("ready").touch()
    with server.accept()[0] as peer, peer.makefile("rw") as lines:
        for line in lines:
            lines.write(json.dumps(answer(json.loads(line), watched)) + "\n")
            lines.flush()
    if watched is not None:
        watched.end()


def home():
    """Switch the machine on, and let all joints find their zero."""
    command.state(linuxcnc.STATE_ESTOP_RESET)
    command.wait_complete()
    command.state(linuxcnc.STATE_ON)
    wait("power", lambda: stat.task_state == linuxcnc.STATE_ON)
    command.mode(linuxcnc.MODE_MANUAL)
    command.wait_complete()
    command.home(-1)
    wait("home", lambda: all(stat.homed[:3]))


def answer(asked, watched):
    """Do what is asked, in this order, and say what came of it."""
    found = {}
    for name, value in asked.get("set", {}).items():
        hal.set_p(name, str(value))
    if "mdi" in asked:
        found["settled"] = move(asked["mdi"])
    if "program" in asked:
        found["ran"] = run(asked["program"])
    if "shell" in asked:
        subprocess.run(asked["shell"], shell=True, check=True, timeout=30)
    if watched is not None:
        if "forget" in asked:
            watched.forget()
        found |= watched.figures()
    found["values"] = [hal.get_value(name) for name in asked.get("get", [])]
    return found


def wait(what, until):
    """Wait until LinuxCNC says so."""
    for _ in range(2000):
        stat.poll()
        if until():
            return
        time.sleep(0.01)
    sys.exit("never came: " + what)


def mode(wanted):
    """Change the mode, if it is another one."""
    command.mode(wanted)
    command.wait_complete()


def move(words):
    """Make one move; give each joint's commanded position and its motor's, in machine units."""
    mode(linuxcnc.MODE_MDI)
    command.mdi(words)
    if command.wait_complete(30) != linuxcnc.RCS_DONE:
        sys.exit("the move failed: " + words)
    return settled()


def settled():
    """Wait until commanded positions and motors stand still."""
    last, same = None, 0
    while same < 10:
        now = [(hal.get_value(f"joint.{j}.pos-cmd"), hal.get_value(MOTORS[j])) for j in range(3)]
        same = same + 1 if now == last else 0
        last = now
        time.sleep(0.01)
    return now


class Rests:
    """Where the motors stood at each dwell and each stop, and whence the axes had come.

    The controller says when it waits. How long nothing has moved would not do: on a busy computer
    the axes themselves stand still now and then.
    """

    def __init__(self):
        self.found = []
        self._last, self._ways, self._held = axes(), [1] * 3, None

    def look(self):
        """See whether the machine waits; what was last seen of a wait is what counts."""
        waited = waits()
        now, motors = axes(), [hal.get_value(name) for name in MOTORS]
        stands = hal.get_value("motion.in-position")
        stat.poll()
        for joint, (at, before) in enumerate(zip(now, self._last)):
            if at != before:
                self._ways[joint] = 1 if at > before else -1
        if now != self._last or not waits():
            self.keep()
        self._last = now
        if waited and stands and waits():
            self._held = [motors, list(self._ways)]

    def keep(self):
        """Take down the wait that is over, if there was one."""
        if self._held is not None:
            self.found.append(self._held)
        self._held = None


def axes():
    """Give the axes' commanded positions."""
    return [hal.get_value(f"joint.{joint}.pos-cmd") for joint in range(3)]


def waits():
    """Say whether the program dwells or has stopped for the operator, as last polled."""
    dwells = stat.exec_state == linuxcnc.EXEC_WAITING_FOR_DELAY
    return dwells or stat.interp_state == linuxcnc.INTERP_PAUSED


def run(text):
    """Run a program, with an operator who presses start at every stop.

    A work offset is active, as on a machine that was used before.
    """
    Path("program.ngc").write_text(text)
    mode(linuxcnc.MODE_MDI)
    command.mdi("G10 L2 P1 X7 Y8 Z9")
    command.wait_complete()
    mode(linuxcnc.MODE_AUTO)
    command.program_open("program.ngc")
    command.auto(linuxcnc.AUTO_RUN, 0)
    wait("start", lambda: stat.interp_state != linuxcnc.INTERP_IDLE)
    stops, said, low, high, rests = [], [], [1e9] * 3, [-1e9] * 3, Rests()
    while stat.interp_state != linuxcnc.INTERP_IDLE:
        now = stat.joint_actual_position[:3]
        low, high = list(map(min, low, now)), list(map(max, high, now))
        rests.look()
        if stat.interp_state == linuxcnc.INTERP_PAUSED:
            stops.append(now)
            settled()
            rests.look()
            command.auto(linuxcnc.AUTO_RESUME)
            wait("resume", lambda: stat.interp_state != linuxcnc.INTERP_PAUSED)
        told = errors.poll()
        if told:
            said.append(told[1])
        time.sleep(0.002)
        stat.poll()
    rests.keep()
    wait("rest", lambda: stat.inpos)
    ended = [motor for _, motor in settled()]
    found = {"ended": ended, "stops": stops, "rests": rests.found}
    return found | {"low": low, "high": high, "said": said}


class Watched:
    """What the offsets of the live compensation did, looked at all the time."""

    def __init__(self, rate_um_per_s):
        self._lock, self._done, self._rate = threading.Lock(), False, rate_um_per_s
        self.forget()
        self._thread = threading.Thread(target=self._watch)
        self._thread.start()

    def forget(self):
        """Count from now on."""
        with self._lock:
            self._moved = dict.fromkeys(AXES, 0.0)
            self._beyond = dict.fromkeys(AXES, 0.0)
            self._speeds = dict.fromkeys(AXES, 0.0)

    def figures(self):
        """Say how far, by which steps and how fast [µm, µm/s]."""
        with self._lock:
            found = {"moved": self._moved, "beyond": self._beyond, "speeds": self._speeds}
            return {name: dict(figures) for name, figures in found.items()}

    def end(self):
        """Look no longer."""
        self._done = True
        self._thread.join()

    def _watch(self):
        trace = {axis: [] for axis in AXES}
        while not self._done:
            for axis in AXES:
                begun = time.monotonic()
                now = UM_PER_UNIT * hal.get_value(f"thermap-{axis}.offset")
                at = time.monotonic()
                trace[axis] = [one for one in trace[axis] if at - one[0] < 0.5] + [(begun, now)]
                first, last = trace[axis][0], trace[axis][-2:][0]
                with self._lock:
                    step = abs(now - last[1])
                    self._moved[axis] += step
                    # However late the look was: what the rate does not allow for in that time.
                    beyond = step - self._rate * (at - last[0])
                    self._beyond[axis] = max(self._beyond[axis], beyond)
                    if at - first[0] > 0.4:
                        speed = abs(now - first[1]) / (at - first[0])
                        self._speeds[axis] = max(self._speeds[axis], speed)
            time.sleep(0.002)


main()
