"""Bodies of HTTP requests read as a campaign, without a service: for what judges analyses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

from app.api.routes.readings import StatedReading
from app.identification.campaign import Campaign
from app.services.observations import VerificationRequest
from app.thermal.compile_model import compile_model
from app.thermal.error_map import ERROR_MAP
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
    maps = [ERROR_MAP.validate_python(body) for body in map_bodies]
    read = [StatedReading.model_validate(body).to_reading() for body in readings]
    return Campaign(
        model=compile_model(machine, maps, {}),
        maps=maps,
        verifications=[
            VerificationRequest.model_validate(body).to_verification()
            for body in verification_bodies
        ],
        readings=TemperatureHistory.of_readings(
            machine.sensors,
            [(reading.time.timestamp(), reading.temperatures_c) for reading in read],
        ),
        state_readings=[(reading.time.timestamp(), reading.state) for reading in read],
    )
