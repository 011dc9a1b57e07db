"""What the generated shapes share."""

from __future__ import annotations

from typing import Final

from pydantic import BaseModel, ConfigDict

_UNITS: Final = {
    "um": "µm",
    "urad": "µrad",
    "um_per_m": "µm/m",
    "urad_per_m": "µrad/m",
}
"""How a field's name spells a unit, and how people do."""


class Shape(BaseModel):
    """Something that travels to the service or comes from it; it cannot be changed.

    What a user writes has no unknown fields. Of an answer, fields that a newer service adds
    are passed over by `thermap.call.reader_of`.
    """

    model_config = ConfigDict(
        extra="forbid",
        frozen=True,
        # Names that are Python's own words, such as `from`, stand with an underscore too.
        validate_by_name=True,
        validate_by_alias=True,
        # Made ready when it is first used: an import is not to wait for a hundred shapes.
        defer_build=True,
    )


class TableEntry(Shape):
    """What an entry of the compensation table says of itself, whichever fields its unit names."""

    @property
    def unit(self) -> str:
        """The unit of this component's errors and compensation."""
        return _UNITS[self._spelled_unit]

    @property
    def compensation(self) -> list[float] | float:
        """Minus the error, in `unit`: a list over the positions, or a single number."""
        value: list[float] | float = getattr(self, f"compensation_{self._spelled_unit}")
        return value

    @property
    def standard_errors(self) -> list[float] | float | None:
        """One standard deviation of the errors, in `unit`; None where it is not known."""
        of_table = getattr(self, f"standard_errors_{self._spelled_unit}", None)
        value: list[float] | float | None = (
            getattr(self, f"standard_error_{self._spelled_unit}", None)
            if of_table is None
            else of_table
        )
        return value

    @property
    def _spelled_unit(self) -> str:
        return next(u for u in _UNITS if getattr(self, f"compensation_{u}", None) is not None)
