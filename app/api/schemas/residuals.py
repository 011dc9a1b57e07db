"""Residuals over HTTP: measured minus predicted, before anything is fitted."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Final

from pydantic import ConfigDict, Field

from app.api.schemas.analyses import ChosenVerifications
from app.stated import Integer, Schema

if TYPE_CHECKING:
    pass

MOST_ROWS: Final = 10_000


class ResidualsRequest(Schema):
    """Which verifications are compared with which version."""

    model_config = ConfigDict(json_schema_extra={"example": {"verifications": [1, 2], "rows": 100}})

    verifications: ChosenVerifications = None
    model_version: Integer | None = Field(None, description="Version; the active one if not stated")
    rows: Annotated[Integer, Field(ge=0, le=MOST_ROWS)] = Field(
        0, description="How many single residuals are shown too; `Accept: text/csv` gives all"
    )


class ComparisonRequest(Schema):
    """Versions to be compared with the same verifications."""

    model_config = ConfigDict(
        json_schema_extra={"example": {"verifications": [1, 2], "versions": [3, 4]}}
    )

    verifications: ChosenVerifications = None
    versions: Annotated[list[Integer], Field(min_length=1, max_length=20)] = Field(
        description="Numbers of the versions"
    )
