"""Answers as they are stored: JSON that carries the version of its shape."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, Generic, TypeAlias, TypeVar

import orjson
from pydantic import TypeAdapter, ValidationError

from app.errors import InvalidContent

Shape = TypeVar("Shape")
Fields: TypeAlias = dict[str, Any]

VERSION_FIELD: Final = "shape"
"""What is stored without it is of version 0: the first version of this software."""

MOST_NAMED: Final = 3


class StoredShape(Generic[Shape]):
    """Writes one kind of answer, and reads it in all forms that it ever had.

    Parameters
    ----------
    upgrades
        Each makes version n + 1 of version n; as many as the version that is written.
    """

    def __init__(
        self, shape: type[Shape], what: str, upgrades: Sequence[Callable[[Fields], Fields]]
    ) -> None:
        self._adapter = TypeAdapter(shape)
        self._what = what
        self._upgrades = upgrades

    @property
    def version(self) -> int:
        """The version that is written."""
        return len(self._upgrades)

    def text(self, value: Shape) -> str:
        """Write JSON, the version first; numbers that are not finite become null."""
        written = self._adapter.dump_json(value, by_alias=True)
        return f'{{"{VERSION_FIELD}":{self.version},{written[1:].decode()}'

    def fields(self, value: Shape) -> Fields:
        """Write JSON's own types."""
        written: Fields = orjson.loads(self.text(value))
        return written

    def read_text(self, text: str) -> Shape:
        """Read JSON."""
        return self.read(orjson.loads(text))

    def read(self, stored: Mapping[str, Any]) -> Shape:
        """Read what was stored, of any version up to this one.

        Raises
        ------
        InvalidContent
            If a newer version wrote it, or something of it is missing or wrong.
        """
        fields = dict(stored)
        version = fields.pop(VERSION_FIELD, 0)
        if version > self.version:
            raise InvalidContent(
                f"expected {self._what} of shape {self.version} or older, got {version}: a newer "
                "version of thermap stored it"
            )
        try:
            for upgrade in self._upgrades[version:]:
                fields = upgrade(fields)
            return self._adapter.validate_python(fields)
        except (KeyError, TypeError) as error:
            raise InvalidContent(
                f"expected {self._what} as it was stored: {error} is missing or of another type"
            ) from None
        except ValidationError as error:
            wrong = "; ".join(
                f"{'.'.join(map(str, detail['loc']))}: {detail['msg']}"
                for detail in error.errors()[:MOST_NAMED]
            )
            raise InvalidContent(f"expected {self._what} as it was stored: {wrong}") from None


def unchanged(stored: Fields) -> Fields:
    """Take a version 0 that differs from version 1 by the number alone."""
    return stored
