"""What is true later, in states that nobody measured: where a correction is judged.

A correction that was learnt from scatter fits what was measured and is wrong later. Here its
error is free of any measurement, so it is the correction's alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from app.simulation.undeclared.components import FloatArray
from app.simulation.undeclared.observations import Observations


@dataclass(frozen=True)
class Later:
    """Later observations, none of which is handed out, and the truth there.

    Arrays of m values run over the observations as in `Truth`.

    Parameters
    ----------
    asked
        The same as `POST …/predictions` takes it.
    true_um : ndarray, shape (m,)
        The machine's error.
    contribution_um : ndarray, shape (m,)
        What the undeclared effects add to what the model would say.
    predicted_um : ndarray, shape (m,)
        What the maps and readings that are handed out say.
    """

    observations: Observations
    asked: list[dict[str, Any]]
    true_um: FloatArray
    contribution_um: FloatArray
    predicted_um: FloatArray

    def error_um(self, correction_um: ArrayLike = 0.0) -> float:
        """Say how wrong the corrected model is: root mean square, free of measurement.

        Parameters
        ----------
        correction_um : array-like, shape (m,)
            What the correction adds to `predicted_um`; 0 is the model as it is.

        Returns
        -------
        float
            Of true − predicted − correction. It has the errors of maps and readings too.
        """
        return _rms(self.true_um - self.predicted_um - np.asarray(correction_um, dtype=float))

    def left_um(self, correction_um: ArrayLike = 0.0) -> float:
        """Say what of the undeclared effects a correction leaves or adds: root mean square.

        Parameters
        ----------
        correction_um : array-like, shape (m,)
            As for `error_um`.

        Returns
        -------
        float
            Of contribution − correction: 0 is a perfect correction; above `left_um()` it harms.
        """
        return _rms(self.contribution_um - np.asarray(correction_um, dtype=float))


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else 0.0
