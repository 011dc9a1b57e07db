"""Bodies of HTTP requests read as a campaign, without a service: for what judges analyses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

from app.api.schemas.error_maps import ErrorMapSchema
from app.api.schemas.readings import StatedReading
from app.api.schemas.verifications import VerificationRequest
from app.effects.observations import Verification
from app.identification.campaign import Campaign
from app.thermal.compile_model import compile_model
from app.thermal.machine import MACHINE
from app.thermal.temperature_history import TemperatureHistory

Body: TypeAlias = Mapping[str, Any]


def campaign_of_bodies(
    machine_body: Body,
    map_bodies: Sequence[Body],
    readings: Sequence[Body],
    verification_bodies: Sequence[Body],
) -> Campaign:
    """Read bodies of HTTP requests."""
    machine = MACHINE.validate_python(machine_body)
    maps = [ErrorMapSchema.model_validate(body).to_error_map() for body in map_bodies]
    read = [StatedReading.model_validate(body).to_reading() for body in readings]
    return Campaign(
        model=compile_model(machine, maps, {}),
        maps=maps,
        verifications=[_verification(body) for body in verification_bodies],
        readings=TemperatureHistory.of_readings(
            machine.sensors,
            [(reading.time.timestamp(), reading.temperatures_c) for reading in read],
        ),
        state_readings=[(reading.time.timestamp(), reading.state) for reading in read],
    )


def _verification(body: Body) -> Verification:
    request = VerificationRequest.model_validate(body)
    return request.to_verification()
