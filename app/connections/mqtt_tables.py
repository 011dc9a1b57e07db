"""`[[mqtt]]`: a broker, and which of its topics are which sensors of which machines."""

from __future__ import annotations

import os
import ssl
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, TypeAlias

from pydantic import (
    BeforeValidator,
    Field,
    ValidationInfo,
    field_validator,
    model_validator,
)

from app.compensation.table_steps import SMALLEST_STEP
from app.connections.connection import (
    ConnectionTable,
    Secret,
    ShortName,
    Table,
    TemperatureTable,
    Variable,
    each,
)
from app.connections.mqtt_payloads import JsonPath, TimeForm
from app.connections.mqtt_topics import TopicPattern


def _parsed(parse: Callable[[str], Any]) -> BeforeValidator:
    def read(raw: object) -> Any:
        if not isinstance(raw, str):
            raise ValueError(f"expected a text, got {raw!r:.80}")
        return parse(raw)

    return BeforeValidator(read)


def _time_form(raw: str) -> TimeForm:
    if raw not in list(TimeForm):
        raise ValueError(f"expected one of {', '.join(TimeForm)}, got {raw!r:.80}")
    return TimeForm(raw)


Path_: TypeAlias = Annotated[JsonPath, _parsed(JsonPath.parse)]
FilePath: TypeAlias = Annotated[Path, _parsed(Path)]
SparkplugName: TypeAlias = Annotated[str, Field(min_length=1, max_length=200, pattern=r"^[^/+#]+$")]


class PathTable(TemperatureTable):
    """A temperature in a JSON document: where, and how it is written."""

    path: Path_


class MetricTable(TemperatureTable):
    """A metric of Sparkplug by its name, and how a temperature is written."""

    metric: Annotated[str, Field(min_length=1, max_length=500)]


Paths: TypeAlias = Annotated[dict[str, PathTable], each("path")]
Metrics: TypeAlias = Annotated[dict[str, MetricTable], each("metric")]


class TopicTable(TemperatureTable):
    """`[[mqtt.topics]]`: a topic, and what its messages say."""

    topic: Annotated[TopicPattern, _parsed(TopicPattern.parse)]
    machine: ShortName | None = None
    sensor: ShortName | None = None
    value: Path_ | None = None
    sensors: Paths = Field(default_factory=dict)
    state: dict[str, Path_] = Field(default_factory=dict)
    time: Path_ | None = None
    time_form: Annotated[TimeForm, _parsed(_time_form)] = TimeForm.ISO_8601
    silent_after_s: float | None = Field(None, ge=1.0, le=86400.0)

    @model_validator(mode="after")
    def _says_which_is_what(self) -> TopicTable:
        names = self.topic.names
        if (self.machine is None) == ("machine" not in names):
            raise ValueError(
                "expected the machine either as `machine` or as {machine}, got "
                + ("both" if self.machine else "neither")
            )
        ways = [self.sensor is not None, "sensor" in names, bool(self.sensors or self.state)]
        if sum(ways) != 1:
            raise ValueError(
                "expected one of `sensor`, {sensor} and `sensors` (with `state`), got "
                + ("none" if not any(ways) else "more than one")
            )
        if ways[2] and self.model_fields_set & {"value", *TemperatureTable.model_fields}:
            raise ValueError(
                "expected a path for each of `sensors`, and there a unit, factor or offset, got "
                "`value`, `unit`, `factor` or `offset` beside them"
            )
        if self.time is not None and self.value is None and not ways[2]:
            raise ValueError("expected `value` or `sensors` with `time`, got plain numbers")
        if self.silent_after_s is not None and self.topic.group:
            raise ValueError(
                "expected no silent_after_s with $share, got one: others of the group "
                "hear what this one does not"
            )
        return self


class SparkplugTable(Table):
    """`[[mqtt.sparkplug]]`: an edge node, or one of its devices, that is a machine."""

    machine: ShortName
    group: SparkplugName
    node: SparkplugName
    device: SparkplugName | None = None
    sensors: Annotated[Metrics, Field(min_length=1, max_length=200)]
    state: dict[str, Annotated[str, Field(min_length=1, max_length=500)]] = Field(
        default_factory=dict
    )
    rebirth: bool = False


class MqttTable(ConnectionTable):
    """One broker."""

    extra = "mqtt"
    library = "paho"

    host: Annotated[str, Field(pattern=r"^[^\s/]+$", max_length=253)]
    port: int | None = Field(None, ge=1, le=65535)
    client_id: Annotated[str, Field(pattern=r"^[A-Za-z0-9._-]+$", max_length=64)]
    topics: tuple[TopicTable, ...] = Field((), strict=False, max_length=500)
    sparkplug: tuple[SparkplugTable, ...] = Field((), strict=False, max_length=500)
    session_expiry_s: int = Field(3600, ge=60, le=30 * 86400)
    receive_maximum: int = Field(500, ge=1, le=5000)
    keepalive_s: int = Field(15, ge=2, le=600)
    username: Annotated[str, Field(min_length=1, max_length=200)] | None = None
    password: Secret | None = None
    password_env: Variable | None = None
    tls: bool = False
    ca: FilePath | None = None
    cert: FilePath | None = None
    key: FilePath | None = None
    publish: (
        Annotated[str, Field(pattern=r"^[^/+#$][^+#]*[^/+#]$|^[^/+#$]$", max_length=200)] | None
    ) = None
    min_change_um: float = Field(0.1, ge=0.0, le=1e6)
    max_step_um: float | None = Field(None, ge=SMALLEST_STEP, le=1e6)

    @model_validator(mode="after")
    def _fits_together(self) -> MqttTable:
        if not self.topics and not self.sparkplug and self.publish is None:
            raise ValueError("expected `topics`, `sparkplug` or `publish`, got none of them")
        if self.password is not None and self.password_env is not None:
            raise ValueError("expected `password` or `password_env`, got both")
        if self.secret is not None and self.username is None:
            raise ValueError("expected a `username` with the password, got none")
        if self.key is not None and self.cert is None:
            raise ValueError("expected `cert` with `key`, got none")
        return self

    @field_validator("ca", "cert", "key")
    @classmethod
    def _beside_the_file(cls, raw: Path | None, info: ValidationInfo) -> Path | None:
        return None if raw is None else (info.context or {}).get("folder", Path()) / raw

    @model_validator(mode="after")
    def _can_encrypt(self) -> MqttTable:
        self.encryption()
        return self

    @property
    def secret(self) -> str | None:
        """The password, of the file or of the environment."""
        if self.password_env is not None:
            return os.environ.get(self.password_env)
        return None if self.password is None else self.password.get_secret_value()

    @property
    def state_topic(self) -> str | None:
        """Where `online` is retained, and by the broker `offline` when contact is lost."""
        return None if self.publish is None else f"{self.publish}/state"

    @property
    def endpoint(self) -> str:
        """Where the broker is."""
        return f"{'mqtts' if self.is_encrypted else 'mqtt'}://{self.host}:{self.port_used}"

    @property
    def is_encrypted(self) -> bool:
        """Whether it speaks TLS."""
        return self.tls or self.ca is not None or self.cert is not None

    @property
    def port_used(self) -> int:
        """The port, or the usual one."""
        return self.port or (8883 if self.is_encrypted else 1883)

    def encryption(self) -> ssl.SSLContext | None:
        """Make what TLS needs; None without TLS. ValueError says what is wrong with the files."""
        if not self.is_encrypted:
            return None
        try:
            tls = ssl.create_default_context(cafile=self.ca)
        except (OSError, ssl.SSLError) as why:
            raise ValueError(f"expected certificates as `ca`, got {self.ca}: {_why(why)}") from None
        if self.cert is not None:
            try:
                # A key behind a passphrase would be asked for at the terminal.
                tls.load_cert_chain(self.cert, self.key, password=lambda: b"")
            except (OSError, ssl.SSLError) as why:
                raise ValueError(
                    f"expected a certificate and its key without a passphrase, got {self.cert} "
                    f"and {self.key or 'no key'}: {_why(why)}"
                ) from None
        return tls


def _why(error: OSError) -> str:
    return error.strerror or str(error)
