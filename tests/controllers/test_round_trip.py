"""What is written is read back: every format, bounded by its own resolution."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.controllers.curve import difference
from app.controllers.export import export, wanted_of
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

SIGNED = [name for name, one in FORMATS.items() if one.sign is None]


def test_every_format_is_registered_under_its_name():
    assert [one.name for one in FORMATS.values()] == list(FORMATS)
    assert set(NEEDED) == set(FORMATS)


@pytest.mark.slow
@pytest.mark.parametrize("name", FORMATS)
@given(table=tables(), sign=st.sampled_from(["error", "compensation"]))
def test_files_are_read_back_as_they_were_meant(name, table, sign):
    controller = format_named(name)
    options = options_for(name, **({"sign": sign} if name in SIGNED else {}))
    found = export(controller, table, options)
    read = read_back(name, found, options)
    wanted = wanted_of(controller, table, options).table
    stated = {one.component: one.difference for one in found.resampling}
    held = {one.code: one for one in found.held}
    assert set(held) == set(stated) == set(wanted.curves)
    for code, one in held.items():
        parsed = read.curves[code]
        at = one.positions_mm if one.positions_mm.size else np.zeros(1)
        # The files say what the export says that the controller holds, to a thousandth nm.
        for direction in "+-":
            assert parsed.at(at, direction) == pytest.approx(one.at(at, direction), abs=1e-6)
        target = wanted.curves[code]
        if one.backward_errors is None:
            target = target.mean()
        assert abs(difference(parsed, target).largest) <= abs(stated[code].largest) + 1e-6
    assert read.machine in (None, "mcfv5050")


@pytest.mark.parametrize("name", [n for n in FORMATS if n != "siemens-temperature"])
def test_where_nothing_is_resampled_rounding_alone_is_left(name):
    at = np.arange(-5, 6) * 2.0**16 * 1e-4  # every format can lay its grid there
    table = error_table(curve("EXX", at, 30 * np.sin(np.arange(11)) - 30 * np.sin(5)))
    options = options_for(name, **({"magnification": 10} if name == "fanuc" else {}))
    if name == "fanuc":
        at = np.arange(-5, 6) * 50.0
        table = error_table(curve("EXX", at, 30 * np.sin(np.arange(11)) - 30 * np.sin(5)))
    found = export(format_named(name), table, options)
    (one,) = found.resampling
    assert abs(one.difference.largest) <= format_named(name).resolution(options) / 2 + 1e-9


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
