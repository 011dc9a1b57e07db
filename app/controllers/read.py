"""Files of a controller, read by what they and the user say of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from app.controllers.format import CHECK_FILE, ControllerFile, Format, Options, Parsed
from app.controllers.heads import machine_named, options_named
from app.controllers.registry import options_of
from app.errors import InvalidContent, repeated


def read_files(
    controller: Format, files: Sequence[ControllerFile], overrides: Mapping[str, Any]
) -> tuple[Options, Parsed]:
    """Read a controller's files.

    Parameters
    ----------
    files
        All files of one controller. Of the check table that lies beside an export the head is
        read: some formats have no place for one.
    overrides
        The format's options. What our files say of how they were written need not be stated.

    Raises
    ------
    InvalidContent
        If an option is wrong or contradicts what a file says, if files are of two machines, or if
        a file would be read wrongly.
    """
    twice = repeated(file.name for file in files)
    if twice:
        raise InvalidContent.of_field("files", f"expected each name once, got {twice[0]!r} twice")
    options = _options(controller, files, overrides)
    tables = [file for file in files if file.name.rpartition("/")[2] != CHECK_FILE]
    return options, replace(controller.parse(tables, options), machine=_machine(files))


def _options(
    controller: Format, files: Sequence[ControllerFile], overrides: Mapping[str, Any]
) -> Options:
    """Unite what files and the user state; where both state an option, they have to agree."""
    written: dict[str, Any] = {}
    where: dict[str, str] = {}
    for file in files:
        for name, value in options_named(file, controller.name):
            if written.setdefault(name, value) != value:
                raise InvalidContent.of_field(
                    f"files.{file.name}",
                    f"expected {name} = {written[name]!r} as in {where[name]}, got {value!r}: the "
                    "files were written with different options",
                )
            where.setdefault(name, file.name)
    options = options_of(controller, {**written, **overrides})
    as_written = options_of(controller, {**overrides, **written})
    for name in written:
        if getattr(options, name) != getattr(as_written, name):
            raise InvalidContent.of_field(
                f"options.{name}",
                f"expected {written[name]!r}, with which {where[name]} says that it was written, "
                f"got {overrides[name]!r}",
            )
    return options


def _machine(files: Sequence[ControllerFile]) -> str | None:
    """Give the machine that the files name, None where they name none."""
    machine: str | None = None
    for file in files:
        named = machine_named(file.content)
        if named is not None and named != (machine or named):
            raise InvalidContent.of_field(
                f"files.{file.name}", f"expected files of one machine, got {machine} and {named}"
            )
        machine = machine or named
    return machine
