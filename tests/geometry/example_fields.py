"""Fields with random tables, and the exact motion that they are the first order of."""

import numpy as np
from scipy.spatial.transform import Rotation

from app.geometry.body_diagonal import DIAGONALS, diagonal_ends, displacement_along
from app.geometry.chain import Chain
from app.geometry.components import COMPONENTS, Kind
from app.geometry.error_field import ErrorField
from app.geometry.error_table import Table
from app.geometry.measuring_line import MeasuringLine
from app.geometry.volumetric_error import NO_TOOL

RIGID = {Kind.LINEAR, Kind.STRAIGHTNESS, Kind.ANGULAR, Kind.SQUARENESS}
NONRIGID = RIGID | {Kind.SLOPE}
TRANSLATIONS = {Kind.LINEAR, Kind.STRAIGHTNESS, Kind.SQUARENESS}

TOOL = (17.0, -29.0, 163.0)
LINES = {
    "x": MeasuringLine((0.0, 250.0, 100.0), (3.0, -5.0, 40.0)),
    "y": MeasuringLine((-120.0, 0.0, 310.0)),
    "z": MeasuringLine((75.0, -45.0, 0.0), (0.0, 0.0, 160.0)),
}


def codes_of(kinds):
    return [code for code, component in COMPONENTS.items() if component.kind in kinds]


def random_table(rng, code, positions=8, low=0.0, high=500.0):
    """Unevenly spaced, in a range of its own; like a thermal map in size."""
    if COMPONENTS[code].axis is None:
        return Table((), rng.normal(scale=20.0))
    spread = np.sort(rng.choice(np.arange(low, high + 1.0, 7.0), positions, replace=False))
    return Table(spread, rng.normal(scale=10.0, size=positions))


def random_field(chain="XYFZ", kinds=RIGID, seed=0, lines=None, **table):
    rng = np.random.default_rng(seed)
    tables = {code: random_table(rng, code, **table) for code in codes_of(kinds)}
    return ErrorField.make(Chain.parse(chain), tables, lines)


def constant_field(chain, errors, lines=None):
    """Errors that do not depend on position."""
    tables = {code: Table((), value) for code, value in errors.items()}
    return ErrorField.make(Chain.parse(chain), tables, lines)


def values_at(field, points):
    """Every component at every point, one np.interp each."""
    return {
        code: np.interp(points[:, "xyz".index(COMPONENTS[code].axis)], positions, values[0])
        if positions.size > 1
        else values[0, 0]
        for code, (positions, values) in field.tables.items()
    }


def values_at_one(field, point):
    """Every component at one point, as numbers."""
    return {code: np.ravel(v)[0] for code, v in values_at(field, np.array([point])).items()}


def exact_position(chain, values, point, tool):
    """The product of homogeneous transformations from the tool to the workpiece [mm].

    A workpiece-side axis shifts what it carries and turns it then (8.64: RI(x)X); a
    tool-side axis turns and shifts then. Squareness is in straightness (8.58-8.60).
    """
    straight = dict(values)
    for code, by in (("SXY", "EXY"), ("SZX", "EXZ"), ("SYZ", "EYZ")):
        along = point["xyz".index(by[2].lower())]
        straight[by] = straight.get(by, 0.0) + values.get(code, 0.0) * along / 1000.0
    before, _, after = chain.lower().partition("f")
    product = np.eye(4)
    for u in reversed(before):
        product = product @ turn(straight, u) @ shift(straight, point, u)
    for u in after:
        product = product @ shift(straight, point, u) @ turn(straight, u)
    return (product @ [*tool, 1.0])[:3]


def turn(values, u):
    found = np.eye(4)
    angles = [values.get(f"E{about}{u.upper()}", 0.0) * 1e-6 for about in "ABC"]
    found[:3, :3] = Rotation.from_rotvec(angles).as_matrix()
    return found


def shift(values, point, u):
    found = np.eye(4)
    found["xyz".index(u), 3] = point["xyz".index(u)]
    found[:3, 3] += [values.get(f"E{way}{u.upper()}", 0.0) / 1000.0 for way in "XYZ"]
    return found


def diagonal_displacements(field, volume, steps=20, tool_offset_mm=NO_TOOL):
    """The volumetric error itself along each body diagonal, since its start [µm]."""
    shares = np.linspace(0.0, 1.0, steps + 1)[:, None]
    found = {}
    for diagonal in DIAGONALS:
        start, end = diagonal_ends(volume, diagonal)
        errors_um, _ = field.at(start + shares * (end - start), tool_offset_mm)
        found[diagonal] = displacement_along(errors_um, end - start)
    return found
