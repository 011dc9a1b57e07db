"""No request that schemathesis makes of the OpenAPI document is answered as it does not say.

`python -m tests.faults requests` sends ten thousand.
"""

import pytest

from tests.faults.requests import send_cases


@pytest.mark.slow
def test_what_is_sent_is_answered_as_the_document_says(sqlite_url, capfd):
    pytest.importorskip("schemathesis")
    code = send_cases(sqlite_url, cases=140, seed=1, phases="fuzzing")
    assert code == 0, capfd.readouterr().out[-5000:]
