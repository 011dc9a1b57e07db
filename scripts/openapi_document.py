"""The service's OpenAPI document, for scripts and tests."""

from __future__ import annotations

import tempfile
from functools import cache
from typing import Any

from app.main import create_app
from app.settings import Settings


@cache
def openapi_document() -> dict[str, Any]:
    """Ask a service on an empty database for its document, which is the same for all services."""
    with tempfile.TemporaryDirectory() as folder:
        service = create_app(Settings(database_url=f"sqlite:///{folder}/empty.db"))
        try:
            return service.openapi()
        finally:
            service.state.context.database.close()
