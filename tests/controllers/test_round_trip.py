"""What is written is read back: every format, bounded by its own resolution."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.controllers.curve import difference
from app.controllers.export import export, wanted_of
from app.controllers.read import read_files
from app.controllers.registry import FORMATS, format_named, options_of
from app.errors import InvalidContent
from tests.controllers.example_tables import (
    NEEDED,
    curve,
    error_table,
    options_for,
    read_back,
    tables,
)

MINUS_ZERO = re.compile(r"(?m)^.*(?<![\w.)])[-−](?:0+(?:\.0*)?|\.0+)(?![\d.\w]).*$")

SIGNED = [name for name, one in FORMATS.items() if one.sign is None]


def test_every_format_is_registered_under_its_name():
    assert [one.name for one in FORMATS.values()] == list(FORMATS)
    assert set(NEEDED) == set(FORMATS)


REFERENCES = st.dictionaries(st.sampled_from("xyz"), st.integers(-500, 500).map(float))
SIGNS = st.sampled_from(["error", "compensation"])
OPTIONS = {
    "linuxcnc": st.fixed_dictionaries(
        {},
        optional={
            "type": st.sampled_from([0, 1]),
            "linear_units": st.sampled_from(["mm", "inch"]),
            "joints": st.sampled_from([{"x": 3, "y": 0, "z": 1}, {"x": [0, 1], "y": 2, "z": 3}]),
        },
    ),
    "siemens-cec": st.fixed_dictionaries(
        {"sign": SIGNS},
        optional={
            "axes": st.just({"x": "AX1", "y": "AX9", "z": "AX2"}),
            "first_table": st.integers(0, 20),
            "decimals": st.integers(3, 7),
            "most_points": st.integers(30, 200),
        },
    ),
    "siemens-enc-comp": st.fixed_dictionaries(
        {},
        optional={"encoder": st.just(1), "reference_mm": REFERENCES, "decimals": st.integers(3, 7)},
    ),
    "siemens-temperature": st.fixed_dictionaries(
        {"sign": SIGNS}, optional={"reference_position_mm": REFERENCES}
    ),
    "fanuc": st.fixed_dictionaries(
        {"sign": SIGNS},
        optional={
            "numbers": st.just({"x": 2, "y": 5, "z": 1}),
            "reference_mm": REFERENCES,
            "detection_unit_um": st.sampled_from([0.1, 0.5, 1.0]),
            "interval_unit_um": st.sampled_from([1.0, 10.0]),
            "largest_increment": st.just(127),
        },
    ),
    "heidenhain": st.fixed_dictionaries(
        {"sign": SIGNS}, optional={"columns": st.just({"x": 2, "y": 1, "z": 3})}
    ),
    "mdsi": st.fixed_dictionaries(
        {"sign": SIGNS, "counts_per_mm": st.sampled_from([1000.0, 81_920.0, 100_000.0])}
    ),
    "fagor": st.fixed_dictionaries({}, optional={"reference_mm": REFERENCES}),
    "etalon": st.just({}),
    "isg-csv": st.just({}),
    "csv": st.just({}),
}
"""What may be stated of each format."""


def assert_no_minus_zero(files):
    for file in files:
        assert not MINUS_ZERO.findall(file.content), file.content


@pytest.mark.parametrize("tiny", [1e-12, 4e-5, 0.0])
@pytest.mark.parametrize("name", FORMATS)
def test_no_file_has_a_minus_zero(name, tiny):
    small = [-tiny, tiny, -tiny, 3.0]
    at = [-100.0, -0.0, 100.0, 200.0]
    table = error_table(
        curve("EXX", at, small, [-v for v in small]),
        *(curve(code, at, small) for code in ("EYX", "EYY", "EZZ", "EBX")),
        curve("SXY", [], [-tiny]),
    )
    for sign in ("error", "compensation"):
        options = NEEDED[name] | ({"sign": sign} if name in SIGNED else {})
        found = export(format_named(name), table, options_of(format_named(name), options))
        assert len(found.files) > 1
        assert_no_minus_zero(found.files)


@pytest.mark.slow
@pytest.mark.parametrize("name", FORMATS)
@given(data=st.data(), table=tables(), axes=st.sampled_from(["xyz", "xz", "xy", "x"]),
       factor=st.sampled_from([1.0, 120.0]))  # fmt: skip
def test_files_are_read_back_as_they_were_meant(name, data, table, axes, factor):
    """Of whatever machine and with whatever options, which the files themselves say."""
    controller = format_named(name)
    stated = data.draw(OPTIONS[name])
    table = of_machine(table, axes, factor)
    options = options_of(controller, stated)
    try:
        found = export(controller, table, options)
    except InvalidContent:
        return
    assert_no_minus_zero(found.files)
    written_with, read = read_files(controller, found.files, {})
    for option in stated.keys() - controller.options.layout:
        assert getattr(written_with, option) == getattr(options, option)
    assert read.machine == "mcfv5050"
    wanted = wanted_of(controller, table, options).table
    differences = {one.component: one.largest_deviation for one in found.resampling}
    held = {one.code: one for one in found.loaded}
    assert set(held) == set(differences) == set(wanted.curves)
    for code, one in held.items():
        parsed = read.curves[code]
        at = one.positions_mm if one.positions_mm.size else np.zeros(1)
        # The files say what the export says that the controller holds, to a thousandth nm.
        for direction in "+-":
            assert parsed.at(at, direction) == pytest.approx(one.at(at, direction), abs=1e-6)
        off = abs(difference(parsed, wanted.curves[code]).largest)
        assert off <= differences[code] + 1e-6
        moved = {one.component.direction, one.component.axis} & set("xyz")
        assert moved <= set(axes)


def of_machine(table, axes, factor):
    """The same errors, so many times as large, of a machine with these axes."""
    curves = {
        code: replace(
            one,
            errors=one.errors * factor,
            backward_errors=None if one.backward_errors is None else one.backward_errors * factor,
        )
        for code, one in table.curves.items()
    }
    ranges = {axis: ends for axis, ends in table.ranges_mm.items() if axis in axes}
    return replace(
        table, origin=replace(table.origin, axes=tuple(axes)), curves=curves, ranges_mm=ranges
    )


RESOLUTIONS_UM = {
    **dict.fromkeys(("siemens-cec", "siemens-enc-comp", "fagor"), 0.1),
    **dict.fromkeys(("etalon", "isg-csv", "csv"), 1e-6),
    **{"linuxcnc": 1e-3, "fanuc": 10.0, "heidenhain": 0.01, "mdsi": 0.01},
}
"""Smallest difference of two values, with the options of the test."""


@pytest.mark.parametrize("name", RESOLUTIONS_UM)
def test_where_nothing_is_resampled_rounding_alone_is_left(name):
    at = np.arange(-5, 6) * 2.0**16 * 1e-4  # every format can lay its grid there
    table = error_table(curve("EXX", at, 30 * np.sin(np.arange(11)) - 30 * np.sin(5)))
    options = options_for(name, **({"magnification": 10} if name == "fanuc" else {}))
    if name == "fanuc":
        at = np.arange(-5, 6) * 50.0
        table = error_table(curve("EXX", at, 30 * np.sin(np.arange(11)) - 30 * np.sin(5)))
    found = export(format_named(name), table, options)
    (one,) = found.resampling
    assert one.largest_deviation <= RESOLUTIONS_UM[name] / 2 + 1e-9


@pytest.mark.parametrize("name", SIGNED)
def test_an_unverified_sign_has_to_be_stated(name):
    stated = {k: v for k, v in NEEDED[name].items() if k != "sign"}
    controller = format_named(name)
    with pytest.raises(InvalidContent, match=r"options\.sign: expected a value, got none"):
        options_of(controller, stated)


@pytest.mark.parametrize("name", SIGNED)
def test_the_other_sign_writes_the_other_sign(name):
    table = error_table(curve("EXX", [0.0, 100.0, 200.0], [0.0, 10.0, -20.0]))
    read = {}
    for sign in ("error", "compensation"):
        options = options_for(name, sign=sign)
        exported = export(format_named(name), table, options)
        # Read as errors, whatever they were written as.
        read[sign] = read_back(name, exported, options_for(name, sign="error")).curves["EXX"]
    at = np.array([0.0, 100.0, 200.0])
    assert read["compensation"].at(at) == pytest.approx(-read["error"].at(at), abs=1e-6)
    assert np.abs(read["error"].at(at)).max() > 5.0
