"""What every router of the service has in common."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from fastapi import APIRouter, Depends, FastAPI

from app.access.keys import Role
from app.api.access import Access, needs
from app.api.dependencies import refuse_unknown_query
from app.api.gate import SAFE_METHODS
from app.api.turns import take_turn


class Router(APIRouter):
    """The routes of one subject, each of which waits for its turn and wants no unknown query.

    Parameters
    ----------
    read_first
        A dependency of all of them that comes before the turn, since it may take long.
    access
        Who may use them, but for those whose function states it by `needs`; None for viewers
        where they read, and metrologists where they may write.
    """

    def __init__(
        self,
        *,
        read_first: Callable[..., Any] | None = None,
        access: Access | None = None,
        **named: Any,
    ) -> None:
        self._access = access
        first = () if read_first is None else (Depends(read_first),)
        # Whose turn it is ends with its function.
        turn = Depends(take_turn, scope="function")
        super().__init__(**named, dependencies=(Depends(refuse_unknown_query), *first, turn))

    def add_api_route(self, path: str, endpoint: Callable[..., Any], **named: Any) -> None:
        """Add a route, and say at it who may use it."""
        super().add_api_route(path, endpoint, **named)
        reads = SAFE_METHODS.issuperset(named["methods"])
        usual = self._access or Access(Role.VIEWER if reads else Role.METROLOGIST)
        access: Access = getattr(endpoint, "access", usual)
        needs(access.role, all_machines=access.all_machines)(self.routes[-1])

    def serve_by(self, service: FastAPI) -> None:
        """Let a service answer at these routes, as they are.

        `include_router` would make every route anew, with all models of its body and its answer:
        half a second at the first request of each service.
        """
        service.router.routes.extend(self.routes)
