"""Every test of the HTTP interface runs on SQLite, which is what a user gets, in the ordinary run;
on PostgreSQL with the slow ones.
"""

from pathlib import Path

import pytest

HERE = Path(__file__).parent


def pytest_collection_modifyitems(items):
    for item in items:
        parameters = getattr(item, "callspec", None)
        if HERE in item.path.parents and parameters and "postgresql" in parameters.params.values():
            item.add_marker(pytest.mark.slow)
