"""Results of analyses as text."""

from __future__ import annotations

from typing import Final

from app.identification.analysis.analysis import Analysis
from app.storage.stored_shapes import Fields, StoredShape


def _from_0(stored: Fields) -> Fields:
    """Add what 0.1.0 and its first successors did not write.

    They did not say which kinds were looked for and of which unit overall figures are, nor until
    when what grows may be used, nor of which approach the means of a visit are.
    """
    units = [one["unit"] for one in stored["components"]]
    effects = [{"measure_again": None, **effect} for effect in stored["effects"]]
    plots = stored["plots"]
    visits = [{"direction": [0.0] * len(one["time_s"]), **one} for one in plots["visits"]]
    return {
        "kinds": None,
        "unit": "µm" if "µm" in units or not units else units[0],
        **stored,
        "effects": effects,
        "plots": {**plots, "visits": visits},
    }


RESULTS: Final = StoredShape(Analysis, "a result of an analysis", [_from_0])
