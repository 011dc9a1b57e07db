"""What our files say of themselves: whose they are, and the options that reading them needs."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any, Final

from app.controllers.error_table import Origin
from app.controllers.format import SIGN_WORDS, ControllerFile, Format, Options
from app.controllers.lines import LONGEST_LINE, unsigned
from app.errors import InvalidContent
from app.units import iso_time

_MACHINE: Final = re.compile(r"thermap: machine (\S{1,64})(?!\S)")
_OPTION: Final = re.compile(r"thermap: ([\w-]{1,64}) option (\w{1,64}) = (.+)")


def head(
    origin: Origin, controller: Format, options: Options, values: str | None = None
) -> list[str]:
    """Write what stands at the head of a file, in ASCII and without a comment's sign.

    Parameters
    ----------
    values
        What the values are; where left out, what their sign says.
    """
    temperatures = ", ".join(
        f"{s} {unsigned(t, 2)}" for s, t in sorted(origin.temperatures_c.items())
    )
    # Defaults, too: another version may have others.
    chosen = options.model_dump(
        mode="json", exclude_none=True, exclude=set(controller.options.layout)
    )
    return [
        _ascii(line)
        for line in (
            f"thermap: machine {origin.machine_id} ({origin.machine_name}), "
            f"model version {origin.model_version}",
            f"{controller.title}; format {controller.status.value}",
            f"computed {iso_time(origin.computed_at.timestamp())} at temperatures [deg C]: "
            f"{temperatures or 'none'}",
            f"values: {values or SIGN_WORDS[controller.sign_of(options)]}",
            *(
                f"thermap: {controller.name} option {name} = {json.dumps(value)}"
                for name, value in chosen.items()
                if value != {}
            ),
        )
    ]


def _ascii(text: str) -> str:
    return "".join(c if " " <= c <= "~" else "?" for c in text)


def machine_named(content: str) -> str | None:
    """Find the machine that the head of a file names, None where it names none.

    >>> machine_named("; thermap: machine mcfv5050 (MCFV), model version 3")
    'mcfv5050'
    """
    match = _MACHINE.search(content)
    return match[1] if match else None


def options_named(file: ControllerFile, controller: str) -> Iterator[tuple[str, Any]]:
    """Go through the options with which a file says that it was written.

    >>> head = '# thermap: linuxcnc option linear_units = "inch"'
    >>> list(options_named(ControllerFile("thermap.ini", head), "linuxcnc"))
    [('linear_units', 'inch')]

    Raises
    ------
    InvalidContent
        If one is not as it was written.
    """
    for name_of_format, option, written in _OPTION.findall(file.content):
        if name_of_format != controller:
            continue
        try:
            if len(written) > LONGEST_LINE:
                raise ValueError(written)
            yield option, json.loads(written)
        except (ValueError, RecursionError):
            raise InvalidContent.of_field(
                f"files.{file.name}",
                f"expected the option {option} as it was written, in JSON, got {written[:60]!r}",
            ) from None
