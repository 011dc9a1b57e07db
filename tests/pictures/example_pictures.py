"""Pictures of machines of every shape, and what a person reads off them."""

import numpy as np

from app.geometry.chain import Chain
from app.geometry.error_field import ErrorField
from app.geometry.error_table import Table
from app.geometry.work_volume import WorkVolume
from app.pictures.work_volume_picture import work_volume_picture
from tests.geometry.example_fields import random_field

CUBE = WorkVolume((0.0, 500.0), (0.0, 500.0), (0.0, 500.0))
MILL = WorkVolume((0.0, 500.0), (-200.0, 200.0), (-400.0, 0.0))
LATHE = WorkVolume((0.0, 300.0), (0.0, 0.0), (0.0, 3000.0))
GANTRY = WorkVolume((0.0, 30_000.0), (0.0, 4000.0), (-1500.0, 0.0))
PORTAL = WorkVolume((0.0, 2500.0), (0.0, 8000.0), (0.0, 1000.0))
LINE = WorkVolume((0.0, 500.0), (0.0, 0.0), (0.0, 0.0))
TURNING_CENTRE = WorkVolume((0.0, 300.0), (-100.0, 100.0), (0.0, 3000.0))
VOLUMES = {
    "cube": CUBE,
    "mill": MILL,
    "lathe": LATHE,
    "gantry": GANTRY,
    "portal": PORTAL,
    "line": LINE,
    "turning centre": TURNING_CENTRE,
    "plate": WorkVolume((-250.0, 250.0), (0.0, 500.0), (200.0, 200.0)),
    "wall": WorkVolume((10.0, 10.0), (0.0, 500.0), (0.0, 200.0)),
}

STRETCHED = ErrorField.make(Chain.parse("XYFZ"), {"EXX": Table([0.0, 500.0], [0.0, 40.0])})
"""X is 40 µm too long at its end, and nothing else is wrong."""

NO_ERRORS = ErrorField.make(Chain.parse("XYFZ"), {"EXX": Table([0.0, 500.0], [0.0, 0.0])})


def picture(field=STRETCHED, volume=CUBE, tool=(0.0, 0.0, 0.0), title="Mill 7", **wanted):
    return work_volume_picture(field, volume, tool, title=title, **wanted)


def random_picture(volume, seed=0, **wanted):
    return picture(random_field(seed=seed, high=3000.0), volume, (17.0, -29.0, 163.0), **wanted)


def trace(figure, name, kind="scatter3d"):
    """The trace of this name that draws something."""
    (found,) = (t for t in figure.data if t.name == name and t.type == kind and t.x[0] is not None)
    return found


def lines_of(found):
    """The trace's lines, each as its points (n, 3) [mm] and rows under the mouse (n, 7)."""
    coordinates = list(zip(found.x, found.y, found.z, strict=True))
    rows = found.customdata if found.customdata is not None else [None] * len(coordinates)
    lines = [([], [])]
    for point, row in zip(coordinates, rows, strict=True):
        if None in point:
            lines.append(([], []))
        else:
            lines[-1][0].append(point)
            lines[-1][1].append(row)
    return [(np.array(points), np.array(rows)) for points, rows in lines]
