"""Where the measured data lie: they are no part of the project."""

from __future__ import annotations

import os
from pathlib import Path

VARIABLE = "THERMAP_MEASURED_DATA"
BESIDE = Path(__file__).parents[3] / "shared" / "data" / "measured"


def data_folder() -> Path:
    """Give the folder that the environment names, or the one beside the checkout."""
    return Path(os.environ.get(VARIABLE, BESIDE))
