"""By what one observation scatters: as is stated, unless nearly all lengths contradict that.

Whatever says something of a campaign asks here, or its search, which decides in the same way
(`app.search.common_scatter`): so two answers about the same verifications cannot differ.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from app.arrays import one_blas_thread, rms
from app.errors import InvalidContent
from app.identification.campaign import Campaign, residuals_of
from app.identification.doubted_sensors import trusted_readings
from app.identification.residuals.inexact_sensors import error_columns, inexact_sensors
from app.identification.residuals.map_uncertainty import map_uncertainty
from app.identification.residuals.residuals import Residuals
from app.search.common_scatter import screen_at_common_scatter
from app.search.noise import COMMON
from app.search.rows import DeclaredNoise, Rows
from app.units import Unit

UM: Final = Unit.UM.symbol


@dataclass(frozen=True, slots=True)
class Contradiction:
    """A stated repeatability that nearly all lengths contradict.

    Parameters
    ----------
    stated
        What verifications state, in words [µm].
    shown_um
        By what lengths scatter within their set-ups [µm].
    times
        That over what is stated, rounding included.
    """

    stated: str
    shown_um: float
    times: float

    @property
    def sentence(self) -> str:
        """Say by how much it is contradicted."""
        return (
            f"The stated repeatability of {self.stated} {UM} is contradicted: nearly all lengths "
            f"scatter by {self.shown_um:.2g} {UM} within their set-ups, {self.times:.2g} times as "
            "much, and the answer rests on that."
        )

    @property
    def to_state(self) -> str:
        """Say what to state instead."""
        return (
            f"State {self.shown_um:.2g} instead of {self.stated} {UM} as repeatability_um, or "
            "measure some places twice within two minutes, which shows how well lengths repeat."
        )


@dataclass(frozen=True, eq=False)
class ObservedScatter:
    """By what the channels of a campaign scatter.

    Parameters
    ----------
    noise
        Channel to what is known before any search [the channel's unit].
    contradiction
        None where nothing that is stated is contradicted.
    """

    noise: Mapping[int, DeclaredNoise]
    contradiction: Contradiction | None


def observed_scatter(campaign: Campaign, residuals: Residuals) -> ObservedScatter:
    """Decide what one observation scatters by, as an analysis of the same campaign does."""
    declared = residuals.as_rows().noise
    if all(channel_noise.repeatability is None for channel_noise in declared.values()):
        return ObservedScatter(declared, None)
    trusted = trusted_readings(campaign.model, campaign.readings)
    inexact = inexact_sensors(campaign.model.machine, trusted)
    looking_back = residuals_of(campaign, inexact) if inexact else residuals
    projection, rows = looking_back.projection, looking_back.as_rows()
    try:
        errors = error_columns(projection, trusted, inexact)
        maps = map_uncertainty(projection, campaign.maps, errors)
    except InvalidContent:
        # Too many for any analysis: what is stated is all that is known.
        return ObservedScatter(declared, None)
    with one_blas_thread():
        screened, _ = screen_at_common_scatter(rows, maps)
    common = {c: n.repeatability for c, n in screened.noise.items() if n.origin == COMMON}
    observed = {c: value for c, value in common.items() if value is not None}
    return ObservedScatter(screened.noise, contradiction(looking_back, rows, observed))


def contradiction(
    residuals: Residuals, rows: Rows, common: Mapping[int, float]
) -> Contradiction | None:
    """Put a contradiction into figures.

    Parameters
    ----------
    common
        Channel to what nearly all lengths show in its place [µm]; empty: nothing is contradicted.
    """
    if not common:
        return None
    size = rms(np.array(list(common.values())))
    before = rms(np.array([rows.noise[c].repeatability or np.nan for c in common]))
    observations = residuals.rows
    which = np.unique(
        observations.verification[np.isin(observations.channel, list(common))]
    ).tolist()
    values = [observations.verifications[i].repeatability_um for i in which]
    declared = sorted({f"{value:.2g}" for value in values if value is not None}, key=float)
    number = " to ".join(dict.fromkeys([declared[0], declared[-1]]))
    return Contradiction(number, size, size / before)
