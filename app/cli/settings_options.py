"""Settings as options of a command: their names, types, limits and words are those of the settings.

`Settings` reads the same names from the environment, where nobody runs the command line.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import wraps
from typing import Annotated, Any, Final, get_origin

import typer
from pydantic import ValidationError
from pydantic.fields import FieldInfo

from app.errors import InvalidContent
from app.field_errors import field_error
from app.settings import Settings

_OPTIONS: Final = {"allowed_hosts": "--allowed-host", "cors_origins": "--cors-origin"}
"""Options of which each takes one of a setting's entries."""

_METAVARS: Final = {
    "host": "HOST",
    "port": "PORT",
    "allowed_hosts": "NAME",
    "cors_origins": "ORIGIN",
    "forwarded_allow_ips": "ADDRESS",
    "database_url": "URL",
    "opcua_endpoint": "URL",
    "config": "FILE.toml",
    "log_level": "LEVEL",
}
_METAVARS_BY_UNIT: Final = {"[s]": "SECONDS", "[days]": "DAYS"}
"""In which unit a setting's description says that it is, to what stands for its value."""


def with_settings(*names: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Give a command settings as options, before those of its own.

    The command takes them as `settings`, a mapping for `checked_settings`.
    """

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        @wraps(command)
        def with_options(*arguments: Any, **options: Any) -> None:
            settings = {name: options.pop(name) for name in names}
            # An option that takes several has none where it was not given.
            stated = {name: value for name, value in settings.items() if value is not None}
            command(*arguments, settings=stated, **options)

        own = inspect.signature(command, eval_str=True)
        parameters = [p for p in own.parameters.values() if p.name != "settings"]
        first = [p for p in parameters if p.kind is p.POSITIONAL_OR_KEYWORD]
        shared = [_parameter(name, Settings.model_fields[name]) for name in names]
        rest = [p for p in parameters if p.kind is not p.POSITIONAL_OR_KEYWORD]
        signature = own.replace(parameters=[*first, *shared, *rest])
        # Typer reads options off the signature, and types off the annotations.
        with_options.__signature__ = signature  # type: ignore[attr-defined]
        with_options.__annotations__ = {
            p.name: p.annotation for p in signature.parameters.values()
        } | {"return": None}
        return with_options

    return decorate


def checked_settings(settings: dict[str, Any]) -> Settings:
    """Make the settings; a value out of range is wrong usage."""
    try:
        return Settings(**settings)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        name = str(first["loc"][0])
        raise typer.BadParameter(field_error(first).message, param_hint=_option(name)) from None


def blamed_option(error: InvalidContent) -> typer.BadParameter | None:
    """Blame the option whose setting is found wrong when the service is made; None: no option."""
    name, _, words = error.detail.partition(": ")
    if name not in Settings.model_fields:
        return None
    return typer.BadParameter(words, param_hint=_option(name))


def _parameter(name: str, field: FieldInfo) -> inspect.Parameter:
    """Describe a setting as typer wants an option of a command."""
    is_several = get_origin(field.annotation) is tuple
    is_flag = field.annotation is bool
    least, most = (
        next((getattr(m, side) for m in field.metadata if hasattr(m, side)), None)
        for side in ("ge", "le")
    )
    option = typer.Option(
        f"{_option(name)}/--no-{name}" if is_flag and field.default else _option(name),
        envvar=f"THERMAP_{name.upper()}",
        metavar=None if is_flag else _metavar(name, field),
        help=f"{field.description}{'; once for each' if is_several else ''}.",
        show_default=field.default not in (None, ""),
        min=least,
        max=most,
    )
    annotation = list[str] | None if is_several else field.annotation
    # What computes its default does so where the setting is left out.
    default = None if is_several or field.default_factory else field.default
    return inspect.Parameter(
        name,
        inspect.Parameter.KEYWORD_ONLY,
        default=default,
        annotation=Annotated[annotation, option],
    )


def _option(name: str) -> str:
    return _OPTIONS.get(name, "--" + name.replace("_", "-"))


def _metavar(name: str, field: FieldInfo) -> str:
    if name in _METAVARS:
        return _METAVARS[name]
    words = field.description or ""
    return next((metavar for unit, metavar in _METAVARS_BY_UNIT.items() if unit in words), "N")
