"""Everything that an analysis starts from: the model, what was measured, and what was recorded."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from app.effects.conditions import recorded_conditions
from app.effects.effect import Effect
from app.effects.observations import Verification, observation_rows, refuse_many_states
from app.identification.doubted_sensors import trusted_readings
from app.identification.residuals.inexact_sensors import Inexact, looked_back
from app.identification.residuals.residuals import Residuals, compute_residuals
from app.identification.zeroed import with_true_zeros
from app.thermal.compiled_model import CompiledModel
from app.thermal.error_map import ErrorMap
from app.thermal.temperature_history import TemperatureHistory

NONE_INEXACT: Final[Mapping[str, Inexact]] = {}


@dataclass(frozen=True, eq=False)
class Campaign:
    """Verifications of one machine, with the model that they are held against.

    Plain values throughout, so that it can be sent to a process of its own.

    Parameters
    ----------
    readings
        Temperatures as they came, believable or not, from well before the first observation:
        an effect with a time constant needs five of them.
    state_readings
        Time [s] and the machine's state of each reading, in order of time.
    verification_ids
        Numbers under which the verifications are stored; none where they are not.
    older_readings
        Whether the machine has readings from before these, which nothing here needs.
    """

    model: CompiledModel
    maps: Sequence[ErrorMap]
    verifications: Sequence[Verification]
    readings: TemperatureHistory
    state_readings: Sequence[tuple[float, Mapping[str, float]]] = ()
    effects: Sequence[Effect] = ()
    verification_ids: Sequence[int] = ()
    older_readings: bool = False


def residuals_of(campaign: Campaign, inexact: Mapping[str, Inexact] = NONE_INEXACT) -> Residuals:
    """Subtract what the model says, adopted effects included, from what was measured.

    Parameters
    ----------
    inexact
        Sensors whose temperatures are those that they probably had, looking back; a table knows
        only what was read.

    Raises
    ------
    InvalidContent
        If no observation can be compared with the model, or values are in another unit.
    """
    machine = campaign.model.machine
    rows = with_true_zeros(observation_rows(campaign.verifications))
    conditions = recorded_conditions(
        machine.sensors,
        looked_back(trusted_readings(campaign.model, campaign.readings), inexact),
        campaign.state_readings,
        rows.times_s,
        rows.states,
    )
    refuse_many_states(len(conditions.states), len(rows))
    return compute_residuals(
        campaign.model,
        rows,
        conditions,
        campaign.effects,
        campaign.readings,
        older_readings=campaign.older_readings,
    )
