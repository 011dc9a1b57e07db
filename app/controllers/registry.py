"""Every file format by its name; registered explicitly."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from pydantic import ValidationError

from app.controllers.etalon import ETALON
from app.controllers.fagor import FAGOR
from app.controllers.fanuc import FANUC
from app.controllers.format import Format, Options
from app.controllers.heidenhain import HEIDENHAIN
from app.controllers.isg import ISG
from app.controllers.linuxcnc import LINUXCNC
from app.controllers.mdsi import MDSI
from app.controllers.siemens_cec import SIEMENS_CEC
from app.controllers.siemens_enc_comp import SIEMENS_ENC_COMP
from app.controllers.siemens_temperature import SIEMENS_TEMPERATURE
from app.controllers.thermap_csv import THERMAP_CSV
from app.errors import FieldError, InvalidContent, UnknownThing, list_names

FORMATS: Final[Mapping[str, Format]] = {
    controller.name: controller
    for controller in (
        LINUXCNC,
        SIEMENS_CEC,
        SIEMENS_ENC_COMP,
        SIEMENS_TEMPERATURE,
        FANUC,
        HEIDENHAIN,
        MDSI,
        FAGOR,
        ETALON,
        ISG,
        THERMAP_CSV,
    )
}


def format_named(name: str) -> Format:
    """Give a format by its name, or raise UnknownThing that lists what exists."""
    try:
        return FORMATS[name]
    except KeyError:
        raise UnknownThing(
            f"expected a controller of {list_names(FORMATS)}, got {name!r}"
        ) from None


def options_of(controller: Format, options: Mapping[str, Any]) -> Options:
    """Check what is stated of a format's options.

    Raises
    ------
    InvalidContent
        If one is unknown, missing or of another kind; `sign` is missing where nobody has
        verified a format's sign.
    """
    try:
        return controller.options.model_validate(dict(options))
    except ValidationError as error:
        problems = [_field_error(controller, problem) for problem in error.errors()]
        raise InvalidContent(
            "; ".join(f"{e.field}: {e.message}" for e in problems), problems
        ) from None


def _field_error(controller: Format, error: Mapping[str, Any]) -> FieldError:
    path = [str(part) for part in error["loc"] if part != "[key]"]
    fields = controller.options.model_fields
    field = ".".join(["options", *path])
    if error["type"] == "extra_forbidden":
        return FieldError(
            field, f"expected the options of {controller.name}: {list_names(fields)}; got another"
        )
    if error["type"] == "missing":
        about = fields[path[0]].description if path and path[0] in fields else ""
        return FieldError(field, f"expected a value, got none. {about}".strip())
    expected = str(error["msg"]).removeprefix("Input should be ").removeprefix("Value error, ")
    if error["type"] == "string_pattern_mismatch":
        of_axis = "[key]" in error["loc"]
        expected = "an axis x, y or z" if of_axis else "1 to 32 letters A to Z, digits or _"
    return FieldError(field, f"expected {expected}, got {str(error.get('input'))[:60]!r}")
