"""Procrastinate's queue in PostgreSQL: which worker gets which analysis.

The table of analyses says what is asked for, how far it is and what was found, on either kind
of database. The queue beside it is for handing out alone, in a schema of its own, and can be
made anew at any time: what waits and is not in it is handed out again. On SQLite there is none.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from importlib import resources
from typing import TYPE_CHECKING, Any, Final

from sqlalchemy import Connection, text
from sqlalchemy.orm import Session

from app.errors import StorageUnavailable
from app.storage.database import Database

if TYPE_CHECKING:
    from procrastinate import PsycopgConnector

SCHEMA: Final = "thermap_jobs"
"""Of PostgreSQL, where Procrastinate's tables and functions are."""

QUEUE: Final = "analyses"
TASK: Final = "thermap.analysis"


def prepare_queue(connection: Connection) -> None:
    """Make the queue's schema, or make it anew where an older Procrastinate made it.

    A newer one keeps what an older one asks for, and is left as it is.
    """
    newest = _newest_step()
    made_by = connection.scalar(
        text("SELECT obj_description(to_regnamespace(:schema)::oid, 'pg_namespace')"),
        {"schema": SCHEMA},
    )
    if made_by is not None and made_by >= newest:
        return
    schema = resources.files("procrastinate.sql").joinpath("schema.sql").read_text("utf-8")
    connection.exec_driver_sql(f"DROP SCHEMA IF EXISTS {SCHEMA} CASCADE")
    connection.exec_driver_sql(f"CREATE SCHEMA {SCHEMA}")
    with _in_schema(connection):
        # The driver's own: SQLAlchemy would read placeholders in it.
        driver: Any = connection.connection.driver_connection
        driver.execute(schema)
    connection.exec_driver_sql(f"COMMENT ON SCHEMA {SCHEMA} IS '{newest}'")


def hand_out(session: Session, analysis_id: int, machine_id: str) -> None:
    """Let a worker have an analysis once this transaction is committed; on SQLite nothing.

    Of one machine's analyses workers get one at a time.
    """
    if session.get_bind().dialect.name != "postgresql":
        return
    from procrastinate import SyncPsycopgConnector
    from procrastinate.exceptions import ConnectorException
    from procrastinate.manager import JobManager
    from procrastinate.tasks import configure_task

    # By the connection of this transaction: there is no job without its analysis, and none is lost.
    connection = session.connection()
    with _in_schema(connection):
        task = configure_task(
            name=TASK,
            job_manager=JobManager(SyncPsycopgConnector()),
            queue=QUEUE,
            lock=machine_id,
            connection=connection.connection.driver_connection,
        )
        try:
            task.defer(analysis_id=analysis_id)
        except ConnectorException as error:
            raise StorageUnavailable(f"the database is away: {error.__cause__}") from error


def queue_connector(database: Database, most: int) -> PsycopgConnector:
    """Make a worker's connections to the queue.

    Parameters
    ----------
    most
        How many at the same time, beside the one that listens.
    """
    from procrastinate import PsycopgConnector

    from app.storage.postgresql import APPLICATION_NAME, CONNECT_TIMEOUT_S

    engine = database.engine
    _, arguments = engine.dialect.create_connect_args(engine.url)
    options = f"{arguments.pop('options', '')} -c search_path={SCHEMA}".strip()
    return PsycopgConnector(
        kwargs={
            **arguments,
            "options": options,
            "application_name": APPLICATION_NAME,
            "connect_timeout": CONNECT_TIMEOUT_S,
        },
        min_size=1,
        max_size=most,
        timeout=CONNECT_TIMEOUT_S,
    )


@contextmanager
def _in_schema(connection: Connection) -> Iterator[None]:
    """Let names without a schema be the queue's, within a transaction."""
    # For the transaction alone (`true` below): where one fails, the path goes back with it.
    before = connection.scalar(text("SELECT current_setting('search_path')"))
    _search(connection, SCHEMA)
    yield
    _search(connection, before)


def _search(connection: Connection, path: str) -> None:
    connection.execute(text("SELECT set_config('search_path', :path, true)"), {"path": path})


def _newest_step() -> str:
    """Name the newest step of Procrastinate's own tables."""
    steps = resources.files("procrastinate.sql").joinpath("migrations").iterdir()
    return max(step.name for step in steps if step.name.endswith(".sql"))
