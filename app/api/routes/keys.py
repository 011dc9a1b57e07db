"""Keys: who may ask for what. For admins, and only where keys are asked for."""

from __future__ import annotations

from typing import Annotated, Final

from fastapi import Path, Query, Request, Response
from starlette.exceptions import HTTPException

from app.access.keys import AccessKey, NewAccessKey, Role
from app.api.access import Access, AccessControl
from app.api.bodies import BodyRoute
from app.api.dependencies import ContextDep
from app.api.router import Router
from app.services.access_keys import KeyRequest, create_key, revoke_key, show_keys


async def expect_keys(request: Request) -> None:
    """Let nobody make a key where nobody is asked for one.

    Who reaches an open service would else make an admin's key, and be let in by it when the
    service is no longer open.
    """
    control: AccessControl = request.app.state.access
    if not control.is_on:
        raise HTTPException(
            403,
            "expected a service that asks for keys (`thermap serve --require-keys`), got one that "
            "answers everybody; `thermap keys` works on its database all the same",
        )


router = Router(
    route_class=BodyRoute,
    read_first=expect_keys,
    access=Access(Role.ADMIN, all_machines=True),
    prefix="/v1/keys",
    tags=["keys"],
)

KeyPath = Annotated[str, Path(description="The key's name", examples=["line-3"])]
LastAdminQuery = Annotated[
    bool,
    Query(
        description="Whether it may be the last key of an admin: after that only `thermap keys "
        "create` beside the database makes keys"
    ),
]

_STORED_NOWHERE: Final[dict[str, str]] = {"Cache-Control": "no-store"}


@router.get("", summary="List keys")
def get_keys(context: ContextDep) -> list[AccessKey]:
    """List all keys by name: role, machines, last use. The keys themselves are stored nowhere."""
    return show_keys(context.database)


@router.post("", status_code=201, summary="Make a key")
def post_key(context: ContextDep, body: KeyRequest, response: Response) -> NewAccessKey:
    """Make a key; the answer's `secret` is shown this once, and stored nowhere."""
    new_key = create_key(context.database, body.name, body.role, body.machines, context.now)
    response.headers["Location"] = f"/v1/keys/{new_key.key.name}"
    response.headers.update(_STORED_NOWHERE)
    return new_key


@router.delete("/{name}", status_code=204, summary="Revoke a key")
def delete_key_route(
    context: ContextDep, name: KeyPath, last_admin: LastAdminQuery = False
) -> None:
    """Let a key be none any more: streams opened with it end, browsers ask for another.

    An admin's last key is kept (409) unless `last_admin` says that it may go.
    """
    revoke_key(context.database, name, context.now, last_admin=last_admin)
