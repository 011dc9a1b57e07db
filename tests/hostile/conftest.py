"""How many hostile inputs each fuzzer makes: few beside the ordinary tests, many by command.

`pytest tests/hostile -m "slow or not slow" --hostile-inputs 100000` runs them in full.
"""

import pytest


def pytest_addoption(parser):
    parser.addoption(
        "--hostile-inputs",
        type=int,
        default=100,
        help="hostile inputs of each fuzzer in tests/hostile",
    )


@pytest.fixture
def hostile_inputs(request):
    """So many inputs a fuzzer makes; with the same seed always the same ones."""
    return request.config.getoption("--hostile-inputs", default=200)
