"""Which form of an answer a client asked for (RFC 9110, 12.5.1)."""

from __future__ import annotations

from collections.abc import Sequence


def chosen_form(accept: str, offered: Sequence[str]) -> str:
    """Choose the form that a client likes best; the first one where it does not say.

    Parameters
    ----------
    accept
        The header Accept; may be empty.
    offered
        Media types, the usual one first. Where none of them is accepted the usual one
        is sent all the same.

    Examples
    --------
    >>> chosen_form("text/html,application/json;q=0.9", ["application/json", "text/html"])
    'text/html'
    >>> chosen_form("*/*", ["application/json", "text/html"])
    'application/json'
    """
    qualities = dict(_media_range(part) for part in accept.split(",") if part.strip())
    return max(offered, key=lambda media_type: _quality(media_type, qualities))


def _media_range(part: str) -> tuple[str, float]:
    media_range, *parameters = (text.strip().lower() for text in part.split(";"))
    weights = [p.removeprefix("q=") for p in parameters if p.startswith("q=")]
    try:
        return media_range, float(weights[0]) if weights else 1.0
    except ValueError:
        return media_range, 0.0


def _quality(media_type: str, qualities: dict[str, float]) -> float:
    """The quality of the most specific range that the type is in."""
    family = f"{media_type.partition('/')[0]}/*"
    return next((qualities[r] for r in (media_type, family, "*/*") if r in qualities), 0.0)
