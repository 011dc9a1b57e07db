"""The uncertainty of a component's errors over HTTP: standard errors, or a covariance."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field

from app.arrays import FloatArray
from app.errors import InvalidContent
from app.geometry.components import Component
from app.stated import Number, Schema
from app.thermal.uncertainty import standard_errors_of, stated_covariance, without_zeros

StandardError = Annotated[Number, Field(ge=0)]
"""One standard deviation."""

StandardErrors = Annotated[list[StandardError], Field(min_length=1, max_length=100_000)]
"""One for each position."""

Covariance = Annotated[list[list[Number]], Field(min_length=1, max_length=100_000)]
"""n rows of n numbers."""


def uncertainty_fields(component: Component, before: str = "") -> tuple[str, str]:
    """Name the fields of standard errors and covariance, those of the `backward_` errors too."""
    return f"{before}{component.standard_error_field}", f"{before}covariance"


def read_uncertainty(
    schema: Schema, component: Component, n: int, before: str = ""
) -> FloatArray | None:
    """Take what a component states of its n errors' uncertainty, or of the `backward_` ones'.

    Raises
    ------
    InvalidContent
        If it does not fit the errors, or is no uncertainty.
    """
    names = uncertainty_fields(component, before)
    errors, covariance = (getattr(schema, name) for name in names)
    beside = f"{before}{component.input_field}"
    if getattr(schema, beside) is None and (errors, covariance) != (None, None):
        raise InvalidContent.of_field(
            names[errors is None],
            f"expected {beside} of {component.code} beside it, got none",
        )
    if isinstance(errors, float):
        errors = [errors]
    return stated_covariance(component, n, errors, covariance, before)


def show_uncertainty(
    component: Component, covariance: FloatArray | None, before: str = ""
) -> dict[str, Any]:
    """Show standard errors, and the covariance where they do not say all of it."""
    if covariance is None:
        return {}
    name, name_of_all = uncertainty_fields(component, before)
    standard_errors = standard_errors_of(covariance).tolist()
    written = without_zeros(covariance)
    return {
        name: standard_errors if component.is_table else standard_errors[0],
        **({name_of_all: written.tolist()} if written.ndim == 2 else {}),
    }
