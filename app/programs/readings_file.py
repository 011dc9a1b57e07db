"""Heads of the empty files that readings are filled into."""

from __future__ import annotations

from app.thermal.machine import Machine


def map_head(machine: Machine) -> list[str]:
    """Write the comment lines that a measured error map needs, to be filled in.

    Returns
    -------
    list of str
        Label, time and each sensor's temperature are empty: the file is refused until they
        are stated there or as options.
    """
    return [
        "# Fill in what is empty, one reading a line, in the order in which they are read",
        "# label: ",
        f"# machine: {machine.id}",
        "# measured_at: ",
        *(f"# temperature {sensor}: " for sensor in machine.sensors),
    ]
