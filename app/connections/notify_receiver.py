"""Receivers of alarms, by Apprise: e-mail, webhooks, chats and some hundred others."""

from __future__ import annotations

import os
from datetime import timedelta
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Final
from urllib.parse import urlsplit
from zoneinfo import ZoneInfo

from pydantic import Field, field_validator, model_validator

from app.connections.connection import Secret, ShortName, Table, Variable
from app.errors import list_names
from app.foreign_text import HIDDEN, shown
from app.services.tell_receivers import Rules
from app.status.alarm_message import Message
from app.status.machine_status import Verdict

if TYPE_CHECKING:
    from apprise import AppriseResult, NotifyBase

LONGEST_SEND_S: Final = 30.0
"""How long a message may take [s]."""

ALARMING: Final = (Verdict.NOT_TRUSTED, Verdict.LIMITED)

SHORTEST_SECRET: Final = 4
"""Of the parts of an address that are hidden wherever they stand [characters]."""


class NotifyTable(Table):
    """`[[notify]]`: somebody who is told of alarms."""

    extra: ClassVar[str] = "notify"
    library: ClassVar[str] = "apprise"

    name: ShortName
    url: Secret | None = None
    url_env: Variable | None = None
    machines: Annotated[tuple[ShortName, ...], Field(strict=False, max_length=1000)] = ()
    verdicts: Annotated[tuple[Verdict, ...], Field(strict=False)] = ALARMING
    after_s: float = Field(60.0, ge=0.0, le=86_400.0)
    repeat_h: float = Field(24.0, ge=0.1, le=8760.0)
    zone: str | None = None
    link: Annotated[str, Field(pattern=r"^https?://[^\s?#]+$", max_length=500)] | None = None

    @field_validator("verdicts", mode="before")
    @classmethod
    def _are_alarming(cls, raw: Any) -> Any:
        if not isinstance(raw, list) or not raw or any(v not in ALARMING for v in raw):
            raise ValueError(f"expected some of {list_names(ALARMING)}, got {raw!r:.80}")
        return tuple(map(Verdict, raw))

    @field_validator("zone")
    @classmethod
    def _is_zone(cls, name: str | None) -> str | None:
        if name is not None:
            try:
                ZoneInfo(name)
            except (KeyError, ValueError, OSError):
                raise ValueError(
                    f"expected a time zone such as Europe/Prague, got {name!r:.80}"
                ) from None
        return name

    @model_validator(mode="after")
    def _has_one_url(self) -> NotifyTable:
        if (self.url is None) == (self.url_env is None):
            raise ValueError("expected `url` or `url_env`, got both or none")
        return self

    @property
    def address(self) -> str:
        """The URL, of the file or of the environment."""
        if self.url is not None:
            return self.url.get_secret_value()
        return os.environ.get(self.url_env or "", "")

    def expect_usable(self) -> None:
        """Refuse a URL that Apprise does not know, with ValueError that says nothing of it."""
        _service(self.address)


class NotifyReceiver:
    """A receiver while the service runs.

    Parameters
    ----------
    link
        Address of the service where the file states none; empty without any.
    """

    def __init__(self, table: NotifyTable, link: str) -> None:
        zone = None if table.zone is None else ZoneInfo(table.zone)
        self.name = table.name
        self.rules = Rules(
            table.machines,
            frozenset(table.verdicts),
            timedelta(seconds=table.after_s),
            timedelta(hours=table.repeat_h),
            zone,
            (link if table.link is None else table.link).rstrip("/"),
        )
        self._address = table.address

    @cached_property
    def _service(self) -> NotifyBase:
        return _service(self._address)

    @property
    def service(self) -> str:
        """What Apprise calls the kind of service."""
        return str(self._service.service_name)[:64]

    def send(self, message: Message) -> str:
        """Send a message; say why it could not be sent, "" where it was."""
        from apprise import Apprise, NotifyFormat, NotifyType

        sender = Apprise(asset=self._service.asset)
        sender.add(self._service)
        result = sender.notify(
            message.text,
            message.title,
            notify_type=NotifyType.SUCCESS if message.is_good else NotifyType.WARNING,
            body_format=NotifyFormat.TEXT,
            timeout=LONGEST_SEND_S,
        )
        return "" if result else self._why(result)

    def _why(self, result: AppriseResult) -> str:
        reasons = list(dict.fromkeys(entry.message.strip() for entry in result.logs()))
        words = "; ".join(reasons) or f"no answer within {LONGEST_SEND_S:g} s"
        for secret in _secrets(self._address):
            words = words.replace(secret, HIDDEN)
        return shown(words)


def _service(address: str) -> NotifyBase:
    """Make what sends to an address.

    Raises
    ------
    ValueError
        If Apprise knows no such service; the address, which may be a secret, is not repeated.
    """
    from apprise import Apprise, AppriseAsset, PersistentStoreMode

    scheme = address.partition("://")[0]
    asset = AppriseAsset(
        app_id="thermap",
        app_desc="thermap",
        app_url="",
        image_url_mask="",
        storage_mode=PersistentStoreMode.MEMORY,
    )
    notify = Apprise.instantiate(address, asset=asset)
    if notify is None:
        raise ValueError(
            "expected a URL of Apprise, such as mailtos://USER:PASSWORD@HOST?to=ADDRESS or "
            f"jsons://HOST/PATH, got one of {len(address)} characters"
            + (f" that begins with {scheme[:20]}://" if "://" in address else "")
        )
    return notify


def _secrets(address: str) -> list[str]:
    """List what of an address may be a secret: all but its host, the longest first."""
    parts = urlsplit(address)
    login, _, _ = parts.netloc.rpartition("@")
    pieces = [*login.split(":"), *parts.path.split("/"), *parts.query.replace("=", "&").split("&")]
    return sorted({p for p in pieces if len(p) >= SHORTEST_SECRET}, key=len, reverse=True)
