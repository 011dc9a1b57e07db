"""The page of a controller's files: which controller, its options, and what it cannot hold."""

from __future__ import annotations

import json
from collections.abc import Sequence
from datetime import datetime
from typing import Any, Final

from app.controllers.format import SIGN_WORDS, Format, Status
from app.controllers.option_fields import OptionField, option_fields
from app.controllers.registry import FORMATS
from app.errors import capitalised
from app.pages.dashboard.numbers import MINUS, NO_BREAK
from app.pages.environment import render_machine
from app.status.machine_status import MachineStatus

HOW_KNOWN: Final = {
    Status.CONTROLLER: "the controller itself loaded such files",
    Status.SOURCE: "by the reader's own documentation or source",
    Status.MANUAL: "a manufacturer's manual gives the form; not tried on a controller",
    Status.SEED: "by printed examples; sign and limits are to be confirmed at the machine",
    Status.OURS: "thermap's own form",
}


def export_page(
    status: MachineStatus, chosen: Format | None, writable: Sequence[str], now: datetime
) -> str:
    """Write the page on which a controller is chosen and its files are made.

    Parameters
    ----------
    writable
        Components that the machine's table and the controller both have; empty without a table.
    """
    options = [] if chosen is None else [_option(o, writable) for o in option_fields(chosen)]
    return render_machine(
        "export",
        "/export",
        status.machine,
        status.name,
        now,
        status=status,
        formats=list(FORMATS.values()),
        chosen=chosen,
        sign="" if chosen is None or chosen.sign is None else SIGN_WORDS[chosen.sign],
        how_known="" if chosen is None else HOW_KNOWN[chosen.status],
        needed=[one for one in options if one["is_required"]],
        others=[one for one in options if not one["is_required"]],
        command="" if chosen is None else _command(status.machine, chosen, options),
    )


def _option(option: OptionField, writable: Sequence[str]) -> dict[str, Any]:
    """Lay out one option as fields of a form, with what holds where they are left as they are."""
    unit = option.unit or ""
    choices = option.choices
    if option.takes == "components":
        choices = tuple(writable) or choices
    stated = option.name.removesuffix(_SUFFIXES.get(unit, "")).replace("_", " ")
    return {
        "name": option.name,
        "label": capitalised(stated),
        "unit": unit,
        "about": option.description.replace("`", ""),
        "takes": option.takes,
        "is_required": option.required,
        "range": _range(option),
        "default": _default(option),
        "choices": [_choice(one, option) for one in choices],
        "is_group": bool(option.axes) or option.takes == "components",
        "inputs": _inputs(option),
    }


_SUFFIXES: Final = {"mm": "_mm", "µm": "_um", "1/mm": "_per_mm"}


def _inputs(option: OptionField) -> list[dict[str, str]]:
    """Give each field of an option: its axis, and the value that it begins with."""
    if not option.axes:
        return [{"axis": "", "value": _text(option.default)}]
    values = option.default or {}
    return [{"axis": axis, "value": _text(values.get(axis))} for axis in option.axes]


def _choice(value: Any, option: OptionField) -> dict[str, Any]:
    words = SIGN_WORDS.get(value) if isinstance(value, str) else None
    return {
        "json": json.dumps(value),
        "words": words or str(value),
        "is_default": value == option.default,
    }


def _default(option: OptionField) -> str:
    """Say in words what holds where an option is left out; empty where its description does."""
    if option.takes == "components" or option.default in (None, {}):
        return ""
    if option.axes:
        return ", ".join(f"{a.upper()} {_text(v)}" for a, v in option.default.items())
    return _text(option.default)


def _range(option: OptionField) -> str:
    r"""Say from where to where an option may lie.

    >>> _range(OptionField("a_mm", "", False, None, "number", unit="mm", above=0, maximum=5))
    'above 0 to 5\xa0mm'
    """
    if option.maximum is None:
        return ""
    low = f"above {_words(option.above)}" if option.minimum is None else _words(option.minimum)
    words = f"{low} to {_words(option.maximum)}"
    return f"{words}{NO_BREAK}{option.unit}" if option.unit else words


def _text(value: Any) -> str:
    return "" if value is None else f"{value:.10g}" if isinstance(value, float) else str(value)


def _words(value: float | None) -> str:
    return f"{value:,.10g}".replace(",", NO_BREAK).replace("-", MINUS)


def _command(machine: str, chosen: Format, options: list[dict[str, Any]]) -> str:
    """Write the command that makes the same files, for a browser without JavaScript."""
    needed = [f"--option {one['name']}=…" for one in options if one["is_required"]]
    return " ".join(["thermap export", machine, "--controller", chosen.name, *needed])
