"""What an answer is worth, the truth being known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from app.effects.hypothesis import IN_SERIES

Described = Mapping[str, Any]

FORMS: Final = {"second-time-constant": ("thermal-lag", IN_SERIES)}
"""Effects of no kind that a kind has as another form: it names no such effect by itself, but says
where the values cannot tell the two forms apart."""

NAMED_AS: Final = {"bent-by-difference": {"kind": "sensor-gradient", "in_library": True}}
"""Effects that only their course along the axis keeps from being of a kind: who names that with the
right sensors is right."""


def judge(answer: Described, truth: Sequence[Described]) -> str:
    """Judge an answer in a word.

    Parameters
    ----------
    answer
        The result of an analysis, as JSON.
    truth
        The planted effects, as the simulator describes them.

    Returns
    -------
    str
        `alone`: every effect was found, and nothing else; `tie`: some only in a stated tie;
        `extra`: all were found, and something else too; `part`: some were found; `wrong`: others
        were found; `missed`: none was. Without effects: `nothing`, or `false`. For effects in no
        family: `unexplained`, `proxy` (named beside unexplained structure), `wrong name`, or
        `missed`. `(unexplained)` follows where a right answer was called so.
    """
    truth = [{**e, **NAMED_AS.get(str(e["kind"]), {})} for e in truth]
    effects = answer["effects"]
    is_open = answer["verdict"] == "unexplained"
    if not truth:
        return "false" if effects else "unexplained" if is_open else "nothing"
    if not all(e["in_library"] for e in truth):
        if effects and all(_is_tied_with_form(e, truth) for e in effects):
            return "tie (unexplained)" if is_open else "tie"
        if is_open:
            return "proxy" if effects else "unexplained"
        return "wrong name" if effects else "missed"
    return _of_known(effects, truth) + (" (unexplained)" if is_open else "")


def _of_known(effects: Sequence[Described], truth: Sequence[Described]) -> str:
    matches = [[_match(effect, true) for true in truth] for effect in effects]
    seen = {i for row in matches for i, how in enumerate(row) if how}
    extra = any(not any(row) for row in matches)
    if not effects:
        return "missed"
    if not seen:
        return "wrong"
    if len(seen) < len(truth):
        return "part"
    if extra:
        return "extra"
    return "alone" if all("alone" in row for row in matches) else "tie"


def _match(effect: Described, true: Described) -> str:
    """Say whether a found effect is a true one: `alone`, `tie`, or empty."""
    if _is_same(effect, true):
        return "alone"
    tied = (a for a in effect["alternatives"] if a["tied"])
    return "tie" if any(_is_same(a, true) for a in tied) else ""


def _is_same(effect: Described, true: Described) -> bool:
    """Kind, component, sensors and state; of a fingerprint any of its components."""
    parameters = true["parameters"]
    wanted = [parameters["slope"].lower()] if "slope" in parameters else true["components"]
    codes = [c.lower() for c in effect["components"]]
    components = any(c.lower() in codes for c in wanted)
    if true["kind"] in ("thermal-lag", "sensor-fault"):
        components = len(set(codes) & {c.lower() for c in wanted}) > len(wanted) / 2
        components = components and len(codes) <= len(wanted)
    sensors = set(true["sensors"]) <= set(effect["sensors"]) or true["kind"] in (
        "temperature-curvature",
    )
    states = parameters.get("state") in (None, *effect["states"])
    return effect["kind"] == true["kind"] and components and sensors and states


def _is_tied_with_form(effect: Described, truth: Sequence[Described]) -> bool:
    """Whether it is said that a found effect may as well be another form, which is the true one."""
    tied = [(a["kind"], a["variant"]) for a in effect["alternatives"] if a["tied"]]
    named = {e["kind"]: e for e in truth}
    return any(
        FORMS.get(kind) in tied and set(effect["components"]) <= set(true["components"])
        for kind, true in named.items()
    )
