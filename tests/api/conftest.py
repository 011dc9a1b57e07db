"""Every test of the HTTP interface runs on SQLite, which is what a user gets, in the ordinary run;
on PostgreSQL with the slow ones, unless a database has no part in what it tests.
"""

from pathlib import Path

import pytest

HERE = Path(__file__).parent

WITHOUT_DATABASE = {
    f"test_api_{room}.py"
    for room in ("bad_input", "body_size", "uncertainty", "predictions", "controllers", "loop_page")
}
"""What is refused before it is stored, or computed of what others test that it is read."""


def pytest_collection_modifyitems(config, items):
    left_out = []
    for item in items:
        parameters = getattr(item, "callspec", None)
        if HERE in item.path.parents and parameters and "postgresql" in parameters.params.values():
            item.add_marker(pytest.mark.slow)
            if item.path.name in WITHOUT_DATABASE:
                left_out.append(item)
    config.hook.pytest_deselected(items=left_out)
    items[:] = [item for item in items if item not in set(left_out)]
