"""The straightforward handler that one would write first.

FastAPI with pydantic models in and out; for each request the maps are read through
SQLAlchemy, and scipy interpolates each component over temperature.
"""

from __future__ import annotations

import os

import numpy as np
from fastapi import FastAPI
from pydantic import BaseModel
from scipy.interpolate import interp1d

from app.storage.database import Database
from app.storage.machines import find_machine
from app.storage.model_versions import active_version

app = FastAPI()
database = Database(os.environ["THERMAP_DATABASE_URL"])


class Temperatures(BaseModel):
    """Live temperatures."""

    temperatures_c: dict[str, float]
    state: dict[str, float] = {}


class Component(BaseModel):
    """One component's table."""

    component: str
    positions_mm: list[float]
    errors: list[float]
    compensation: list[float]
    sensor: str
    temperature_c: float


class Table(BaseModel):
    """The compensation table."""

    machine: str
    model_version: int
    components: list[Component]


@app.post("/v1/machines/{machine}/compensation")
def post_compensation(machine: str, body: Temperatures) -> Table:
    """Interpolate every component of the machine's active model."""
    with database.reading() as session:
        version = active_version(session, find_machine(session, machine))
    components = []
    for code, sensor in version.assignment.items():
        maps = sorted(
            (m.error_map for m in version.maps), key=lambda m, s=sensor: m.temperatures_c[s]
        )
        temperature = body.temperatures_c[sensor]
        errors = interp1d(
            [m.temperatures_c[sensor] for m in maps],
            np.array([m.tables[code].errors for m in maps]),
            axis=0,
        )(temperature)
        components.append(
            Component(
                component=code,
                positions_mm=maps[0].tables[code].positions_mm.tolist(),
                errors=errors.tolist(),
                compensation=(-errors).tolist(),
                sensor=sensor,
                temperature_c=temperature,
            )
        )
    return Table(machine=machine, model_version=version.version, components=components)
