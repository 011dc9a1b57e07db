"""Commands that ask a service: where it is, which machine is meant, and how its answer is shown."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib import import_module
from inspect import Parameter, Signature, signature
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias, TypeVar, get_args

from rich.console import RenderableType

from app.cli.answers import show
from app.cli.options import (
    JsonOption,
    MachineOption,
    UrlOption,
    by_name,
    chosen_machine,
    connect,
    expect_finite,
    in_options,
)
from thermap import DEFAULT_URL

Answer = TypeVar("Answer")

if TYPE_CHECKING:
    from thermap import ThermapClient, calls, loop_calls
    from thermap.call import Call
else:

    class _Later:
        """A module that is loaded when something of it is needed: help needs nothing."""

        def __init__(self, module: str) -> None:
            self._module = module

        def __getattr__(self, name: str) -> Any:
            return getattr(import_module(self._module), name)

    calls, loop_calls = _Later("thermap.calls"), _Later("thermap.loop_calls")
    ThermapClient = object

__all__ = [
    "ChosenMachine",
    "Shown",
    "ThermapClient",
    "asks",
    "calls",
    "loop_calls",
    "parameters_of",
    "with_parameters",
]

ChosenMachine: TypeAlias = Annotated[str, "chosen"]
"""The machine that --machine states, or the only one that is stored."""


class Shown:
    """What is asked, and how its answer is laid out where not its JSON is wanted."""

    def __init__(self, call: Call[Answer], view: Callable[[Answer], RenderableType]) -> None:
        self.call: Call[Any] = call
        self.view: Callable[[Any], RenderableType] = view


def asks(command: Callable[..., Shown | None]) -> Callable[..., None]:
    """Make a command of a function that asks a service.

    The command takes the function's options and --url; --json where the function gives what is
    `Shown`; --machine for a `ChosenMachine`. The function's parameter `thermap` is the client. What
    the service refuses of a question is told by the options that state it.
    """
    parameters = parameters_of(command)
    given = signature(command, eval_str=True).return_annotation
    is_shown = Shown in (given, *get_args(given))
    chooses = any(p.annotation == ChosenMachine for p in parameters)
    takes_client = any(p.name == "thermap" for p in parameters)

    def ask(*, url: str, **stated: Any) -> None:
        expect_finite(stated)
        stated = by_name(stated)
        json = stated.pop("json") if is_shown else False
        with connect(url) as thermap, in_options():
            if takes_client:
                stated["thermap"] = thermap
            if chooses:
                stated["machine"] = chosen_machine(thermap, stated["machine"])
            shown = command(**stated)
            if shown is not None:
                show(thermap, shown.call, shown.view, json=json)

    options = [
        p.replace(annotation=MachineOption, default=None) if p.annotation == ChosenMachine else p
        for p in parameters
        if p.name != "thermap"
    ]
    if is_shown:
        options.append(_option("json", JsonOption, False))
    return with_parameters(ask, command, [*options, _option("url", UrlOption, DEFAULT_URL)])


def parameters_of(function: Callable[..., object]) -> list[Parameter]:
    """Give a function's parameters; by their names, so that any may have a default."""
    parameters = signature(function, eval_str=True).parameters.values()
    return [parameter.replace(kind=Parameter.KEYWORD_ONLY) for parameter in parameters]


def with_parameters(
    made: Callable[..., None], of: Callable[..., object], parameters: Sequence[Parameter]
) -> Callable[..., None]:
    """Let a function be seen, by typer too, with other parameters, and the help of another one."""
    made.__doc__ = of.__doc__
    made.__signature__ = Signature(parameters)  # type: ignore[attr-defined]
    return made


def _option(name: str, annotation: Any, default: Any) -> Parameter:
    return Parameter(name, Parameter.KEYWORD_ONLY, default=default, annotation=annotation)
