"""One term of an effect: coefficient × driver × shape on one component."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from functools import partial
from typing import Annotated, Any, Final, TypeAlias, TypeVar

import numpy as np
from pydantic import Field, PlainSerializer, PlainValidator

from app.arrays import FloatArray
from app.effects.conditions import Conditions, Signal
from app.effects.driver import DRIVERS, Driver
from app.effects.map_tables import MapReading
from app.effects.response_driver import FormerResponse, Responding
from app.effects.shape import (
    SHAPES,
    Everywhere,
    Exchange,
    OfMaps,
    Places,
    Shape,
)
from app.effects.valid import Range, Valid, complete
from app.errors import InvalidContent, list_names
from app.geometry.components import COMPONENTS
from app.thermal.compiled_model import CompiledModel

EVERYWHERE: Final = Everywhere()
STORED_DRIVERS: Final[dict[str, type[Driver]]] = DRIVERS | {
    kind.name: kind for kind in (Responding, FormerResponse)
}
Part = TypeVar("Part", bound=Driver | Shape)


def _part(what: str, kinds: Mapping[str, type[Part]], stored: Mapping[str, Any]) -> Part:
    """Read a driver or a shape as `_written` wrote it."""
    kind = kinds.get(stored.get("name", ""))
    if kind is None:
        raise InvalidContent.of_field(
            "terms", f"expected a {what} among {list_names(kinds)}, got {stored.get('name')!r}"
        )
    arguments = {name: _tuples(value) for name, value in stored.items() if name != "name"}
    expected = {field.name for field in fields(kind)}
    if not set(arguments) <= expected:
        raise InvalidContent.of_field(
            "terms",
            f"expected {kind.name} to have {list_names(sorted(expected))}, got "
            f"{list_names(sorted(arguments))}",
        )
    return kind(**arguments)


def _written(part: Driver | Shape) -> dict[str, Any]:
    return {"name": part.name, **asdict(part)}


def _tuples(value: Any) -> Any:
    """Turn JSON's lists back into tuples, at any depth."""
    return tuple(map(_tuples, value)) if isinstance(value, list | tuple) else value


def _component(code: str) -> str:
    if code not in COMPONENTS:
        raise InvalidContent.of_field("terms", f"expected an error component, got {code!r}")
    return code


@dataclass(frozen=True)
class Term:
    """An additive error of one component.

    Parameters
    ----------
    shape
        How it looks along the axis.
    coefficient
        How strong it is [the component's unit for each unit of driver and shape].
    is_reversing
        Whether its sign is that of the approach: plus coming from below, minus from above.
    learnt
        Where it was learnt, the driver's smallest and largest value; None for drivers that are
        made of no signal, and where it is not known.
    """

    component: Annotated[str, PlainValidator(_component)]
    driver: Annotated[
        Driver, PlainValidator(partial(_part, "driver", STORED_DRIVERS)), PlainSerializer(_written)
    ]
    shape: Annotated[
        Shape, PlainValidator(partial(_part, "shape", SHAPES)), PlainSerializer(_written)
    ] = EVERYWHERE
    coefficient: float = 1.0
    is_reversing: Annotated[bool, Field(alias="reversing")] = False
    learnt: Range | None = None

    def times(self, factor: float) -> Term:
        """Scale the term."""
        return replace(self, coefficient=factor * self.coefficient)

    def at(
        self,
        model: CompiledModel,
        places: Places,
        conditions: Conditions,
        valid: Valid | None = None,
    ) -> FloatArray:
        """Give the error at n places, each at its own moment.

        Parameters
        ----------
        model
            The compiled model: fingerprints are made of its tables.
        valid
            The ranges of its effect: outside them the term is held at their edge. Without, it
            is evaluated as it stands.

        Returns
        -------
        ndarray, shape (n,) [the component's unit]
            NaN where a condition is missing; 0 for a reversing term where the direction is
            not known, as the tables then give the mean of both.
        """
        driver, limited = self._held(conditions, valid)
        if valid is not None and self.shape.changes_along:
            places = valid.held_places(self.component, places)
        errors = self.coefficient * self.shape.along(model, self.component, places, limited, driver)
        return errors * np.sign(places.directions) if self.is_reversing else errors

    def reading(
        self, model: CompiledModel, conditions: Conditions, valid: Valid | None = None
    ) -> MapReading | None:
        """Say how much of each map it adds at n moments.

        Returns
        -------
        MapReading, or None
            None where it is not made of the maps, or the model does not have what it needs.
        """
        if self.is_reversing or not isinstance(self.shape, OfMaps):
            return None
        driver, limited = self._held(conditions, valid)
        reading = self.shape.reading(model, self.component, limited, driver)
        return None if reading is None else reading.times(self.coefficient)

    def held_signals(self, model: CompiledModel) -> set[Signal]:
        """List the signals that are moved to the edge where they lie outside their ranges."""
        signals = {signal for signal, _ in self.driver.signals if self.driver.is_held_by_signal}
        return signals | {Signal("temperature", sensor) for sensor in self.sensors_of_tables(model)}

    def _held(self, conditions: Conditions, valid: Valid | None) -> tuple[FloatArray, Conditions]:
        """Give the driver and the conditions of the shape, at the edge where they lie outside."""
        if valid is None:
            return conditions.driven(self.driver), conditions
        limited = valid.held(conditions)
        driver = self.driver.at(valid.for_driver(self.driver, conditions, limited))
        return driver if self.learnt is None else np.clip(driver, *self.learnt), limited

    def nodes_mm(self, low_mm: float, high_mm: float, valid: Valid | None = None) -> FloatArray:
        """Give the positions that a table needs to show the term [mm], and where it is held."""
        nodes = self.shape.nodes_mm(low_mm, high_mm)
        edges = valid.edges_mm(self.component) if valid and self.shape.changes_along else None
        held_from = [at for at in edges or () if low_mm < at < high_mm]
        return np.concatenate([nodes, held_from]) if held_from else nodes

    def why_missing(self, model: CompiledModel, conditions: Conditions) -> str:
        """Say which condition is missing where the term is NaN, empty where none."""
        why = self.driver.why_missing(conditions)
        why = why or self.shape.why_missing(model, self.component)
        for sensor in () if why else self.sensors_of_tables(model):
            if np.isnan(conditions.temperature(sensor)).any():
                return conditions.why_missing(Signal("temperature", sensor))
        return why

    def sensors_of_tables(self, model: CompiledModel) -> list[str]:
        """Name the sensors by which it reads the model's own tables."""
        located = model.find(self.component)
        if located is None or not isinstance(self.shape, OfMaps):
            return []
        other = [self.shape.sensor] if isinstance(self.shape, Exchange) else []
        return [located[0].sensor, *other]


StoredTerm: TypeAlias = Annotated[
    Term, complete("component", "driver", "shape", "coefficient", "reversing")
]
"""Terms of older versions have no `learnt`."""
