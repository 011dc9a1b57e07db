"""Readers that know nothing of ours: what a controller makes of the files, to the micrometre.

They follow the controllers' own rules as they are documented or were measured, and share no code
with the parsers.
"""

import bisect
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.controllers.curve import difference
from app.controllers.export import export
from app.controllers.registry import format_named
from tests.controllers.example_tables import curve, curves, error_table, options_for


def linear(nodes, values, at):
    """Linear between nodes, the end values beyond."""
    if at <= nodes[0]:
        return values[0]
    if at >= nodes[-1]:
        return values[-1]
    i = bisect.bisect_right(nodes, at) - 1
    share = (at - nodes[i]) / (nodes[i + 1] - nodes[i])
    return values[i] + share * (values[i + 1] - values[i])


class LinuxCncJoint:
    """A joint as LinuxCNC 2.9 loads it: it ends reading where a line is not three numbers."""

    def __init__(self, content, kind):
        self.nominal, self.trims = [], ([], [])
        for line in content.splitlines():
            numbers = re.match(r"\s*(\S+)\s+(\S+)\s+(\S+)", line)
            try:
                nominal, forward, reverse = (float(n) for n in numbers.groups())
            except (AttributeError, ValueError):
                break
            if len(self.nominal) == 256 or (self.nominal and nominal <= self.nominal[-1]):
                continue
            self.nominal.append(nominal)
            shift = nominal if kind == 0 else 0.0
            sign = -1.0 if kind == 0 else 1.0
            self.trims[0].append(sign * (forward - shift))
            self.trims[1].append(sign * (reverse - shift))

    def motor(self, command, direction):
        return command + linear(self.nominal, self.trims[direction == "-"], command)


@given(exx=curves("EXX"), kind=st.sampled_from([0, 1]), at=st.floats(-2000, 2000))
def test_linuxcnc_adds_minus_the_error(exx, kind, at):
    found = export(format_named("linuxcnc"), error_table(exx), options_for("linuxcnc", type=kind))
    joint = LinuxCncJoint(found.files[0].content, kind)
    assert len(joint.nominal) == exx.positions_mm.size
    for direction in "+-":
        expected = -exx.at(np.array([at]), direction)[0]
        assert (joint.motor(at, direction) - at) * 1000.0 == pytest.approx(expected, abs=2e-3)


def test_linuxcnc_has_all_of_a_table_that_is_too_long():
    at = np.linspace(-500.0, 500.0, 900)
    wave = curve("EXX", at, 40.0 * np.sin(at / 80.0))
    found = export(format_named("linuxcnc"), error_table(wave), options_for("linuxcnc"))
    joint = LinuxCncJoint(found.files[0].content, 1)
    assert len(joint.nominal) == len(found.files[0].content.splitlines()) <= 256
    (stated,) = found.resampling
    off = [(joint.motor(p, "+") - p) * 1000.0 + wave.at(np.array([p]))[0] for p in at]
    assert 0.0 < max(map(abs, off)) <= stated.largest_deviation + 2e-3 < 0.1


def siemens_memory(content):
    """Assignments into a memory that held something else: a gap keeps 9.9 mm."""
    memory = {}
    program = [line.partition(";")[0].strip() for line in content.splitlines()]
    program = [line for line in program if line]
    assert program[-1] == "M17"
    for line in program:
        found = re.fullmatch(r"\$(\w+)\[(.+)\]=(.+)", line)
        if found:
            memory[found[1], found[2]] = found[3]
    return memory


def cec_tables(memory):
    """Every table: input and output axis, direction, and its function of the input axis."""
    for number in sorted({i for (name, i) in memory if name == "AN_CEC_STEP"}, key=int):
        step, low, high = (float(memory[f"AN_CEC_{n}", number]) for n in ("STEP", "MIN", "MAX"))
        count = (high - low) / step + 1.0
        assert count == pytest.approx(round(count), abs=1e-9)
        nodes = [low + i * step for i in range(round(count))]
        values = [float(memory.get(("AN_CEC", f"{number},{i}"), 9.9)) for i in range(len(nodes))]
        assert memory["AN_CEC_MULT_BY_TABLE", number] == memory["AN_CEC_IS_MODULO", number] == "0"
        yield (
            memory["AN_CEC_INPUT_AXIS", number],
            memory["AN_CEC_OUTPUT_AXIS", number],
            int(memory["AN_CEC_DIRECTION", number]),
            lambda at, nodes=nodes, values=values: linear(nodes, values, at),
        )


@given(
    exx=curves("EXX"),
    eyx=curves("EYX"),
    eyz=curves("EYZ"),
    at=st.floats(-1500, 1500),
    sign=st.sampled_from(["error", "compensation"]),
)
def test_siemens_cec_tables_add_up_to_the_curves(exx, eyx, eyz, at, sign):
    found = export(
        format_named("siemens-cec"),
        error_table(exx, eyx, eyz, curve("SYZ", [], [20.0])),
        options_for("siemens-cec", sign=sign, axes={"x": "AX1", "y": "AX2", "z": "AX5"}),
    )
    tables = list(cec_tables(siemens_memory(found.files[0].content)))
    stated = {one.component: one.largest_deviation for one in found.resampling}
    held = {one.code: one for one in found.loaded}
    factor = 1000.0 if sign == "error" else -1000.0
    for code, pair in {"EXX": "11", "EYX": "12", "EYZ": "52"}.items():
        names = tuple(f"(AX{n})" for n in pair)
        for direction, way in (("+", 1), ("-", -1)):
            sums = sum(f(at) for a, b, d, f in tables if (a, b) == names and d in (0, way))
            assert sums * factor == pytest.approx(
                held[code].at(np.array([at]), direction)[0], abs=1e-6
            )
    wanted = exx.at(np.array([at]))[0]
    assert abs(held["EXX"].at(np.array([at]))[0] - wanted) <= stated["EXX"] + 1e-6 or not (
        exx.positions_mm[0] <= at <= exx.positions_mm[-1]
    )
    # Squareness of 20 µm/m is in the straightness of y along z.
    z = np.array([100.0])
    folded = eyz.at(z)[0] + 20.0 * z[0] / 1000.0
    assert held["EYZ"].at(z)[0] == pytest.approx(folded, abs=stated["EYZ"] + 1e-6)


@given(exx=curves("EXX", directions=False), at=st.floats(-1500, 1500))
def test_siemens_encoder_compensation_subtracts_what_it_holds(exx, at):
    found = export(
        format_named("siemens-enc-comp"), error_table(exx), options_for("siemens-enc-comp")
    )
    memory = siemens_memory(found.files[0].content)
    step, low, high = (float(memory[f"AA_ENC_COMP_{n}", "0,X1"]) for n in ("STEP", "MIN", "MAX"))
    count = round((high - low) / step) + 1
    assert low + (count - 1) * step == pytest.approx(high, abs=1e-9)
    assert count <= 200
    nodes = [low + i * step for i in range(count)]
    values = [float(memory.get(("AA_ENC_COMP", f"0,{i},X1"), 9.9)) for i in range(count)]
    assert linear(nodes, values, 0.0) == pytest.approx(0.0, abs=1e-9)  # at the reference point
    (stated,) = found.resampling
    shift = exx.at(np.zeros(1))[0]
    if exx.positions_mm[0] <= at <= exx.positions_mm[-1]:
        # A positive value moves the axis in the negative direction: it takes the error away.
        left = exx.at(np.array([at]))[0] - shift - linear(nodes, values, at) * 1000.0
        assert abs(left) <= stated.largest_deviation + 1e-6


def test_siemens_temperature_compensation_leaves_what_it_says():
    exx = curve("EXX", [0.0, 250.0, 500.0], [10.0, 20.0, 40.0])
    options = options_for("siemens-temperature", reference_position_mm={"x": 100.0})
    found = export(format_named("siemens-temperature"), error_table(exx), options)
    memory = siemens_memory(found.files[0].content)
    k0, slope, p0 = (
        float(memory[f"SA_TEMP_COMP_{n}", "X1"]) for n in ("ABS_VALUE", "SLOPE", "REF_POSITION")
    )
    assert p0 == 100.0
    at = np.linspace(0.0, 500.0, 2001)
    left = exx.at(at) + 1000.0 * (k0 + slope * (at - p0))
    (stated,) = found.resampling
    assert np.abs(left).max() == pytest.approx(stated.largest_deviation, abs=1e-6)
    assert np.sqrt((left**2).mean()) == pytest.approx(
        difference(found.loaded[0], exx).rms, rel=2e-3
    )
    # No other line is better: the least squares of so many points.
    assert (slope * -1000.0, 3.0) == pytest.approx(
        (np.polyfit(at, exx.at(at), 1)[0], 3.0), rel=1e-3
    )
