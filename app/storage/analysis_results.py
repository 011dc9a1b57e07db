"""Results of analyses as text."""

from __future__ import annotations

import json
from dataclasses import dataclass
from math import sqrt
from typing import Final

from app.identification.analysis.analysis import Analysis
from app.storage.records import StoredAnalysis
from app.storage.stored_shapes import Fields, StoredShape


@dataclass(frozen=True, slots=True, kw_only=True)
class AnalysisWithResult(StoredAnalysis, published_as="AnalysisAnswer"):
    """An analysis with its result, once it is done."""

    result: Analysis | None
    """What was found; null before that"""


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


def _from_1(stored: Fields) -> Fields:
    """Say of each effect whether it helps: then it was what held-out visits had confirmed."""
    effects = [
        {"helps": sure, "why_not": None if sure else "visits that were held out did not confirm it"}
        | effect
        for effect in stored["effects"]
        for sure in [effect["status"] == "confirmed"]
    ]
    return {**stored, "effects": effects}


def _from_2(stored: Fields) -> Fields:
    """Say that nothing was refitted, and no name held against flexible versions of itself.

    The scatter of set-ups stood in a component's floor alone, beside its noise: later floors are
    of what was repeated.
    """
    effects = [
        {"doubts": []}
        | effect
        | {"alternatives": [{"with_offset": False} | other for other in effect["alternatives"]]}
        for effect in stored["effects"]
    ]
    components = [{"setup_scatter": _of_setups(one), **one} for one in stored["components"]]
    return {"refitted": [], **stored, "effects": effects, "components": components}


def _from_3(stored: Fields) -> Fields:
    """Leave out a next visit that nobody could carry out; its sentence is in `what_next`."""
    return {name: value for name, value in stored.items() if name != "next_visit"}


def _of_setups(component: Fields) -> float | None:
    floor, noise = component["floor"], component["noise"]
    return None if floor is None else sqrt(max(floor**2 - noise**2, 0.0))


RESULTS: Final = StoredShape(
    Analysis, "a result of an analysis", [_from_0, _from_1, _from_2, _from_3]
)


def confirmed_effects(result: str) -> list[str]:
    """Give the sentences of the effects that a result confirms and that help."""
    return [
        effect["explanation"]
        for effect in json.loads(result).get("effects", ())
        if effect["status"] == "confirmed" and effect["helps"]
    ]
