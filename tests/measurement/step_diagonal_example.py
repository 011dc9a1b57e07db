"""A machine with random errors at the nodes of its steps, and what its diagonals read."""

import numpy as np

from app.geometry.chain import Chain
from app.geometry.components import COMPONENTS, Kind
from app.geometry.error_field import ErrorField
from app.geometry.error_table import Table
from app.measurement.step_diagonal import step_diagonal

ORIGIN = np.array([100.0, -50.0, 20.0])
# Three different steps, so that no two directions are alike [mm].
STEP = np.array([50.0, 30.0, 40.0])
STEPS = 8
TOOL = (10.0, -20.0, 150.0)
CHAINS = ["FXYZ", "XFYZ", "XYFZ", "XYZF", "FYXZ"]

# How each diagonal runs, written out [V III E].
WAYS = {"ppp": (1, 1, 1), "npp": (-1, 1, 1), "pnp": (1, -1, 1), "ppn": (1, 1, -1)}

ANGULAR = [code for code, c in COMPONENTS.items() if c.kind is Kind.ANGULAR]
TRANSLATIONS = [
    c for c, found in COMPONENTS.items() if found.kind in (Kind.LINEAR, Kind.STRAIGHTNESS)
]
SQUARENESS = ["SXY", "SYZ", "SZX"]


def nodes(axis, steps=STEPS):
    u = "XYZ".index(axis.upper())
    return ORIGIN[u] + STEP[u] * np.arange(steps + 1)


def random_tables(seed, codes, size=5.0, steps=STEPS):
    rng = np.random.default_rng(seed)
    found = {}
    for code in codes:
        if code in SQUARENESS:
            found[code] = Table((), rng.normal(scale=4 * size))
        else:
            found[code] = Table(nodes(code[2], steps), rng.normal(scale=size, size=steps + 1))
    return found


def field_of(tables, chain="XYFZ", lines=None):
    return ErrorField.make(Chain.parse(chain), tables, lines)


def derive(readings, chain="XYFZ", **options):
    return step_diagonal(Chain.parse(chain), ORIGIN, STEP, readings, **options)


def errors_of(found):
    return {table.component.code: table.errors for table in found.result.tables}


def table_of(found, code):
    return next(t for t in found.result.tables if t.component.code == code)


def about_its_line(positions, values, line):
    """What is left about a line, and its slope [µm/m]."""
    ends = slice(None) if line == "least-squares" else [0, -1]
    slope, start = np.polyfit(positions[ends], values[ends], 1)
    return values - slope * positions - start, slope * 1000.0


def expected_errors(tables, line="end-points"):
    """The twelve sets of errors, as far as they are more than the choice of coordinates."""
    found = {}
    slopes = {}
    for code in TRANSLATIONS:
        positions, values = (np.asarray(a) for a in tables[code])
        found[code] = values - values[0]
        if code[1] != code[2]:
            found[code], slopes[code] = about_its_line(positions, values, line)
    for a, b in ("XY", "YZ", "ZX"):
        own = float(tables.get(f"S{a}{b}", Table((), 0.0)).values)
        found[f"S{a}{b}"] = own + slopes[f"E{a}{b}"] + slopes[f"E{b}{a}"]
    return found


def increments_by_hand(readings):
    """[V III I]: what each axis added in each of its intervals, signed as [V 6] has it."""
    found = {}
    for diagonal, rows in readings.items():
        before = 0.0
        for step, row in enumerate(np.asarray(rows)):
            for u, reading in enumerate(row):
                way = WAYS[diagonal][u]
                interval = step if way > 0 else len(rows) - 1 - step
                found[diagonal, u, interval] = way * (reading - before)
                before = reading
    return found
