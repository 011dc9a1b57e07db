"""Connections to PostgreSQL that give up when no answer comes.

The server is told how long a statement may take. But a server that is frozen, or a
network that keeps a connection open and delivers nothing, needs a limit at this end.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from threading import Lock
from time import monotonic
from typing import Any, Final
from weakref import WeakSet

import psycopg
from psycopg.conninfo import make_conninfo
from sqlalchemy import URL, Connection, Engine, PoolProxiedConnection, create_engine, event
from sqlalchemy.exc import DBAPIError, SQLAlchemyError

from app.errors import StorageUnavailable
from app.storage.limits import QUESTION, Limits
from app.storage.news import CHANNEL, News, read_payload

CONNECT_TIMEOUT_S: Final = 5

_HOLDS_LOCK: Final = (
    "SELECT EXISTS (SELECT FROM pg_locks WHERE locktype = 'advisory' AND granted "
    "AND pid = pg_backend_pid() AND objid = %(number)s)"
)
_TAKE: Final = "SELECT pg_try_advisory_lock(%(number)s)"

APPLICATION_NAME: Final = "thermap"
"""By which PostgreSQL lists our connections."""

MARGIN_S: Final = 1.0
"""How much longer this end waits than the server, which knows the reason [s]."""

IDLE_S: Final = 120.0
"""A transaction in which nothing is asked for so long belongs to a process that hangs [s]."""

POOL_SIZE: Final = 10
MOST_CONNECTIONS: Final = 40

AT_ONCE: Final = 2
"""Transactions of readings that arrived together: one is made while another is being committed."""

TOGETHER_S: Final = 1.0
"""How long those wait for a lock who wait together [s]; after that each waits alone."""

KEPT_FOR_S: Final = 0.1
"""A connection that was used so shortly ago is not asked first whether it lives [s]."""

DriverError: Final = psycopg.Error
"""Whatever the driver says went wrong, where SQLAlchemy is not between."""

_GIVE_UP: Final = {
    "connect_timeout": CONNECT_TIMEOUT_S,
    "tcp_user_timeout": CONNECT_TIMEOUT_S * 1000,
    "keepalives_idle": CONNECT_TIMEOUT_S,
    "keepalives_interval": 1,
    "keepalives_count": CONNECT_TIMEOUT_S,
}
"""A network that swallows everything, without this, keeps a request for a quarter of an hour."""


class ImpatientConnection(psycopg.Connection[Any]):
    """A connection that is closed when the server does not answer in time.

    `answer_s` is how long an answer may take [s], None for any time; what is `broken_off`
    from another thread gives up within a tenth of a second.
    """

    answer_s: float | None = QUESTION.statement_s
    broken_off = False

    def wait(self, gen: Generator[Any, Any, Any], *args: Any, **named: Any) -> Any:
        """Wait for the server, as psycopg does everywhere, but not for ever."""
        return super().wait(self._impatient(gen), *args, **named)

    def _impatient(self, gen: Generator[Any, Any, Any]) -> Generator[Any, Any, Any]:
        """Pass on what is waited for; psycopg comes by every tenth of a second at least."""
        heard_at = monotonic()
        try:
            wanted = next(gen)
            while True:
                ready = yield wanted
                if ready:
                    heard_at = monotonic()
                elif self.broken_off:
                    self._give_up(gen, "broken off, the service ends")
                elif self.answer_s is not None and monotonic() - heard_at > self.answer_s:
                    self._give_up(gen, f"no answer within {self.answer_s:g} s")
                wanted = gen.send(ready)
        except StopIteration as end:
            return end.value

    def _give_up(self, gen: Generator[Any, Any, Any], reason: str) -> None:
        # The answer may still come, and would be taken for that of the next statement: a connection
        # of which that is not known is used no more.
        gen.close()
        self.pgconn.finish()
        raise psycopg.OperationalError(reason)


class Listener:
    """Hears what other processes tell at their commits, on a connection of its own.

    News that were told while there was no connection are lost: whoever listens looks at
    everything after `connect`, and so misses nothing.

    Parameters
    ----------
    sender
        Whose own news are passed over.
    """

    def __init__(self, connect: Callable[[], ImpatientConnection], sender: str) -> None:
        self._connect = connect
        self._sender = sender
        self._connection: ImpatientConnection | None = None

    @property
    def is_connected(self) -> bool:
        """Whether news are being heard."""
        return self._connection is not None

    def connect(self) -> None:
        """Begin to listen; StorageUnavailable where the server is away."""
        with self._giving_up():
            self._connection = self._connect()
            self._connection.answer_s = QUESTION.statement_s
            self._connection.execute(f"LISTEN {CHANNEL}")

    def hear(self, within_s: float) -> list[News]:
        """Wait for news; give those that have come, none after a time without any [s].

        Raises
        ------
        StorageUnavailable
            If the connection is lost.
        """
        if self._connection is None:
            return []
        with self._giving_up():
            self._connection.answer_s = None  # it is nobody's turn to answer
            came = list(self._connection.notifies(timeout=within_s, stop_after=1))
            news = [read_payload(notification.payload) for notification in came]
        return [heard[0] for heard in news if heard is not None and heard[1] != self._sender]

    def ping(self) -> None:
        """Ask something, to see that the connection lives; StorageUnavailable where it does not."""
        if self._connection is not None:
            with self._giving_up():
                self._connection.answer_s = QUESTION.statement_s
                self._connection.execute("SELECT 1")

    def close(self) -> None:
        """Listen no more."""
        connection, self._connection = self._connection, None
        if connection is not None:
            with suppress(psycopg.Error):
                connection.close()

    @contextmanager
    def _giving_up(self) -> Iterator[None]:
        try:
            yield
        except psycopg.Error as error:
            self.close()
            reason = (str(error).strip().splitlines() or [type(error).__name__])[0]
            raise StorageUnavailable(f"the database is away: {reason}") from error


class Duty:
    """What one of several processes does for all: whoever holds an advisory lock.

    The lock is held by a connection of its own. When the holder dies, or is cut off, PostgreSQL
    lets go of it, and the next one that asks has it.
    """

    def __init__(self, connect: Callable[[], ImpatientConnection], number: int) -> None:
        self._connect = connect
        self._number = number
        self._connection: ImpatientConnection | None = None

    def is_ours(self) -> bool:
        """Take the duty where nobody has it; say whether it is ours now."""
        try:
            if self._connection is None:
                self._connection = self._connect()
            # Asked each time, not remembered: the server may have ended the session meanwhile. And
            # not taken again where it is ours: PostgreSQL counts, and would want as many releases.
            row = self._connection.execute(_HOLDS_LOCK, {"number": self._number}).fetchone()
            if row is None or not row[0]:
                row = self._connection.execute(_TAKE, {"number": self._number}).fetchone()
        except psycopg.Error:
            self.lay_down()
            return False
        return row is not None and bool(row[0])

    def lay_down(self) -> None:
        """Let another one have it."""
        connection, self._connection = self._connection, None
        if connection is not None:
            with suppress(psycopg.Error):
                connection.close()


class KeptConnections:
    """A few connections for what is written many times a second.

    To lend one of a pool, and to ask it first whether it lives, costs as much as a statement.
    """

    def __init__(self, engine: Engine, answer_s: float | None) -> None:
        self._engine = engine
        self._answer_s = answer_s
        self._idle: list[tuple[PoolProxiedConnection, float]] = []
        self._is_closed = False

    @contextmanager
    def writing(self) -> Iterator[ImpatientConnection]:
        """Open a transaction that is committed at the end, or rolled back whole.

        On the driver's own connection: what SQLAlchemy does around a statement takes longer than
        the statement. Errors are SQLAlchemy's.
        """
        with _as_sqlalchemys():
            # Two threads come here at a time; `append` and `pop` of a list are one step each, and
            # need no lock.
            lent = self._take()
            connection: Any = lent.driver_connection
            connection.answer_s = self._answer_s
            try:
                yield connection
                connection.commit()
            except BaseException:
                self._give_back(lent)
                raise
        self._idle.append((lent, monotonic()))
        if self._is_closed:  # while something was written
            self.close()

    def close(self) -> None:
        """Give those up that nobody uses, and each that is used as soon as that ends."""
        self._is_closed = True
        while self._idle:
            self._give_back(self._idle.pop()[0])
        self._engine.dispose()

    def _take(self) -> PoolProxiedConnection:
        """Take the one that was used last, if that was just now, else one of the pool."""
        try:
            lent, used_s = self._idle.pop()
        except IndexError:
            return self._engine.raw_connection()
        if monotonic() - used_s <= KEPT_FOR_S:
            return lent
        self._give_back(lent)
        return self._engine.raw_connection()

    def _give_back(self, lent: PoolProxiedConnection) -> None:
        """Let the pool have a connection again, which rolls back what was not committed."""
        driver: Any = lent.driver_connection
        with suppress(SQLAlchemyError, psycopg.Error):
            if self._is_closed or driver.closed:
                lent.invalidate()  # a pool that was given up closes none that come back to it
            else:
                lent.close()


@contextmanager
def _as_sqlalchemys() -> Iterator[None]:
    """Raise what the driver raises as SQLAlchemy does, where no SQLAlchemy is between."""
    try:
        yield
    except psycopg.Error as error:
        raise DBAPIError.instance(None, None, error, psycopg.Error) from error


class PostgresqlConnections:
    """Makes the engine, and can break off all its connections, those at work too.

    `kept` is for readings that arrive together, `at_once` transactions at a time.
    """

    at_once: Final = AT_ONCE

    def __init__(self, url: URL, limits: Limits) -> None:
        self._made: WeakSet[ImpatientConnection] = WeakSet()
        self._is_closed = False
        self._closing = Lock()
        self._apart = _connect_args(url, limits)
        self.engine = self._engine(url, limits, POOL_SIZE, MOST_CONNECTIONS - POOL_SIZE)
        lock_s = TOGETHER_S if limits.lock_s is None else min(TOGETHER_S, limits.lock_s)
        self.kept = KeptConnections(
            self._engine(url, replace(limits, lock_s=lock_s), AT_ONCE, 0), _answer_s(limits)
        )

    def _engine(self, url: URL, limits: Limits, lent: int, more: int) -> Engine:
        """Make an engine whose transactions have these limits where they state no others."""
        engine = create_engine(
            url,
            # After a restart of the server the pool is full of connections that it has closed: each
            # would fail the request that gets it.
            pool_pre_ping=True,
            pool_size=lent,
            max_overflow=more,
            pool_timeout=CONNECT_TIMEOUT_S,
            connect_args=_connect_args(url, limits),
        )
        # The driver looks at the options only when it connects, where nobody expects a mistake.
        arguments = engine.dialect.create_connect_args(url)[1]
        make_conninfo(**{name: value for name, value in arguments.items() if name != "context"})
        event.listen(engine, "do_connect", self._connect)
        event.listen(engine, "begin", partial(_begin, limits))
        event.listen(engine, "checkin", _checkin)
        return engine

    def listener(self, sender: str) -> Listener:
        """Make what hears the news of other processes."""
        return Listener(self._connect_apart, sender)

    def duty(self, number: int) -> Duty:
        """Make what knows whether a duty is this process'."""
        return Duty(self._connect_apart, number)

    def _connect_apart(self) -> ImpatientConnection:
        """Make a connection that is not in the pool, and of which each statement is committed."""
        arguments, named = self.engine.dialect.create_connect_args(self.engine.url)
        named.update(self._apart, autocommit=True)
        return self._connect(None, None, arguments, named)

    def close(self) -> None:
        """Give up all connections, and let whoever waits for one of them go."""
        # First of all new ones are refused: who is broken off would else connect again.
        with self._closing:
            self._is_closed = True
            for connection in self._made:
                connection.broken_off = True
        self.engine.dispose()
        self.kept.close()

    def _connect(
        self, _dialect: Any, _record: Any, arguments: Any, named: Any
    ) -> ImpatientConnection:
        if self._is_closed:
            raise psycopg.OperationalError("the service ends")
        connection = ImpatientConnection.connect(*arguments, **named)
        with self._closing:
            self._made.add(connection)
            connection.broken_off = self._is_closed  # closed while it was made
        return connection


def _connect_args(url: URL, limits: Limits) -> dict[str, Any]:
    from_url = url.query.get("options", "")
    options = f"{_options(limits)} {from_url if isinstance(from_url, str) else ' '.join(from_url)}"
    return {**_GIVE_UP, "application_name": APPLICATION_NAME, "options": options.strip()}


def _begin(usual: Limits, connection: Connection) -> None:
    limits: Limits = connection.get_execution_options().get("thermap_limits", usual)
    driver: Any = connection.connection.driver_connection
    driver.answer_s = _answer_s(limits)
    if limits is not usual:
        settings = "; ".join(f"SET LOCAL {name} = {ms}" for name, ms in _stated_ms(limits))
        connection.exec_driver_sql(settings)


def _answer_s(limits: Limits) -> float | None:
    """How long this end waits for an answer [s]; None for any time."""
    return None if limits.statement_s is None else limits.statement_s + MARGIN_S


def _checkin(connection: ImpatientConnection | None, _record: Any) -> None:
    """Let the ping that precedes the next use be answered soon."""
    if connection is not None:
        connection.answer_s = QUESTION.statement_s


def _options(limits: Limits) -> str:
    return " ".join(f"-c {name}={ms}" for name, ms in _stated_ms(limits))


def _stated_ms(limits: Limits) -> list[tuple[str, int]]:
    """Name PostgreSQL's settings, with their values [ms]; 0 is no limit."""
    idle_s = None if limits.statement_s is None else max(IDLE_S, limits.statement_s)
    return [
        ("lock_timeout", _ms(limits.lock_s)),
        ("statement_timeout", _ms(limits.statement_s)),
        ("idle_in_transaction_session_timeout", _ms(idle_s)),
    ]


def _ms(seconds: float | None) -> int:
    # At least 1: rounded to 0 the shortest limit would be none.
    return 0 if seconds is None else max(1, round(1000 * seconds))
