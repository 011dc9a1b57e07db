"""The limits that docs/security.md states are those of the code."""

import re
from importlib import import_module
from pathlib import Path

import pytest

SECURITY = Path(__file__).parents[1] / "docs" / "security.md"

_ROW = re.compile(
    r"\| [^|]+ \| (?P<number>[0-9][0-9,.]*)(?: (?P<unit>[^|]*?))? \| [^|]+ "
    r"\| `(?P<constant>[\w.]+)` \|"
)
_FACTORS = {"kB": 1024, "MB": 1024**2, "GB": 1024**3, "min": 60, "h": 3600}
"""Of units that constants are not stated in; numbers of bytes are powers of two."""


def limits():
    """Give each stated limit: constant, number and unit."""
    return [
        (row["constant"], float(row["number"].replace(",", "")), row["unit"] or "")
        for line in SECURITY.read_text(encoding="utf-8").splitlines()
        if (row := _ROW.fullmatch(line))
    ]


@pytest.mark.parametrize(("constant", "number", "unit"), limits())
def test_what_the_page_states_is_what_the_code_has(constant, number, unit):
    module, _, name = constant.rpartition(".")
    actual = getattr(import_module(module), name)
    assert actual == number * _FACTORS.get(unit.split(" ")[0], 1)


def test_every_row_of_the_table_is_compared():
    rows = [line for line in SECURITY.read_text(encoding="utf-8").splitlines() if "| `app." in line]
    assert len(limits()) == len(rows) > 0
