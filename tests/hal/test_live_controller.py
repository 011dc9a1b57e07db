"""The motors of the running LinuxCNC follow the service's table, and nothing makes them jump."""

import os
import time
from contextlib import contextmanager

import pytest
from typer.testing import CliRunner

from app.cli import application
from app.cli.listening import listening, serving, url_of
from app.main import create_app
from app.settings import Settings
from examples.linuxcnc.controller import LINUXCNC, UNITS, running
from thermap import ThermapClient

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        LINUXCNC is None and "THERMAP_REQUIRE_SERVICES" not in os.environ,
        reason="LinuxCNC is not installed (Debian: linuxcnc-uspace)",
    ),
]

TOLERANCE_UM = 0.1
RATE_UM_PER_S, PERIOD_S, EVERY_S = 20.0, 0.02, 0.3

SENSORS = ("thermap.temperature.z-column", "thermap.temperature.x-middle")

POSITIONS = [0.0, 80.0, 200.0, 310.0, 500.0]
COLD_C, WARM_C = 20.0, 30.0

WARM_UM = {
    "EXX": [0.0, 3.0, 9.0, 8.0, 21.0],
    "EYX": [0.0, -2.0, 4.0, 1.0, 0.0],
    "EZX": [0.0, 1.0, 5.0, -3.0, 2.0],
    "EXY": [0.0, 2.0, -6.0, 4.0, 1.0],
    "EYY": [0.0, -4.0, -7.0, -12.0, -18.0],
    "EZY": [0.0, 0.5, 1.5, 4.5, 6.0],
    "EXZ": [0.0, -1.0, -3.0, -8.0, -9.0],
    "EYZ": [0.0, 2.5, 1.0, 6.0, 3.0],
    "EZZ": [0.0, 6.0, 15.0, 22.0, 33.0],
}
"""Errors at 30 °C [µm]; at 20 °C there are none, and between they grow evenly."""

WARM_UM_PER_M = {"SXY": -12.0, "SYZ": 20.0, "SZX": 8.0}

MACHINE = {
    "id": "vmc",
    "name": "VMC",
    "configuration": "XYFZ",
    "axes": {axis: {"min_mm": 0, "max_mm": 500} for axis in "xyz"},
    "sensors": [
        {"name": "z-column", "max_age_s": 600, "max_rate_c_per_min": 1e6},
        {"name": "x-middle", "max_age_s": 600, "max_rate_c_per_min": 1e6},
    ],
}


def map_at(label, t_c):
    share = (t_c - COLD_C) / (WARM_C - COLD_C)
    return {
        "label": label,
        "measured_at": "2026-03-01T06:00:00Z",
        "temperatures_c": {"z-column": t_c, "x-middle": t_c},
        "components": [
            *(
                {"component": c, "positions_mm": POSITIONS, "errors_um": [share * v for v in e]}
                for c, e in WARM_UM.items()
            ),
            *(
                {"component": c, "value_um_per_m": share * value}
                for c, value in WARM_UM_PER_M.items()
            ),
        ],
    }


def error_um(axis, point, t_c):
    """The definition written once more: E_x = EXX(x) + EXY(y) + EXZ(z) + SXY·y + SZX·z [µm]."""
    found = 0.0
    for along, at in zip("xyz", point, strict=True):
        values = WARM_UM[f"E{axis}{along}".upper()]
        number = max(n for n, p in enumerate(POSITIONS[:-1]) if p <= at)
        low, high = POSITIONS[number : number + 2]
        found += values[number] + (values[number + 1] - values[number]) * (at - low) / (high - low)
    _, y, z = point
    square = WARM_UM_PER_M
    found += {
        "x": (square["SXY"] * y + square["SZX"] * z) / 1000.0,
        "y": square["SYZ"] * z / 1000.0,
        "z": 0.0,
    }[axis]
    return found * (t_c - COLD_C) / (WARM_C - COLD_C)


class Shop:
    """A service that can be ended and begun again at its address."""

    def __init__(self, database_url):
        self._settings = Settings(database_url=database_url)
        self.url, self._port = "", 0

    @contextmanager
    def open(self):
        with (
            listening("127.0.0.1", self._port, "serve") as opened,
            serving(create_app(self._settings), opened, "warning"),
        ):
            self.url = url_of(opened)
            self._port = int(self.url.rpartition(":")[2])
            yield


def offsets_um(machine, units="mm"):
    motor = machine.get(*(f"thermap-{axis}.out" for axis in "xyz"))
    nominal = machine.get(*(f"joint.{n}.pos-cmd" for n in range(3)))
    return [(m - c) * UNITS[units] * 1000.0 for m, c in zip(motor, nominal, strict=True)]


def expect_offsets(machine, point, t_c, units="mm"):
    """The offsets are those of these temperatures, or become so.

    Sensors' pins are set one after the other: on a busy machine a reading between two of them
    is settled first.
    """
    wanted = [-error_um(axis, point, t_c) for axis in "xyz"]
    near = pytest.approx(wanted, abs=TOLERANCE_UM)
    deadline = time.monotonic() + 60.0
    while offsets_um(machine, units) != near and time.monotonic() < deadline:
        time.sleep(0.2)
    assert offsets_um(machine, units) == near
    return wanted


def furnished(shop):
    with ThermapClient(shop.url) as client:
        client.create_machine(MACHINE)
        for t_c in (COLD_C, WARM_C):
            client.store_error_map("vmc", map_at(f"at {t_c:g}", t_c))


def wiring_of(shop, *more):
    words = ["hal", "wiring", "vmc", "--url", shop.url, "--rate", str(RATE_UM_PER_S)]
    words += ["--period", str(PERIOD_S), "--every", str(EVERY_S), *more]
    written = CliRunner().invoke(application, words)
    assert written.exit_code == 0, written.output
    return written.stdout


def warm_to(machine, t_c, largest_um):
    """Change the temperatures, and wait as long as the documents say at most."""
    machine.set(dict.fromkeys(SENSORS, t_c))
    machine.wait_for(60.0, connected=True, settled=False)  # the answer has come
    machine.wait_for(largest_um / RATE_UM_PER_S + 60.0, settled=True, connected=True, stale=False)


def expect_no_jump(asked):
    """The offsets went in steps of the rate times the period, and no faster than the rate.

    By the controller's own cycles: on a busy computer its thread runs late and catches up.
    """
    for axis in "xyz":
        assert asked["moved"][axis] > 0.0
        assert asked["steps"][axis] <= RATE_UM_PER_S * PERIOD_S + 1e-6
        # One step may have come just before such a time, and one stands at its end.
        assert asked["speeds"][axis] <= RATE_UM_PER_S * (1.0 + 2 * PERIOD_S / 0.4)


def restart(machine, wiring, t_c):
    """End the component, and start it again: the curves stay where they are all the while."""
    start = next(line for line in wiring.splitlines() if line.startswith("loadusr"))
    (going,) = machine.get("thermap.heartbeat")
    machine.ask(forget=True, shell=f"halcmd unloadusr thermap && halcmd {start}")
    machine.set(dict.fromkeys(SENSORS, t_c))
    machine.wait_for(60.0, connected=True, stale=False, settled=True)
    assert machine.get("thermap.heartbeat") < [going]


def test_the_motors_follow_hold_and_never_jump(tmp_path):
    shop = Shop(f"sqlite:///{tmp_path / 'shop.db'}")
    with shop.open():
        furnished(shop)
        wiring = wiring_of(shop)
    with running(wiring=wiring) as machine:
        # The controller starts without the service, and nothing moves the motors.
        assert machine.get("thermap.connected", "thermap.stale") == [False, True]
        assert offsets_um(machine) == [0.0, 0.0, 0.0]
        point = (150.0, 260.0, 420.0)
        machine.move("G53 G0 X{} Y{} Z{}".format(*point))
        with shop.open():
            warm_to(machine, 24.0, 120.0)
            expect_offsets(machine, point, 24.0)
            warm_to(machine, 30.0, 120.0)
            held = expect_offsets(machine, point, 30.0)
            expect_no_jump(machine.ask())
        # The service is gone: what was last is held, whatever the temperatures do.
        machine.wait_for(60.0, connected=False, stale=True)
        machine.ask(forget=True, set=dict.fromkeys(SENSORS, 21.0))
        time.sleep(1.0)
        assert offsets_um(machine) == pytest.approx(held, abs=1e-6)
        assert set(machine.ask()["moved"].values()) == {0.0}
        # And held is a curve, not a number: the motors still stand where it says.
        point = (35.0, 480.0, 255.0)
        machine.move("G53 G0 X{} Y{} Z{}".format(*point))
        expect_offsets(machine, point, 30.0)
        machine.ask(forget=True)
        with shop.open():
            machine.wait_for(60.0, connected=True, stale=False, settled=False)
            machine.wait_for(60.0, connected=True, stale=False, settled=True)
            expect_offsets(machine, point, 21.0)
            expect_no_jump(machine.ask())
            restart(machine, wiring, 21.0)
            expect_offsets(machine, point, 21.0)
            assert set(machine.ask()["moved"].values()) == {0.0}
            machine.set({"thermap.enable": 0})
            machine.wait_for(60.0, active=False, settled=True)
            assert offsets_um(machine) == pytest.approx([0.0, 0.0, 0.0], abs=1e-6)
            expect_no_jump(machine.ask())


def test_an_inch_machine_is_moved_by_as_much(tmp_path):
    """Its positions, its offsets and the curves are inches; the rate stays in µm/s."""
    shop = Shop(f"sqlite:///{tmp_path / 'shop.db'}")
    with shop.open():
        furnished(shop)
        wiring = wiring_of(shop, "--units", "inch")
        with running(wiring=wiring, units="inch") as machine:
            point = (150.0, 260.0, 420.0)
            machine.move("G21 G53 G0 X{} Y{} Z{}".format(*point))
            commanded = machine.get(*(f"joint.{n}.pos-cmd" for n in range(3)))
            assert commanded == pytest.approx([mm / 25.4 for mm in point])
            warm_to(machine, 30.0, 120.0)
            expect_offsets(machine, point, 30.0, "inch")
            expect_no_jump(machine.ask())
            restart(machine, wiring, 30.0)
            expect_offsets(machine, point, 30.0, "inch")
            assert set(machine.ask()["moved"].values()) == {0.0}
