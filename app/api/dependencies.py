"""What routes are handed."""

from __future__ import annotations

from typing import Annotated

from fastapi import Depends, Path, Request

from app.services.context import Context


def get_context(request: Request) -> Context:
    """Give the application's context."""
    context: Context = request.app.state.context
    return context


ContextDep = Annotated[Context, Depends(get_context)]
MapPath = Annotated[int, Path(description="The map's number", examples=[1])]
VersionPath = Annotated[int, Path(description="Number of the version", examples=[3])]
MachinePath = Annotated[str, Path(description="The machine's id", examples=["mcfv5050"])]
