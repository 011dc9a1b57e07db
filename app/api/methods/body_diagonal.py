"""Body diagonals (ISO 230-6)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from pydantic import Field

from app.api.methods.method import Method
from app.files.csv_columns import (
    LENGTH,
    POSITION,
    Named,
    find_columns,
)
from app.files.csv_comments import Statement
from app.files.csv_measurements.formats import (
    DIAGONAL,
    REPEATABILITY,
    RUN,
    Body,
    Format,
    flat_if_one,
    read_runs,
    rows_by_diagonal,
)
from app.files.delimited_text import DelimitedText
from app.measurement.body_diagonal import BodyDiagonal, body_diagonal
from app.pages.wording import message
from app.services.ask_field import Volume
from app.services.context import Context
from app.services.measurements import (
    MeasuredPositions,
    MeasurementAnswer,
    MeasurementRequest,
    Runs,
    travel_volume,
)
from app.stated import Schema
from app.thermal.machine import Machine


class DiagonalRunsSchema(Schema):
    """Readings along one body diagonal."""

    positions_mm: MeasuredPositions = Field(
        min_length=2, description="Positions along the diagonal [mm]"
    )
    forward_um: Runs = Field(
        description="Displacement along the diagonal less its nominal, one run or several [µm]"
    )
    backward_um: Runs | None = Field(None, description="The same on the way back [µm]")


class BodyDiagonalRequest(
    MeasurementRequest,
    example={
        "diagonals": {
            "ppp": {"positions_mm": [0, 812.4], "forward_um": [0, 12.1]},
            "npp": {"positions_mm": [0, 812.4], "forward_um": [0, 8.4]},
            "pnp": {"positions_mm": [0, 812.4], "forward_um": [0, 9.9]},
            "ppn": {"positions_mm": [0, 812.4], "forward_um": [0, 10.2]},
        }
    },
):
    """Readings along the four body diagonals (ISO 230-6)."""

    diagonals: dict[str, DiagonalRunsSchema] = Field(
        description="Readings of each diagonal: ppp, npp, pnp, ppn"
    )
    volume: Volume


@dataclass(frozen=True, eq=False, kw_only=True)
class BodyDiagonalAnswer(MeasurementAnswer, BodyDiagonal):
    """Ed, ESd, and the squareness that the diagonals' ends show."""


def _evaluate(_context: Context, machine: Machine, body: BodyDiagonalRequest) -> BodyDiagonal:
    return body_diagonal(
        {name: runs.model_dump(exclude_none=True) for name, runs in body.diagonals.items()},
        # Over the axes' travel where no volume is stated.
        volume=travel_volume(machine, body.volume),
        chain=machine.chain,
        repeatability_um=body.repeatability_um,
    )


_POSITION: Final = Named("position", POSITION)


_RANGES: Final = tuple(
    Statement(Named(f"volume_{axis}", POSITION), 2, f"volume_{axis}_mm: 0, 500") for axis in "xyz"
)


_BOTH_WAYS: Final = (Named("forward", LENGTH), Named("backward", LENGTH))


def _read_body_diagonal(
    text: DelimitedText, statements: Mapping[str, Any], remarks: list[str]
) -> Body:
    position = Named("position", POSITION, ("distance",))
    needed = [DIAGONAL, position, _BOTH_WAYS[0]]
    columns = find_columns(text, needed, [_BOTH_WAYS[1], RUN], remarks)
    diagonals = {}
    for name, rows in rows_by_diagonal(columns).items():
        positions, readings = read_runs(
            columns, "position", ["forward", "backward"], rows
        ).in_order()
        ways = {f"{way}_um": flat_if_one(runs) for way, runs in readings.items()}
        if positions and "forward_um" not in ways:
            columns.complain(rows[0], "forward", f"expected forward readings of {name}, got none")
        diagonals[name] = {"positions_mm": positions, **ways}
    return {**_with_volume(statements), "diagonals": diagonals}


def _with_volume(statements: Mapping[str, Any]) -> Body:
    """Put the ranges of the axes into one field."""
    ranges = {range_.thing.full: range_.thing.field[-1] for range_ in _RANGES}
    volume = {
        axis: dict(zip(("min_mm", "max_mm"), statements[name], strict=True))
        for name, axis in ranges.items()
        if statements.get(name)
    }
    rest = {name: value for name, value in statements.items() if name not in ranges}
    return rest | ({"volume": volume} if volume else {})


_FILE: Final = Format((*_RANGES, REPEATABILITY), _read_body_diagonal)


BODY_DIAGONAL: Final = Method(
    name="body-diagonal",
    title=message("body diagonals (ISO 230-6)"),
    summary="Body diagonals (ISO 230-6)",
    about="Evaluate Ed and ESd, and squareness from the ends.",
    request=BodyDiagonalRequest,
    answer=BodyDiagonalAnswer,
    evaluate=_evaluate,
    file=_FILE,
)
