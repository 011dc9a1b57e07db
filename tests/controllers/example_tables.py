"""Errors of an example machine as they go into files, and random ones."""

from datetime import UTC, datetime

import numpy as np
from hypothesis import strategies as st

from app.arrays import frozen
from app.controllers.curve import Curve
from app.controllers.error_table import TRANSLATIONS, ErrorTable, Origin
from app.controllers.format import CHECK_FILE
from app.controllers.registry import format_named, options_of
from app.geometry.components import COMPONENTS

ORIGIN = Origin(
    "mcfv5050",
    "MCFV5050LN",
    3,
    datetime(2026, 3, 1, 6, 0, tzinfo=UTC),
    {"x-middle": 25.5, "z-column": 29.0},
)

NEEDED = {
    "linuxcnc": {},
    "siemens-cec": {"sign": "error"},
    "siemens-enc-comp": {},
    "siemens-temperature": {"sign": "compensation"},
    "fanuc": {"sign": "error"},
    "heidenhain": {"sign": "compensation"},
    "mdsi": {"sign": "error", "counts_per_mm": 100_000.0},
    "fagor": {},
    "etalon": {},
    "isg-csv": {},
    "csv": {},
}
"""Options that each format cannot do without."""


def curve(code, positions_mm, errors, backward=None):
    return Curve(
        COMPONENTS[code],
        frozen(positions_mm)[: len(positions_mm)],
        frozen(errors),
        None if backward is None else frozen(backward),
    )


def error_table(*curves, ranges_mm=None, sizes_um=None):
    """A table of these curves; every axis goes from -1000 to 1000 mm where nothing is said."""
    return ErrorTable(
        ORIGIN,
        {one.code: one for one in curves},
        {one.code: "interpolated" for one in curves},
        dict.fromkeys("xyz", (-1000.0, 1000.0)) if ranges_mm is None else ranges_mm,
        {one.code: float(np.abs(one.errors).max()) for one in curves} | (sizes_um or {}),
    )


def options_for(controller, **more):
    return options_of(format_named(controller), NEEDED[controller] | more)


def read_back(name, exported, options):
    """Parse what was exported, without the check table."""
    files = [file for file in exported.files if file.name != CHECK_FILE]
    return format_named(name).parse(files, options)


@st.composite
def curves(draw, code, directions=True):
    """A curve on uneven or even positions, with one or two directions."""
    gaps = draw(
        st.one_of(
            st.lists(st.integers(1, 500), min_size=1, max_size=12),
            st.tuples(st.integers(1, 500), st.integers(1, 12)).map(lambda g: [g[0]] * g[1]),
        )
    )
    start = draw(st.integers(-9000, 2000))
    # At least 50 mm long: no machine is wrong by more than 10 µm/mm.
    gaps = [gaps[0] + 500, *gaps[1:]]
    at = (start + np.concatenate([[0], np.cumsum(gaps)])) / 10.0
    values = st.lists(st.floats(-100, 100, allow_nan=False), min_size=at.size, max_size=at.size)
    backward = draw(values) if directions and draw(st.booleans()) else None
    return curve(code, at, draw(values), backward)


@st.composite
def tables(draw, codes=TRANSLATIONS):
    """A table of some components, at least EXX."""
    chosen = draw(st.sets(st.sampled_from(codes), max_size=4)) | {"EXX"}
    found = [draw(curves(code)) for code in COMPONENTS if code in chosen]
    if draw(st.booleans()):
        found.append(curve("SXY", [], [draw(st.floats(-50, 50))]))
    return error_table(*found)
