"""What routes are handed."""

from __future__ import annotations

from typing import Annotated

from fastapi import Depends, Path, Request

from app.errors import InvalidContent, list_names
from app.services.context import Context
from app.services.run_analyses import AnalysisRunner


def get_context(request: Request) -> Context:
    """Give the application's context."""
    context: Context = request.app.state.context
    return context


def get_runner(request: Request) -> AnalysisRunner:
    """Give who runs the queued analyses."""
    runner: AnalysisRunner = request.app.state.runner
    return runner


def refuse_unknown_query(request: Request) -> None:
    """Refuse parameters that a route does not know: a misspelt one would not be missed.

    Raises
    ------
    InvalidContent
        That names the parameters of the route.
    """
    known = [field.alias for field in request.scope["route"].dependant.query_params]
    for name in request.query_params:
        if name not in known:
            raise InvalidContent.of_field(
                name, f"expected the query parameters {list_names(known)}, came {name!r}"
            )


ContextDep = Annotated[Context, Depends(get_context)]
MapPath = Annotated[int, Path(description="The map's number", examples=[1])]
VerificationPath = Annotated[int, Path(description="The verification's number", examples=[1])]
AnalysisPath = Annotated[int, Path(description="The analysis' number", examples=[1])]
VersionPath = Annotated[int, Path(description="Number of the version", examples=[3])]
MachinePath = Annotated[str, Path(description="The machine's id", examples=["mcfv5050"])]
