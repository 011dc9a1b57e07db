"""The loop closed on the running LinuxCNC, on a plant with errors that nobody has declared.

`thermap program positioning` moves the machine; behind its motors stands a plant whose errors grow
with temperature and have a reversal. A laser reads the plant wherever the motors rest, the files
that the program came with are filled in and imported, the compensation is exported, the controller
loads it, and the same program is measured again.
"""

import math
import os

import numpy as np
import pytest
from typer.testing import CliRunner

from app.cli import application
from app.cli.listening import listening, serving, url_of
from app.main import create_app
from app.settings import Settings
from tests.controllers.linuxcnc_machine import LINUXCNC, run_program
from thermap import ThermapClient

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        LINUXCNC is None and "THERMAP_REQUIRE_SERVICES" not in os.environ,
        reason="LinuxCNC is not installed (Debian: linuxcnc-uspace)",
    ),
]

MACHINE = {
    "id": "vmc",
    "name": "VMC",
    "configuration": "XYFZ",
    "axes": {axis: {"min_mm": 0, "max_mm": 100} for axis in "xyz"},
    "sensors": [{"name": "x-middle"}],
}

MAPS_C = {"cold": 20.0, "warm": 30.0}
WORKING_C = 26.0


def actual_mm(motor_mm, way, t_c):
    """Where the plant stands: a screw that grows, a periodic error, 4 µm lost at a reversal."""
    grown = 0.04 * (t_c - 18.0) * motor_mm + 2.5 * math.sin(motor_mm / 14.0)
    return motor_mm + (grown + (0.0 if way > 0 else -4.0)) / 1000.0


def laser_um(rests, targets, t_c):
    """Deviations at the targets in order [µm], from the zero at the first rest."""
    stood = [actual_mm(motors[0], ways[0], t_c) for motors, ways in rests]
    zero, *read = stood
    assert len(read) == len(targets)
    return [1000.0 * (at - zero - (to - targets[0])) for at, to in zip(read, targets, strict=True)]


def filled(form, label, t_c, deviations):
    """Fill in the file that came with the program."""
    head = {"# label: ": label, "# measured_at: ": "2026-03-01T06:00:00Z"}
    head["# temperature x-middle: "] = f"{t_c:g}"
    left = iter(deviations)
    lines = [
        f"{line}{next(left):.4f}" if line.endswith((",+,", ",-,")) else line + head.get(line, "")
        for line in form.splitlines()
    ]
    assert next(left, None) is None
    return "\n".join(lines) + "\n"


def targets_of(form):
    return [float(r.split(",")[0]) for r in form.splitlines() if r.endswith((",+,", ",-,"))]


def test_what_the_program_measured_the_controller_takes_away(tmp_path):
    service = create_app(Settings(database_url=f"sqlite:///{tmp_path / 'shop.db'}"))
    with listening("127.0.0.1", 0, "serve") as opened, serving(service, opened, "warning"):
        url = url_of(opened)
        with ThermapClient(url) as client:
            client.create_machine(MACHINE)

        def thermap(*words):
            env = {"THERMAP_URL": url}
            found = CliRunner().invoke(application, [str(word) for word in words], env=env)
            assert found.exit_code == 0, found.output

        thermap(
            *("program", "positioning", "vmc", "-c", "linuxcnc", "--axis", "x", "--runs", 1),
            *("--at", "10,24,41,55,72", "--line", "y=9", "--line", "z=90", "--feed", 20_000),
            *("--dwell", 0.12, "--reading", 0.06, "--output", tmp_path),
        )
        (program,) = (path.read_text() for path in tmp_path.glob("*.ngc"))
        (form,) = (path.read_text() for path in tmp_path.glob("*.csv"))
        targets = targets_of(form)

        # Without compensation the motors rest at the same places at any temperature.
        without = run_program(program)["rests"]
        for label, t_c in MAPS_C.items():
            file = tmp_path / f"{label}.csv"
            file.write_text(filled(form, label, t_c, laser_um(without, targets, t_c)))
            thermap("import", "--method", "positioning", file, "--machine", "vmc")
        out = tmp_path / "cnc"
        thermap("export", "vmc", "-c", "linuxcnc", "-t", f"x-middle={WORKING_C}", "--output", out)
        files = {path.name: path.read_text() for path in out.iterdir()}
        with_it = run_program(program, files)["rests"]

    before = np.abs(laser_um(without, targets, WORKING_C)).max()
    after = np.abs(laser_um(with_it, targets, WORKING_C)).max()
    assert before > 15.0
    assert after < 0.1
