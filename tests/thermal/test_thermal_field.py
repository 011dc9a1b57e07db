"""The field at a thermal state is what predictions say at its points."""

import numpy as np
import pytest

from app.geometry.error_field import ErrorField
from app.thermal.compile_model import compile_model
from app.thermal.prediction import predict_points
from app.thermal.thermal_field import thermal_tables
from tests.thermal.example_maps import machine
from tests.thermal.test_prediction import rich_maps


def thermal_field(model, states, directions):
    tables = thermal_tables(states, directions)
    return ErrorField.make(model.machine.chain, tables, model.measuring_lines)


TOOL = (10.0, -20.0, 160.0)
STATES = [
    {"x-middle": x, "y-front": x - 1.0, "z-column": z, "spindle": 2 * x}
    for x, z in ((20.0, 23.0), (22.5, 31.0), (31.0, 25.0), (60.0, 34.0))
]


@pytest.fixture(scope="module")
def model():
    return compile_model(machine(), rich_maps(np.random.default_rng(8)), {})


@pytest.mark.parametrize("directions", [(0, 0, 0), (1, 1, 1), (-1, 1, 0)])
def test_it_is_the_prediction_at_every_point_and_state(model, directions):
    points = np.random.default_rng(9).uniform(0.0, 500.0, (40, 3))
    field = thermal_field(model, [model.errors_at(t) for t in STATES], directions)
    together, _ = field.at(points, TOOL)
    assert together.shape == (4, 40, 3)
    for i, state in enumerate(STATES):
        expected = predict_points(
            model,
            {name: np.full(40, t) for name, t in state.items()},
            points,
            np.tile(TOOL, (40, 1)),
            np.tile(directions, (40, 1)),
        )
        np.testing.assert_allclose(together[i], expected.values, atol=1e-10)
        alone, _ = thermal_field(model, [model.errors_at(state)], directions).at(points, TOOL)
        np.testing.assert_allclose(alone, together[i], atol=1e-12)
