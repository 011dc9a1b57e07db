"""Finding positions among nodes: numpy's bisection is the reference, whatever the spacing."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.geometry.axis_table import CLOSEST_MM, AxisTable, NodeSearch

EVEN = np.linspace(0.0, 500.0, 41)
UNEVEN = np.array([-300.0, -120.0, -119.0, 0.0, 7.5, 400.0])
# A nanometre beside half a kilometre: more buckets than there may be.
TOO_UNEVEN = np.array([0.0, 1e-6, 100.0, 5e5])
ALONE = np.array([50.0])


def expected(nodes, positions):
    count = np.searchsorted(nodes, positions, side="right")
    return count, positions - nodes[np.maximum(count - 1, 0)]


@pytest.mark.parametrize("nodes", [EVEN, UNEVEN, TOO_UNEVEN, ALONE], ids=str)
def test_every_position_is_found_as_by_bisection(nodes):
    rng = np.random.default_rng(1)
    around = np.concatenate([nodes, np.nextafter(nodes, -np.inf), np.nextafter(nodes, np.inf)])
    spread = rng.uniform(nodes[0] - 200.0, nodes[-1] + 200.0, 5000)
    positions = np.concatenate([around, spread, [-1e9, 1e9, 0.0, -0.0]])
    found = NodeSearch(nodes).locate(positions)
    count, beyond = expected(nodes, positions)
    np.testing.assert_array_equal(found.count, count)
    np.testing.assert_array_equal(found.beyond_mm, beyond)


def drawn_nodes(most_mm):
    """Whole multiples of CLOSEST_MM: nodes of a table are no closer to each other."""
    most = round(most_mm / CLOSEST_MM)
    return st.lists(st.integers(-most, most), min_size=1, max_size=30, unique=True)


@given(
    st.sampled_from([1e-4, 1.0, 1e6]).flatmap(drawn_nodes),
    st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=30),
)
def test_whatever_the_nodes_it_is_bisection(multiples, positions):
    nodes = np.sort(multiples) * CLOSEST_MM
    positions = np.concatenate([positions, nodes])
    found = NodeSearch(nodes).locate(positions)
    np.testing.assert_array_equal(found.count, expected(nodes, positions)[0])


def test_a_table_is_read_by_state_and_by_what_it_multiplies():
    own = np.zeros((2, 6, 2))
    own[:, 3] = [[0.0, 10.0], [100.0, 200.0]]
    table = AxisTable(np.array([0.0, 50.0]), {None: own, "y": 2.0 * own})
    located = table.locate(np.array([-5.0, 0.0, 20.0, 50.0, 60.0]))
    assert table.read(0, located)[None][3].tolist() == [0.0, 0.0, 4.0, 10.0, 10.0]
    assert table.read(1, located)[None][3].tolist() == [100.0, 100.0, 140.0, 200.0, 200.0]
    assert table.read(1, located)["y"][3].tolist() == [200.0, 200.0, 280.0, 400.0, 400.0]
    assert not table.read(1, located)["y"][:3].any()
