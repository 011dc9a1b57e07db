"""What the active model says along an edge that a machine cut, for comparison with the part."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from app.arrays import FloatArray
from app.errors import NotEnoughMaps
from app.geometry.components import LINEAR_LETTERS, Component
from app.services.ask_field import FieldQuestion, Triple, ask_field
from app.services.context import Context


@dataclass(frozen=True, slots=True, eq=False)
class PartPrediction:
    """Predicted errors along the edge [µm], shape (n,), and what is to be said of them."""

    predicted_um: FloatArray
    model_version: int
    notes: list[str]


def predict_part(
    context: Context,
    machine_id: str,
    component: Component,
    positions_mm: FloatArray,
    temperatures_c: Mapping[str, float],
    path_mm: Triple | None,
    tool_offset_mm: Triple,
) -> PartPrediction | None:
    """Predict the straightness that a part should show.

    Parameters
    ----------
    context, machine_id
        Whose active model.
    component
        A straightness component.
    positions_mm : ndarray, shape (n,) [mm]
        Along its axis.
    temperatures_c
        Sensor to temperature while it was cut [°C].
    path_mm
        A point of the machine's path along the edge: then the prediction is the
        volumetric error there, with rotations and lever arms. Without it, it is the
        component's table alone.
    tool_offset_mm
        Tool offset with which it was cut [mm].

    Returns
    -------
    PartPrediction or None
        None where no model has the component.

    Raises
    ------
    InvalidContent
        As `ask_field`.
    """
    question = FieldQuestion([temperatures_c], tool_offset_mm, missing_as_zero=True)
    try:
        asked = ask_field(context, machine_id, question, orientation=False)
    except NotEnoughMaps:
        return None
    if component.code not in asked.field.tables:
        return None
    if path_mm is None:
        positions, values = asked.field.tables[component.code]
        predicted = np.interp(positions_mm, positions, values[0])
        return PartPrediction(predicted, asked.model_version, list(asked.warnings))
    points = np.tile(path_mm, (positions_mm.size, 1))
    points[:, LINEAR_LETTERS.index(str(component.axis))] = positions_mm
    errors_um, _ = asked.field.at(points, tool_offset_mm)
    notes = list(asked.warnings)
    if asked.counted_as_zero:
        notes.append(f"the prediction counts as zero: {', '.join(asked.counted_as_zero)}")
    return PartPrediction(errors_um[:, component.row], asked.model_version, notes)
