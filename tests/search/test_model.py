"""What a model of one channel answers, against dense matrices."""

import numpy as np
import pytest
from scipy.linalg import block_diag

from app.search.model import Model
from app.search.state import Given, State
from tests.search.test_search_likelihood import covariance, make_small


@pytest.mark.parametrize("given", [0, 2])
@pytest.mark.parametrize("number", [0, 3, 8])
def test_a_model_answers_as_dense_matrices_do(given, number):
    """Every second visit teaches, the others are held out; given terms have a prior."""
    _, problem = make_small(cells=2)
    fixed = problem.fixed[0]
    channel, random = fixed.channel, np.random.default_rng(7)
    cells = np.array([True, False])
    taught = cells[channel.cells][channel.block]
    terms, precision = random.normal(size=(len(taught), given)), np.full(given, 3.0)
    state = State(fixed, cells, Given(terms, precision, np.zeros(len(taught))) if given else None)
    model = Model(state, number)
    # Without maps and terms; both are random, with variances of one and of 1/precision.
    of_maps = channel.nuisance @ channel.nuisance.T
    dense = covariance(channel, number) - of_maps
    both = np.column_stack([channel.nuisance, terms])
    spread = block_diag(np.eye(channel.nuisance.shape[1]), np.diag(1.0 / precision))
    whole = dense[np.ix_(taught, taught)] + both[taught] @ spread @ both[taught].T
    inverse = np.linalg.inv(whole)
    columns = random.normal(size=(len(taught), 3))
    np.testing.assert_allclose(
        model.product(columns[:, :1], columns), columns[taught, :1].T @ inverse @ columns[taught],
        rtol=1e-6, atol=1e-9,
    )  # fmt: skip
    gain = spread @ both[taught].T @ inverse
    np.testing.assert_allclose(
        model.entries(channel.values), gain @ channel.values[taught], rtol=1e-6, atol=1e-9
    )
    left = spread - gain @ both[taught] @ spread
    np.testing.assert_allclose(
        model.open_still, np.einsum("ni,ij,nj->n", both, left, both), rtol=1e-6, atol=1e-9
    )
    held = dense[np.ix_(~taught, ~taught)] + both[~taught] @ left @ both[~taught].T
    np.testing.assert_allclose(
        model.product_of_held_out(columns, ~cells),
        columns[~taught].T @ np.linalg.inv(held) @ columns[~taught],
        rtol=1e-6, atol=1e-9,
    )  # fmt: skip
    # Shifts and tilts of the blocks that teach, from values without maps and terms.
    shapes = np.zeros((len(taught), len(channel.starts), channel.shapes.shape[1]))
    shapes[np.arange(len(taught)), channel.block] = channel.shapes
    shapes = shapes[taught][:, state.blocks].reshape(taught.sum(), -1)
    own = np.linalg.inv(dense[np.ix_(taught, taught)])
    of_setups = np.tile(channel.blocks.of_setup(channel.tried[number]), state.blocks.sum())
    expected = of_setups * (shapes.T @ own @ channel.values[taught])
    np.testing.assert_allclose(model.setups(channel.values).ravel(), expected, rtol=1e-5, atol=1e-6)
