"""Steps of a stream that limits them, between tables of other positions, directions, components."""

import json
from datetime import UTC, datetime
from itertools import count, pairwise

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from app.api.streamed_table import Feed, Table
from app.api.streams import STEP_S, Follower, Wanted
from app.api.table_json import current_table_json
from app.compensation.table import Basis, CompensationTable, ComponentCompensation
from app.compensation.table_steps import curves_of
from app.geometry.components import COMPONENTS
from app.rounding import DECIMALS
from app.services.live_table import CurrentState, CurrentTable
from app.thermal.reading import Reading

NOW = datetime(2026, 1, 1, tzinfo=UTC)
CODES = ("EXX", "EYX", "EBX", "SXY")
BASIS = Basis("x-middle", 21.0, "Run #1", "Run #3", 0.5, "interpolated")
EVERYWHERE_MM = np.arange(-50.0, 650.0, 10.0)


def entry(code, positions_mm, errors, backward_errors=None):
    backward = None if backward_errors is None else np.array(backward_errors, dtype=float)
    return ComponentCompensation(
        COMPONENTS[code],
        np.array(positions_mm, dtype=float),
        np.array(errors, dtype=float),
        backward,
        standard_errors=np.full(len(errors), 0.1),
        backward_standard_errors=None,
        basis=BASIS,
    )


def told(number, *entries):
    """A table as a feed has it."""
    table = CompensationTable("m", 3, NOW, True, [], [], entries)
    state = CurrentState(None, Reading(NOW, {}, {}), 0.0, [], None, (), False, (), "")
    current = CurrentTable(table, state)
    facts = (number,)
    return Table(number, curves_of(entries, DECIMALS), facts, current_table_json(current), current)


def followed(tables, **wanted):
    """What a follower is sent of tables, each of which comes some seconds after the other."""
    feed, numbers = Feed("m"), count(1000)
    follower = Follower(Wanted(kinds=frozenset({"table"}), **wanted), feed)
    contents, now_s = [], 0.0
    for after_s, table in tables:
        feed.table = table
        until_s = now_s + after_s
        while now_s <= until_s or (table is tables[-1][1] and follower.is_stepping):
            due = follower.due(feed, now_s, lambda: next(numbers))
            contents += [json.loads(content) for _, _, content in due]
            now_s += STEP_S
            assert len(contents) < 10_000, "it never arrives"
    return contents


def curve(content, code, side):
    """What a controller adds everywhere: straight between positions, 0 without the component."""
    (component,) = [c for c in content["components"] if c["component"] == code] or [None]
    if component is None:
        return np.zeros(EVERYWHERE_MM.size)
    unit = COMPONENTS[code].unit
    values = component.get(f"{side}compensation_{unit}", component[f"compensation_{unit}"])
    if "positions_mm" not in component:
        return np.full(EVERYWHERE_MM.size, values)
    return np.interp(EVERYWHERE_MM, component["positions_mm"], values)


def largest_step(contents):
    return max(
        np.abs(curve(after, code, side) - curve(before, code, side)).max()
        for before, after in pairwise(contents)
        for code in CODES
        for side in ("", "backward_")
    )


def test_steps_between_maps_of_other_positions():
    before = told(1, entry("EXX", [0, 250, 500], [0.0, 10.0, 10.0]))
    after = told(2, entry("EXX", [0, 100, 400, 600], [0.0, 30.0, 30.0, 30.0]))
    contents = followed([(0, before), (0, after)], max_step=2.0)
    assert contents[1]["stepping"] is True
    assert [c["compensation_um"][0] for c in contents[-1]["components"]] == [0.0]
    # At X 100 from 4 to 30 µm, in 13 steps.
    assert len(contents) == 1 + 13
    assert largest_step(contents) <= 2.0 + 1e-9
    assert contents[-1] == json.loads(after.content) | {"stepping": False}
    assert "standard_errors_um" not in contents[1]["components"][0]


def test_a_component_that_goes_and_one_that_comes_do_so_in_steps():
    before = told(1, entry("EXX", [0, 500], [0.0, 10.0]))
    after = told(2, entry("EYX", [0, 500], [0.0, -10.0], [0.0, 6.0]))
    contents = followed([(0, before), (0, after)], max_step=5.0)
    codes = [[c["component"] for c in content["components"]] for content in contents]
    assert codes == [["EXX"], ["EXX", "EYX"], ["EYX"]]
    assert contents[1]["components"][1]["backward_errors_um"] == [0.0, 3.0]


def test_words_that_change_bring_no_value_that_jumps():
    """`state` says what changed beside the values, and sends these too."""
    before = told(1, entry("EXX", [0, 500], [0.0, 10.0]))
    after = told(2, entry("EXX", [0, 500], [0.0, 14.0]))
    contents = followed([(0, before), (0, after)], min_change=5.0, max_step=1.0)
    assert largest_step(contents) <= 1.0 + 1e-9
    assert contents[-1] == json.loads(after.content) | {"stepping": False}


@st.composite
def tables(draw):
    """Some components over any positions, in one direction or both."""
    errors = st.one_of(st.floats(-40.0, 40.0), st.sampled_from([0.0, 1e-5, -30.0, 30.0]))
    entries = []
    for code in draw(st.lists(st.sampled_from(CODES), unique=True)):
        positions, n = [], 1
        if COMPONENTS[code].is_table:
            inner = st.lists(st.integers(1, 59).map(lambda i: 10 * i), unique=True, max_size=5)
            positions = sorted({draw(st.sampled_from([0, 100])), *draw(inner)})
            n = len(positions)
        sides = [draw(st.lists(errors, min_size=n, max_size=n)) for _ in range(2)]
        is_bidirectional = bool(positions) and draw(st.booleans())
        entries.append(entry(code, positions, sides[0], sides[1] if is_bidirectional else None))
    return entries


@given(
    st.lists(st.tuples(st.integers(0, 6), tables()), min_size=2, max_size=4),
    st.sampled_from([1.5, 7.3]),
    st.sampled_from([0.0, 0.1, 3.0]),
)
def test_no_value_at_any_position_jumps_and_all_arrive(sequence, limit, min_change):
    sent = [(after_s, told(i, *entries)) for i, (after_s, entries) in enumerate(sequence, 1)]
    contents = followed(sent, max_step=limit, min_change=min_change)
    assert largest_step(contents) <= limit + 1e-9
    assert contents[-1] == json.loads(sent[-1][1].content) | {"stepping": False}


def test_even_the_smallest_limit_arrives():
    before = told(1, entry("EXX", [0, 500], [0.0, 10.0]))
    after = told(2, entry("EXX", [0, 400, 500], [0.0, 8.05, 10.1]))
    contents = followed([(0, before), (0, after)], max_step=0.001)
    assert contents[-1] == json.loads(after.content) | {"stepping": False}
    assert largest_step(contents) <= 0.001 + 1e-9
