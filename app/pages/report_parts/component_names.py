"""Names of components, as a person reads them."""

from __future__ import annotations

from app.geometry.components import COMPONENTS


def component_name(name: str) -> str:
    """Name a component, or one direction of the error at points.

    Parameters
    ----------
    name
        A component's code, or `points x`, `points y`, `points z`.

    Examples
    --------
    >>> component_name("EXX"), component_name("points y")
    ('EXX', 'points, Y')
    """
    stem, _, letter = name.partition(" ")
    return f"points, {letter.upper()}" if stem == "points" else name


def chapter_name(name: str) -> str:
    """Give the chapter's notation of a component; empty where there is none.

    Examples
    --------
    >>> chapter_name("EYX"), chapter_name("points y")
    ('D_y(x)', '')
    """
    return COMPONENTS[name].chapter if name in COMPONENTS else ""
