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
MachinePath = Annotated[str, Path(description="The machine's id", examples=["mcfv5050"])]
