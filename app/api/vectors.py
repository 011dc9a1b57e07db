"""Many vectors in one answer: as JSON, as numpy's npy, or as an Arrow stream."""

from __future__ import annotations

import io
import json
from dataclasses import fields
from typing import Any, Final

import nanoarrow
import nanoarrow.ipc
import numpy as np
import orjson
from starlette.responses import Response

from app.api.media_types import ANSWER_HEADER, JSON, NPY
from app.api.table_json import OPTIONS
from app.arrays import FloatArray
from app.rounding import rounded
from app.services.ask_field import AnswerHead
from app.services.geometry import VolumetricError

LONGEST_HEADER: Final = 6000
"""Servers, proxies and clients refuse headers from some 8,000 characters on."""

ROWS_AT_ONCE: Final = 10_000
"""Vectors written in one call: some milliseconds."""

COLUMNS: Final = (
    "error_x_um", "error_y_um", "error_z_um",
    "orientation_x_urad", "orientation_y_urad", "orientation_z_urad",
)  # fmt: skip


def vectors_response(media_type: str, errors: VolumetricError) -> Response:
    """Write errors and orientations at points in the form that was asked for.

    Parameters
    ----------
    media_type
        `JSON`, `NPY` or `ARROW`.
    errors
        JSON has the vectors to 0.1 nm. npy has one array of shape (n, 6) or (s, n, 6); Arrow has
        the six columns, and a column `thermal_state` where there are several. What the answer
        says beside them is then in the header `Thermap-Answer` (as JSON) and, in Arrow, in the
        schema's metadata too.
    """
    head: dict[str, Any] = {f.name: getattr(errors, f.name) for f in fields(AnswerHead)}
    errors_um, orientation_urad = errors.errors_um, errors.orientation_urad
    if media_type == JSON:
        beside = {
            "outside_travel": errors.outside_travel,
            "errors_um": orjson.Fragment(_written(rounded(errors_um))),
            "orientation_urad": orjson.Fragment(_written(rounded(orientation_urad))),
        }
        return Response(orjson.dumps(head | beside, option=OPTIONS), media_type=JSON)
    six = np.concatenate([errors_um, orientation_urad], axis=-1)
    content = _npy(six) if media_type == NPY else _arrow(six, _ascii(head))
    return Response(content, media_type=media_type, headers={ANSWER_HEADER: _short(head)})


def _written(vectors: FloatArray) -> bytes:
    """Write vectors as JSON in pieces, between which others have their turn."""
    if vectors.ndim > 2:
        pieces = [_written(state) for state in vectors]
    else:
        pieces = [
            orjson.dumps(vectors[first : first + ROWS_AT_ONCE], option=OPTIONS)[1:-1]
            for first in range(0, len(vectors), ROWS_AT_ONCE)
        ]
    return b"[" + b",".join(pieces) + b"]"


def _short(head: dict[str, Any]) -> str:
    """Write the head for a header: warnings that make it too long are only counted."""
    warnings = head["warnings"]
    count = len(warnings)
    while len(text := _ascii(head)) > LONGEST_HEADER and count:
        count //= 2
        more = f"and {len(warnings) - count} more warnings; JSON has them all"
        head = head | {"warnings": [*warnings[:count], more]}
    return text


def _ascii(head: dict[str, Any]) -> str:
    """Write JSON in ASCII alone, as headers need it."""
    return json.dumps(json.loads(orjson.dumps(head, option=OPTIONS)), separators=(",", ":"))


def _npy(numbers: FloatArray) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, numbers, allow_pickle=False)
    return buffer.getvalue()


def _arrow(numbers: FloatArray, metadata: str) -> bytes:
    rows = numbers.reshape(-1, len(COLUMNS))
    columns: dict[str, Any] = dict(zip(COLUMNS, np.ascontiguousarray(rows.T), strict=True))
    kinds: dict[str, Any] = dict.fromkeys(COLUMNS, nanoarrow.float64())
    if numbers.ndim > 2:
        states, points, _ = numbers.shape
        columns["thermal_state"] = np.repeat(np.arange(states, dtype=np.int32), points)
        kinds["thermal_state"] = nanoarrow.int32()
    children = [
        nanoarrow.c_array_from_buffers(kinds[name], len(rows), [None, column], null_count=0)
        for name, column in columns.items()
    ]
    schema = nanoarrow.c_schema(nanoarrow.struct(kinds, nullable=False))
    schema = schema.modify(metadata={"thermap": metadata})
    batch = nanoarrow.c_array_from_buffers(
        schema, len(rows), [None], children=children, null_count=0
    )
    buffer = io.BytesIO()
    with nanoarrow.ipc.StreamWriter.from_writable(buffer) as writer:
        writer.write_stream(nanoarrow.c_array_stream(batch))
    return buffer.getvalue()
