"""The short way for readings: a few that are right and new, stored without the framework.

They are checked on the event loop, in one call, which makes them too; and stored by threads of the
queue in which readings of all who send any are stored together.
"""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from contextlib import suppress
from datetime import datetime
from typing import Annotated, Final

from pydantic import Field, TypeAdapter
from pydantic_core import CoreSchema, SchemaValidator, core_schema

from app.api.json_text import read_json
from app.api.schemas.base import MachineState, Temperatures
from app.api.schemas.readings import MOST_READINGS, StoredReadings
from app.api.short_way.plain import MACHINES, Answer, ShortWay
from app.services.context import Context
from app.services.readings import ReadingBatch, begin_to_store
from app.services.together import Wanted
from app.thermal.reading import Reading

LARGEST_PLAIN_BODY: Final = 32_768
"""Longer bodies go the ordinary way [bytes], which checks them in a thread: some 250 readings."""

_PLAIN_TIME: Final = (
    r"^(19|2[0-9])[0-9]{2}-[0-9]{2}-[0-9]{2}T([01][0-9]|2[0-3]):[0-9]{2}:[0-9]{2}"
    r"(\.[0-9]{1,6})?(Z|\+00:00)$"
)
"""UTC, within the years that `UtcTime` allows: the standard library reads it as pydantic does."""


def _plain_reading() -> CoreSchema:
    """Say what `ReadingSchema` says, but for times in other zones, and make readings of it.

    Nothing of it is called back in Python but for names of states.
    """
    time = core_schema.no_info_after_validator_function(
        datetime.fromisoformat, core_schema.str_schema(strict=True, pattern=_PLAIN_TIME)
    )
    temperatures = TypeAdapter(Annotated[Temperatures, Field(min_length=1)]).core_schema
    on_time = core_schema.with_default_schema(core_schema.float_schema(), default=0.0)
    fields = [
        core_schema.dataclass_field("time", time),
        core_schema.dataclass_field("temperatures_c", temperatures),
        core_schema.dataclass_field("state", TypeAdapter(MachineState).core_schema),
        core_schema.dataclass_field("early_s", on_time, init=False),
    ]
    stated = core_schema.dataclass_args_schema("Reading", fields, extra_behavior="forbid")
    names = [field["name"] for field in fields]
    return core_schema.dataclass_schema(Reading, stated, names, slots=True, frozen=True)


_READINGS: Final = SchemaValidator(
    core_schema.list_schema(_plain_reading(), min_length=1, max_length=MOST_READINGS)
)


def plain_readings(body: bytes) -> Sequence[Reading]:
    """Read the readings of a body: one, or a list of them.

    Raises
    ------
    ValueError
        If anything of it is not as it should be, or not plain.
    """
    content = read_json(body)
    readings: list[Reading] = _READINGS.validate_python(
        [content] if isinstance(content, dict) else content
    )
    return readings


async def store_plain(context: Context, machine_id: str, body: bytes) -> Answer | None:
    """Store readings if they are in order in every way and all of them new, else give None.

    Raises
    ------
    StorageUnavailable
        If the database was away, or its disk is full.
    """
    live = context.live
    if live.get(machine_id) is None or live.database.trouble is not None:
        return None
    if not context.reading_batches.has_room:
        return None  # who has to wait for a place waits with the others
    try:
        batch = ReadingBatch(machine_id, plain_readings(body))
    except ValueError:
        return None
    loop = asyncio.get_running_loop()
    is_done = asyncio.Event()

    def end() -> None:
        with suppress(RuntimeError):  # the loop has ended, and whoever waited with it
            loop.call_soon_threadsafe(is_done.set)

    wanted = Wanted(batch, end)
    begin_to_store(context, wanted)
    await is_done.wait()
    wanted.expect_database()
    if batch.outcome is None:
        return None
    return Answer(201, StoredReadings.of(batch.outcome).as_json())


READINGS: Final = ShortWay(f"{MACHINES}{{machine}}/readings", LARGEST_PLAIN_BODY, store_plain)
