"""What the pages' words mean: components by their codes, verdicts, and words of statistics."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from markupsafe import Markup

from app.geometry.components import COMPONENTS, Component, Kind
from app.pages.report_parts.component_names import component_name
from app.pages.wording import _, message, said

VERDICTS: Final[Mapping[str, str]] = {
    "not-trusted": message("Not trusted"),
    "limited": message("Limited"),
    "service": message("Service"),
    "trusted": message("Trusted"),
    "unknown": message("Unknown"),
}
"""The word beside each symbol."""

MEANINGS: Final[Mapping[str, str]] = {
    "not-trusted": message("There is no compensation table, or it stands still."),
    "limited": message("There is a table; the sentences beside it say where it is not right."),
    "service": message("The table is right, but a sensor failed and another stands in for it."),
    "trusted": message("The table is what the maps say, on fresh temperatures."),
    "unknown": message("The page has lost the service: its numbers are old."),
}

TERMS: Final[tuple[tuple[str, str], ...]] = (
    (message("error"), message("Actual minus nominal.")),
    (message("compensation"), message("Minus the error: what is added to the command.")),
    (
        message("map"),
        message("The errors of the machine, measured in one thermal state, with its temperatures."),
    ),
    (
        message("check"),
        message("Errors that were measured to be held against the model; they do not change it."),
    ),
    (message("residual"), message("Measured minus predicted: what the model leaves.")),
    (
        message("RMS"),
        message("Root mean square: the size of typical values, large ones count more."),
    ),
    (
        message("repeatability"),
        message("By how much repeated measurements at one place scatter (standard deviation)."),
    ),
    (message("floor"), message("What repeatability and set-ups alone would leave.")),
    (
        message("held out"),
        message("Visits that took no part in finding an effect, and then judge it."),
    ),
    (
        message("± 2 σ"),
        message("The range in which 95 of 100 values lie, by their standard deviation σ."),
    ),
    (
        message("2 ln B"),
        message("Evidence for one cause against another: above 10 it is very strong."),
    ),
    (
        message("r"),
        message("Correlation: ±1 if two things always move together, 0 if they have no relation."),
    ),
)
"""Words of the trade and of statistics, and what each means."""


def component_words(code: str) -> str:
    """Name a component in words; empty for what is none.

    >>> component_words("EBX"), component_words("SXY"), component_words("points x")
    ('rotation of X about Y (pitch if Z is vertical)', 'squareness of X and Y', '')
    """
    return _words_of(COMPONENTS[code]) if code in COMPONENTS else ""


def _words_of(one: Component) -> str:
    axis = (one.axis or "").upper()
    direction = one.direction.upper().translate(_ABOUT)
    match one.kind:
        case Kind.LINEAR:
            return _("positioning of %(axis)s", axis=axis)
        case Kind.STRAIGHTNESS:
            return _("straightness of %(axis)s in %(direction)s", axis=axis, direction=direction)
        case Kind.ANGULAR:
            return _rotation(axis, direction)
        case Kind.SQUARENESS:
            return _("squareness of %(one)s and %(other)s", one=one.code[1], other=one.code[2])
        case Kind.SLOPE:
            parent, _slope, along = one.code.partition("^")
            words = component_words(parent)
            return _("%(error)s: how it grows along %(axis)s", error=words, axis=along.upper())
        case Kind.ROTARY_LOCATION if one.is_rotation:
            return _("tilt of axis %(axis)s about %(about)s", axis=one.code[2], about=direction)
        case Kind.ROTARY_LOCATION:
            return _(
                "place of axis %(axis)s in %(direction)s", axis=one.code[2], direction=direction
            )


def _rotation(axis: str, about: str) -> str:
    if axis == about:
        return _("roll of %(axis)s", axis=axis)
    if axis == "Z":
        return _("rotation of Z about %(about)s", about=about)
    if about == "Z":
        return _("rotation of %(axis)s about Z (yaw if Z is vertical)", axis=axis)
    return _(
        "rotation of %(axis)s about %(about)s (pitch if Z is vertical)", axis=axis, about=about
    )


_ABOUT: Final = str.maketrans("ABC", "XYZ")


def named(code: str) -> Markup | str:
    """Write a component's code, with its words for who points at it."""
    words = component_words(code)
    if not words:
        return component_name(code)
    return Markup('<abbr title="{}">{}</abbr>').format(words, code)


def verdict_words(group: str) -> str:
    """Give the word of a verdict."""
    return _(VERDICTS[group])


def entries() -> list[tuple[str, list[tuple[str, str]]]]:
    """List the glossary as a page shows it: titles, and under each its words."""
    rigid = (Kind.LINEAR, Kind.STRAIGHTNESS, Kind.ANGULAR, Kind.SQUARENESS)
    codes = [code for code, one in COMPONENTS.items() if one.kind in rigid]
    return [
        (_("Verdicts"), [(_(VERDICTS[key]), said(words)) for key, words in MEANINGS.items()]),
        (_("Words"), [(said(term), said(words)) for term, words in TERMS]),
        (_("Error components (ISO 230-1)"), [(code, component_words(code)) for code in codes]),
    ]
