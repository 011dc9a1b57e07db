"""The tables. Only migrations change them; `alembic check` holds that both agree."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

import numpy as np
from sqlalchemy import (
    JSON,
    BigInteger,
    DateTime,
    Dialect,
    Double,
    ForeignKey,
    ForeignKeyConstraint,
    Index,
    Integer,
    LargeBinary,
    MetaData,
    String,
    Text,
    UniqueConstraint,
    text,
)
from sqlalchemy.orm import DeclarativeBase, Mapped, mapped_column, relationship
from sqlalchemy.types import TypeDecorator

from app.arrays import FloatArray
from app.events.event import LONGEST_NAME


class UtcDateTime(TypeDecorator[datetime]):
    """A time, stored and returned as UTC; a time without a zone is refused."""

    impl = DateTime(timezone=True)
    cache_ok = True

    def process_bind_param(self, value: datetime | None, dialect: Dialect) -> datetime | None:
        """Convert to UTC; SQLite keeps no zone, so it is taken off there."""
        if value is None:
            return None
        if value.tzinfo is None:
            raise ValueError("a time without a zone cannot be stored")
        utc = value.astimezone(UTC)
        return utc.replace(tzinfo=None) if dialect.name == "sqlite" else utc

    def process_result_value(self, value: datetime | None, dialect: Dialect) -> datetime | None:
        """Give the zone back."""
        if value is None:
            return None
        return value.replace(tzinfo=UTC) if value.tzinfo is None else value.astimezone(UTC)


class Float64Array(TypeDecorator[FloatArray]):
    """An array of double precision, bit for bit (little-endian)."""

    impl = LargeBinary
    cache_ok = True

    def process_bind_param(self, value: FloatArray | None, dialect: Dialect) -> bytes | None:
        """Write the numbers' own bytes."""
        return None if value is None else np.ascontiguousarray(value, dtype="<f8").tobytes()

    def process_result_value(self, value: bytes | None, dialect: Dialect) -> FloatArray | None:
        """Read them back; the array is read-only."""
        return None if value is None else np.frombuffer(value, dtype="<f8")


class Base(DeclarativeBase):
    """All tables, with constraints named so that migrations can name them too."""

    metadata = MetaData(
        naming_convention={
            "ix": "ix_%(table_name)s_%(column_0_N_name)s",
            "uq": "uq_%(table_name)s_%(column_0_N_name)s",
            "fk": "fk_%(table_name)s_%(referred_table_name)s",
            "pk": "pk_%(table_name)s",
        }
    )
    type_annotation_map = {  # noqa: RUF012 - SQLAlchemy reads it from the class
        dict[str, Any]: JSON,
        list[Any]: JSON,
        datetime: UtcDateTime,
        float: Double,
        FloatArray: Float64Array,
    }


class MachineRow(Base):
    """A machine and its settings.

    `revision` counts every change of it that live tables follow, `withdrawals` how often
    readings were withdrawn: who holds readings in memory then reads them again.
    `waiting_version` is made of all that was stored, and is not active because its tables would
    lose something. What the event log has of its id up to the number `entries_after` is of an
    older machine.
    """

    __tablename__ = "machine"

    id: Mapped[str] = mapped_column(String(64), primary_key=True)
    name: Mapped[str] = mapped_column(Text)
    configuration: Mapped[str] = mapped_column(String(8))
    axes: Mapped[dict[str, Any]]
    sensors: Mapped[list[Any]]
    out_of_range: Mapped[str] = mapped_column(String(16))
    extrapolation_margin_c: Mapped[float]
    extrapolation_error_ratio: Mapped[float] = mapped_column(default=3.0, server_default="3.0")
    same_temperature: Mapped[str] = mapped_column(String(16))
    serial_number: Mapped[str | None] = mapped_column(Text)
    active_version: Mapped[int | None]
    waiting_version: Mapped[int | None]
    revision: Mapped[int] = mapped_column(default=1)
    withdrawals: Mapped[int] = mapped_column(default=0, server_default=text("0"))
    entries_after: Mapped[int] = mapped_column(BigInteger, default=0, server_default=text("0"))
    created_at: Mapped[datetime]


class ErrorMapRow(Base):
    """One error map; `withdrawn_at` is set when a user deletes it but a model keeps it."""

    __tablename__ = "error_map"
    __table_args__ = (
        Index(
            "uq_error_map_label_in_use",
            "machine_id",
            "label",
            unique=True,
            sqlite_where=text("withdrawn_at IS NULL"),
            postgresql_where=text("withdrawn_at IS NULL"),
        ),
    )

    id: Mapped[int] = mapped_column(primary_key=True)
    machine_id: Mapped[str] = mapped_column(ForeignKey("machine.id", ondelete="CASCADE"))
    label: Mapped[str] = mapped_column(Text)
    measured_at: Mapped[datetime]
    temperatures_c: Mapped[dict[str, Any]]
    measuring_lines_mm: Mapped[dict[str, Any]]
    repeatability_um: Mapped[float | None]
    instrument: Mapped[str | None] = mapped_column(Text)
    stored_at: Mapped[datetime]
    withdrawn_at: Mapped[datetime | None]

    components: Mapped[list[ComponentRow]] = relationship(
        lazy="selectin", order_by="ComponentRow.place", cascade="all, delete-orphan"
    )


class ComponentRow(Base):
    """One component of one map: its arrays, in the order in which they came.

    Covariances are row by row, or the variances alone where nothing else is not zero.
    """

    __tablename__ = "error_map_component"

    error_map_id: Mapped[int] = mapped_column(
        ForeignKey("error_map.id", ondelete="CASCADE"), primary_key=True
    )
    component: Mapped[str] = mapped_column(String(8), primary_key=True)
    place: Mapped[int]
    positions_mm: Mapped[FloatArray]
    errors: Mapped[FloatArray]
    backward_errors: Mapped[FloatArray | None]
    covariance: Mapped[FloatArray | None]
    backward_covariance: Mapped[FloatArray | None]


class ModelVersionRow(Base):
    """One immutable version of a machine's model."""

    __tablename__ = "model_version"

    machine_id: Mapped[str] = mapped_column(
        ForeignKey("machine.id", ondelete="CASCADE"), primary_key=True
    )
    version: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    created_at: Mapped[datetime]
    reason: Mapped[str] = mapped_column(Text)
    assignment: Mapped[dict[str, Any]]
    effects: Mapped[list[Any]]

    maps: Mapped[list[ErrorMapRow]] = relationship(
        secondary="model_version_map", lazy="selectin", order_by="ErrorMapRow.id", viewonly=True
    )


class ModelVersionMapRow(Base):
    """Which maps a version is made of."""

    __tablename__ = "model_version_map"
    __table_args__ = (
        ForeignKeyConstraint(
            ["machine_id", "version"],
            ["model_version.machine_id", "model_version.version"],
            ondelete="CASCADE",
        ),
    )

    machine_id: Mapped[str] = mapped_column(String(64), primary_key=True)
    version: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    error_map_id: Mapped[int] = mapped_column(
        ForeignKey("error_map.id", ondelete="CASCADE"), primary_key=True
    )


class ReadingRow(Base):
    """Live temperatures and the machine's state at one time.

    Processes follow each other by the numbers, so none is ever used again. `early_s` is None
    where a reading did not arrive before its time.
    """

    __tablename__ = "reading"
    __table_args__ = (UniqueConstraint("machine_id", "time"), {"sqlite_autoincrement": True})

    id: Mapped[int] = mapped_column(
        BigInteger().with_variant(Integer(), "sqlite"), primary_key=True
    )
    machine_id: Mapped[str] = mapped_column(ForeignKey("machine.id", ondelete="CASCADE"))
    time: Mapped[datetime]
    temperatures_c: Mapped[dict[str, Any]]
    state: Mapped[dict[str, Any]]
    early_s: Mapped[float | None]


class TemperatureHourRow(Base):
    """An hour of a machine's readings in bins of a minute (`app.thermal.temperature_bins`).

    `minutes` says of each sensor how many bins it has, in the order in which they stand in `bins`;
    `whole` has the hour as one bin, sensor by sensor. Where `is_stale` readings of the hour were
    withdrawn since.
    """

    __tablename__ = "temperature_hour"

    machine_id: Mapped[str] = mapped_column(
        ForeignKey("machine.id", ondelete="CASCADE"), primary_key=True
    )
    hour: Mapped[datetime] = mapped_column(primary_key=True)
    is_stale: Mapped[bool]
    minutes: Mapped[dict[str, Any]]
    whole: Mapped[FloatArray]
    bins: Mapped[FloatArray]


class TemperatureHoursDoneRow(Base):
    """Up to which number readings are in `temperature_hour`: one row, or none before the first."""

    __tablename__ = "temperature_hours_done"

    id: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    number: Mapped[int] = mapped_column(BigInteger)


class WithdrawnReadingRow(Base):
    """A reading that somebody withdrew, under its old number, so that no query meets it.

    The same time may have a new reading, and that may be withdrawn as well.
    """

    __tablename__ = "withdrawn_reading"

    id: Mapped[int] = mapped_column(
        BigInteger().with_variant(Integer(), "sqlite"), primary_key=True, autoincrement=False
    )
    machine_id: Mapped[str] = mapped_column(ForeignKey("machine.id", ondelete="CASCADE"))
    time: Mapped[datetime]
    temperatures_c: Mapped[dict[str, Any]]
    state: Mapped[dict[str, Any]]
    withdrawn_at: Mapped[datetime]


class VerificationRow(Base):
    """One verification: its observations as arrays, one entry or three numbers for each.

    Numbers in threes are row by row; NaN stands for what an observation does not have. `setup`
    has places in `setup_names`; it is NULL where no observation states one. No
    number of a verification is used again: analyses name them after they are gone.
    """

    __tablename__ = "verification"
    __table_args__ = (UniqueConstraint("machine_id", "label"), {"sqlite_autoincrement": True})

    id: Mapped[int] = mapped_column(primary_key=True)
    machine_id: Mapped[str] = mapped_column(ForeignKey("machine.id", ondelete="CASCADE"))
    label: Mapped[str] = mapped_column(Text)
    datum: Mapped[str] = mapped_column(String(16))
    repeatability_um: Mapped[float | None]
    instrument: Mapped[str | None] = mapped_column(Text)
    operator: Mapped[str | None] = mapped_column(Text)
    stored_at: Mapped[datetime]
    first_at: Mapped[datetime]
    last_at: Mapped[datetime]
    observations: Mapped[int]
    components: Mapped[list[Any]]
    state_names: Mapped[list[Any]]
    judgement: Mapped[dict[str, Any] | None] = mapped_column(JSON(none_as_null=True))
    times_s: Mapped[FloatArray] = mapped_column(deferred=True, deferred_group="arrays")
    component: Mapped[FloatArray] = mapped_column(deferred=True, deferred_group="arrays")
    measured: Mapped[FloatArray] = mapped_column(deferred=True, deferred_group="arrays")
    points_mm: Mapped[FloatArray] = mapped_column(deferred=True, deferred_group="arrays")
    tool_offsets_mm: Mapped[FloatArray] = mapped_column(deferred=True, deferred_group="arrays")
    directions: Mapped[FloatArray] = mapped_column(deferred=True, deferred_group="arrays")
    states: Mapped[FloatArray] = mapped_column(deferred=True, deferred_group="arrays")
    setup_names: Mapped[list[Any]] = mapped_column(server_default="[]")
    setup: Mapped[FloatArray | None] = mapped_column(deferred=True, deferred_group="arrays")


class AnalysisRow(Base):
    """One analysis as a job: what was asked, how far it is, and its result as JSON text.

    While it runs, `owner` names the try and `beats` grows: where it no longer does, the process
    that ran it is gone. `tries` counts how often it was begun. Of a machine's analyses one runs
    at a time. `confirmed` are the sentences of the effects that the result confirms and that help:
    what verdicts need of it.
    """

    __tablename__ = "analysis"
    __table_args__ = (
        Index(
            "uq_analysis_running_machine",
            "machine_id",
            unique=True,
            sqlite_where=text("status = 'running'"),
            postgresql_where=text("status = 'running'"),
        ),
        {"sqlite_autoincrement": True},
    )

    id: Mapped[int] = mapped_column(primary_key=True)
    machine_id: Mapped[str] = mapped_column(ForeignKey("machine.id", ondelete="CASCADE"))
    model_version: Mapped[int]
    verification_ids: Mapped[list[Any]]
    holdout_fraction: Mapped[float]
    kinds: Mapped[list[Any] | None] = mapped_column(JSON(none_as_null=True))
    seed: Mapped[int]
    status: Mapped[str] = mapped_column(String(16))
    progress: Mapped[float]
    message: Mapped[str] = mapped_column(Text)
    created_at: Mapped[datetime]
    started_at: Mapped[datetime | None]
    finished_at: Mapped[datetime | None]
    owner: Mapped[str | None] = mapped_column(String(64))
    beats: Mapped[int]
    tries: Mapped[int] = mapped_column(default=0, server_default=text("0"))
    adopted_version: Mapped[int | None]
    result: Mapped[str | None] = mapped_column(Text, deferred=True)
    confirmed: Mapped[list[Any] | None] = mapped_column(JSON(none_as_null=True))


class WatchRow(Base):
    """Where the sequential test of one model version on its machine stands."""

    __tablename__ = "watch"

    machine_id: Mapped[str] = mapped_column(
        ForeignKey("machine.id", ondelete="CASCADE"), primary_key=True
    )
    model_version: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    status: Mapped[str] = mapped_column(String(16))
    state: Mapped[dict[str, Any]]
    updated_at: Mapped[datetime]


class AccessKeyRow(Base):
    """A key: what it may do, and the digest by which it is known.

    No number is used again: a session belongs to its key's.
    """

    __tablename__ = "access_key"
    __table_args__ = ({"sqlite_autoincrement": True},)

    id: Mapped[int] = mapped_column(primary_key=True)
    name: Mapped[str] = mapped_column(String(64), unique=True)
    role: Mapped[str] = mapped_column(String(16))
    machines: Mapped[list[Any] | None]
    digest: Mapped[str] = mapped_column(String(64), unique=True)
    created_at: Mapped[datetime]
    last_used_at: Mapped[datetime | None]


class BrowserSessionRow(Base):
    """A browser in which somebody stated a key; it ends with the key, or by itself."""

    __tablename__ = "browser_session"

    digest: Mapped[str] = mapped_column(String(64), primary_key=True)
    key_id: Mapped[int] = mapped_column(ForeignKey("access_key.id", ondelete="CASCADE"), index=True)
    expires_at: Mapped[datetime]


class ConnectionReportRow(Base):
    """What one process last told of its connections beside HTTP; others read it."""

    __tablename__ = "connection_report"

    owner: Mapped[str] = mapped_column(String(200), primary_key=True)
    told_at: Mapped[datetime]
    content: Mapped[str] = mapped_column(Text)


class ReceiverRow(Base):
    """One who is told of alarms, and what was told; `name` is that of the file of connections.

    `announced` says of which machines the receiver knows that they have alarms, and which. Alarms
    whose entry in the event log has a number up to `settled` and that are not lasting are dealt
    with. `test_asked_at` is set by whoever asks for a test message, all else by who sends.
    """

    __tablename__ = "receiver"

    name: Mapped[str] = mapped_column(String(64), primary_key=True)
    service: Mapped[str] = mapped_column(String(64))
    machines: Mapped[list[Any]]
    announced: Mapped[dict[str, Any]]
    settled: Mapped[int] = mapped_column(BigInteger)
    waiting: Mapped[list[Any]]
    looked_at: Mapped[datetime]
    sent_at: Mapped[datetime | None]
    sent: Mapped[str] = mapped_column(Text)
    failing_since: Mapped[datetime | None]
    failure: Mapped[str] = mapped_column(Text)
    test_asked_at: Mapped[datetime | None]
    tested_at: Mapped[datetime | None]
    test_failure: Mapped[str] = mapped_column(Text)


_LASTS = text("until IS NULL AND subject <> ''")


class EventRow(Base):
    """An event. It stays when its machine goes, and names it then still.

    `number` is given anew by each transaction that changes the row, and is larger than all that
    were committed before (`app.storage.log_numbers`); NULL only within the transaction.
    """

    __tablename__ = "event"
    __table_args__ = (
        Index("ix_event_machine_id", "machine_id", "id"),
        Index(None, "time"),
        Index("ix_event_number", "number", unique=True),
        Index("ix_event_lasting", "machine_id", postgresql_where=_LASTS, sqlite_where=_LASTS),
    )

    id: Mapped[int] = mapped_column(
        BigInteger().with_variant(Integer(), "sqlite"), primary_key=True
    )
    time: Mapped[datetime]
    kind: Mapped[str] = mapped_column(String(16))
    subject: Mapped[str] = mapped_column(String(64))
    machine_id: Mapped[str | None] = mapped_column(String(64))
    who: Mapped[str] = mapped_column(String(LONGEST_NAME))
    text: Mapped[str] = mapped_column(Text)
    details: Mapped[dict[str, Any]]
    until: Mapped[datetime | None]
    count: Mapped[int]
    number: Mapped[int | None] = mapped_column(BigInteger)
