"""The HAL file that puts the live compensation between LinuxCNC's motion and its drives."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from itertools import chain

from app.hal.curves import Nodes, curves_between

COMPONENT = "thermap"
LONGEST_PIN = 47
"""HAL's HAL_NAME_LEN."""

LONGEST_LINE = 1000
"""halcmd takes lines of up to 1024 characters, and 32 words."""

_HAL_NAME = re.compile(r"[A-Za-z0-9._-]+", re.ASCII)


class NotWired(ValueError):
    """A machine that HAL has no names for; the sentence says why."""


THREAD = "servo-thread"
"""The thread in which the controller commands positions."""

CLOCK = f"{COMPONENT}-clock"
"""How long the controller's thread has run [s]: by it the component knows that a step was taken."""


def curve_name(code: str) -> str:
    """Name the `lincurve` of a component."""
    return f"{COMPONENT}-{code.lower()}"


def sensor_pin(sensor: str) -> str:
    """Name the pin that a sensor's temperature comes in on, without the component's name.

    Raises
    ------
    NotWired
        If HAL cannot name a pin so.
    """
    pin = f"temperature.{sensor}"
    if not _HAL_NAME.fullmatch(sensor) or len(f"{COMPONENT}.{pin}") > LONGEST_PIN:
        most = LONGEST_PIN - len(f"{COMPONENT}.temperature.")
        raise NotWired(
            f"expected a sensor's name of at most {most} letters, digits, '.', '_' and '-', which "
            f"HAL names a pin by, got {sensor!r}"
        )
    return pin


def wiring(
    nodes: Nodes,
    joints: Mapping[str, Sequence[int]],
    machine_units_per_mm: float,
    command: Iterable[str],
) -> str:
    """Write the HAL file: curves, sums, offsets, a clock, their order in the thread, the component.

    Parameters
    ----------
    nodes
        Axis to the positions of its curves' points [mm]; the axes that the machine has.
    joints
        Axis to the numbers of its joints; of a gantry several, which are moved alike.
    machine_units_per_mm
        1 for LINEAR_UNITS = mm, 1/25.4 for inch.
    command
        The command line of the userspace component, word by word.

    Raises
    ------
    NotWired
        If that line is longer than HAL reads.
    """
    start = f"loadusr -Wn {COMPONENT} {' '.join(command)}"
    if len(start) > LONGEST_LINE:
        raise NotWired(
            f"expected a line of at most {LONGEST_LINE} characters, which HAL reads, got "
            f"{len(start)} with the names of all sensors: shorten them"
        )
    curves = curves_between(nodes)
    names = [curve_name(code) for code in curves]
    points = ",".join(str(len(nodes[along])) for _, along in curves.values())
    sums = [name for axis in nodes for name in _sums_of(axis, nodes)]
    offsets = [name for axis in nodes for name in offset_names(axis, joints[axis])]
    lines = [
        "# The live compensation of thermap: motor = commanded + offset.",
        "# Load it after motmod, instead of the lines that join motor-pos-cmd and motor-pos-fb to",
        "# the drives; then join the drives:",
        *chain.from_iterable(
            (
                f"#   net {name.removeprefix(f'{COMPONENT}-')}-motor {name}.out => "
                "(the drive's commanded position)",
                f"#   net {name.removeprefix(f'{COMPONENT}-')}-feedback (the drive's position) "
                f"=> {name}.fb-in",
            )
            for name in offsets
        ),
        "# and the sensors, for example:",
        f"#   net column-temperature (a pin in °C) => {COMPONENT}.temperature.z-column",
        "# In the thread, update-feedback stands before motion-controller, and what writes to the",
        "# drives behind update-output.",
        f"loadrt lincurve names={','.join(names)} personality={points}",
        *([f"loadrt sum2 names={','.join(sums)}"] if sums else []),
        f"loadrt offset names={','.join(offsets)}",
        f"loadrt integ names={CLOCK}",
        *(f"addf {name}.update-feedback {THREAD} 1" for name in offsets),
        *(f"addf {name} {THREAD}" for name in chain(names, sums)),
        *(f"addf {name}.update-output {THREAD}" for name in offsets),
        f"addf {CLOCK} {THREAD}",
        f"setp {CLOCK}.in 1",
    ]
    for code, (_, along) in curves.items():
        lines += (
            f"setp {curve_name(code)}.x-val-{number:02d} {at * machine_units_per_mm:.9g}"
            for number, at in enumerate(nodes[along])
        )
    for axis in nodes:
        lines += _nets_of(axis, joints[axis], nodes)
    return "\n".join([*lines, start]) + "\n"


def _sums_of(axis: str, nodes: Nodes) -> list[str]:
    """Name what sums the curves that move an axis: one less than there are."""
    return [f"{COMPONENT}-sum-{axis}{part}" for part in "ab"[: len(nodes) - 1]]


def offset_names(axis: str, joints: Sequence[int]) -> list[str]:
    """Name the offset of each joint of an axis.

    >>> offset_names("y", [1, 2])
    ['thermap-y', 'thermap-y2']
    """
    return [f"{COMPONENT}-{axis}{number or ''}" for number in (0, *range(2, len(joints) + 1))]


def _nets_of(axis: str, joints: Sequence[int], nodes: Nodes) -> list[str]:
    """Join one axis: its position to the curves along it, and those that move it to its offsets."""
    curves = curves_between(nodes)
    along = [f"{curve_name(code)}.in" for code, (_, a) in curves.items() if a == axis]
    sum_so_far, *moving = (curve_name(code) for code, (m, _) in curves.items() if m == axis)
    name = f"{COMPONENT}-{axis}"
    offsets = offset_names(axis, joints)
    # All joints of an axis are commanded to the same position; the first one's says where it is.
    lines = [f"net {name}-nominal joint.{joints[0]}.pos-cmd => {' '.join(along)}"]
    for added, total in zip(moving, _sums_of(axis, nodes)):
        lines += [
            f"net {sum_so_far} {sum_so_far}.out => {total}.in0",
            f"net {added} {added}.out => {total}.in1",
        ]
        sum_so_far = total
    to_offsets = " ".join(f"{offset}.offset" for offset in offsets)
    lines.append(f"net {name}-offset {sum_so_far}.out => {to_offsets}")
    for offset, joint in zip(offsets, joints):
        lines += [
            f"net {offset}-commanded joint.{joint}.motor-pos-cmd => {offset}.in",
            f"net {offset}-actual {offset}.fb-out => joint.{joint}.motor-pos-fb",
        ]
    return lines
