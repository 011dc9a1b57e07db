"""Close the loop on the running LinuxCNC: maps, export, warm-ups, and what nobody declared.

    python -m examples.linuxcnc

Needed is LinuxCNC itself (Debian 12: `apt-get install --no-install-recommends linuxcnc-uspace`); it
runs here without a screen and without motors. Behind its motors stands a plant (`plant`): a laser
reads where it is, sensors read how warm, and nothing else of it is known to thermap. Days pass in
minutes: times are stated, and the last measurement is at present.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path
from typing import Final

from examples.linuxcnc.campaign import (
    VISIT_MM,
    VISITS,
    Found,
    analyse,
    course_until,
    warm_ups_s,
)
from examples.linuxcnc.controller import NotRunning, expect_installed
from examples.linuxcnc.live import BETWEEN_MM, Logger, Stage, live, warm_up
from examples.linuxcnc.maps import MACHINE, MAPS_C, WORKING_C, Axis, export, map_axis
from examples.linuxcnc.plant import HOUR_S, LATE_S
from examples.linuxcnc.shop import open_shop

GOES_ON_S: Final = 6 * HOUR_S
"""How long the plant's course goes on while the loop runs, however slow the computer is."""


def close_the_loop(folder: Path) -> tuple[list[Axis], list[Stage], Found, list[Stage]]:
    """Walk the whole way.

    Returns
    -------
    tuple
        X and Z before and after their export; the first warm-up, with the maps alone; what
        was found; the last warm-up, with what was adopted.

    Raises
    ------
    NotRunning
        If LinuxCNC is not installed, or does not start.
    """
    expect_installed()
    with open_shop(folder) as shop:
        shop.client.create_machine(MACHINE)
        exported = export(shop, {axis: map_axis(shop, axis) for axis in "xz"})
        now_s = time.time()
        logger = Logger(shop, course_until(now_s + GOES_ON_S, now_s))
        first_s, last_s = warm_ups_s(now_s)
        with live(shop) as machine:
            before = warm_up(shop, machine, logger, first_s, until_now=False)
        logger.send(last_s)
        found = analyse(shop, logger.course, now_s)
        with live(shop) as machine:
            after = warm_up(shop, machine, logger, last_s, until_now=True)
    return exported, before, found, after


def main() -> None:
    """Print the figures of each step."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            exported, before, found, after = close_the_loop(Path(folder))
        except NotRunning as error:
            sys.exit(str(error))
    cold, warm = MAPS_C.values()
    print(f"maps      X and Z, measured by the controller's own moves at {cold:g} and {warm:g} °C")
    print(f"export    the controller loads the table of {WORKING_C:g} °C; largest deviations:")
    for axis in exported:
        print(
            f"          {axis.name.upper()} {axis.before_um:.1f} µm before, "
            f"{axis.after_um:.3f} µm after"
        )
    print(f"visits    {VISITS} in days of warming up, {len(VISIT_MM)} readings of Z each")
    print(f"planted   EZZ follows z-column {LATE_S / 60.0:.0f} min late")
    print(f"found     {found.summary}")
    print(f"          ({found.status}; adopted as model version {found.version})")
    print("live      largest deviation of Z in a warm-up, the motor following the service's table,")
    print(
        f"          at {len(BETWEEN_MM)} positions between those of the maps; "
        f"its move at Z {BETWEEN_MM[-1]:g} mm:"
    )
    print("          after    z-column  ahead by  maps alone  with what was adopted  motor moved")
    for one, other in zip(before, after, strict=True):
        print(
            f"          {one.minutes:3.0f} min  {one.sensor_c:5.1f} °C  {one.late_c:+5.1f} K  "
            f"{one.largest_um:7.1f} µm  {other.largest_um:18.1f} µm  {other.moved_um:+8.1f} µm"
        )
    print(
        f"          (with what was adopted the last was measured at present, "
        f"{after[-1].minutes:.0f} min after the"
    )
    print("          warm-up began: the component itself sent what HAL's pins said)")


if __name__ == "__main__":
    main()
