#!/usr/bin/python3
"""What LinuxCNC starts as its display: it homes the machine, then does what it is asked to.

It runs in LinuxCNC's own Python, in the controller's folder, and is asked over a socket there:
a JSON object a line, and one in answer. `examples.linuxcnc.controller` starts it and asks.
"""

import faulthandler
import json
import os
import re
import socket
import subprocess
import sys
import threading
import time
from collections import deque
from pathlib import Path

import hal
import linuxcnc

AXES = "xyz"

INI = linuxcnc.ini("machine.ini")

COMPENSATED = INI.find("THERMAP", "LIVE") is not None
"""Stated where the live compensation stands between motion and motors."""

UM_PER_UNIT = 1000.0 if INI.find("TRAJ", "LINEAR_UNITS") == "mm" else 25400.0

SAMPLED = "ffffffs" + "fff" * COMPENSATED
"""Commanded positions and motors [machine units], the program's line, the offsets if there are."""

STILL = 100
"""Cycles [ms] after which what has not moved stands."""

STEADY = 400
"""Cycles [ms] over which a speed is taken."""

TRIES = 3

STANDSTILL_S = 120.0
"""A program that neither moves nor gets to another line for so long is given up."""

stat, command, errors = linuxcnc.stat(), linuxcnc.command(), linuxcnc.error_channel()


def main():
    """Home, and obey until nobody asks any more."""
    faulthandler.enable()
    kept = hal.component("drive")  # it lives as long as it is named
    kept.ready()
    recorder = Recorder(kept)
    home()
    recorder.forget()
    server = socket.socket(socket.AF_UNIX)
    server.bind("asked")
    server.listen(1)
    Path("ready").touch()
    with server.accept()[0] as peer, peer.makefile("rw") as lines:
        for line in lines:
            lines.write(json.dumps(answer(json.loads(line), recorder)) + "\n")
            lines.flush()
    recorder.end()


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


def answer(asked, recorder):
    """Do what is asked, in this order, and say what came of it."""
    found = {}
    for name, value in asked.get("set", {}).items():
        hal.set_p(name, str(value))
    if "mdi" in asked:
        found["settled"] = move(asked["mdi"], recorder)
    if "program" in asked:
        found["ran"] = run(asked["program"], recorder)
    if "shell" in asked:
        subprocess.run(asked["shell"], shell=True, check=True, timeout=30)
    if COMPENSATED:
        if "forget" in asked:
            recorder.forget()
        found |= recorder.figures()
    found["values"] = [hal.get_value(name) for name in asked.get("get", [])]
    return found


def wait(what, until):
    """Wait until LinuxCNC says so."""
    for _ in range(6000):
        stat.poll()
        if until():
            return
        time.sleep(0.01)
    sys.exit("never came: " + what)


def mode(wanted):
    """Change the mode, if it is another one."""
    command.mode(wanted)
    command.wait_complete()


def move(words, recorder):
    """Make one move; give each joint's commanded position and its motor's, in machine units."""
    mode(linuxcnc.MODE_MDI)
    command.mdi(words)
    if command.wait_complete(30) != linuxcnc.RCS_DONE:
        sys.exit("the move failed: " + words)
    return recorder.settled()


def run(text, recorder):
    """Run a program, with an operator who presses start at every stop.

    A busy computer may hold the controller's thread for longer than a dwell lasts: no cycle then
    tells of that rest, and the program is run again.
    """
    rests = waits_after(text)
    for _ in range(TRIES):
        found = run_once(text, recorder)
        if len(found["rests"]) >= len(rests):
            break
    return found


def run_once(text, recorder):
    """Run a program; a work offset is active, as on a machine that was used before."""
    Path("program.ngc").write_text(text)
    mode(linuxcnc.MODE_MDI)
    command.mdi("G10 L2 P1 X7 Y8 Z9")
    command.wait_complete()
    mode(linuxcnc.MODE_AUTO)
    command.program_open("program.ngc")
    recorder.begin(waits_after(text))
    command.auto(linuxcnc.AUTO_RUN, 0)
    wait("start", lambda: stat.interp_state != linuxcnc.INTERP_IDLE)
    stops, said = [], []
    place, since = None, time.monotonic()
    while stat.interp_state != linuxcnc.INTERP_IDLE:
        if place != (place := (stat.motion_line, stat.position)):
            since = time.monotonic()
        elif time.monotonic() - since > STANDSTILL_S:
            sys.exit(f"the program stands still at line {stat.motion_line}")
        if stat.interp_state == linuxcnc.INTERP_PAUSED:
            stops.append([commanded for commanded, _ in recorder.settled()])
            command.auto(linuxcnc.AUTO_RESUME)
            wait("resume", lambda: stat.interp_state != linuxcnc.INTERP_PAUSED)
        told = errors.poll()
        if told:
            said.append(told[1])
        time.sleep(0.002)
        stat.poll()
    wait("rest", lambda: stat.inpos)
    ended = [motor for _, motor in recorder.settled()]
    return {"ended": ended, "stops": stops, "said": said, **recorder.walked()}


def waits_after(text):
    """Give the numbers of the lines that move, with a dwell or a stop before the next that does.

    The axes stand still after other lines too, where a busy computer reads the program slowly.
    """
    found, moving = set(), 0
    for number, line in enumerate(text.splitlines(), 1):
        words = set(re.findall(r"[GM]\d+", line.partition(";")[0]))
        if words & {"G0", "G1"}:
            moving = number
        elif words & {"G4", "M0"}:
            found.add(moving)
    return found


class Recorder:
    """What the controller did, cycle by cycle, as its own thread wrote it down.

    On a busy computer that thread runs late, and so does this program: what it sees by looking
    has happened at other times, or has gone by. Nothing of what the sampler keeps is lost.
    """

    def __init__(self, component):
        self._stream = hal.stream(component, hal.sampler_base, SAMPLED)
        self._changed, self._done, self._read = threading.Condition(), False, 0
        self._last, self._same = None, 0
        self._offsets = deque(maxlen=STEADY + 1)
        with self._changed:
            self._forget()
            self._begin(set())
        self._thread = threading.Thread(target=self._follow, daemon=True)
        self._thread.start()

    def forget(self):
        """Count what the offsets do from now on."""
        with self._changed:
            self._catch_up()
            self._forget()

    def figures(self):
        """Say how far the offsets went, by which steps and how fast [µm, µm/s]."""
        with self._changed:
            self._catch_up()
            found = {"moved": self._moved, "steps": self._steps, "speeds": self._speeds}
            return {name: dict(zip(AXES, figures)) for name, figures in found.items()}

    def begin(self, waits_after):
        """Take down where the axes go and where they rest from now on."""
        with self._changed:
            self._catch_up()
            self._begin(waits_after)

    def walked(self):
        """Say how far the axes went, and where the motors stood at each rest."""
        with self._changed:
            self._catch_up()
            self._keep()
            return {"low": self._low, "high": self._high, "rests": self._rests}

    def settled(self):
        """Wait until axes and motors stand still; give both of each joint, in machine units."""
        with self._changed:
            self._catch_up()
            if not self._changed.wait_for(lambda: self._same >= STILL, timeout=60.0):
                sys.exit("axes and motors never stood still")
            return list(zip(self._last[:3], self._last[3:6]))

    def end(self):
        """Follow no longer."""
        self._done = True
        self._thread.join()

    def _catch_up(self):
        """Wait until all is read that the thread has written down till now."""
        until = hal.get_value("sampler.0.sample-num")
        if not self._changed.wait_for(lambda: self._read >= until, timeout=60.0):
            sys.exit(f"of {until} cycles only {self._read} were read")

    def _follow(self):
        while not self._done:
            with self._changed:
                while self._stream.readable:
                    cycle = self._stream.read()
                    self._read += 1
                    self._take(cycle)
                self._changed.notify_all()
            if self._stream.num_overruns:
                print("cycles of the controller were lost", flush=True)
                os._exit(1)
            time.sleep(0.005)

    def _take(self, cycle):
        now, line, offsets = cycle[:6], cycle[6], [UM_PER_UNIT * one for one in cycle[7:]]
        last = self._last or now
        self._same = self._same + 1 if now == last else 0
        self._low = [min(one) for one in zip(self._low, now[:3])]
        self._high = [max(one) for one in zip(self._high, now[:3])]
        if line and not self._line:
            self._keep()  # the queue was empty: the axes stood, and go on now
        self._line = line
        self._moving = line or self._moving
        self._ways = [
            (1 if to > at else -1) if to != at else way
            for at, to, way in zip(last, now, self._ways)
        ]
        self._last = now
        self._watch(offsets)

    def _keep(self):
        """Take down the rest that is over, if it was one."""
        if self._moving in self._waits_after:
            self._rests.append([list(self._last[3:]), list(self._ways)])
        self._moving = 0

    def _watch(self, offsets):
        past = self._offsets
        if past and offsets:
            steps = [abs(now - before) for now, before in zip(offsets, past[-1])]
            self._moved = [a + b for a, b in zip(self._moved, steps)]
            self._steps = [max(pair) for pair in zip(self._steps, steps)]
        past.append(offsets)
        if len(past) > STEADY:
            moved = [abs(now - before) for now, before in zip(offsets, past[0])]
            speeds = [1000.0 * one / STEADY for one in moved]
            self._speeds = [max(pair) for pair in zip(self._speeds, speeds)]

    def _forget(self):
        self._moved, self._steps, self._speeds = ([0.0] * 3 for _ in range(3))
        self._offsets.clear()

    def _begin(self, waits_after):
        self._waits_after, self._rests, self._ways = waits_after, [], [1] * 3
        self._low, self._high = [1e9] * 3, [-1e9] * 3
        self._line = self._moving = 0


main()
